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

"""Diagnosis on simulated nights: exact rotations and rules that are not the fitted columns."""

import json
from functools import cache

import numpy as np
import pytest
from simulated import FAST, SITE, TRUTH, backlash, names, night, oval_disc

from calibration.analysis.diagnosis import holdout, validation
from calibration.analysis.diagnosis.base_terms import Base
from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.observations import observations
from calibration.analysis.diagnosis.run_problem import RunProblem
from calibration.analysis.diagnosis.validation import _surely, _worse
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_view import view_of
from calibration.report.wording import paragraph, wording
from msg_tools import forks
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.effects import Amount
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL, STANDARD6
from pointing_model.runs.run import PointingRun


def off_centre(size):
    """A disc off its centre, exactly."""
    def of(c):
        d, a = size * ARCSEC, c['az'] - 0.7
        return wrap(np.arctan2(np.sin(a), np.cos(a) - d) - a), 0.0
    return of


KEYS = {'observations', 'runs', 'base_terms', 'verdict', 'before', 'after', 'noise_floor_arcsec',
        'effects', 'excluded', 'next_observations', 'wander', 'detectable', 'expected',
        'rows_read', 'rows_used', 'outliers', 'rms_with_outliers_arcsec', 'columns_alike',
        'readings', 'as_read_rms_arcsec', 'unequal_scatter', 'worst_rows', 'held_out', 'no_star',
        'unequal_axes',
        'unphysical', 'approach_from', 'rows_are', 'rows_taken_back', 'rows_not_drawn',
        'detection_factor',
        'as_read_terms', 'south', 'cv_contiguous', 'equinox'}
RMS = {'rms_arcsec', 'rms_x_arcsec', 'rms_y_arcsec', 'cv_rms_arcsec', 'cv_rms_x_arcsec',
       'cv_rms_y_arcsec', 'cv_spread', 'holdout_rms_arcsec'}
EFFECT = {'name', 'tpoint', 'driver', 'axes', 'coefficients_arcsec', 'sigma_arcsec', 'p_family',
          'delta_bic', 'alternatives', 'cv_gain_arcsec', 'causes', 'contenders',
          'removes_rms_arcsec'}


def test_backlash_is_named_and_taken_out():
    run, fresh = night(1, effect=backlash(12.0)), night(2, effect=backlash(12.0))
    result = diagnose(run, holdout=fresh, folds=5)
    assert names(result) == ['azimuth_hysteresis_cosE']
    row = json.loads(json.dumps(result.to_dict()))
    assert set(row) == KEYS and set(row['before']) == set(row['after']) == RMS
    assert row['verdict'] == 'identified' and row['observations'] == 60
    (effect,) = row['effects']
    assert set(effect) == EFFECT
    # half of the 12" between the sides, encoder - catalogue positive for approach +1
    assert effect['coefficients_arcsec']['half_difference'] == pytest.approx(6.0, abs=0.9)
    assert 0.1 < effect['sigma_arcsec']['half_difference'] < 0.4
    assert effect['p_family'] <= 0.01 and effect['cv_gain_arcsec'] > 1.0
    assert row['before']['cv_rms_arcsec'] > 3.0 and row['after']['cv_rms_arcsec'] < 1.8
    assert row['before']['holdout_rms_arcsec'] > 3.0
    assert row['after']['holdout_rms_arcsec'] < 1.75
    assert row['noise_floor_arcsec'] == pytest.approx(np.sqrt(2.0), rel=0.2)
    # the model points the fresh night, with the drivers from its run
    x, y = result.model.residuals(fresh)
    assert np.sqrt(np.mean(x**2 + y**2)) < 1.8 * ARCSEC
    x, y = result.base_model.residuals(fresh)
    assert np.sqrt(np.mean(x**2 + y**2)) > 3.0 * ARCSEC


def test_the_fit_with_effects_is_exact():
    big = {name: 6.0 * v for name, v in TRUTH.items()}
    run = night(3, effect=off_centre(40.0), noise=lambda rng, el: 0.05 * rng.normal(
        size=(2, len(el))), terms=big)
    result = diagnose(run, **FAST)
    assert names(result) == ['azimuth_encoder_1']
    assert result.after['rms_arcsec'] < 0.09
    assert np.allclose(result.model.residuals(run), result.residual_after, atol=1e-5 * ARCSEC)
    for name, v in big.items():
        assert result.model.terms[name] == pytest.approx(v, abs=0.15 * ARCSEC)
    # d sin(a - 0.7) on the angle
    c = result.effects[0].fitted.coefficients / ARCSEC
    assert c == pytest.approx([-40.0 * np.sin(0.7), 40.0 * np.cos(0.7)], abs=0.1)


