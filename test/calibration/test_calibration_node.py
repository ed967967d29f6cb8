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

from desk import MOUNT, START, Desk, rows
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String
from std_srvs.srv import Trigger

from calibration.calibration_figures import calibration_figures
from calibration.calibration_node import Calibration
from calibration.calibration_state import CalibrationState
from calibration.report.encoder_wording import MARKS_UNKNOWN
from msg_tools import convert, topics
from msg_tools.cloud_tables import cloud_to_table
from msg_tools.homing import AxisHoming, homing_to_cloud
from msg_tools.status_rows import Progress, handover
from msg_tools.units import ARCSEC
from pointing_model.calibration_messages import ZeroPairs, pair_to_text
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import run_to_cloud
from pointing_model.sky.star_catalogue import POLARIS_HIP
from pointing_model.zero import PowerOnZero

pytestmark = pytest.mark.usefixtures('nothing_expected', 'short_diagnosis')


def listen_zeros(graph):
    """The (stamp, zero) that come, each with its identity."""
    pairs, out = ZeroPairs(), []
    for topic in (topics.ZERO_IDENTITY, topics.ZERO):
        graph.listen(topic, call=lambda message: out.extend(filter(None, [pairs.take(message)])))
    return out


def test_a_zero_is_refused_with_a_reason_until_polaris_was_seen(graph):
    desk = Desk(graph)
    zeros = graph.listen(topics.ZERO)
    answer = graph.call('calibrate_zero')
    assert not answer.success and 'no observation has come yet' in answer.message
    desk.observe(rows(3))
    answer = graph.call('calibrate_zero')
    assert not answer.success
    assert answer.message == (
        'Polaris was not observed since power-on 1, nor stars for its zero; point at them first')
    desk.observe(rows(1, star=POLARIS_HIP))
    answer = graph.call('calibrate_zero')
    assert not answer.success and 'expose again' in answer.message
    desk.observe(rows(3, star=POLARIS_HIP, seed=1))
    assert graph.call('calibrate_zero').success
    graph.wait_for(lambda: len(zeros) == 1)


def test_an_encoder_that_reads_20_too_much_gives_a_zero_of_plus_20(graph, tmp_path):
    MOUNT.save(tmp_path / 'model.json')
    desk = Desk(graph, model_file=str(tmp_path / 'model.json'))
    desk.observe(rows(8, star=POLARIS_HIP, zero=np.array([20.0, -8.0]) * ARCSEC))
    answer = graph.call('calibrate_zero')
    assert answer.success
    assert answer.message.startswith('zero of power-on 1 by Polaris: azimuth +')
    zeros = graph.listen(topics.ZERO)  # late: it is latched
    graph.wait_for(lambda: zeros)
    stamp, zero, _, sigma = convert.read_joints(zeros[0])
    assert stamp == desk.stamp
    assert zero[0] / ARCSEC == pytest.approx(20.0, abs=1.0)
    assert zero[1] / ARCSEC == pytest.approx(-8.0, abs=1.0)
    assert 0.01 < sigma[0] / ARCSEC < 1.0 and 0.01 < sigma[1] / ARCSEC < 1.0
    assert f'{zero[0] / ARCSEC:+.2f}' in answer.message


def test_a_zero_says_its_power_on_and_its_model(graph):
    desk = Desk(graph)
    zeros, models = listen_zeros(graph), graph.listen(topics.MODEL)

    def observe(run, start):
        desk.observe(PointingRun({**run.columns, 'encoder_start': np.full(len(run), start)}))

    observe(rows(20, seed=2), 1e9)
    observe(rows(8, star=POLARIS_HIP, seed=3), 1e9)
    assert graph.call('fit').success
    observe(rows(8, run=2, star=POLARIS_HIP, seed=4), 2e9)
    assert graph.call('calibrate_zero').success
    graph.wait_for(lambda: len(zeros) == 2 and models)
    name = identity(models[0].data)
    told = [zero for _, zero in zeros]
    assert [(zero.run, zero.started, zero.model) for zero in told] == [
        (1, 1e9, name), (2, 2e9, name)]
    # IA is in the model: by Polaris alone the second would be 300" off beside it
    assert abs(told[1].az) < 3 * ARCSEC


