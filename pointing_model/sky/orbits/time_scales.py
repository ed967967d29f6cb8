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

"""TAI seconds, used by all orbits, from the time scales of files and from UTC.

All times are seconds since 1970-01-01 with days of 86 400 s, with a separate fraction if a file has
one: whole seconds are exact, which a float Julian date is not (40 us, 0.0007" for a low satellite).
"""

import numpy as np

from ..earth import DAY, MJD_1970, check_time
from ..iers_tables import learn_leap_seconds, tai_utc

#: TAI - scale, s; for UTC there is a table
_BEHIND = {'TAI': 0.0, 'GPS': 19.0, 'GAL': 19.0, 'QZS': 19.0, 'IRN': 19.0, 'BDT': 33.0,
           'TT': -32.184}
#: GLO is UTC
SCALES = ('UTC', 'GLO', *_BEHIND)


def calendar_seconds(dates):
    """Whole seconds since 1970 of calendar dates, and the fraction, in any time scale.

    Parameters
    ----------
    dates : ndarray, shape (n, 6)
        Year, month, day, hour, minute, second.

    Returns
    -------
    whole, rest : ndarray, shape (n,)
        NaN for invalid dates.
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
    """TAI - UTC (s) at UTC seconds since 1970-01-01, with the shape of `time`."""
    time = np.asarray(time, float)
    check_time(time)
    learn_leap_seconds()
    if time.ndim == 0:
        return float(tai_utc(np.floor(time / DAY) + MJD_1970, 0.0))
    days, which = np.unique(np.floor(time / DAY), return_inverse=True)
    return np.asarray(tai_utc(days + MJD_1970, 0.0))[which.reshape(time.shape)]


def tai_of(time, scale):
    """TAI from seconds in another scale.

    Parameters
    ----------
    time : float or ndarray
    scale : str
        One of `SCALES`.

    Raises
    ------
    ValueError
        The scale is unknown.
    """
    if scale not in SCALES:
        raise ValueError(f'time scale {scale} is not known; known are {", ".join(SCALES)}')
    return time + (_BEHIND[scale] if scale in _BEHIND else leap_seconds(time))


def utc_of(tai):
    """UTC from TAI seconds: the inverse of `tai_of`."""
    return tai - leap_seconds(tai - leap_seconds(tai))


def utc_text(tai):
    """TAI seconds as a UTC date for people, to the second."""
    stamp = np.datetime64(int(round(float(utc_of(np.asarray(tai, float))))), 's')
    return str(stamp).replace('T', ' ')
