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

"""What the stars do not determine: held, said, and nothing rests on it."""


import numpy as np
import pytest
from determined import simulated
from places import CASES

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.mistaken_columns import check_columns
from calibration.analysis.run_fit import fit_run
from calibration.analysis.term_fit import fit_terms
from calibration.report.documents import fit_document
from calibration.report.fit_tables import fit_tables
from calibration.rows import usable
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

TRUTH = {'IA': 120.0, 'IE': -150.0, 'CA': 15.0, 'NPAE': -8.0, 'AN': 20.0, 'AW': 12.0, 'TF': 25.0}


def run_at(el, az=None, seed=1, noise=0.5, **columns):
    """A run of the terms above at these elevations, degrees."""
    rng = np.random.default_rng(seed)
    el = np.asarray(el) * DEG
    az = rng.uniform(0.0, 2.0 * np.pi, len(el)) if az is None else np.full(len(el), az)
    model = PointingModel({name: value * ARCSEC for name, value in TRUTH.items()})
    az_enc, el_enc = model.sky_to_encoder(az, el)
    x, y = rng.normal(scale=noise * ARCSEC, size=(2, len(el)))
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el),
                        'el_enc': el_enc + y, **columns}, {})


def off(fit, truth=TRUTH):
    """How far each determined term is from the truth, in sigmas."""
    return {name: (value / ARCSEC - truth[name]) / (sigma / ARCSEC)
            for name, value, sigma in zip(fit.names, fit.coefficients, fit.sigma)
            if name not in fit.undetermined}


@pytest.mark.parametrize('run, undetermined', [
    (run_at(np.full(60, 50.0)), 'IA IE CA NPAE TF'),
    (run_at(np.repeat([40.0, 60.0], 30)), 'IA CA NPAE'),
    (run_at(np.full(12, 50.0), 1.0), 'IA IE CA NPAE AN AW TF'),
], ids=['one elevation', 'two elevations', 'one star'])
def test_of_few_elevations_the_rest_is_right_and_what_is_not_has_no_sigma(run, undetermined):
    fit = fit_terms(run)
    assert ' '.join(fit.undetermined) == undetermined
    assert all(abs(z) < 3.5 for z in off(fit).values())
    assert fit.rms_arcsec().radial < 1.0
    rows = {row['name']: row for row in fit.term_rows(interval=True)}
    for name in fit.undetermined:
        assert rows[name]['undetermined'] and rows[name]['sigma_arcsec'] is None
    held = [row for row in rows.values() if row['value_arcsec'] == 0.0]
    assert len(held) == 7 - fit.rank and not {'IA', 'IE'} & {row['name'] for row in held}


@pytest.mark.parametrize('mount, undetermined', [('fork', 'IH CH NP'), ('German', 'CH NP')])
def test_of_one_circle_of_declination(mount, undetermined):
    for given in (False, True):
        run, truth = simulated('one circle', mount, 3, given)
        fit = fit_terms(run)
        assert ' '.join(fit.undetermined) == undetermined
        assert all(abs(z) < 3.5 for z in off(
            fit, {name: value / ARCSEC for name, value in truth.items()}).values())


@pytest.mark.parametrize('kind, mount', [
    ('one circle +- 1', 'fork'), ('one circle +- 0.01', 'German'), ('two circles +- 0.01', 'fork')])
def test_near_circles_every_run_converges_and_what_has_a_sigma_is_right(kind, mount):
    beyond = terms = 0
    for seed in range(5):
        run, truth = simulated(kind, mount, seed, True)
        fit = fit_terms(run)
        away = np.array(list(off(fit, {n: v / ARCSEC for n, v in truth.items()}).values()))
        assert np.abs(away).max() < 5.0
        assert fit.rms_arcsec().radial < 2.5
        beyond, terms = beyond + np.sum(np.abs(away) > 1.96), terms + len(away)
    assert beyond <= 0.25 * terms


def test_a_healthy_run_and_a_field_of_five_degrees_determine_every_term():
    assert not fit_terms(run_at(np.linspace(20, 80, 30))).undetermined
    for mount in ('alt-az', 'fork', 'German'):
        assert not fit_terms(simulated('a field of 5 deg', mount, 2, False)[0]).undetermined


