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

"""The nodes of the bridge in a graph, at a server that says what the test wants."""

import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')

from fake_server import TELESCOPE, FakeServer, number

from msg_tools import convert, topics
from msg_tools.params import BadInput
from msg_tools.units import DEG
from pointing_model.sky.places import sidereal_time
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.bridges.indi.indi_mount_node import IndiMount
from telescope_mount.bridges.indi.indi_sky_node import IndiSky
from telescope_mount.bridges.indi.indi_telescope import SIMULATOR

JOINTS = 'hour_angle', 'declination'


@pytest.fixture
def server():
    info = ('<defText name="DRIVER_INTERFACE">5</defText>',
            f'<defText name="DRIVER_INTERFACE">5</defText><defText name="DRIVER_EXEC">{SIMULATOR}'
            '</defText>')
    with FakeServer(TELESCOPE.replace(*info)) as served:
        yield served


def test_the_mount_tells_its_axes_follows_a_command_stops_and_says_what_is_lost(graph, server):
    got = graph.listen(topics.INCREMENTAL)
    commands = graph.publisher(topics.COMMAND)
    graph.add(IndiMount, port=server.port, mount='german')
    graph.connect()
    graph.wait_for(lambda: len(got) > 1, 'readings')
    assert tuple(got[-1].name) == JOINTS
    assert np.array(got[-1].position) / DEG == pytest.approx((45.0, 30.0))
    assert graph.call('home').message.startswith('the zero is that of the driver')
    angles = np.tile(np.array([50.0, 20.0]) * DEG, (2, 1))
    commands.publish(convert.trajectory(time.time_ns(), [0.0, 60.0], angles, 0.0 * angles, JOINTS))
    graph.wait_for(lambda: any('EQUATORIAL_EOD_COORD' in text for text in server.got), 'a slew')
    commands.publish(convert.trajectory(time.time_ns(), [0.0, 60.0], angles, 0.0 * angles))
    graph.report('indi_mount', '1 messages refused')
    commands.publish(convert.trajectory(time.time_ns(), [0.0, 0.1], angles, 0.0 * angles, JOINTS))
    graph.wait_for(lambda: any('"ABORT">On' in text for text in server.got), 'the abort sent')
    server.drop()
    graph.report('indi_mount', 'is lost')


def test_a_kind_of_mount_that_cannot_be_driven_is_refused(graph):
    with pytest.raises((BadInput, ValueError), match='cannot command the axes of a free mount'):
        graph.add(IndiMount, mount='free:0,0')


def test_the_sky_is_that_of_a_simulator_at_its_ticks(graph, server):
    frames = graph.listen(topics.MISS_DISTANCE)
    node = graph.add(IndiSky, port=server.port, mount='german', field_deg=5.0, rate_hz=20.0)
    graph.wait_for(lambda: node._source.ticks.telescope, 'the telescope')
    lst = sidereal_time(time.time(), DEFAULT_SITE) / DEG / 15.0

    def seen():
        axes = {'PRIMARY': 45.0 + 0.001 * (time.time() % 10.0), 'SECONDARY': 30}
        server.say(number('MOUNT_AXES', axes)
                   + number('EQUATORIAL_EOD_COORD', {'RA': (lst - 3.0) % 24.0, 'DEC': 30}))
        return len(frames) > 1
    graph.wait_for(seen, 'frames')
    assert np.hypot(frames[-1].vector.x, frames[-1].vector.y) < 5.1 * DEG
    assert node.trigger_deactivate().name == 'SUCCESS'
    assert node._source.ticks.telescope and not node._source.on
    graph.report('indi_sky', 'waiting for activation')


def test_what_a_driver_of_a_real_mount_believes_is_not_taken_for_what_is_seen(graph):
    with FakeServer() as real:
        frames = graph.listen(topics.MISS_DISTANCE)
        graph.add(IndiSky, port=real.port, mount='german')
        graph.report('indi_sky', 'Mount reports a computed, not a measured position')
        assert not frames
