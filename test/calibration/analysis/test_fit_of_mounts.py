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

"""Fits to runs of mounts that are no alt-azimuth ones."""


import numpy as np
import pytest
from places import DATA

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.mistaken_columns import MistakenColumns, check_columns
from calibration.analysis.diagnosis.prediction import predictive_model
from calibration.analysis.external_check import external_check
from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from pointing_model.mounts import ALTAZ, Mount, is_beyond, through_pole
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site

GERMAN = Mount.equatorial(31.0 * DEG, 'german')
FORK = Mount.equatorial(31.0 * DEG)
SIZES = np.array([200.0, -100.0, 60.0, 40.0, 30.0, -80.0, 20.0])


def truth(mount):
    return dict(zip(mount.names.physical, SIZES * ARCSEC))


def simulated(mount=GERMAN, n=60, seed=1, noise=1.0, x=0.0, y=0.0):
    """A run; the German mount observes the east through the pole."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.995, n))
    h, _ = mount.axes_of(az, el)
    a, e = mount.axes_of(az, el, (h < 0.0) & (mount.two_sided))
    reading = geometry.sky_to_encoder(a, e, truth(mount), mount)
    off = noise * rng.normal(size=(2, n))
    if callable(x):
        x = x(a, e)
    if callable(y):
        y = y(a, e)
    return PointingRun({
        'az': a, 'el': e, 'time': 1.7e9 + 90.0 * np.arange(n),
        'az_enc': reading[0] + (x + off[0]) * ARCSEC / np.cos(e),
        'el_enc': reading[1] + (y + off[1]) * ARCSEC}, {'mount': mount})


@pytest.mark.parametrize('mount', [FORK, GERMAN, Mount.equatorial(-30.0 * DEG, 'german'),
                                   Mount.free(1.0, 0.4)], ids=lambda m: m.kind)
def test_exact_terms_come_back_on_both_sides(mount):
    run = simulated(mount, noise=0.0)
    fit = fit_terms(run, robust=False)
    for name, value in truth(mount).items():
        assert fit.model.terms[name] / ARCSEC == pytest.approx(value / ARCSEC, abs=1e-4)
    assert fit.rms_arcsec().radial < 1e-5


def test_first_order_leaves_what_exact_rotations_do_not():
    run = simulated(GERMAN, noise=0.0)
    left = fit_terms(run, robust=False, geometry='first_order').rms_arcsec().radial
    assert left > 0.005


def test_model_goes_both_ways_and_through_its_document():
    model = fit_terms(simulated(GERMAN)).model
    first, second = through_pole(np.array([-1.0, 0.5, 0.2]), np.array([0.3, 1.4, -0.2]),
                                 np.array([True, False, True]))
    back = model.encoder_to_sky(*model.sky_to_encoder(first, second))
    assert np.hypot(wrap(back[0] - first) * np.cos(second), back[1] - second).max() / ARCSEC < 1e-6
    again = PointingModel.from_json(model.to_json())
    assert again.mount == GERMAN and again.to_json() == model.to_json()
    turned = model.to_json().replace('"german"', '"equatorial"')
    assert identity(turned) != identity(model.to_json())


def test_halves_judge_each_other():
    assert 1.0 < external_check(simulated(GERMAN)).radial < 2.0


def test_terms_of_an_altaz_mount_are_refused():
    with pytest.raises(ValueError, match='IA, IE of a German mount'):
        fit_terms(simulated(GERMAN), ('IA', 'IE'))


def test_five_metre_horseshoe_as_its_own_program_says():
    path = DATA / 'spk5m' / 'pmfit_equat.dat'
    if not path.is_file():
        pytest.skip('no measured run of the 5 m horseshoe beside the project')
    printed = {'IH': 92.2, 'ID': 126.7, 'CH': -44.2, 'MA': 3.0, 'ME': -64.8, 'TF': 11.0}
    fit = fit_terms(read_run(path), tuple(printed), robust=False)
    assert fit.rms_arcsec().radial * np.sqrt(39 / 33) == pytest.approx(5.78, abs=0.005)
    for name, value in printed.items():
        assert fit.model.terms[name] / ARCSEC == pytest.approx(value, abs=0.1)
    found = predictive_model(read_run(path), ways=1, folds=5)
    assert found.after[0].radial < 2.5 < 5.5 < found.before[0].radial
    assert found.blocks.radial < 2.5 < found.blocks_before.radial and found.rows == 39


def test_german_robotic_mount_as_one_model():
    path = DATA / 'coatli' / '20211103b.txt'
    if not path.is_file():
        pytest.skip('no measured run of the German robotic mount beside the project')
    run = read_run(path, site=Site(31.0455305556 * DEG, -115.4669 * DEG, 2790.0),
                   weather=Weather(720.0, 8.0))
    assert fit_terms(run).rms_arcsec().radial == pytest.approx(20.5, abs=0.3)


@pytest.mark.usefixtures('short_diagnosis')
def test_an_effect_of_an_axis_and_one_of_gravity_are_found():
    def disc(a, e):
        return 8.0 * np.sin(2.0 * a) * np.cos(e)
    found = diagnose(simulated(GERMAN, x=disc), cross_validation=False)
    shown = {n for e in found.effects for n in (e.fitted.effect.name, *e.alternatives)}
    assert 'hour_angle_encoder_2' in shown
    assert found.model.mount == GERMAN and found.to_dict()['base_terms'][0] == 'IH'

    def fork(a, e):
        return 10.0 * np.cos(a)
    found = diagnose(simulated(FORK, seed=4, y=fork), cross_validation=False)
    shown = {n for e in found.effects for n in (e.fitted.effect.name, *e.alternatives)}
    assert 'fork_flexure' in shown


def test_what_hangs_on_the_other_end_differs_by_side():
    run = simulated(GERMAN)
    side = np.where(is_beyond(run['el']), -1.0, 1.0)
    leaning = [geometry.offsets(run['az'], run['el'], {'ME': s * 8.0 * ARCSEC}, GERMAN)
               for s in (1.0, -1.0)]
    x, y = (np.where(side > 0, plus, minus) for plus, minus in zip(*leaning))
    run = PointingRun({**run.columns, 'az_enc': run['az_enc'] + x / np.cos(run['el']),
                       'el_enc': run['el_enc'] + y}, run.meta)
    found = diagnose(run, cross_validation=False)
    shown = {n for e in found.effects for n in (e.fitted.effect.name, *e.alternatives)}
    assert 'ME_by_side' in shown


def test_runs_of_two_mounts_are_not_one():
    with pytest.raises(ValueError, match='different mounts'):
        diagnose([simulated(FORK), simulated(GERMAN)], cross_validation=False)


def test_nothing_is_found_where_nothing_is():
    found = diagnose(simulated(GERMAN, seed=3), cross_validation=False)
    assert not found.effects
    told = {row['name'] for row in found.detectable}
    assert 'hour_angle_encoder_1' in told and 'declination_encoder_2' in told
    assert any('another amount' in reason or 'IH' in reason for _, reason in found.untestable)


def mistaken(run, **columns):
    """The run with some columns written otherwise."""
    return PointingRun({**run.columns, **columns}, run.meta)


@pytest.mark.parametrize('mount', [FORK, GERMAN], ids=lambda m: m.kind)
def test_mistakes_in_columns_are_named(mount):
    run = simulated(mount)
    h, d = through_pole(run['az'], run['el'], is_beyond(run['el']))
    on_sky = {'az': h, 'el': d}
    cases = {
        'hour angle of the catalogue in hours': {**on_sky, 'az': wrap(h) / 15.0},
        'hour angle of the encoders in hours': {'az_enc': wrap(run['az_enc']) / 15.0},
        'hour angle of the encoders counted the other way': {'az_enc': -run['az_enc']},
        'right ascension in place of the hour angle of the encoders': {
            'az_enc': run['time'] * 2.0 * np.pi / 86164.0905 - run['az_enc']},
        'hour angle and declination of the encoders exchanged': {
            'az_enc': run['el_enc'], 'el_enc': run['az_enc']},
        'polar distance in place of the declination of the encoders': {
            'el_enc': np.pi / 2 - run['el_enc']},
    }
    for said, columns in cases.items():
        with pytest.raises(MistakenColumns, match=said):
            check_columns(mistaken(run, **columns))
    assert any('counted the other way' in text for text in check_columns(run).alike)


def test_mistakes_beyond_the_pole_are_named():
    run = simulated(GERMAN)
    beyond = is_beyond(run['el'])
    h, d = through_pole(run['az'], run['el'], beyond)
    turned = wrap(np.where(beyond, run['az_enc'] + np.pi, run['az_enc']))
    folded = np.where(beyond, np.pi - run['el_enc'], run['el_enc'])
    with pytest.raises(MistakenColumns, match='beyond 90 degrees with the hour angle of the star'):
        check_columns(mistaken(run, az_enc=turned))
    with pytest.raises(MistakenColumns, match='where the hour angle is 180 degrees on'):
        check_columns(mistaken(run, az=h, el=d, el_enc=folded))
    with pytest.raises(MistakenColumns, match='where stars east of the meridian are through'):
        check_columns(mistaken(run, az=h, el=d, az_enc=turned, el_enc=folded))


@pytest.mark.usefixtures('short_diagnosis')
def test_page_and_result_go_by_the_axes_of_the_mount():
    from calibration.report.diagnosis_page import render
    from calibration.report.diagnosis_view import view_of

    def disc(a, e):
        return 8.0 * np.sin(2.0 * a) * np.cos(e)
    found = diagnose(simulated(GERMAN, x=disc), cross_validation=False)
    document = found.to_dict()
    assert document['mount'] == 'german'
    assert document['mount_axes'] == ['hour angle', 'declination']
    page = render(view_of(found))
    assert 'hour angle × cos δ' in page and 'azimuth × cos E' not in page
    assert 'hour angle encoder' in page


def test_a_model_of_another_mount_is_refused(tmp_path):
    model = fit_terms(simulated(FORK)).model
    model.save(tmp_path / 'model.json')
    assert PointingModel.load(tmp_path / 'model.json').mount == FORK
    # a latitude that was rounded is the same
    near = Mount.equatorial(FORK.latitude + 1e-10)
    assert PointingModel.load(tmp_path / 'model.json', near).mount == FORK
    for other in (ALTAZ, GERMAN, Mount.equatorial(FORK.latitude + 1e-6)):
        with pytest.raises(ValueError, match='a model of another mount .equatorial, latitude'):
            PointingModel.load(tmp_path / 'model.json', other)
