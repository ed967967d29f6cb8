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

"""Each fault of an instrument or a driver is named within two seconds, and ends a plan in the end.

On instruments and a clock of the test: a mount that slews, an encoder at 20 Hz and a camera, on the
time of the wall, each of which may fail.
"""

import logging

import numpy as np
import pytest
from bench import SECOND
from live_bench import Live, pairs

from calibration.analysis.camera_faults import turned_rows
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun
from telescope_mount.observing.instruments import ABSOLUTE, CAMERA, MOUNT


def test_a_night_without_a_fault_says_nothing(caplog):
    bench = Live('stars 8')
    with caplog.at_level(logging.INFO):
        bench.until(lambda: not bench.plan.busy, 20000)
    assert len(bench.rows) == 8 and bench.plan.progress.state == 'done'
    assert {text for _, text in bench.statuses} <= {'the graph', 'stars 8', 'plan finished'}
    assert not [r for r in caplog.records if r.levelno >= logging.WARNING]


def test_a_mount_that_takes_its_time_to_slew_is_no_fault():
    bench = Live('stars 2')
    bench.drives = lambda way: 0.02 * way  # softly, and 0.08 deg/s at most
    bench.lasts(30.0)
    assert bench.plan.faults == [] and len(bench.commands) == 1


def dies(name):
    def fault(bench):
        bench.answers -= {name}
    return fault


def stamped(name, change):
    def fault(bench):
        bench.stamps[name] = change
    return fault


def set_to(**values):
    def fault(bench):
        for name, value in values.items():
            setattr(bench, name, value)
    return fault


FAULTS = [
    (dies(MOUNT), f'instrument {MOUNT}: silent; it sent something every 0.05 s; look at its '
     'driver, power and cable'),
    (dies(ABSOLUTE), f'instrument {ABSOLUTE}: silent; it sent something every 0.05 s'),
    (stamped(MOUNT, lambda t: 0), f'instrument {MOUNT}: stamps are 0; stamp with the time of'),
    (stamped(CAMERA, lambda t: 0), f'instrument {CAMERA}: stamps are 0'),
    (stamped(MOUNT, lambda t: t + 60 * SECOND),
     f"instrument {MOUNT}: stamps 60 s ahead of this machine's clock"),
    (stamped(CAMERA, lambda t: t + 60 * SECOND),
     f"instrument {CAMERA}: stamps 60 s ahead of this machine's clock"),
    (stamped(MOUNT, lambda t: t - 60 * SECOND),
     f"instrument {MOUNT}: stamps 60 s behind this machine's clock"),
    (lambda bench: stamped(MOUNT, lambda _, at=bench.stamp: at)(bench),
     f'instrument {MOUNT}: a stamp not after the one before'),
    (set_to(frame=lambda miss: (40.0, 20.0)),
     f'instrument {CAMERA}: a star outside the field, of 5.73 deg (field_deg): arcsec or '
     'degrees for radians?'),
    (set_to(reads=lambda angles: (np.nan, np.nan)), 'the encoder to be homed (call home)'),
]


@pytest.mark.parametrize('seed', range(1))
@pytest.mark.parametrize('fault, words', FAULTS)
def test_a_fault_is_named_within_two_seconds_and_ends_the_plan(fault, words, seed, caplog):
    bench = Live('stars 16', star_seed=seed + 1, give_up_s=30.0)
    bench.lasts(25.0 + 3.7 * seed)
    assert bench.plan.faults == [] and bench.rows
    fault(bench)
    with caplog.at_level(logging.INFO):
        bench.names(words)
        # said once, and again only when something changes
        bench.lasts(10.0)
    assert len([r for r in caplog.records if words in r.message]) == 1
    bench.until(lambda: not bench.plan.busy, 3000)
    state, text = bench.plan.progress.state, bench.plan.text
    assert state == 'failed' and text.startswith('given up after 30 s without an observation')
    assert words in text
    sent = len(bench.commands)
    assert sent == len(bench.commands)
    bench.lasts(20.0)
    assert len(bench.commands) == sent


