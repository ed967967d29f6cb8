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

"""The commands on runs of mounts that are no alt-azimuth ones."""

import json

import numpy as np
import pytest
from sides import NAMES, a_run

from calibration.analysis.diagnosis.prediction import predictive_model
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.mounts import Mount
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run


@pytest.fixture(scope='module')
def german_csv(tmp_path_factory):
    """Forty stars on both sides, with an oval disc."""
    rng = np.random.default_rng(2)
    mount = Mount.equatorial(31.0 * DEG, 'german')
    az, el = rng.uniform(0.0, 6.2, 40), np.arcsin(rng.uniform(0.35, 0.99, 40))
    h, _ = mount.axes_of(az, el)
    a, e = mount.axes_of(az, el, h < 0.0)
    terms = {'IH': 200 * ARCSEC, 'ID': -80 * ARCSEC, 'CH': 60 * ARCSEC, 'ME': 90 * ARCSEC}
    reading = np.array(geometry.sky_to_encoder(a, e, terms, mount))
    reading[0] += 12.0 * ARCSEC * np.sin(2.0 * a + 0.5)
    reading += ARCSEC * rng.normal(size=(2, 40)) / [np.abs(np.cos(e)), np.ones(40)]
    path = tmp_path_factory.mktemp('german') / 'german.csv'
    write_csv(PointingRun({'az': a, 'el': e, 'az_enc': reading[0], 'el_enc': reading[1]},
                          {'mount': mount}), path)
    return path


def test_fit_prints_the_terms_of_the_mount(ended, german_csv, tmp_path, monkeypatch):
    monkeypatch.setitem(predictive_model.__kwdefaults__, 'folds', 3)
    monkeypatch.setattr('calibration.analysis.diagnosis.prediction.BLOCKS', 3)
    model, figures = tmp_path / 'model.json', tmp_path / 'fit.json'
    _, out, _ = ended('fit', german_csv, '--predict', '--verbose', '--save', model, '--json',
                      figures)
    for word in ('IH', 'MA', 'TF', ' ha ', ' dec ', 'Parts of the prediction',
                 'validated by blocks of time, prediction', 'No cause is claimed'):
        assert word in out, word
    assert json.loads(model.read_text())['mount']['kind'] == 'german'
    # all keys are there, whatever was asked
    found = json.loads(figures.read_text())
    ended('fit', german_csv, '--json', figures, '--overwrite')
    plain = json.loads(figures.read_text())
    assert plain['mount_axes'] == ['hour angle', 'declination'] and plain['rows_used'] == 40
    assert plain['predicted'] is plain['harmonics'] is plain['base_model'] is None
    values = {term['name']: term['value_arcsec'] for term in plain['terms']}
    assert values['ME'] == pytest.approx(90.0, abs=15.0)
    assert plain['after']['rms_arcsec'] < plain['after']['cv_rms_arcsec'] < 20.0
    assert set(found) == set(plain)
    assert found['predicted']['after']['cv_rms_arcsec'] < found['after']['rms_arcsec']
    assert 'HHSH2' in {c['tpoint'] for c in found['predicted']['coefficients']}
    wrong = tmp_path / 'exchanged.csv'
    text = german_csv.read_text().replace('dec_deg', 'x').replace('ha_deg', 'dec_deg')
    wrong.write_text(text.replace('x,', 'ha_deg,', 1) if ',x' not in text else
                     text.replace(',x', ',ha_deg', 1))
    code, _, err = ended('fit', wrong, '--json', figures, '--overwrite')
    assert code == 2 and 'exchanged' in err
    refused = json.loads(figures.read_text())
    assert set(refused) | {'mount', 'mount_axes'} == set(plain) and refused['readings']


@pytest.mark.usefixtures('short_diagnosis')
def test_diagnose_names_the_axis(ended, german_csv, tmp_path):
    _, out, _ = ended('diagnose', german_csv, '--json', tmp_path / 'found.json')
    assert 'hour angle encoder, 2 per turn' in out
    assert json.loads((tmp_path / 'found.json').read_text())['base_terms'][0] == 'IH'


def test_what_does_not_go_together_is_one_line(refused, german_csv, tmp_path):
    assert 'an alt-azimuth mount are az_enc_deg' in refused(
        'fit', german_csv, '--mount', 'altaz')
    assert 'dobson' in refused('fit', german_csv, '--mount', 'dobson')
    assert '--harmonics' in refused('fit', german_csv, '--predict', '--harmonics', 'zenith')
    bare = tmp_path / 'bare.csv'
    bare.write_text('\n'.join(line for line in german_csv.read_text().splitlines()
                              if not line.startswith('#')))
    assert 'needs the latitude' in refused('fit', bare, '--mount', 'german')
    assert '--latitude DEG' in refused('fit', bare, '--longitude', '31')


def test_half_a_site_goes_with_the_half_that_the_file_tells(ended, refused, german_csv, tmp_path):
    rows = [line for line in german_csv.read_text().splitlines() if not line.startswith('#')]
    half = tmp_path / 'half.csv'
    half.write_text('\n'.join(['# mount: german', '# longitude_deg: 7.0', *rows]))
    code, out, err = ended('fit', half, '--latitude', 31.0, '--save', tmp_path / 'model.json')
    assert (code, err) == (0, '') and 'IH' in out
    half.write_text('\n'.join(['# mount: german', '# latitude_deg: 31.0', *rows]))
    assert ended('fit', half, '--longitude', 7.0, '--height', 100)[0] == 0
    assert read_run(half, site={'longitude': 0.1}).meta['site'] == {
        'latitude': 31.0 * DEG, 'longitude': 0.1}
    places = tmp_path / 'places.csv'
    places.write_text('# latitude_deg: 31\nra_deg,dec_deg,time,az_enc_deg,el_enc_deg\n'
                      '10,20,1700000000,30,40\n')
    assert 'longitude is missing' in refused('fit', places)
    assert read_run(places, site={'longitude': 0.1}).meta['site']['latitude'] == 31.0 * DEG


def test_a_fit_says_whether_the_errors_go_through_the_pole(ended, tmp_path):
    for kind, words in (('mount', 'the errors are of the mount, on both sides of the pier: '),
                        ('sky', 'the errors are on the sky, the same on both sides of the pier: ')):
        run, terms = a_run(kind, 7)
        write_csv(run, tmp_path / f'{kind}.csv')
        code, out, _ = ended('fit', tmp_path / f'{kind}.csv', '--terms', ','.join(NAMES),
                             '--verbose', '--json', tmp_path / f'{kind}.json')
        assert code == 0 and f'sides of the pier: {words}' in ' '.join(out.split())
        told = json.loads((tmp_path / f'{kind}.json').read_text())['origin_of_errors']
        assert told['holds'] == kind and told['rows_through_the_pole'] == 20
        found = {row['name']: row['value_arcsec'] for row in told['terms'][kind]}
        assert found['CH'] == pytest.approx(terms['CH'] / ARCSEC, abs=3.0)
