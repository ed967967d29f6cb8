import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.power_on import PowerOn
from msg_tools.status import Progress, handover_rows
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.run import PointingRun
from pointing_model.run_messages import cloud_to_run, run_to_cloud
from pointing_model.sky import DEFAULT_SITE, DEFAULT_WEATHER, Site, observed_place
from pointing_model.star_catalogue import POLARIS_HIP, load_catalogue
from pointing_model.star_observer_node import StarObserver
from pointing_model.target import satellite_target

START = 1_768_482_000_000_000_000  # 2026-01-15T13:00:00
SECOND = 10**9
#: exposures are made on a knot of the commanded track, where every way to interpolate agrees
EXPOSURE = 20 * SECOND


def place(hip, ns):
    az, el = observed_place(load_catalogue(hip=[hip]), ns * 1e-9, DEFAULT_SITE, DEFAULT_WEATHER)
    return np.array([az[0], el[0]])


class Instruments:
    """Mount, encoders and camera of the test: they answer a command with an exposure.

    Parameters
    ----------
    miss : callable
        ``miss(number, stamp, reading)`` in rad, or None: the camera says nothing.
    """

    def __init__(self, graph, miss=lambda number, *_: (1e-6 * ARCSEC * number, 0.0), homed=True,
                 absolute=True, error=(0.0, 0.0)):
        self.graph, self.miss, self.absolute = graph, miss, absolute
        self.error = np.array(error)
        self.now = START
        self.position = np.array([3.0, 0.8])
        self.commands = []
        self.readings = {}  # stamp of an exposure -> both encoders' reading
        self.pubs = {topic.name: graph.publisher(topic) for topic in (
            topics.INCREMENTAL, topics.ABSOLUTE, topics.MISS_DISTANCE, topics.CLOCK)}
        graph.listen(topics.COMMAND, call=self._on_command)
        self.ticks = graph.tester.create_timer(0.05, self._tick)
        self.homed = homed
        self.awake, self.frame = True, ''

    def _tick(self):
        self.pubs[topics.CLOCK.name].publish(Clock(clock=convert.to_stamp(self.now)))
        if self.homed and not self.commands:
            self.now += SECOND // 10
            self.read(self.now, self.position)

    def read(self, stamp, angles):
        self.pubs[topics.INCREMENTAL.name].publish(
            convert.joint_state(stamp, angles + self.error, [0.0, 0.0], frame=self.frame))
        if self.absolute:
            self.pubs[topics.ABSOLUTE.name].publish(convert.joint_state(stamp, angles, [0.0, 0.0]))

    def _on_command(self, message):
        stamp, times, track, _ = convert.read_trajectory(message)
        self.commands.append((stamp, track))
        if not self.awake:
            return
        at = stamp + EXPOSURE

        def demand(ns):
            return np.array([np.interp((ns - stamp) * 1e-9, times, track[:, i]) for i in (0, 1)])
        self.position = demand(at)
        self.readings[at] = self.position + self.error, self.position
        miss = self.miss(len(self.commands), at, self.position + self.error)
        self.read(at - SECOND // 2, demand(at - SECOND // 2))
        if miss is not None:
            self.pubs[topics.MISS_DISTANCE.name].publish(convert.vector(at, *miss, 'camera'))
        self.read(at + SECOND // 2, demand(at + SECOND // 2))
        self.now = at + SECOND

    def stop(self):
        self.graph.tester.destroy_timer(self.ticks)


class Night:
    """A star observer under test and what it publishes."""

    def __init__(self, graph, plan, **overrides):
        self.graph = graph
        self.rows = graph.listen(topics.OBSERVATION)
        self.offsets = graph.listen(topics.OFFSET)
        self.tables = graph.listen(topics.OBSERVATIONS)
        self.status = graph.listen(topics.OBSERVER_STATUS)
        self.node = graph.add(StarObserver, plan=plan, **{
            'use_sim_time': True, 'magnitude_limit': 3.5, 'answer_timeout_s': 60.0, **overrides})

    def value(self, key):
        return {row.key: row.value for row in self.status[-1].values}[key] if self.status else ''

    def until(self, state, text=''):
        """Wait for a state; its text."""
        self.graph.wait_for(
            lambda: self.value('state') == state and text in self.status[-1].message,
            lambda: f'{state} {text}; last: {self.status[-1:]}')
        return self.status[-1].message

    def run(self):
        """All rows of a finished plan."""
        self.until('done')
        self.graph.wait_for(lambda: len(self.rows) == int(self.value('observations')))
        return [cloud_to_run(message) for message in self.rows]


# --- signs --------------------------------------------------------------------------------------


def test_offset_is_encoder_minus_catalogue_plus_miss(graph):
    error, miss = np.array([9.0, -5.0]) * ARCSEC, np.array([4.0, 7.0]) * ARCSEC
    sky = Instruments(graph, miss=lambda *_: miss, error=error)
    night = Night(graph, 'stars 3')
    rows = night.run()
    assert len(rows) == len({int(run['star'][0]) for run in rows}) == 3
    graph.wait_for(lambda: len(night.offsets) == 3)
    for run, offset in zip(rows, night.offsets):
        stamp = convert.from_stamp(offset.header.stamp)
        star = place(int(run['star'][0]), stamp)
        np.testing.assert_allclose([run['az'][0], run['el'][0]], star, rtol=0, atol=1e-9)
        stretch = np.array([np.cos(star[1]), 1.0])
        for encoder, reading in zip(('enc', 'abs'), sky.readings[stamp]):
            x, y = run.offsets(encoder)
            wanted = np.array([wrap(reading[0] - star[0]), reading[1] - star[1]]) * stretch + miss
            np.testing.assert_allclose([x[0] / ARCSEC, y[0] / ARCSEC], wanted / ARCSEC,
                                       rtol=0, atol=0.03)
        x, y = run.offsets()
        np.testing.assert_allclose([offset.vector.x, offset.vector.y], [x[0], y[0]], rtol=1e-12)
        np.testing.assert_allclose([run['miss_x'][0], run['miss_y'][0]], miss, rtol=1e-12)
        assert run['time'][0] == pytest.approx(stamp * 1e-9, abs=1e-6)
        assert offset.header.frame_id == 'mount_enu'


def test_rows_say_how_they_were_taken(graph):
    Instruments(graph)
    night = Night(graph, 'stars 2, polaris 1', first_run=7, temperature_c=3.5, pressure_hpa=900.0)
    rows = night.run()
    assert [run['run'][0] for run in rows] == [7.0] * 3
    assert [run['block'][0] for run in rows] == [0.0, 0.0, 1.0]
    assert rows[2]['star'][0] == POLARIS_HIP
    assert rows[0]['temperature'][0] == 3.5 and rows[0]['pressure'][0] == 900.0
    assert all(abs(run['approach_az'][0]) == 1.0 for run in rows)
    assert all(run['magnitude'][0] <= 3.5 for run in rows)
    graph.wait_for(lambda: night.tables and night.tables[-1].width == 3)
    table = cloud_to_run(night.tables[-1])
    for name in table.columns:
        np.testing.assert_array_equal(table[name], [run[name][0] for run in rows])


def test_a_star_far_off_is_centred_and_measured_again(graph):
    off = np.array([150.0, -60.0]) * ARCSEC  # encoder - catalogue of a centred star

    def miss(number, stamp, reading):
        star = place(POLARIS_HIP, stamp)
        return (wrap(star[0] + off[0] - reading[0]) * np.cos(star[1]),
                star[1] + off[1] - reading[1])
    sky = Instruments(graph, miss=miss)
    rows = Night(graph, 'polaris 2').run()
    assert len(sky.commands) == 3  # the second exposure begins where the first was centred
    for number, wanted in enumerate((np.zeros(2), off, off)):
        stamp, track = sky.commands[number]
        demand = track[0] - place(POLARIS_HIP, stamp)
        np.testing.assert_allclose([wrap(demand[0]) / ARCSEC, demand[1] / ARCSEC],
                                   wanted / ARCSEC, rtol=0, atol=0.1)
    for run in rows:
        x, y = run.offsets()
        assert x[0] / ARCSEC == pytest.approx(150.0 * np.cos(run['el'][0]), abs=0.1)
        assert y[0] / ARCSEC == pytest.approx(-60.0, abs=0.1)
        assert abs(run['miss_x'][0]) < 1 * ARCSEC  # of the exposure that counts


def test_model_and_zero_are_applied_once(graph):
    model = PointingModel({'IA': 120 * ARCSEC, 'IE': -80 * ARCSEC, 'CA': 50 * ARCSEC})
    zero = np.array([33.0, -21.0]) * ARCSEC
    graph.publisher(topics.MODEL).publish(String(data=model.to_json()))
    graph.publisher(topics.ZERO).publish(convert.joint_state(START, zero))
    sky = Instruments(graph)
    night = Night(graph, 'polaris 1', autostart=False)
    graph.report('star_observer', '', 'received /mount/zero', 1)
    graph.report('star_observer', '', 'received /mount/model', 1)
    graph.connect()
    assert graph.call('observe').success
    run = night.run()[0]
    stamp, track = sky.commands[0]
    star = place(POLARIS_HIP, stamp)
    wanted = np.array(model.sky_to_encoder(*star)).ravel() + zero
    np.testing.assert_allclose(wrap(track[0, 0] - wanted[0]), 0.0, atol=1e-9)
    np.testing.assert_allclose(track[0, 1], wanted[1], atol=1e-9)
    # the row is raw: what the encoder read, neither model nor zero taken off
    x, y = run.offsets()
    mx, my = model.offsets(run['az'], run['el'])
    assert x[0] / ARCSEC == pytest.approx(
        (mx[0] + zero[0] * np.cos(run['el'][0])) / ARCSEC, abs=0.05)
    assert y[0] / ARCSEC == pytest.approx((my[0] + zero[1]) / ARCSEC, abs=0.05)


def test_a_model_file_is_in_force_at_the_start(graph, tmp_path):
    PointingModel({'IE': -80 * ARCSEC}).save(tmp_path / 'model.json')
    sky = Instruments(graph)
    Night(graph, 'polaris 1', model_file=str(tmp_path / 'model.json')).run()
    stamp, track = sky.commands[0]
    assert (track[0, 1] - place(POLARIS_HIP, stamp)[1]) / ARCSEC == pytest.approx(-80.0, abs=0.01)


def test_a_satellite_is_tracked_at_its_interval(graph):
    sky = Instruments(graph)
    rows = Night(graph, 'satellite 3', satellite='gps-26690', satellite_interval_s=90.0,
                 latitude_deg=0.0, longitude_deg=60.0).run()
    target = satellite_target('gps-26690')
    site = Site(0.0, 60.0 * DEG, DEFAULT_SITE.height)
    assert [run['star'][0] for run in rows] == [-26690.0] * 3
    for run, (stamp, track) in zip(rows, sky.commands):
        wanted = target.place(np.array([stamp * 1e-9]), site, DEFAULT_WEATHER)
        np.testing.assert_allclose(
            [wrap(track[0, 0] - wanted[0][0]), track[0, 1] - wanted[1][0]], 0.0,
            atol=0.5 * ARCSEC)
        assert np.isnan(run['magnitude'][0])
    begins = np.diff([stamp for stamp, _ in sky.commands]) * 1e-9
    np.testing.assert_allclose(begins, 90.0, atol=1e-6)


@pytest.mark.parametrize('overrides, text', [
    ({}, 'set the parameter satellite'),
    ({'satellite': 'gps-26690', 'min_elevation_deg': 84.9}, 'satellite 26690 stands at'),
])
def test_a_satellite_that_cannot_be_tracked_ends_the_plan(graph, overrides, text):
    Instruments(graph)
    night = Night(graph, 'satellite 3', **overrides)
    assert text in night.until('failed')


def test_the_next_evening_is_waited_for(graph):
    sky = Instruments(graph)
    night = Night(graph, 'polaris 1, wait 24, polaris 1, wait 23, polaris 1')
    rows = night.run()
    times = np.array([run['time'][0] for run in rows])
    # counted from the evening before, not from the last exposure
    np.testing.assert_allclose(times - times[0], [0.0, 24 * 3600.0, 47 * 3600.0], atol=60.0)
    assert len(sky.commands) == 5
    np.testing.assert_array_equal(sky.commands[1][1][0], sky.commands[1][1][-1])  # it stood still


def test_a_plan_may_begin_with_waiting(graph):
    sky = Instruments(graph)
    rows = Night(graph, 'wait 24, polaris 1').run()
    assert rows[0]['time'][0] - START * 1e-9 == pytest.approx(24 * 3600.0, abs=120.0)
    assert len(sky.commands) == 2
    np.testing.assert_array_equal(sky.commands[0][1][0], sky.commands[0][1][-1])  # it stood still


# --- instruments that are late, silent or wrong ---------------------------------------------------


@pytest.mark.parametrize('observer_first', [True, False])
def test_the_order_of_start_does_not_matter(graph, observer_first):
    if observer_first:
        night = Night(graph, 'stars 2')
        text = night.until('waiting', 'the graph')
        assert text
        graph.report('star_observer', 'waiting for a subscriber of /mount/command')
        Instruments(graph)
    else:
        Instruments(graph)
        night = Night(graph, 'stars 2')
    assert len(night.run()) == 2


def test_a_lost_frame_is_asked_for_again(graph):
    sky = Instruments(graph, miss=lambda number, *_: None if number == 2 else (0.0, 0.0))
    rows = Night(graph, 'stars 3', answer_timeout_s=0.5).run()
    assert len({int(run['star'][0]) for run in rows}) == len(rows) == 3
    assert len(sky.commands) >= 4
    (_, lost), (_, again) = sky.commands[1:3]
    np.testing.assert_allclose(wrap(lost[0, 0] - again[0, 0]), 0.0, atol=0.01)  # the same star


def test_a_silent_camera_is_named_and_the_plan_goes_on_when_it_speaks(graph):
    speaks = []
    Instruments(graph, miss=lambda *_: (0.0, 0.0) if speaks else None)
    night = Night(graph, 'stars 2', answer_timeout_s=0.5)
    night.until('waiting', 'an answer of camera')
    status = graph.report('star_observer', 'waiting for an answer of camera')
    assert status.level == DiagnosticStatus.WARN
    assert not night.rows
    speaks.append(True)
    assert len(night.run()) == 2
    graph.report('star_observer', 'ok')


def test_a_silent_encoder_is_named(graph):
    sky = Instruments(graph, absolute=False)
    night = Night(graph, 'stars 1', answer_timeout_s=0.5)
    night.until('waiting', 'an answer of absolute encoder')
    sky.absolute = True
    assert len(night.run()) == 1


def test_a_mount_that_does_not_answer_is_named(graph):
    sky = Instruments(graph)
    sky.awake = False
    night = Night(graph, 'stars 1', answer_timeout_s=0.5)
    # at first a reading of before the command may still be on its way
    night.until('waiting', 'an answer of mount and incremental encoder, absolute encoder, camera')
    sky.awake = True
    assert len(night.run()) == 1


def test_a_field_without_a_star_is_lost_and_the_next_is_observed(graph):
    # one without a star may have been under way at the command; three in a row are not
    Instruments(graph, miss=lambda number, *_: (
        (np.nan, np.nan) if number in (2, 3, 4) else (0.0, 0.0)))
    night = Night(graph, 'stars 3')
    assert len(night.run()) == 2
    assert night.value('lost') == '1'
    assert night.value('done') == night.value('total') == '3'
    graph.report('star_observer', '', 'stars lost', 1)


def test_an_exposure_off_the_target_does_not_count(graph):
    sky = Instruments(graph, error=(60 * ARCSEC, 60 * ARCSEC))
    night = Night(graph, 'stars 1', on_target_arcsec=30.0, answer_timeout_s=0.5)
    graph.wait_for(lambda: len(sky.commands) >= 2)
    assert not night.rows
    sky.error = np.zeros(2)
    assert len(night.run()) == 1


def test_two_cameras_stop_the_night_until_one_is_gone(graph):
    Instruments(graph)
    other = Node('other_camera', context=graph.context, namespace='/mount',
                 start_parameter_services=False, enable_rosout=False)
    topic = topics.MISS_DISTANCE
    second = other.create_publisher(topic.message, topic.name, topic.qos)
    night = Night(graph, 'stars 2')
    status = graph.report('star_observer', 'instrument camera: published by /mount/other_camera '
                          'and /mount/tester; end all but one')
    assert status.level == DiagnosticStatus.WARN and not night.rows
    other.destroy_publisher(second)
    assert len(night.run()) == 2
    graph.wait_for(lambda: 'instrument' not in graph.reports['star_observer'].message)
    other.destroy_node()


def test_bad_messages_are_counted_and_the_night_goes_on(graph):
    sky = Instruments(graph)
    night = Night(graph, 'stars 2', autostart=False)
    zero, model = graph.publisher(topics.ZERO), graph.publisher(topics.MODEL)
    graph.connect()
    wrong = convert.joint_state(START, [0.0, 0.0])
    wrong.name = ['x', 'y']
    sky.pubs[topics.ABSOLUTE.name].publish(wrong)
    zero.publish(convert.joint_state(START, [np.nan, 0.0]))
    graph.report('star_observer', '2 messages refused')
    model.publish(String(data='no JSON'))
    graph.report('star_observer', '3 messages refused')
    # a model that somebody wrote by hand is one
    model.publish(String(
        data=PointingModel({'IA': 0.0}, provenance={'last_stamp_ns': None}).to_json()))
    # two encoders on one topic
    sky.pubs[topics.INCREMENTAL.name].publish(convert.joint_state(sky.now - 1, [0.0, 0.0]))
    status = graph.report('star_observer', '4 messages refused')
    assert any('stamp not after the one before' in row.value for row in status.values)
    assert graph.call('observe').success
    assert len(night.run()) == 2


# --- the plan -----------------------------------------------------------------------------------


def test_it_waits_for_an_encoder_that_is_homed(graph):
    sky = Instruments(graph, homed=False)
    night = Night(graph, 'stars 1')
    night.until('waiting', 'the encoder to be homed (call home)')
    sky.homed = True
    assert len(night.run()) == 1


def test_a_zero_lost_in_the_night_is_looked_for_again(graph):
    sky = Instruments(graph)
    homed = []

    def home():
        homed.append(len(sky.commands))
        sky.error = np.zeros(2)
        sky.now += SECOND
        sky.read(sky.now, sky.position)
        return True, 'homed'
    graph.service('home', home)

    def miss(number, stamp, reading):
        if number == 2 and len(homed) == 1:
            sky.error = np.full(2, np.nan)  # the power failed
        return 0.0, 0.0
    sky.miss = miss
    rows = Night(graph, 'home, stars 4').run()
    assert len(homed) == 2
    runs = [run['run'][0] for run in rows]
    assert len(rows) == 4 and runs[0] == runs[1] - 1 == runs[3] - 1


def test_services_are_called_in_the_order_of_the_plan(graph):
    sky = Instruments(graph, homed=False)
    calls = []
    zero, model, status = (graph.publisher(topic) for topic in (
        topics.ZERO, topics.MODEL, topics.CALIBRATION_STATUS))
    night = Night(graph, 'home, polaris 2, calibrate_zero, power_cycle, home, fit')

    def rows():
        return convert.from_stamp(night.rows[-1].header.stamp) if night.rows else 0

    def serve(verb):
        def answer():
            calls.append(verb)
            sky.homed = verb != 'power_cycle'
            if verb == 'home':
                sky.now += 60 * SECOND
                sky.read(sky.now, sky.position)
            elif verb == 'power_cycle':
                sky.now += SECOND
                sky.read(sky.now, np.full(2, np.nan))
            elif verb == 'calibrate_zero':
                zero.publish(convert.joint_state(rows(), [0.0, 0.0]))
            elif verb == 'fit':
                model.publish(String(data=PointingModel(
                    {'IA': 0.0}, provenance={'last_stamp_ns': rows()}).to_json()))
            return True, f'{verb} done'
        return answer
    for verb in ('home', 'power_cycle', 'calibrate_zero', 'fit'):
        graph.service(verb, serve(verb))
    # the zero may be asked for only when the calibration has every row
    night.until('waiting', 'calibration to take the last observation')
    assert calls == ['home']
    graph.wait_for(lambda: len(night.rows) == 2)
    status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=2))
    night.run()
    assert calls == ['home', 'calibrate_zero', 'power_cycle', 'home', 'fit']
    assert night.value('run') == '2'


