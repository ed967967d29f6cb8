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

import numpy as np
import pytest
from noisy_run import MODEL, TRUTH, make_run

from calibration.analysis.term_fit import fit_first_order, fit_harmonics, fit_terms
from calibration.report.wording import wording
from msg_tools.units import ARCSEC
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import Harmonics
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL, design
from pointing_model.rms import rms_arcsec
from pointing_model.runs.run import PointingRun
from pointing_model.zero import PowerOnZero


@pytest.mark.parametrize('robust', [True, False])
def test_exact_data_give_the_exact_mount(robust):
    fit = fit_terms(make_run(np.random.default_rng(0), noise=(0, 0), high=89), robust=robust)
    np.testing.assert_allclose(fit.coefficients, TRUTH, atol=1e-7 * ARCSEC)
    assert fit.rms_arcsec().radial < 1e-8
    # the first-order formula cannot
    assert fit_terms(make_run(np.random.default_rng(0), noise=(0, 0), high=89), robust=robust,
                     geometry='first_order').rms_arcsec().radial > 0.05


def test_rotation_fit_is_the_least_squares_minimum():
    rng = np.random.default_rng(1)
    run = make_run(rng)
    fit = fit_terms(run, robust=False)
    base = sum(np.sum(r**2) for r in fit.model.residuals(run))
    for name in PHYSICAL:
        for sign in (1, -1):
            moved = dict(fit.model.terms)
            moved[name] += sign * 0.02 * ARCSEC
            x, y = PointingModel(moved).residuals(run)
            assert np.sum(x**2) + np.sum(y**2) > base
    x, y = fit.model.residuals(run)
    np.testing.assert_allclose((fit.residual_x, fit.residual_y), (x, y), atol=1e-8 * ARCSEC)


@pytest.mark.parametrize('n, low, high', [(30, 20, 85), (100_000, 20, 85), (300, 50, 50.1)])
def test_first_order_against_lstsq(n, low, high):
    """Also where the design is so flat (condition over 1e5) that normal equations fail."""
    rng = np.random.default_rng(2)
    run = make_run(rng, n, low=low, high=high)
    x, y = run.offsets()
    a = np.vstack(design(PHYSICAL, run['az'], run['el']))
    fit = fit_first_order(run['az'], run['el'], x, y, rcond=1e-12)
    expected = np.linalg.lstsq(a, np.concatenate((x, y)), rcond=None)[0]
    scale = np.abs(expected).max()
    condition = np.linalg.cond(a)
    np.testing.assert_allclose(fit.coefficients, expected, atol=1e-15 * condition * scale)
    assert fit.rank == 7
    assert (condition > 1e5) == (low == 50)


def test_first_order_weights_and_covariance():
    rng = np.random.default_rng(3)
    run = make_run(rng, 50)
    x, y = run.offsets()
    sx, sy = rng.uniform(0.5, 3, (2, 50)) * ARCSEC
    fit = fit_first_order(run['az'], run['el'], x, y, PHYSICAL, sx, sy)
    a = np.vstack(design(PHYSICAL, run['az'], run['el']))
    s = np.concatenate((sx, sy))
    expected = np.linalg.lstsq(a / s[:, None], np.concatenate((x, y)) / s, rcond=None)[0]
    np.testing.assert_allclose(fit.coefficients, expected, rtol=1e-10)
    normal = (a / s[:, None]).T @ (a / s[:, None])
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(normal), rtol=1e-7)
    with pytest.raises(ValueError, match='one axis'):
        fit_first_order(run['az'], run['el'], x, y, PHYSICAL, sx)


def test_fit_terms_and_fit_first_order_agree():
    run = make_run(np.random.default_rng(4), noise=(0.6, 1.5))
    full = fit_terms(run, geometry='first_order', robust=False)
    bare = fit_first_order(run['az'], run['el'], *run.offsets())
    np.testing.assert_allclose(full.coefficients, bare.coefficients, atol=1e-10 * ARCSEC)
    np.testing.assert_allclose(full.covariance, bare.covariance, rtol=1e-8)


@pytest.mark.parametrize('noise, outliers, given', [
    ((1, 1), 0, False), ((0.6, 1.8), 0, False), ((1, 1), 6, False), ((1, 1), 0, True)])
