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

"""The example for ros2_control: its files agree with `command`; run where it is installed."""

import xml.etree.ElementTree as ET
from importlib.util import find_spec

import pytest
import yaml
from places import ROOT

from msg_tools import convert

EXAMPLE = ROOT / 'examples' / 'ros2_control'
INTERFACES = ('command_interface', 'state_interface')


@pytest.fixture(scope='module')
def parameters():
    document = yaml.safe_load((EXAMPLE / 'controllers.yaml').read_text())
    return {name.rsplit('/', 1)[-1]: value['ros__parameters'] for name, value in document.items()}


@pytest.fixture(scope='module')
def urdf():
    return ET.parse(EXAMPLE / 'mount.urdf').getroot()


def test_each_controller_of_the_manager_is_configured_and_spawned(parameters):
    kinds = {name: value['type'] for name, value in parameters['controller_manager'].items()
             if isinstance(value, dict)}
    assert kinds == {
        'mount_controller': 'joint_trajectory_controller/JointTrajectoryController',
        'joint_state_broadcaster': 'joint_state_broadcaster/JointStateBroadcaster'}
    assert set(parameters) == {'controller_manager', *kinds}
    launch = (EXAMPLE / 'mock_mount.launch.py').read_text()
    assert all(f"'{name}': '" in launch for name in kinds)


def test_joints_and_interfaces_are_those_of_the_hardware_and_of_command(parameters, urdf):
    hardware = {joint.get('name'): {kind: [one.get('name') for one in joint.findall(kind)]
                                    for kind in INTERFACES}
                for joint in urdf.find('ros2_control').findall('joint')}
    controller = parameters['mount_controller']
    assert controller['joints'] == list(convert.AXES) == list(hardware)
    for offered in hardware.values():
        assert offered == {kind: controller[f'{kind}s'] for kind in INTERFACES}
    # a command ends in motion, as the guard's do
    assert controller['allow_nonzero_velocity_at_trajectory_end'] is True
    assert controller['allow_partial_joints_goal'] is False


def test_joints_do_not_wrap(urdf):
    joints = {joint.get('name'): joint for joint in urdf.findall('joint')}
    assert {joint.get('type') for joint in joints.values()} == {'revolute'}
    links = {link.get('name') for link in urdf.findall('link')}
    ends = {joint.find(end).get('link') for joint in joints.values()
            for end in ('parent', 'child')}
    assert ends == links
    low, high = (float(joints['azimuth'].find('limit').get(end)) for end in ('lower', 'upper'))
    assert high - low > 6.3 and set(joints) == set(convert.AXES)


def test_the_mock_hardware_follows_command(graph):
    for module in ('controller_manager', 'launch_ros'):
        if find_spec(module) is None:
            pytest.skip(f'{module} is not installed: it is in no wheel (ros-jazzy-ros2-control, '
                        'ros-jazzy-ros2-controllers)')
    import os
    import subprocess
    import time

    import numpy as np

    from msg_tools import topics
    from msg_tools.topics import Topic
    states = graph.listen(Topic('joint_state_broadcaster/joint_states',
                                'sensor_msgs/msg/JointState', topics.RELIABLE))
    pub = graph.publisher(topics.COMMAND)
    process = subprocess.Popen(['ros2', 'launch', str(EXAMPLE / 'mock_mount.launch.py')], env={
        **os.environ, 'ROS_DOMAIN_ID': str(graph.context.get_domain_id())})
    try:
        graph.wait_for(lambda: states and pub.get_subscription_count(), 'the controllers')
        wanted = [1.0, 0.5]
        pub.publish(convert.trajectory(
            time.time_ns(), [1.0, 2.0], [[0.5, 0.6], wanted], [[0.1, 0.0], [0.0, 0.0]]))

        def there():
            return np.allclose(convert.read_joints(states[-1])[1], wanted, atol=1e-3)
        graph.wait_for(there, 'the axes to arrive')
    finally:
        process.terminate()
        process.wait(30)
