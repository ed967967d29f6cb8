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
import struct
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from calibration.analysis.encoders.cross_check import Homing
from calibration.calibration_state import CalibrationState, Contradiction
from calibration.report.encoder_wording import MARKS_UNKNOWN
from encoder_sim.scenario_file import scenario_files
from msg_tools.bag import BagReader, BagWriter
from msg_tools.convert import from_stamp
from msg_tools.homing import cloud_to_homing, homing_to_cloud
from msg_tools.units import ARCSEC
from pointing_model.calibration_messages import zero_to_joints
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from telescope_mount.cli import main
from telescope_mount.log_check.log_check import _calibrate, _LoggedRows, verify_log
from telescope_mount.log_check.log_comparison import LogComparison

pytestmark = pytest.mark.usefixtures('ros_domain')


def rewrite(source, out, change, leave_out=(), late=()):
    """A copy of a log; ``change(topic, data)`` gives the bytes of each message, those on topics
    `late` are logged after all others.
    """
    log = BagReader(source)
    with BagWriter(out) as new:
        kept = [topic for topic in log.topics if topic.name not in leave_out]
        for topic in kept:
            definition = log.schema_of(topic.name, topic.type)[0].data
            new.add_foreign_topic(topic.name, topic.type, topic.qos, definition, topic.type_hash)
        for name, data in log.metadata.items():
            if name not in ('rosbag2', *leave_out):
                new.add_metadata(name, data)
        for message in log.messages([topic.name for topic in kept]):
            new.write(message.topic, change(message.topic, message.data),
                      message.log_time + 10**12 * (message.topic in late),
                      message.publish_time, message.sequence)
    return out


def flip(topic, number, offset):
    """Change a millionth of a float in the `number`-th message on `topic`, from its end."""
    seen = [0]

    def change(name, data):
        if name == topic:
            seen[0] += 1
            if seen[0] == number + 1:
                data = bytearray(data)
                data[4 - offset] ^= 1
                data = bytes(data)
        return data
    return change


@pytest.fixture(scope='module')
def verified(night):
    return verify_log(night / 'bag')


def test_a_night_is_the_same_to_the_bit(verified):
    report = verified
    assert report['differences'] == [] and report['unchecked'] == []
    # 8 stars and 4 exposures of Polaris, twice; two zeros and that of the model
    rows = ('enc of observation', 'rate of observation', 'offset')
    assert {report['checked'][kind] for kind in rows} == {24}
    assert report['checked']['zero'] == 3 and report['checked']['sigma of the zero'] == 2
    assert report['checked']['model'] == report['checked']['report'] == 1


