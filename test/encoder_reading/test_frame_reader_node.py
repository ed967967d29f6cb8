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

import array
import dataclasses

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from places import ROOT

from encoder_reading.axis_reader import AxisReader
from encoder_reading.design import Design
from encoder_reading.frame_messages import frame_message, read_frame
from encoder_reading.frame_reader_node import DESIGN_PARAMS, PARAMS, FrameReader
from encoder_reading.frame_readings import CORRECTED, EXACT, REJECTED
from encoder_sim.absolute import AbsoluteEncoder
from encoder_sim.absolute_encoder_node import AbsoluteEncoders
from encoder_sim.scenario_file import load_scenario
from msg_tools import convert, topics
from msg_tools.params import BadInput
from msg_tools.units import ARCSEC, wrap

START = 1_768_482_000_000_000_000
ANGLES = np.stack([np.linspace(0.0, 6.2, 45), np.linspace(-0.2, 1.5, 45)], axis=1)
QOS = 'qos_overrides./mount/absolute/frame.subscription.'
EVERY_FRAME = {QOS + 'reliability': 'reliable', QOS + 'depth': 5000}


def rows(messages):
    """Stamps, positions, and all that each message says."""
    read = [convert.read_joints(message) for message in messages]
    return [row[0] for row in read], np.array([row[1] for row in read]), read


@pytest.fixture
def scenario(tmp_path):
    def write(azimuth, elevation):
        path = tmp_path / 'mine.yaml'
        path.write_text(f'based_on: ideal\nabsolute: {{azimuth: {{noise: 2.0, {azimuth}}}, '
                        f'elevation: {{noise: 2.0, {elevation}}}}}')
        return str(path)
    return write


@pytest.mark.parametrize('azimuth, elevation, told', [
    ('ccd_dust: 2', 'missing_bars_percent: 2', {}),
    ('heads: 2, eccentricity_um: 2', '', {'azimuth.heads': 2}),
    ('mounting: reversed', 'geometry: tangent', {'elevation.geometry': 'tangent'}),
    ('method: paper', 'method: paper', {'azimuth.method': 'paper', 'elevation.method': 'paper'}),
    ('method: paper, heads: 2', 'pixels: 2048, code: equation2, bar_pitch_px: 60, blur_px: 8', {
        'azimuth.method': 'paper', 'azimuth.heads': 2, 'elevation.pixels': 2048,
        'elevation.code': 'equation2', 'elevation.bar_pitch_px': 60.0, 'elevation.blur_px': 8.0}),
])
def test_both_ways_give_the_same_angle_to_the_last_bit(graph, scenario, azimuth, elevation, told):
    path = scenario(azimuth, elevation)
    graph.add(AbsoluteEncoders, scenario=path, seed=5, publishes='frames')
    graph.add(FrameReader, **EVERY_FRAME, **told)
    truth = graph.publisher(topics.TRUTH_JOINTS)
    got, poses = graph.listen(topics.ABSOLUTE), graph.listen(topics.ABSOLUTE_POSE)
    graph.connect()
    for i, angle in enumerate(ANGLES):
        truth.publish(convert.joint_state(START + 10**6 * i, angle, [0.01, 0.002]))
    graph.wait_for(lambda: len(got) == len(poses) == len(ANGLES), 'readings of every image')
    stamps, angles, read = rows(got)
    params = load_scenario(path).absolute
    for i, axis in enumerate(convert.AXES):
        device = AbsoluteEncoder(getattr(params, axis), 5, axis)
        own = device.read(np.array(stamps), ANGLES[:, i], rates=[0.01, 0.002][i])
        assert np.array_equal(angles[:, i], own.angle, equal_nan=True)
        assert np.array_equal([row[3][i] for row in read], own.quality)
        np.testing.assert_allclose(
            [pose.pose.covariance[(35, 28)[i]] for pose in poses], own.sigma**2)
        assert np.isfinite(own.angle).mean() > 0.6
    assert stamps == [convert.from_stamp(pose.header.stamp) for pose in poses] == [
        START + 10**6 * i for i in range(len(ANGLES))]
    # an image tells no rate, two of them do
    rates = np.array([row[2] for row in read])
    assert np.isnan(rates[0]).all()
    assert np.array_equal(rates[1:], wrap(np.diff(angles, axis=0)) / 1e-3, equal_nan=True)
    graph.report('frame_reader', '', 'gaps /mount/absolute/frame', 0)


def image(stamp=START, angles=(1.0, 0.5), **changes):
    params = load_scenario('ideal').absolute
    message = frame_message(stamp, [
        AbsoluteEncoder(getattr(params, axis), 1, axis).frames(stamp, angle)[:, 0]
        for axis, angle in zip(convert.AXES, angles)])
    for name, value in changes.items():
        setattr(message, name, value)
    return message


AXES = [AxisReader(Design(), axis) for axis in convert.AXES]