def test_clean_nights_stay_as_they_are():
    # the level itself test_search.py has
    found = [diagnose(night(100 + i, n=40), **FAST) for i in range(4)]
    assert sum(r.verdict != 'none' for r in found) <= 1
    clean = next(r for r in found if r.verdict == 'none')
    assert clean.before == clean.after and clean.to_dict()['effects'] == []
    assert clean.model.terms == clean.base_model.terms and not clean.model.effects


def test_noise_that_grows_toward_the_horizon_is_no_effect():
    found = [diagnose(night(200 + i, n=40, noise=lambda rng, el: rng.normal(size=(2, len(el)))
                            / np.sin(el)), **FAST).verdict for i in range(3)]
    assert sum(v != 'none' for v in found) <= 1


def late(c):
    """9" in the later rows."""
    return 9.0 * ARCSEC * (np.arange(len(c['az'])) >= 23)


CASES = {
    'drift': (lambda c: (0.0, 12.0 * ARCSEC * (c['time'] - 1.7e9) / 3600.0),
              {'elevation_zero_with_time', 'elevation_zero_with_temperature',
               'flexure_with_time', 'elevation_zero_step'}),
    'step': (lambda c: (7.0 * ARCSEC * (np.arange(len(c['az'])) >= 23), 0.0),
             {'azimuth_zero_step'}),
    'kicked pier': (lambda c: late(c) * np.array([
        np.sin(c['az']) * np.tan(c['el']), np.cos(c['az'])]), {'tilt_step'}),
    'loose camera': (lambda c: (late(c) / np.cos(c['el']), 0.0), {'collimation_step'}),
    'oval disc': (oval_disc, {'azimuth_encoder_2'}),
    'refraction': (lambda c: (0.0, -5.0 * ARCSEC / np.tan(c['el'] + 0.001)),
                   {'refraction', 'refraction_cube', 'elevation_encoder_2', 'second_flexure',
                    'elevation_encoder_1', 'elevation_encoder_3'}),
    'magnitude': (lambda c: (0.0, 1.2 * ARCSEC * c['magnitude']), {'magnitude_equation_el'}),
}


@cache
def found_of(case):
    return diagnose(night(11, effect=CASES[case][0]), **FAST)


@pytest.mark.parametrize('case', CASES)
def test_effects_are_found(case):
    result, expected = found_of(case), CASES[case][1]
    # what follows the zenith distance has many names
    assert result.verdict == ('ambiguous' if case == 'refraction' else 'identified')
    (one,) = result.effects
    assert one.fitted.effect.name in expected
    assert {*one.alternatives, *one.aliases} <= expected
    assert result.after['rms_arcsec'] < 0.75 * result.before['rms_arcsec']


def test_step_is_found_at_its_time():
    (one,) = found_of('step').effects
    time = night(11)['time']
    assert time[20] < one.fitted.effect.parameters['at'] < time[26]
    assert one.fitted.coefficients[0] / ARCSEC == pytest.approx(7.0, abs=1.5)


def test_a_step_is_placed_between_its_rows():
    # of 200 rows the search tries every sixth place
    run = night(22, n=200, effect=lambda c: (0.0, 6.0 * ARCSEC * (np.arange(200) >= 93)))
    result = diagnose(run, **FAST)
    (one,) = result.effects
    assert run['time'][92] < one.fitted.effect.parameters['at'] < run['time'][93]
    assert not result.excluded
    assert 2.0 * ARCSEC * 2.9 < one.fitted.coefficients[0] < 2.0 * ARCSEC * 3.1


def test_own_terms_of_a_run_come_from_its_other_rows():
    nights = [night(70 + i, n=15, effect=backlash(12.0)) for i in range(3)]
    result = diagnose(nights)
    # the noise is 1.41"; two terms fitted to the two rows that are judged would leave less
    assert 1.1 * result.after['rms_arcsec'] < result.after['cv_rms_arcsec'] < 2.0


