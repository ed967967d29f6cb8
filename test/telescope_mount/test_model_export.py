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

"""The command ``export --to``: a model as another program reads it."""

import json
from pathlib import Path

import numpy as np
import pytest

from msg_tools.units import ARCSEC, wrap
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.model_reader import read_model
from pointing_model.runs.programs import PROGRAMS
from pointing_model.runs.run import PointingRun

TERMS = {name: value * ARCSEC for name, value in {
    'IA': 412.0, 'IE': -31.0, 'CA': 25.0, 'AN': 30.0, 'AW': -22.0, 'TF': 15.0}.items()}
ZEROS = [{'run': 1, 'az_arcsec': 100.0, 'el_arcsec': -50.0}]


@pytest.fixture
def model(tmp_path):
    side = FittedEffect(effect('hysteresis', axis='az'), [4.0 * ARCSEC])
    made = PointingModel(TERMS, effects=[side], provenance={'zeros_in_force': ZEROS})
    made.save(tmp_path / 'model.json')
    return tmp_path / 'model.json', made


@pytest.fixture
def run(tmp_path):
    rng = np.random.default_rng(1)
    az, el = rng.uniform(0.0, 6.0, 40), rng.uniform(0.4, 1.3, 40)
    side = rng.choice([-1.0, 1.0], 40)
    az_enc, el_enc = PointingModel(TERMS).sky_to_encoder(az, el)
    write_csv(PointingRun({'az': az, 'el': el, 'az_enc': az_enc + 4.0 * side * ARCSEC,
                           'el_enc': el_enc, 'approach_az': side, 'approach_el': side}),
              tmp_path / 'run.csv')
    return tmp_path / 'run.csv'


@pytest.mark.parametrize('to', ['tpoint', 'table'])
def test_a_file_of_another_program_is_written_with_a_word_on_undetermined_terms(ended, tmp_path,
                                                                                to):
    PointingModel({**TERMS, 'TF': 0.0}, np.eye(6) * ARCSEC**2, undetermined=('IE', 'TF'),
                  directions=[{'TF': 1.0, 'IE': -0.6}]).save(tmp_path / 'model.json')
    code, said, _ = ended('export', tmp_path / 'model.json', tmp_path / 'out.dat', '--to', to)
    assert code == 0
    assert ('undetermined by these stars: IE, TF. TF is held at zero, and IE includes them '
            'here') in ' '.join(said.split())


@pytest.mark.parametrize('to', [*PROGRAMS, 'table', 'model'])
def test_a_file_that_reads_back(ended, model, tmp_path, to):
    out = tmp_path / ('out.yaml' if to == 'model' else 'out.dat')
    code, said, err = ended('export', model[0], out, '--to', to, '--json', tmp_path / 'told.json',
                            '--latitude', '31.5', '--longitude', '-110.9')
    assert code == 0 and not err
    assert '--zero newest adds it to the index terms' in ' '.join(said.split())
    told = json.loads((tmp_path / 'told.json').read_text())
    assert told['program'] == to and Path(told['file']) == out
    bare = PointingModel(TERMS)
    az, el = np.linspace(0.0, 6.0, 50), np.linspace(0.4, 1.3, 50)
    one, other = (m.sky_to_encoder(az, el) for m in (bare, read_model(out).model))
    away = np.hypot(wrap(one[0] - other[0]) * np.cos(el), one[1] - other[1]).max() / ARCSEC
    assert away < {'onstepx': 2.0, 'katpoint': 0.1, 'rts2': 0.1, 'spk': 0.01, 'indi': 0.02}.get(
        to, 1e-3)
    if to in ('table', 'model'):
        assert told['held'] and read_model(out).model.effects
    else:
        assert told['not_held'] == ['azimuth_hysteresis (follows approach_az)']
        assert not told['held']
        assert 'azimuth hysteresis (follows direction of approach)' in ' '.join(said.split())
        assert told['loss']['directions'] == 600