def test_a_zero_by_polaris_alone_goes_with_no_model(graph):
    desk = Desk(graph)
    desk.observe(rows(8, star=POLARIS_HIP))
    assert graph.call('calibrate_zero').success
    zeros = listen_zeros(graph)
    graph.wait_for(lambda: zeros)
    zero = zeros[0][1]
    assert (zero.started, zero.model) == (None, 'none')


def series_of(message):
    """As PlotJuggler reads a DiagnosticArray: each key whose value is a number is a series."""
    return {f'{status.name}/{row.key}': float(row.value)
            for status in message.status for row in status.values}


def test_terms_zero_and_errors_are_numbers_to_plot(graph):
    desk = Desk(graph)
    desk.observe(rows(30, seed=2))
    desk.observe(rows(8, star=POLARIS_HIP, seed=3))
    assert graph.call('calibrate_zero').success and graph.call('fit').success
    topic = (topics.CALIBRATION_FIGURES, topics.CALIBRATION_RESIDUALS, topics.MODEL, topics.ZERO,
             topics.CALIBRATION_REPORT, topics.ZERO_POSE)
    came = [graph.listen(one) for one in topic]
    graph.wait_for(lambda: all(came))
    figures, residuals, model, zero, report, pose = (some[-1] for some in came)
    series, model, report = series_of(figures), PointingModel.from_json(model.data), json.loads(
        report.data)
    assert all(len(status.values) <= 15 for status in figures.status)
    for (name, value), sigma in zip(model.terms.items(), model.sigmas):
        assert series[f'term/{name}/value_arcsec'] == pytest.approx(value / ARCSEC, rel=1e-9)
        assert series[f'term/{name}/sigma_arcsec'] == pytest.approx(sigma / ARCSEC, rel=1e-9)
    _, zero, _, zero_sigma = convert.read_joints(zero)
    assert series['zero/first_axis_arcsec'] == pytest.approx(zero[0] / ARCSEC, rel=1e-9)
    assert series['zero/second_axis_sigma_arcsec'] == pytest.approx(zero_sigma[1] / ARCSEC)
    assert [pose.pose.covariance[i] for i in (35, 28)] == pytest.approx(np.square(zero_sigma))
    assert pose.header.stamp == residuals.header.stamp
    assert series['fit/stars'] == 30.0
    assert series['rms/raw/used/radial_arcsec'] == pytest.approx(
        report['steps'][0]['used']['radial'])
    left = cloud_to_table(residuals)
    assert len(left['residual_right']) == 30
    assert convert.from_stamp(residuals.header.stamp) == desk.stamp
    rms = np.hypot(*(np.sqrt(np.mean(left[f'residual_{way}']**2))
                     for way in ('right', 'up'))) / ARCSEC
    assert series['rms/active_model/used/radial_arcsec'] == pytest.approx(rms)
    assert series['rms/7_physical_terms/used/radial_arcsec'] < rms
    assert rms < series['rms/7_physical_terms/held_out/radial_arcsec']


def test_the_expected_error_is_that_of_the_active_model_not_of_the_fit_before_it():
    model = PointingModel({'CA': 1e-5}, provenance={'expected': {'rms_arcsec': 1.5}})
    figures = calibration_figures(model, None, {'expected': {'rms_arcsec': 3.6}})
    assert figures['expected_error'] == {'rms_arcsec': 1.5}