def test_two_effects_at_once():
    def both(c):
        return (off_centre(6.0)(c)[0] + backlash(8.0)(c)[0],
                12.0 * ARCSEC * (c['time'] - 1.7e9) / 3600.0)
    result = diagnose(night(5, n=80, effect=both), **FAST)
    shown = [{e.fitted.effect.name, *e.alternatives, *e.aliases} for e in result.effects]
    for wanted in ('azimuth_encoder_1', 'azimuth_hysteresis_cosE', 'elevation_zero_with_time'):
        assert any(wanted in s for s in shown), wanted


def growing(size, by):
    """An azimuth error twice a turn, `by` times its size larger at the end than at the start."""
    def of(c):
        grown = 1.0 + by * (np.linspace(-0.5, 0.5, len(c['az'])))
        return size * ARCSEC * np.sin(2.0 * c['az'] + 1.0) * grown, 0.0
    return of


def test_an_effect_that_grows_is_told_with_its_change():
    result = diagnose(night(600, effect=growing(6.0, 1.8)), **FAST)
    assert len(result.effects) == 2, names(result)
    whole, change = result.effects
    # an axis error twice a turn and a line of sight twice a turn are close
    assert whole.fitted.effect.name in ('azimuth_encoder_2', 'line_of_sight_2')
    assert change.fitted.effect.form == 'changing'
    assert change.fitted.effect.name.startswith(whole.fitted.effect.name + '_changing_with_')
    assert result.after['rms_arcsec'] < 1.6 < result.before['rms_arcsec']
    sentence = change.fitted.effect.clause(Amount(
        change.fitted.coefficients / ARCSEC, 2.0, (0.0, 3600.0)))
    assert sentence.endswith('not the same all the time: it changes with time')
    # through the document, and held where the run is long over
    model = PointingModel.from_json(result.model.to_json())
    fresh = night(600, effect=growing(6.0, 1.8))
    assert np.allclose(model.residuals(fresh), result.model.residuals(fresh), atol=1e-12)
    late = PointingRun({**fresh.columns, 'time': fresh['time'] + 1e6}, fresh.meta)
    later = PointingRun({**fresh.columns, 'time': fresh['time'] + 2e6}, fresh.meta)
    assert np.array_equal(model.residuals(late), model.residuals(later))
    # what stays as it is has no change
    assert not any('changing' in name for name in names(
        diagnose(night(610, effect=growing(6.0, 0.0)), **FAST)))


def test_aliases_of_terms_are_never_effects():
    def clock(c):
        # 1.5 s of time, exactly: the sky turned about the pole
        lat, turn = SITE['latitude'], 1.5 * 15.0 * ARCSEC
        v = np.array([np.cos(c['el']) * np.sin(c['az']), np.cos(c['el']) * np.cos(c['az']),
                      np.sin(c['el'])])
        pole = np.array([0.0, np.cos(lat), np.sin(lat)])[:, None]
        w = v * np.cos(turn) + np.cross(pole, v, axis=0) * np.sin(turn) \
            + pole * (pole * v).sum(axis=0) * (1.0 - np.cos(turn))
        return wrap(np.arctan2(w[0], w[1]) - c['az']), np.arcsin(w[2]) - c['el']
    result = diagnose(night(6, effect=clock), **FAST)
    assert result.verdict == 'none'
    hidden = dict(result.untestable)
    assert 'IA + AW' in hidden['clock_or_longitude'] and 'IA + AW' in hidden['latency']
    assert 'AN' in hidden['latitude']
    # what AW took up
    assert result.model.terms['AW'] / ARCSEC == pytest.approx(
        TRUTH['AW'] / ARCSEC + 22.5 * np.cos(SITE['latitude']), abs=1.0)


def test_time_and_temperature_alike_are_ambiguous_and_it_says_what_to_observe():
    def drift(c):
        c['time'] -= 8.0 * 3600.0  # it stays dark for some hours
        c['temperature'] = 12.0 - 4.0 * np.linspace(0.0, 1.0, len(c['az']))**0.6
        return 0.0, -3.0 * ARCSEC * c['temperature']
    result = diagnose(night(11, effect=drift), **FAST)
    assert result.verdict == 'ambiguous'
    (one,) = result.effects
    shown = {one.fitted.effect.name, *one.alternatives}
    assert {'elevation_zero_with_temperature', 'elevation_zero_with_time'} <= shown
    assert result.next_observations
    for row in result.next_observations:
        assert 15.0 <= row['el_deg'] <= 88.0 and row['after_hours'] > 0.0
        assert row['utc'].startswith('2023-11-14 ') and row['next_night'] is False
        assert row['approach_az'] == row['approach_el'] == 0  # either: it makes no difference
        assert row['separation_after'] > row['separation_before'] >= 0.0
    json.dumps(result.to_dict())