def test_the_loss_is_that_on_the_sky_of_the_run(ended, model, run, tmp_path):
    out = tmp_path / 'out.mod'
    code, said, _ = ended('export', model[0], out, '--to', 'tpoint', '--sky', run, '--json',
                          tmp_path / 'told.json', '--zero', 'newest')
    assert code == 0
    told = json.loads((tmp_path / 'told.json').read_text())
    # what is lost is the hysteresis, four arcseconds on the sky, and nothing else is moved by it
    assert told['loss']['directions'] == 40
    assert told['loss']['rms_arcsec'] == pytest.approx(4.0, abs=0.01)
    assert 'on the 40 directions of run.csv' in said
    # of the direction nothing is lost
    assert told['elsewhere']['directions'] == 600 and told['elsewhere']['max_arcsec'] < 1e-3
    assert 'on a uniform sky above 20 degrees: 0.000 arcsec RMS' in ' '.join(said.split())
    values = {row['name']: row['value'] for row in told['terms']}
    assert values['IA'] == pytest.approx(512.0, abs=0.1)
    assert values['IE'] == pytest.approx(81.0, abs=0.1)
    assert out.read_text().splitlines()[1].split()[:2] == ['T', '40']


def test_what_is_held_is_said_to_be(ended, tmp_path):
    PointingModel(TERMS).save(tmp_path / 'm.json')
    code, said, _ = ended('export', tmp_path / 'm.json', tmp_path / 'm.mod', '--to', 'tpoint')
    assert code == 0
    assert 'TPOINT reproduces the model within 0.0001 arcsec on a uniform sky' in said
    assert 'read to first order at the encoder angles (pytelpoint and others): off by' in said