def test_model_and_report_are_there_for_those_who_come_late(graph):
    desk = Desk(graph)
    desk.observe(rows(30, seed=2))
    desk.observe(rows(8, star=POLARIS_HIP, seed=3))
    assert graph.call('calibrate_zero').success
    answer = graph.call('fit')
    assert answer.success and answer.message.startswith('30 stars fitted')
    models, reports = graph.listen(topics.MODEL), graph.listen(topics.CALIBRATION_REPORT)
    status = graph.listen(topics.CALIBRATION_STATUS)
    graph.wait_for(lambda: models and reports and status)
    model = PointingModel.from_json(models[0].data)
    for name in ('CA', 'AN', 'AW', 'TF'):
        assert model.terms[name] / ARCSEC == pytest.approx(MOUNT.terms[name] / ARCSEC, abs=3.0)
    assert model.provenance['last_stamp_ns'] == desk.stamp
    report = json.loads(reports[0].data)
    assert report['stars'] == 30 and report['polaris'] == 8
    assert status[0].message == answer.message


def with_both_encoders(run):
    return PointingRun({**run.columns, 'time': START * 1e-9 + np.arange(len(run)),
                        'az_abs': run['az_enc'], 'el_abs': run['el_enc']})


def test_what_the_encoder_says_of_its_marks_is_judged(graph):
    met = AxisHoming(True, 'below', 0, 1, np.nan, 0.0686 * ARCSEC, 3 * ARCSEC, 1)
    marks = graph.publisher(topics.HOMING)
    # before the calibration is there
    marks.publish(homing_to_cloud([met._replace(side='above'), met], START))
    desk = Desk(graph)
    graph.publisher(topics.INCREMENTAL)
    graph.report('calibration', '', 'received /mount/incremental/homing', 1)
    desk.observe(with_both_encoders(rows(30, seed=2)))
    reports = graph.listen(topics.CALIBRATION_REPORT)
    assert graph.call('fit').success
    graph.report('calibration', 'homed from above, not from below')
    marks.publish(homing_to_cloud([met, met._replace(mark_error=-120.0, passages=2)], START + 1))
    graph.report('calibration', '', 'received /mount/incremental/homing', 2)
    assert graph.call('fit').success
    graph.report('calibration', 'elevation: incremental encoder, power-on 1: off by -120 counts')
    graph.wait_for(lambda: len(reports) == 2)
    for report, word in zip(reports, ('from above', '-120 counts')):
        told = json.loads(report.data)['witnesses']
        assert len(told['alarms']) == 1 and word in told['alarms'][0]
        assert MARKS_UNKNOWN not in told['notes']


def test_an_encoder_that_tells_nothing_of_its_marks_is_named(graph):
    desk = Desk(graph)
    desk.observe(with_both_encoders(rows(30, seed=2)))
    reports = graph.listen(topics.CALIBRATION_REPORT)
    assert graph.call('fit').success  # no incremental encoder, nothing to judge
    graph.publisher(topics.INCREMENTAL)
    marks = graph.publisher(topics.HOMING)
    status = graph.report('calibration', MARKS_UNKNOWN)
    assert status.level == DiagnosticStatus.WARN
    # what cannot be understood tells nothing either
    other = homing_to_cloud([AxisHoming(True, '', 0, 0, 0.0, 1e-6, 1e-5, 1)] * 2, START)
    other.fields = [field for field in other.fields if field.name != 'mark_error']
    marks.publish(other)
    graph.report('calibration', '1 messages refused')
    graph.report('calibration', MARKS_UNKNOWN)
    assert graph.call('fit').success
    graph.wait_for(lambda: len(reports) == 2)
    notes = [json.loads(report.data)['witnesses']['notes'] for report in reports]
    assert [MARKS_UNKNOWN in note for note in notes] == [False, True]


def test_a_fit_without_enough_stars_is_refused_with_a_reason(graph):
    desk = Desk(graph)
    assert 'no observation has come yet' in graph.call('fit').message
    desk.observe(rows(2))
    answer = graph.call('fit')
    assert not answer.success and 'observe' in answer.message and '\n' not in answer.message
    status = graph.listen(topics.CALIBRATION_STATUS)
    graph.wait_for(lambda: status and status[0].message == answer.message)


