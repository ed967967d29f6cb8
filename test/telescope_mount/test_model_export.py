"""The command ``export --to``: a model as another program reads it."""

import json
from pathlib import Path

import numpy as np
import pytest

from msg_tools.units import ARCSEC, wrap
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.model_files import read_model
from pointing_model.run import PointingRun
from pointing_model.run_files import write_csv

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


@pytest.mark.parametrize('to', ['tpoint', 'katpoint', 'rts2', 'spk', 'indi', 'onstepx', 'table',
                                'model'])
def test_a_file_that_reads_back(ended, model, tmp_path, to):
    out = tmp_path / ('out.yaml' if to == 'model' else 'out.dat')
    code, said, err = ended('export', model[0], out, '--to', to, '--json', tmp_path / 'told.json',
                            '--latitude', '31.5', '--longitude', '-110.9')
    assert code == 0 and not err
    assert '--zero newest adds it to the indices' in ' '.join(said.split())
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
        assert 'azimuth_hysteresis (follows approach_az)' in said and not told['held']
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
    assert 'TPOINT computes what the model does, to 0.0001 arcsec at most on a uniform sky' in said
    assert 'read to first order at the encoder angles (pytelpoint and others): off by' in said


@pytest.mark.parametrize('options, words', [
    (['out.json', '--to', 'tpoint'], 'is a model of ours'),
    (['out.mod', '--to', 'model'], 'is a model of ours'),
    (['model.json', '--to', 'model'], 'written over the model'),
    (['out.mod', '--to', 'maxpoint'], 'maxpoint'),
    (['out.mod', '--to', 'tpoint', '--zero', '7'], 'no zero of run 7; it has: 1'),
    (['out.mod', '--to', 'tpoint', '--zero', 'all'], 'write newest, none'),
    (['out.mod', '--to', 'tpoint', '--start', '0'], '--start is of runs'),
    (['out.mod', '--to', 'tpoint', '--sky', 'model.json'], 'model.json'),
    (['nowhere/out.mod', '--to', 'tpoint'], 'no such folder'),
    (['out.xml', '--to', 'indi'], 'give the site'),
    (['out.xml', '--to', 'indi', '--latitude', '31'], 'needs --latitude and --longitude'),
    (['out.csv', '--zero', 'newest'], '--zero is of models: say the program with --to'),
])
def test_bad_input_is_one_line(refused, model, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    assert words in refused('export', 'model.json', *options)
