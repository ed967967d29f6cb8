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

import json

import numpy as np
import pytest

from calibration.analysis.encoders.cross_check import Homing
from calibration.analysis.harmonic_fit import HarmonicChoice
from calibration.calibration_state import CalibrationState
from calibration.night_series import NightSeries
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP
from telescope_mount.papers.table_1 import (
    COLUMNS,
    PAPER_TABLE_1,
    compare_with_paper,
    experiment_tables,
    statistics,
)

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))
DAY = 86400.0
pytestmark = pytest.mark.usefixtures('nothing_expected')
#: of the zero in each night; the nights between two of them lie far off
DRIFTS = {-1: (0.0, 0.0), 0: (100.0, -70.0), 1: (12.0, -9.0), 2: (95.0, -78.0), 3: (3.0, 5.0)}
SATELLITE = -26690.0


def block(rng, run, star, az, el, time, noise=1.0):
    drift = np.array(DRIFTS[run]) * ARCSEC
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, len(az))) * noise * ARCSEC
    enc = {'az_enc': az_enc + drift[0] + x / np.cos(el), 'el_enc': el_enc + drift[1] + y}
    second = {name.replace('enc', 'abs'): value - shift
              for (name, value), shift in zip(enc.items(), drift)}
    return PointingRun({
        'az': az, 'el': el, **enc, **second, 'star': np.broadcast_to(star, len(az)).astype(float),
        'run': np.full(len(az), float(run)), 'time': time + 40.0 * np.arange(len(az))})


def night(run, seed=0, stars=30, polaris=16, satellite=False):
    """Blocks of a night in their order: (satellite,) stars, Polaris, (satellite,) stars."""
    rng = np.random.default_rng([seed, run + 10])
    start = 1.38e9 + run * DAY

    def field(first, time):
        az, el = rng.uniform(0.0, 2.0 * np.pi, stars), np.arcsin(rng.uniform(0.35, 0.99, stars))
        return block(rng, run, first + np.arange(stars), az, el, time)

    out = [field(1000, start)]
    hour = 0.01 * np.arange(polaris)
    out.append(block(rng, run, POLARIS_HIP, 0.6 * DEG * np.sin(hour), 34.9 * DEG + 0.0 * hour,
                     start + 5000.0))
    out.append(field(2000, start + 10000.0))
    if satellite:
        for time in (start + 2000.0, start + 8000.0):
            az = np.linspace(1.0, 1.2, 12)
            out.append(block(rng, run, SATELLITE, az, 0.5 + 0.1 * az, time))
    return PointingRun.concatenate(out)


@pytest.fixture(scope='module')
def season():
    """All nights, in the last of which a satellite was tracked; the zeros as each was set; the
    report.
    """
    series, zeros = NightSeries(2), {}
    for run in sorted(DRIFTS):
        series.add(night(run, satellite=run == 3), run + 10)
        zeros[run] = series.calibrate_zero()[1]
        assert (series.reference is None) == (run < 1)
        _, report = series.fit()
    return series, zeros, report


@pytest.fixture
def nights(season):
    """Rows of the report after night 3."""
    return season[2]['nights']


def test_nights_without_a_model_of_two_nights_before_have_no_row(nights):
    assert [row['night'] for row in nights] == [1, 2, 3]
    assert [row['reference'] for row in nights] == [-1, 0, 1]
    json.dumps(nights)


def test_before_is_the_change_since_two_nights_before(nights):
    for row in nights:
        then, now = DRIFTS[row['night'] - 2], DRIFTS[row['night']]
        before = row['physical']['before']
        assert before['az_mean_arcsec'] == pytest.approx(now[0] - then[0], abs=2.5)
        assert before['el_mean_arcsec'] == pytest.approx(now[1] - then[1], abs=1.5)


def test_after_the_calibration_the_means_are_within_their_errors(nights):
    for row in nights:
        after = row['physical']['after']
        for axis in ('az', 'el'):
            assert abs(after[f'{axis}_mean_arcsec']) < 4.0 * after[f'{axis}_sigma_arcsec']
        assert 1.0 < after['radial_rms_arcsec'] < 2.0
        assert after['x_rms_arcsec'] < 0.95 * after['az_rms_arcsec']  # times cos E


