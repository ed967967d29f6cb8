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

"""The command `watch`: what it says of a log and of messages, and how it is drawn."""

import io
import json
import re
from types import SimpleNamespace as Message

import numpy as np
import pytest
from places import LOG
from rich.console import Console

from msg_tools import topics
from msg_tools.bag import BagReader
from msg_tools.status_rows import Progress
from msg_tools.units import ARCSEC, DEG
from telescope_mount.cli import main
from telescope_mount.dashboard.graph_state import LastMessages
from telescope_mount.dashboard.log_state import log_messages
from telescope_mount.dashboard.terminal_view import ALARMS, Dashboard


@pytest.fixture(scope='module')
def at_end():
    return log_messages(BagReader(LOG), '/mount').state()


def drawn(state, width, encoding='utf-8', note='', whole=True):
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(file=file, width=width, markup=False, highlight=False)
    console.print(Dashboard(state, note, whole))
    file.flush()
    return file.buffer.getvalue().decode(encoding)


def joints(seconds, angles, rates=(0.0, 0.0), frame='', effort=()):
    sec, nano = divmod(round(seconds * 1e9), 10**9)
    return Message(header=Message(stamp=Message(sec=sec, nanosec=nano), frame_id=frame),
                   name=['azimuth', 'elevation'], position=list(angles), velocity=list(rates),
                   effort=list(effort))


def status(level, name, said, **rows):
    return Message(level=level, name=name, message=said, values=[
        Message(key=key, value=str(value)) for key, value in rows.items()])


def test_a_log_says_how_it_ended(at_end):
    rows = [json.loads(m.data.data) for m in BagReader(LOG).messages(
        '/mount/calibration/report', decode=True)][-1]
    assert at_end.plan['state'] == 'done' and at_end.plan['observations'] == 20
    assert len(at_end.stars['time_s']) == 20 and len(at_end.nodes) == 8 and at_end.alarms == []
    # the last zero, as the log has it and the fit reported it within its sigma
    zero = [m.data for m in BagReader(LOG).messages('/mount/zero', decode=True)][-1]
    assert np.allclose(at_end.zero_arcsec, np.array(zero.position) / ARCSEC)
    assert abs(at_end.zero_arcsec[0] - rows['zeros'][-1]['az_arcsec']) < 10.0
    stars = at_end.stars
    assert sorted(set(stars['power_on'])) == [1.0, 2.0]
    since = [value for value, run in zip(stars['encoders_first_arcsec'], stars['power_on'])
             if run == 2.0]
    assert f'azimuth: {min(since):.2f} to {max(since):.2f}″' in drawn(at_end, 80)
    # what the zero alone leaves: the offset less the zero, on the sky
    el = stars['el_deg'][-1] * DEG
    assert at_end.left_by == 'zero'
    assert stars['left_x_arcsec'][-1] == pytest.approx(
        stars['offset_x_arcsec'][-1] - at_end.zero_arcsec[0] * np.cos(el), abs=1e-6)
    assert stars['left_y_arcsec'][-1] == pytest.approx(
        stars['offset_y_arcsec'][-1] - at_end.zero_arcsec[1], abs=1e-6)


def test_a_log_at_an_earlier_time(at_end):
    bag = BagReader(LOG)
    then = log_messages(bag, '/mount', bag.start_time + 200 * 10**9).state()
    assert then.plan['state'] == 'observing' and then.zero_arcsec is None and then.left_by == ''
    assert then.stars['time_s'] == at_end.stars['time_s'][:9] and then.time_utc < at_end.time_utc
    with pytest.raises(ValueError, match='no message of a graph in /other'):
        log_messages(bag, '/other')


def test_encoders_are_compared_at_one_time_and_a_zero_of_another_power_on_is_told():
    heard = LastMessages('a graph')
    rate = 15.0 * ARCSEC
    heard.take(topics.INCREMENTAL.name, joints(100.0, (7.0, 0.5), (rate, 0.0), 'power_on_2@50.000'))
    heard.take(topics.ABSOLUTE.name, joints(
        100.2, (7.0 - 2 * np.pi + 0.2 * rate - 5 * ARCSEC, 0.5 + 3 * ARCSEC)))
    heard.take(topics.ZERO.name, joints(90.0, (1e-3, 2e-3), frame='power_on_1@10.000',
                                        effort=(1e-6, 1e-6)))
    state = heard.state()
    assert state.encoders_arcsec == pytest.approx([5.0, -3.0], abs=1e-6)
    assert state.looks_at_deg == pytest.approx([7.0 / DEG % 360.0, 0.5 / DEG])
    assert (state.power_on, state.zero_power_on) == (2, 1)
    assert state.alarms == [{'level': 'warning',
                             'said': 'the zero is of power-on 1, and this is power-on 2'}]
    heard.take(topics.ABSOLUTE.name, joints(101.0, (7.0, 0.5)))
    assert heard.state().encoders_arcsec is None  # too far apart