def test_a_calibration_that_was_started_anew_gets_all_rows_again(graph):
    Instruments(graph)
    graph.service('fit', lambda: (True, ''))
    night = Night(graph, 'stars 2, fit')
    status = graph.publisher(topics.CALIBRATION_STATUS)
    graph.wait_for(lambda: len(night.rows) == 2 and night.tables)
    before = len(night.tables)
    for count in (1, 0):
        status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=count))
        graph.report('star_observer', '', 'received /mount/calibration/status', 2 - count)
    graph.wait_for(lambda: len(night.tables) > before)
    assert night.tables[-1].width == 2


def test_an_observer_started_anew_takes_its_night_from_the_calibration(graph):
    sky = Instruments(graph)
    sky.frame = PowerOn(2, 2e9).frame
    first = Night(graph, 'polaris 5')
    graph.wait_for(lambda: len(first.rows) == 3)
    rows = PointingRun.concatenate(map(cloud_to_run, first.rows[:3]))
    graph.remove(first.node)
    sky.commands.clear()  # the encoder goes on to be read
    rows.columns['run'] = np.full(3, 7.0)  # as the night has numbered it
    status, table = (graph.publisher(topic) for topic in (
        topics.CALIBRATION_STATUS, topics.CALIBRATION_TABLE))
    status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=3))
    # who is heard first is not told: here the calibration is
    night = Night(graph, 'polaris 5', autostart=False)
    graph.wait_for(lambda: night.node._has_rows)
    assert graph.call('observe').success
    graph.report('star_observer', 'the calibration to give back the rows of the night so far')
    table.publish(run_to_cloud(rows, convert.from_stamp(first.rows[2].header.stamp)))
    left = Progress('observing', 'polaris 5', 0, 3, 5, 3, 7, 0, 'polaris 5')
    status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=3,
                                  **handover_rows(3, left)))
    night.until('done')
    graph.wait_for(lambda: night.tables and night.tables[-1].width == 5)
    got = cloud_to_run(night.tables[-1])
    np.testing.assert_array_equal(got['run'], 7.0)
    np.testing.assert_array_equal(got['encoder_start'], 2e9)