def test_errors_are_what_the_covariance_says(noise, outliers, given):
    z, origins = [], []
    for seed in range(150):
        rng = np.random.default_rng([5, seed])
        columns = {}
        if given:
            sigma = rng.uniform(0.3, 3, (2, 60))
            columns = dict(zip(('sigma_x', 'sigma_y'), sigma * ARCSEC))
        run = make_run(rng, 60, sigma if given else noise, **columns)
        run['el_enc'][:outliers] += 30 * ARCSEC
        fit = fit_terms(run)
        origins.append(fit.covariance_from)
        z.append((fit.coefficients - TRUTH) / fit.sigma)
        # and in a correlated combination
        direction = np.array([1.0, 0, 1, 1, 0, 0, 0])
        z[-1] = np.append(z[-1], direction @ (fit.coefficients - TRUTH)
                          / np.sqrt(direction @ fit.covariance @ direction))
    # right sigmas are hardly ever multiplied
    assert origins.count('given sigmas' if given else 'measured scatter') > 0.98 * len(origins)
    spread = np.sqrt(np.mean(np.square(z), axis=0))
    assert np.all((spread > 0.8) & (spread < 1.22)), spread
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.08)


def test_robust_costs_little_without_outliers_and_saves_much_with():
    grid = make_run(np.random.default_rng(0), 1500, (0, 0))

    def held_out(robust, outliers):
        squares = []
        for seed in range(60):
            rng = np.random.default_rng([6, seed])
            run = make_run(rng)
            run['az_enc'][:outliers] += 20 * ARCSEC / np.cos(run['el'][:outliers])
            x, y = fit_terms(run, robust=robust).model.residuals(grid)
            squares.append(np.mean(x**2 + y**2) / ARCSEC**2)
        return np.sqrt(2.0 + np.mean(squares))

    plain, robust = held_out(False, 0), held_out(True, 0)
    assert robust < 1.005 * plain
    assert held_out(True, 2) < 1.02 * plain
    assert held_out(False, 2) > 1.3 * plain


@pytest.mark.parametrize('size', [1 / 60, 10.0])
def test_wrong_stars_are_rejected(size):
    """Six of thirty stars wrong by an arcminute, or by ten degrees."""
    rng = np.random.default_rng(7)
    run = make_run(rng)
    run['az_enc'][:6] += np.radians(rng.uniform(0.5, 1, 6) * size)
    run['el_enc'][:6] -= np.radians(size)
    fit = fit_terms(run)
    assert set(fit.rejected) >= set(range(6)) and len(fit.rejected) < 9
    assert fit.rms_arcsec(rejected=False).radial < 1.7
    assert fit.rms_arcsec().radial > 10
    assert np.all(np.abs(fit.coefficients - TRUTH) < 5 * fit.sigma)


def test_given_sigmas_weigh():
    rng = np.random.default_rng(8)
    sigma = np.where(np.arange(60) < 30, 0.2, 20.0)
    run = make_run(rng, 60, (sigma, sigma), sigma_x=sigma * ARCSEC, sigma_y=sigma * ARCSEC)
    good = fit_terms(run.select(slice(0, 30)))
    both = fit_terms(run)
    np.testing.assert_allclose(both.sigma, good.sigma, rtol=0.15)
    assert np.all(np.abs(both.coefficients - TRUTH) < 4 * both.sigma)


def given_run(rng, n, sigmas):
    columns = {f'sigma_{axis}': np.full(n, sigma * ARCSEC) for axis, sigma in zip('xy', sigmas)}
    return make_run(rng, n, (1, 1), **columns)


@pytest.mark.parametrize('n', [12, 50])
@pytest.mark.parametrize('given, wrong', [
    ((0.2, 0.2), ('azimuth', 'elevation')), ((1, 0.2), ('elevation',)), ((0.1, 1), ('azimuth',))])
def test_sigmas_that_are_too_small_are_multiplied(n, given, wrong):
    beyond = []
    for seed in range(60):
        run = given_run(np.random.default_rng([21, seed]), n, given)
        fit = fit_terms(run)
        (found,) = [one for one in fit.findings(run) if 'sigmas' in one.kind]
        assert found.kind == 'sigmas multiplied' and fit.covariance_from == 'multiplied sigmas'
        if n == 50:
            assert set(found['ratios']) >= set(wrong)
            for axis, sigma in zip(('azimuth', 'elevation'), given):
                assert found['ratios'].get(axis, 1.0) == pytest.approx(1.0 / sigma, rel=0.5)
        beyond.append(np.abs(fit.coefficients - TRUTH) > fit.within95)
    assert 0.02 < np.mean(beyond) < 0.08
    assert 'times the given sigmas in' in wording(found)