def test_what_to_observe_says_the_approach_and_the_time_where_they_matter():
    result = diagnose(night(3, effect=backlash(4.0)), **FAST)
    assert result.verdict == 'ambiguous' and result.next_observations
    sides = [row['approach_az'] for row in result.next_observations]
    assert {-1, 1} <= set(sides)  # the first may be from either
    assert all(row['after_hours'] is None and row['approach_el'] == 0
               for row in result.next_observations)
    places = [(row['az_deg'], row['el_deg']) for row in result.next_observations]
    assert len(set(places)) == len(places)
    # a play that needs some degrees to cross shows after short moves back
    result = diagnose(night(6, effect=backlash(2.5)), **FAST)
    assert result.effects[0].alternatives == ['azimuth_hysteresis_cosE_memory_10deg']
    assert all(row['last_move_deg'] == 2.0 for row in result.next_observations)
    last = result.next_observations[-1]
    # by the rows so far they are members of one set, whatever was to be expected of such rows
    assert last['separation_before'] <= 6.0 and last['separation_after'] > 12.0


def test_exact_aliases_in_a_run_are_one_class():
    run = night(9, effect=lambda c: (0.0, 12.0 * ARCSEC * (c['time'] - 1.7e9) / 3600.0))
    run.columns['temperature'] = 20.0 - (run['time'] - 1.7e9) / 1800.0
    result = diagnose(run, **FAST)
    (one,) = result.effects
    assert {one.fitted.effect.name, *one.aliases} >= {
        'elevation_zero_with_time', 'elevation_zero_with_temperature'}
    # and the verdict does not choose between them
    assert set(one.aliases) <= set(one.alternatives) and result.verdict == 'ambiguous'
    assert set(one.aliases) <= set(result.to_dict()['effects'][0]['alternatives'])


def bump(c):
    return 9.0 * ARCSEC * np.exp(-0.5 * ((c['az'] - 2.0) / (12.0 * DEG))**2), 0.0


def test_unknown_shapes_are_said_to_be_unknown():
    result = diagnose(night(12, n=80, effect=bump), **FAST)
    assert result.verdict == 'unknown'
    curve = next(e for e in result.effects if e.fitted.effect.kind == 'smooth')
    assert curve.fitted.effect.driver == 'azimuth' and curve.fitted.effect.axes == 'az'
    fresh = night(13, effect=bump)
    x, y = result.model.residuals(fresh)
    assert np.sqrt(np.mean(x**2 + y**2)) < 2.0 * ARCSEC
    run = night(14, n=80, effect=lambda c: (0.0, 0.4 * ARCSEC * ((c['el'] / DEG) % 16.0 - 8.0)))
    result = diagnose(run, **FAST)
    assert {e.fitted.effect.driver for e in result.effects} == {'elevation'}


def test_outliers_and_slips():
    run = night(15)
    run.columns['az_enc'][7] += 2.0 * 1200.0 * ARCSEC
    run.columns['el_enc'][30] -= 1200.0 * ARCSEC
    run.columns['el_enc'][40] += 431.0 * ARCSEC
    run.columns['az_enc'][50] = np.nan
    run.meta['graduation'] = {'bars': 1080}
    result = diagnose(run, **FAST)
    slips = {e.fitted.effect.name: e.fitted.effect.parameters for e in result.effects}
    assert slips['azimuth_decode_slip_bars']['rows'] == [7]
    assert slips['azimuth_decode_slip_bars']['multiples'] == [2]
    assert slips['elevation_decode_slip_bars']['multiples'] == [-1]
    assert [e['row'] for e in result.excluded] == [50, 40]
    assert 'not finite' in result.excluded[0]['reason']
    assert any('encoder readings were off by whole bars' in note and note.endswith('row 7 (+2)')
               for note in map(wording, result.notes))
    # without a declared graduation, or a reading, they are outliers as any other
    for meta in ({'graduation': None}, {'raw_reading': False}):
        plain = diagnose(PointingRun(run.columns, {**run.meta, **meta}), **FAST)
        assert names(plain) == [] and {e['row'] for e in plain.excluded} == {7, 30, 40, 50}
    # in a file rows are its lines
    run.meta.update(source='night.csv', lines=2 * np.arange(60) + 5)
    other = night(16)
    other.meta['graduation'] = run.meta['graduation']
    again = diagnose([run, other], **FAST)
    assert [(e['row'], e['source']) for e in again.excluded] == [
        (105, 'night.csv'), (85, 'night.csv')]
    assert again.to_dict()['excluded'][0] == {
            'row': 105, 'reason': 'az_enc not finite', 'source': 'night.csv'}
    assert any(note.endswith('line night.csv:19 (+2)') for note in map(wording, again.notes))
    assert result.after['rms_arcsec'] < 1.7