def test_a_service_that_refuses_ends_the_plan_with_its_reason(graph):
    Instruments(graph)
    graph.service('fit', lambda: (False, 'too few stars'))
    night = Night(graph, 'fit, stars 1')
    assert night.until('failed') == 'fit: too few stars'
    status = graph.report('star_observer', 'fit: too few stars')
    assert status.level == DiagnosticStatus.ERROR
    # and it can be started again
    assert graph.set_parameter(night.node, plan='stars 1')[0]
    assert graph.call('observe').success
    assert len(night.run()) == 1


def test_a_service_that_is_not_there_is_waited_for(graph):
    Instruments(graph)
    night = Night(graph, 'fit')
    assert night.until('waiting', 'a server of').endswith('fit')
    graph.service('fit', lambda: (False, 'now it is'))
    assert night.until('failed') == 'fit: now it is'


def test_polaris_below_the_limit_ends_the_plan(graph):
    Instruments(graph)
    night = Night(graph, 'polaris 1', latitude_deg=-30.0)
    assert 'below min_elevation_deg = 20.0' in night.until('failed', 'Polaris stands at -')


def test_no_polaris_in_the_field_ends_the_plan_before_the_zero(graph):
    Instruments(graph, miss=lambda *_: np.full(2, np.nan))
    asked = []
    graph.service('calibrate_zero', lambda: (asked.append(1) or True, 'the zero of yesterday'))
    night = Night(graph, 'polaris 2, calibrate_zero')
    assert 'none of 2 exposures shows Polaris' in night.until('failed')
    assert not asked and not night.rows


