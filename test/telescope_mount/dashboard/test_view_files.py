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

"""Layout of Foxglove and configuration of RViz: they name topics that there are, by their types."""

import json
import re

import numpy as np
import pytest
import yaml
from places import ROOT

from msg_tools import NAMESPACE, topics
from msg_tools.bag import BagReader
from msg_tools.units import ARCSEC
from pointing_model.mount_shape import ROOT as FRAME
from telescope_mount.dashboard.graph_state import full_name
from telescope_mount.graph import NIGHT, NODES

CONFIG = ROOT / 'config'
BY_NAME = {full_name(NAMESPACE, topic): topic for topic in (
    *topics.ALL, topics.ROBOT_DESCRIPTION, topics.JOINTS, topics.MARKERS)}
#: fields that the paths of series lead to, of each type of message
FIELDS = {'geometry_msgs/msg/Vector3Stamped': ('vector.x', 'vector.y'),
          'sensor_msgs/msg/JointState': ('position[0]', 'position[1]'),
          'diagnostic_msgs/msg/DiagnosticStatus': ('message',)}


def panels(content):
    if content['type'] == 'panel':
        yield content
    for item in content.get('items', ()):
        yield from panels(item['content'])


@pytest.fixture(scope='module')
def layout():
    return json.loads((CONFIG / 'foxglove_layout.json').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def script(layout):
    (one,) = layout['userScripts'].values()
    return one['sourceCode']


def test_series_lead_to_fields_of_topics_that_there_are(layout, script):
    made = re.search(r'export const output = "(.+)"', script)[1]
    columns = re.search(r'type Output = \{(.+)\}', script)[1]
    plotted = set()
    for panel in panels(layout['content']):
        for series in panel['config'].get('paths', ()):
            name, path = re.fullmatch(r'(/[\w/]+)\.(.+)', series['value']).groups()
            if name == full_name(NAMESPACE, topics.CALIBRATION_FIGURES):
                continue  # test_plots looks into a night for these
            plotted.add(name)
            if name == made:
                assert f'{path}: number' in columns
                continue
            field, _, factor = path.partition('.@mul(')
            assert field in FIELDS[BY_NAME[name].type], series
            if panel['panelType'] == 'Plot':  # rad to arcsec
                up = -1.0 if field == 'vector.y' else 1.0  # messages have y down
                assert np.isclose(float(factor.rstrip(')')), up / ARCSEC, rtol=1e-8)
    own = {full_name(NAMESPACE, topic) for topic in (
        topics.MISS_DISTANCE, topics.OFFSET, topics.GUARD_STATUS,
        topics.OBSERVER_STATUS, topics.CALIBRATION_STATUS, topics.CALIBRATION_RESIDUAL)}
    assert plotted == own | {made}


def test_the_script_listens_to_both_encoders(script):
    inputs = json.loads(re.search(r'export const inputs = (\[.+\])', script)[1])
    assert inputs == [full_name(NAMESPACE, topic)
                      for topic in (topics.INCREMENTAL, topics.ABSOLUTE)]
    assert set(re.findall(r'"(/mount/[\w/]+)"', script)) == set(inputs)


def test_panels_of_foxglove(layout):
    by_kind = {panel['panelType']: panel['config'] for panel in panels(layout['content'])}
    scene = by_kind['ThreeDee']
    assert scene['followTf'] == scene['fixedFrame'] == FRAME
    assert {name: BY_NAME[name].type for name in scene['topics']} == {
        '/mount/markers': 'visualization_msgs/msg/MarkerArray',
        '/mount/observations': 'sensor_msgs/msg/PointCloud2',
        '/mount/calibration/residuals': 'sensor_msgs/msg/PointCloud2'}
    model = scene['layers']['model']
    assert BY_NAME[model['topic']] is topics.ROBOT_DESCRIPTION
    assert BY_NAME[model['jointStatesTopic']] is topics.JOINTS
    summary = next(config for kind, config in by_kind.items() if kind.startswith('Diagnostic'))
    assert BY_NAME[summary['topicToRender']] is topics.DIAGNOSTICS
    # of every rclpy node, rcl_interfaces/msg/Log
    assert next(config for config in by_kind.values()
                if 'minLogLevel' in config)['topicToRender'] == '/rosout'


def test_displays_of_rviz():
    document = yaml.safe_load((CONFIG / 'telescope_mount.rviz').read_text(encoding='utf-8'))
    manager = document['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == FRAME
    types = {'MarkerArray': topics.MARKERS, 'RobotModel': topics.ROBOT_DESCRIPTION,
             'PointCloud2': topics.OBSERVATIONS}
    found = set()
    for display in manager['Displays']:
        assert display['Enabled'] is True and display['Value'] is True
        kind = display['Class'].removeprefix('rviz_default_plugins/')
        heard = display.get('Topic') or display.get('Description Topic')
        if heard is None:
            assert kind in ('Grid', 'Axes')
            continue
        topic = BY_NAME[heard['Value']]
        assert types[kind] is topic
        # one that asks for less gets nothing that was latched, for more gets nothing at all
        assert (heard['Durability Policy'] == 'Transient Local') is topic.latched
        assert heard['Reliability Policy'] == 'Reliable' and topic.quality.reliable
        found.add(kind)
    assert found == set(types)


# --- diagnostic_aggregator ----------------------------------------------------------------------


def groups_of(name):
    """Analyzers of the aggregator that take a status: the rule of its GenericAnalyzer."""
    text = (CONFIG / 'diagnostic_aggregator.yaml').read_text(encoding='utf-8')
    analyzers = [value for value in yaml.safe_load(text)['/**']['ros__parameters'].values()
                 if isinstance(value, dict)]
    assert {one['type'] for one in analyzers} == {'diagnostic_aggregator/GenericAnalyzer'}
    return [one['path'] for one in analyzers if any(part in name for part in one['contains'])]


def test_the_aggregator_has_one_group_for_each_node():
    assert {name: len(groups_of(f'/north/{name}')) for name in NODES} == dict.fromkeys(NODES, 1)
    assert groups_of('/north/disk') == []


def test_the_aggregator_knows_each_status_of_a_night(night):
    told = {status.name for message in BagReader(night / 'bag').messages(
        '/diagnostics', decode=True) for status in message.data.status}
    assert len(told) >= len(NIGHT)
    assert [name for name in told if len(groups_of(name)) != 1] == []
