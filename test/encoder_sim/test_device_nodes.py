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

from encoder_reading.frame_reader_node import FrameReader
from encoder_sim.absolute_encoder_node import AbsoluteEncoders
from encoder_sim.device_params import Decimator, parse_utc
from encoder_sim.incremental_encoder_node import IncrementalEncoders
from msg_tools import convert, topics
from msg_tools.homing import cloud_to_homing
from msg_tools.power_on import read_power_on
from msg_tools.units import ARCSEC, DEG
from telescope_mount.graph import every_frame

START = 1_768_482_000_000_000_000
COUNT = 1296000.0 / 18_880_000 * ARCSEC
MARKS = np.array([180.0, 45.0]) * DEG
HOMING = MARKS + np.array([[-0.5], [-0.1], [0.1], [0.5]]) * DEG


@pytest.fixture
def drifting(tmp_path):
    """A scenario without any error but the zero drift of the incremental encoders."""
    path = tmp_path / 'drifting.yaml'
    path.write_text('based_on: ideal\nincremental:\n  azimuth: {zero_drift_arcsec: 20.0}\n'
                    '  elevation: {zero_drift_arcsec: 20.0}\n')
    return str(path)


class Axes:
    """Publishes true angles, one second apart, and waits for the readings of them."""

    def __init__(self, graph, topic):
        self.graph = graph
        self.pub = graph.publisher(topics.TRUTH_JOINTS)
        self.got = graph.listen(topic)
        self.said = graph.listen(topics.INCREMENTAL_POWER_ON if topic is topics.INCREMENTAL
                                 else topics.ABSOLUTE_POWER_ON)
        self.stamp = START
        graph.connect()

    def power_on_of(self, message):
        """The last that had begun."""
        assert message.header.frame_id == 'mount_enu'
        return [one for one in map(read_power_on, self.said)
                if one.started <= convert.from_stamp(message.header.stamp) * 1e-9][-1]

    def __call__(self, angles):
        """Readings (n, 2) of true angles (n, 2), rad."""
        before = len(self.got)
        stamps = []
        for angle in np.atleast_2d(angles):
            self.stamp += 10**9
            stamps.append(self.stamp)
            self.pub.publish(convert.joint_state(self.stamp, angle, [0.0, 0.0]))
        self.graph.wait_for(lambda: len(self.got) == before + len(stamps), 'readings')
        rows = [convert.read_joints(message) for message in self.got[before:]]
        assert [row[0] for row in rows] == stamps
        return np.array([row[1] for row in rows])


# --- incremental --------------------------------------------------------------------------------