def test_no_star_visible_ends_the_plan(graph):
    Instruments(graph)
    night = Night(graph, 'stars 5', min_elevation_deg=84.5, magnitude_limit=-1.0)
    night.until('failed', 'no star visible')


def test_it_starts_when_asked_and_once(graph):
    Instruments(graph)
    night = Night(graph, 'stars 2', autostart=False)
    graph.connect()
    answer = graph.call('observe')
    assert answer.success and 'stars 2' in answer.message
    answer = graph.call('observe')
    assert not answer.success and answer.message == 'a plan is under way'
    assert len(night.run()) == 2


def test_a_zero_on_polaris_by_service(graph):
    Instruments(graph)
    asked = []
    graph.service('calibrate_zero', lambda: (asked.append(1) or True, 'done'))
    zero = graph.publisher(topics.ZERO)
    status = graph.publisher(topics.CALIBRATION_STATUS)
    night = Night(graph, 'stars 1', autostart=False, polaris_exposures=3)
    graph.connect()
    answer = graph.call('zero_on_polaris')
    assert answer.success and 'polaris 3, calibrate_zero' in answer.message
    assert not graph.call('observe').success
    graph.wait_for(lambda: len(night.rows) == 3)
    status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=3))
    graph.wait_for(lambda: asked)
    stamp = convert.from_stamp(night.rows[-1].header.stamp)
    zero.publish(convert.joint_state(stamp, [0.0, 0.0]))
    rows = night.run()
    assert {run['star'][0] for run in rows} == {POLARIS_HIP}