def test_predicted_errors_are_those_that_come_out(monkeypatch):
    # the cross-check of the encoders takes half of the time of a fit, and nothing here asks for it
    monkeypatch.setattr(CalibrationState, '_cross_check', lambda *args: {'alarms': []})
    chi = []
    for seed in range(16):
        series = NightSeries(2)
        for run in (-1, 1):
            series.add(night(run, seed, stars=12), run + 10)
            series.calibrate_zero()
            _, report = series.fit()
        after = report['nights'][0]['physical']['after']
        chi.append([after[f'{axis}_mean_arcsec'] / after[f'{axis}_sigma_arcsec']
                    for axis in ('az', 'el')])
    # 16 values: their RMS is known to 18 %
    assert np.sqrt(np.mean(np.square(chi), axis=0)) == pytest.approx([1.0, 1.0], abs=0.35)


def test_zeros_of_all_nights_go_with_one_another(season, nights):
    series, zeros, _ = season
    for run in (1, 2, 3):
        # the change of the zero in the report is that of the zeros, and of what was put in
        change = zeros[run].angles - series._nights[run - 2].models['physical'][1].angles
        row = nights[run - 1]['physical']
        assert change / ARCSEC == pytest.approx(
            [row['change_az_arcsec'], row['change_el_arcsec']], abs=1e-9)
        assert change / ARCSEC == pytest.approx(
            np.subtract(DRIFTS[run], DRIFTS[run - 2]), abs=2.5)
    # and of one night from the next, which has no part in its reference
    third, second = (series._nights[run].models['physical'][1].angles for run in (3, 2))
    assert (third - second) / ARCSEC == pytest.approx(np.subtract(DRIFTS[3], DRIFTS[2]), abs=4.0)


def test_a_satellite_is_judged_and_not_fitted(nights):
    rng_free = NightSeries(2)
    with_it = NightSeries(2)
    for run in (-1, 1):
        rows = night(run, satellite=run == 1)
        with_it.add(rows, run + 10)
        rng_free.add(rows.select(rows['star'] > 0), run + 10)
        models = []
        for series in (with_it, rng_free):
            series.calibrate_zero()
            models.append(series.fit()[0].to_json())
    assert models[0] == models[1]
    track = nights[-1]['satellite']
    assert np.mean(track['before']['az_arcsec']) == pytest.approx(-9.0, abs=2.5)
    assert np.mean(track['before']['el_arcsec']) == pytest.approx(14.0, abs=1.5)
    assert abs(np.mean(track['after']['az_arcsec'])) < 3.0
    assert abs(np.mean(track['after']['el_arcsec'])) < 1.5
    assert len(track['before']['time']) == len(track['after']['time']) == 12


def test_a_shift_of_the_absolute_encoder_is_an_alarm():
    series = NightSeries(2)
    for run in (-1, 0, 1):
        rows = night(run)
        if run == 1:
            rows.columns['el_abs'] = rows['el_abs'] + 9.0 * ARCSEC
        series.add(rows, run + 10)
        series.calibrate_zero()
        _, report = series.fit()
        alarms = report['witnesses']['alarms']
        assert bool(alarms) == (run == 1), alarms
    assert 'elevation' in alarms[0] and 'absolute encoder' in alarms[0]
    assert report['nights'][0]['alarms'] == alarms


def test_a_calibration_started_anew_takes_the_table():
    series, late = NightSeries(2), NightSeries(2)
    rows = PointingRun.concatenate([night(-1), night(0)])
    series.add(rows, 5)
    late.add_table(rows, 5)
    assert series.rows.taken.kept == late.rows.taken.kept == len(rows)
    assert series.calibrate_zero()[1].az == late.calibrate_zero()[1].az


@pytest.fixture(scope='module')
def three():
    """The rows of three nights, the zero of the last, the report."""
    series, nights = NightSeries(2), [night(run) for run in (-1, 0, 1)]
    for number, rows in enumerate(nights):
        series.add(rows, number + 1)
        zero = series.calibrate_zero()[1]
        _, report = series.fit()
    return nights, zero, report