def test_unknown_until_homed_and_again_after_power_off(graph, drifting):
    graph.add(IncrementalEncoders, scenario=drifting)
    axes = Axes(graph, topics.INCREMENTAL)
    graph.report('incremental_encoder', 'no zero since power-on: call home', 'azimuth homed', False)
    place = MARKS + [20 * DEG, 10 * DEG]
    assert np.isnan(axes([MARKS - 2 * DEG])).all()
    # one axis at its mark is not enough for the other
    reading = axes([MARKS - 1 * DEG, MARKS + [1 * DEG, -1 * DEG]])[-1]
    assert np.isfinite(reading[0]) and np.isnan(reading[1])
    assert np.isfinite(axes([place])).all()
    graph.report('incremental_encoder', 'ok', 'azimuth homed', True)

    answer = graph.call('power_cycle')
    assert answer.success and 'power-on 2' in answer.message
    before = axes.power_on_of(axes.got[-1])
    assert np.isnan(axes([place])).all()
    assert before == (1, START // 10**9 + 1)
    assert axes.power_on_of(axes.got[-1]) == (2, axes.stamp // 10**9)
    graph.report('incremental_encoder', 'call home', 'power-on', 2)
    assert np.isfinite(axes(HOMING)[-1]).all()


def test_the_zero_drifts_at_each_power_on_as_the_truth_says(graph, drifting):
    graph.add(IncrementalEncoders, scenario=drifting)
    truth = graph.listen(topics.TRUTH_ZERO)
    axes = Axes(graph, topics.INCREMENTAL)
    place = MARKS + [20 * DEG, 10 * DEG]
    drifts = []
    for power_on in range(3):
        if power_on:
            graph.call('power_cycle')
        axes(HOMING)
        drifts.append((axes([place]) - place)[0])
        graph.wait_for(lambda n=power_on: len(truth) == n + 1, 'the truth')
        np.testing.assert_allclose(
            drifts[-1], convert.read_joints(truth[-1])[1], rtol=0, atol=1.01 * COUNT)
    steps = np.abs(np.diff(drifts, axis=0))
    assert (steps > 2 * COUNT).all() and (np.abs(drifts) < 100 * ARCSEC).all()


@pytest.mark.parametrize('node, topic, sigma', [
    (IncrementalEncoders, topics.INCREMENTAL, 1.0), (AbsoluteEncoders, topics.ABSOLUTE, 1.2)])
def test_a_rate_comes_of_readings_not_of_the_truth(graph, node, topic, sigma):
    graph.add(node, scenario='default')
    pub, got = graph.publisher(topics.TRUTH_JOINTS), graph.listen(topic)
    graph.connect()
    rate = np.array([0.25, 0.25]) * DEG
    times = np.arange(-2.0, 3.0, 0.5)
    for t in times:  # the marks are met at 0
        pub.publish(convert.joint_state(START + 10**10 + round(t * 1e9), MARKS + rate * t, rate))
    graph.wait_for(lambda: len(got) == len(times), 'readings')
    rows = [convert.read_joints(message) for message in got]
    angle, told = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    known = np.isfinite(told)
    assert np.array_equal(known[1:], np.isfinite(angle[1:]) & np.isfinite(angle[:-1]))
    assert not known[0].any()
    off = (told - rate)[known] / ARCSEC
    assert 0.01 < np.abs(off).max() < 5 * sigma and len(set(off)) > 2


def test_the_seed_decides_the_drift(graph, drifting):
    found = []
    for seed in (1, 1, 2):
        node = graph.add(IncrementalEncoders, scenario=drifting, seed=seed)
        axes = Axes(graph, topics.INCREMENTAL)
        found.append(axes(HOMING)[-1])
        graph.remove(node)
    assert np.array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])


def test_the_truth_of_the_zero_holds_the_side(graph):
    graph.add(IncrementalEncoders, scenario='wrong_side')
    truth = graph.listen(topics.TRUTH_ZERO)
    axes = Axes(graph, topics.INCREMENTAL)
    above = HOMING.copy()
    above[:, 0] = HOMING[::-1, 0]
    reading = axes(above)[-1]
    graph.wait_for(lambda: truth, 'the truth')
    # eccentricity, subdivision and jitter are left
    np.testing.assert_allclose(
        reading - above[-1], convert.read_joints(truth[0])[1], rtol=0, atol=0.5 * ARCSEC)
    graph.report('incremental_encoder', 'ok', 'azimuth mark met from', 'above')
    graph.report('incremental_encoder', 'ok', 'elevation mark met from', 'below')
    graph.report('incremental_encoder', 'ok', 'azimuth mark width [arcsec]', '3.00')
    rows = {row.key: row.value for row in graph.report('incremental_encoder', 'ok').values}
    volts = float(rows['supply [V]'].split(',')[0])  # 5 V, as a monitor with steps of 4 mV has them
    assert 4.97 < volts < 5.03 and abs(volts / 0.004 - round(volts / 0.004)) < 1e-6


def test_a_missed_mark_is_told(graph):
    graph.add(IncrementalEncoders, scenario='home_too_fast')
    axes = Axes(graph, topics.INCREMENTAL)
    fast = MARKS + np.array([[-2.0], [-1.0], [1.0], [2.0]]) * DEG  # 2 deg/s
    reading = axes(fast)[-1]
    assert np.isnan(reading[0]) and np.isfinite(reading[1])
    graph.report('incremental_encoder', 'azimuth: reference mark missed, pulses too short: 1; pass',
                 'azimuth homed', False)
    graph.report('incremental_encoder', '', 'elevation homed', True)
    assert np.isfinite(axes(HOMING)[-1]).all()
    graph.report('incremental_encoder', 'ok', 'azimuth missed marks', 2)