def test_it_waits_for_the_nodes_that_it_was_told_of(graph):
    Instruments(graph)
    night = Night(graph, 'stars 1', wait_for_nodes=['/mount/star_observer', '/mount/archive'])
    graph.report('star_observer', 'waiting for node /mount/archive')
    assert not night.rows
    from msg_tools.node import MountNode

    class Archive(MountNode):
        def __init__(self, **kwargs):
            super().__init__('archive', **kwargs)
    graph.add(Archive)
    assert len(night.run()) == 1


def test_foreign_diagnostics_do_no_harm(graph):
    from diagnostic_msgs.msg import DiagnosticArray, KeyValue
    night = Night(graph, 'stars 1', wait_for_nodes=['/mount/star_observer'])
    pub = graph.publisher(topics.DIAGNOSTICS)
    graph.wait_for(lambda: pub.get_subscription_count() >= 2)
    pub.publish(DiagnosticArray(status=[DiagnosticStatus(
        name='disk', values=[KeyValue(key='published /x', value='many')])]))
    Instruments(graph)
    assert len(night.run()) == 1


# --- parameters ---------------------------------------------------------------------------------


@pytest.mark.parametrize('overrides, text', [
    ({'plan': 'strs 3'}, "'strs' is unknown"),
    ({'plan': ''}, 'the plan is empty'),
    ({'min_elevation_deg': 95.0}, 'must be 0.0 to 89.0'),
    ({'latitude_deg': 95.0}, 'must be -90.0 to 90.0'),
    ({'magnitude_limt': 3.0}, 'did you mean magnitude_limit'),
    ({'model_file': 'absent.json'}, 'absent.json'),
])
def test_bad_start_values(graph, overrides, text):
    with pytest.raises((ValueError, OSError), match=text):
        graph.add(StarObserver, **overrides)