def test_bad_observations_are_counted_and_the_node_lives_on(graph):
    desk = Desk(graph)
    good = rows(5)
    truncated = run_to_cloud(good, START)
    truncated.data = bytes(truncated.data)[:40]
    lacking = run_to_cloud(good, START)
    lacking.fields = [f for f in lacking.fields if f.name != 'az_enc']
    nameless = run_to_cloud(PointingRun(
        {name: good[name] for name in ('az', 'el', 'az_enc', 'el_enc')}), START)
    empty = run_to_cloud(good, START)
    empty.fields, empty.data = [], b''
    for message in (truncated, lacking, nameless, empty):
        desk.pub.publish(message)
    status = graph.report('calibration', '4 messages refused')
    assert any('observation without column star' in row.value
               or 'without float64 field' in row.value for row in status.values)
    desk.observe(good)


def test_values_that_are_not_numbers_are_left_out_of_the_fit_and_said(graph):
    desk = Desk(graph)
    bad = rows(2, seed=9)
    bad['az_enc'][:] = np.nan
    desk.observe(bad)
    desk.observe(rows(30, seed=2))
    assert graph.call('fit').success
    reports = graph.listen(topics.CALIBRATION_REPORT)
    graph.wait_for(lambda: reports)
    notes = json.loads(reports[0].data)['notes']
    assert sum('left out' in note for note in notes) == 2


def test_the_table_brings_back_the_night_after_a_restart(graph):
    table = graph.publisher(topics.OBSERVATIONS)
    table.publish(run_to_cloud(rows(12), START))
    graph.add(Calibration)
    graph.report('calibration', '', 'observations', 12)


def test_a_calibration_started_anew_says_what_it_took_up(graph):
    status = graph.listen(topics.CALIBRATION_STATUS)
    night = PointingRun.concatenate([rows(20, seed=2), rows(6, star=POLARIS_HIP, seed=3)])
    table, pair = graph.publisher(topics.OBSERVATIONS), graph.publisher(topics.ACTIVE)
    name = identity(MOUNT.to_json())
    zero = PowerOnZero(3e-6, -4e-6, np.diag([1e-12, 4e-12]), 1, 1e9, name)
    pair.publish(String(data=pair_to_text(MOUNT.to_json(), START, zero)))
    graph.add(Calibration)
    zeros, models = listen_zeros(graph), graph.listen(topics.MODEL)
    # what its predecessor has published died with it, and is latched again
    graph.wait_for(lambda: zeros and models)
    stamp, told = zeros[0]
    assert stamp == START and told == zero and (told.started, told.model) == (1e9, name)
    assert identity(models[0].data) == name
    table.publish(run_to_cloud(night, START))
    graph.wait_for(lambda: 'restored 26 observations, zeros by Polaris of power-ons 1; the active '
                   'model' in status[-1].message, lambda: status[-1].message)
    assert graph.call('calibrate_zero').success
    graph.wait_for(lambda: len(zeros) == 2)
    # beside the model that is in force
    told = zeros[1][1]
    assert told.model == name and abs(told.az) < 3 * ARCSEC


