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

"""Seconds that every orbit counts in, TAI, from the time scales of files and from UTC.

All are seconds since 1970-01-01 with days of 86 400 s, in two parts where a file has a fraction:
whole seconds are exact, and one float of a Julian date is not (40 us, 0.0007" of a low satellite).
"""

import numpy as np

from ..earth import DAY, MJD_1970, check_time
from ..iers_tables import learn_leap_seconds, tai_utc

#: TAI less the scale, s; of UTC there is a table
_BEHIND = {'TAI': 0.0, 'GPS': 19.0, 'GAL': 19.0, 'QZS': 19.0, 'IRN': 19.0, 'BDT': 33.0,
           'TT': -32.184}
#: GLO is UTC
SCALES = ('UTC', 'GLO', *_BEHIND)


def calendar_seconds(dates):
    """Whole seconds since 1970 of calendar dates, and the rest; no scale is meant.

    Parameters
    ----------
    dates : ndarray, shape (n, 6)
        Year, month, day, hour, minute, second.

    Returns
    -------
    whole, rest : ndarray, shape (n,)
        NaN where there is no such date.
    """
    year, month, day, hour, minute, second = np.asarray(dates, float).T
    good = (np.isin(month, np.arange(1, 13)) & (day >= 1) & (day <= 31) & (hour >= 0)
            & (hour <= 24) & (minute >= 0) & (minute < 60) & (second >= 0.0) & (second < 61.0)
            & (year >= 1900) & (year < 2100))
    year, month = np.where(good, year, 1970.0), np.where(good, month, 1.0)
    first = (year.astype(int) - 1970).astype('datetime64[Y]').astype('datetime64[M]') \
        + (month.astype(int) - 1)
    days = first.astype('datetime64[D]').astype(int) + day - 1.0
    whole = np.floor(second)
    return np.where(good, days * DAY + 3600.0 * hour + 60.0 * minute + whole, np.nan), \
        second - whole


def leap_seconds(time):
    """TAI - UTC (s) at UTC seconds since 1970-01-01, of the shape of `time`."""
    time = np.asarray(time, float)
    check_time(time)
    learn_leap_seconds()
    if time.ndim == 0:
        return float(tai_utc(np.floor(time / DAY) + MJD_1970, 0.0))
    days, which = np.unique(np.floor(time / DAY), return_inverse=True)
    return np.asarray(tai_utc(days + MJD_1970, 0.0))[which.reshape(time.shape)]


def tai_of(time, scale):
    """TAI of seconds in a scale.

    Parameters
    ----------
    time : float or ndarray
    scale : str
        Of `SCALES`.

    Raises
    ------
    ValueError
        The scale is not known.
    """
    if scale not in SCALES:
        raise ValueError(f'time scale {scale} is not known; known are {", ".join(SCALES)}')
    return time + (_BEHIND[scale] if scale in _BEHIND else leap_seconds(time))


def utc_of(tai):
    """UTC of TAI seconds: the inverse of `tai_of`."""
    return tai - leap_seconds(tai - leap_seconds(tai))


def utc_text(tai):
    """TAI seconds as a date of UTC for people, to the second."""
    stamp = np.datetime64(int(round(float(utc_of(np.asarray(tai, float))))), 's')
    return str(stamp).replace('T', ' ')
