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

"""A zero that wanders: whitened, estimated, told, and mistaken for no effect of the mount."""

import json
from dataclasses import replace

import numpy as np
import pytest
from simulated import FAST, make_context, make_problem, names, night, oval_disc

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.observations import sequence_of, star_groups
from calibration.analysis.diagnosis.residual_correlation import (
    PairDifferences,
    beyond_terms,
    slow_noise,
    trend,
)
from calibration.analysis.diagnosis.residual_patterns import ResidualRows
from calibration.analysis.diagnosis.row_counts import repeats
from calibration.analysis.term_fit import fit_terms
from calibration.estimation.correlated_noise import (
    AxisNoise,
    CorrelatedNoise,
    Sequence,
    WhiteNoise,
)
from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.linear_model import weighted_fit
from calibration.estimation.memory_likelihood import noise_memory
from calibration.report.noise_wording import (
    correlation_sentence,
    difference_sentence,
    direction_sentence,
)
from calibration.report.verdict_wording import verdict_sentences
from calibration.report.wording import paragraph, wording
from msg_tools.units import ARCSEC
from pointing_model.context import Context
from pointing_model.mounts import ALTAZ
from pointing_model.runs.run import PointingRun

# --- its algebra ----------------------------------------------------------------------------------


def wandering_noise(sequence, variance, memory, rng):
    gap = np.abs(sequence.position[:, None] - sequence.position)
    root = np.linalg.cholesky(np.exp(-gap / memory) + 1e-9 * np.eye(len(gap)))
    return np.sqrt(variance) * root @ rng.normal(size=len(gap))


def test_rows_that_wander_are_whitened_exactly():
    rng = np.random.default_rng(21)
    context = make_context(rng, 40)
    run = np.repeat([0, 1], 20)
    sequence = sequence_of(context, run)
    root = rng.uniform(0.5, 2.0, 80)
    root[5] = root[45] = 0.0
    wander = AxisNoise(2.0, 900.0, True), AxisNoise(0.5, 300.0)
    white = CorrelatedNoise(root, sequence, wander)
    gap = np.where(run[:, None] == run, np.abs(
        context.get('time')[:, None] - context.get('time')), np.inf)
    values, log_det = rng.normal(size=(3, 80)), 0.0
    squares, spread = np.zeros(3), np.zeros(3)
    for part, one, factor in ((slice(0, 40), wander[0], np.cos(context.el)),
                              (slice(40, 80), wander[1], np.ones(40))):
        keep = root[part] > 0.0
        v = np.diag(1.0 / np.square(root[part][keep])) + (
            one.variance * np.outer(factor, factor) * np.exp(-gap / one.memory))[keep][:, keep]
        here = values[:, part][:, keep]
        squares += np.einsum('ki,ij,kj->k', here, np.linalg.inv(v), here)
        spread += np.einsum('ki,ij,kj->k', here, v, here)
        log_det += np.linalg.slogdet(v)[1]
    assert np.allclose(np.square(white.whiten(values)).sum(axis=1), squares)
    assert np.allclose(np.square(white.spread(values)).sum(axis=1), spread)
    assert white.log_det == pytest.approx(log_det)
    kept = values * (root > 0.0)
    assert np.allclose(white.whiten(white.coloured(kept)), kept)
    assert np.allclose(white.whiten(values)[:, [5, 45]], 0.0)


def test_a_wander_is_estimated_and_white_noise_is_left_white():
    found, white = [], []
    for seed in range(10):
        problem = make_problem(400 + seed, 120)
        sequence = problem.sequence
        rng = np.random.default_rng(seed)
        state = problem.plain.fit([])
        rows = problem.base
        white.append(max(w.gain for w in noise_memory(
            sequence, state.noise.root, state.scale, rows, problem.b)))
        b = problem.b.copy()
        b[120:] += wandering_noise(sequence, 4.0 * ARCSEC**2, 1800.0, rng)
        state = weighted_fit(problem.base, b)
        found.append(noise_memory(sequence, state.noise.root, state.scale, rows, b)[1])
    # how far it moves in ten minutes; size and memory alone are hard to tell apart
    moves = [np.sqrt(2.0 * w.variance * -np.expm1(-600.0 / w.memory)) / ARCSEC for w in found]
    assert np.median(moves) == pytest.approx(
        np.sqrt(8.0 * -np.expm1(-600.0 / 1800.0)), rel=0.2)
    assert np.median([w.scale / ARCSEC for w in found]) == pytest.approx(1.0, rel=0.15)
    assert min(w.gain for w in found) > 10.0 and np.median(white) < 3.0


