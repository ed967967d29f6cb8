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

"""A model file as the base of a fit and of a diagnosis."""

import json

import numpy as np
import pytest

from calibration.analysis.base_model import BaseModel
from calibration.analysis.diagnosis.observations import observations
from msg_tools.units import ARCSEC, DEG
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.model_files.transfer import export
from pointing_model.runs.programs import PROGRAMS
from pointing_model.runs.run import PointingRun

TERMS = {name: value * ARCSEC for name, value in {
    'IA': 412.0, 'IE': -31.0, 'CA': 25.0, 'AN': 30.0, 'AW': -22.0, 'TF': 15.0}.items()}
WAVE = FittedEffect(effect('encoder', axis='el', order=4), np.array([6.0, -4.0]) * ARCSEC)


@pytest.fixture
def run(tmp_path):
    rng = np.random.default_rng(5)
    az, el = rng.uniform(0.0, 2.0 * np.pi, 60), np.arcsin(rng.uniform(0.35, 0.99, 60))
    az_enc, el_enc = PointingModel(TERMS, effects=[WAVE]).sky_to_encoder(az, el)
    noise = rng.normal(size=(2, 60)) * 0.5 * ARCSEC
    made = PointingRun({'az': az, 'el': el, 'az_enc': az_enc + noise[0] / np.cos(el),
                        'el_enc': el_enc + noise[1]})
    write_csv(made, tmp_path / 'run.csv')
    return tmp_path / 'run.csv', made


@pytest.fixture
def file(tmp_path):
    """A TPOINT file whose indices have moved since, with an elevation harmonic."""
    model = PointingModel({**TERMS, 'IA': 300.0 * ARCSEC, 'IE': 10.0 * ARCSEC},
                          np.eye(6) * (0.2 * ARCSEC)**2, effects=[WAVE])
    path = tmp_path / 'tcs.mod'
    path.write_text(export(model, PROGRAMS['tpoint']).text)
    return path


def test_terms_are_fitted_anew_and_the_rest_is_held(ended, run, file, tmp_path):
    code, out, err = ended('fit', run[0], '--base', file, '--save', tmp_path / 'new.json',
                           '--verbose')
    assert code == 0, err
    assert 'Terms of tcs.mod and of this run, arcsec' in out
    (line,) = [line for line in out.splitlines() if line.strip().startswith('IA ')
               and '+300.00' in line]
    assert float(line.split()[2]) == pytest.approx(412.0, abs=1.5)
    assert 'not refitted: el cos 4E, el sin 4E' in ' '.join(out.split())
    new = PointingModel.load(tmp_path / 'new.json')
    assert tuple(new.terms) == BaseModel.read(file, ALTAZ).terms
    x, y = new.residuals(run[1])
    assert np.std(y) < 0.6 * ARCSEC and np.std(x) < 0.6 * ARCSEC
    assert [e.effect.name for e in new.effects] == ['el cos 4E', 'el sin 4E']
    # without what is held, the harmonic stays in the residual
    ended('fit', run[0], '--terms', ','.join(new.terms), '--save', tmp_path / 'bare.json')
    assert np.std(PointingModel.load(tmp_path / 'bare.json').residuals(run[1])[1]) > 1.5 * ARCSEC


def test_what_meets_a_graduation_is_the_reading_as_it_was(file, run):
    base = BaseModel.read(file, ALTAZ)
    taken = base.taken_off(run[1])
    np.testing.assert_array_equal(taken['az_raw'], run[1]['az_enc'])
    moved = (run[1]['el_enc'] - taken['el_enc']) / ARCSEC
    el = run[1]['el']
    np.testing.assert_allclose(moved, 6.0 * np.cos(4 * el) - 4.0 * np.sin(4 * el), atol=1e-4)


def test_a_diagnosis_of_what_the_file_lacks(ended, run, file, tmp_path):
    code, out, err = ended('diagnose', run[0], '--base', file, '--json', tmp_path / 'd.json',
                           '--save', tmp_path / 'd_model.json')
    assert code == 0, err
    told = json.loads((tmp_path / 'd.json').read_text())
    assert told['effects'] == [] and told['base_terms'] == list(TERMS)
    rows = {row['name']: row for row in told['base_model']['terms']}
    assert rows['IE']['there_arcsec'] == pytest.approx(10.0, abs=0.1)
    assert rows['IE']['here_arcsec'] == pytest.approx(-31.0, abs=1.5)
    assert abs(rows['IE']['in_sigma']) > 20.0
    assert told['base_model']['held'] == ['el cos 4E', 'el sin 4E']
    assert len(PointingModel.load(tmp_path / 'd_model.json').effects) == 2


@pytest.mark.parametrize('command', ['fit', 'diagnose'])
@pytest.mark.parametrize('text, words', [
    ('caption\nT 3 1.0 0.0 0.0\n  IH  +3.0 0.1\nEND\n', 'equatorial mount (IH)'),
    ('caption\nT 3 1.0 0.0 0.0\n  ZZZ  +3.0 0.1\nEND\n', 'ZZZ (row 3)'),
    ('RTS2_GEM 1 2 3 4 5 6 7 8 9', 'equatorial mount'),
    (':SX00,nan#', 'not finite'),
])
def test_bad_files_are_one_line(refused, run, tmp_path, command, text, words):
    path = tmp_path / 'base.mod'
    path.write_text(text)
    assert words in refused(command, run[0], '--base', path)


def test_bases_that_say_nothing(refused, run, file, tmp_path):
    assert 'leave one out' in refused('fit', run[0], '--base', file, '--terms', 'IA,IE')
    assert 'no_such.mod' in refused('diagnose', run[0], '--base', tmp_path / 'no_such.mod')
    PointingModel({}, effects=[WAVE]).save(tmp_path / 'empty.json')
    assert 'no term to fit anew' in refused('fit', run[0], '--base', tmp_path / 'empty.json')


def test_a_mount_whose_latitude_was_rounded_is_the_same(tmp_path):
    model = PointingModel({'IH': 90.0 * ARCSEC}, mount=Mount.equatorial(31.05 * DEG))
    model.save(tmp_path / 'fork.json')
    rounded = Mount.equatorial(31.05 * DEG + 1e-15)
    assert rounded != model.mount
    assert BaseModel.read(tmp_path / 'fork.json', rounded).terms == ('IH',)
    with pytest.raises(ValueError, match='model of another mount'):
        BaseModel.read(tmp_path / 'fork.json', Mount.equatorial(31.0501 * DEG))
    rng = np.random.default_rng(1)
    runs = [PointingRun({name: rng.uniform(0.1, 1.2, 8) for name in
                         ('az', 'el', 'az_enc', 'el_enc')}, {'mount': mount})
            for mount in (model.mount, rounded)]
    assert len(observations(runs)) == 16
