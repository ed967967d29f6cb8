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

"""Clocks that jump, messages that come twice, late or out of order, and clouds: the rows are the
same as without, or there is a reason why there is none.

On instruments and a clock of the test; each exposure has readings all along it, and an error of
the mount that changes from one to the next, so that a pair of two exposures would show.
"""


import numpy as np
import pytest
from bench import EXPOSURE, SECOND, Bench

from msg_tools.units import ARCSEC, wrap
from pointing_model.mounts import centred
from telescope_mount.observing.instruments import ABSOLUTE, CAMERA, MOUNT, Instruments
from telescope_mount.observing.sequencer import Sequencer

HOUR = 3600 * SECOND
STARS = 12
#: of an offset: interpolated between knots of the track
SAME = 0.02 * ARCSEC


class Played(Bench):
    """A bench whose messages are reordered, and whose clock may jump at an exposure.

    Attributes
    ----------
    order : callable
        Makes of an exposure's messages, (name, stamp, values) each, those that come in.
    jumps : dict of int to int
        Number of the exposure in the middle of which the clock jumps -> ns.
    alone : bool
        Whether it is that of the camera, which from then on is off.
    """

    def __init__(self, plan, order=list, jumps=(), alone=False, **settings):
        super().__init__(plan, homed=False, **settings)
        self.order, self.jumps, self.alone = order, dict(jumps), alone
        self.instruments = Instruments(1, wall=lambda: self.wall, now=lambda: self.stamp)
        self.plan = Sequencer(
            self, self.instruments, self.in_force, self.table, looks=0.0)
        self.read(self.stamp, self.position)
        self.plan.start(plan)
        self.seen = lambda number: True
        self.number, self.read_then, self.late = 0, {}, 0

    def take(self, name, stamp, values):
        try:
            if name == CAMERA:
                self.instruments.take_frame(stamp, *values)
            elif name == MOUNT:
                self.instruments.take_incremental(stamp, tuple(values), (0.0, 0.0))
            else:
                self.instruments.take_absolute(stamp, tuple(values))
        except ValueError as err:
            self.refused.append(str(err))

    def off(self, number):
        """By how much this exposure finds the star off, rad."""
        return np.array([10.0 + number, 5.0 - number]) * ARCSEC

    def tick(self):
        self.plan.look(self.wall)
        track, self.pending = self.pending, None
        if track is None:
            self.wall += 0.1
            self.plan.advance()
            return
        self.wall += 0.01
        self.number += 1
        jump = self.jumps.get(self.number, 0)
        if self.alone:
            self.late += jump
            jump = 0
        messages = []
        for at in np.arange(11, 31) * SECOND:
            stamp, moved = track.start + int(at), jump if at >= EXPOSURE else 0
            place = np.array([np.interp(at * 1e-9, track.times, axis) for axis in track.angles.T])
            messages += [(MOUNT, stamp + moved, place), (ABSOLUTE, stamp + moved, place)]
            if at == EXPOSURE:
                miss = self.off(self.number) if self.seen(self.number) else (np.nan, np.nan)
                messages.append((CAMERA, stamp + moved + self.late - SECOND // 4,
                                 miss))
                self.read_then[self.number] = [
                    np.interp(at * 1e-9 - 0.25, track.times, axis) for axis in track.angles.T]
            if at == EXPOSURE - SECOND:
                self.position = place
        for message in self.order(messages):
            if message[0] == MOUNT:
                self.stamp = message[1] if jump < 0 else max(self.stamp, message[1])
            self.take(*message)
            self.plan.advance()


def twice(messages):
    return [one for message in messages for one in (message, message)]


def camera_late(messages):
    """The frame 3 s after the readings beside it, and once more at the end."""
    frames = [one for one in messages if one[0] == CAMERA]
    rest = [one for one in messages if one[0] != CAMERA]
    at = next(i for i, one in enumerate(rest) if one[1] > frames[0][1] + 3 * SECOND)
    return rest[:at] + frames + rest[at:] + frames


def readings_late(messages):
    """Each fourth reading of both encoders 3 s late."""
    return [one for _, one in sorted(
        ((one[1] + 3 * SECOND * (one[0] != CAMERA and i % 4 == 0), i), one)
        for i, one in enumerate(messages))]


def exchanged(messages):
    """Neighbours in time of each instrument, and the encoders with one another."""
    out = list(messages)
    for i in range(0, len(out) - 4, 4):
        out[i], out[i + 2], out[i + 1], out[i + 3] = out[i + 2], out[i], out[i + 3], out[i + 1]
    return out


def whole(plan=f'stars {STARS}', **played):
    bench = Played(plan, **played)
    bench.until(lambda: not bench.plan.busy, 500)
    return bench


def of_its_own_exposure(bench):
    """Whether each row has the reading and the miss distance of one exposure."""
    for row in bench.rows:
        number = round(row['miss_x'][0] / ARCSEC) - 10
        az, el = centred(*bench.read_then[number], *bench.off(number))
        assert abs(wrap(row['az_enc'][0] - az)) < SAME and abs(row['el_enc'][0] - el) < SAME
    return True


def test_played_in_order_each_row_is_of_its_exposure():
    bench = whole()
    assert len(bench.rows) == STARS and bench.refused == [] and of_its_own_exposure(bench)


@pytest.mark.parametrize('order', [twice, camera_late, readings_late, exchanged])
def test_what_comes_twice_late_or_out_of_order_makes_no_wrong_row_and_is_named(order):
    bench = Played(f'stars {STARS}', order=order)
    for _ in range(40):
        bench.tick()
    assert of_its_own_exposure(bench)
    stamps = [row['time'][0] for row in bench.rows]
    assert len(set(stamps)) == len(stamps) and len(bench.commands) > 3
    assert len(bench.rows) == STARS or any('stamp' in text for text in bench.plan.faults)


@pytest.mark.parametrize('jump', [HOUR, -HOUR])
def test_no_pair_across_a_jump_of_the_clock_and_the_plan_ends(jump):
    bench = whole(jumps={5: jump})
    assert (bench.plan.progress.state, len(bench.rows)) == ('done', STARS)
    assert of_its_own_exposure(bench)


def test_a_camera_whose_clock_jumps_by_an_hour_gives_no_row():
    for jump in (HOUR, -HOUR):
        bench = Played(f'stars {STARS}', jumps={5: jump}, alone=True)
        for _ in range(60):
            bench.tick()
        assert bench.plan.busy and len(bench.rows) == 4 and of_its_own_exposure(bench)
        assert any(f'{CAMERA}: ' in text for text in bench.plan.faults)


@pytest.mark.parametrize('seen', [lambda number: number % 8 < 4,
                                  lambda number: not 6 <= number < 24])
def test_clouds_lose_stars_and_leave_the_rows_right(seen):
    """Of each blank field three exposures are made."""
    bench = Played(f'stars {STARS}')
    bench.seen = seen
    bench.until(lambda: not bench.plan.busy, 500)
    at = bench.plan.progress
    assert at.state == 'done' and at.lost >= 2 and len(bench.rows) + at.lost == STARS
    assert len(bench.rows) > 3 and of_its_own_exposure(bench)