def test_lost_counts_show_when_the_mark_is_passed_again(graph, tmp_path):
    path = tmp_path / 'lost.yaml'
    path.write_text('based_on: ideal\nincremental:\n  elevation:\n'
                    '    losses: [{at_s: 6.5, counts: 120}]\n')
    graph.add(IncrementalEncoders, scenario=str(path))
    axes = Axes(graph, topics.INCREMENTAL)
    axes(HOMING)
    graph.report('incremental_encoder', 'ok', 'elevation mark error [counts]', 'nan')
    error = axes(np.repeat(MARKS[None] + 1 * DEG, 4, axis=0)) - MARKS - 1 * DEG
    np.testing.assert_allclose(error[-1], [0.0, -120 * COUNT], rtol=0, atol=1.01 * COUNT)
    axes(HOMING)
    graph.report('incremental_encoder', 'elevation: -120 counts off at the reference mark',
                 'elevation mark error [counts]', -120)
    graph.report('incremental_encoder', '', 'azimuth mark error [counts]', 0)


def test_what_others_compute_with_is_told_in_numbers(graph, tmp_path):
    path = tmp_path / 'lost.yaml'
    path.write_text('based_on: wrong_side\nincremental:\n  elevation:\n'
                    '    losses: [{at_s: 6.5, counts: 120}]\n')
    graph.add(IncrementalEncoders, scenario=str(path))
    told = graph.listen(topics.HOMING)
    axes = Axes(graph, topics.INCREMENTAL)
    graph.wait_for(lambda: told, 'the state at the start')  # although it was there before us
    start = cloud_to_homing(told[0])
    assert [(start[axis].homed, start[axis].power_on) for axis in convert.AXES] == [(False, 1)] * 2
    above = HOMING.copy()
    above[:, 0] = HOMING[::-1, 0]
    axes(above)
    axes(np.repeat(MARKS[None] + 1 * DEG, 4, axis=0))
    axes(HOMING)
    graph.wait_for(lambda: np.isfinite(cloud_to_homing(told[-1])['elevation'].mark_error))
    last = cloud_to_homing(told[-1])
    azimuth, elevation = last['azimuth'], last['elevation']
    assert (azimuth.homed, azimuth.side, elevation.side) == (True, 'above', 'below')
    assert elevation.mark_error == pytest.approx(-120.0, abs=3.0)
    assert elevation.count == pytest.approx(COUNT)
    assert azimuth.pulse_width == pytest.approx(3.0 * ARCSEC)
    # of the mark, each axis by instruments of its own
    assert np.isnan(start['azimuth'].supply) and np.isnan(start['azimuth'].temperature)
    assert 4.95 < azimuth.supply < 5.05 and azimuth.supply != elevation.supply
    assert 9.0 < azimuth.temperature < 11.0 and azimuth.temperature != elevation.temperature
    changed = axes.stamp
    axes([MARKS + 2 * DEG] * 3)
    assert graph.call('power_cycle').success
    graph.wait_for(lambda: cloud_to_homing(told[-1])['azimuth'].power_on == 2)
    stamps = [convert.from_stamp(message.header.stamp) for message in told]
    # between the last passage and the power nothing was new
    assert stamps[-1] == axes.stamp and max(stamps[:-1]) <= changed
    off = cloud_to_homing(told[-1])['azimuth']
    assert (off.homed, off.side, off.passages, off.power_on) == (False, '', 0, 2)
    assert np.isnan(off.mark_error)


