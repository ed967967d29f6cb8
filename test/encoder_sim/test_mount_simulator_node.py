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

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from diagnostic_msgs.msg import DiagnosticStatus

from encoder_sim.absolute_encoder_node import AbsoluteEncoders
from encoder_sim.incremental_encoder_node import IncrementalEncoders
from encoder_sim.mount_simulator_node import MountSimulator
from encoder_sim.scenario_file import scenario_files
from msg_tools import convert, topics
from msg_tools.units import ARCSEC, DEG

START = 1_768_482_000_000_000_000  # 2026-01-15T13:00:00
COUNT = 1296000.0 / 18_880_000 * ARCSEC


class Desk:
    """A mount simulator under test with the topics around it."""

    def __init__(self, graph, encoder=True, scenario='ideal', names=convert.AXES, **overrides):
        self.graph, self.names = graph, names
        self.node = graph.add(MountSimulator, scenario=scenario, **overrides)
        if encoder:
            graph.add(IncrementalEncoders, scenario=scenario)
            self.encoder = graph.listen(topics.INCREMENTAL)
        self.truth = graph.listen(topics.TRUTH_JOINTS)
        self.clock = graph.listen(topics.CLOCK)
        self.pub = graph.publisher(topics.COMMAND)
        graph.connect()

    def home(self):
        before = len(self.truth)
        assert self.graph.call('home').success
        self.graph.wait_for(lambda: len(self.truth) >= before + 6)

    def now(self):
        return max(convert.from_stamp(message.clock) for message in self.clock)

    def command(self, az, el, after=0):
        """Stand still at a place (deg), `after` ns; wait for the end of the exposure."""
        self.graph.wait_for(lambda: self.clock)
        before = self.now()
        self.pub.publish(convert.trajectory(
            before + after, [0.0], [[az * DEG, el * DEG]], [[0.0, 0.0]], self.names))
        self.graph.wait_for(lambda: self.now() > before, 'the exposure')

    def exposure(self, got):
        """Rows (stamp, angles) of the last three samples, when they have come."""
        self.graph.wait_for(
            lambda: got and convert.from_stamp(got[-1].header.stamp) == self.now())
        rows = [convert.read_joints(message) for message in got[-3:]]
        return np.array([r[0] for r in rows]), np.array([r[1] for r in rows])


@pytest.fixture
def drifting(tmp_path):
    path = tmp_path / 'drifting.yaml'
    path.write_text('based_on: ideal\nincremental:\n  azimuth: {zero_drift_arcsec: 300.0}\n'
                    '  elevation: {zero_drift_arcsec: 300.0}\n')
    return str(path)


def test_it_tells_the_log_of_the_truth_its_scenario(graph, drifting):
    desk = Desk(graph, encoder=False, scenario=drifting)
    # latched: whoever comes late gets it all the same
    told = graph.listen(topics.TRUTH_SCENARIO)
    graph.wait_for(lambda: told)
    assert [file['name'] for file in json.loads(told[0].data)] == ['drifting', 'ideal']
    assert json.loads(told[0].data) == scenario_files(drifting)
    assert desk.node.value('scenario') == drifting


def test_the_servo_makes_the_encoder_read_the_demand_not_the_axis(graph, drifting):
    desk = Desk(graph, scenario=drifting)
    desk.home()
    desk.command(200.0, 60.0)
    stamps, truth = desk.exposure(desk.truth)
    encoder_stamps, reading = desk.exposure(desk.encoder)
    np.testing.assert_array_equal(stamps, encoder_stamps)
    demand = np.array([200.0, 60.0]) * DEG
    np.testing.assert_allclose(reading, [demand] * 3, rtol=0, atol=1.01 * COUNT)
    assert (np.abs(truth - demand) > 10 * ARCSEC).all()
    graph.report('mount_simulator', 'ok')


def test_the_servo_knows_its_own_readings_after_months_too(graph, drifting):
    desk = Desk(graph, scenario=drifting)
    desk.home()
    demand = np.array([200.0, 60.0]) * DEG
    for _ in range(5):  # a second since the start has no digit for the ns any more
        desk.command(200.0, 60.0, 9_000_000_123_456_789)
        reading = desk.exposure(desk.encoder)[1]
        np.testing.assert_allclose(reading, [demand] * 3, rtol=0, atol=1.01 * COUNT)
        desk.home()


def test_the_encoder_is_behind_by_the_twist_of_its_coupling_and_what_sticks_is_seen(
        graph, tmp_path):
    path = tmp_path / 'worn.yaml'
    path.write_text('based_on: ideal\ncoupling: {azimuth: {wind_up_arcsec: 40.0}}\n'
                    'drives: {elevation: {stick_arcsec: 1.0}}\n')
    desk = Desk(graph, scenario=str(path), sample_rate_hz=1.0)
    desk.home()
    for az, sense in ((200.0, 1.0), (190.0, -1.0)):
        desk.command(az, 60.0)
        stamps, truth = desk.exposure(desk.truth)
        reading = desk.exposure(desk.encoder)[1]
        twist = (truth - reading)[:, 0] / ARCSEC
        np.testing.assert_allclose(twist, 40.0 * sense, rtol=0, atol=0.1)
        np.testing.assert_array_equal(np.diff(stamps), 100_000_000)  # restless: 10 Hz