def test_a_log_in_which_time_went_back_is_refused_in_one_line(night, tmp_path):
    source = BagReader(night / 'bag')
    count, seen = next(t.count for t in source.topics if t.name == '/clock'), []

    def change(topic, data):  # as of a simulator that was started anew amid the night
        if topic == '/clock':
            seen.append(data)
            if len(seen) > count // 2:
                return seen[len(seen) - 1 - count // 2]
        return data
    bag = rewrite(night / 'bag', tmp_path / 'bag', change)
    with pytest.raises(ValueError, match=r'time jumps back from 17\d+\.\d+ s to 17.*2 parts'):
        verify_log(bag)
    assert main(['verify', str(bag)]) == 2


def test_a_node_that_was_logged_late(night, verified, tmp_path):
    late = ('/mount/camera/miss_distance', '/mount/absolute/joint_states')
    bag = rewrite(night / 'bag', tmp_path / 'bag', lambda topic, data: data, late=late)
    assert verify_log(bag) == verified


@pytest.mark.parametrize('topic, number, offset, kinds', [
    # the last of the three arrays of a JointState ends the message: two floats of 8 bytes
    ('/mount/zero', 0, 8, {'sigma of the zero'}),
    ('/mount/camera/miss_distance', 'observed', 22, {'enc of observation', 'abs of observation'}),
    ('/mount/offset', 5, 24, {'offset'}),
])
def test_a_number_that_was_changed_is_found(night, tmp_path, topic, number, offset, kinds):
    if number == 'observed':  # not every exposure becomes an observation
        log = BagReader(night / 'bag')
        wanted = from_stamp(next(
            log.messages('/mount/observation', decode=True)).data.header.stamp)
        number = next(i for i, m in enumerate(log.messages(topic, decode=True))
                      if from_stamp(m.data.header.stamp) == wanted)
    bag = rewrite(night / 'bag', tmp_path / 'bag', flip(topic, number, offset))
    found = verify_log(bag)['differences']
    assert {line.split(' of 1')[0] for line in found} <= kinds and found


def test_a_reading_of_an_observation(night, tmp_path):
    """az_enc of one row: its readings, its offset, and all that follows are no longer right."""
    log = BagReader(night / 'bag')
    (first, *_) = log.messages('/mount/observation', decode=True)
    field = next(f.offset for f in first.data.fields if f.name == 'az_enc')

    def change(topic, data):
        if topic == '/mount/observation' and not done:
            done.append(1)
            place = len(data) - 1 - first.data.point_step + field
            data = bytearray(data)
            for start in range(place - 8, place + 9):
                if struct.unpack_from('<d', data, start) == struct.unpack_from(
                        '<d', bytes(first.data.data), field):
                    data[start + 4] ^= 1
                    return bytes(data)
            raise AssertionError('the value was not found')
        return data
    done = []
    found = verify_log(rewrite(night / 'bag', tmp_path / 'bag', change))['differences']
    kinds = {line.split(' of 1')[0] for line in found}
    assert 'enc of observation' in kinds and {'zero', 'model'} & kinds


@pytest.mark.parametrize('topic', ['model', 'calibration/report'])
def test_a_number_in_a_document(night, tmp_path, topic):
    def change(name, data):
        if name == f'/mount/{topic}':
            place = data.rindex(b'.') + 1
            digit = b'%d' % ((data[place] - 47) % 10)
            data = data[:place] + digit + data[place + 1:]
        return data
    report = verify_log(rewrite(night / 'bag', tmp_path / 'bag', change))
    (line,) = report['differences']
    assert line.startswith(topic.rsplit('/', 1)[-1]) and 'logged' in line


def homed_from_above(message):
    axes = cloud_to_homing(message).values()
    return homing_to_cloud([axis._replace(side=axis.side and 'above') for axis in axes],
                           from_stamp(message.header.stamp))


def test_what_the_encoder_said_of_its_marks_decides(night, tmp_path):
    def change(topic, data):
        if topic == '/mount/incremental/homing':
            data = serialize_message(homed_from_above(deserialize_message(data, PointCloud2)))
        return data
    report = verify_log(rewrite(night / 'bag', tmp_path / 'bag', change))
    (line,) = report['differences']
    assert line.startswith('report of') and 'witnesses.alarms' in line


def test_logs_without_numbers_of_the_marks(night, tmp_path):
    """Old ones have the encoder's diagnostics; a driver may tell nothing at all."""
    def same(topic, data):
        return data
    told = ['/mount/incremental/homing', '/diagnostics']
    old = rewrite(night / 'bag', tmp_path / 'old', same, leave_out=told[:1])
    assert verify_log(old)['differences'] == []

    def unjudged(topic, data):
        if topic == '/mount/calibration/report':
            report = json.loads(deserialize_message(data, String).data)
            report['witnesses']['notes'].insert(0, MARKS_UNKNOWN)
            data = serialize_message(String(data=json.dumps(report)))
        return data
    mute = rewrite(night / 'bag', tmp_path / 'mute', unjudged, leave_out=told)
    assert verify_log(mute)['differences'] == []

    def above(topic, data):
        if topic == '/diagnostics':
            message = deserialize_message(data, DiagnosticArray)
            for row in (row for status in message.status for row in status.values):
                row.value = 'above' if row.key == 'azimuth mark met from' else row.value
            data = serialize_message(message)
        return data
    old = rewrite(night / 'bag', tmp_path / 'old_above', above, leave_out=told[:1])
    (line,) = verify_log(old)['differences']
    assert line.startswith('report of') and 'witnesses.alarms' in line
    # where there are numbers, the rows for people do not count
    new = rewrite(night / 'bag', tmp_path / 'new_above', above)
    assert verify_log(new)['differences'] == []


def test_provenance_decides(night, tmp_path):
    """The seed of the held-out half is in the log, and without it the report is another one."""
    log = BagReader(night / 'bag')
    values = {key: json.loads(text)
              for key, text in log.metadata['parameters /mount/calibration'].items()}
    assert values['split_seed'] == 3
    assert set(log.metadata['telescope_mount']) == {'package', 'catalogue', 'earth orientation'}
    assert [a.name for a in log.attachments] == ['model.json']
    assert log.read_attachment('model.json') + b'\n' == (night / 'model.json').read_bytes()
    truth = BagReader(night / 'bag_truth')
    assert truth.attachments == []
    for node in ('mount_simulator', 'incremental_encoder', 'absolute_encoder', 'camera'):
        public, whole = (bag.metadata[f'parameters /mount/{node}'] for bag in (log, truth))
        assert json.loads(whole['seed']) == 3 and json.loads(whole['scenario']) == 'default'
        assert set(whole) - set(public) == {'scenario', 'seed'}
        assert json.loads(public['start_time']) == json.loads(whole['start_time'])
    assert json.loads(log.metadata['parameters /mount/mcap_logger']['folder']) == 'bag'
    (told,) = truth.messages('/mount/truth/scenario', decode=True)
    assert json.loads(told.data.data) == scenario_files('default')
    bag = rewrite(night / 'bag', tmp_path / 'bag', lambda topic, data: data,
                  leave_out=['parameters /mount/calibration'])
    report = verify_log(bag)
    assert [line.split(' of ')[0] for line in report['differences']] == ['report']
    assert any('no parameters of the calibration' in line for line in report['unchecked'])
    assert verify_log(bag, seed=3)['differences'] == []


@pytest.mark.parametrize('logged, computed, differs, rounded', [
    ([1.0, 0.0], [1.0, 0.0], 0, 0),
    ([6.28, 1e-14], [6.28 * (1.0 + 1e-15), 2e-14], 0, 1),
    ([6.28, 0.5], [6.28, 0.5 + 1e-7], 1, 0),
    ([1.0], [np.nan], 1, 0),
    ('{"a": [1e-12, 5.0], "n": 3}', '{"a": [2e-12, 5.0], "n": 3}', 0, 1),
    ('{"a": 5.0, "n": [1700000000000000001]}', '{"a": 5.0, "n": [1700000000000000002]}', 1, 0),
    ('{"a": 5.0}', '{"a": 5.0001}', 1, 0),
    ('{"a": "one"}', '{"a": "two"}', 1, 0),
    ('{"a": 0.4756369075}', '{"a": 0.4756369061}', 0, 1),
    ('{"a": 1.0, "b": {"c": 2.0}}', '{"a": 1.00000000001, "b": {"c": 3.0}}', 1, 0)])
def test_what_another_processor_rounds_otherwise_is_no_difference(
        logged, computed, differs, rounded):
    check = LogComparison()
    check.compare('zero', logged, computed, 'a night')
    assert (len(check.differences), check.rounded) == (differs, rounded)
    # named is what differs, not what is rounded otherwise
    assert not any('a: logged 1.0,' in line for line in check.differences)


def test_command(night, tmp_path, capsys):
    assert main(['verify', str(night / 'bag')]) == 0
    assert 'are identical bit by bit' in capsys.readouterr().out
    bag = rewrite(night / 'bag', tmp_path / 'bag', flip('/mount/offset', 5, 24))
    assert main(['verify', str(bag)]) == 1
    assert 'difference: offset of 1768' in capsys.readouterr().out
    for path, words in ((night / 'bag_truth', 'truth of the simulator'),
                        (tmp_path / 'absent', 'does not exist')):
        assert main(['verify', str(path)]) == 2
        error = capsys.readouterr().err
        assert words in error and error.count('\n') == 1


def session_of(run, upto):
    """A calibration, and the rows of a log, that have taken the first of `run`."""
    session, rows = CalibrationState(), _LoggedRows()
    more(session, rows, run, upto)
    return session, rows


def more(session, rows, run, upto):
    for k in range(session.rows.taken.kept, upto):
        rows.observations[k + 1] = run.select([k])
        session.add(rows.observations[k + 1], k + 1)


def said(session, rows, model, document=None):
    """What a calibration publishes, into the rows of a log."""
    rows.published['model'].append((session.last_stamp, SimpleNamespace(data=model.to_json())))
    rows.published['zero'].append((session.last_stamp, zero_to_joints(
        session.active_zeros.newest, session.last_stamp)))
    reported(rows, session.report)
    if document is not None:
        rows.published['diagnosis'].append((0, SimpleNamespace(data=json.dumps(document))))


def reported(rows, report):
    rows.published['calibration/report'].append((0, SimpleNamespace(data=json.dumps(report))))


def differences(rows):
    check = LogComparison()
    _calibrate(rows, CalibrationState(), {}, check)
    assert check.unchecked == []
    return check.differences


def stars(n, climb=0.0, checks=0, spread=1.0):
    """A run without ROS, whose elevation zero climbs by ``climb`` (arcsec, of each row), in a part
    of all elevations.
    """
    mount = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))
    rng = np.random.default_rng(1)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    el = el if spread == 1.0 else 0.8 + spread * (el - 0.8)
    enc = np.array(mount.sky_to_encoder(az, el)) + 0.5 * rng.normal(size=(2, n)) * ARCSEC
    enc[1] += climb * ARCSEC
    return PointingRun({
        'time': 1.7e9 + 15.0 * np.arange(n), 'az': az, 'el': el, 'az_enc': enc[0],
        'el_enc': enc[1], 'run': np.ones(n), 'star': 1.0 + np.arange(n),
        'check': 1.0 * (np.arange(n) >= n - checks)})