def test_what_is_undetermined_is_said_everywhere_and_read_back():
    run = run_at(np.full(60, 50.0))
    fit = fit_terms(run)
    found = fit_run(run)
    document = fit_document(found)
    assert [row['name'] for row in document['terms'] if row.get('undetermined')] == [
        'IA', 'IE', 'CA', 'NPAE', 'TF']
    assert all(pair['terms'] == ['AW', 'AN'] for pair in document['correlations'])
    assert not any('TF, the bending' in note for note in document['notes'])
    assert 'undetermined by these stars: IA, IE, CA, NPAE, TF' in ' '.join(document['notes'])
    assert any('undetermined by these stars' in str(line) for line in fit_tables(found, document))
    again = PointingModel.from_json(fit.model.to_json())
    assert again.to_json() == fit.model.to_json()
    assert again.undetermined == ('IA', 'IE', 'CA', 'NPAE', 'TF')
    sx, sy = again.sigma(np.full(3, 2.0), np.array([20.0, 50.0, 80.0]) * DEG)
    assert np.isnan(sx[[0, 2]]).all() and np.isnan(sy[[0, 2]]).all()
    assert 0.0 < sx[1] < 0.3 * ARCSEC and 0.0 < sy[1] < 0.3 * ARCSEC


def test_a_side_of_the_pier_that_no_row_is_on_has_a_prediction_of_unknown_error():
    run, _ = simulated('one side', 'German', 1, False)
    model = PointingModel.from_json(fit_terms(run).model.to_json())
    assert model.sides == (30, 0)
    here, there = model.sigma(np.array([0.3, 0.3 + np.pi]), np.array([0.5, np.pi - 0.5]))[0]
    assert np.isfinite(here) and np.isnan(there)
    run, _ = simulated('few stars', 'German', 1, False)
    assert not fit_terms(run).model.is_open(0.3 + np.pi, np.pi - 0.5)


def test_diagnosis_claims_nothing_of_undetermined_terms():
    result = diagnose(run_at(np.full(40, 50.0)), flips=999, cross_validation=False)
    assert result.model.undetermined == ('IA', 'IE', 'CA', 'NPAE', 'TF')
    assert not result.unphysical and not result.effects
    assert any(note.kind == 'undetermined terms' for note in result.notes)


def test_one_sigma_far_below_the_others_is_taken_as_a_fifth_of_the_median():
    for tiny in (1e-6, 1e-3, 0.05):
        sigma = np.full(60, 0.5)
        sigma[7] = tiny
        run = run_at(np.random.default_rng(2).uniform(20, 80, 60), seed=5,
                     sigma_x=sigma * ARCSEC, sigma_y=np.full(60, 0.5) * ARCSEC)
        fit = fit_terms(run)
        assert fit.rank == 7 and not fit.undetermined
        assert all(abs(z) < 4.0 for z in off(fit).values())
        (raised,) = fit.raised
        assert (raised['row'], raised['axis']) == (7, 'x')
        assert raised['taken'] == pytest.approx(0.1 * ARCSEC)
        assert any('row 7: sigma x' in note for note in fit_document(fit_run(run))['notes'])


def test_many_small_sigmas_are_an_instrument_and_one_that_cannot_be_costs_its_row():
    sigma = np.full(60, 0.5)
    sigma[:20] = 0.01
    run = run_at(np.linspace(20, 80, 60), sigma_x=sigma * ARCSEC, sigma_y=sigma * ARCSEC)
    assert not usable(run).raised
    assert fit_terms(run).rank == 7
    sigma[3] = 1e-300
    run.columns['sigma_x'][:] = sigma * ARCSEC
    assert [one['row'] for one in usable(run).excluded] == [3]
    assert fit_terms(run).rank == 7


@pytest.mark.skipif(not CASES.is_dir(), reason='the cases of ../shared are not here')
def test_the_cases_of_one_elevation_and_near_one_circle():
    fit = fit_terms(read_run(CASES / 'const_el.csv'))
    assert fit.undetermined == ('IA', 'IE', 'CA', 'NPAE', 'TF')
    assert all(abs(z) < 3.0 for z in off(fit).values())
    run = read_run(CASES / 'one_circle.csv')
    check_columns(run)
    assert fit_terms(run).rms_arcsec().x == pytest.approx(1.0, abs=0.3)
