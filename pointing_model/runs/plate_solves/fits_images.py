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

"""Data from the header of one image: the keywords of its mount, and its solution (WCS)."""

import re
import warnings
from typing import NamedTuple

import numpy as np

from ..columns.cell_values import YEAR_1900, YEAR_2100, TextRows, sexagesimal
from .frames import Frame, parse_frame
from .mapping import WCS, NotThere, readings, refuse_twice, without

_SEXAGESIMAL = re.compile(r'([+-]?)(\d+)[: ](\d+)[: ](\d+(?:\.\d*)?)')
_DAY = 86400.0
_MJD_1970, _JD_1970 = 40587.0, 2440587.5
_SAME_PIXEL = 0.1  # pixels: largest difference of two descriptions in one header
_TEXT = ('star', 'telescope', 'pier_side', 'block', 'run')


class PlateSolution(NamedTuple):
    """Plate solution of one image.

    Attributes
    ----------
    ra_deg, dec_deg : float
        Of the boresight, degrees, in `frame`.
    scale_arcsec_px : float
        Square root of the area of a pixel.
    parity : int
        Sign of the determinant of the matrix from pixels to sky: -1 direct image, 1 mirrored.
    frame : Frame or None
        None: not given in the header.
    """

    ra_deg: float
    dec_deg: float
    scale_arcsec_px: float
    parity: int
    frame: Frame | None


def astropy_fits():
    """The modules ``astropy.io.fits`` and ``astropy.wcs``.

    Raises
    ------
    ValueError
        astropy is not installed.
    """
    try:
        from astropy import wcs
        from astropy.io import fits
    except ImportError:
        raise ValueError('FITS images need the package astropy, which is not installed: '
                         './install.sh ros,images, or pip install astropy') from None
    return fits, wcs


def read_header(path):
    """Header of the image in a FITS file, with the keywords of its primary header.

    Parameters
    ----------
    path : Path

    Returns
    -------
    astropy.io.fits.Header

    Raises
    ------
    NotThere
        Not a FITS file.
    ValueError
        astropy is not installed.
    """
    fits, _ = astropy_fits()
    try:
        with warnings.catch_warnings(), fits.open(path, memmap=False, lazy_load_hdus=True) as hdus:
            warnings.simplefilter('ignore')
            first = hdus[0].header.copy()
            if first.get('NAXIS', 0) >= 2 or 'CTYPE1' in first:
                return first
            for hdu in hdus:
                if hdu.header.get('NAXIS', 0) >= 2 or 'CTYPE1' in hdu.header:
                    header = hdu.header.copy()
                    # keep one solution, do not mix two
                    header.extend(without(first, WCS) if 'CTYPE1' in header else first,
                                  unique=True, strip=True)
                    return header
            return first
    except (OSError, TypeError, ValueError, IndexError) as error:
        raise NotThere(f'not a FITS image ({" ".join(str(error).split())[:60]})') from None


def solution_of(header, boresight=None):
    """Place of the boresight of an image, from the WCS in its header.

    Parameters
    ----------
    header : astropy.io.fits.Header
    boresight : tuple of float, optional
        Pixel, counted from 1; by default the middle of the image.

    Returns
    -------
    PlateSolution

    Raises
    ------
    NotThere
        There is no WCS, it cannot be read, contradicts itself or is not in right ascension and
        declination, or the equinox is invalid.
    """
    kinds = [str(header.get(f'CTYPE{i}', '')).upper() for i in (1, 2)]
    if not all(kinds):
        raise NotThere('no WCS: it is not solved')
    if {kind[:4].rstrip('-') for kind in kinds} != {'RA', 'DEC'}:
        raise NotThere(f'its WCS is {kinds[0][:8]}, {kinds[1][:8]}, not of right ascension and '
                       'declination')
    width, height = (header.get(f'NAXIS{i}', header.get(f'IMAGE{c}'))
                     for i, c in ((1, 'W'), (2, 'H')))
    if boresight is None and not (width and height):
        raise NotThere('no size of the image')
    pixel = boresight or (0.5 * (width + 1), 0.5 * (height + 1))
    frame = frame_of(header)
    headers, ambiguity = readings(header)
    place, matrix = _solved(headers[0], pixel)
    area = np.linalg.det(matrix) if np.isfinite(matrix).all() else 0.0
    if not np.isfinite(place).all() or area == 0.0:
        raise NotThere('its WCS gives no place')
    for other in headers[1:]:
        away = _solved(other, pixel)[0] - place
        away[0] = (away[0] + 180.0) % 360.0 - 180.0
        away[0] *= np.cos(np.radians(place[1]))
        if not np.hypot(*away) <= _SAME_PIXEL * np.sqrt(abs(area)):
            raise NotThere(f'its WCS has {ambiguity}: which counts is not known')
    return PlateSolution(float(place[0]) % 360.0, float(place[1]),
                         3600.0 * float(np.sqrt(abs(area))),
                    int(np.sign(area)), frame)


