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

"""Earth orientation: the tables, the leap seconds, and what lies beyond."""

import calendar
import warnings
from pathlib import Path

import astropy_iers_data
import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.sky import earth, iers_tables
from pointing_model.sky.earth import DAY, MJD_1970, SOURCES, earth_orientation, split_utc


def _posix(year, month=1, day=1, hour=0, minute=0, second=0.0):
    return calendar.timegm((year, month, day, hour, minute, 0)) + second


def _mjd(mjd):
    return (mjd - MJD_1970) * DAY


def _bulletin_a():
    """Lines of Bulletin A that hold UT1, cut by hand."""
    with open(astropy_iers_data.IERS_A_FILE) as file:
        return [line for line in file if line[58:68].strip()]


def _tai(time):
    utc = split_utc(time)
    tai1, tai2, _ = erfa.ufunc.utctai(*utc)
    return (tai1 - 2440587.5) * DAY + tai2 * DAY


def test_values_of_c04():
    # 2017-01-01 0h, EOP 20 C04: published to the microsecond
    with open(astropy_iers_data.IERS_B_FILE) as file:
        line = next(text for text in file if text[16:26].strip() == '57754.00')
    o = earth_orientation(_mjd(57754.0))
    assert o.source == 'IERS final'
    assert o.dut1 == pytest.approx(float(line[50:62]), abs=1e-9)
    assert o.dut1 == pytest.approx(0.5914, abs=2e-4)
    assert o.xp / ARCSEC == pytest.approx(float(line[26:38]), abs=1e-9)
    assert o.yp / ARCSEC == pytest.approx(float(line[38:50]), abs=1e-9)
    assert 0 < o.sigma_dut1 < 1e-4 and 0 < o.sigma_pole < 1e-3 * ARCSEC


def test_values_of_bulletin_a():
    line = _bulletin_a()[-100]
    o = earth_orientation(_mjd(float(line[7:15])))
    assert o.source == 'IERS prediction'
    assert o.dut1 == pytest.approx(float(line[58:68]), abs=1e-9)
    assert o.xp / ARCSEC == pytest.approx(float(line[18:27]), abs=1e-9)
    assert o.yp / ARCSEC == pytest.approx(float(line[37:46]), abs=1e-9)
    assert o.sigma_dut1 == pytest.approx(float(line[68:78]), rel=0.01)


def test_sources_follow_each_other():
    last = float(_bulletin_a()[-1][7:15])
    days = np.arange(37600.0, last + 100.0)
    source = earth_orientation(_mjd(days)).source
    rank = [4, 0, 1, 2, 3]
    assert list(dict.fromkeys(source.tolist())) == [SOURCES[k] for k in rank]
    assert np.all(source[days < 37665] == SOURCES[4]) and source[days == 37665] == SOURCES[0]
    assert source[days == last] == SOURCES[2] and source[days == last + 1] == SOURCES[3]


def test_interpolation_is_exact_for_a_cubic():
    mjd = np.arange(50000.0, 50010.0)
    cubic = 1e-3 * (mjd - 50004.2) ** 3 - 0.3 * mjd
    rows = np.stack([mjd, cubic, 2 * cubic, -cubic, 0.001 * (mjd - 49999), 0 * mjd])
    t = np.array([50000.0, 50000.3, 50004.5, 50007.25, 50009.0])
    value, _ = earth._interpolate(t, rows, np.zeros(10, int))
    expected = 1e-3 * (t - 50004.2) ** 3 - 0.3 * t
    assert value[0] == pytest.approx(expected, abs=1e-9)
    assert value[2] == pytest.approx(-expected, abs=1e-9)
    assert value[3] == pytest.approx([0.002, 0.002, 0.006, 0.009, 0.010])


@pytest.mark.parametrize('year, month', [(1972, 7), (1999, 1), (2017, 1)])
def test_no_tear_at_a_leap_second(year, month):
    midnight = _posix(year, month)
    before, at, after = (earth_orientation(midnight + s) for s in (-1.0, 0.0, 1.0))
    assert at.dut1 - before.dut1 == pytest.approx(1.0, abs=1e-6)
    assert after.dut1 == pytest.approx(at.dut1, abs=1e-6)
    # from 23:59:59 to 00:00:00 two seconds pass, and the day before is 86401 s long all along
    assert _tai(midnight) - _tai(midnight - 1.0) == pytest.approx(2.0, abs=2e-5)
    assert _tai(midnight - 1.0) - _tai(midnight - 2.0) == pytest.approx(1.0, abs=2e-5)
    assert split_utc(midnight - DAY / 2)[1] == pytest.approx(43200.0 / 86401.0, abs=1e-15)
    assert split_utc(midnight + DAY / 2)[1] == 0.5


def test_ut1_is_continuous_over_the_whole_table():
    mjd = np.arange(37666.0, float(_bulletin_a()[-1][7:15]) - 1, 0.25)
    ut1_tai = earth_orientation(_mjd(mjd)).dut1 - (_tai(_mjd(mjd)) - _mjd(mjd))
    # Earth's day is never more than 5 ms from 86400 s; a leap second would show as 1 s
    assert np.abs(np.diff(ut1_tai)).max() < 0.005 * 0.25 + 2e-4
    # nor does it stagger at midnight (C04 itself has 0.3 ms at MJD 45699)
    assert np.abs(np.diff(ut1_tai, 2)).max() < 5e-4