def test_an_exposure_has_its_length_and_its_samples(graph):
    desk = Desk(graph, exposure_s=4.0, sample_rate_hz=2.0)
    desk.home()
    desk.command(185.0, 50.0)
    stamps = desk.exposure(desk.truth)[0]
    rows = [convert.read_joints(message)[0] for message in desk.truth[-9:]]
    assert rows[-1] == stamps[-1]
    np.testing.assert_array_equal(np.diff(rows), 500_000_000)
    assert desk.now() == rows[-1]


def test_the_clock_advances_once_an_event(graph):
    desk = Desk(graph)
    graph.wait_for(lambda: len(desk.clock) >= 3)  # it ticks, for those who came late
    desk.home()
    for az in (190.0, 200.0, 210.0):
        desk.command(az, 50.0)
        desk.exposure(desk.truth)
    times = [convert.from_stamp(message.clock) for message in desk.clock]
    assert times == sorted(times)
    assert times[0] == START
    assert len(set(times)) == 1 + 1 + 3  # the start, home, three commands


def test_what_it_cannot_do_is_refused_and_the_next_command_obeyed(graph):
    desk = Desk(graph)
    desk.home()
    graph.wait_for(lambda: desk.clock)
    good = convert.trajectory(desk.now(), [0.0, 9.0], np.ones((2, 2)), np.zeros((2, 2)))
    bad = []
    for change in range(4):
        message = convert.trajectory(desk.now(), [0.0, 9.0], np.ones((2, 2)), np.zeros((2, 2)))
        if change == 0:
            for point in message.points:
                point.positions = [1.0, 120 * DEG]
        elif change == 1:
            message.joint_names = ['az', 'el']
        elif change == 2:
            message.points = []
        else:
            message.points[0].positions = [float('nan'), 1.0]
        bad.append(message)
    before = desk.now()
    for message in bad:
        desk.pub.publish(message)
    status = graph.report('mount_simulator', '4 messages refused')
    assert 'not finite' in next(r.value for r in status.values if r.key == 'refused command')
    assert desk.now() == before
    desk.pub.publish(good)
    graph.wait_for(lambda: desk.now() > before)
    np.testing.assert_allclose(desk.exposure(desk.truth)[1], 1.0, atol=2 * COUNT)


def test_out_of_travel_says_so(graph):
    desk = Desk(graph)
    desk.pub.publish(convert.trajectory(START, [0.0], [[1.0, 120 * DEG]], [[0.0, 0.0]]))
    status = graph.report('mount_simulator', '1 messages refused')
    assert 'elevation from 120.000 to 120.000 deg leaves the travel' in next(
        r.value for r in status.values if r.key == 'refused command')


def test_a_german_mount_goes_through_its_pole_by_its_own_names(graph):
    names = convert.JOINTS['equatorial']
    desk = Desk(graph, scenario='german', names=names)
    graph.add(AbsoluteEncoders, scenario='german')
    absolute = graph.listen(topics.ABSOLUTE)
    graph.connect()
    desk.home()
    for place in ((20.0, -25.0), (200.0 - 20.0, 205.0)):  # the flip is a slew as any other
        desk.command(*place)
        reading = desk.exposure(desk.encoder)[1]
        np.testing.assert_allclose(reading, [np.array(place) * DEG] * 3, rtol=0, atol=5 * ARCSEC)
        told = desk.exposure(absolute)[1]
        # of the same turn: no jump of 360 degrees anywhere on the travel
        np.testing.assert_allclose(told, reading, rtol=0, atol=200 * ARCSEC)
    for message in (desk.truth[-1], desk.encoder[-1], absolute[-1]):
        assert tuple(message.name) == names
    for joints, place in ((names, [195.0, 30.0]), (convert.AXES, [20.0, 30.0])):
        desk.pub.publish(convert.trajectory(
            desk.now(), [0.0], [np.array(place) * DEG], [[0.0, 0.0]], joints))
    status = graph.report('mount_simulator', '2 messages refused')
    said = next(r.value for r in status.values if r.key == 'refused command')
    assert 'command for azimuth and elevation: this mount has hour_angle and declination' in said


def test_without_an_encoder_it_exposes_with_the_servo_open(graph):
    desk = Desk(graph, encoder=False)
    desk.command(200.0, 60.0)
    np.testing.assert_allclose(
        desk.exposure(desk.truth)[1], [[200 * DEG, 60 * DEG]] * 3, atol=1e-9)
    status = graph.report('mount_simulator', '1 pointings with the servo open')
    assert status.level == DiagnosticStatus.WARN


def test_a_silent_encoder_does_not_stop_it(graph):
    graph.publisher(topics.INCREMENTAL)  # there, but says nothing
    desk = Desk(graph, encoder=False, feedback_timeout_s=0.01)
    desk.command(200.0, 60.0)
    graph.report('mount_simulator', '1 pointings with the servo open')