def test_sigmas_that_are_too_large_stay_and_are_said():
    run = given_run(np.random.default_rng(22), 50, (5, 5))
    fit = fit_terms(run)
    (found,) = fit.findings(run)
    assert found.kind == 'sigmas too large' and set(found['ratios']) == {'azimuth', 'elevation'}
    assert all(0.15 < ratio < 0.27 for ratio in found['ratios'].values())
    right = given_run(np.random.default_rng(22), 50, (1, 1))
    known = fit_terms(right)
    assert not known.findings(right) and np.isinf(known.freedom).all()
    np.testing.assert_allclose(fit.sigma, 5.0 * known.sigma, rtol=0.02)


def test_outliers_multiply_no_sigma():
    run = given_run(np.random.default_rng(23), 60, (1, 1))
    run['el_enc'][:4] += 60 * ARCSEC
    assert fit_terms(run).ratios == (1.0, 1.0)


def test_harmonics_have_their_sigmas_multiplied_too():
    run = given_run(np.random.default_rng(24), 80, (0.25, 0.25))
    terms, plain = fit_terms(run), PointingRun(
        {name: of for name, of in run.columns.items() if 'sigma' not in name})
    found = fit_harmonics(run, after=terms, degree=2)
    alike = fit_harmonics(plain, after=fit_terms(plain), degree=2)
    assert all(3.0 < ratio < 5.5 for ratio in found.ratios)
    np.testing.assert_allclose(found.sigma, alike.sigma, rtol=0.1)


def test_rank_deficient_sky_is_reported():
    rng = np.random.default_rng(9)
    run = make_run(rng, 40, low=45, high=45.00001)
    fit = fit_terms(run)
    # at one elevation IA, CA and NPAE are one effect, and IE and TF another
    assert fit.rank == 4 and len(fit.dropped) == 3
    assert fit.condition > 1e5
    named = {name for d in fit.dropped for name in d['direction']}
    assert named == {'IA', 'CA', 'NPAE', 'IE', 'TF'}
    assert all(name in fit.dropped[0]['text'] for name in fit.dropped[0]['direction'])
    assert np.isfinite(fit.covariance).all() and np.abs(fit.coefficients).max() < 400 * ARCSEC
    assert fit.rms_arcsec().radial < 2
    full = fit_terms(make_run(rng, 40))
    assert full.rank == 7 and full.dropped == [] and full.condition < 1e3


def test_correlations():
    fit = fit_terms(make_run(np.random.default_rng(10), 60))
    c = fit.correlations
    np.testing.assert_allclose(np.diag(c), 1.0)
    i = {name: k for k, name in enumerate(fit.names)}
    assert c[i['IA'], i['CA']] < -0.8 and c[i['IE'], i['TF']] < -0.8
    assert abs(c[i['AN'], i['AW']]) < 0.4


def test_rows_that_are_not_finite_are_left_out_and_named():
    run = make_run(np.random.default_rng(11), sigma_x=np.full(30, ARCSEC),
                   sigma_y=np.full(30, ARCSEC))
    clean = fit_terms(run.select(np.arange(3, 30)))
    run['el_enc'][0] = np.nan
    run['az'][1] = np.inf
    run['sigma_x'][2] = 0.0
    fit = fit_terms(run)
    assert [e['row'] for e in fit.excluded] == [0, 1, 2]
    assert 'el_enc' in fit.excluded[0]['reason'] and 'az' in fit.excluded[1]['reason']
    assert 'sigma' in fit.excluded[2]['reason']
    np.testing.assert_allclose(fit.coefficients, clean.coefficients, atol=1e-12)
    assert np.isnan(fit.residual_x[:3]).all() and (fit.weights[:3] == 0).all()
    assert fit.rms_arcsec().n == 27 and not set(fit.rejected) & {0, 1, 2}
    assert fit.model.provenance['rows_excluded'] == 3