@pytest.mark.parametrize('drives, words', [
    (lambda way: 0 * way, 'no axis has moved since the command'),
    (lambda way: way * (1, 0), 'elevation stays'),
    (lambda way: way * (0, 1), 'azimuth stays'),
])
def test_a_deaf_mount_is_named_two_seconds_after_the_command(drives, words):
    bench = Live('stars 16', give_up_s=30.0)
    bench.until(lambda: len(bench.rows) == 2)
    bench.drives = drives
    bench.until(lambda: len(bench.rows) == 2 and len(bench.commands) == 3)
    bench.names(f'instrument {MOUNT}: {words}', within=12.0 if 'stays' in words else 2.0)
    bench.until(lambda: not bench.plan.busy, 3000)
    assert bench.plan.progress.state == 'failed' and words in bench.plan.text


@pytest.mark.parametrize('drives', [lambda way: -way, lambda way: way[::-1] * (1, -1)])
def test_a_mount_that_goes_the_wrong_way_is_named(drives):
    bench = Live('stars 16', give_up_s=30.0)
    bench.drives = drives
    bench.until(lambda: bench.commands)
    bench.names('moves away from its demand: reversed, or the axes are exchanged')


@pytest.mark.parametrize('flip', [lambda m: -m, lambda m: m * (-1, 1), lambda m: m[::-1]])
def test_a_camera_with_a_wrong_sign_is_named_and_ends_the_plan(flip):
    bench = Live('stars 40', give_up_s=60.0)
    bench.off = np.array([150.0, -90.0]) * ARCSEC
    bench.frame = flip
    bench.until(lambda: not bench.plan.busy, 20000)
    assert bench.plan.progress.state == 'failed' and not bench.rows
    assert 'instrument camera: contradicts the commanded motion' in bench.plan.text
    assert 'check-drivers --nudge' in bench.plan.text


def test_a_camera_mirrored_amid_the_night_is_named_dated_and_its_rows_are_known():
    """Of a mount that is 2 arcsec off from star to star; and no row comes until it is right."""
    bench = Live('stars 60', give_up_s=60.0)
    jitter, frame = pairs(np.random.default_rng(5)), bench.frame

    def jittered(track, send=bench.send_command):
        bench.off = 2.0 * ARCSEC * next(jitter)
        send(track)
    bench.send_command = jittered
    bench.until(lambda: len(bench.rows) == 14, 20000)
    bench.frame, since = (lambda miss: miss * (-1.0, 1.0)), len(bench.rows)
    bench.until(lambda: bench.plan.faults, 4000)
    assert any('instrument camera:' in text and 'check-drivers --nudge' in text
               for text in bench.plan.faults)
    named = len(bench.rows)
    bench.lasts(15.0)
    assert len(bench.rows) == named <= since + 5
    rows = PointingRun.concatenate(bench.rows)
    wrong, sense = turned_rows(rows)
    assert sense == 'x mirrored' and not wrong[:since].any()
    assert wrong[since + 2:named].all()
    bench.frame = frame
    bench.until(lambda: len(bench.rows) > named, 2000)
    assert bench.plan.faults == []


def test_a_slow_camera_is_waited_for_and_named():
    bench = Live('stars 3')
    bench.every = 12.0
    bench.until(lambda: not bench.plan.busy, 20000)
    assert len(bench.rows) == 3
    assert bench.statuses[-1][1] == 'plan finished'
    assert any('instrument camera: a message every 12 s, slower than answer_timeout_s' in text
               for _, text in bench.statuses)
    # commanded again while that was not known yet
    assert len(bench.commands) <= 3 + 5


@pytest.mark.parametrize('offered, words', [
    (False, "a server of /mount/home: start the mount's driver, or leave home out of the plan"),
    (True, "/mount/home to answer: it is homing; if the axes do not move, look at the mount's "
           'driver')])