@pytest.mark.parametrize('changes, text', [
    ({'encoding': 'rgb8'}, "image in 'rgb8': need mono8"),
    ({'height': 3}, r'3 rows, 1800 columns: need 2 rows \(a reading head each: 1 of azimuth'),
    ({'width': 1799}, '2 rows, 1799 columns: need .*1800 columns'),
    ({'step': 1700}, '3600 bytes in 2 rows of 1700'),
    ({'step': 1900}, '3600 bytes in 2 rows of 1900'),
    ({'data': array.array('B', bytes(3599))}, '3599 bytes'),
    ({'data': array.array('B')}, '0 bytes'),
    ({'header': topics.ABSOLUTE_FRAME.message().header}, 'without a stamp'),
])
def test_what_is_no_image(changes, text):
    with pytest.raises(ValueError, match=text):
        read_frame(image(**changes), AXES)


def test_padded_rows_and_other_names_of_grey():
    plain = image()
    data = np.frombuffer(plain.data, np.uint8).reshape(2, 1800)
    padded = np.pad(data, ((0, 0), (0, 24)), constant_values=77)
    other = image(step=1824, encoding='8UC1', is_bigendian=1,
                  data=array.array('B', padded.tobytes()))
    stamp, frames = read_frame(other, AXES)
    assert stamp == START
    assert all(np.array_equal(*pair) for pair in zip(frames, read_frame(plain, AXES)[1]))


def test_bad_images_are_counted_and_the_next_is_read(graph):
    """A camera's best effort is heard, whatever it sends."""
    graph.add(FrameReader)
    camera = graph.publisher(topics.ABSOLUTE_FRAME)
    got = graph.listen(topics.ABSOLUTE)
    graph.connect()
    for message in (image(encoding='rgb8'), image(height=1), image(data=array.array('B'))):
        camera.publish(message)
    graph.report('frame_reader', '3 messages refused')
    camera.publish(image(START + 1, [2.0, 0.7]))
    dark = image(START + 2)
    dark.data = array.array('B', bytes(1800)) + dark.data[1800:]
    camera.publish(dark)
    graph.wait_for(lambda: len(got) == 2, 'readings')
    stamps, angles, read = rows(got)
    assert stamps == [START + 1, START + 2]
    assert np.abs(wrap(angles[0] - [2.0, 0.7])).max() < 2 * ARCSEC
    assert [row[3] for row in read] == [(EXACT, EXACT), (REJECTED, EXACT)]
    assert CORRECTED not in read[0][3] and np.isnan(angles[1, 0])
    graph.report('frame_reader', '1 images could not be read', 'azimuth rejected', 1)


def test_a_second_who_reads_is_refused(graph):
    graph.add(FrameReader)
    graph.report('frame_reader', 'waiting for a publisher of /mount/absolute/frame')
    with pytest.raises(BadInput, match='joint_states is published by /mount/frame_reader'):
        graph.add(AbsoluteEncoders, scenario='ideal')
        graph.report('absolute_encoder', 'that it has ended')


def test_frames_alone_need_a_reader(graph):
    graph.add(AbsoluteEncoders, scenario='ideal', publishes='frames')
    graph.report('absolute_encoder', 'waiting for a subscriber of /mount/absolute/frame')
    assert graph.tester.count_publishers(topics.ABSOLUTE.name) == 0


@pytest.mark.parametrize('overrides, text', [
    ({'azimuth.pixels': 100}, 'must be 400 to 16384'),
    ({'elevation.code': 'morse'}, "elevation.code = 'morse': code 'morse' is not one of table"),
    ({'elevation.method': 'sine'}, 'use one of template, paper'),
    ({'azimuth.bar_narrow_mm': 0.149}, 'azimuth encoder: .*cannot be distinguished'),
    ({'azimuth.bar_wide_mm': 0.25}, 'azimuth encoder: bars of 0.25 mm'),
    ({'mount': 'dobson'}, 'use one of altaz, equatorial, german, free'),
    ({'azimuth.pixel': 2000}, 'did you mean azimuth.pixels'),
])
def test_designs_that_cannot_be_read(graph, overrides, text):
    with pytest.raises(ValueError, match=text):
        graph.add(FrameReader, **overrides)


def test_the_parameter_file_of_the_documentation_is_complete():
    import yaml
    text = (ROOT / 'docs' / 'absolute_encoder.md').read_text()
    values = yaml.safe_load(text.split('```yaml')[1].split('```')[0])
    values = values['/**/frame_reader']['ros__parameters']
    flat = {name: values.pop(name) for name in ('mount', 'max_batch')} | {
        f'{axis}.{name}': value for axis, part in values.items() for name, value in part.items()}
    assert flat == {param.name: param.default for param in PARAMS}
    assert all(isinstance(flat[param.name], type(param.default)) for param in PARAMS)


def test_parameters_tell_unit_and_range(graph):
    node = graph.add(FrameReader)
    pitch = node.describe_parameter('elevation.bar_pitch_px')
    assert '[px]' in pitch.description and pitch.read_only
    assert (pitch.floating_point_range[0].from_value, pitch.floating_point_range[0].to_value) == (
        16.0, 200.0)
    assert 'with, against' in node.describe_parameter('azimuth.sense').additional_constraints
    # every field of the drawing can be told, and what is not told is the paper's
    for axis, params in DESIGN_PARAMS.items():
        assert [item for item, _ in params] == list(dataclasses.fields(Design))
        assert node._axes[convert.AXES.index(axis)].design == Design()
    good, reason = graph.set_parameter(node, max_batch=0)
    assert not good and 'Max: 256' in reason
    assert graph.set_parameter(node, max_batch=4) == (True, '')
