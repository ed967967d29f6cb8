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

"""Earth orientation: UT1-UTC and polar motion for any date, each with its uncertainty.

From 1962 on the IERS tables in the package astropy-iers-data are used: the C04 series, then
Bulletin A with its predictions. UT1-TAI is interpolated, since it has no leap seconds. Beyond the
tables the values are extrapolated, with the uncertainty that this implies:

* UT1-UTC after the table: the rate of the table's last year, plus the seasonal variation UT2-UT1.
  The formula of Bulletin A, 0.00025 s (days)^0.75, is meant for a few weeks: on the C04 series
  1972-2026 such an extrapolation is wrong by 0.09 s (rms) after 1 year, 0.9 s after 5 and 2.3 s
  after 10, which `RATE_WALK` reproduces. Future leap seconds keep UTC within 0.9 s of UT1, at
  least until 2035, so the extrapolation is averaged with 0 +- 0.52 s.
* The pole after or before the table: the IERS secular pole, around which the true one moves by
  0.12" (rms) in each coordinate.
* UT1-UTC before 1962: time signals followed the Earth's rotation. Taken as 0 +- 0.1 s from 1960
  on; before 1960 there was no UTC, and the time is taken as universal time, 0 +- 0.5 s.
"""

from dataclasses import dataclass

import erfa
import numpy as np

from msg_tools.units import ARCSEC

from .iers_tables import C04_FIRST, extent, learn_leap_seconds, rows_of, tai_utc

MJD_1970 = 40587.0
DAY = 86400.0
EARTH_RADIUS = 6378137.0  # m, equatorial (WGS84)
TURN_RATE = 2.0 * np.pi * 1.00273781191135448 / DAY  # Earth rotation, rad per second of UT1

RATE_WALK = 0.085  # s, growing with years^1.45: measured on C04, see above
LEAP_SECONDS = 0.52  # s, standard deviation of a uniform value within +-0.9 s
LEAP_SECONDS_END = 64328.0  # MJD of 2035-01-01 (CGPM 2022, resolution 4)
POLAR_MOTION = 0.12 * ARCSEC  # rms about the secular pole, one coordinate
POLAR_MOTION_MEMORY = 60.0  # days, correlation time of the pole after the end of the table
# tides within a day are in neither table (IERS Conventions 2010, ch. 5 and 8)
TIDES_UT1 = 3e-5  # s
TIDES_POLE = 2e-4 * ARCSEC

FIRST, LAST = -2208988800.0, 4133980800.0  # 1900-01-01, 2101-01-01: range of ERFA's Earth model
_MJD_1960 = 36934.0

#: values of `EarthOrientation.source`, from the best to the worst
SOURCES = ('IERS final', 'IERS rapid', 'IERS prediction', 'extrapolated', 'before the IERS table')


@dataclass(frozen=True, eq=False)
class EarthOrientation:
    """Orientation of the Earth at one or several times; every field has the shape of the time.

    Parameters
    ----------
    dut1, sigma_dut1 : float or ndarray
        UT1-UTC and its standard deviation, seconds.
    xp, yp, sigma_pole : float or ndarray
        Coordinates of the pole and the standard deviation of each, radians.
    source : str or ndarray of str
        One of `SOURCES`.
    """

    dut1: float
    xp: float
    yp: float
    sigma_dut1: float
    sigma_pole: float
    source: str

    @property
    def sigma(self):
        """Resulting standard deviation of a direction on the sky (at the equator), rad."""
        return np.hypot(TURN_RATE * np.asarray(self.sigma_dut1), self.sigma_pole)

    def statement(self):
        """One line for people; for several times the most uncertain one."""
        worst = np.argmax(np.atleast_1d(self.sigma))
        pick = lambda v: np.atleast_1d(v)[worst]  # noqa: E731
        return (f'UT1-UTC {pick(self.dut1):+.4f} ± {pick(self.sigma_dut1):.4f} s, '
                f'pole ± {pick(self.sigma_pole) / ARCSEC:.4f}" ({pick(self.source)}): '
                f'directions ± {pick(self.sigma) / ARCSEC:.3f}"')


