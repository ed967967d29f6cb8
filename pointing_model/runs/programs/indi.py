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

"""INDI's alignment database, to which its SPK plug-in fits its model (indilib libs/alignment).

INDI reads no coefficients. It keeps synchronisation points in
``~/.indi/DEVICE_alignment_database.xml``, each a Julian date, apparent right ascension (h) and
declination (deg) and the direction of the mount as a vector. It fits IA IE AN AW CA TF to them, to
first order at the mount's angles (`Pmfit`; fewer terms to fewer than six points), and applies these
as the rotations of SPK. A model is written as points from which this fit returns its coefficients,
and read by repeating INDI's fit.

For an equatorial mount the terms are IH ID ME MA CH TF, and the vector is the direction of the
mount's right ascension and declination. It has no pier side. ID, CH and NP of a German mount change
sign with it, so a database is for one side.
"""

import re
from dataclasses import replace
from xml.etree import ElementTree

import erfa
import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import ALTAZ, ON_SKY, sides

from ..columns.cell_values import sexagesimal
from ..model_files.program import ModelFile, Program, for_celestial, spread
from ..model_files.term_columns import TERM_KEYS, on_sky
from . import spk

#: Pmfit's terms in its order -> its coefficient for a unit of ours
_TERMS = {'IA': 1, 'IE': -1, 'AN': 1, 'AW': 1, 'CA': 1, 'TF': 1}
_OWN = {TERM_KEYS[name]: [(name, float(sign))] for name, sign in _TERMS.items()}
#: the same for an equatorial mount
_EQUATORIAL = {'IH': -1, 'ID': -1, 'ME': -1, 'MA': -1, 'CH': -1, 'TF': 1}
_HOUR = 15.0 * DEG
#: Julian date of all points written; only the sidereal time depends on it
_DATE = 2461041.5
_SPREAD = 30, 20.0 * DEG, 70.0 * DEG  # points, and their lowest and highest elevation
_STEPS = 20
_FAR = 1.0 * DEG
_FIELDS = ('ObservationJulianDate', 'RightAscension', 'Declination', 'TelescopeDirectionVectorX',
           'TelescopeDirectionVectorY', 'TelescopeDirectionVectorZ')


def _sidereal(date, longitude):
    """Apparent sidereal time as in libnova (IAU 1982 and 1980, UT1 = UTC), radians."""
    return erfa.gst94(2400000.5, np.asarray(date) - 2400000.5) + longitude


def _write(sheet):
    latitude, longitude = _site(sheet)
    az, el = spread(*_SPREAD)
    wanted = {TERM_KEYS[name]: sign * sheet.terms.get(name, 0.0) for name, sign in _TERMS.items()}
    a, e = _made(wanted, az, el, spk.PROGRAM.encoder)
    ha, dec = erfa.ae2hd(az, el, latitude)
    ra = np.mod(_sidereal(_DATE, longitude) - ha, 2.0 * np.pi)
    return _file(sheet, ra, dec, [np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)])


def _site(sheet):
    if sheet.site is None:
        raise ValueError('INDI keeps its points in right ascension: give the site (--latitude, '
                         '--longitude)')
    return sheet.site


def _made(wanted, first, second, encoder, mount=ALTAZ):
    """Readings to which Pmfit fits the wanted values."""
    made = dict(wanted)
    for _ in range(_STEPS):
        a, e = encoder(made, first, second)
        fitted = _fitted(list(wanted), first, second, a, e, mount)[0]
        # a first-order fit to rotations has second-order errors: adjust the points
        made = {key: made[key] + wanted[key] - fitted[key] for key in wanted}
    return a, e


def _file(sheet, ra, dec, vectors):
    latitude, longitude = sheet.site
    rows = ['<INDIAlignmentDatabase>',
            f'   <!-- {re.sub("-+", "-", sheet.caption)} -->',
            f"   <DatabaseReferenceLocation latitude='{latitude / DEG:.9f}' "
            f"longitude='{longitude / DEG:.9f}'/>", '   <DatabaseEntries>']
    for point in zip(np.full(len(ra), _DATE), ra / _HOUR, dec / DEG, *vectors):
        rows += ['      <DatabaseEntry>', *(f'         <{name}>{value:.14f}</{name}>'
                                            for name, value in zip(_FIELDS, point)),
                 '      </DatabaseEntry>']
    return '\n'.join([*rows, '   </DatabaseEntries>', '</INDIAlignmentDatabase>']) + '\n'