@pytest.mark.parametrize('graduation', [{'grating': 47200}, {'grating': 47200, 'bars': 1080}])
def test_outliers_anywhere_are_no_slips(graduation):
    rng = np.random.default_rng(7)
    alarms = 0
    for seed in range(10):
        run = night(seed)
        rows = rng.choice(60, 4, replace=False)
        for axis, k in zip(rng.choice(['az_enc', 'el_enc'], 4), rows):
            run.columns[axis][k] += rng.choice([-1, 1]) * rng.uniform(20.0, 800.0) * ARCSEC
        run.meta['graduation'] = graduation
        obs = observations(run)
        alarms += bool(RunProblem(obs, Base.parse('physical'), 0.01, curves=False).slips)
    assert alarms <= 1  # of 10 at 1 %


def test_an_outlier_that_misses_speaks_against_slips():
    period = 2.0 * np.pi / 47200
    found = {}
    for misses in (0, 6):
        run = night(21)
        rows = np.arange(5, 5 + 4 + misses)
        run.columns['el_enc'][rows[:4]] += period * np.array([1, -2, 3, 1])
        run.columns['el_enc'][rows[4:]] += period * np.linspace(2.3, 7.7, misses)
        run.meta['graduation'] = {'el': {'grating': 47200}}
        slips = RunProblem(observations(run), Base.parse('physical'), 0.01).slips
        found[misses] = [p for _, p in slips]
    assert found[0] and found[0][0] < 1e-3
    assert not found[6]


def test_held_out_rows_and_drivers_that_fail_are_said():
    later = night(81, effect=backlash(8.0))
    later.columns['az_enc'][4] = np.nan
    later.columns.pop('approach_az')
    result = diagnose(night(80, effect=backlash(8.0)), holdout=later, **FAST)
    assert 'held out: run:4 left out: az_enc not finite' in '\n'.join(map(wording, result.notes))
    assert wording(result.cautions[0]) == (
        'run cannot test "azimuth hysteresis, × cos E": the direction of approach is not known '
        '(column approach_az).')
    # nothing else to judge: no figure, and no night is bad
    assert result.held_out == [] and result.after['holdout_rms_arcsec'] is None


def test_rows_without_the_driver_judge_nothing_and_the_others_do():
    later = night(81, effect=backlash(8.0))
    later.columns['approach_az'] = np.where(np.arange(60) % 6, later['approach_az'], np.nan)
    result = diagnose(night(80, effect=backlash(8.0)), holdout=later, **FAST)
    one, = result.held_out
    assert one['rows'] == 50 and one['bad'] is None and not result.cautions
    assert result.after['holdout_rms_arcsec'] < 1.8 < result.before['holdout_rms_arcsec']
    assert any('held out, but no test' in wording(note) and note.size == 10 for note in result.notes
               if not isinstance(note, str))


def test_a_drift_of_one_night_is_not_judged_by_another():
    def drift(rate):
        return lambda c: (0.0, rate * ARCSEC * (c['time'] - c['time'][0]) / 3600.0)
    later = night(95, effect=drift(-5.0))
    later.columns['time'] += 86400.0
    result = diagnose(night(94, effect=drift(5.0)), holdout=later, **FAST)
    assert [e.fitted.effect.driver for e in result.effects] == ['time']
    assert 'outside the fitted times' in wording(result.cautions[0])
    assert 'bad' not in paragraph(result.cautions) and result.held_out == []