def test_a_calibration_started_anew_has_the_references_of_the_nights_before(three):
    nights, zero, report = three
    late = NightSeries(2)
    late.add_table(PointingRun.concatenate(nights), 3)
    again = late.calibrate_zero()[1]
    assert late.reference is not None
    assert (again.az, again.el) == (zero.az, zero.el)
    assert late.fit()[1]['nights'] == report['nights']


def test_a_table_that_overtakes_the_last_row_leaves_the_zero(three):
    nights, _, report = three
    series = NightSeries(2)
    for number, rows in enumerate(nights):
        last = number == 2
        series.add(rows.select(slice(0, -1)) if last else rows, 10 * number + 9)
        series.calibrate_zero()
        if last:
            series.add_table(PointingRun.concatenate(nights), 30)
        _, overtaken = series.fit()
    assert [row['night'] for row in overtaken['nights']] == [1]
    assert overtaken['nights'] == report['nights']


@pytest.mark.parametrize('power_ons', [0, 3])
def test_a_table_that_overtakes_the_last_row_changes_no_number(power_ons):
    nights = [night(run) for run in (-1, 0, 1, 2)]
    reports = []
    for overtakes in (False, True):
        series = NightSeries(2, power_ons=power_ons)
        for number, rows in enumerate(nights):
            last = 10 * (number + 1)
            if number == 3 and overtakes:
                series.add(rows.select(slice(0, -1)), last - 1)
                table = PointingRun.concatenate(nights[1:] if power_ons else nights)
                assert series.add_table(table, last) == 1
            series.add(rows, last)
            zero = series.calibrate_zero()[1]
            _, report = series.fit()
        reports.append((zero.az, zero.el, json.dumps(report)))
    assert reports[0] == reports[1]


def test_nights_long_ago_are_not_kept():
    nights = [night(run) for run in (-1, 0, 1, 2)]
    series, whole = NightSeries(2, power_ons=3), NightSeries(2)
    for number, rows in enumerate(nights):
        for one in (series, whole):
            one.add(rows, number + 1)
        zero, same = series.calibrate_zero()[1], whole.calibrate_zero()[1]
        told, report = series.fit()[1], whole.fit()[1]
        # the reference of tonight is there: the same numbers
        assert (zero.az, zero.el) == (same.az, same.el)
        assert told['nights'] == report['nights'] and told['power_ons'] == report['power_ons']
    assert series.rows.taken.kept == sum(map(len, nights[1:]))
    assert series.rows.taken == (series.rows.taken.kept, 3, len(nights[0]), 4)
    assert sorted(series.zeros) == [0, 1, 2]
    assert [note for note in told['notes'] if note not in report['notes']] == [
        'the nights are of the last 3 power-ons alone (kept_power_ons): rows of earlier ones, if '
        'there are any, are in the log']
    late = NightSeries(2, power_ons=3)
    late.add_table(PointingRun.concatenate(nights), 4)
    assert late.rows.taken.kept == series.rows.taken.kept and late.rows.newest == 2


@pytest.mark.parametrize('power_ons', [1, 2])
def test_the_reference_must_be_among_the_nights_that_are_kept(power_ons):
    with pytest.raises(ValueError, match='keep 3 or more'):
        NightSeries(2, power_ons=power_ons)


def test_nothing_observed_is_said():
    for work in (NightSeries(2).calibrate_zero, NightSeries(2).fit):
        with pytest.raises(ValueError, match='observe first'):
            work()


# --- the report of the experiment -----------------------------------------------------------------


def test_the_papers_table_recomputed():
    """Erratum 5: mean, standard deviation, RMS."""
    wanted = {'before_az_arcsec': (1.12, 8.35, 8.04), 'before_el_arcsec': (2.26, 9.72, 9.54),
              'after_az_arcsec': (-0.85, 1.12, 1.37), 'after_el_arcsec': (-0.08, 0.56, 0.54)}
    for name, numbers in statistics(PAPER_TABLE_1).items():
        ours = [numbers[key] for key in ('mean', 'std', 'rms')]
        assert ours == pytest.approx(wanted[name], abs=0.006)


