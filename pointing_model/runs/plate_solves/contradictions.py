"""Headers of images that describe their sky twice, and not alike.

By the FITS standard (4.0, section 8, and Greisen & Calabretta 2002, section 2.1.2) CD counts and a
CDELT or CROTA beside it does not; PC beside CD is forbidden. Programs that solve an image again and
leave what another wrote make such headers.
"""

import re


class NotThere(ValueError):
    """An image lacks what a row needs; the text says what."""


_CD, _PC = re.compile(r'CD(\d_\d|\d{6})'), re.compile(r'PC(\d_\d|\d{6})')
_CROTA, _PV = re.compile(r'CROTA\d'), re.compile(r'PV\d_\d+')
_SIP = re.compile(r'(A|B|AP|BP)_(ORDER|DMAX|\d+_\d+)')
#: keywords of the one description that has no letter at its end
WCS = re.compile('|'.join([*(p.pattern for p in (_CD, _PC, _CROTA, _PV, _SIP)),
                           r'C(TYPE|RPIX|RVAL|DELT|UNIT)\d', 'LONPOLE', 'LATPOLE', 'WAT.*']))
#: projections of IRAF: what bends them stands in WAT, which is not read
_UNREAD = ('TNX', 'ZPX')


def readings(header):
    """What the WCS of a header may mean.

    Parameters
    ----------
    header : astropy.io.fits.Header

    Returns
    -------
    headers : list of Header
        One, or several of which it is not known which counts: the first as the standard has it.
    said : str
        What is in it twice.

    Raises
    ------
    NotThere
        PC beside CD, a keyword twice with different values, or a projection that is not read.
    """
    if _has(header, _CD) and _has(header, _PC):
        raise NotThere('its WCS has PC beside CD, which the FITS standard forbids: which counts is '
                       'not known; solve the image again')
    refuse_twice(header, [key for key in set(header) if WCS.fullmatch(key)])
    code = str(header['CTYPE1'])[5:8].upper()
    if code in _UNREAD:
        raise NotThere(f'its WCS has the projection {code}, whose distortion is not read')
    # TAN has no PV of the second axis: it is what SCAMP wrote before TPV had a name
    if code == 'TAN' and any(key.startswith('PV2_') for key in header):
        tpv = without(header, _SIP)
        for key in ('CTYPE1', 'CTYPE2'):
            tpv[key] = f'{str(header[key])[:5]}TPV'
        if not _has(header, _SIP):
            return [tpv], ''
        return [_with_suffix(without(header, _PV)), tpv], 'coefficients of SIP and of TPV'
    if _has(header, _SIP) and not str(header['CTYPE1']).upper().endswith('-SIP'):
        return [without(header, _SIP), _with_suffix(header)], \
            'coefficients of SIP, and no -SIP in CTYPE'
    if _has(header, _PC) and _has(header, _CROTA):
        return [without(header, _CROTA), without(header, _PC)], 'CROTA beside PC'
    return [header], ''


def refuse_twice(header, names):
    """Refuse a keyword that is there several times, with different values.

    Raises
    ------
    NotThere
    """
    for name in sorted(names):
        values = [header[name, i] for i in range(header.count(name))] if name in header else []
        if any(value != values[0] for value in values):
            raise NotThere(f'{name} is there {len(values)} times, with different values')


def without(header, pattern):
    """A copy of a header without the keywords that match."""
    out = header.copy()
    for key in set(out):
        if pattern.fullmatch(key):
            out.remove(key, remove_all=True)
    return out


def _has(header, pattern):
    return any(map(pattern.fullmatch, header))


def _with_suffix(header):
    out = header.copy()
    for key in ('CTYPE1', 'CTYPE2'):
        out[key] = f'{str(header[key])[:8]}-SIP'
    return out
