# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The YAML file in a folder of images that maps their keywords to columns of a run."""

import difflib
import re
from dataclasses import dataclass
from pathlib import Path

from pointing_model.mount_kinds import KINDS, MountKind
from pointing_model.mounts import ALTAZ
from pointing_model.runs.run import COLUMNS, column_name
from pointing_model.sky.site import SITE

from ..columns.declarations import declare
from .frames import Frame

#: moments of an exposure, as fractions of it
MOMENTS = {'start': 0.0, 'middle': 0.5, 'end': 1.0}
_KEYS = ('images', 'keywords', 'mount', 'site', 'time_is', 'encoders_at', 'frame', 'readings',
         'boresight')
#: further columns that `keywords` may give
OTHERS = ('exposure_s', 'sigma_arcsec', 'telescope', 'pier_side', 'ra_enc_deg')
_PLACES = ('az_deg', 'el_deg', 'ra_deg', 'dec_deg', 'ha_deg', 'scale_arcsec_px', 'parity')
PATTERNS = ('*.fits', '*.fit', '*.fts', '*.fits.gz', '*.fits.fz')


@dataclass(frozen=True)
class Keyword:
    """A column of a run: ``scale`` times the value of the keyword plus ``offset``.

    Several `names` are date and time. `constant`, if not None, replaces the keyword.
    """

    names: tuple = ()
    scale: float = 1.0
    offset: float = 0.0
    constant: float | str | None = None


@dataclass(frozen=True)
class Mapping:
    """Contents of the YAML file.

    Attributes
    ----------
    path : Path
        The YAML file.
    patterns : tuple of str
        File name patterns of the images in its folder.
    columns : dict of str to Keyword
        Keys are column names of a CSV file.
    site : dict of str to Keyword
        Keys are the names of `SITE`.
    shift : float
        Time from the moment of the time keyword to the encoder reading, as a fraction of the
        exposure.
    names : MountKind
        Names of the axes of the readings.
    mount : str or None
        See `mounts.parse_mount`.
    frame : Frame or None
        Replaces the frame of the images.
    readings : Frame or None
        Frame of readings given as right ascension and declination; None: of date.
    boresight : tuple of float, or None
        Pixel that the mount points (FITS: counted from 1); None: the middle of the image.
    """

    path: Path
    patterns: tuple
    columns: dict
    site: dict
    shift: float
    names: MountKind = ALTAZ.names
    mount: str | None = None
    frame: Frame | None = None
    readings: Frame | None = None
    boresight: tuple | None = None

    @property
    def needed(self):
        """Columns that an image must have."""
        return ('time', *_readings(self.names, self.columns))

    def images(self, folder=None):
        """Files of the images, sorted by name.

        Raises
        ------
        ValueError
            There are none.
        """
        folder = Path(folder) if folder is not None else self.path.parent
        found = sorted({file for pattern in self.patterns for file in folder.glob(pattern)
                        if file.is_file()})
        if not found:
            raise ValueError(f'{folder} has no image {", ".join(self.patterns)}')
        return found


def load_mapping(path):
    """Read the YAML file of a mount's images.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Mapping

    Raises
    ------
    ValueError
        The file is not YAML, has an unknown key or an invalid keyword, or lacks a moment.
    OSError
        The file cannot be read.
    """
    import yaml  # only needed for folders of images
    path = Path(path)
    try:
        document = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        line = getattr(getattr(error, 'problem_mark', None), 'line', None)
        raise ValueError(f'{path}{"" if line is None else f", line {line + 1}"}: not a YAML '
                         'file') from None
    if not isinstance(document, dict) or not isinstance(document.get('keywords'), dict):
        raise ValueError(f'{path}: no section "keywords:" with the keywords of a mount\'s images')
    _known(path, document, _KEYS, '')
    columns = {name: _keyword(path, f'keywords: {name}', value)
               for name, value in document['keywords'].items()}
    names = next((kind for kind in KINDS.values() if _readings(kind, columns)[0] in columns),
                 ALTAZ.names)
    known = (*(column_name(name, names) for name in COLUMNS), *OTHERS)
    for name in columns:
        if not isinstance(name, str) or not name:
            raise ValueError(f'{path}, keywords: {name!r} is not the name of a column')
        if name in _PLACES:
            raise ValueError(f'{path}, keywords: {name} comes from the solution of the image')
        near = difflib.get_close_matches(name, known, 1, 0.85)
        if name not in known and near:
            raise ValueError(f'{path}, keywords: column {name!r} is unknown; did you mean '
                             f'{near[0]}?')
    needed = ('time', *_readings(names, columns))
    missing = [name for name in needed if name not in columns]
    if missing:
        near = difflib.get_close_matches(missing[0], [
            str(name) for name in columns if name not in needed], 1)
        raise ValueError(f'{path}, keywords: no keyword for {", ".join(missing)}'
                         + (f' (closest: {near[0]})' if near else ''))
    patterns = document.get('images', PATTERNS)
    patterns = (patterns,) if isinstance(patterns, str) else tuple(patterns or ())
    if not patterns or not all(isinstance(p, str) and p and not Path(p).is_absolute()
                               for p in patterns):
        raise ValueError(f'{path}, images: not a pattern of file names beside it')
    frames = {}
    for key in ('frame', 'readings'):
        if document.get(key) is not None:
            declare(frames, key, document[key], path)
    return Mapping(path, patterns, columns, _site(path, document.get('site')),
                   _shift(path, document, columns), names, _mount(path, document.get('mount')),
                   frames.get('sky_frame'), frames.get('readings_frame'),
                   _boresight(path, document.get('boresight')))