def test_the_power_fails_as_the_scenario_says(graph, tmp_path):
    path = tmp_path / 'failing.yaml'
    path.write_text('based_on: ideal\nincremental:\n  azimuth: {power_cycles_s: [5.5]}\n'
                    '  elevation: {power_cycles_s: [5.5]}\n')
    graph.add(IncrementalEncoders, scenario=str(path))
    marks = graph.listen(topics.HOMING)
    axes = Axes(graph, topics.INCREMENTAL)
    assert np.isfinite(axes(HOMING)[-1]).all()
    reading = axes(np.repeat(MARKS[None] + 1 * DEG, 4, axis=0))
    assert np.isfinite(reading[0]).all() and np.isnan(reading[1:]).all()
    told = [axes.power_on_of(message) for message in axes.got[-4:]]
    assert [power_on.number for power_on in told] == [1, 2, 2, 2]
    assert [power_on.started - START * 1e-9 for power_on in told] == [1.0, 6.0, 6.0, 6.0]
    graph.wait_for(lambda: marks and cloud_to_homing(marks[-1])['azimuth'].identity == told[1])
    graph.report('incremental_encoder', 'no zero since power-on: call home', 'power-on', 2)
    assert np.isfinite(axes(HOMING)[-1]).all()


def test_bad_angles_are_refused_and_the_next_are_read(graph, drifting):
    graph.add(IncrementalEncoders, scenario=drifting)
    axes = Axes(graph, topics.INCREMENTAL)
    axes(HOMING)
    wrong = convert.joint_state(axes.stamp + 1, [1.0, 1.0])
    wrong.name = ['x', 'y']
    axes.pub.publish(wrong)
    short = convert.joint_state(axes.stamp + 2, [1.0, 1.0])
    short.position = [1.0]
    axes.pub.publish(short)
    place = MARKS + 20 * DEG
    np.testing.assert_allclose(axes([place])[0], place, rtol=0, atol=100 * ARCSEC)
    graph.report('incremental_encoder', '2 messages refused')


@pytest.mark.parametrize('node, topic', [
    (IncrementalEncoders, topics.INCREMENTAL), (AbsoluteEncoders, topics.ABSOLUTE)])
def test_a_sample_that_is_not_a_number_does_no_lasting_harm(graph, node, topic):
    graph.add(node, scenario='ideal')
    axes = Axes(graph, topic)
    axes(HOMING)
    place = MARKS + 20 * DEG
    axes.stamp += 10**9
    axes.pub.publish(convert.joint_state(axes.stamp, [np.nan, np.nan], [np.nan, np.nan]))
    axes.stamp += 10**9
    axes.pub.publish(convert.joint_state(axes.stamp, place, [0.0, 0.0]))
    graph.wait_for(lambda: axes.got and convert.read_joints(axes.got[-1])[0] == axes.stamp)
    np.testing.assert_allclose(
        convert.read_joints(axes.got[-1])[1], place, rtol=0, atol=10 * ARCSEC)