def test_two_clocks_are_not_joined():
    other = night(83)
    other.meta = {**other.meta, 'time_is_utc': False}
    other.columns['time'] = other['time'] - 1.7e9
    result = diagnose([night(82), other], **FAST)
    assert result.verdict == 'none' and 'two clocks' in [n.kind for n in result.notes]


def test_several_runs_get_zeros_of_their_own():
    runs = []
    for i in range(4):
        shifted = {**TRUTH, 'IA': (20.0 + 300.0 * i) * ARCSEC}
        run = night(30 + i, n=30, effect=backlash(8.0), terms=shifted)
        run.columns['time'] += 86400.0 * i
        runs.append(run)
    result = diagnose(runs[:3], holdout=runs[3], **FAST)
    assert names(result) == ['azimuth_hysteresis_cosE']
    assert result.to_dict()['runs'] == 3
    zeros = [terms['IA'] for terms in result.run_terms.values()]
    assert np.diff(zeros) == pytest.approx([300.0, 300.0], abs=5.0)
    assert result.before['holdout_rms_arcsec'] > 2.0 > result.after['holdout_rms_arcsec']
    assert any('IA, IE refitted' in note for note in map(wording, result.notes))


def test_a_choice_that_does_not_hold_elsewhere_is_not_added(monkeypatch):
    run = night(62, n=40, effect=backlash(8.0))
    assert diagnose(run).cautions == []
    monkeypatch.setattr('calibration.analysis.diagnosis.validation.nested', lambda problem, *rest,
                        **more: (np.ones((3, 2, problem.n)) * np.array(
                            [5.0, 10.0, 30.0])[:, None, None] * ARCSEC, []))
    result = diagnose(run)
    assert not result.effects and not result.model.effects
    text = paragraph(result.cautions)
    assert 'session' not in text  # there is one night
    assert 'not added' in text and 'azimuth hysteresis, × cos E' in text
    assert result.verdict == 'undecided' and text in render(view_of(result))
    (note,) = (wording(n) for n in result.notes if n.kind == 'not repeated')
    assert 'azimuth hysteresis, × cos E' in note


def test_base_is_read_and_refused():
    assert Base.parse('physical').terms == PHYSICAL
    assert Base.parse('standard6+TX').terms == (*STANDARD6, 'TX')
    assert Base.parse('physical+sh4') == Base(PHYSICAL, 4) and Base.parse('sh13').degree == 4
    with pytest.raises(ValueError, match='unknown pointing term NONSENSE'):
        Base.parse('IA+NONSENSE')
    result = diagnose(night(16), 'physical+sh2', **FAST)
    assert result.base.names() == [*PHYSICAL, 'sh2'] and result.model.harmonics is not None
    assert np.allclose(result.model.residuals(night(16)), result.residual_after,
                       atol=0.02 * ARCSEC)


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match='do not determine'):
        diagnose(night(1, n=5))
    run = night(1)
    run.columns['az'] = run['az'] * np.nan
    with pytest.raises(ValueError, match='none of 60 observations'):
        diagnose(run)
    with pytest.raises(ValueError, match='alpha'):
        diagnose(night(1), alpha=1.0)
    with pytest.raises(ValueError, match='no pointing run'):
        observations([])


def test_an_axis_is_worse_only_beyond_the_scatter_of_its_rows():
    rng = np.random.default_rng(4)
    n, refused = 40, 0
    for _ in range(200):
        before = rng.normal(size=(2, n))
        # nothing is done to y but another fit of the terms
        after = before + 0.25 * rng.normal(size=(2, n)) * [[0.0], [1.0]]
        refused += 'y' in _surely(before**2, after**2)
    assert refused < 0.5 * 200
    worse = _surely(before**2, (1.4 * before)**2)
    assert worse == {'x', 'y'}
    figures = [{'radial': 5.0, 'x': 4.5, 'y': 1.0}], {'radial': 4.8, 'x': 4.1, 'y': 1.6}
    assert _worse('rows', *figures, set()) == {}
    assert _worse('rows', *figures, {'y'}) == {
        'before': 1.0, 'after': 1.6, 'evidence': {'what': 'rows', 'axis': 'elevation'}}
    # as a whole it is worse by any amount
    assert _worse('rows', [figures[1]], figures[0][0], set())