def test_a_home_that_never_answers_is_named_and_ends_the_plan(caplog, offered, words):
    bench = Live('home, stars 3', give_up_s=20.0)
    bench.services = {'home': lambda: None} if offered else {}
    with caplog.at_level(logging.INFO):
        bench.names(words, within=0.1)
        bench.lasts(2.0)
        assert f'waiting for {words}' in caplog.text
        bench.until(lambda: not bench.plan.busy, 3000)
    assert bench.plan.text == f'given up after 20 s without an observation: waiting for {words}'
    assert bench.commands == []
    # and may be begun again once it is mended
    bench.homes()
    bench.plan.start('home, stars 3')
    bench.until(lambda: not bench.plan.busy, 20000)
    assert bench.plan.progress.state == 'done' and len(bench.rows) == 3


@pytest.mark.parametrize('speaks', [True, False])
def test_the_mount_is_homed_again_where_its_encoder_says_nothing_and_not_where_it_is_refused(
        speaks):
    bench = Live('home, stars 3', give_up_s=60.0)
    bench.offers('home')
    words = 'an elevation of 45 rad, beyond the zenith: degrees for radians, or exchanged axes?'

    def refuse(stamp, *_):
        if speaks:
            bench.instruments.count_message(MOUNT, stamp)
            bench.instruments.health.unreadable(MOUNT, words)
            raise ValueError(words)

    bench.instruments.take_incremental = refuse
    bench.lasts(50.0)
    assert (bench.calls == ['home']) == speaks and len(bench.calls) < 11
    if speaks:
        bench.until(lambda: not bench.plan.busy, 3000)
        assert bench.plan.text.startswith('given up after 60 s without an observation: ')
        assert 'waiting for the encoder to be homed' in bench.plan.text
        assert words in bench.plan.text


def test_what_the_graph_lacks_is_logged_and_never_given_up(caplog):
    bench = Live('stars 3', give_up_s=5.0)
    bench.lacks = ['a publisher of /mount/absolute/joint_states']
    with caplog.at_level(logging.INFO):
        bench.lasts(20.0)
        assert caplog.text.count('waiting for the graph: a publisher of /mount/absolute') == 1
    bench.lacks = []
    bench.lasts(3.0)
    assert bench.plan.begun and bench.plan.busy


def test_an_instrument_that_never_spoke_is_named():
    bench = Live('stars 3')
    bench.answers -= {CAMERA}
    bench.lasts(0.5)
    bench.names('instrument camera: has sent nothing yet')


def test_names_that_are_wrong_are_told_until_five_good_messages_have_come():
    bench = Live('stars 3')
    bench.lasts(1.0)
    bench.instruments.health.unreadable(MOUNT, 'joints az and alt')
    bench.lasts(0.5)
    assert bench.plan.faults == []
    bench.answers -= {MOUNT}
    bench.instruments.health.unreadable(MOUNT, 'joints az and alt')
    bench.names('joints az and alt; fix its driver')


def test_a_fault_that_is_over_is_said_and_the_plan_goes_on(caplog):
    bench = Live('stars 6')
    bench.until(lambda: len(bench.rows) == 2)
    bench.answers -= {MOUNT}
    bench.names('silent')
    with caplog.at_level(logging.INFO):
        bench.answers |= {MOUNT}
        bench.until(lambda: not bench.plan.busy, 20000)
    assert 'over: instrument mount and incremental encoder: silent' in caplog.text
    assert bench.plan.progress.state == 'done' and len(bench.rows) == 6


def test_without_a_limit_nothing_is_given_up(monkeypatch):
    monkeypatch.setattr('live_bench.STEP', 0.5)
    bench = Live('stars 3', give_up_s=0.0)
    bench.answers -= {CAMERA}
    bench.lasts(700.0)
    assert bench.plan.busy


def test_a_covered_telescope_is_named():
    bench = Live('stars 5')
    bench.frame = lambda miss: (np.nan, np.nan)
    bench.until(lambda: not bench.plan.busy, 20000)
    assert any('no star in the field of 3 targets in a row; look at clouds, cover' in text
               for _, text in bench.statuses)