def check_time(time):
    """Raise ValueError if a time (UTC, seconds since 1970) is outside 1900-2100."""
    fine = (time >= FIRST) & (time <= LAST)  # False for NaN
    if not np.all(fine):
        raise ValueError(f'time {np.asarray(time)[~np.asarray(fine)].flat[0]:.6g} s is outside '
                         '1900 to 2100: give UTC in seconds since 1970-01-01')


def split_utc(time):
    """Split a time into the two-part UTC of ERFA.

    Parameters
    ----------
    time : float or ndarray
        UTC, seconds since 1970-01-01 (POSIX: every day has 86 400 of them, so a leap second
        shares its number with the next second).

    Returns
    -------
    utc1, utc2 : float or ndarray
        Julian date of the day at 0h, and the fraction of that day. On a day with a leap second
        the fraction counts 86 401 seconds, ERFA's convention.

    Raises
    ------
    ValueError
        A time is not finite or outside 1900-2100.
    """
    day, second, _, _, step = _calendar(time)
    return erfa.DJM0 + day, second / (DAY + step)


def terrestrial(time):
    """Two-part Julian date, terrestrial time, of UTC seconds since 1970."""
    utc = split_utc(np.asarray(time, float))
    tai = erfa.ufunc.utctai(*utc)[:2]
    return erfa.ufunc.taitt(*tai)[:2]


def earth_orientation(time):
    """UT1-UTC and polar motion with their uncertainty.

    Parameters
    ----------
    time : float or ndarray
        UTC, seconds since 1970-01-01, from 1900 to 2100.

    Returns
    -------
    EarthOrientation

    Raises
    ------
    ValueError
        A time is not finite or outside 1900-2100, or an IERS table is damaged.

    Notes
    -----
    Four-point Lagrange interpolation of the daily values (IERS Gazette 13). Only the rows
    around `time` are read.
    """
    day, second, dat, drift, _ = _calendar(time)
    dat = dat + drift * second / DAY
    mjd = day + second / DAY
    flat = np.atleast_1d(mjd).ravel()
    flat_dat = np.atleast_1d(dat).ravel()
    out = np.empty((5, flat.size))  # dut1, xp, yp, sigma_dut1, sigma_pole
    source = np.empty(flat.size, int)
    last = extent()[2]

    early = flat < C04_FIRST
    late = flat > last
    known = ~(early | late)
    if np.any(early):
        t = flat[early]
        pole = _secular_pole(t)
        sigma = np.where(t >= _MJD_1960, 0.1, 0.5)
        out[:, early] = 0.0 * t, *pole, sigma, np.full(t.size, POLAR_MOTION)
        source[early] = 4
    if np.any(known):
        t = flat[known]
        rows, kind = rows_of(max(int(t.min()) - 1, int(C04_FIRST)),
                             min(int(t.max()) + 2, int(last)))
        value, kind = _interpolate(t, rows, kind)
        value[0] += flat_dat[known]
        value[3] = np.hypot(value[3], TIDES_UT1)
        value[4] = np.hypot(value[4], TIDES_POLE)
        out[:, known], source[known] = value, kind
    if np.any(late):
        rows, _ = rows_of(int(last) - 365, int(last))
        value = extrapolate(flat[late], rows)
        value[0] += flat_dat[late]
        value[0], value[3] = _with_leap_seconds(flat[late], value[0], value[3])
        out[:, late], source[late] = value, 3
    names = np.array(SOURCES)[source]
    if np.ndim(time) == 0:
        return EarthOrientation(*(float(v) for v in out[:, 0]), str(names[0]))
    return EarthOrientation(*out.reshape(5, *np.shape(time)), names.reshape(np.shape(time)))


