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

"""IERS tables of UT1 and the pole, by day, and TAI-UTC.

The package astropy-iers-data has the tables. Both have one line of constant width per day, so the
line of a day is found by its offset; nothing else is read.
"""

from functools import lru_cache

import astropy_iers_data
import erfa
import numpy as np

from msg_tools.units import ARCSEC

#: MJD of the first day of the C04 series
C04_FIRST = 37665.0
_C04_LINE, _A_LINE, _A_FIRST = 219, 188, 41684
# first and last byte, counted from 1, of MJD, UT1-UTC, xp, yp, their sigmas
_C04_COLUMNS = ((17, 26), (51, 62), (27, 38), (39, 50), (147, 158), (123, 134), (135, 146))
_A_COLUMNS = ((8, 15), (59, 68), (19, 27), (38, 46), (69, 78), (28, 36), (47, 55))


def fixed_width(lines, first, last):
    """Numbers in the bytes `first` to `last`, counted from 1, of each row of `lines`.

    Parameters
    ----------
    lines : ndarray of uint8, shape (n, width)
    first, last : int

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    ValueError
        Bytes that are not a number.
    """
    text = np.ascontiguousarray(lines[:, first - 1 : last])
    return text.view(f'S{text.shape[1]}')[:, 0].astype(float)


def tai_utc(mjd, fraction):
    """TAI-UTC (s) at a fraction of the day (UTC) of an MJD; 0 before 1960."""
    year, month, day, _, _ = erfa.ufunc.jd2cal(erfa.DJM0, mjd)
    return erfa.ufunc.dat(year, month, day, fraction)[0]


@lru_cache(maxsize=1)
def learn_leap_seconds():
    """Give ERFA the leap seconds in the IERS data that it does not know yet."""
    rows = np.loadtxt(astropy_iers_data.IERS_LEAP_SECOND_FILE, comments='#')
    table = erfa.leap_seconds.get()
    new = [(int(r[3]), int(r[2]), r[4]) for r in rows
           if (int(r[3]), int(r[2])) > (int(table['year'][-1]), int(table['month'][-1]))]
    if new:
        erfa.leap_seconds.set(np.append(table, np.array(new, table.dtype)))


@lru_cache(maxsize=1)
def extent():
    """Bytes before the first line of C04; MJD of its last day and of the last prediction."""
    with open(astropy_iers_data.IERS_B_FILE, 'rb') as file:
        header = 0
        for line in file:
            if not line.startswith(b'#'):
                break
            header += len(line)
        lines = (file.seek(0, 2) - header) // _C04_LINE
    with open(astropy_iers_data.IERS_A_FILE, 'rb') as file:
        low, high = 0, file.seek(0, 2) // _A_LINE  # Bulletin A ends with empty lines
        while high - low > 1:
            middle = (low + high) // 2
            file.seek(middle * _A_LINE)
            low, high = (middle, high) if file.read(78)[58:68].strip() else (low, middle)
    return header, int(C04_FIRST) + lines - 1, float(_A_FIRST + low)


@lru_cache(maxsize=8)
def rows_of(first, last):
    """Table values for the days `first` to `last` (MJD), at least four.

    Returns
    -------
    rows : ndarray, shape (6, n)
        MJD, UT1-TAI (s), xp, yp (rad), their sigmas (s, rad).
    kinds : ndarray of int, shape (n,)
        0 final, 1 rapid, 2 predicted.

    Raises
    ------
    ValueError
        A table is damaged.
    """
    header, end, limit = extent()
    last = max(last, first + 3)
    first -= max(last - int(limit), 0)
    last = min(last, int(limit))
    parts = []
    if first <= end:
        lines = _lines(astropy_iers_data.IERS_B_FILE, header, _C04_LINE,
                       first - int(C04_FIRST), min(last, end) - first + 1)
        parts.append((_fields(lines, _C04_COLUMNS), np.zeros(lines.shape[0], int)))
    if last > end:
        begin = max(first, end + 1)
        lines = _lines(astropy_iers_data.IERS_A_FILE, 0, _A_LINE,
                       begin - _A_FIRST, last - begin + 1)
        predicted = (lines[:, 57] == ord('P')) | (lines[:, 16] == ord('P'))
        parts.append((_fields(lines, _A_COLUMNS), 1 + predicted))
    table = np.concatenate([p[0] for p in parts], axis=1)
    mjd, dut1, xp, yp, sigma, sigma_x, sigma_y = table
    if not np.array_equal(mjd, np.arange(first, last + 1)):
        raise ValueError(f'IERS table does not hold MJD {first} to {last} where it should: '
                         'reinstall astropy-iers-data')
    rows = np.stack([mjd, dut1 - tai_utc(mjd, 0.0), xp * ARCSEC, yp * ARCSEC,
                     sigma, np.maximum(sigma_x, sigma_y) * ARCSEC])
    return rows, np.concatenate([p[1] for p in parts])


def _lines(path, header, width, first, count):
    begin = header + first * width
    data = np.memmap(path, np.uint8, 'r')[begin : begin + count * width]
    if data.size != count * width:
        raise ValueError(f'{path} ends too early: reinstall astropy-iers-data')
    return data.reshape(count, width)


def _fields(lines, columns):
    try:
        return np.array([fixed_width(lines, *column) for column in columns])
    except ValueError as error:
        raise ValueError(f'IERS table is damaged ({error}): reinstall astropy-iers-data') from None
