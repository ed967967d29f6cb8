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

"""Rows of exposures that have a length, from a log made here."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from rclpy.serialization import serialize_message

from msg_tools import convert, topics
from msg_tools.bag import BagReader, BagWriter
from msg_tools.units import ARCSEC
from pointing_model.mounts import centred
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import run_to_cloud
from telescope_mount.log_check.log_check import _read
from telescope_mount.log_check.log_comparison import LogComparison
from telescope_mount.observing.axis_demand import Track
from telescope_mount.observing.frame_choice import RATE_OVER, Exposures

SECOND = 10**9
START = 1_768_482_000 * SECOND
LATE = SECOND // 5
MISS = 3.0 * ARCSEC, -2.0 * ARCSEC


def swing(t):
    return 4.0 * ARCSEC * np.sin(np.pi * t) * np.exp(-0.1 * t)


@pytest.fixture(scope='module')
def night(tmp_path_factory):
    """Two stars of a mount that swings, its requests logged last; what the observer made of it."""
    messages, rows, late = [], [], []
    times = np.array([0.0, 20.0, 40.0])
    for begin, at, length in ((START, 8, 1.5), (START + 12 * SECOND, 21, 0.0)):
        track = np.column_stack([1.0 + 1e-4 * times + 1e-7 * times**2, 0.6 - 5e-5 * times])
        if begin > START:
            track = track + 0.2
        out = Exposures(['enc'])
        out.begin(Track(begin, times, track, None))
        request = convert.trajectory(begin, times, track, np.zeros_like(track))
        late += [(topics.REQUEST, request)] * 3 + [(topics.REQUEST, convert.trajectory(
            begin, [], [], []))]
        for i in range(1200):
            t = i / 100.0
            angles = [np.interp(t, times, axis) for axis in track.T] + swing(t) * np.ones(2)
            stamp = begin + i * SECOND // 100
            out.add_reading('enc', stamp, angles)
            messages.append((topics.INCREMENTAL, convert.joint_state(stamp, angles)))
        stamp = START + at * SECOND
        messages.append((topics.MISS_DISTANCE, convert.sky_vector(stamp + LATE, *MISS)))
        out.add_frame(stamp, *MISS)
        assert out.take(30.0 * ARCSEC, None, length, 9.0 * ARCSEC) is not None
        angles, rate = out.over('enc', stamp, length)
        enc = centred(*angles, *MISS)
        row = {'az': enc[0], 'el': enc[1], 'az_enc': enc[0], 'el_enc': enc[1], 'az_rate': rate[0],
               'el_rate': rate[1], 'camera_late': 0.2}
        rows.append((stamp, angles, row | ({'exposure': length} if length else {})))
    for stamp, _, row in rows:
        run = PointingRun({name: np.array([value]) for name, value in row.items()})
        messages.append((topics.OBSERVATION, run_to_cloud(run, stamp)))
    folder = tmp_path_factory.mktemp('rows')

    def write(name, change=lambda topic, message: message):
        with BagWriter(folder / name) as bag:
            for i, (topic, message) in enumerate(messages + late):
                bag.add_topic(f'/mount/{topic.name}', topic.type)
                bag.write(f'/mount/{topic.name}', serialize_message(change(topic, message)),
                          START + i, START + i)
        check = LogComparison()
        _read(BagReader(folder / name), '/mount/', check)
        return check

    return write, rows


def test_the_mean_over_an_exposure_is_verified_to_the_bit(night):
    write, rows = night
    stamp, angles, row = rows[0]
    check = write('right')
    assert check.differences == [] and check.unchecked == []
    assert check.checked == {'enc of observation': 2, 'rate of observation': 2}
    assert RATE_OVER < 1.5 * SECOND  # readings of before that are needed as well
    middle = 1.0 + 1e-4 * 8.0 + 1e-7 * 20.0 * 8.0 + swing(8.0)
    assert abs(angles[0] - middle) > 0.02 * ARCSEC


def test_a_track_that_is_another_is_found(night):
    write, _ = night

    def change(topic, message):
        if topic is topics.REQUEST and message.points:
            # the bend of the track within the exposure; a straight one tells no difference
            message = convert.trajectory(
                convert.from_stamp(message.header.stamp), [0.0, 8.1, 40.0],
                [[1.0, 0.6], [1.001, 0.61], [1.0, 0.6]], np.zeros((3, 2)))
        return message
    (line,) = write('another', change).differences
    assert line.startswith('enc of observation of 1768482008')


def test_without_its_track_a_row_is_not_checked(night):
    write, _ = night
    check = write('none', lambda topic, message: convert.trajectory(START, [], [], [])
                  if topic is topics.REQUEST else message)
    assert check.differences == [] and check.checked['enc of observation'] == 1
    assert check.unchecked == ['observation of 1768482008.000000000 s: its exposure, its track or '
                               'its readings are not in the log']