def test_star_in_the_hole_at_the_zenith_is_left_out():
    run = make_run(np.random.default_rng(12), 40, noise=(0.1, 0.1))
    # where the leaning axis points: collimation and skew leave a hole of 30" there
    run['el'][5] = np.pi / 2 - np.hypot(120, -130) * ARCSEC
    run['az'][5] = np.arctan2(130, 120)
    fit = fit_terms(run)
    assert [e['row'] for e in fit.excluded] == [5] and 'zenith' in fit.excluded[0]['reason']
    np.testing.assert_allclose(fit.coefficients, TRUTH, atol=1 * ARCSEC)


@pytest.mark.parametrize('n', [0, 3])
def test_too_few_rows(n):
    run = make_run(np.random.default_rng(13))
    with pytest.raises(ValueError, match=f'{n} usable observations'):
        fit_terms(run.select(slice(0, n)))
    run = run.select(slice(0, 8))
    run.columns['run'] = np.arange(8.0)
    with pytest.raises(ValueError, match='7 coefficients and the zeros of 8 power-ons'):
        fit_terms(run, run_zeros=True)


def test_bad_arguments():
    run = make_run(np.random.default_rng(14))
    for kwargs, word in (({'names': ()}, 'no term'), ({'names': ('XX',)}, 'XX'),
                         ({'geometry': 'flat'}, 'flat'), ({'encoder': 'abs'}, 'az_abs'),
                         ({'encoder': 'third'}, 'third')):
        with pytest.raises(ValueError, match=word):
            fit_terms(run, **kwargs)
    with pytest.raises(ValueError, match='interpretation'):
        fit_harmonics(run, 'nadir')


def test_zero_is_subtracted_and_other_encoder_is_used():
    run = make_run(np.random.default_rng(15), noise=(0, 0))
    columns = dict(run.columns)
    columns['az_abs'], columns['el_abs'] = run['az_enc'] + 1e-4, run['el_enc'] - 2e-4
    run = PointingRun(columns)
    fit = fit_terms(run, encoder='abs', zero=PowerOnZero(1e-4, -2e-4))
    np.testing.assert_allclose(fit.coefficients, TRUTH, atol=1e-6 * ARCSEC)
    fit = fit_terms(run, encoder='abs')
    assert fit.coefficients[0] - TRUTH[0] == pytest.approx(1e-4, abs=1e-11)
    assert fit.coefficients[1] - TRUTH[1] == pytest.approx(-2e-4, abs=1e-11)


def test_other_terms_beside_the_rotations():
    model = PointingModel({**MODEL.terms, 'HASA2': 15 * ARCSEC, 'ECES': -10 * ARCSEC})
    run = make_run(np.random.default_rng(16), 60, (0, 0), model)
    fit = fit_terms(run, tuple(model.terms))
    np.testing.assert_allclose(
        fit.coefficients, list(model.terms.values()), atol=1e-6 * ARCSEC)


@pytest.mark.parametrize('reading', ['zenith', 'printed'])
def test_harmonics_on_top_of_terms(reading):
    rng = np.random.default_rng(17)
    c = rng.normal(size=(2, 13)) * 5 * ARCSEC
    truth = PointingModel(MODEL.terms, None, Harmonics(reading, *c, np.eye(26)))
    run = make_run(rng, 200, (0, 0), truth)
    fit = fit_harmonics(run, reading, held=MODEL, rcond=1e-9)
    np.testing.assert_allclose(fit.model.harmonics.coef_x, c[0], atol=1e-5 * ARCSEC)
    np.testing.assert_allclose(fit.model.harmonics.coef_y, c[1], atol=1e-5 * ARCSEC)
    assert fit.model.terms == MODEL.terms and fit.rank == 26
    assert np.abs(fit.model.residuals(run)).max() < 1e-6 * ARCSEC
    assert fit.names[0] == 'A0' and fit.names[-1] == 'B12'
    with pytest.raises(ValueError, match='harmonics already'):
        fit_harmonics(run, reading, held=fit.model)


def test_harmonics_of_thirty_stars_are_ill_conditioned_and_truncated():
    run = make_run(np.random.default_rng(18))
    fit = fit_harmonics(run, rcond=1e-3)
    assert fit.rank < 26 and len(fit.dropped) == 26 - fit.rank
    assert 1e3 < fit.condition < 1e5
    assert fit_harmonics(run, rcond=1e-6).rank == 26
    with pytest.raises(ValueError, match='13 usable'):
        fit_harmonics(run.select(slice(0, 13)))