def test_readings_can_be_thinned_at_runtime(graph):
    node = graph.add(IncrementalEncoders, scenario='ideal')
    axes = Axes(graph, topics.INCREMENTAL)
    axes(HOMING)
    assert graph.set_parameter(node, max_rate_hz=-1.0)[0] is False
    assert graph.set_parameter(node, max_rate_hz=0.5) == (True, '')
    first, before = axes.stamp, len(axes.got)
    for i in range(1, 9):
        axes.pub.publish(convert.joint_state(first + i * 10**9, MARKS + i * DEG, [0.0, 0.0]))
    graph.wait_for(lambda: len(axes.got) >= before + 4)
    assert [(convert.read_joints(m)[0] - first) // 10**9 for m in axes.got[before:]] == [2, 4, 6, 8]


# --- absolute -----------------------------------------------------------------------------------


def test_the_absolute_encoder_knows_its_place_at_once(graph):
    graph.add(AbsoluteEncoders, scenario='ideal')
    axes = Axes(graph, topics.ABSOLUTE)
    places = np.array([[10.0, 20.0], [181.3, 45.2], [359.9, 89.0]]) * DEG
    np.testing.assert_allclose(axes(places), places, rtol=0, atol=10 * ARCSEC)


@pytest.mark.parametrize('publishes', ['angles', 'frames'])
def test_the_absolute_encoder_has_another_zero_after_its_power_cycle(graph, tmp_path, publishes):
    path = tmp_path / 'slipping.yaml'
    path.write_text('based_on: ideal\nabsolute:\n  azimuth: {zero_drifts_arcsec: [0, 30, 30]}\n'
                    '  elevation: {zero_drifts_arcsec: [0, -20, 10], power_cycles_s: [6.5]}\n')
    graph.add(AbsoluteEncoders, scenario=str(path), publishes=publishes)
    if publishes == 'frames':
        graph.add(FrameReader, **every_frame())
    axes = Axes(graph, topics.ABSOLUTE)
    place = np.array([[50.0, 20.0]] * 3) * DEG
    before = axes(place)
    answer = graph.call('absolute/power_cycle')
    assert answer.success and answer.message == 'absolute encoder: power-on 2'
    moved = (axes(place) - before) / ARCSEC
    np.testing.assert_allclose(moved, [[30.0, -20.0]] * 3, atol=1.0)
    moved = (axes(place) - before) / ARCSEC  # the scenario cuts the power of one axis
    np.testing.assert_allclose(moved, [[30.0, 10.0]] * 3, atol=1.0)
    told = [axes.power_on_of(message) for message in axes.got]
    assert [power_on.number for power_on in told] == [1] * 3 + [2] * 3 + [3] * 3
    assert [power_on.started - START * 1e-9 for power_on in told] == [
        1.0] * 3 + [4.0] * 3 + [7.0] * 3
    # no rate over a power-on
    known = np.isfinite([convert.read_joints(message)[2] for message in axes.got])
    assert np.array_equal(known.all(axis=1), [False, True, True] * 3)


def test_frames_are_made_for_those_who_ask(graph):
    graph.add(AbsoluteEncoders, scenario='ideal')
    axes = Axes(graph, topics.ABSOLUTE)
    axes([[0.5, 0.5]])
    graph.report('absolute_encoder', '', 'published /mount/absolute/frame', 0)
    frames = graph.listen(topics.ABSOLUTE_FRAME)
    graph.connect()
    axes([[0.6, 0.6]])
    graph.wait_for(lambda: frames)
    image = frames[0]
    assert (image.height, image.width, image.encoding) == (2, 1800, 'mono8')
    assert image.step == 1800 and len(image.data) == 3600
    assert convert.from_stamp(image.header.stamp) == axes.stamp
    rows = np.frombuffer(bytes(image.data), np.uint8).reshape(2, 1800)
    assert rows.min() < 120 < 150 < rows.max()


# --- what they share ----------------------------------------------------------------------------


@pytest.mark.parametrize('node', [IncrementalEncoders, AbsoluteEncoders])
@pytest.mark.parametrize('overrides, text', [
    ({'scenario': 'absent'}, 'absent'),
    ({'start_time': 'yesterday'}, 'write 2026-01-15T13:00:00'),
    ({'seed': -1}, 'must be 0 to'),
])
def test_bad_start_values(graph, node, overrides, text):
    with pytest.raises(ValueError, match=text):
        graph.add(node, **overrides)


def test_parse_utc():
    assert parse_utc('1970-01-02T00:00:01') == 86_401 * 10**9
    assert parse_utc('1970-01-02T00:00:01Z') == 86_401 * 10**9
    assert parse_utc(' 1970-01-02T01:00:01+01:00') == 86_401 * 10**9
    assert parse_utc('1970-01-02') == 86_400 * 10**9
    with pytest.raises(ValueError, match='is no date'):
        parse_utc('soon')


def test_decimator():
    decimator = Decimator()
    ms = 1_000_000
    passed = [t for t in range(0, 100, 5) if decimator.passes(t * ms, 50.0)]
    assert passed == [0, 20, 40, 60, 80]
    assert decimator.passes(81 * ms, 0.0)
    # a clock that goes back starts anew
    assert decimator.passes(10 * ms, 50.0)
