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

"""Errors of the parts of a mount against errors applied on the sky before the flip."""

import json
from dataclasses import replace

import numpy as np
import pytest
from exact_rotations import offsets_and_jacobian
from sides import MOUNT, NAMES, a_run

from calibration.analysis.sky_model import CHANCE, origin_of_errors
from calibration.calibration_state import CalibrationState
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from pointing_model.mounts import Mount, is_beyond, through_pole
from pointing_model.rms import rms
from pointing_model.runs.model_files import coefficient_table
from pointing_model.runs.model_files.transfer import export
from pointing_model.runs.programs import PROGRAMS
from pointing_model.runs.run import PointingRun


@pytest.mark.parametrize('kind', ['mount', 'sky'])
@pytest.mark.parametrize('seed', [1, 2])
def test_the_right_origin_is_told_and_its_terms_are_those_of_the_simulation(kind, seed):
    run, terms = a_run(kind, seed)
    origin = origin_of_errors(run, NAMES)
    assert origin.holds == kind
    other = {'mount': 'sky', 'sky': 'mount'}[kind]
    assert origin.left_out[kind] < 2.0 * ARCSEC < 5.0 * ARCSEC < origin.left_out[other]
    fit = origin.fits[kind]
    off = [(fit.model.terms[name] - terms[name]) for name in NAMES]
    assert np.all(np.abs(off) < 4.0 * fit.sigma)
    assert origin.document()['holds'] == kind and origin.document()['rows'] == 40


@pytest.mark.parametrize('kind', ['mount', 'sky'])
def test_each_of_several_runs_has_a_zero_of_its_own(kind):
    """Rows in turn, zeros some 300 arcsec apart; applied on the sky it turns with the side."""
    run, terms = a_run(kind, 3)
    run.columns['run'] = np.arange(40) % 3 + 1.0
    side = np.where(is_beyond(run['el']) & (kind == 'sky'), -1.0, 1.0)
    for name, zeros, sign in (('az_enc', (0.0, 300.0, -200.0), 1.0),
                              ('el_enc', (0.0, -250.0, 350.0), side)):
        run.columns[name] = run[name] + sign * np.take(zeros, np.arange(40) % 3) * ARCSEC
    origin = origin_of_errors(run, NAMES)
    assert origin.holds == kind and origin.rows == 40
    assert origin.left_out[kind] < 2.5 * ARCSEC
    fit = origin.fits[kind]
    off = [(fit.model.terms[name] - terms[name]) for name in NAMES]
    assert np.all(np.abs(off) < 4.0 * fit.sigma[:len(NAMES)])


def test_rows_that_do_not_tell_are_said_not_to():
    """The terms whose sign would change are lost in the noise: a false claim once in a hundred."""
    claims = sum(bool(origin_of_errors(a_run('mount', seed, size=0.0)[0], NAMES).holds)
                 for seed in range(100, 112))
    assert claims <= 1 and CHANCE == 0.01


def test_one_wild_row_does_not_turn_the_verdict():
    run, _ = a_run('sky', 5)
    run['az_enc'][3] += 0.5 * DEG
    assert origin_of_errors(run, NAMES).holds == 'sky'


def test_nothing_is_said_of_one_side_or_of_another_mount():
    assert origin_of_errors(a_run('sky', 1, east=0.0)[0], NAMES) is None
    assert origin_of_errors(a_run('sky', 1)[0], ('IH', 'MA', 'ME')) is None
    assert origin_of_errors(a_run('sky', 1, rows=6)[0], NAMES) is None
    run, _ = a_run('mount', 1, east=0.0)
    assert origin_of_errors(PointingRun(run.columns)) is None