@pytest.mark.parametrize('options, words', [
    (['out.json', '--to', 'tpoint'], '.json and .yaml are'),
    (['out.mod', '--to', 'model'], '.json and .yaml are'),
    (['model.json', '--to', 'model'], 'is the input itself'),
    (['out.mod', '--to', 'maxpoint'], 'maxpoint'),
    (['out.mod', '--to', 'tpoint', '--zero', '7'], 'no zero of run 7; it has: 1'),
    (['out.mod', '--to', 'tpoint', '--zero', 'all'], 'write newest, none'),
    (['out.mod', '--to', 'tpoint', '--start', '0'], '--start applies to runs'),
    (['out.mod', '--to', 'tpoint', '--sky', 'model.json'], 'model.json'),
    (['nowhere/out.mod', '--to', 'tpoint'], 'no such folder'),
    (['out.xml', '--to', 'indi'], 'give the site'),
    (['out.xml', '--to', 'indi', '--latitude', '31'], 'give --latitude and --longitude'),
    (['out.csv', '--zero', 'newest'], '--zero applies to models: name the program with --to'),
])
def test_bad_input_is_one_line(refused, model, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    assert words in refused('export', 'model.json', *options)


def test_a_german_mount_from_the_fit_to_the_encoders(ended, refused, tmp_path):
    """Fit with TPOINT's terms, export, apply and back, on both sides of the pier."""
    from pointing_model.mounts import Mount
    from pointing_model.runs.model_files.transfer import uniform_sky
    mount = Mount.equatorial(np.radians(33.3), 'german')
    terms = {'IH': 212.0, 'ID': -131.0, 'CH': 44.0, 'NP': -18.0, 'MA': 30.0, 'ME': -64.0}
    model = PointingModel({n: v * ARCSEC for n, v in terms.items()}, mount=mount)
    sky = uniform_sky(80, mount)
    ha_enc, dec_enc = model.sky_to_encoder(sky.az, sky.el)
    rng = np.random.default_rng(2)
    write_csv(PointingRun({'az': sky.az, 'el': sky.el, 'az_enc': ha_enc + rng.normal(
        size=80) * ARCSEC, 'el_enc': dec_enc + rng.normal(size=80) * ARCSEC}, {'mount': mount}),
        tmp_path / 'run.csv')
    here = ['--mount', 'german', '--latitude', '33.3']
    (tmp_path / 'tcs.mod').write_text('caption\nT 9 1.0 0.0 0.0\n' + ''.join(
        f'  {name:8}+1.0000 0.1\n' for name in terms) + 'END\n')
    code, said, err = ended('fit', tmp_path / 'run.csv', *here, '--base', tmp_path / 'tcs.mod',
                            '--save', tmp_path / 'new.json')
    assert code == 0, err
    new = PointingModel.load(tmp_path / 'new.json')
    assert new.mount == mount and {n: v / ARCSEC for n, v in new.terms.items()} == pytest.approx(
        terms, abs=2.5)
    code, said, err = ended('export', tmp_path / 'new.json', tmp_path / 'new.mod', '--to',
                            'tpoint', '--sky', tmp_path / 'run.csv')
    assert code == 0, err
    said = ' '.join(said.split())
    assert 'TPOINT reproduces the model' in said and 'directions of run.csv' in said
    (tmp_path / 'in.csv').write_text('ha_deg,dec_deg\n-20,30\n160,150\n')
    code, out, err = ended('apply', tmp_path / 'new.mod', tmp_path / 'in.csv', *here)
    assert code == 0 and out.splitlines()[0] == 'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg'
    expected = new.sky_to_encoder(np.radians([-20.0, 160.0]), np.radians([30.0, 150.0]))
    got = np.array([[float(c) for c in line.split(',')[2:]] for line in out.splitlines()[1:]])
    np.testing.assert_allclose(np.radians(got.T), expected, atol=0.001 * ARCSEC)
    (tmp_path / 'there.csv').write_text(out)
    code, out, err = ended('apply', tmp_path / 'new.mod', tmp_path / 'there.csv', '--reverse',
                           *here)
    back = np.array([[float(c) for c in line.split(',')[4:]] for line in out.splitlines()[1:]])
    np.testing.assert_allclose(back, [[-20.0, 30.0], [160.0, 150.0]], atol=1e-9)
    assert 'say so (--mount' in refused('apply', tmp_path / 'new.mod', tmp_path / 'in.csv')


def test_a_database_without_a_side_is_of_one_side(ended, refused, tmp_path):
    """INDI has one CH and no NP: of both sides only where they are nothing."""
    from pointing_model.mounts import Mount
    mount, place = Mount.equatorial(np.radians(48.0), 'german'), tmp_path / 'out.xml'
    where = ('--to', 'indi', '--latitude', '48', '--longitude', '11', '--overwrite')

    def written(name, sides=None, **terms):
        values = {'IH': 60.0, 'ID': 0.0, 'CH': 0.5, 'NP': -0.5, 'MA': 45.0, 'ME': -70.0, **terms}
        PointingModel({n: v * ARCSEC for n, v in values.items()}, np.eye(6) * ARCSEC**2,
                      mount=mount, sides=sides).save(tmp_path / name)
        return tmp_path / name
    large = written('large.json', CH=35.0)
    line = refused('export', large, place, *where)
    assert 'CH is +35.0 +- 1.0 arcsec. Write one file per side (--side east' in line
    code, said, _ = ended('export', large, place, *where, '--side', 'west')
    assert code == 0 and 'west of the pier' in said and 'loss: 0.' in said
    code, said, _ = ended('export', written('small.json'), place, *where)
    assert code == 0 and 'CH and NP are within one sigma of zero' in said and 'loss: 0.' in said
    # all rows of the fit on one side: that side
    code, said, _ = ended('export', written('one.json', (30, 0), CH=35.0), place, *where)
    assert code == 0 and 'valid on the east side of the pier only' in ' '.join(said.split())
    assert 'leave it out' in refused('export', large, tmp_path / 'a.mod', '--to', 'tpoint',
                                     '--side', 'east')
