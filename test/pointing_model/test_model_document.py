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

import json

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from test.pointing_model.test_model import make


@pytest.mark.parametrize('suffix', ['json', 'yaml'])
def test_round_trip_to_the_bit(tmp_path, suffix):
    for seed in range(20):
        model = make(seed=seed, reading=['zenith', 'printed', None][seed % 3],
                     geometry=['rotation', 'first_order'][seed % 2])
        model.save(tmp_path / f'm.{suffix}')
        back = PointingModel.load(tmp_path / f'm.{suffix}')
        assert back.terms == model.terms and list(back.terms) == list(model.terms)
        assert np.array_equal(back.covariance, model.covariance)
        assert back.geometry == model.geometry and back.provenance == {'source': 'x'}
        if model.harmonics:
            assert back.harmonics.interpretation == model.harmonics.interpretation
            for name in ('coef_x', 'coef_y', 'covariance'):
                a, b = getattr(back.harmonics, name), getattr(model.harmonics, name)
                assert np.array_equal(a, b)
        assert back.to_json() == model.to_json()


def test_document_is_in_arcsec():
    document = json.loads(PointingModel({'CA': 5 * ARCSEC}, [[4 * ARCSEC**2]]).to_json())
    assert document['format'] == 'telescope_mount/pointing_model' and document['version'] == 1
    assert document['terms'][0]['name'] == 'CA'
    assert document['terms'][0]['value_arcsec'] == pytest.approx(5, rel=1e-14)
    assert document['terms'][0]['sigma_arcsec'] == pytest.approx(2, rel=1e-14)


def broken(**changes):
    document = json.loads(make().to_json())
    document.update(changes)
    return json.dumps({k: v for k, v in document.items() if v != 'DELETE'})


def named(name, value):
    """Harmonics in which one coefficient is changed by its name alone."""
    harmonics = json.loads(make().to_json())['harmonics']
    next(row for row in harmonics['coefficients'] if row['name'] == name)['value_arcsec'] = value
    return harmonics


def test_harmonics_have_the_names_of_the_paper_and_their_sigmas():
    model = make(reading='printed')
    document = json.loads(model.to_json())['harmonics']
    rows = document['coefficients']
    assert [row['name'] for row in rows] == [f'A{i}' for i in range(13)] + [
        f'B{i}' for i in range(13)]
    assert [row['value_arcsec'] for row in rows] == pytest.approx(
        [*document['azimuth_arcsec'], *document['elevation_arcsec']])
    assert [row['sigma_arcsec'] for row in rows] == pytest.approx(
        np.sqrt(np.diag(document['covariance_arcsec2'])))
    # a file from before has no names, and is the same model
    old = json.loads(model.to_json())
    del old['harmonics']['coefficients'], old['harmonics']['degree']
    back = PointingModel.from_json(json.dumps(old))
    assert back.to_json() == model.to_json()
    assert identity(json.dumps(old)) == identity(model.to_json())


@pytest.mark.parametrize('text, word', [
    ('{', 'not JSON'), ('[1]', 'not a pointing model'), ('{"format": "x"}', 'not a pointing'),
    (broken(version=5), 'version 5'), (broken(terms='DELETE'), 'terms'),
    (broken(terms=[{'name': 'QQ', 'value_arcsec': 1}], covariance_arcsec2=[[1]]), 'QQ'),
    (broken(terms=[{'name': 'IA', 'value_arcsec': 'one'}]), 'damaged'),
    (broken(terms=[{'name': 'IA', 'value_arcsec': 1}] * 2), 'twice'),
    (broken(covariance_arcsec2=[[1.0]]), 'damaged'),
    (broken(harmonics={'reading': 'x'}), 'azimuth'),
    (broken(harmonics=named('A3', 7.0)), 'A3 is not what the series of its axis says'),
    (broken(geometry='flat'), 'flat'), (broken(harmonics=[1]), 'damaged'),
    (broken(terms=[{'name': 'IA', 'value_arcsec': float('nan')}], covariance_arcsec2=[[1]]), 'IA'),
])
def test_bad_documents(text, word):
    with pytest.raises(ValueError, match=word) as caught:
        PointingModel.from_json(text)
    assert '\n' not in str(caught.value)


def test_bad_files(tmp_path):
    with pytest.raises(ValueError, match='rename'):
        make().save(tmp_path / 'm.txt')
    (tmp_path / 'm.yaml').write_text('a: [1,\n  b')
    with pytest.raises(ValueError, match='m.yaml.*not YAML') as caught:
        PointingModel.load(tmp_path / 'm.yaml')
    assert '\n' not in str(caught.value)
    with pytest.raises(OSError):
        PointingModel.load(tmp_path / 'none.json')