@pytest.mark.parametrize('geometry', ['rotation', 'first_order'])
def test_terms_that_act_on_the_sky_are_those_of_a_mount_that_never_goes_through_the_pole(geometry):
    """By an equatorial model at the angles folded back, which knows nothing of sides."""
    rng = np.random.default_rng(7)
    terms = {name: 300.0 * ARCSEC * rng.normal() for name in ('IH', 'CH', 'NP', 'MA', 'TF', 'FO')}
    beyond = rng.random(200) < 0.5
    ha, dec = rng.uniform(-1.4, 1.4, 200), rng.uniform(-0.5, 1.3, 200)
    first, second = MOUNT.on_travel(*through_pole(ha, dec, beyond))
    model = PointingModel(terms, geometry=geometry, mount=MOUNT.with_errors('sky'))
    plain = PointingModel(terms, geometry=geometry, mount=Mount(
        'equatorial', MOUNT.frame))
    want = MOUNT.on_travel(*through_pole(*plain.sky_to_encoder(ha, dec), beyond))
    got = model.sky_to_encoder(first, second)
    np.testing.assert_allclose(wrap(np.subtract(got, want)), 0.0, atol=1e-12)
    back = model.encoder_to_sky(*got)
    np.testing.assert_allclose(wrap(np.subtract(back, (first, second))), 0.0, atol=1e-12)
    sign = np.where(beyond, -1.0, 1.0)
    for own, other in zip(model.offsets(first, second), plain.offsets(ha, dec)):
        np.testing.assert_allclose(own, sign * other, atol=1e-12)
    for own, other in zip(model.sigma(first, second), plain.sigma(ha, dec)):
        np.testing.assert_allclose(own, other)
    # the derivatives of the fit, by differences
    x, y, columns = offsets_and_jacobian(first, second, {'CH': terms['CH']}, ['CH'], model.mount)
    step = 1e-6
    x2, y2, _ = offsets_and_jacobian(first, second, {'CH': terms['CH'] + step}, ['CH'],
                                     model.mount)
    np.testing.assert_allclose(columns['CH'], ((x2 - x) / step, (y2 - y) / step), atol=1e-5)


def fitted(run):
    """A session that has the run as a night, its model and report."""
    rows = len(run)
    run.columns |= {'star': np.arange(rows), 'run': np.ones(rows), 'time': 1.8e9 + np.arange(rows)}
    session = CalibrationState()
    session.add(run, 1)
    return session, *session.fit()


def test_the_model_that_holds_is_published_and_its_files_and_exports_say_so(tmp_path):
    run, terms = a_run('sky', 2)
    session, model, report = fitted(run)
    assert model.mount.on_sky and report['errors_act'] == 'sky'
    assert report['origin_of_errors']['holds'] == 'sky'
    assert 'the same on both sides of the pier' in report['notes'][-1]
    assert abs(model.terms['CH'] - terms['CH']) < 2.0 * ARCSEC
    assert rms(*model.residuals(run)) < 2.0 * ARCSEC  # of rows that do not know whose errors are
    assert session.diagnose().model.mount.on_sky
    # a calibration that begins again takes it up with the model in force
    again = CalibrationState()
    again.take_up(model)
    again.add(run, 1)
    assert again.observations().mount.on_sky
    model.save(tmp_path / 'sky.json')
    assert json.loads((tmp_path / 'sky.json').read_text())['mount']['errors'] == 'sky'
    loaded = PointingModel.load(tmp_path / 'sky.json', MOUNT)
    assert loaded.mount == model.mount
    other = replace(model, mount=MOUNT)
    assert identity(other.to_json()) != identity(model.to_json())
    text = coefficient_table.write(model, 'a model')
    again = coefficient_table.read('a.csv', text, MOUNT)
    np.testing.assert_array_equal(again.sky_to_encoder(1.0, 2.0), loaded.sky_to_encoder(1.0, 2.0))
    for name in ('tpoint', 'spk', 'onstepx', 'rts2'):
        export(other, PROGRAMS[name])
        with pytest.raises(ValueError, match='act on the sky, alike on both sides'):
            export(model, PROGRAMS[name])
    with pytest.raises(ValueError, match='of an equatorial mount'):
        Mount('equatorial', MOUNT.frame, 'sky')


def test_errors_of_the_mount_are_published_as_ever():
    run, _ = a_run('mount', 2)
    _, model, report = fitted(run)
    assert not model.mount.on_sky and 'errors_act' not in report
    assert report['origin_of_errors']['holds'] == 'mount'
