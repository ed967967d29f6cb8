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

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from encoder_reading.frame_readings import CORRECTED, EXACT, REJECTED
from encoder_sim.absolute import AbsoluteEncoder
from encoder_sim.absolute_encoder_node import AbsoluteEncoders
from encoder_sim.scenario_file import load_scenario
from msg_tools import convert, topics
from msg_tools.units import ARCSEC, wrap

START = 1_768_482_000_000_000_000


class Truth:
    """Publishes true angles a millisecond apart, all at once, and waits for the readings."""

    def __init__(self, graph):
        self.graph = graph
        self.pub = graph.publisher(topics.TRUTH_JOINTS)
        self.got = graph.listen(topics.ABSOLUTE)
        self.stamp = START
        graph.connect()

    def __call__(self, angles, answers=None):
        before = len(self.got)
        for angle in angles:
            self.stamp += 10**6
            self.pub.publish(convert.joint_state(self.stamp, angle, [0.0, 0.0]))
        answers = len(angles) if answers is None else answers
        self.graph.wait_for(lambda: len(self.got) >= before + answers, 'readings')
        rows = [convert.read_joints(message) for message in self.got[before:]]
        return (np.array([row[0] for row in rows]), np.array([row[1] for row in rows]),
                np.array([row[3] for row in rows]))


@pytest.fixture
def scenario(tmp_path):
    def write(text):
        path = tmp_path / 'mine.yaml'
        path.write_text('based_on: ideal\n' + text)
        return str(path)
    return write


def test_a_burst_is_read_sample_by_sample(graph, scenario):
    """Noise and reading belong to the stamp, whatever waited with it."""
    path = scenario('absolute: {azimuth: {noise: 2.0}, elevation: {noise: 2.0}}')
    graph.add(AbsoluteEncoders, scenario=path, seed=5)
    truth = Truth(graph)
    angles = np.stack([np.linspace(0.0, 6.0, 150), np.linspace(0.1, 1.5, 150)], axis=1)
    stamps, readings, quality = truth(angles)
    assert np.array_equal(stamps, START + 10**6 * np.arange(1, 151))
    assert (quality == EXACT).all()
    assert np.abs(wrap(readings - angles)).max() < 2 * ARCSEC
    params = load_scenario(path).absolute
    for i, axis in enumerate(convert.AXES):
        device = AbsoluteEncoder(getattr(params, axis), 5, axis)
        assert np.array_equal(readings[:, i], device.read(stamps, angles[:, i]).angle)
    status = graph.report('absolute_encoder', 'ok', 'azimuth exact', 150)
    rows = {row.key: row.value for row in status.values}
    assert rows['elevation exact'] == '150' and rows['azimuth rejected'] == '0'
    assert rows['received /mount/truth/joint_states'] == '150'
    assert rows['gaps /mount/truth/joint_states'] == '0'


def test_quality_and_rejections_are_told(graph, scenario):
    graph.add(AbsoluteEncoders, scenario=scenario(
        'absolute: {azimuth: {ccd_dust: 2}, elevation: {ccd_dust: 40}}'))
    truth = Truth(graph)
    angles = np.full((3, 2), 0.5)
    _, readings, quality = truth(angles)
    assert quality.tolist() == [[CORRECTED, REJECTED]] * 3
    assert np.abs(readings[:, 0] - 0.5).max() < 3 * ARCSEC and np.isnan(readings[:, 1]).all()
    status = graph.report('absolute_encoder', '3 images could not be read', 'elevation rejected', 3)
    rows = {row.key: row.value for row in status.values}
    assert rows['azimuth corrected'] == '3' and rows['azimuth exact'] == '0'


def test_a_true_angle_that_is_none_is_refused(graph):
    graph.add(AbsoluteEncoders, scenario='ideal')
    truth = Truth(graph)
    stamps, readings, _ = truth([[1.0, 0.5], [np.nan, 0.5], [1.2, 0.6]], answers=2)
    assert ((stamps - START) // 10**6).tolist() == [1, 3]
    assert np.abs(readings - [[1.0, 0.5], [1.2, 0.6]]).max() < ARCSEC
    graph.report('absolute_encoder', '1 messages refused')


def test_images_have_a_row_for_each_head_and_a_rate(graph, scenario):
    node = graph.add(AbsoluteEncoders, scenario=scenario('absolute: {azimuth: {heads: 2}}'))
    truth = Truth(graph)
    images = graph.listen(topics.ABSOLUTE_FRAME, depth=100)
    graph.connect()
    truth(np.full((5, 2), 0.5))
    graph.wait_for(lambda: images)
    assert (images[0].height, images[0].width, images[0].step) == (3, 1800, 1800)
    rows = np.frombuffer(bytes(images[0].data), np.uint8).reshape(3, 1800)
    assert not np.array_equal(rows[0], rows[1])
    params = load_scenario('ideal').absolute.elevation
    stamp = convert.from_stamp(images[0].header.stamp)
    expected = AbsoluteEncoder(params, 1, 'elevation').frames(stamp, 0.5)[0, 0]
    assert np.array_equal(rows[2], expected)
    # ten a second of the stamps' time: the other four of the burst came too early
    assert graph.set_parameter(node, frame_rate_hz=0.0) == (True, '')
    truth(np.full((3, 2), 0.5))
    graph.wait_for(lambda: len(images) >= 4)
    stamps = [convert.from_stamp(image.header.stamp) - START for image in images]
    assert [stamp // 10**6 for stamp in stamps] == [1, 6, 7, 8]


@pytest.mark.parametrize('values', [
    {'max_batch': 0}, {'max_batch': 1000}, {'frame_rate_hz': -1.0}, {'max_rate_hz': 1e5}])
def test_wrong_parameters_are_refused_with_a_reason(graph, values):
    node = graph.add(AbsoluteEncoders, scenario='ideal')
    good, reason = graph.set_parameter(node, **values)
    assert not good and reason
    assert graph.set_parameter(node, max_batch=4) == (True, '')