@pytest.mark.usefixtures('short_diagnosis', 'nothing_expected')
def test_what_was_taken_back_is_taken_back_again():
    # the zero climbs until the first judges have looked, and is back when the next do
    k = np.arange(120)
    run = stars(120, 9.0 * np.minimum(k / 79, 1.0) * (k < 95), checks=40)
    session, rows = session_of(run, 80)
    said(session, rows, session.fit()[0])
    more(session, rows, run, 95)
    found = session.diagnose()
    said(session, rows, found.model, found.document)
    more(session, rows, run, 120)
    found = session.check_on_blind_stars()
    said(session, rows, found.model, found.document)
    assert found.document['judged']['taken_back']
    assert differences(rows) == []


@pytest.mark.usefixtures('short_diagnosis', 'nothing_expected')
def test_stars_that_were_asked_for_are_asked_for_again():
    run = stars(32, spread=0.25)
    # of the line of sight or the azimuth encoder, 4 times a turn: 24 stars do not tell
    run.columns['az_enc'] += 2.0 * ARCSEC * np.sin(4.0 * run['az'] + 1.0) / np.cos(run['el'])
    session, rows = session_of(run, 24)
    said(session, rows, session.fit()[0])
    found = session.diagnose()
    assert found.document['verdict'] == 'ambiguous'
    texts = [session.requests.news()]
    said(session, rows, found.model, found.document)
    for upto in range(25, 33):
        more(session, rows, run, upto)
        texts.append(session.requests.news())
    texts = [text for text in texts if text]
    asked = [json.loads(text) for text in texts]
    assert asked[0]['state'] == 'asks' and asked[0]['request']['why']
    # stars of the same elevations do not tell: it says so, and asks no more
    assert 1 < len(asked) < 9 and asked[-1]['state'] == 'cannot be distinguished from here'
    assert [one['last_stamp_ns'] for one in asked] == [24 + k for k in range(len(asked))]
    assert session.requests.document == asked[-1]
    logged = [texts[0], texts[1].replace('az_deg', 'ra_deg'), *texts[2:]]
    rows.published['apart'] = [(0, SimpleNamespace(data=text)) for text in logged]
    check = LogComparison()
    _calibrate(rows, CalibrationState(), {}, check)
    assert check.checked['stars asked for'] == len(texts)
    assert [line.partition(' of ')[0] for line in check.differences] == ['stars asked for']


