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

"""The search behind the diagnosis: its algebra, its chance level, no look at held-out rows."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import make_context, make_problem

from calibration.analysis.diagnosis.offered_effects import effect_bank
from calibration.analysis.diagnosis.validation import nested
from calibration.estimation.backward_elimination import eliminate
from calibration.estimation.candidate_scores import CandidateBank, CandidateGroup
from calibration.estimation.chance import Chance, ChanceTest, normal_score, pair_corrected
from calibration.estimation.correlated_noise import WhiteNoise
from calibration.estimation.equal_causes import overlap
from calibration.estimation.folds import (
    contiguous_folds,
    cross_validate,
    cross_validate_quickly,
    predicted,
    random_folds,
)
from calibration.estimation.group_columns import Basis, GroupColumns, orthonormal
from calibration.estimation.linear_model import weighted_fit
from calibration.estimation.reduced_squares import reduced_squares
from calibration.estimation.select import choose, search, second_look
from calibration.estimation.selection_problem import ModelChoice, SelectionProblem
from calibration.estimation.significance import significance
from msg_tools.units import ARCSEC
from pointing_model.effects import effect
from pointing_model.pointing_terms import stacked_design


def test_the_tail_of_a_bump_gains_nothing():
    """In single precision one over its length was infinite, and the group not a number."""
    length = np.array([[1e-40], [1.0]])
    left, dof = reduced_squares([np.array([2.0])], [
        (np.square(length)[..., None], (0.5 * length)[..., None].astype(np.float32))], length)
    assert left[0].ravel() == pytest.approx([2.0, 1.75]) and dof.tolist() == [0, 1]


def index(problem, name):
    return next(i for i, e in enumerate(problem.dictionary.effects) if e.name == name)


def play(size):
    return lambda c: np.array([size * ARCSEC * c.get('approach_az') * np.cos(c.el), 0.0 * c.el])


def test_columns_of_single_runs_are_the_dense_ones():
    rng = np.random.default_rng(1)
    own, common, run = rng.normal(size=(2, 80)), rng.normal(size=(3, 80)), np.arange(40) % 3
    columns = GroupColumns.of(np.tile(run, 2), own, common)
    root = rng.uniform(0.5, 2.0, 80)
    kept = columns.basis(WhiteNoise(root))
    basis, dense = np.vstack((np.asarray(kept.groups), kept.common)), np.asarray(columns)
    assert len(columns) == len(dense) == 9 and np.allclose(basis @ basis.T, np.eye(9), atol=1e-12)
    white = dense * root
    assert np.allclose((white @ basis.T) @ basis, white, atol=1e-10)
    values = rng.normal(size=(2, 80))
    assert np.allclose(kept.off(values), values - (values @ basis.T) @ basis, atol=1e-12)
    x, y = basis[:, :40], basis[:, 40:]
    assert np.allclose(kept.blocks_of_rows(),
                       [(a * b).sum(axis=0) for a, b in ((x, x), (y, y), (x, y))], atol=1e-12)
    assert np.allclose(Basis(kept.common[1:], kept.groups).blocks_of_rows(kept.common[:1]),
                       kept.blocks_of_rows(), atol=1e-12)
    left = columns.left_of(values[0], WhiteNoise(root))
    p = np.linalg.lstsq(white.T, values[0] * root, rcond=None)[0]
    assert np.allclose(left, values[0] - p @ dense, atol=1e-10)
    solver = columns.solver(WhiteNoise(root))
    found = solver(values[0])
    assert np.allclose(np.concatenate([part.ravel() for part in found]), p, atol=1e-9)
    inverse = np.linalg.inv(white @ white.T)[:3, :3]
    assert np.allclose(solver.inverse, inverse, rtol=1e-6)
    part = columns.rows(np.concatenate((np.flatnonzero(run < 2), 40 + np.flatnonzero(run < 2))))
    assert len(part.basis()) == len(kept) - 2 == 7
    # a column that runs fit for themselves has nothing left of its own
    again = columns.beside(own[0])
    assert len(again.basis(WhiteNoise(root))) == 9


def test_state_ignores_gross_outliers_and_fills_their_residual():
    problem = make_problem(2)
    clean = weighted_fit(problem.base, problem.b, final=True)
    b = problem.b.copy()
    b[7] += 900.0 * ARCSEC
    dirty = weighted_fit(problem.base, b, final=True)
    assert dirty.weights[7] == 0.0 and np.count_nonzero(dirty.weights == 0.0) == 1
    assert dirty.raw[7] / ARCSEC == pytest.approx(900.0 + clean.raw[7] / ARCSEC, abs=1.0)
    p, _ = problem.base.solver(WhiteNoise(np.ones(120)))(problem.b)
    exact, *_ = np.linalg.lstsq(problem.base.common.T, problem.b, rcond=None)
    assert np.allclose(p, exact, rtol=1e-8)


def test_one_effect_alone_gives_way_to_a_better_one():
    # the first was chosen at weights of the terms alone, which saw other outliers
    def wave(c):
        return np.array([0.0 * c.el, 6.0 * ARCSEC * np.cos(2.0 * c.az)])
    problem = make_problem(5, signal=wave).plain
    first = [CandidateGroup(index(problem, 'line_of_sight_2'))]
    choice = ModelChoice(first, problem.fit(first))
    second_look(problem, choice)
    assert [c.effect(problem).name for c in choice.chosen] == ['elevation_nod_2']


def test_leverage_correction_gives_the_noise_back():
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(30, 100)) * np.linspace(0.2, 3.0, 100)
    basis = orthonormal(rows)
    total, raw = np.zeros(2), np.zeros(2)
    for _ in range(400):
        e = rng.normal(size=100)
        r = e - (basis @ e) @ basis
        corrected = pair_corrected(Basis(basis), r)
        total += np.square(corrected).mean(axis=1) / 400.0
        raw += np.square(r.reshape(2, 50)).mean(axis=1) / 400.0
    assert total == pytest.approx([1.0, 1.0], abs=0.03) and raw.max() < 0.9


def test_scores_of_groups_of_any_size_are_alike():
    from scipy.special import fdtri, ndtri

    for dof, nu in ((1, 40), (2, 25), (6, 80)):
        for p in (0.05, 1e-3, 1e-5):
            z = normal_score(dof * fdtri(dof, nu, 1.0 - p), dof, nu)
            assert z == pytest.approx(-ndtri(p), abs=0.25)


def test_first_test_is_true_to_its_level():
    p = []
    for i in range(40):
        problem = make_problem(1000 + i, n=40)
        fit = problem.fit([])
        scores = problem.dictionary.score(fit)
        chance = Chance(40, 199, np.random.default_rng(i))
        p.append(chance.p(fit, scores, int(np.argmax(scores.delta_bic))))
    p = np.array(p)
    # 4 expected below 0.1; 12 would be 4 sigma
    assert np.sum(p <= 0.1) < 12 and np.median(p) > 0.3
    assert np.sum(p <= 0.5) >= 10  # nor does it never find anything


def test_noise_that_grows_toward_the_horizon_keeps_the_level():
    alarms = 0
    for i in range(30):
        problem = make_problem(3000 + i, n=40, noise=lambda rng, c: rng.normal(
            size=(2, 40)) / np.sin(c.el)**1.5)
        found = search(problem, 0.05, Chance(40, 399, np.random.default_rng(i)))
        alarms += bool(found.chosen)
    assert alarms <= 5  # 1.5 expected


def test_identification_at_lambda_nine():
    names = ('azimuth_encoder_2', 'elevation_hysteresis', 'second_flexure', 'azimuth_zero_step',
             'elevation_nod_3', 'magnitude_equation_az', 'elevation_zero_with_temperature')
    good = 0
    for i in range(14):
        problem = make_problem(4000 + i)
        g = index(problem, names[i % len(names)]) + (8 if 'step' in names[i % len(names)] else 0)
        columns = problem.dictionary.of(g)
        s = np.random.default_rng(i).normal(size=len(columns)) @ columns
        q = orthonormal(problem.base.common)
        problem.b = problem.b + s * 9.0 * ARCSEC / np.linalg.norm(s - (q @ s) @ q)
        chance = Chance(60, 499, np.random.default_rng(i))
        found = search(problem, 0.01, chance)
        line = problem.dictionary.line
        shown = set()
        for j, one in enumerate(found.chosen):
            s = significance(problem, found, j, chance, 0.01)
            shown |= {int(line[k]) for k in (one.group, *s.equals)}
        good += int(line[g]) in shown
    assert good >= 13


def test_p_counts_the_flips():
    problem = make_problem(5, signal=play(1.2))
    fit = problem.fit([])
    scores = problem.dictionary.score(fit)
    g = index(problem, 'azimuth_hysteresis_cosE')
    chance = Chance(60, 399, np.random.default_rng(0))
    test = ChanceTest(fit, scores, g)
    expected = (np.sum(test.flipped_max(chance.signs) >= test.z) + 1) / 400
    assert chance.p(fit, scores, g) == pytest.approx(expected)
    assert chance.p_of_all(fit, scores)[int(np.argmax(scores.delta_bic))] < 0.2
    # the mirrored residual has the same score: the sign of an effect is not the test's business
    problem.b = -problem.b
    assert ChanceTest(problem.fit([]), problem.dictionary.score(problem.fit([])),
                      g).z == pytest.approx(test.z)


def test_what_is_asked_of_some_of_many_groups_decides_as_all_of_them(monkeypatch):
    decided = {}
    for many in (10, 10**6):
        monkeypatch.setattr('calibration.estimation.chance._MANY', many)
        for seed in range(12):
            problem = make_problem(seed, signal=play(3.0 * (seed % 3 == 0)))
            fit = problem.plain.fit([])
            scores = problem.dictionary.score(fit)
            g = int(np.argmax(scores.delta_bic))
            p = Chance(60, 399, np.random.default_rng(seed)).p(fit, scores, g, 0.05)
            decided.setdefault(seed, []).append((p <= 0.05, p if p <= 0.05 else None))
    assert all(one == other for one, other in decided.values())
    assert {one[0] for one, _ in decided.values()} == {False, True}


def test_flips_that_reach_a_score_are_those_whose_largest_does():
    problem = make_problem(5, signal=play(1.2))
    fit = problem.fit([])
    test = ChanceTest(fit, problem.dictionary.score(fit),
                      index(problem, 'azimuth_hysteresis_cosE'))
    signs = Chance(60, 399, np.random.default_rng(0)).signs
    best = np.sort(test.flipped_max(signs))
    for place in (0, 40, 200, 390, 398):  # between two of them: no rounding decides
        test.z = float(best[place:place + 2].mean()) if place < 398 else best[-1] + 0.01
        reached, largest = test.flipped_beyond(signs)
        assert reached == 398 - place and largest == pytest.approx(best[-1], abs=1e-4)


def test_overlap_knows_aliases():
    problem = make_problem(6)
    fit = problem.fit([])
    scores = problem.dictionary.score(fit)
    flexure, encoder = (scores.basis(index(problem, n))
                        for n in ('second_flexure', 'elevation_encoder_1'))
    # cos E is TF already, so an encoder off its centre is a second flexure here
    assert overlap(flexure, encoder)[0] == pytest.approx(1.0, abs=1e-6)
    other = scores.basis(index(problem, 'azimuth_hysteresis'))
    assert overlap(flexure, other)[1] < 0.3
    assert scores.dof[index(problem, 'latitude')] == 0


def test_folds_cover_every_row_once():
    rng = np.random.default_rng(0)
    label = np.repeat(np.arange(6), 5)
    for folds in (random_folds(np.arange(30), 7, rng), contiguous_folds(-np.arange(30.0), 7),
                  random_folds(label, 3, rng)):
        assert np.array_equal(np.sort(np.concatenate(folds)), np.arange(30))
    assert all(len(np.unique(label[f])) == 2 for f in random_folds(label, 3, rng))
    assert contiguous_folds(-np.arange(30.0), 7)[0].min() == 25
    # rows of one group stay together
    for fold in random_folds(label, 3, rng):
        assert all(np.isin(np.flatnonzero(label == r), fold).all() for r in label[fold])


def test_held_out_rows_are_not_looked_at():
    problem = make_problem(7, signal=play(2.0))
    folds = random_folds(np.arange(60), 6, np.random.default_rng(1))
    left, choices = nested(problem, folds, 0.01, np.random.default_rng(2), flips=199)
    assert all(any(problem.dictionary.effects[c.group].form == 'hysteresis' for c in chosen)
               for chosen in choices)
    # if one row reads 40" more, its own residual is 40" more, to rounding
    row = int(folds[3][2])
    moved = replace(problem, b=problem.b.copy(), _memories={})
    moved.b[60 + row] += 40.0 * ARCSEC
    again, _ = nested(moved, folds, 0.01, np.random.default_rng(2), flips=199)
    assert len(again) == len(left) == 1 + max(map(len, choices))
    assert np.allclose(again[:, :, folds[3]] - left[:, :, folds[3]],
                       [[0.0] * 10, 40.0 * ARCSEC * (folds[3] == row)], atol=1e-9 * ARCSEC)
    # with none of the choices it is the plain cross-validation
    assert np.allclose(left[0], cross_validate(problem.plain, [], folds), atol=1e-12)
    assert np.mean(left[-1]**2) < 0.8 * np.mean(left[0]**2)


def test_cross_validation_tells_gain_from_decoration():
    problem = make_problem(8, signal=play(2.0))
    folds = random_folds(np.arange(60), 10, np.random.default_rng(1))
    good = CandidateGroup(index(problem, 'azimuth_hysteresis_cosE'))
    idle = CandidateGroup(index(problem, 'azimuth_encoder_5'))
    plain, better, more = (np.mean(cross_validate(problem, c, folds)**2)
                           for c in ([], [good], [good, idle]))
    assert better < 0.7 * plain and more > better
    # with the weights of all rows: as good as fitted anew
    quick, = cross_validate_quickly(problem, [good], problem.plain.fit([good], final=True).noise,
                                    [folds])
    assert np.mean(quick**2) == pytest.approx(better, rel=0.02)
    found = choose(problem, 0.01, Chance(60, 499, np.random.default_rng(3)), [folds])
    assert [c.effect(problem).form for c in found.chosen] == ['hysteresis']
    assert found.gains[0] > 0.3
    both = eliminate(problem, ModelChoice([good, idle], problem.fit([good, idle])), 1.0,
                     Chance(60, 99, np.random.default_rng(3)), [folds])
    assert both.chosen == [good] and idle in [*both.dropped, *both.dropped_by_cv]


def test_new_runs_refit_their_own_terms_only():
    rng = np.random.default_rng(9)
    context = make_context(rng, 90)
    run = np.repeat([0, 1, 2], 30)
    own = stacked_design(('IA', 'IE'), context.az, context.el)
    common = stacked_design(('CA', 'AN', 'AW', 'TF'), context.az, context.el)
    truth = np.array([30.0, -20.0, 10.0, 15.0]) * ARCSEC
    shift = np.array([[0.0, 400.0, -90.0][r] for r in run]) * ARCSEC
    b = truth @ common + np.concatenate((shift * np.cos(context.el), -shift)) \
        + 0.1 * ARCSEC * rng.normal(size=180)
    none = CandidateBank.empty(90)
    problem = SelectionProblem(GroupColumns.of(np.tile(run, 2), own, common), b, None, none, none)

    def left_of_one(problem):
        part = problem.rows(np.flatnonzero(run != 1))
        return predicted(problem, part, [], part.fit([], final=True).noise,
                         np.flatnonzero(run == 1))
    left = left_of_one(problem)
    assert np.sqrt(np.mean(left**2)) < 0.2 * ARCSEC
    # terms that all share are not refitted: a tilt of the new run only stays
    tilted = replace(problem, b=b + np.concatenate((run == 1, run == 1)) * 5.0 * ARCSEC
                     * stacked_design(('AN',), context.az, context.el)[0])
    left = left_of_one(tilted)
    assert np.sqrt(np.mean(left**2)) > 1.5 * ARCSEC


def test_curves_take_the_place_of_effects_that_only_imitate_them():
    def bump(c):
        return np.array([8.0 * ARCSEC * np.exp(-0.5 * ((c.az - 3.0) / 0.25)**2), 0.0 * c.az])
    problem = make_problem(12, n=80, signal=bump, curves=True)
    found = search(problem, 0.01, Chance(80, 999, np.random.default_rng(0)))
    assert any(c.curve for c in found.chosen)
    effects = [c.effect(problem) for c in found.chosen]
    assert {e.driver for e in effects} == {'azimuth'} and len(effects) <= 2


def test_effects_without_columns_of_their_own_cannot_win():
    problem = make_problem(11)
    context = make_context(np.random.default_rng(11))
    bank = effect_bank([effect('latitude'), effect('clock', latitude=0.6)], context)
    scores = bank.score(problem.fit([]))
    assert not scores.dof.any() and np.all(scores.delta_bic == -np.inf)
    problem.dictionary = bank
    assert search(problem, 0.5, Chance(60, 99, np.random.default_rng(0))).chosen == []


def test_rows_of_one_star_are_flipped_together():
    group = np.repeat(np.arange(30), 2)
    signs = Chance(60, 99, np.random.default_rng(1), group=group).signs
    assert np.array_equal(signs[:, ::2], signs[:, 1::2]) and abs(signs.mean()) < 0.1
    alone = Chance(60, 99, np.random.default_rng(1)).signs
    assert not np.array_equal(alone[:, ::2], alone[:, 1::2])

    def shared(rng, context):
        return rng.normal(size=(2, 30))[:, group]
    alarms = {True: 0, False: 0}
    for i in range(40):
        problem = make_problem(5000 + i, noise=shared)
        problem.dictionary = problem.dictionary.rows(group)  # each star twice
        problem.base = problem.base.rows(np.concatenate((group, group + 60)))
        for together in alarms:
            chance = Chance(60, 199, np.random.default_rng(i), group=group if together else None)
            fit = problem.plain.fit([])
            scores = problem.dictionary.score(fit)
            g = int(np.argmax(scores.delta_bic))
            alarms[together] += chance.p(fit, scores, g) <= 0.05
    assert alarms[True] <= 7 < 15 <= alarms[False]  # 2 expected


@pytest.mark.parametrize('size, offered', [(0.27, True), (4.0, False)])
def test_a_cause_of_known_size_is_offered_where_the_rows_ask_for_that_size(size, offered):
    # the diurnal aberration is 0.32" cos(latitude), whatever else looks the same
    east = effect('diurnal_aberration', latitude=0.57)
    context = make_context(np.random.default_rng(5), 200)
    noise = 0.2 * ARCSEC * np.random.default_rng(3).normal(size=400)
    b = size * ARCSEC * east.columns(context)[0].ravel() + noise
    base = GroupColumns.alone(stacked_design(('IA', 'IE'), context.az, context.el))
    free = replace(east, size=None)
    none = CandidateBank.empty(200)
    fit = SelectionProblem(base, b, None, none, none).fit([])
    gains = [effect_bank([e], context, sizes=sizes).score(fit).delta_bic[0]
             for e, sizes in ((free, True), (east, False), (east, True))]
    assert gains[0] == gains[1] > 20.0
    assert np.isfinite(gains[2]) == offered