def test_a_bad_plan_at_runtime_is_refused_with_its_reason(graph):
    node = graph.add(StarObserver, plan='stars 2')
    done, reason = graph.set_parameter(node, plan='stars 0')
    assert not done and 'a count of 1 to 100000' in reason
    assert node.value('plan') == 'stars 2'


def test_another_site_at_runtime_is_used(graph):
    sky = Instruments(graph)
    night = Night(graph, 'polaris 1', autostart=False)
    graph.connect()
    assert graph.set_parameter(night.node, latitude_deg=50.0) == (True, '')
    graph.call('observe')
    run = night.run()[0]
    assert run['el'][0] / DEG == pytest.approx(50.0, abs=1.0)
    assert sky.commands[0][1][0, 1] / DEG == pytest.approx(50.0, abs=1.0)


# --- blind checks, and a model with effects -----------------------------------------------------


def test_a_check_points_blind_at_fresh_stars_and_says_how_far_off_they_were(graph):
    off = np.array([150.0, -60.0]) * ARCSEC  # far beyond recentre_arcsec

    def miss(number, stamp, reading):
        # centred, a star is nearer, but not near enough
        return off * (1.0 if number in (1, 4, 7, 8, 9, 10) else 0.45)
    sky = Instruments(graph, miss=miss)
    checks = graph.listen(topics.CHECKS)
    night = Night(graph, 'stars 2, check 3, stars 1')
    rows = night.run()
    assert [run['check'][0] for run in rows] == [0.0, 0.0, 1.0, 1.0, 1.0, 0.0]
    assert len({run['star'][0] for run in rows}) == 6
    # a star that is recentred takes three exposures, a blind one is taken as it comes
    assert len(sky.commands) == 2 * 3 + 3 + 3
    for run in rows[2:5]:
        np.testing.assert_allclose([run['miss_x'][0], run['miss_y'][0]], off)
        stamp = round(run['time'][0] * 1e9)
        at = min(sky.readings, key=lambda s: abs(s - stamp))
        star = place(int(run['star'][0]), at)
        # what was learned of the stars before is not carried over
        np.testing.assert_allclose(
            [wrap(sky.readings[at][0][0] - star[0]) / ARCSEC,
             (sky.readings[at][0][1] - star[1]) / ARCSEC], 0.0, atol=0.1)
    graph.wait_for(lambda: checks)
    document = json.loads(checks[-1].data)
    assert document['format'] == 'telescope_mount/blind_checks'
    check, = document['checks']
    assert (check['block'], check['stars'], check['lost']) == (1, 3, 0)
    assert check['rms_arcsec'] == pytest.approx(np.hypot(150.0, 60.0), abs=0.01)
    assert check['mean_y_arcsec'] == pytest.approx(-60.0, abs=0.01)