def test_report_and_tables(nights):
    report = compare_with_paper(nights, 3)
    assert [row['night'] for row in report['table1']] == [1, 2, 3]
    assert set(report['table1'][0]) == set(COLUMNS)
    gps = report['gps']
    assert gps['before']['n'] == 12
    assert gps['before']['el_mean_arcsec'] == pytest.approx(14.0, abs=1.5)
    assert gps['before']['az_sky_mean_arcsec'] == pytest.approx(
        gps['before']['az_mean_arcsec'] * np.cos(0.61), abs=0.3)
    assert gps['paper']['after']['az_mean_arcsec'] == 5.94
    text = ' '.join(str(cell) for table in experiment_tables(report)
                    for column in table.columns for cell in column.cells)
    assert '+3.5' in text and '+13.99 ± 11.33' in text


def test_the_case_after_the_nights(nights):
    case = compare_with_paper(nights, 2)['case_1_1']  # night 3: -9, 14 since night 1
    assert case['polaris_off_arcsec'] == pytest.approx(
        np.hypot(9.0 * np.cos(34.9 * DEG), 14.0), abs=1.5)
    assert case['before_rms_arcsec'] > 8.0 > case['after_max_arcsec']
    assert compare_with_paper(nights, 3)['case_1_1'] is None


def test_a_missing_night_is_said(nights):
    with pytest.raises(ValueError, match='no calibrated night 4, 5'):
        compare_with_paper(nights, 5)


def test_the_zeros_of_the_season_are_in_the_report():
    series = NightSeries(2)
    for run in DRIFTS:
        series.season.update_marks([
            Homing(0, axis, True, 'below', supply=5.0 + 0.01 * run, temperature=2.0 * run,
                   started=1.38e9 + DAY * run - 100.0) for axis in ('azimuth', 'elevation')])
        series.add(night(run), run + 10)
        report = series.fit()[1]
    rows = report['power_ons']
    assert [row['run'] for row in rows] == list(DRIFTS)
    assert [row['temperature'][0] for row in rows] == [2.0 * run for run in DRIFTS]
    assert [row['supply'][1] for row in rows] == [5.0 + 0.01 * run for run in DRIFTS]
    zeros = np.array([row['zero_arcsec'] for row in rows])
    np.testing.assert_allclose(zeros, np.array(list(DRIFTS.values())), atol=3.0)
    assert f'{len(DRIFTS)} power-ons' in report['zero_causes']['text']  # too few
    # tonight from the four nights before: their mean, and what they scatter
    told = report['zero_expected']['azimuth']
    assert told['zero_arcsec'] == pytest.approx(zeros[:-1, 0].mean())
    assert told['change_arcsec'] == pytest.approx(zeros[:-1, 0].mean() - zeros[-2, 0])
    assert told['sigma_arcsec'] > 40.0
    json.dumps(report)


def test_the_reference_of_a_night_is_what_was_published_with_harmonics():
    plain, series = (NightSeries(1, harmonics=choice) for choice in (
        HarmonicChoice(), HarmonicChoice('zenith', True, 2)))
    reports = {}
    for one in (plain, series):
        for run in (1, 2, 3):
            one.add(night(run), run + 10)
            one.calibrate_zero()
            _, reports[one is series] = one.fit()
    assert series.reference.harmonics.degree == 2 and series.reference.terms == {}
    with_it, without = (reports[harmonics]['nights'] for harmonics in (True, False))
    assert [row['night'] for row in with_it] == [row['night'] for row in without]
    # the terms are judged beside it, as where they are published
    for a, b in zip(with_it, without):
        assert 'published' in a and 'published' not in b
        own, terms, same = (row[kind]['after']['radial_rms_arcsec'] for row, kind in (
            (a, 'published'), (a, 'physical'), (b, 'physical')))
        assert own > terms == pytest.approx(same, abs=1e-6)