def extrapolate(mjd, rows):
    """Continue a table beyond its last row.

    Parameters
    ----------
    mjd : ndarray, shape (n,)
        Modified Julian dates after the last row.
    rows : ndarray, shape (6, 366)
        A year and a day of the table: MJD, UT1-TAI (s), xp, yp (rad), their sigmas (s, rad).

    Returns
    -------
    ndarray, shape (5, n)
        UT1-TAI (s), xp, yp (rad), sigma of UT1-TAI (s), sigma of the pole (rad).
    """
    years = (mjd - rows[0, -1]) / 365.25
    level = rows[1] + _seasonal(rows[0])
    rate = (level[-1] - level[0]) / (rows[0, -1] - rows[0, 0])
    ut1_tai = level[-1] + rate * (mjd - rows[0, -1]) - _seasonal(mjd)
    # the end of the table may be a prediction: include its error and that of its rate
    sigma = rows[4, -1] * (1.0 + 2.0 * years) + RATE_WALK * years**1.45
    memory = np.exp((rows[0, -1] - mjd) / POLAR_MOTION_MEMORY)
    pole = _secular_pole(mjd) + (rows[2:4, -1:] - _secular_pole(rows[0, -1:])) * memory
    sigma_pole = np.sqrt(rows[5, -1] ** 2 + POLAR_MOTION**2 * (1.0 - memory**2))
    return np.stack([ut1_tai, *pole, sigma, sigma_pole])


def _with_leap_seconds(mjd, dut1, sigma):
    """Weighted mean of the extrapolation and of the limit that the definition of UTC sets."""
    after = np.maximum(mjd - LEAP_SECONDS_END, 0.0) / 365.25
    promise = np.hypot(LEAP_SECONDS, RATE_WALK * after**1.45)
    weight = promise**2 / (promise**2 + sigma**2)
    return dut1 * weight, sigma * np.sqrt(weight)


def _interpolate(mjd, rows, kind):
    start = np.clip((mjd - rows[0, 0]).astype(int) - 1, 0, rows.shape[1] - 4)
    weights = np.stack(_lagrange(mjd - rows[0, start]))
    window = start + np.arange(4)[:, None]
    value = np.einsum('kn,jkn->jn', weights, rows[1:4][:, window])
    # sigma and source of the worse neighbour only, not of the whole window
    near = np.minimum((mjd - rows[0, 0]).astype(int) + np.arange(2)[:, None], rows.shape[1] - 1)
    sigma = rows[4:][:, near].max(axis=1)
    return np.concatenate([value, sigma]), kind[near].max(axis=0)


def _lagrange(u):
    """Weights of the rows at 0, 1, 2 and 3."""
    return (-(u - 1) * (u - 2) * (u - 3) / 6, u * (u - 2) * (u - 3) / 2,
            -u * (u - 1) * (u - 3) / 2, u * (u - 1) * (u - 2) / 6)


def _secular_pole(mjd):
    years = (mjd - 51544.5) / 365.25  # IERS Conventions 2010, eq. 21 as updated in 2018
    return np.stack([0.0550 + 0.001677 * years, 0.3205 + 0.003460 * years]) * ARCSEC


def _seasonal(mjd):
    """UT2-UT1, seconds (Bulletin A)."""
    turn = 2.0 * np.pi * (2000.0 + (mjd - 51544.03) / 365.2422)
    return (0.022 * np.sin(turn) - 0.012 * np.cos(turn)
            - 0.006 * np.sin(2.0 * turn) + 0.007 * np.cos(2.0 * turn))


def _calendar(time):
    """MJD at 0h, second of that day, TAI-UTC at 0h, its change over the day, step at its end."""
    time = np.asarray(time, float)
    check_time(time)
    learn_leap_seconds()
    day = np.floor(time / DAY)
    second = time - day * DAY
    day = day + MJD_1970
    today = tai_utc(day, 0.0)
    drift = 2.0 * (tai_utc(day, 0.5) - today)
    return day, second, today, drift, tai_utc(day + 1.0, 0.0) - today - drift