def test_what_a_wander_did_in_the_rows_is_told_from_their_noise():
    problem, rng = make_problem(31, 80), np.random.default_rng(31)
    walk = wandering_noise(problem.sequence, (5.0 * ARCSEC)**2, 3600.0, rng)
    true = np.array([np.zeros(80), walk])
    noise = ARCSEC * rng.normal(size=160)
    problem = replace(problem, b=true.ravel() + noise)
    one = AxisNoise((5.0 * ARCSEC)**2, 3600.0, False, problem.plain.fit([]).scale[1] * 0.2)
    found = slow_noise(problem, [], {'el': one})
    assert not found[0].any()
    left = problem.base.left_of(true.ravel(), WhiteNoise(np.ones(160))).reshape(2, -1)
    assert np.sqrt(np.mean(np.square(found[1] - left[1]))) < ARCSEC
    assert beyond_terms(problem, found) == pytest.approx(beyond_terms(problem, true), rel=0.15)


def test_an_even_drift_has_a_rate_and_a_share():
    problem = make_problem(32, 60)
    hours = problem.sequence.position / 3600.0
    rng = np.random.default_rng(32)
    drift = np.concatenate((np.zeros(60), -40.0 * ARCSEC * hours))
    problem = replace(problem, b=drift + ARCSEC * rng.normal(size=120))
    told = trend(problem, [], 'el', AxisNoise())
    assert told['rate_arcsec_per_hour'] == pytest.approx(-40.0, abs=1.5) and told['share'] > 0.9
    assert told['removes_rms_arcsec'] == pytest.approx(beyond_terms(
        problem, drift.reshape(2, -1)), rel=0.05)
    assert trend(problem, [], 'az', AxisNoise())['share'] < 0.2
    # a model with that drift leaves none, however rounding falls
    even = np.concatenate((np.zeros(60), hours - hours.mean()))
    drifts = GroupColumns.alone(np.vstack((problem.base.common, even)))
    assert trend(replace(problem, base=drifts), [], 'el', AxisNoise()) is None


# --- what the diagnosis says of it ---------------------------------------------------------------


def nights_that_wander(seed, n=18, size=0.0):
    """Four nights whose elevation zero walks at random; beside that, a backlash."""
    rng = np.random.default_rng(seed)
    return [night(40 + 10 * seed + i, n=n, effect=lambda c: (
        0.5 * size * ARCSEC * c['approach_az'], np.cumsum(rng.normal(size=n)) * ARCSEC))
        for i in range(4)]


def test_what_the_rows_of_a_night_share_is_no_effect_of_the_mount():
    result = diagnose(nights_that_wander(3), **FAST)
    assert result.verdict == 'wanders' and not result.effects
    assert result.noise_memory['slow'] and set(result.noise_memory['axes']) >= {'el'}
    _, sentences = verdict_sentences(result.to_dict(), caution=paragraph(result.cautions))
    assert not any('looks like noise' in s for s in sentences)
    # what the mount has on all nights stays
    result = diagnose(nights_that_wander(3, size=8.0))
    assert any('azimuth_hysteresis' in name for name in names(result))
    assert result.after['cv_rms_arcsec'] < 0.8 * result.before['cv_rms_arcsec']


def correlated(rho):
    """Noise whose rows share `rho` with the row before."""
    def noise(rng, el):
        e = rng.normal(size=(2, len(el)))
        for i in range(1, len(el)):
            e[:, i] = rho * e[:, i - 1] + np.sqrt(1.0 - rho**2) * e[:, i]
        return e
    return noise