@pytest.mark.usefixtures('nothing_expected')
def test_the_marks_heard_beside_a_fit_are_tried_on_the_session_before_it():
    run = stars(100, checks=60)
    session, rows = session_of(run, 80)
    said(session, rows, session.fit(None)[0])
    more(session, rows, run, 100)
    # as of the second fit the log has one state, but the calibration had heard none
    rows.homings.append((100, lambda run: [Homing(1, 'az', True, 'above', mark_error=9.0)]))
    said(session, rows, session.fit(None)[0])
    assert 'judgement' in session.report
    assert differences(rows) == []


def test_a_report_is_computed_from_the_marks_whose_stamp_it_has():
    run = stars(60)
    session, rows = session_of(run, 60)
    marks = [lambda run, i=i: [Homing(1, 'az', True, 'above', mark_error=3.0 * i)]
             for i in range(9)]
    rows.homings, rows.homings_at = [(10**19, one) for one in marks], dict(enumerate(marks))
    model, report = session.fit(marks[7](0))
    report['homing_stamp_ns'] = 7
    said(session, rows, model)
    assert differences(rows) == []
    del report['homing_stamp_ns']  # an old log: no more than a few are tried
    session, rows.published['calibration/report'] = session_of(run, 60)[0], []
    reported(rows, report)
    assert differences(rows)


@pytest.mark.usefixtures('nothing_expected')
def test_reports_of_fits_that_were_refused_are_passed_over(monkeypatch):
    run = stars(40)
    session, rows = session_of(run, 30)
    with monkeypatch.context() as patch:
        patch.setattr('calibration.calibration_state.contradiction',
                      lambda rows, report=None: 'not published' if report else '')
        with pytest.raises(Contradiction, match='not published') as refused:
            session.fit()
    reported(rows, refused.value.report)
    assert session.report is None and not session.active_zeros
    more(session, rows, run, 40)
    said(session, rows, session.fit()[0])
    assert differences(rows) == []


def test_a_night_with_harmonics_is_verified_to_the_bit(other_night, tmp_path):
    text = (other_night.parent / 'stdout').read_text()
    assert 'Harmonics of degree 1' in text and 'chosen by parameter' in text
    found = verify_log(other_night / 'bag')
    assert found['differences'] == [] and found['checked']['model'] == 1
    # without the parameters in the log its report says which harmonics there were
    names = [name for name in BagReader(other_night / 'bag').metadata if 'calibration' in name]
    rewrite(other_night / 'bag', tmp_path / 'bare', lambda topic, data: data, leave_out=names)
    assert names and verify_log(tmp_path / 'bare', seed=3)['differences'] == []
