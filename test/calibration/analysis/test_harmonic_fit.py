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

from calibration.analysis.harmonic_fit import (
    CHOICES,
    HarmonicChoice,
    Recipe,
    choice_of,
    choice_of_report,
    cross_validated,
    every_choice,
    fit_chosen,
)
from calibration.analysis.term_fit import fit_harmonics, fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.harmonics import Harmonics, names_of
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.zero import NO_ZERO
from telescope_mount.commands.options import SHARED
from test.calibration.test_night_diagnosis import same_series

TERMS = dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC))
ALONE = Recipe(NO_ZERO, run_zeros=False)


def sky(rng, n):
    return rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))


def observed(mount, n=60, seed=0, noise=1.0, runs=1):
    rng = np.random.default_rng(seed)
    az, el = sky(rng, n)
    az_enc, el_enc = mount.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, n)) * noise * ARCSEC
    return PointingRun({
        'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el), 'el_enc': el_enc + y,
        'star': 1.0 + np.arange(n), 'run': 1.0 + np.arange(n) % runs})


def harmonic_mount(reading='zenith', degree=4, seed=1, size=3.0, terms=()):
    k = len(names_of(degree))
    p = np.random.default_rng(seed).normal(size=k) * size * ARCSEC
    return PointingModel(dict(terms), None, Harmonics.from_degree(
        degree, reading, p, np.zeros((k, k))))


def test_the_options_are_those_of_the_node():
    assert SHARED['harmonics']['choices'] == CHOICES


@pytest.mark.parametrize('wrong, words', [
    (('nadir',), "unknown harmonics 'nadir'; take none, zenith, printed"),
    (('zenith', False, 5), 'harmonics of degree 5; take 1 to 4, or 0'),
    (('none', True), 'but no harmonics; take zenith or printed'),
    (('none', False, 2), 'but no harmonics; take zenith or printed')])
def test_what_cannot_be_chosen(wrong, words):
    with pytest.raises(ValueError, match=words):
        HarmonicChoice(*wrong)


def test_a_choice_comes_back_from_parameters_and_reports():
    choice = HarmonicChoice('printed', True, 2)
    assert choice_of(choice.parameters()) == choice
    assert choice_of({}) == choice_of_report(None) == choice_of_report({}) == HarmonicChoice()
    rows = observed(harmonic_mount('printed', 2))
    for wanted in (choice, HarmonicChoice('printed', True)):
        _, section, _ = fit_chosen(rows, wanted, ALONE)
        assert choice_of_report({'harmonics': section}) == wanted


def test_what_few_stars_do_not_determine_is_left_out_unless_it_is_asked_for():
    rows = observed(harmonic_mount('printed'), 30)
    (_, damped, lost), (_, whole, none) = (
        fit_chosen(rows, HarmonicChoice('printed', True, 4, rcond), ALONE)
        for rcond in (1e-4, 1e-12))
    assert damped['rank'] < whole['rank'] == 26
    assert any(found.kind == 'open direction' for found in lost)
    assert not any(found.kind == 'open direction' for found in none)
    assert any(row['sigma_arcsec'] is None for row in damped['coefficients'])
    assert all(row['sigma_arcsec'] is not None for row in whole['coefficients'])
    assert choice_of_report({'harmonics': whole}).rcond == 1e-12


@pytest.mark.parametrize('reading', ['zenith', 'printed'])
@pytest.mark.parametrize('degree', [1, 3])
def test_a_series_of_lower_degree_ends_there(reading, degree):
    mount = harmonic_mount(reading, degree)
    fit = fit_harmonics(observed(mount, noise=1e-6), reading, degree=degree, rcond=1e-9)
    series = fit.model.harmonics
    assert series.degree == degree and fit.names == names_of(degree)
    np.testing.assert_allclose(series.coef_x, mount.harmonics.coef_x, atol=1e-3 * ARCSEC)
    np.testing.assert_allclose(series.coef_y, mount.harmonics.coef_y, atol=1e-3 * ARCSEC)
    assert not series.coef_x[3 * degree + 1:].any()


@pytest.mark.parametrize('reading', ['zenith', 'printed'])
def test_coefficients_are_within_their_sigma_as_often_as_they_should(reading):
    inside, chi = [], []
    for seed in range(60):  # 26 each; those of one run are correlated: 2.3 % is by chance
        mount = harmonic_mount(reading, seed=1000 + seed)
        fit = fit_harmonics(observed(mount, 120, seed=seed), reading, rcond=1e-9)  # undamped
        assert fit.rank == 26
        error = fit.coefficients - np.concatenate((mount.harmonics.coef_x, mount.harmonics.coef_y))
        inside.append(np.abs(error) < fit.sigma)
        chi.append(error @ np.linalg.solve(fit.covariance, error))
    assert 0.62 < np.mean(inside) < 0.76
    assert 23.0 < np.mean(chi) < 29.0