def _degrees(text):
    """A decimal number, or degrees (hours), minutes and seconds, as read by f_scansexa."""
    parts = re.findall(r'\d+\.?\d*(?:[eE][-+]?\d+)?', text)
    if not 1 <= len(parts) <= 3:
        return np.nan
    return sexagesimal(parts) * (-1.0 if text.strip().startswith('-') else 1.0)


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
    count = _count(len(rows))
    keys = {TERM_KEYS[name]: (name, sign) for name, sign in list(_TERMS.items())[:count]}
    return _file_of(path, keys, *_fitted(list(keys), az, el, a, e), len(rows),
                    'an alt-azimuth mount; is it of an equatorial one?')


def _count(points):
    """Number of terms that INDI fits to this number of points."""
    return 2 if points < 3 else 4 if points < 5 else 5 if points < 6 else 6


def _file_of(path, keys, values, left, points, kind):
    """The `ModelFile` from a fit to the points of a database."""
    if not left < _FAR:
        raise ValueError(f'{path}: its points are {left / DEG:.3g} degrees off any model of {kind}')
    count = len(keys)
    found = ModelFile({name: float(sign * values[key]) for key, (name, sign) in keys.items()})
    if count < 6:
        found.notes.append(f'of {points} points INDI fits {count} terms')
    if left > ARCSEC:
        found.notes.append(f'the {points} points are {left / ARCSEC:.1f} arcsec RMS from the '
                           'model that INDI fits')
    return found


def _fitted(keys, az, el, a, e, mount=ALTAZ):
    """INDI's Pmfit: values by column, and RMS of the residuals, radians."""
    values = dict.fromkeys(keys, 0.0)
    there = [on_sky(key, a, e, mount) for key in keys]
    here = np.stack([np.ravel(on_sky(key, az, el, mount)) for key in keys], axis=1)
    last = np.inf
    for _ in range(_STEPS):
        lon, lat = a, e
        for value, (x, y) in zip(values.values(), there):  # one after the other, as in Pmfit
            lon, lat = lon - value * x / np.cos(lat), lat - value * y
        left = np.concatenate([wrap(lon - az) * np.cos(el), lat - el])
        step = np.linalg.lstsq(here, left, rcond=1e-12)[0]
        values = {key: value + d for (key, value), d in zip(values.items(), step)}
        if step @ step >= last:
            break
        last = step @ step
    return values, float(np.sqrt(np.sum(left**2) / len(az)))


def _for_mount(mount):
    """INDI for an equatorial mount: its terms act on the sky, the same on both pier sides."""
    plain = spk.PROGRAM.for_mount(mount).encoder

    def encoder(values, first, second):
        here = sides(first, second)
        a, e = plain(values, *here[:2])
        return first + wrap(a - here[0]), second + here[2] * wrap(e - here[1])

    def write(sheet):
        latitude, longitude = _site(sheet)
        ha, dec = erfa.ae2hd(*spread(2 * _SPREAD[0], *_SPREAD[1:]), latitude)
        if sheet.beyond is not None:  # with the counterweight down
            ha, dec = (v[(ha < 0.0) == sheet.beyond] for v in (ha, dec))
        wanted = {(name, ()): sign * sheet.terms.get(name, 0.0)
                  for name, sign in _EQUATORIAL.items()}
        a, e = _made(wanted, ha, dec, encoder, mount)
        now = _sidereal(_DATE, longitude)
        return _file(sheet, np.mod(now - ha, 2.0 * np.pi), dec, [
            np.cos(e) * np.cos(now - a), np.cos(e) * np.sin(now - a), np.sin(e)])

    def read(path, text):
        (_, longitude), rows = _points(path, text)
        date, ra, dec, x, y, z = rows.T
        now, dec = _sidereal(date, longitude), dec * DEG
        ha = wrap(now - ra * _HOUR)
        a, e = ha + wrap(now - np.arctan2(y, x) - ha), np.arctan2(z, np.hypot(x, y))
        keys = {(name, ()): (name, sign)
                for name, sign in list(_EQUATORIAL.items())[:_count(len(rows))]}
        return _file_of(path, keys, *_fitted(list(keys), ha, dec, a, e, mount), len(rows),
                        'an equatorial mount; is it of an alt-azimuth one?')
    made = for_celestial(PROGRAM, mount, {name: (name, sign) for name, sign in _EQUATORIAL.items()},
                         encoder=encoder, write=write, read=read, one_sided=mount.two_sided)
    return replace(made, mount=mount.with_errors(ON_SKY)) if mount.two_sided else made


_looks_like = re.compile('<INDIAlignmentDatabase').search
PROGRAM = Program(
    'indi', 'INDI (SPK plug-in)', _OWN.get,
    lambda name: [(TERM_KEYS[name], float(_TERMS[name]))], tuple(_OWN),
    spk.PROGRAM.encoder, _write, _read, _looks_like, None, for_mount=_for_mount)
