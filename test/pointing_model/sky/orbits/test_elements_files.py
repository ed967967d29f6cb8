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

"""Elements in files: two lines, messages in all their shapes, several sets."""

import json

import numpy as np
import pytest

from pointing_model.sky.elements import GPS_26690, parse_elements
from pointing_model.sky.orbits.orbit_files import Orbits

MESSAGE = {
    'OBJECT_NAME': 'USA 156', 'OBJECT_ID': '2001-004A', 'CENTER_NAME': 'EARTH',
    'REF_FRAME': 'TEME', 'TIME_SYSTEM': 'UTC', 'MEAN_ELEMENT_THEORY': 'SGP4',
    'EPOCH': '2013-09-21T07:54:50.416416', 'MEAN_MOTION': '2.00567355', 'ECCENTRICITY': '.0147879',
    'INCLINATION': '53.1031', 'RA_OF_ASC_NODE': '214.8630', 'ARG_OF_PERICENTER': '241.2580',
    'MEAN_ANOMALY': '4.0622', 'NORAD_CAT_ID': '26690', 'MEAN_MOTION_DOT': '-.00000016'}
GPS = parse_elements(GPS_26690)
XML = ('<omm><body><segment><metadata>%s</metadata><data><meanElements>%s</meanElements>'
       '</data></segment></body></omm>')


def _xml():
    tags = [f'<{key}>{value}</{key}>' for key, value in MESSAGE.items()]
    return XML % (''.join(tags[:6]), ''.join(tags[6:]))


@pytest.mark.parametrize('text', [
    '\n'.join(['GPS', *GPS_26690]), json.dumps([MESSAGE]), _xml(),
    ','.join(MESSAGE) + '\n' + ','.join(MESSAGE.values()),
    'CCSDS_OMM_VERS = 2.0\n' + '\n'.join(f'{key} = {value}' for key, value in MESSAGE.items()),
], ids=['lines', 'json', 'xml', 'csv', 'keywords'])
def test_all_shapes_give_one_orbit(tmp_path, text):
    (tmp_path / 'gps.txt').write_text(text)
    found = Orbits([tmp_path / 'gps.txt']).orbit('26690')
    time = GPS.epoch + np.array([-3600.0, 0.0, 86400.0])
    assert np.abs(found.itrf(time) - GPS.itrf(time)).max() < 5.0
    assert not found.precise and 400.0 <= found.sigma(GPS.epoch) < 401.0


def test_the_nearest_of_several_sets_counts(tmp_path):
    later = MESSAGE | {'EPOCH': '2013-09-23T07:54:50.416416', 'MEAN_ANOMALY': '14.0622'}
    (tmp_path / 'both.json').write_text(json.dumps([later, MESSAGE]))
    found = Orbits([tmp_path / 'both.json']).orbit()
    time = GPS.epoch + np.array([0.0, 1.9 * 86400.0])
    near = np.linalg.norm(found.itrf(time) - GPS.itrf(time), axis=1)
    assert near[0] < 5.0 and near[1] > 1e5
    assert found.sigma(time)[1] < 420.0


@pytest.mark.parametrize(('change', 'message'), [
    ({'MEAN_ANOMALY': ''}, 'the elements of USA 156 lack MEAN_ANOMALY'),
    ({'REF_FRAME': 'EME2000'}, 'are in EME2000, UTC; SGP4 takes TEME, UTC'),
    ({'INCLINATION': 'x'}, 'the elements of USA 156: could not convert string'),
])
def test_a_bad_message_is_one_line(tmp_path, change, message):
    (tmp_path / 'gps.json').write_text(json.dumps(MESSAGE | change))
    with pytest.raises(ValueError, match=message):
        Orbits([tmp_path / 'gps.json'])