def test_a_zero_that_wanders_is_no_effect_and_is_told():
    found = [diagnose(night(300 + i, noise=correlated(0.9)), **FAST) for i in range(3)]
    # if rows are taken to have no memory, most of these have effects
    assert sum(bool(r.effects) for r in found) <= 1
    assert sum(r.verdict == 'wanders' for r in found) >= 2
    told = next(r for r in found if r.noise_memory and set(r.noise_memory['axes']) == {'az', 'el'})
    for axis in told.noise_memory['axes'].values():
        assert axis['sigma_arcsec'] > 0.3 and 0.0 < axis['moves_arcsec'] < 5.0
        assert axis['unit'] == 'hours' and 0.05 < axis['memory'] < 10.0
    assert 0.5 < told.noise_memory['removes_rms_arcsec'] < 2.0
    assert 'the zero drifts' in correlation_sentence(told.noise_memory, ALTAZ.names.axes)
    headline, sentences = verdict_sentences(told.to_dict())
    assert headline.startswith('The zero drifts') and 'Its cause is unknown' in sentences[0]
    document = json.loads(json.dumps(told.to_dict()))
    assert document['wander']['p'] <= 0.01


def test_an_effect_not_of_time_is_found_beside_a_wander():
    for seed in range(2):
        result = diagnose(night(310 + seed, effect=oval_disc, noise=correlated(0.6)), **FAST)
        assert 'azimuth_encoder_2' in names(result)


def test_what_repeats_each_other_counts_as_fewer():
    false, told = 0, 0
    for seed in range(4):
        once = night(330 + seed, n=30)
        two = np.repeat(np.arange(30), 2)
        run = PointingRun({k: v[two].copy() for k, v in once.columns.items()}, once.meta)
        run.columns['time'] += np.tile([0.0, 8.0], 30)
        e = 0.3 * ARCSEC * np.random.default_rng(seed).normal(size=(2, 60))
        run.columns['az_enc'] += e[0] / np.cos(run['el'])
        run.columns['el_enc'] += e[1]
        result = diagnose(run, **FAST)
        false += bool(result.effects)
        told += bool(result.noise_memory) and not result.noise_memory['slow']
    assert false <= 1 and told >= 2


def test_a_small_drift_is_not_told_from_a_wander():
    verdicts = [diagnose(night(350 + i, effect=lambda c: (
        0.0, 3.0 * ARCSEC * (c['time'] - 1.7e9) / 3600.0)), **FAST) for i in range(2)]
    assert all(r.verdict != 'none' for r in verdicts)
    wandering = [r for r in verdicts if r.verdict == 'wanders']
    assert wandering and all(
        any('with_time' in n or 'step' in n or 'temperature' in n for n in r.noise_memory['like'])
        for r in wandering)


def walk(rng, el):
    """Zeros that walk far, of rows that are good."""
    return 0.1 * rng.normal(size=(2, len(el))) + 0.8 * np.cumsum(
        rng.normal(size=(2, len(el))), axis=1)


def cot(c):
    return 0.0, 8.0 * ARCSEC / np.tan(c['el'])


def test_members_of_a_set_are_no_farther_apart_than_the_rows_say():
    # against the noise from row to row alone two of refraction were 606 and 127 apart
    for seed in (400, 406):
        result = diagnose(night(seed, n=40, effect=cot, noise=walk), **FAST)
        first, last = result.next_observations[0], result.next_observations[-1]
        assert first['separates'][0] == 'refraction'
        assert first['separation_before'] <= 6.0
        assert last['separation_after'] > first['separation_after']


def test_what_wanders_on_one_axis_is_no_cause_of_what_the_other_has():
    result = diagnose(night(404, n=40, effect=cot, noise=walk), **FAST)
    assert names(result) == ['refraction']  # beside an azimuth zero that walks
    assert not any(name.startswith('azimuth') for name in result.effects[0].alternatives)


def along_the_sky(seed=3):
    """Rows in the order of azimuth, with a wander far larger than their noise."""
    run = night(seed, n=60)
    rng, order = np.random.default_rng(seed), np.argsort(run['az'])
    columns = {k: v[order] for k, v in run.columns.items() if not k.startswith('approach')}
    columns['time'] = np.sort(run['time'])
    gap = np.diff(columns['time'], prepend=columns['time'][0])
    z = np.empty((2, 60))
    z[:, 0] = rng.normal(size=2)
    for i in range(1, 60):
        phi = np.exp(-gap[i] / 3600.0)
        z[:, i] = phi * z[:, i - 1] + np.sqrt(1.0 - phi**2) * rng.normal(size=2)
    columns['az_enc'] = columns['az_enc'] + 60.0 * ARCSEC * z[0] / np.cos(columns['el'])
    columns['el_enc'] = columns['el_enc'] + 60.0 * ARCSEC * z[1]
    return PointingRun(columns, run.meta)