def test_a_blind_star_out_of_the_field_is_counted_as_lost(graph):
    Instruments(graph, miss=lambda number, *_: (
        (np.nan, np.nan) if number in (2, 3, 4) else (0.0, 0.0)))
    checks = graph.listen(topics.CHECKS)
    Night(graph, 'check 3').run()
    graph.wait_for(lambda: checks)
    check, = json.loads(checks[-1].data)['checks']
    assert (check['stars'], check['lost']) == (2, 1)


def drift_model(**more):
    """10 arcsec of azimuth by approach, 60 an hour of elevation, 3 a degree, and no terms."""
    effects = [
        FittedEffect(effect('hysteresis', axis='az', shape='cosE'), np.array([10.0]) * ARCSEC),
        FittedEffect(effect('drift', of='IE', driver='time', origin=START * 1e-9, scale=3600.0),
                     np.array([60.0]) * ARCSEC),
        FittedEffect(effect('drift', of='IE', driver='temperature', origin=10.0, scale=1.0),
                     np.array([3.0]) * ARCSEC)]
    return PointingModel({'IA': 0.0}, effects=effects, **more)


def test_the_effects_of_the_model_act_with_what_is_known_of_a_pointing(graph):
    sky = Instruments(graph)
    model, air = graph.publisher(topics.MODEL), graph.publisher(topics.AMBIENT)
    night = Night(graph, 'check 8', autostart=False)
    graph.connect()
    model.publish(String(data=drift_model().to_json()))
    air.publish(convert.temperature(START, 14.0))
    graph.report('star_observer', '', 'received /mount/model', 1)
    graph.report('star_observer', '', 'received /mount/ambient/temperature', 1)
    assert graph.call('observe').success
    rows = night.run()
    signs = set()
    for run, (stamp, track) in zip(rows, sky.commands):
        weather = replace(DEFAULT_WEATHER, temperature_c=14.0)  # which bends less, too
        az, el = observed_place(load_catalogue(hip=[int(run['star'][0])]), stamp * 1e-9,
                                DEFAULT_SITE, weather)
        sign = run['approach_az'][0]
        signs.add(sign)
        assert wrap(track[0, 0] - az[0]) / ARCSEC == pytest.approx(10.0 * sign, abs=0.01)
        hours = (stamp - START) * 1e-9 / 3600.0
        assert (track[0, 1] - el[0]) / ARCSEC == pytest.approx(60.0 * hours + 12.0, abs=0.05)
        assert run['temperature'][0] == 14.0
    assert signs == {-1.0, 1.0}


