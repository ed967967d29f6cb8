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
import threading

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from desk import START, Desk, rows
from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from calibration.calibration_node import Calibration
from calibration.calibration_state import CalibrationState
from msg_tools import topics
from msg_tools.status_rows import Stage
from msg_tools.units import ARCSEC
from pointing_model.calibration_messages import ZeroPairs
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import run_to_cloud
from pointing_model.sky.skyline import parse_horizon
from pointing_model.sky.star_catalogue import POLARIS_HIP

pytestmark = pytest.mark.usefixtures('nothing_expected', 'short_diagnosis')


def eccentric(run):
    """The same rows, read by a disc that lies off its axis."""
    columns = dict(run.columns)
    columns['az_enc'] = columns['az_enc'] + 9.0 * ARCSEC * np.cos(columns['az'] - 0.8)
    return PointingRun(columns)


def test_a_diagnosis_knows_the_skyline_of_the_site(graph, monkeypatch):
    known = []
    monkeypatch.setattr('calibration.analysis.diagnosis.diagnosis.propose',
                        lambda run, *_: known.append(run.obs.run.meta['skyline']) or ([], []))
    desk = Desk(graph, horizon='0 10, 90 10, 90 60, 180 60, 180 10')
    for run in rows(60, seed=2), rows(8, star=POLARIS_HIP, seed=3):
        # refraction, flexure or the elevation encoder: what tells them is asked for
        desk.observe(PointingRun({**run.columns, 'el_enc': run['el_enc']
                                  + 12.0 * ARCSEC * np.cos(2.0 * run['el'] + 2.0)}))
    assert graph.call('diagnose').success
    assert known[0] == parse_horizon('0 10, 90 10, 90 60, 180 60, 180 10')


def test_a_diagnosis_adds_the_effect_and_publishes_what_belongs_together(graph, tmp_path):
    page = tmp_path / 'page.html'
    desk = Desk(graph, site='34.3, 109.0', diagnosis_page=str(page))
    desk.observe(eccentric(rows(60, seed=2)))
    desk.observe(eccentric(rows(8, star=POLARIS_HIP, seed=3)))
    assert graph.call('calibrate_zero').success
    assert graph.call('fit').success
    status = graph.listen(topics.CALIBRATION_STATUS, depth=10)
    answer = graph.call('diagnose')
    assert answer.success, answer.message
    assert answer.message.startswith('identified: azimuth_encoder_1; ')
    documents, models, zeros, said, figures = (graph.listen(topic) for topic in (
        topics.DIAGNOSIS, topics.MODEL, topics.ZERO, topics.ZERO_IDENTITY,
        topics.CALIBRATION_FIGURES))  # late: latched
    graph.wait_for(lambda: documents and models and zeros and said and figures)
    radial = {status.name: float(row.value) for status in figures[0].status
              for row in status.values if row.key == 'radial_arcsec'}
    assert radial['rms/active_model/used'] < 0.7 < radial['rms/7_physical_terms/used']
    document, model = json.loads(documents[0].data), PointingModel.from_json(models[0].data)
    assert document['verdict'] == 'identified' and document['kept_out'] == 0
    assert [e.effect.name for e in model.effects] == document['applied'] == ['azimuth_encoder_1']
    assert model.provenance['last_stamp_ns'] == desk.stamp
    pairs = ZeroPairs()
    pairs.take(said[0])
    _, zero = pairs.take(zeros[0])
    told, = model.provenance['zeros_in_force']
    assert zero.run == told['run'] == 1
    assert zero.angles == pytest.approx([told['az_arcsec'] * ARCSEC, told['el_arcsec'] * ARCSEC])
    fresh = eccentric(rows(50, seed=9))
    x, y = model.residuals(fresh, zero=zero)
    assert np.sqrt(np.mean(x**2 + y**2)) / ARCSEC < 0.7  # the noise: 0.42
    assert 'azimuth' in page.read_text()
    # what takes long is said before it begins
    graph.wait_for(lambda: status and status[-1].message == answer.message)
    assert 'diagnosing' in [message.message for message in status]
    graph.report('calibration', '', 'diagnosis', 'identified: azimuth_encoder_1')


def test_a_diagnosis_can_be_watched_and_cancelled(graph, monkeypatch):
    pause = threading.Event()

    def endless(self, alpha, site, until, progress):
        while not pause.wait(0.01):
            progress('looking', 1, 2)
    desk = Desk(graph)
    desk.observe(rows(30, seed=2))
    status, models = graph.listen(topics.CALIBRATION_STATUS), graph.listen(topics.MODEL)
    graph.connect()
    assert graph.call('fit').success
    assert graph.call('calibration/cancel').message == 'nothing long is under way'
    with monkeypatch.context() as patch:
        patch.setattr(CalibrationState, 'find_effects', endless)
        client = graph.tester.create_client(Trigger, 'diagnose')
        graph.wait_for(client.service_is_ready)
        answer = client.call_async(Trigger.Request())
        graph.wait_for(lambda: status[-1].message == 'diagnosing: looking, 1 of 2')
        assert Stage.read(status[-1]) == ('looking', 1, 2)
        assert 'call calibration/cancel' in graph.call('fit').message
        desk.pub.publish(run_to_cloud(rows(1, seed=3), desk.stamp + 1))
        graph.report('calibration', '', 'received /mount/observation', 31)
        graph.report('calibration', '', 'observations', 30)
        assert graph.call('calibration/cancel').success
        graph.wait_for(answer.done, 'the end of the diagnosis')
    assert (answer.result().success, answer.result().message) == (
        False, 'diagnosing was cancelled')
    # what came meanwhile counts, and nothing else has changed
    graph.report('calibration', '', 'observations', 31)
    assert graph.call('diagnose').success
    graph.wait_for(lambda: len(models) == 2)