def _solved(header, pixel):
    """Right ascension and declination of a pixel, degrees, and the matrix from pixels to sky."""
    _, wcs = astropy_fits()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            found = wcs.WCS(header, naxis=2)
            axes = [found.wcs.lng, found.wcs.lat]
            place = found.all_pix2world([pixel], 1)[0][axes]
            matrix = np.asarray(found.pixel_scale_matrix, float)[axes]
    except Exception as error:  # wcslib raises exceptions of its own classes
        raise NotThere(f'its WCS cannot be read ({" ".join(str(error).split())[:60]})') from None
    return place, matrix


def frame_of(header):
    """Frame of a WCS from RADESYS and EQUINOX (FITS standard 4.0, section 8.3); None: not given.

    Raises
    ------
    NotThere
        The frame is unknown.
    """
    system = str(header.get('RADESYS', header.get('RADECSYS', ''))).strip().upper()
    equinox = header.get('EQUINOX', header.get('EPOCH'))
    try:
        if equinox is not None and not isinstance(equinox, str):
            equinox = f'{float(equinox):.10g}'
        if system == 'GAPPT':
            return parse_frame('of date')
        if not system:
            return None if equinox is None else parse_frame(
                f'FK4 {equinox}' if _is_old(equinox) else equinox)
        if system in ('FK5', 'FK4') and equinox is not None:
            return parse_frame(f'{system} {str(equinox).strip()}')
        return parse_frame(system)
    except ValueError as error:
        raise NotThere(f'{error} (RADESYS {system or "not there"}, EQUINOX {equinox})') from None


def _is_old(equinox):
    try:
        return float(equinox) < 1984.0
    except ValueError:
        return False


def row_of(header, mapping):
    """Columns of the run from the keywords of an image.

    Parameters
    ----------
    header : astropy.io.fits.Header
    mapping : Mapping

    Returns
    -------
    row : dict of str to float or str
        The time is that of the encoder reading, seconds since 1970, UTC. Columns with missing
        keywords are left out.
    missing : list of str
        Keywords that the image lacks.

    Raises
    ------
    NotThere
        A value is not a number or time, or the time is not UTC.
    """
    row, missing = _values(header, mapping.columns)
    if mapping.shift and 'time' in row and 'exposure_s' in row:
        row['time'] += mapping.shift * row['exposure_s']
    return row, missing


def site_of(header, mapping):
    """Site of an image, with the names of `mapping.SITE`, degrees and metres.

    Raises
    ------
    NotThere
        A keyword is missing or not a number.
    """
    site, missing = _values(header, mapping.site)
    if missing:
        raise NotThere(f'no keyword {", ".join(missing)} for the site')
    return site


def _values(header, keywords):
    """Values of columns by their keywords, and the keywords that are not there."""
    row, missing = {}, []
    for name, keyword in keywords.items():
        lacking = [k for k in keyword.names if header.get(k) is None or header[k] == '']
        missing += lacking
        if not lacking:
            refuse_twice(header, keyword.names)
            row[name] = _value(header, name, keyword)
    return row, missing


def _value(header, name, keyword):
    if keyword.constant is not None:
        return keyword.constant
    values = [header[k] for k in keyword.names]
    if name == 'time':
        return _time(header, keyword.names, values)
    value = values[0]
    if name in _TEXT and isinstance(value, str):
        return value.strip()
    return keyword.scale * _number(keyword.names[0], value) + keyword.offset


def _number(name, value):
    if isinstance(value, bool):
        raise NotThere(f'{name} is {value}, not a number')
    try:
        return float(value)
    except (TypeError, ValueError):
        pass
    found = _SEXAGESIMAL.fullmatch(str(value).strip())
    if not found:
        raise NotThere(f'{name} is {str(value)[:30]!r}, not a number')
    return sexagesimal([found[1] + found[2], found[3], found[4]])


def _time(header, names, values):
    system = str(header.get('TIMESYS', 'UTC')).strip().upper()
    if system not in ('', 'UTC', 'UT'):
        raise NotThere(f'TIMESYS is {system[:20]}, not UTC')
    if isinstance(values[0], int | float) and not isinstance(values[0], bool):
        value = float(values[0])
        if names[0].startswith('MJD'):
            value = (value - _MJD_1970) * _DAY
        elif names[0].startswith('JD'):
            value = (value - _JD_1970) * _DAY
        if not YEAR_1900 <= value <= YEAR_2100:
            raise NotThere(f'{names[0]} {values[0]:g} is no time from 1900 to 2100')
        return value
    text = 'T'.join(str(value).strip() for value in values)
    try:
        return float(TextRows('', [0]).iso_times('', [text])[0])
    except ValueError:
        raise NotThere(f'{" ".join(names)} {text[:40]!r} is no time in ISO 8601') from None