@pytest.mark.parametrize('reading, degree', [('zenith', 2), ('printed', 4)])
def test_the_predicted_sigma_on_top_of_terms_is_the_scatter(reading, degree):
    """Terms and harmonics share directions, in which the terms have left nothing."""
    mount, at = PointingModel(TERMS), np.array(sky(np.random.default_rng(5), 100))
    at = at[:, (at[1] > 25.0 * DEG) & (at[1] < 65.0 * DEG)]  # where all nights have stars
    truth, z, held = np.array(mount.offsets(*at)), [], []
    for seed in range(24):
        rows = observed(mount, seed=seed, runs=2)
        terms = fit_terms(rows, run_zeros=True)
        fit = fit_harmonics(rows, reading, degree=degree, after=terms, zero=terms.zeros)
        z.append((np.array(fit.model.offsets(*at)) - truth) / fit.model.sigma(*at))
        plain = fit_harmonics(rows, reading, degree=degree, held=terms.model,
                              zero=terms.zeros).model
        assert same_series(plain.harmonics, fit.model.harmonics)
        held.append(np.mean(fit.model.sigma(*at)) / np.mean(plain.sigma(*at)))
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.12)
    assert np.mean(held) < 0.95  # as if nothing had been taken it would be too large


def test_the_zero_of_a_later_power_on_is_fitted_with_them():
    mount = harmonic_mount(degree=2)
    rows = observed(mount, 80, noise=0.1, runs=2)
    late = rows['run'] == 2.0
    rows.columns['az_enc'] = rows['az_enc'] + late * 20 * ARCSEC
    rows.columns['el_enc'] = rows['el_enc'] - late * 12 * ARCSEC
    fitted = Recipe(NO_ZERO).fit(rows, HarmonicChoice('zenith', True), 2)
    np.testing.assert_allclose(fitted.zeros[2].angles / ARCSEC, (20, -12), atol=0.3)
    x, y = fitted.model.residuals(rows, zero=fitted.zeros)
    assert np.sqrt(np.mean(x**2 + y**2)) < 0.2 * ARCSEC
    assert fitted.names[-2:] == ('IA[2]', 'IE[2]')


def test_cross_validation_finds_the_degree_and_the_reading():
    rows = observed(harmonic_mount('printed', 2, size=5.0, terms=TERMS), 70)
    tried = cross_validated(rows, ALONE)
    assert len(tried['choices']) == len(list(every_choice())) == 17
    best = min(tried['choices'], key=lambda one: one['radial'])
    assert (best['harmonics'], best['alone']) == ('printed', False)
    assert best['radial'] < 2.0 < 3.0 < tried['choices'][0]['radial']  # terms alone
    fitted, section, findings = fit_chosen(rows, HarmonicChoice('printed'), ALONE)
    assert section['degree'] == best['degree'] >= 2
    assert section['degree_by'] == 'cross-validation' and not findings
    assert fitted.model.harmonics.degree == best['degree']
    assert [row['name'] for row in section['coefficients']] == list(names_of(best['degree']))


def test_a_better_model_is_named_and_the_one_that_was_asked_for_is_made():
    fitted, section, findings = fit_chosen(observed(PointingModel(TERMS)),
                                           HarmonicChoice('zenith', True, 3), ALONE)
    assert (section['degree'], section['degree_by']) == (3, 'parameter')
    assert fitted.model.terms == {} and fitted.model.harmonics.degree == 3
    (better,) = findings
    assert better.kind == 'better model' and better['best'].startswith('7 terms')


def test_stars_observed_twice_are_left_out_together():
    rows = observed(PointingModel({}), 30, noise=1.0)
    twice = PointingRun.concatenate([rows, rows])  # the same noise: who sees one knows the other
    alone, both = (cross_validated(one, ALONE, seed=2)['choices'] for one in (rows, twice))
    overfitted = [[c['radial'] for c in choices if c['alone'] and c['degree'] == 4]
                  for choices in (alone, both)]
    assert min(overfitted[1]) > 1.5  # the noise is 1.41, seen rows would leave 1.1


@pytest.mark.parametrize('choice', [HarmonicChoice('zenith', True, 4), HarmonicChoice('printed')])
def test_too_few_stars_say_what_to_do(choice):
    few = observed(PointingModel(TERMS), 7 if choice.degree else 4)
    with pytest.raises(ValueError, match='observe at least|observe more') as refused:
        fit_chosen(few, choice, ALONE)
    assert '\n' not in str(refused.value)


def test_too_few_stars_to_leave_some_out_are_a_note():
    findings = fit_chosen(observed(PointingModel(TERMS), 14, noise=0.1),
                          HarmonicChoice('zenith', True, 4), ALONE)[-1]
    assert any(found.kind == 'not cross-validated' for found in findings)


@pytest.mark.parametrize('alone', [True, False])
def test_harmonics_that_the_stars_do_not_determine_make_no_prediction(alone):
    rng = np.random.default_rng(5)
    az, el = rng.uniform(-np.pi, np.pi, 40), np.full(40, 50.0 * DEG)  # one elevation
    run = PointingRun({'az': az, 'el': el, 'az_enc': az + rng.normal(scale=ARCSEC, size=40),
                       'el_enc': el + rng.normal(scale=ARCSEC, size=40)})
    after = None if alone else fit_terms(run)
    model = PointingModel.from_json(fit_harmonics(run, after=after).model.to_json())
    assert {'A0', 'A1', 'B0', 'B1'} <= set(model.undetermined_harmonics)
    assert np.isnan(model.sigma(0.3, 20.0 * DEG)).all()
    assert np.isfinite(model.sigma(0.3, 50.0 * DEG)).all()
