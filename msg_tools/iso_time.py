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

"""Times in ISO 8601, as people and programs write them."""

import re

import numpy as np

_ISO = re.compile(r'(\d{4}-\d\d-\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d)([.,]\d+)?)?'
                  r'(?:Z|([+-])(\d\d):?(\d\d)?)?)?', re.ASCII)
WANTED = '2026-01-15T13:00:00'


def read_iso(texts):
    """Seconds since 1970 of times; UTC if no zone is given.

    Second 60 is the first of the next minute: programs that round up write it so, and a leap
    second has the number of the second after it (POSIX). 24:00:00 is the next day.

    Parameters
    ----------
    texts : sequence of str
        As ``2021-08-21T04:36:01.5Z``, ``2021-08-21 04:36``, ``2021-08-21T06:36:01+02:00``.

    Returns
    -------
    seconds : ndarray of int, shape (n,)
        Whole seconds; 0 if a text is not a time.
    fraction : ndarray, shape (n,)
        Fraction of a second; NaN if a text is not a time.
    """
    matches = [_ISO.fullmatch(text) for text in texts]
    days = [match[1] if match else 'NaT' for match in matches]
    try:
        dates = np.array(days, dtype='datetime64[D]')
    except ValueError:  # one does not exist in the calendar
        dates = np.array([_date(day) for day in days], dtype='datetime64[D]')
    hour, minute, second = (np.array([int(m[i] or 0) if m else 0 for m in matches], dtype=np.int64)
                            for i in (2, 3, 4))
    fraction = np.array([float('0' + m[5].replace(',', '.')) if m and m[5] else 0.0
                         for m in matches])
    zone = np.array([_zone(m) if m else 0 for m in matches], dtype=np.int64)
    good = ~np.isnat(dates) & (minute < 60) & (second <= 60) & (
        (hour < 24) | ((hour == 24) & (minute + second + fraction == 0.0)))
    whole = np.where(np.isnat(dates), 0, dates.astype(np.int64)) * 86400 \
        + 3600 * hour + 60 * minute + second - zone
    return np.where(good, whole, 0), np.where(good, fraction, np.nan)


def iso_ns(text):
    """Nanoseconds since 1970 of one time, an int; see `read_iso`.

    Raises
    ------
    ValueError
        Not a time.
    """
    seconds, fraction = _one(text)
    return seconds * 1_000_000_000 + round(fraction * 1e9)


def iso_seconds(text):
    """Seconds since 1970 of one time; see `read_iso`.

    Raises
    ------
    ValueError
        Not a time.
    """
    return float(sum(_one(text)))


def _one(text):
    (seconds,), (fraction,) = read_iso([text.strip()])
    if np.isnan(fraction):
        raise ValueError(f'{text!r} is no date; write {WANTED}')
    return int(seconds), float(fraction)


def _date(text):
    try:
        return np.datetime64(text, 'D')
    except ValueError:
        return np.datetime64('NaT')


def _zone(match):
    sign, hours, minutes = match[6], match[7], match[8]
    return int(sign + '1') * (int(hours) * 3600 + int(minutes or 0) * 60) if sign else 0