def test_an_encoder_without_zero_leaves_the_servo_open(graph):
    desk = Desk(graph)  # not homed, and the mark of no axis is on the way
    desk.command(170.0, 30.0)
    graph.report('mount_simulator', '1 pointings with the servo open')
    np.testing.assert_allclose(
        desk.exposure(desk.truth)[1], [[170 * DEG, 30 * DEG]] * 3, atol=1e-9)


def test_live_samples_belong_to_their_times(graph):
    desk = Desk(graph, encoder=False, time_scale=20.0, sample_rate_hz=5.0)
    graph.wait_for(lambda: len(desk.truth) >= 40)
    stamps = np.array([convert.read_joints(message)[0] for message in desk.truth])
    assert not ((stamps - START) % 200_000_000).any()
    np.testing.assert_array_equal(np.diff(stamps), 200_000_000)
    times = [convert.from_stamp(message.clock) for message in desk.clock]
    assert times == sorted(times) and times[-1] > START


def test_live_the_servo_closes_too(graph, drifting):
    desk = Desk(graph, scenario=drifting, time_scale=10.0, sample_rate_hz=4.0)
    assert graph.call('home').success
    graph.wait_for(lambda: desk.encoder
                   and np.isfinite(convert.read_joints(desk.encoder[-1])[1]).all(), 'home')
    graph.wait_for(lambda: desk.clock)
    demand = np.array([182.0, 47.0]) * DEG
    desk.pub.publish(convert.trajectory(desk.now(), [0.0], [demand], [[0.0, 0.0]]))

    def there():
        return np.abs(np.array(convert.read_joints(desk.encoder[-1])[1]) - demand).max() < 2 * COUNT
    graph.wait_for(there, 'the encoder to read the demand')
    truth = np.array(convert.read_joints(desk.truth[-1])[1])
    assert (np.abs(truth - demand) > 10 * ARCSEC).all()
    # deactivated in the middle of a slew it comes to rest, and is sent nowhere
    desk.pub.publish(convert.trajectory(desk.now(), [0.0], [demand + [0.9, 0.0]], [[0.0, 0.0]]))

    def speed():
        return np.abs(convert.read_joints(desk.truth[-1])[2]).max()
    graph.wait_for(lambda: speed() > 1.0 * DEG)
    desk.node.trigger_deactivate()
    graph.wait_for(lambda: speed() == 0.0)
    assert np.abs(convert.read_joints(desk.truth[-1])[1] - demand).max() < 0.8
    desk.pub.publish(convert.trajectory(desk.now(), [0.0], [demand], [[0.0, 0.0]]))
    graph.report('mount_simulator', '1 messages refused')
    assert 'is inactive' in graph.call('home').message


def test_live_home_is_refused_while_somebody_moves_the_mount(graph):
    desk = Desk(graph, time_scale=10.0)
    graph.wait_for(lambda: desk.clock)
    timer = graph.tester.create_timer(0.1, lambda: desk.pub.publish(convert.trajectory(
        desk.now(), [0.0], [np.array([182.0, 47.0]) * DEG], [[0.0, 0.0]])))
    graph.wait_for(lambda: desk.node._commanded >= 0.0, 'a command')
    answer = graph.call('home')
    assert not answer.success and 'commands move the mount; cancel the plan' in answer.message
    timer.cancel()
    assert graph.call('home').success  # who homes may have withdrawn what it asked for just now


@pytest.mark.parametrize('overrides, text', [
    ({'time_scale': -1.0}, 'must be 0.0 to 1000.0'),
    ({'scenario': 'no_such'}, 'no_such'),
    ({'start_time': 'x'}, 'is no date'),
])
def test_bad_start_values(graph, overrides, text):
    with pytest.raises(ValueError, match=text):
        graph.add(MountSimulator, **overrides)


def test_the_thermometer_tells_changes_of_the_air_before_the_angles(graph, tmp_path):
    path = tmp_path / 'warming.yaml'
    path.write_text('based_on: ideal\n'
                    'weather: {temperature_c: 7.0, temperature_c_per_hour: 20.0}\n')
    air = graph.listen(topics.AMBIENT)
    desk = Desk(graph, scenario=str(path))
    desk.home()
    for az in (10.0, 100.0, 190.0):
        desk.command(az, 45.0)
    got = [convert.read_temperature(message) for message in air]
    assert got[0] == (START, 7.0)
    assert len(got) >= 3
    for stamp, celsius in got:
        assert celsius == pytest.approx(7.0 + 20.0 * (stamp - START) * 1e-9 / 3600.0)
    steps = np.diff([celsius for _, celsius in got])
    assert steps.min() > 0.05
    stamps = [convert.from_stamp(message.header.stamp) for message in desk.truth]
    assert {stamp for stamp, _ in got[1:]} <= set(stamps)


def test_without_weather_of_its_own_it_has_no_thermometer(graph):
    air = graph.listen(topics.AMBIENT)
    desk = Desk(graph)
    desk.home()
    desk.command(100.0, 45.0)
    assert air == []
