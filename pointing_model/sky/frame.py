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

"""ERFA's astrom for a site at any time, interpolated within cells of two hours.

It is computed in full at four times of each cell; a cubic through these is accurate to 0.00002".
The cells do not depend on the process or on earlier calls, so results are reproducible.
"""

from functools import lru_cache

import erfa
import numpy as np

from .earth import FIRST, LAST, check_time, earth_orientation, split_utc

#: length of a cell, s; it divides the day, as UTC and the IERS tables change their rules at 0h
GRID = 7200.0
#: with more cells than this, scattered times are computed one by one
_SCATTERED = 50
_ASTROM = erfa.dt_eraASTROM
_FIELDS = _ASTROM.itemsize // 8
#: index of the Earth rotation angle
_TURN = _ASTROM.fields['eral'][1] // 8
#: times within the cell, from -1 to 1: zeros of a Chebyshev polynomial
_TIMES = np.cos(np.pi * (np.arange(4) + 0.5) / 4.0)
_CUBIC = np.linalg.inv(np.vander(_TIMES))


def frame(time, site):
    """ERFA's astrom, without refraction.

    Parameters
    ----------
    time : ndarray, shape () or (n,)
        UTC, seconds since 1970-01-01.
    site : site.Site

    Returns
    -------
    ndarray of erfa.dt_eraASTROM, shape () or (n,)
        A new array that the caller may change.

    Raises
    ------
    ValueError
        A time is not finite or outside 1900-2100.
    """
    if time.ndim == 0:
        time = float(time)
        if not FIRST <= time <= LAST:
            check_time(time)
        return _in_cell(int(time // GRID), time, site).view(_ASTROM)[0]
    check_time(time)
    moments, inverse = time, None
    if np.any(time[1:] <= time[:-1]):
        moments, inverse = np.unique(time, return_inverse=True)
    out = _frames_by_cell(moments, site)
    return out if inverse is None else out[inverse]


def _frames_by_cell(moments, site):
    cells = np.floor(moments / GRID).astype(int)
    begins = np.flatnonzero(np.diff(cells, prepend=cells[:1] - 1))
    if len(begins) > max(_SCATTERED, 0.6 * len(moments)):
        return full_frame(moments, site)
    out = np.concatenate([
        _in_cell(int(cells[first]), moments[first:last, None], site)
        for first, last in zip(begins, [*begins[1:], len(moments)])] or [np.empty((0, _FIELDS))])
    return out.view(_ASTROM)[:, 0]


def _in_cell(number, time, site):
    """Values of astrom at times of a cell, shape () or (n, 1)."""
    third, second, first, middle = _cell(number, site)
    at = time / (0.5 * GRID) - (2 * number + 1)
    return middle + at * (first + at * (second + at * third))


def full_frame(time, site):
    """The same as `frame`, but computed in full for each time."""
    earth = earth_orientation(time)
    astrom, _, status = erfa.ufunc.apco13(
        *split_utc(time), earth.dut1, site.longitude, site.latitude, site.height, earth.xp,
        earth.yp, 0.0, 0.0, 0.0, 0.5)
    if np.any(status < 0):
        raise ValueError('time is not one that ERFA can convert: give UTC since 1970-01-01')
    return np.array(astrom)


@lru_cache(maxsize=5000)  # one year has 4400
def _cell(number, site):
    """Cubic coefficients in the time from -1 to 1, shape (4, numbers of astrom)."""
    times = (number + 0.5 * (1.0 + _TIMES)) * GRID
    full = full_frame(times, site).view(float).reshape(len(times), _FIELDS)
    full[:, _TURN] = np.unwrap(full[:, _TURN])
    return _CUBIC @ full