def test_a_wander_along_the_sky_moves_no_term_and_is_told_as_that():
    run = along_the_sky()
    result, plain = diagnose(run, **FAST), fit_terms(run)
    entry = result.noise_memory
    assert result.verdict == 'wanders' and entry['along_the_sky']['step_deg'] < 20.0
    # what a fit leaves is what is left; the errors are those of such a night
    assert result.before == result.after
    assert result.before['rms_arcsec'] == pytest.approx(plain.rms_arcsec().radial, rel=0.05)
    assert np.sqrt(result.model.covariance[1, 1]) > 2.0 * plain.sigma[1]
    for axis in entry['axes'].values():
        assert axis['apart'] <= 0.5 * axis['span']
        assert axis['row_to_row_arcsec'] < axis['moves_arcsec']
        assert axis['moves_arcsec'] == pytest.approx(np.sqrt(
            axis['apart_arcsec']**2 - axis['next_arcsec']**2))
    headline, sentences = verdict_sentences(result.to_dict())
    assert 'neighbouring rows' in headline
    # what the rows do not tell apart is said first, then what can be seen in them
    assert sentences[0].startswith('Correlated noise: the zero drifts, or the model lacks an')
    assert 'about ten minutes apart by' in sentences[0]
    assert 'smooth of' not in sentences[0] and 'mixes the sky' in sentences[0]
    # a night that goes back and forth says nothing of the kind, and its terms rest on the wander
    other = diagnose(night(301, noise=correlated(0.9)), **FAST)
    assert other.noise_memory['along_the_sky'] is None


def seen(residual, az, el, live=None, apart=10.0):
    """`PairDifferences` of rows in their order, elevations and azimuths in degrees."""
    n = len(az)
    context = Context(np.radians(az), np.radians(el), {})
    sequence = Sequence(np.arange(float(n)), np.zeros(n, int), context.trig.cos_el, False)
    return PairDifferences(context, sequence, ARCSEC * residual,
                           np.ones(n, bool) if live is None else live, apart)


def test_how_rows_differ_is_measured_in_what_is_left_of_them():
    rng = np.random.default_rng(8)
    az, el = rng.uniform(0.0, 360.0, 60), rng.uniform(20.0, 80.0, 60)
    left = rng.normal(size=(2, 60))
    live = np.arange(60) != 7
    told = seen(left, az, el, live).to_dict(1)
    y = left[1][live]
    assert told['next_arcsec'] == pytest.approx(np.sqrt(np.mean(np.diff(y)**2)))
    row = np.arange(60)[live]
    far = [(y[i] - y[j])**2 for i in range(59) for j in range(i) if 5 <= row[i] - row[j] <= 15]
    assert told['apart_arcsec'] == pytest.approx(np.sqrt(np.mean(far)))
    # noise alone: nothing is said to move that cannot be seen
    assert told['moves_arcsec'] < told['next_arcsec']
    told |= {'apart': 10.0, 'unit': 'rows'}
    none = {key: {**told, 'moves_arcsec': 0.0} for key in ('az', 'el')}
    assert 'only consecutive rows' in difference_sentence({'axes': none}, ALTAZ.names.axes)
    assert difference_sentence({'axes': {'az': {**told, 'moves_arcsec': None}}},
                               ALTAZ.names.axes) == ''


def test_an_error_of_the_direction_comes_again_where_the_order_does():
    rng = np.random.default_rng(9)
    az = np.concatenate([np.arange(0.0, 300.0, 6.0), np.arange(2.0, 302.0, 6.0)])
    el = np.full(100, 45.0)
    place, walk = 3.0 * np.sin(np.radians(3.0 * az)), np.cumsum(rng.normal(size=100))
    of_place = seen(np.array([place, walk]) + 0.3 * rng.normal(size=(2, 100)), az, el)
    same, moved = (of_place.to_dict(axis) for axis in (0, 1))
    assert of_place.pairs() >= 50
    assert same['near_apart_arcsec'] < 1.3 * same['near_next_arcsec'] < 0.5 * same['apart_arcsec']
    assert moved['near_apart_arcsec'] > 2.0 * moved['near_next_arcsec']
    same |= {'apart': 10.0, 'unit': 'rows'}
    entry = {'axes': {'az': same, 'el': moved}, 'pairs': of_place.pairs(),
             'within_deg': of_place.within}
    assert f'({of_place.pairs()} pairs)' in direction_sentence(entry, ALTAZ.names.axes)
    assert direction_sentence({**entry, 'axes': {'az': same}, 'pairs': 3}, ALTAZ.names.axes) == ''