def test_rows_kept_out_do_not_reach_fit_and_diagnosis(graph):
    desk = Desk(graph)
    desk.observe(rows(40, seed=2))
    desk.observe(rows(8, star=POLARIS_HIP, seed=3))
    spoilt = rows(20, seed=4)
    spoilt.columns['el_enc'] = spoilt['el_enc'] + 500 * ARCSEC
    marked = PointingRun({**spoilt.columns, 'check': np.ones(20)})
    desk.observe(marked)
    # although the rows before do not have the column
    answer = graph.call('fit')
    assert answer.success and answer.message.startswith('40 stars fitted')
    assert graph.call('diagnose').success
    documents = graph.listen(topics.DIAGNOSIS)
    graph.wait_for(lambda: documents)
    document = json.loads(documents[0].data)
    assert document['kept_out'] == 20 and document['verdict'] == 'none'
    assert document['after']['holdout_rms_arcsec'] == pytest.approx(500.0, abs=5.0)
    assert document['after']['rms_arcsec'] < 1.0


def test_a_diagnosis_that_cannot_be_is_refused_with_a_reason(graph, tmp_path):
    other = Desk(graph, graduation='ha.grating=47200')
    other.observe(rows(3))
    assert 'has no axis ha; its axes are az (azimuth)' in graph.call('diagnose').message
    graph.remove(other.node)
    desk = Desk(graph, diagnosis_page=str(tmp_path / 'no' / 'page.html'))
    assert 'no observation has come yet' in graph.call('diagnose').message
    desk.observe(rows(3))
    answer = graph.call('diagnose')
    assert not answer.success and 'observe more' in answer.message
    desk.observe(rows(40, seed=3))
    apart = graph.listen(topics.DISCRIMINATION)
    answer = graph.call('diagnose')  # without a fit before it, and with no place for the page
    assert answer.success and 'the page was not written' in answer.message
    assert answer.message.startswith('none; ')
    graph.wait_for(lambda: apart)
    assert json.loads(apart[0].data)['state'] == 'nothing open'
    graph.report('calibration', '', 'causes distinguished',
                 'the diagnosis leaves no causes to distinguish: none')


def test_angles_that_are_not_what_they_are_named_are_refused_and_said(graph):
    desk = Desk(graph)
    wrong = rows(40, seed=3)
    wrong.columns['az_enc'] = -wrong['az_enc']
    desk.observe(wrong)
    models = graph.listen(topics.MODEL)
    status = graph.listen(topics.CALIBRATION_STATUS, depth=10)
    for service in ('fit', 'diagnose'):
        answer = graph.call(service)
        assert not answer.success
        assert 'azimuth of the encoders counted the other way' in answer.message
        graph.wait_for(lambda said=answer.message: status and status[-1].message == said)
    assert not models


def test_a_diagnosis_of_too_few_of_the_rows_claims_nothing(graph):
    desk = Desk(graph)
    few = eccentric(rows(60, seed=2))
    few.columns['el_enc'] = np.where(np.arange(60) % 5 < 2, np.nan, few['el_enc'])
    desk.observe(few)
    status = graph.listen(topics.CALIBRATION_STATUS, depth=10)
    answer = graph.call('diagnose')
    assert answer.success and answer.message.startswith('36 of 60 rows are usable')
    graph.wait_for(lambda: status and status[-1].message == answer.message)
    assert status[-1].level == DiagnosticStatus.WARN


@pytest.mark.parametrize('site', ['34.3', '34.3, x', '95, 0', '1, 2, 3'])
def test_a_site_that_is_none_is_refused(graph, site):
    with pytest.raises(ValueError, match='calibration: site = '):
        graph.add(Calibration, site=site)


def test_a_change_that_does_not_hold_is_refused_with_a_warning(graph):
    # the elevation zero climbs while the night's stars are observed, and is back when they are done
    stars, kept = rows(70, seed=5), rows(20, seed=6)
    stars.columns['el_enc'] = stars['el_enc'] + np.linspace(0.0, 8.0, 70) * ARCSEC
    night = PointingRun({
        **{name: np.concatenate([stars[name], kept[name]]) for name in stars.columns},
        'star': np.arange(90) + 1.0, 'check': np.repeat([0.0, 1.0], [70, 20]),
        'time': START * 1e-9 + 15.0 * np.arange(90)})
    desk = Desk(graph)
    models, found = graph.listen(topics.MODEL), graph.listen(topics.DIAGNOSIS)
    reports, said = graph.listen(topics.CALIBRATION_REPORT), graph.listen(topics.CALIBRATION_STATUS)
    answer = graph.call('judge')
    assert not answer.success and 'diagnose first' in answer.message
    desk.observe(night)
    assert graph.call('fit').success
    answer = graph.call('diagnose')
    assert answer.success and answer.message.startswith('withheld; ')
    assert 'not published: elevation_zero' in answer.message
    graph.wait_for(lambda: len(models) == len(reports) == 2 and found)
    before, after = (PointingModel.from_json(message.data) for message in models)
    assert after.terms == before.terms and after.effects == ()
    document = json.loads(found[0].data)
    assert document['verdict'] == 'withheld' and document['refused'][0]['why'] in answer.message
    graph.wait_for(lambda: said and said[-1].message == answer.message)
    assert said[-1].level == DiagnosticStatus.WARN
    graph.report('calibration', 'not published: elevation_zero')
    assert graph.call('judge').message.startswith('the model is the one of before')
    graph.wait_for(lambda: len(models) == 3 and len(found) == 2)
    assert json.loads(models[-1].data)['provenance']['judged'] == 'holds'
    assert json.loads(found[-1].data)['judged']['taken_back'] is False