def test_a_tracked_night_is_taken_up_to_the_bit_and_each_star_gives_a_model(graph):
    night = rows(9, seed=5)
    night = PointingRun({**night.columns, 'time': (START + 10**11 * np.arange(1, 10)) * 1e-9})
    stamps = [START + 10**11 * k for k in range(1, 10)]
    state = CalibrationState(MOUNT, mode='track')

    def offline(first, last):
        for i in range(first, last):
            state.add(night.select([i]), stamps[i])
        model, zero = state.tracked.pair(state.last_stamp)
        return model.to_json(), zero

    table, pair = graph.publisher(topics.OBSERVATIONS), graph.publisher(topics.ACTIVE)
    row = graph.publisher(topics.OBSERVATION)
    zeros = listen_zeros(graph)
    models, told = map(graph.listen, (topics.MODEL, topics.TRACKING))
    text, zero = offline(0, 7)
    pair.publish(String(data=pair_to_text(text, stamps[6], zero)))
    table.publish(run_to_cloud(night.select(np.arange(7)), stamps[6]))
    graph.add(Calibration, mode='track')
    graph.report('calibration', '', 'observations', 7)
    graph.report('calibration', '', 'tracking', '7 stars')
    for i in (7, 8):
        row.publish(run_to_cloud(night.select([i]), stamps[i]))
        text, _ = offline(i, i + 1)
        graph.wait_for(lambda text=text: text in [message.data for message in models])
    graph.wait_for(lambda: zeros[-1][1].model == identity(text) and told
                   and json.loads(told[-1].data)['stars'] == 9)
    found = json.loads(told[-1].data)
    assert found['heard'][0]['taken'] and found['expected_arcsec']['1 h'] > 1.0
    answer = graph.call('calibrate_zero')
    assert answer.success and 'followed with each star' in answer.message


def test_a_model_of_a_camera_that_measures_nothing_is_not_published(graph):
    desk = Desk(graph)
    models = graph.listen(topics.MODEL)
    lying = rows(30, seed=2)
    desk.observe(PointingRun({**lying.columns, 'encoder_start': np.full(30, 1e9),
                              'miss_x': np.zeros(30), 'miss_y': np.zeros(30)}))
    for verb in ('fit', 'diagnose'):
        answer = graph.call(verb)
        assert not answer.success
        assert answer.message.startswith('not published: 30 of 30 observations left out')
    graph.report('calibration', 'the camera said the same miss distance')
    assert not models


def test_a_pair_that_does_not_go_together_is_not_taken_up(graph):
    pair = graph.publisher(topics.ACTIVE)
    graph.add(Calibration)
    graph.connect()
    pair.publish(String(data=pair_to_text(MOUNT.to_json(), START, PowerOnZero(0, 0, model='none'))))
    graph.report('calibration', '1 messages refused', 'taken up', 'nothing: up since the start')
    pair.publish(String(data='{}'))
    graph.report('calibration', '2 messages refused', 'taken up', 'nothing: up since the start')


def test_an_observer_that_has_lost_the_night_gets_it_back(graph):
    desk = Desk(graph)
    status, given = graph.listen(topics.CALIBRATION_STATUS), graph.listen(topics.CALIBRATION_TABLE)
    observer = graph.publisher(topics.OBSERVER_STATUS)
    graph.connect()
    at = Progress('observing', 'stars 30', 1, 4, 30, 4, 1, 0, 'home, stars 30')
    desk.observe(rows(4))
    for number, progress in enumerate((at, Progress(plan='home, stars 30'))):
        observer.publish(convert.status(DiagnosticStatus.OK, 'observer', '', **progress.rows()))
        graph.report('calibration', '', 'received /mount/observer/status', number + 1)
    graph.wait_for(lambda: given and handover(status[-1]))
    assert given[-1].width == 4 and handover(status[-1]) == (4, at)


def test_the_status_counts_what_came(graph):
    status = graph.listen(topics.CALIBRATION_STATUS)
    desk = Desk(graph)
    graph.wait_for(lambda: status)
    assert status[0].message.startswith('knows nothing of the night yet')
    desk.observe(rows(3))
    graph.wait_for(lambda: status and status[-1].values[0].value == '3')
    assert status[-1].values[0].key == 'observations'


@pytest.mark.parametrize('overrides, text', [
    ({'model_file': 'absent.json'}, 'absent.json'),
    ({'split_seed': -1}, 'must be 0 to'),
])
def test_bad_start_values(graph, overrides, text):
    with pytest.raises((ValueError, OSError), match=text):
        graph.add(Calibration, **overrides)


