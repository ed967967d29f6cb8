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

"""Guesses for error messages: what the columns of a refused table may be."""

import difflib
import re

import numpy as np

from .cell_values import TextRows, is_number

_AXES = {'az': ('az', 'azimuth', 'azi', 'azm'),
         'el': ('el', 'elev', 'elevation', 'alt', 'altitude'),
         'ha': ('ha', 'hour', 'hourangle'), 'dec': ('dec', 'declination', 'de'),
         'ra': ('ra', 'rightascension')}
_READ = ('enc', 'encoder', 'mount', 'mnt', 'tel', 'telescope', 'raw', 'reading', 'axis')
_OFF = ('offset', 'off', 'delta', 'd', 'error', 'err', 'diff', 'difference', 'daz', 'del', 'dalt',
        'dha', 'ddec', 'residual', 'xel', 'xoff', 'yoff')
_FEW = 50  # rows that are read
_SMALL = 15.0  # deg: largest difference of reading and place, apart from the zeros of the axes
_EPOCH = 1e8  # s: larger numbers are times


def meant(name):
    """Axis and role of a column, from its name.

    Parameters
    ----------
    name : str
        In a file.

    Returns
    -------
    axis : {'az', 'el', 'ha', 'dec', 'ra', ''}
    role : {'place', 'reading', 'offset'}
    """
    words = [w.lower() for w in re.findall(r'[A-Z]+(?![a-z])|[A-Z]?[a-z]+', name)]
    axis = next((axis for axis, known in _AXES.items()
                 for word in words if word in known or word == f'd{axis}'), '')
    role = ('offset' if set(words) & set(_OFF) else 'reading' if set(words) & set(_READ)
            else 'place')
    return axis, role


def closest(wanted, header):
    """The column of a header that is most similar to a wanted one, or None."""
    axis, role = meant(wanted)
    alike = [name for name in header if axis and meant(name) == (axis, role)]
    near = difflib.get_close_matches(wanted, alike or header, 1, 0.0 if alike else 0.6)
    return near[0] if near else None


def offsets(header):
    """How to rename columns that look like offsets of both axes; '' if there are none."""
    found = {axis: name for name in header for axis, role in [meant(name)]
             if role == 'offset' and axis in ('az', 'el', 'ha', 'dec')}
    for first, second in (('az', 'el'), ('ha', 'dec')):
        if {first, second} <= set(found):
            cos = {'az': 'cos elevation', 'ha': 'cos declination'}[first]
            return (f'; if {found[first][:40]} and {found[second][:40]} are offsets, call them '
                    f'x_arcsec and y_arcsec: encoder - catalogue on the sky, in arcsec (x times '
                    f'{cos})')
    return ''


def without_header(path, body, delimiter):
    """Error message for a table of numbers without a header: the line to put at its top.

    Parameters
    ----------
    path : Path
    body : list of (int, str)
        Line number and text of each row.
    delimiter : str or None
        Separator of the cells; None: blanks.

    Returns
    -------
    str
    """
    rows = [[cell.strip() for cell in line.split(delimiter)] for _, line in body[:_FEW]]
    rows = [row for row in rows if len(row) == len(rows[0])]
    names, assumed, mount = _guess(list(zip(*rows)))
    before = ''.join(f'"{line}", ' for line in mount)
    between = delimiter if delimiter and delimiter.isprintable() else ' '
    return (f'{path} is not a pointing run: it has no header row; write above the numbers '
            f'{before}"{between.join(names)}"'
            + (f' ({assumed})' if assumed else ''))


def _guess(columns):
    """Column names guessed from the values, the assumption, and lines that declare a mount."""
    names, at = [], 0
    for name, holds in (('star', _is_name), ('time', _is_time)):
        if at < len(columns) and holds(columns[at]):
            names, at = [*names, name], at + 1
    numeric = [np.array(c, float) if all(map(is_number, c)) else None for c in columns[at:at + 4]]
    pair, readings, text, mount = ('az', 'el'), None, '', []
    if len(numeric) == 4 and not any(c is None for c in numeric):
        first, second, third, fourth = numeric
        text = 'assumed from their ranges: places, then what the encoders read, in degrees'
        with np.errstate(invalid='ignore'):
            away = np.abs(np.remainder(third - first + 180.0, 360.0) - 180.0)
            near = [np.nanmedian(np.abs(fourth - second)) < _SMALL,
                    np.nanmedian(np.abs(180.0 - fourth - second)) < _SMALL]
            if np.nanmin(first) < -5.0 and np.nanmax(first) <= 180.0 or np.nanmin(second) < -5.0:
                pair = ('ha', 'dec')
                mount = ['# mount: german', '# latitude_deg: ...']
            if not any(near) and max(np.nanmax(np.abs(third)), np.nanmax(np.abs(fourth))) < max(
                    np.nanmax(np.abs(first)), 1.0) * 60.0 and np.nanmedian(away) > _SMALL:
                text = ('assumed from their ranges: places in degrees, then offsets in arcsec')
                readings = ['x_arcsec', 'y_arcsec']
    names += [f'{axis}_deg' for axis in pair]
    names += readings or [f'{axis}_enc_deg' for axis in pair]
    for i, column in enumerate(columns[len(names):], len(names)):
        side = {cell.lower().removeprefix('pier') for cell in column} <= {'east', 'west', 'e', 'w'}
        names.append('pier_side' if side else f'column_{i + 1}')
    return names, text, mount


def _is_name(column):
    return not any(map(is_number, column)) and not _is_time(column)


def _is_time(column):
    if all(map(is_number, column)):
        return all(float(cell) > _EPOCH for cell in column)
    try:
        TextRows('', range(len(column)), strict=True).iso_times('', list(column))
    except ValueError:
        return False
    return True