def test_harmonic_covariance_predicts_the_scatter():
    z = []
    harmonics = Harmonics('zenith', np.full(13, 3e-6), np.full(13, -2e-6), np.eye(26))
    truth = PointingModel({}, None, harmonics)
    az, el = np.array([0.3, 2.0, 4.0]), np.array([0.6, 0.9, 1.2])
    for seed in range(60):
        fit = fit_harmonics(make_run(np.random.default_rng([19, seed]), 60, (1, 2), truth),
                            rcond=1e-9)
        x, y = fit.model.offsets(az, el)
        tx, ty = truth.offsets(az, el)
        sx, sy = fit.model.sigma(az, el)
        z += [(x - tx) / sx, (y - ty) / sy]
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.05, abs=0.12)


def test_scatter_and_rms():
    fit = fit_terms(make_run(np.random.default_rng(20), 5000, (0.5, 2.0)))
    assert fit.scatter[0] / ARCSEC == pytest.approx(0.5, rel=0.05)
    assert fit.scatter[1] / ARCSEC == pytest.approx(2.0, rel=0.05)
    rms = fit.rms_arcsec()
    assert rms.radial == pytest.approx(np.hypot(rms.x, rms.y)) and rms.n == 5000
    assert rms_arcsec(np.array([3.0, np.nan]) * ARCSEC, np.array([4.0, 1.0]) * ARCSEC) == (
        pytest.approx(3), pytest.approx(4), pytest.approx(5), 1)


def test_same_data_same_model():
    run = make_run(np.random.default_rng(21))
    assert fit_terms(run).model.to_json() == fit_terms(run).model.to_json()


# --------------------------------------------------------------------------- held terms


def held(*names):
    return {name: MODEL.terms[name] for name in names}


@pytest.mark.parametrize('robust', [True, False])
@pytest.mark.parametrize('geometry', ['rotation', 'first_order'])
def test_held_at_the_solution_the_others_are_those_of_the_free_fit(robust, geometry):
    run = make_run(np.random.default_rng(30), 40)
    if robust:
        run['el_enc'][7] += 60 * ARCSEC
    free = fit_terms(run, robust=robust, geometry=geometry)
    fixed = {name: free.model.terms[name] for name in ('CA', 'AN', 'TF')}
    # at the same weights: the noise of a fit with fewer terms is another by its freedom
    again = fit_terms(run, ('IA', 'IE', 'NPAE', 'AW'), held=fixed, robust=robust,
                      geometry=geometry)
    atol = 0.02 if robust else 1e-6
    for name in PHYSICAL:
        assert again.model.terms[name] == pytest.approx(
            free.model.terms[name], abs=atol * ARCSEC), name
    assert again.names == ('IA', 'IE', 'NPAE', 'AW') and again.model.geometry == geometry
    assert list(again.rejected) == list(free.rejected)
    x, y = again.model.residuals(run)
    np.testing.assert_allclose((again.residual_x, again.residual_y), (x, y), atol=1e-8 * ARCSEC)


@pytest.mark.parametrize('names', [('IA', 'IE'), ('IA', 'CA', 'AW'), ('TF',), PHYSICAL])
def test_what_is_held_acts_as_exact_rotations(names):
    """60" of collimation and 177" of tilt have 0.4" of second order, which must not be lost."""
    run = make_run(np.random.default_rng(31), 60, (0, 0), high=87.0)
    fit = fit_terms(run, names, held=held(*(n for n in PHYSICAL if n not in names)))
    for name in PHYSICAL:
        assert fit.model.terms[name] == pytest.approx(MODEL.terms[name], abs=1e-6 * ARCSEC)
    assert np.abs(fit.model.residuals(run)).max() < 1e-6 * ARCSEC


