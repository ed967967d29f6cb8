"""INDI's alignment database, which its SPK plug-in fits its model to (indilib libs/alignment).

INDI reads no coefficients: it keeps synchronisation points in
``~/.indi/DEVICE_alignment_database.xml``, each a Julian date, apparent right ascension (h) and
declination (deg) and the direction of the mount as a vector, and fits IA IE AN AW CA TF to them, to
first order at the mount's angles (`Pmfit`; fewer terms to fewer than six points). Those then act as
the rotations of SPK. A model is written as points to which that fit gives its coefficients, and
read as what INDI would fit.
"""

import re
from xml.etree import ElementTree

import erfa
import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap

from . import spk
from .program import ModelFile, Program
from .term_columns import TERM_KEYS, on_sky

#: Pmfit's terms in its order -> its coefficient for a unit of ours
_TERMS = {'IA': 1, 'IE': -1, 'AN': 1, 'AW': 1, 'CA': 1, 'TF': 1}
_OWN = {TERM_KEYS[name]: [(name, float(sign))] for name, sign in _TERMS.items()}
_HOUR = 15.0 * DEG
#: of all points that are written: only the sidereal time follows from it
_DATE = 2461041.5
_POINTS, _LOW, _HIGH = 30, 20.0 * DEG, 70.0 * DEG
_STEPS = 20
_FAR = 1.0 * DEG
_FIELDS = ('ObservationJulianDate', 'RightAscension', 'Declination', 'TelescopeDirectionVectorX',
           'TelescopeDirectionVectorY', 'TelescopeDirectionVectorZ')


def _sidereal(date, longitude):
    """Apparent sidereal time as libnova has it (IAU 1982 and 1980, UT1 = UTC), radians."""
    return erfa.gst94(2400000.5, np.asarray(date) - 2400000.5) + longitude


def _write(sheet):
    if sheet.site is None:
        raise ValueError('INDI keeps its points in right ascension: give the site (--latitude, '
                         '--longitude)')
    latitude, longitude = sheet.site
    i = np.arange(_POINTS)
    height = np.sin(_LOW) + (np.sin(_HIGH) - np.sin(_LOW)) * (i + 0.5) / _POINTS
    az, el = np.mod(i * np.pi * (3.0 - np.sqrt(5.0)), 2.0 * np.pi), np.arcsin(height)
    wanted = {TERM_KEYS[name]: sign * sheet.terms.get(name, 0.0) for name, sign in _TERMS.items()}
    made = dict(wanted)
    for _ in range(_STEPS):
        a, e = spk.PROGRAM.encoder(made, az, el)
        fitted = _fitted(list(wanted), az, el, a, e)[0]
        # a first-order fit to rotations is off by the second order: the points make up for it
        made = {key: made[key] + wanted[key] - fitted[key] for key in wanted}
    ha, dec = erfa.ae2hd(az, el, latitude)
    ra = np.mod(_sidereal(_DATE, longitude) - ha, 2.0 * np.pi)
    vectors = np.stack([np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    rows = ['<INDIAlignmentDatabase>',
            f'   <!-- {re.sub("-+", "-", sheet.caption)} -->',
            f"   <DatabaseReferenceLocation latitude='{latitude / DEG:.9f}' "
            f"longitude='{longitude / DEG:.9f}'/>", '   <DatabaseEntries>']
    for point in zip(np.full(_POINTS, _DATE), ra / _HOUR, dec / DEG, *vectors.T):
        rows += ['      <DatabaseEntry>', *(f'         <{name}>{value:.14f}</{name}>'
                                            for name, value in zip(_FIELDS, point)),
                 '      </DatabaseEntry>']
    return '\n'.join([*rows, '   </DatabaseEntries>', '</INDIAlignmentDatabase>']) + '\n'


def _degrees(text):
    """Decimal, or degrees (hours), minutes and seconds, as f_scansexa takes them."""
    parts = [float(p) for p in re.findall(r'\d+\.?\d*(?:[eE][-+]?\d+)?', text)]
    if not 1 <= len(parts) <= 3:
        return np.nan
    size = sum(p / 60.0**i for i, p in enumerate(parts))
    return -size if text.strip().startswith('-') else size


def _points(path, text):
    """Site and points of a database, shape (n, 6)."""
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f'{path} is no XML: {error}') from None
    place = root.find('DatabaseReferenceLocation')
    try:
        site = [float(place.get(name)) * DEG for name in ('latitude', 'longitude')]
    except (AttributeError, TypeError, ValueError):
        raise ValueError(f'{path} has no DatabaseReferenceLocation with latitude and '
                         'longitude') from None
    rows = []
    for number, entry in enumerate(root.iter('DatabaseEntry'), 1):
        row = []
        for name in _FIELDS:
            cell = entry.findtext(name)
            value = np.nan if cell is None else _degrees(cell)
            if not np.isfinite(value):
                raise ValueError(f'{path}, point {number}: {name} is {cell!r}, which is no number')
            row.append(value)
        rows.append(row)
    if not rows:
        raise ValueError(f'{path} holds no synchronisation point')
    return site, np.array(rows)


def _read(path, text):
    (latitude, longitude), rows = _points(path, text)
    date, ra, dec, x, y, z = rows.T
    az, el = erfa.hd2ae(_sidereal(date, longitude) - ra * _HOUR, dec * DEG, latitude)
    a, e = np.arctan2(-y, x), np.arctan2(z, np.hypot(x, y))
    count = 2 if len(rows) < 3 else 4 if len(rows) < 5 else 5 if len(rows) < 6 else 6
    keys = [TERM_KEYS[name] for name in list(_TERMS)[:count]]
    values, left = _fitted(keys, az, el, a, e)
    if not left < _FAR:
        raise ValueError(f'{path}: its points are {left / DEG:.3g} degrees off any model of an '
                         'alt-azimuth mount; is it of an equatorial one?')
    found = ModelFile({name: float(sign * values[TERM_KEYS[name]]) for name, sign in list(
        _TERMS.items())[:count]})
    if count < 6:
        found.notes.append(f'of {len(rows)} points INDI fits {count} terms')
    if left > ARCSEC:
        found.notes.append(f'the {len(rows)} points are {left / ARCSEC:.1f} arcsec RMS from the '
                           'model that INDI fits')
    return found


def _fitted(keys, az, el, a, e):
    """Pmfit: values by column, and the RMS that is left, radians."""
    values = dict.fromkeys(keys, 0.0)
    there = [on_sky(key, a, e) for key in keys]
    here = np.stack([np.ravel(on_sky(key, az, el)) for key in keys], axis=1)
    last = np.inf
    for _ in range(_STEPS):
        x, y = sum(v * c for v, c in zip(values.values(), there))
        left = np.concatenate([wrap(a - x / np.cos(e) - az) * np.cos(el), e - y - el])
        step = np.linalg.lstsq(here, left, rcond=1e-12)[0]
        values = {key: value + d for (key, value), d in zip(values.items(), step)}
        if step @ step >= last:
            break
        last = step @ step
    return values, float(np.sqrt(np.sum(left**2) / len(az)))


def _looks_like(text):
    return '<INDIAlignmentDatabase' in text[:2000]


PROGRAM = Program(
    'indi', 'INDI (SPK plug-in)', 'indilib/indi, libs/alignment/SPKMathPlugin.cpp and spk/pmfit.c',
    '.xml', _OWN.get, lambda name: [(TERM_KEYS[name], float(_TERMS[name]))], tuple(_OWN),
    spk.PROGRAM.encoder, _write, _read, _looks_like, None, '1e-9 degrees')