def test_a_star_that_stands_twice_is_told():
    context = Context(np.radians([10.0, 80.0, 80.01, 200.0]), np.radians([40.0] * 4), {})
    group = star_groups(context, np.arange(4.0), np.zeros(4, int), False)
    assert group.tolist() == [0, 1, 1, 3]
    left = ARCSEC * np.array([[0.0, 1.0, 1.3, 0.0], [0.0, 2.0, 2.4, 0.0]])

    def rows(group):
        sequence = Sequence(np.arange(4.0), np.zeros(4, int), np.ones(4), group=group)
        return ResidualRows(context, sequence, [11, 12, 13, 14], left, 'line')
    (found,) = repeats(rows(group))
    text = wording(found)
    assert text.startswith('lines 12 and 13 are repeated') and 'differ by 0.50″' in text
    assert repeats(rows(np.arange(4))) == []


def test_errors_of_terms_beside_a_wander_are_those_of_all_noise():
    rng = np.random.default_rng(4)
    sequence = Sequence(np.sort(rng.uniform(0.0, 9000.0, 12)), np.zeros(12, int), np.ones(12))
    wander = AxisNoise(4.0, 2000.0), AxisNoise(9.0, 900.0)
    noise = CorrelatedNoise(np.ones(24), sequence, wander)
    columns = GroupColumns.alone(rng.normal(size=(3, 24)))
    dense = np.eye(24)
    for k, one in enumerate(wander):
        part = slice(12 * k, 12 * k + 12)
        dense[part, part] += one.variance * np.exp(
            -np.abs(np.subtract.outer(sequence.position, sequence.position)) / one.memory)
    gain = np.linalg.pinv(columns.common.T)
    np.testing.assert_allclose(columns.solver(WhiteNoise(np.ones(24))).inverse_under(noise),
                               gain @ dense @ gain.T, rtol=1e-9)


def test_zeros_are_where_the_rows_were_whatever_their_memory():
    rng = np.random.default_rng(5)
    sequence = Sequence(60.0 * np.arange(30.0), np.zeros(30, int), np.ones(30))
    noise = CorrelatedNoise(np.full(60, 10.0), sequence, 2 * (AxisNoise(25.0, 1e5),))
    zero = np.repeat(np.eye(2), 30, axis=1)
    columns = GroupColumns.alone(np.vstack((zero, rng.normal(size=(2, 60)))), zeros=[0, 1])
    b = noise.coloured(rng.normal(size=60))
    left = b - columns.solver(noise)(b)[0] @ columns.common
    np.testing.assert_allclose(left.reshape(2, 30).mean(axis=1), 0.0, atol=1e-12)


def test_progress_counts_the_folds():
    told = []
    diagnose(night(11, n=30, effect=oval_disc), flips=199, partitions=2, folds=4,
             progress=lambda *what: told.append(what))
    assert told[0][1:] == (0, None)
    counts = [(done, total) for _, done, total in told[1:]]
    assert counts == [(k, 12) for k in range(1, 13)]


def test_what_explains_rows_as_well_as_a_drift_is_told_with_it():
    def of(seed, moves):
        return diagnose(night(seed, effect=lambda c: (0.0, ARCSEC * moves(len(c['el'])))), **FAST)
    jumps = [of(700 + i, lambda n, i=i: 2.0 * (np.arange(n) >= 20 + 5 * i)) for i in range(4)]
    shown = [{e.fitted.effect.name for e in r.effects} | {
        name for e in r.effects for name in e.alternatives} | set((r.noise_memory or {}).get(
            'like', ())) for r in jumps]
    assert any(r.verdict == 'wanders' for r in jumps)
    assert all('elevation_zero_step' in names for names in shown)
    # a zero that goes far again and again has not jumped once
    rng = np.random.default_rng(5)

    def wandering(n):
        e = 3.0 * rng.normal(size=n)
        for i in range(1, n):
            e[i] = 0.9 * e[i - 1] + 0.44 * e[i]
        return e
    drifts = [of(720 + i, wandering) for i in range(4)]
    assert all(r.verdict == 'wanders' for r in drifts)
    assert sum('elevation_zero_step' in r.noise_memory['like'] for r in drifts) <= 1