@pytest.mark.parametrize('names', [('IA', 'IE'), ('IA', 'IE', 'AN')])
def test_a_whole_model_is_held_and_terms_fitted_on_top(names):
    rng = np.random.default_rng(32)
    c = rng.normal(size=(2, 13)) * 5 * ARCSEC
    eccentric = FittedEffect(effect('encoder', axis='az', order=1), np.array([8.0, -5.0]) * ARCSEC)
    truth = PointingModel(
        {**MODEL.terms, 'HASA2': 15 * ARCSEC}, np.eye(8) * ARCSEC**2,
        Harmonics('zenith', *c, np.eye(26)), effects=[eccentric])
    run = make_run(rng, 60, (0, 0), truth)
    known = PointingModel({**truth.terms, **dict.fromkeys(names, 3 * ARCSEC)},
                          truth.covariance, truth.harmonics, effects=truth.effects)
    fit = fit_terms(run, names, held=known)
    for name, value in fit.model.terms.items():
        assert value == pytest.approx(truth.terms[name], abs=2e-5 * ARCSEC), name
    # the coefficients are what was added
    np.testing.assert_allclose(fit.coefficients, [MODEL.terms[n] - 3 * ARCSEC for n in names],
                               atol=2e-5 * ARCSEC)
    assert list(fit.model.terms) == list(truth.terms) and len(fit.model.effects) == 1
    assert fit.model.harmonics is truth.harmonics or np.array_equal(
        fit.model.harmonics.coef_x, truth.harmonics.coef_x)
    # held terms keep their covariance, fitted ones have that of the fit
    sigma = np.sqrt(np.diag(fit.model.covariance)) / ARCSEC
    for name, value in zip(truth.terms, sigma):
        assert value == pytest.approx(0.0 if name in names else 1.0, abs=1e-3), name
    assert np.abs(fit.model.covariance - np.diag(np.diag(fit.model.covariance))).max() < 1e-15


def test_values_that_are_held_have_no_variance():
    fit = fit_terms(make_run(np.random.default_rng(33)), ('IA', 'IE'), held=held('CA', 'AN'))
    assert list(fit.model.terms) == ['CA', 'AN', 'IA', 'IE']
    assert not fit.model.covariance[:2].any()
    np.testing.assert_allclose(fit.model.covariance[2:, 2:], fit.covariance, rtol=1e-15)
    assert fit.model.provenance['held'] == 'CA, AN'
    assert 'held' not in fit_terms(make_run(np.random.default_rng(33))).model.provenance


def test_held_terms_beside_outliers_and_zeros_of_each_run():
    rng = np.random.default_rng(34)
    run = make_run(rng, 60, run=np.repeat([1.0, 2.0], 30))
    run['az_enc'][30:] += 50 * ARCSEC
    run['el_enc'][::10] += 200 * ARCSEC
    fit = fit_terms(run, ('IA', 'IE'), held=held('CA', 'NPAE', 'AN', 'AW', 'TF'), run_zeros=True)
    assert list(fit.rejected) == list(range(0, 60, 10))
    assert fit.zeros[2].az / ARCSEC == pytest.approx(50, abs=2)
    assert fit.model.terms['IE'] / ARCSEC == pytest.approx(100, abs=1)


def test_what_cannot_be_held():
    run = make_run(np.random.default_rng(35))
    for wrong, word in (({'XX': 1.0}, 'XX'), ({'CA': np.nan}, 'CA')):
        with pytest.raises(ValueError, match=word):
            fit_terms(run, ('IA',), held=wrong)
    with pytest.raises(ValueError, match='flat'):
        fit_terms(run, ('IA',), held=MODEL, geometry='flat')
    # a star that the held model cannot reach is left out and named
    run['el'][5] = np.pi / 2 - np.hypot(120, -130) * ARCSEC
    run['az'][5] = np.arctan2(130, 120)
    fit = fit_terms(run, ('IA', 'IE'), held=MODEL)
    assert [e['row'] for e in fit.excluded] == [5] and 'cannot point' in fit.excluded[0]['reason']
    assert np.isnan(fit.residual_x[5]) and fit.weights[5] == 0.0


def test_harmonics_on_top_of_a_model_with_effects():
    rng = np.random.default_rng(36)
    eccentric = FittedEffect(effect('encoder', axis='az', order=1), np.array([8.0, -5.0]) * ARCSEC)
    known = PointingModel(MODEL.terms, effects=[eccentric])
    c = rng.normal(size=(2, 13)) * 5 * ARCSEC
    truth = PointingModel(MODEL.terms, None, Harmonics('zenith', *c, np.eye(26)),
                          effects=[eccentric])
    run = make_run(rng, 200, (0, 0), truth)
    run['az'][3] = np.nan
    fit = fit_harmonics(run, held=known, rcond=1e-9)
    np.testing.assert_allclose(fit.model.harmonics.coef_x, c[0], atol=1e-4 * ARCSEC)
    assert len(fit.model.effects) == 1 and [e['row'] for e in fit.excluded] == [3]
    assert np.nanmax(np.abs(fit.model.residuals(run))) < 1e-5 * ARCSEC