def test_a_drift_of_another_week_is_left_out(graph):
    sky = Instruments(graph)
    model = drift_model(provenance={'last_stamp_ns': START - 7 * 86400 * SECOND})
    graph.publisher(topics.MODEL).publish(String(data=model.to_json()))
    night = Night(graph, 'polaris 1', autostart=False)
    graph.report('star_observer', '', 'received /mount/model', 1)
    graph.connect()
    assert graph.call('observe').success
    night.run()
    stamp, track = sky.commands[0]
    assert (track[0, 1] - place(POLARIS_HIP, stamp)[1]) / ARCSEC == pytest.approx(0.0, abs=0.01)


def test_after_a_diagnosis_it_waits_for_the_model_and_its_own_zero(graph):
    sky = Instruments(graph)
    zero, model, status = (graph.publisher(topic) for topic in (
        topics.ZERO, topics.MODEL, topics.CALIBRATION_STATUS))
    night = Night(graph, 'polaris 1, diagnose, check 1')
    asked = []
    graph.service('diagnose', lambda: (not asked.append(1), 'identified'))
    graph.wait_for(lambda: len(night.rows) == 1)
    stamp = convert.from_stamp(night.rows[0].header.stamp)
    status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=1))
    night.until('waiting', 'the new model')
    in_force = [{'run': 1, 'az_arcsec': 20.0, 'el_arcsec': -9.0}]
    model.publish(String(data=PointingModel({'IE': 30 * ARCSEC}, provenance={
        'last_stamp_ns': stamp, 'zeros_in_force': in_force}).to_json()))
    night.until('waiting', 'the zero of the new model')
    assert len(sky.commands) == 1
    zero.publish(convert.joint_state(stamp, np.array([20.0, -9.0]) * ARCSEC))
    night.run()
    stamp, track = sky.commands[-1]
    star = place(int(cloud_to_run(night.rows[-1])['star'][0]), stamp)
    assert wrap(track[0, 0] - star[0]) / ARCSEC == pytest.approx(20.0, abs=0.01)
    assert (track[0, 1] - star[1]) / ARCSEC == pytest.approx(21.0, abs=0.01)
    assert asked == [1]
