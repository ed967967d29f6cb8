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

from answering import START, Instruments, Night, place
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.runs.run_messages import cloud_to_run
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE, Site
from pointing_model.sky.star_catalogue import POLARIS_HIP, satellite_target
from telescope_mount.guard.allowed_sky import rows_of
from telescope_mount.guard.limits import Limits
from telescope_mount.observing.star_observer_node import StarObserver

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
        np.testing.assert_allclose(convert.read_sky_vector(offset), [x[0], y[0]], rtol=1e-12)
        np.testing.assert_allclose([run['miss_x'][0], run['miss_y'][0]], miss, rtol=1e-12)
        assert run['time'][0] == pytest.approx(stamp * 1e-9, abs=1e-6)
        assert offset.header.frame_id == 'boresight_optical'


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
    graph.publisher(topics.ZERO).publish(convert.joint_state(START, zero, frame=''))
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
        graph.report('star_observer', 'waiting for a subscriber of /mount/request')
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


def test_a_site_is_that_of_the_start(graph):
    sky = Instruments(graph)
    night = Night(graph, 'polaris 1', autostart=False, latitude_deg=50.0)
    graph.connect()
    done, reason = graph.set_parameter(night.node, latitude_deg=36.0)
    assert not done and 'read-only parameter: latitude_deg' in reason
    graph.call('observe')
    run = night.run()[0]
    assert run['el'][0] / DEG == pytest.approx(50.0, abs=1.0)
    assert sky.commands[0][1][0, 1] / DEG == pytest.approx(50.0, abs=1.0)


def test_a_guard_that_is_missing_is_named_though_others_hear_the_requests(graph):
    Instruments(graph, guard=False)  # it hears requests, as a logger does
    night = Night(graph, 'stars 1')
    graph.report('star_observer', 'waiting for a publisher of /mount/guard/status (no guard is '
                 'there: start mount_guard, nothing else moves the mount)')
    night.until('waiting', 'start mount_guard')
    assert not any('no axis has moved' in status.message for status in night.status)
    graph.publisher(topics.GUARD_STATUS).publish(convert.status(
        DiagnosticStatus.OK, '/mount/mount_guard', 'no request', state='idle'))
    assert len(night.run()) == 1


def test_no_plan_begins_while_the_guard_takes_no_request(graph):
    Instruments(graph, guard=False)
    night = Night(graph, 'stars 1', autostart=False)
    publisher = graph.publisher(topics.GUARD_STATUS)

    def tell(state):
        publisher.publish(convert.status(
            DiagnosticStatus.WARN, '/mount/mount_guard', f'{state}: call resume', state=state))
        graph.wait_for(lambda: night.node.guard.ends == (
            'the mount guard: aborted: call resume' if state == 'aborted' else ''))
    graph.connect()
    tell('aborted')
    answer = graph.call('observe')
    assert not answer.success and answer.message == 'the mount guard: aborted: call resume'
    tell('idle')
    assert graph.call('observe').success and len(night.run()) == 1


def test_no_plan_begins_while_guard_and_observer_are_at_two_sites(graph):
    Instruments(graph, guard=False)
    night = Night(graph, 'stars 1')
    graph.publisher(topics.GUARD_STATUS).publish(convert.status(
        DiagnosticStatus.OK, '/mount/mount_guard', 'no request', state='idle',
        **rows_of(Limits()), latitude_deg=36.0, longitude_deg=109.0))
    night.until('waiting', 'one site: the guard takes the mount to be at 36.0000, 109.0000 deg, '
                'not at 34.3000, 109.0000: give both one site')
    graph.publisher(topics.GUARD_STATUS).publish(convert.status(
        DiagnosticStatus.OK, '/mount/mount_guard', 'no request', state='idle',
        **rows_of(Limits()), latitude_deg=34.3, longitude_deg=109.0))
    assert len(night.run()) == 1 and night.node.guard.elsewhere == ''


def test_its_clients_are_discovered_before_what_the_graph_is_judged_by(graph, monkeypatch):
    """Who is matched with its subscriptions, and says so, can answer its services."""
    made = []

    def noted(name):
        make = getattr(StarObserver, name)

        def note(self, kind, what, *args, **options):
            made.append((name, what))
            return make(self, kind, what, *args, **options)
        monkeypatch.setattr(StarObserver, name, note)

    noted('create_client')
    noted('create_subscription')
    graph.add(StarObserver)
    own = [name for name, what in made if what != '/clock']
    clients = own.count('create_client')
    assert clients > 1 and set(own[:clients]) == {'create_client'}