def test_an_axis_may_lose_a_little_of_what_the_other_one_gains():
    without, one = {'radial': 2.74, 'x': 1.06, 'y': 2.53}, {'radial': 1.43, 'x': 1.09, 'y': 0.94}
    assert _worse('rows', [without], one, {'x'}) == {}
    # an effect more, by which the axis loses alone, does not hide behind the one before
    two = {'radial': 1.47, 'x': 1.14, 'y': 0.93}
    assert _worse('rows', [without, one], two, {'x'}) == {
        'before': 1.06, 'after': 1.14, 'evidence': {'what': 'rows', 'axis': 'azimuth'}}


def test_equal_causes_share_the_folds_and_the_effect_is_added():
    night_of_two = night(3070, effect=lambda c: (0.0, 12.0 * ARCSEC * np.cos(2.0 * c['el'] + 2.0)))
    result = diagnose(night_of_two, flips=299, partitions=1, folds=10, sessions=0.0)
    (effect,) = result.effects
    spread = result.after['cv_spread']
    assert {'refraction', 'elevation_encoder_2'} <= {effect.fitted.effect.name,
                                                     *effect.alternatives}
    # the folds differ in the cause, not in the set
    assert spread['others'] and spread['same_choice'] < spread['same_set'] == spread['folds']
    assert result.cautions == [] and result.after['cv_rms_x_arcsec'] > 1.01 * (
        result.before['cv_rms_x_arcsec'])
    assert result.after['cv_rms_arcsec'] < 0.8 * result.before['cv_rms_arcsec']


def test_the_cross_validated_figure_is_a_mean_of_partitions():
    after = diagnose(night(1, n=30, effect=backlash(8.0)), flips=299, folds=2).after
    spread = after['cv_spread']
    assert spread['min_arcsec'] < after['cv_rms_arcsec'] < spread['max_arcsec']
    # two folds of each, and two stretches
    assert spread['folds'] == 2 * spread['partitions'] + 2
    (count,) = spread['chosen'].values()
    assert 0 < spread['same_choice'] <= count <= spread['folds'] - spread['no_choice']


@pytest.mark.parametrize('after, more', [
    ([1.00], False), ([1.98], True),  # of one partition: a gain of half, and of 1 %
    ([1.00, 1.01, 1.02], False), ([1.00, 1.30, 1.60], True),  # the mean is known to 0.6 and 14 %
    ([1.98, 2.02, 1.97], True)])  # it is, and whether the effects gain is not
def test_there_are_more_partitions_while_figure_or_gain_is_unsure(after, more):
    parts = [({'radial': 2.0}, np.full((1, 2, 9), (one * ARCSEC)**2 / 2.0)) for one in after]
    assert validation._unsure(parts, np.ones(9, bool)) == more


def test_same_seed_same_answer_with_any_number_of_processes(monkeypatch):
    monkeypatch.setattr(forks, 'WORTH', -1.0)
    run = night(1, n=30, effect=backlash(8.0))
    one, two = (diagnose(run, flips=299, folds=2, jobs=jobs).to_dict() for jobs in (1, 2))
    assert one['effects'] and one['after']['cv_rms_arcsec']
    assert one == two


def test_a_held_out_night_that_contradicts_is_not_called_bad():
    """The effect is in the fitted night alone; a noisy night is bad with and without it."""
    noise = {'noise': lambda rng, el: 4.0 * rng.normal(size=(2, len(el)))}
    for later, contradicts in ((night(91), True), (night(92, effect=backlash(8.0)), False),
                               (night(93, effect=backlash(8.0), **noise), None)):
        result = diagnose(night(90, effect=backlash(8.0)), holdout=later, **FAST)
        one, = result.held_out
        assert bool(one['bad']) == (contradicts is None)
        assert one['contradicts'] == bool(contradicts)
        said = paragraph(result.cautions)
        assert ('contradicts the effects: ' in said) == bool(contradicts)


def test_few_rows_without_an_effect_contradict_it():
    """Forty rows without an effect as large as their noise; with it hardly any would."""
    shape, rng = np.sqrt(2.0) * np.cos(np.arange(80.0)).reshape(2, 40), np.random.default_rng(1)
    noise = rng.normal(size=(100, 2, 40))
    assert sum(holdout._contradicts(one, one - 0.8 * shape) for one in noise) > 90
    assert not any(holdout._contradicts(one + 0.8 * shape, one) for one in noise)