def test_ut1_in_the_years_of_the_rubber_second():
    # TAI-UTC ran by 2.592 ms a day in 1966-68; UTC was kept within 0.1 s of UT2
    o = earth_orientation(np.arange(_posix(1962, 2), _posix(1971, 12), 10.37 * DAY))
    assert np.abs(o.dut1).max() < 0.2


def test_any_date_of_two_centuries():
    time = np.linspace(_posix(1900), _posix(2100, 12, 31), 4001)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        o = earth_orientation(time)
        utc = split_utc(time)
    for value in (o.dut1, o.xp, o.yp, o.sigma_dut1, o.sigma_pole, *utc):
        assert np.all(np.isfinite(value))
    assert np.all(np.hypot(o.xp, o.yp) < 1.2 * ARCSEC)
    assert np.all(o.sigma_dut1 > 0) and np.all(o.sigma_pole > 0)
    assert np.all(o.sigma_dut1[time < _posix(1960)] == 0.5)
    until_2035 = time < _posix(2035)
    assert np.abs(o.dut1[until_2035]).max() < 0.95
    assert o.sigma_dut1[until_2035 & (o.source == 'extrapolated')].max() < 0.53
    assert o.sigma_dut1[-1] > 10.0


def test_extrapolation_starts_where_the_table_ends():
    last = _mjd(float(_bulletin_a()[-1][7:15]))
    end, beyond = earth_orientation(last), earth_orientation(last + 60.0)
    assert beyond.source == 'extrapolated'
    assert beyond.dut1 == pytest.approx(end.dut1, abs=0.1 * end.sigma_dut1)
    assert beyond.sigma_dut1 == pytest.approx(end.sigma_dut1, rel=0.1)
    assert beyond.xp == pytest.approx(end.xp, abs=1e-3 * ARCSEC)
    assert beyond.yp == pytest.approx(end.yp, abs=1e-3 * ARCSEC)


@pytest.mark.parametrize('years', [1, 3, 10])
def test_extrapolation_error_is_as_stated(years):
    """Cut C04 at many dates and compare what is extrapolated with what came."""
    rows, _ = iers_tables.rows_of(41684, 61000)
    ahead = round(365.25 * years)
    error = []
    for end in range(400, rows.shape[1] - ahead, 150):
        value = earth.extrapolate(rows[0, [end + ahead]], rows[:, end - 365 : end + 1])[:, 0]
        true = rows[1:4, end + ahead]
        error.append([(value[0] - true[0]) / value[3], *((value[1:3] - true[1:3]) / value[4])])
    rms = np.sqrt(np.mean(np.square(error), axis=0))
    assert np.all(rms < 1.3) and np.all(rms > 0.5), rms


def test_reads_only_the_rows_around_the_time(monkeypatch):
    read = []
    original = iers_tables._lines
    monkeypatch.setattr(iers_tables, '_lines', lambda *a: read.append(a[4]) or original(*a))
    iers_tables.rows_of.cache_clear()
    earth_orientation(_posix(2005, 6, 7, 8))
    assert sum(read) == 4
    earth_orientation(_posix(2005, 6, 7, 9))
    assert sum(read) == 4


def test_shapes_and_statement():
    one, many = earth_orientation(1.7e9), earth_orientation(np.full((2, 3), 1.7e9))
    assert isinstance(one.dut1, float) and isinstance(one.source, str)
    assert many.dut1.shape == many.source.shape == (2, 3)
    assert many.dut1 == pytest.approx(one.dut1)
    assert one.sigma == pytest.approx(
        np.hypot(15.041 * ARCSEC * one.sigma_dut1, one.sigma_pole), rel=1e-4)
    far = earth_orientation(np.array([1.7e9, _posix(2033)]))
    assert 'extrapolated' in far.statement() and '\n' not in far.statement()


@pytest.mark.parametrize('time', [np.nan, np.inf, _posix(1899, 12, 31), _posix(2101, 1, 2)])
def test_impossible_times(time):
    with pytest.raises(ValueError, match='outside 1900 to 2100'):
        earth_orientation(np.array([0.0, time]))


@pytest.mark.parametrize('damage', ['cut', 'shifted'])
def test_damaged_table(damage, tmp_path, monkeypatch):
    data = Path(astropy_iers_data.IERS_B_FILE).read_bytes()
    start = data.index(b'\n1962') + 1
    line = 219
    if damage == 'cut':
        data = data[: start + 3 * line] + b'x' * 17 * line
    else:
        data = data[: start + 3 * line] + data[start + 4 * line :]
    path = tmp_path / 'eopc04'
    path.write_bytes(data)
    monkeypatch.setattr(astropy_iers_data, 'IERS_B_FILE', str(path))
    iers_tables.extent.cache_clear()
    iers_tables.rows_of.cache_clear()
    try:
        with pytest.raises(ValueError, match='reinstall astropy-iers-data'):
            earth_orientation(_mjd(37670.5))
    finally:
        iers_tables.extent.cache_clear()
        iers_tables.rows_of.cache_clear()


def test_erfa_learns_a_leap_second_that_it_does_not_know():
    known = erfa.leap_seconds.get()
    try:
        erfa.leap_seconds.set(known[:-2])
        iers_tables.learn_leap_seconds.cache_clear()
        assert _tai(_posix(2020)) - _posix(2020) == pytest.approx(37.0, abs=2e-5)
        assert np.array_equal(erfa.leap_seconds.get()[-2:], known[-2:])
    finally:
        erfa.leap_seconds.set(known)
        iers_tables.learn_leap_seconds.cache_clear()