def test_alarms_the_worst_first_and_nodes_that_fall_silent():
    heard = LastMessages('a graph')
    heard.take(topics.DIAGNOSTICS.name, Message(status=[
        status(b'\1', '/mount/camera', 'no image; 3 messages lost'),
        status(b'\2', '/mount/driver', 'axis 1 stalled'),
        status(b'\2', '/north/driver', 'of another mount'), status(b'\0', '/mount/guard', 'ok')]),
        arrived=10.0)
    heard.take(topics.GUARD_STATUS.name, status(b'\0', 'guard', 'as requested', state='following'))
    for name, said in ((topics.OBSERVER_STATUS, 'no image'), (topics.CALIBRATION_STATUS, 'lost')):
        heard.take(name.name, status(b'\1', {'no image': '/mount/camera'}.get(said, 'x'), said,
                                     **Progress().rows()))
    heard.take(topics.CALIBRATION_REPORT.name, Message(data=json.dumps(
        {'witnesses': {'alarms': ['elevation: the witnesses differ']}})))
    heard.take(topics.INCREMENTAL.name, joints(1.0, (np.nan, np.nan)))
    heard.take(topics.OBSERVATION.name, Message(
        header=Message(frame_id='mount_enu'), width=1, height=1, fields=[], data=b''))
    told = [(row['level'], row['said']) for row in heard.state(now=11.0).alarms]
    assert told[:2] == [('error', '/mount/driver: axis 1 stalled'),
                        ('error', 'elevation: the witnesses differ')]
    assert {said for level, said in told if level == 'warning'} >= {
        '/mount/camera: no image; 3 messages lost',
        'the incremental encoder is not homed'}
    assert not any('another mount' in said for _, said in told)
    # what a node says on /diagnostics, too, is told once
    assert ('warning', 'calibration/status: lost') in told
    assert not any(said.startswith('observer/status') for _, said in told)
    assert any('observation: a message that cannot be used' in said for _, said in told)
    assert heard.state(now=20.0).alarms[0]['said'].startswith('all 3 nodes are silent for 10 s')
    heard.take(topics.DIAGNOSTICS.name, Message(status=[
        status(b'\1', '/mount/camera', 'no image'), status(b'\1', '/mount/sky', 'no stars')]),
        arrived=19.0)
    late = heard.state(now=20.0)
    assert late.nodes['/mount/guard']['level'] == 'silent'
    assert [row['said'] for row in late.alarms[:2]] == [
        '/mount/driver: silent for 10 s', '/mount/guard: silent for 10 s']
    text = drawn(late, 80, whole=False)
    assert f'and {len(late.alarms) - ALARMS} more' in text and 'guard following' in text
    text = drawn(late, 20)
    # a name that is wider than the window goes on in the next line
    assert all(row['said'].replace(' ', '') in ''.join(text.split()) for row in late.alarms)
    assert 'and so on' in drawn(late, 20, whole=False)
    assert heard.state().nodes['/mount/guard']['level'] == 'ok'  # a log is never silent


@pytest.mark.parametrize('encoding', ['utf-8', 'ascii'])
@pytest.mark.parametrize('width', [200, 80, 76, 75, 40, 20])
def test_no_number_is_cut_and_no_line_too_long(at_end, width, encoding):
    text = drawn(at_end, width, encoding, 'Ctrl-C ends')
    assert max(map(len, text.splitlines())) <= width
    assert all(line == line.rstrip() for line in text.splitlines())
    words, second = ' '.join(text.split()), '″' if encoding == 'utf-8' else '"'
    state = at_end
    for value in (*state.zero_arcsec, *state.encoders_arcsec, *state.miss_arcsec,
                  state.stars['offset_x_arcsec'][-1], state.stars['left_y_arcsec'][-1]):
        assert f'{value:+.2f}{second}' in words
    for value in state.reading_deg:
        assert re.search(rf'(^| ){value:.4f}( deg|°)', words)
    assert 'Ctrl-C ends' in words and '20 stars observed' in words and '…' not in text
    assert text.count('•' if encoding == 'utf-8' else '*') > 10
    if width == 80:
        assert len(text.splitlines()) <= 24


def test_what_others_say_cannot_move_the_cursor():
    heard = LastMessages('a graph')
    heard.take(topics.GUARD_STATUS.name, status(0, 'guard', 'a\x1b[2Jb\r\nc', state='idle'))
    text = drawn(heard.state(), 80)
    assert '\x1b' not in text and 'a [2Jb c' in text and 'no node reports' in text


def test_the_command(capsys):
    assert main(['watch', str(LOG)]) == 0
    assert 'plan done; 20 stars observed' in capsys.readouterr().out
    assert main(['watch', str(LOG), '--at', '2026-01-15T13:03:00', '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert document['plan']['state'] == 'observing' and document['zero_arcsec'] is None
    for words, said in ((['--at', '5'], '--at needs a log'),
                        ([str(LOG), '--domain', '3'], '--domain applies to a running graph'),
                        ([str(LOG), '--at', '2020-01-01'], 'is before the log begins')):
        assert main(['watch', *words]) == 2
        assert said in capsys.readouterr().err