def test_the_zero_of_tonight_is_told_before_polaris(graph):
    desk = Desk(graph, reference_age=1)
    told, reports = graph.listen(topics.ZERO_EXPECTED), graph.listen(topics.CALIBRATION_REPORT)
    for run, shift in ((1, 0.0), (2, 6.0), (3, -6.0)):
        zero = np.array([shift, 0.0]) * ARCSEC
        desk.observe(rows(12, run=run, zero=zero, seed=run))
        if run == 3:
            break
        assert not told
        desk.observe(rows(8, run=run, star=POLARIS_HIP, zero=zero, seed=10 + run))
        assert graph.call('fit').success
    graph.wait_for(lambda: told, 'the zero that is expected')
    # the mean of two zeros 6" apart lies 3" below the last one
    change = series_of(told[0])
    assert change['expected_change/first_axis_arcsec'] == pytest.approx(-3.0, abs=1.5)
    assert change['expected_change/first_axis_sigma_arcsec'] > 4.0
    found = json.loads(reports[-1].data)
    assert [row['run'] for row in found['power_ons']] == [1, 2]
    assert 'too few' in found['zero_causes']['text']


@pytest.mark.parametrize('alone', [False, True])
def test_harmonics_are_in_the_model_that_is_published(graph, alone):
    desk = Desk(graph, harmonics='zenith', harmonics_alone=alone, harmonics_degree=1)
    desk.observe(rows(24, seed=2))
    answer = graph.call('fit')
    assert answer.success and '4 harmonics, E read as zenith distance' in answer.message
    models, reports = graph.listen(topics.MODEL), graph.listen(topics.CALIBRATION_REPORT)
    graph.wait_for(lambda: models and reports)
    document = json.loads(models[0].data)
    names = [row['name'] for row in document['harmonics']['coefficients']]
    assert names == ['A0', 'A1', 'A2', 'A3', 'B0', 'B1', 'B2', 'B3']
    assert np.shape(document['harmonics']['covariance_arcsec2']) == (26, 26)
    assert len(document['terms']) == (0 if alone else 7)
    tried = json.loads(reports[0].data)['harmonics']['cross_validation']['choices']
    assert {(one['harmonics'], one['alone']) for one in tried} >= {
        ('none', False), ('zenith', True), ('zenith', False), ('printed', True)}


@pytest.mark.parametrize('given, words', [
    ({'harmonics': 'nadir'}, 'use one of none, zenith, printed'),
    ({'harmonics_alone': True}, 'but no harmonics; take zenith or printed')])
def test_harmonics_that_cannot_be_are_refused_at_the_start(graph, given, words):
    with pytest.raises(ValueError, match=words):
        graph.add(Calibration, **given)


def test_too_few_stars_for_the_harmonics_are_said_and_no_model_comes(graph):
    desk = Desk(graph, harmonics='printed', harmonics_alone=True, harmonics_degree=4)
    models = graph.listen(topics.MODEL)
    desk.observe(rows(10, seed=2))
    answer = graph.call('fit')
    assert not answer.success and not models
    assert 'observe at least 14 stars' in answer.message and '\n' not in answer.message


@pytest.mark.parametrize('name, topic', [('fit', topics.MODEL), ('diagnose', topics.DIAGNOSIS)])
def test_what_is_asked_again_before_its_answer_is_worked_out_once(graph, name, topic):
    desk = Desk(graph)
    desk.observe(rows(30, seed=2))
    published = graph.listen(topic)
    graph.connect()
    if name == 'diagnose':
        assert graph.call('fit').success
    client = graph.tester.create_client(Trigger, name)
    graph.wait_for(client.service_is_ready, name)
    futures = [client.call_async(Trigger.Request()) for _ in range(3)]
    graph.wait_for(lambda: all(future.done() for future in futures), name)
    answers = {(future.result().success, future.result().message) for future in futures}
    assert len(answers) == 1 and answers.pop()[0]
    assert graph.call(name).success  # a later question is another one
    graph.wait_for(lambda: len(published) >= 2)
    assert len(published) == 2
