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

"""The power-ons of a season: what was measured, in files and for people."""

import csv

import numpy as np
import pytest

from calibration.analysis.encoders.cross_check import Homing
from calibration.analysis.zero.zero_causes import Season
from calibration.analysis.zero.zero_season import (
    SeasonLog,
    power_on_covariates,
    season_from_rows,
    season_rows,
)
from calibration.report.zero_season_report import (
    season_lines,
    season_table,
    write_season,
    zero_season,
)
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun


def make_season(n=11):
    """The azimuth follows the temperature by 3 arcsec / degC."""
    rng = np.random.default_rng(1)
    warmth, supply = rng.uniform(-4.0, 16.0, n), 5.0 + rng.normal(0.0, 0.1, (n, 2))
    zeros = rng.normal(0.0, 2.0, (n, 2)) + np.outer(warmth, [3.0, 0.0])
    return Season(np.arange(n), 86400.0 * np.arange(n), zeros * ARCSEC,
                  np.full((n, 2), 0.3 * ARCSEC), {
                      'temperature': np.tile(warmth[:, None], 2), 'supply': supply,
                      'hours': np.full((n, 2), 24.0), 'side': np.ones((n, 2))})


def rows_of(**columns):
    angles = dict.fromkeys(('az', 'el', 'az_enc', 'el_enc'), np.zeros(2))
    return PointingRun(angles | {'time': np.array([1000.0, 1010.0])} | columns)


def test_temperature_is_that_of_the_encoders_else_that_of_the_air():
    air = rows_of(temperature=np.array([np.nan, 4.0]))
    told = {'azimuth': Homing(1, 'azimuth', True, 'above', supply=4.9, temperature=7.0),
            'elevation': Homing(1, 'elevation', True, 'below', supply=5.1, temperature=8.0)}
    assert power_on_covariates(told, air) == {
        'temperature': (7.0, 8.0), 'supply': (4.9, 5.1), 'side': (-1.0, 1.0)}
    nothing = power_on_covariates({}, air)
    assert nothing['temperature'] == (4.0, 4.0) and np.isnan(nothing['supply']).all()
    assert np.isnan(power_on_covariates({}, rows_of())['temperature']).all()


def test_a_power_on_has_what_its_own_marks_said():
    log = SeasonLog()
    for started, warmth in ((500.0, 1.0), (990.0, 2.0), (1500.0, 3.0)):  # in any order
        log.update_marks([Homing(0, axis, True, 'below', temperature=warmth, started=started)
                  for axis in ('azimuth', 'elevation')])
    log.update_marks([Homing(0, 'azimuth', False, temperature=9.0, started=995.0)])
    log.add_power_on(1, rows_of(encoder_start=np.full(2, 990.0)))
    assert log._covariates[1]['temperature'] == (2.0, 2.0)
    assert np.isnan(log._covariates[1]['hours']).all()
    log.add_power_on(2, rows_of(encoder_start=np.full(2, 990.0 + 7200.0), time=np.full(2, 9000.0)))
    second = log._covariates[2]
    assert second['temperature'] == (3.0, 3.0) and second['hours'] == (2.0, 2.0)
    assert log.expected(2) is None and len(log.season()) == 0


def test_rows_go_there_and_back():
    given = make_season()
    given.covariates['supply'][2] = np.nan
    back = season_from_rows(season_rows(given))
    np.testing.assert_allclose(back.zeros, given.zeros)
    for name, values in given.covariates.items():
        np.testing.assert_array_equal(back.covariates[name], values)
    assert len(season_from_rows([])) == 0


@pytest.fixture(scope='module')
def judged():
    rows = season_rows(make_season(12))
    expected = {axis: {'zero_arcsec': 1.0, 'sigma_arcsec': 3.0, 'by': [], 'missing': []}
                for axis in ('azimuth', 'elevation')}
    return zero_season(rows, expected)


def test_what_people_see(judged):
    from rich.console import Console
    console = Console(width=110)
    with console.capture() as shown:
        console.print(season_table(judged))
    text = shown.get()
    for words in ('of the zero, 11 power-ons', 'temperature', 'arcsec/°C', 'unexplained, arcsec',
                  '+1.0 ± 3.0', 'cause'):
        assert words in text, words
    lines = season_lines(judged)
    assert 'the zero changes with the temperature' in lines[0]
    assert any('not tried: time since' in line for line in lines)


def test_tonight_is_not_among_those_it_is_judged_by(judged):
    assert judged['causes']['nights'] == 11 and judged['tonight']['run'] == 11
    assert judged['tonight']['azimuth']['measured_arcsec'] == \
        judged['power_ons'][-1]['zero_arcsec'][0]


def test_a_season_of_nothing_is_shown_too(tmp_path):
    judged = zero_season([], None)
    assert season_table(judged).row_count and 'too few' in season_lines(judged)[0]


def test_csv(judged, tmp_path):
    write_season(judged['power_ons'], tmp_path / 'zeros.csv')
    with open(tmp_path / 'zeros.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12 and float(rows[3]['temperature_el_c']) == pytest.approx(
        judged['power_ons'][3]['temperature'][1])
    assert {'zero_az_arcsec', 'sigma_el_arcsec', 'supply_az_v', 'since_az_h', 'side_el'} <= set(
        rows[0])
