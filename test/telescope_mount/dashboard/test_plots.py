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

"""Each series that the layouts of PlotJuggler and Foxglove name is in the log of a night."""

import json
import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from places import ROOT

from msg_tools.bag import BagReader
from msg_tools.cloud_tables import cloud_to_table
from msg_tools.units import ARCSEC

pytestmark = pytest.mark.usefixtures('ros_domain')
PLOTJUGGLER = ElementTree.parse(ROOT / 'config' / 'plotjuggler_layout.xml')
FIGURES = re.compile(r'(/[\w/]+)\.status\[:\]\{name=="(.+)"\}\.values\[:\]\{key=="(.+)"\}\.value')


def numbers_of(message):
    """Name and number of each series that PlotJuggler makes of a message, by its own rules.

    Of a DiagnosticArray group and key (texts that are numbers), of a JointState the joint, of
    others the path of the field; no points of a cloud.
    """
    data, topic = message.data, message.topic
    if message.type == 'diagnostic_msgs/msg/DiagnosticArray':
        for status in data.status:
            for row in status.values:
                try:
                    yield f'{topic}/{status.name}/{row.key}', float(row.value)
                except ValueError:
                    continue
    elif message.type == 'sensor_msgs/msg/JointState':
        for i, joint in enumerate(data.name):
            for field in ('position', 'velocity', 'effort'):
                yield f'{topic}/{joint}/{field}', getattr(data, field)[i]
    elif message.type == 'geometry_msgs/msg/Vector3Stamped':
        for axis in 'xyz':
            yield f'{topic}/vector/{axis}', getattr(data.vector, axis)


@pytest.fixture(scope='module')
def series(night):
    """Of each series the numbers."""
    out = {}
    for message in BagReader(night / 'bag').messages(decode=True):
        for name, value in numbers_of(message):
            if math.isfinite(value):
                out.setdefault(name, []).append(value)
    return out


def test_plotjuggler_finds_each_series(series):
    made = {one.get('name'): one for one in PLOTJUGGLER.iter('snippet')}
    curves = [curve.get('name') for curve in PLOTJUGGLER.iter('curve')]
    assert len(curves) == len(set(curves)) >= 30 and set(made) <= set(curves)
    sources = [made[name].findtext('linked_source') if name in made else name for name in curves]
    assert [name for name in sources if not series.get(name)] == []
    for one in made.values():  # rad, y down, to arcsec, up
        factor = float(one.findtext('function').removeprefix('return value *'))
        up = -1.0 if one.findtext('linked_source').endswith('/y') else 1.0
        assert np.isclose(factor, up / ARCSEC, rtol=1e-8)
    # terms and zero with their errors, RMS, expected error: all without JSON
    assert {re.sub(r'/(IA|IE|CA|NPAE|AN|AW|TF)/', '/T/', name.split('figures/')[1])
            for name in curves if 'figures/' in name} == {
        'term/T/value_arcsec', 'term/T/sigma_arcsec', 'zero/first_axis_arcsec',
        'zero/second_axis_arcsec', 'zero/first_axis_sigma_arcsec', 'zero/power_on',
        'zero/second_axis_sigma_arcsec', 'expected_error/rms_arcsec',
        'rms/active_model/used/radial_arcsec', 'rms/7_physical_terms/held_out/radial_arcsec'}


def test_foxglove_finds_each_series(series):
    text = (ROOT / 'config' / 'foxglove_layout.json').read_text(encoding='utf-8')
    paths = re.findall(r'"value": "(.*figures\..*)"', text)
    named = ['/'.join(FIGURES.fullmatch(json.loads(f'"{path}"')).groups()) for path in paths]
    vectors = [path.replace('.', '/') for path in re.findall(r'"(/mount/.*\.vector\.[xy])\.', text)]
    assert (len(named), len(vectors)) == (21, 6)
    assert [name for name in named + vectors if not series.get(name)] == []


def test_what_is_left_of_each_star_is_drawn_where_it_stands(night):
    *_, message = BagReader(night / 'bag').messages('/mount/calibration/residuals', decode=True)
    assert [field.name for field in message.data.fields[:3]] == ['x', 'y', 'z']
    table = cloud_to_table(message.data)
    step = message.data.point_step
    rows = np.frombuffer(bytes(message.data.data), np.uint8).reshape(-1, step)
    x, y, z = np.ascontiguousarray(rows[:, :12]).view('<f4').T
    np.testing.assert_allclose(np.arctan2(x, y) % (2 * np.pi), table['azimuth'] % (2 * np.pi),
                               atol=1e-6)
    np.testing.assert_allclose(z, np.sin(table['elevation']), atol=1e-6)
    assert {'residual_right', 'residual_up', 'time'} <= set(table) and len(z) == 16
    # and as series, each at the star's time
    each = [one.data for one in BagReader(night / 'bag').messages(
        '/mount/calibration/residual', decode=True)][-len(z):]
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in each]
    np.testing.assert_allclose(stamps, table['time'], rtol=0.0, atol=1e-6)
    np.testing.assert_array_equal([one.vector.x for one in each], table['residual_right'])
    np.testing.assert_array_equal([-one.vector.y for one in each], table['residual_up'])