def _known(path, given, names, where):
    for key in given:
        if key not in names:
            near = difflib.get_close_matches(str(key), names, 1, 0.6)
            hint = f'did you mean {near[0]}?' if near else f'known are {", ".join(names)}'
            raise ValueError(f'{path}{where}: unknown key {str(key)[:40]!r}; {hint}')


def _keyword(path, where, value):
    """A keyword, a number, a list of keywords (date, time), or a dict with keyword and scale."""
    if isinstance(value, bool) or value is None:
        raise ValueError(f'{path}, {where}: {value!r} is neither a keyword nor a number')
    if isinstance(value, int | float):
        return Keyword(constant=float(value))
    if isinstance(value, str):
        return Keyword((value.upper(),))
    if isinstance(value, list) and value and all(isinstance(v, str) for v in value):
        return Keyword(tuple(v.upper() for v in value))
    if isinstance(value, dict) and isinstance(value.get('keyword'), str):
        _known(path, value, ('keyword', 'scale', 'offset'), f', {where}')
        try:
            return Keyword((value['keyword'].upper(),), float(value.get('scale', 1.0)),
                           float(value.get('offset', 0.0)))
        except (TypeError, ValueError):
            pass
    raise ValueError(f'{path}, {where}: {str(value)[:40]!r} is neither a keyword, a number, nor '
                     '{keyword: ..., scale: ..., offset: ...}')


def _site(path, given):
    if given is None:
        return {}
    if not isinstance(given, dict):
        raise ValueError(f'{path}: site needs latitude_deg and longitude_deg')
    _known(path, given, SITE, ', site')
    return {name: _keyword(path, f'site: {name}', value) for name, value in given.items()}


def _shift(path, document, columns):
    """Time from the moment of the time keyword to the encoder reading, in exposures."""
    moments = []
    for key in ('time_is', 'encoders_at'):
        value = document.get(key)
        if value not in MOMENTS:
            text = 'is not said' if value is None else f'{str(value)[:40]!r} is unknown'
            raise ValueError(f'{path}: {key} {text}: start, middle or end of the exposure')
        moments.append(MOMENTS[value])
    shift = moments[1] - moments[0]
    if shift and 'exposure_s' not in columns:
        raise ValueError(f'{path}, keywords: no keyword for exposure_s, and the time is of the '
                         f'{document["time_is"]} while the encoders are read at the '
                         f'{document["encoders_at"]}')
    return shift


def _readings(names, columns):
    """Names of the reading columns; ``ra_enc_deg`` for an equatorial mount that has it."""
    first, second = (column_name(f'{axis}_enc', names) for axis in ('az', 'el'))
    return 'ra_enc_deg' if names.celestial and 'ra_enc_deg' in columns else first, second


def _mount(path, given):
    if given is not None and not isinstance(given, str):
        raise ValueError(f'{path}: mount {str(given)[:40]!r} is none: altaz, equatorial, german or '
                         'free:AZ,EL (keywords: telescope is for a name)')
    return given


def _boresight(path, given):
    if given is None:
        return None
    if (not isinstance(given, list) or len(given) != 2
            or not all(isinstance(v, int | float) and abs(v) < 1e6 for v in given)):
        raise ValueError(f'{path}: boresight is not a pixel [x, y]')
    return float(given[0]), float(given[1])


class NotThere(ValueError):
    """An image lacks data that a row needs; the text says which."""


_CD, _PC = re.compile(r'CD(\d_\d|\d{6})'), re.compile(r'PC(\d_\d|\d{6})')
_CROTA, _PV = re.compile(r'CROTA\d'), re.compile(r'PV\d_\d+')
_SIP = re.compile(r'(A|B|AP|BP)_(ORDER|DMAX|\d+_\d+)')
#: keywords of the primary WCS, which has no letter at the end of its keywords
WCS = re.compile('|'.join([*(p.pattern for p in (_CD, _PC, _CROTA, _PV, _SIP)),
                           r'C(TYPE|RPIX|RVAL|DELT|UNIT)\d', 'LONPOLE', 'LATPOLE', 'WAT.*']))
#: projections of IRAF: their distortion is in WAT keywords, which are not read
_UNREAD = ('TNX', 'ZPX')


def readings(header):
    """Possible interpretations of the WCS in a header.

    Parameters
    ----------
    header : astropy.io.fits.Header

    Returns
    -------
    headers : list of Header
        One, or two if the WCS is ambiguous: the first follows the standard.
    said : str
        The ambiguity, '' if there is none.

    Raises
    ------
    NotThere
        PC occurs beside CD, a keyword occurs twice with different values, or the projection is not
        supported.
    """
    if _has(header, _CD) and _has(header, _PC):
        raise NotThere('its WCS has PC beside CD, which the FITS standard forbids: which counts is '
                       'not known; solve the image again')
    refuse_twice(header, [key for key in set(header) if WCS.fullmatch(key)])
    code = str(header['CTYPE1'])[5:8].upper()
    if code in _UNREAD:
        raise NotThere(f'its WCS has the projection {code}, whose distortion is not read')
    # TAN has no PV of the second axis: SCAMP wrote TPV under this name before it had its own
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
    """Refuse a keyword that occurs several times with different values.

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
