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

"""The star observer's plan: services, checks, models, a start in the middle of a night."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from answering import SECOND, START, Instruments, Night, place
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.status_rows import Progress, handover_rows
from msg_tools.units import ARCSEC, wrap
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import cloud_to_run, run_to_cloud
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import POLARIS_HIP, load_catalogue

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
                zero.publish(convert.joint_state(rows(), [0.0, 0.0], frame=''))
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


@pytest.mark.parametrize('late', [False, True])
def test_an_observer_started_anew_takes_its_night_from_the_calibration(graph, late):
    sky = Instruments(graph)
    sky.frame = 'power_on_2@2000000000.000'  # as older drivers say it
    first = Night(graph, 'polaris 5')
    graph.wait_for(lambda: len(first.rows) == 3)
    rows = PointingRun.concatenate(map(cloud_to_run, first.rows[:3]))
    graph.remove(first.node)
    sky.commands.clear()  # the encoder goes on to be read
    rows.columns['run'] = np.full(3, 7.0)  # as the night has numbered it
    night = None
    if late:  # who is discovered first is not told: here it is the instruments
        camera, sky.miss = sky.miss, lambda *_: None
        night = Night(graph, 'polaris 5')
        graph.wait_for(lambda: sky.commands)
        sky.miss = camera
        sky.commands.clear()
    status, table = (graph.publisher(topic) for topic in (
        topics.CALIBRATION_STATUS, topics.CALIBRATION_TABLE))
    status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=3))
    night = night or Night(graph, 'polaris 5')
    graph.report('star_observer', 'the rows of the night so far from the calibration')
    table.publish(run_to_cloud(rows, convert.from_stamp(first.rows[2].header.stamp)))
    left = Progress('observing', 'polaris 5', 0, 3, 5, 3, 7, 0, 'polaris 5')
    status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=3,
                                  **handover_rows(3, left)))
    night.until('done')
    graph.wait_for(lambda: night.tables and night.tables[-1].width == 5)
    got = cloud_to_run(night.tables[-1])
    np.testing.assert_array_equal(got['run'], 7.0)
    np.testing.assert_array_equal(got['encoder_start'], 2e9)


def test_a_calibration_that_is_there_is_heard_before_the_plan_begins(graph):
    sky = Instruments(graph)
    status, _ = (graph.publisher(topic) for topic in (
        topics.CALIBRATION_STATUS, topics.CALIBRATION_TABLE))
    night = Night(graph, 'stars 1')
    graph.report('star_observer', 'waiting for the state of the calibration')
    assert not sky.commands
    status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', observations=0))
    assert len(night.run()) == 1


def test_a_calibration_that_says_nothing_does_not_hold_the_night_up(graph, monkeypatch):
    monkeypatch.setattr('telescope_mount.observing.star_observer_node.ANSWERS_WITHIN', 0.2)
    Instruments(graph)
    graph.publisher(topics.CALIBRATION_TABLE)
    assert len(Night(graph, 'stars 1').run()) == 1


def test_a_service_that_refuses_ends_the_plan_with_its_reason(graph, tmp_path):
    Instruments(graph)
    stuck = [True]
    graph.service('power_cycle', lambda: (not stuck, 'no power' if stuck else 'off and on'))
    night = Night(graph, 'stars 1, power_cycle', state_file=str(tmp_path / 'state'))
    assert night.until('failed') == 'power_cycle: no power'
    status = graph.report('star_observer', 'power_cycle: no power')
    assert status.level == DiagnosticStatus.ERROR
    # and it can be started again, where it stopped
    stuck.clear()
    assert graph.call('observe').message == (
        'plan goes on at step 2, power_cycle: stars 1, power_cycle; to begin it anew call '
        'star_observer/anew')
    assert len(night.run()) == 1
    kept = [json.loads(line) for line in (tmp_path / 'state').read_text().splitlines()]
    assert sum('row' in line for line in kept) == 1 and kept[-1]['plan']['state'] == 'done'
    assert graph.call('star_observer/anew').message == 'plan started: stars 1, power_cycle'


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
    client = graph.tester.create_client(Trigger, 'observe')
    graph.wait_for(client.service_is_ready)
    # the second is sent before the first is answered: as where an answer was lost
    futures = [client.call_async(Trigger.Request()) for _ in range(2)]
    graph.wait_for(lambda: all(future.done() for future in futures))
    assert all(future.result().success for future in futures)
    assert all('stars 2' in future.result().message for future in futures)
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
    zero.publish(convert.joint_state(stamp, [0.0, 0.0], frame=''))
    rows = night.run()
    assert {run['star'][0] for run in rows} == {POLARIS_HIP}
    answer = graph.call('zero_on_stars')
    assert answer.success and 'zero_on_stars 3, calibrate_zero' in answer.message
    assert graph.call('zero').message == 'a plan is under way'


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


@pytest.mark.parametrize('wanted', [[''], ['/mount/star_observer']])
def test_nothing_begins_before_a_guard_has_said_whether_the_mount_may_move(graph, wanted):
    Instruments(graph, guard=False)
    guard = graph.publisher(topics.GUARD_STATUS)
    node = Night(graph, 'stars 1', wait_for_nodes=wanted, autostart=False).node
    reason = 'the guard to say whether the mount may move'
    graph.wait_for(lambda: node.waiting_for() == [reason])
    guard.publish(convert.status(DiagnosticStatus.OK, '/mount/mount_guard', 'idle', state='idle'))
    graph.wait_for(lambda: not node.waiting_for())


def test_foreign_diagnostics_do_no_harm(graph):
    from diagnostic_msgs.msg import DiagnosticArray, KeyValue
    night = Night(graph, 'stars 1', wait_for_nodes=['/mount/star_observer'])
    pub = graph.publisher(topics.ENDPOINTS)
    graph.wait_for(lambda: pub.get_subscription_count() >= 2)
    pub.publish(DiagnosticArray(status=[DiagnosticStatus(
        name='disk', values=[KeyValue(key='published /x', value='many')])]))
    Instruments(graph)
    assert len(night.run()) == 1


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
    zero.publish(convert.joint_state(stamp, np.array([20.0, -9.0]) * ARCSEC, frame=''))
    night.run()
    stamp, track = sky.commands[-1]
    star = place(int(cloud_to_run(night.rows[-1])['star'][0]), stamp)
    assert wrap(track[0, 0] - star[0]) / ARCSEC == pytest.approx(20.0, abs=0.01)
    assert (track[0, 1] - star[1]) / ARCSEC == pytest.approx(21.0, abs=0.01)
    assert asked == [1]
