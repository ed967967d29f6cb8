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

"""Exposures on a mount that swings: they count when it was on its track all the time."""

from functools import cached_property

import numpy as np
import pytest
from bench import SECOND, offset
from live_bench import SPEED, STEP, Live

from msg_tools.units import ARCSEC, DEG, wrap
from telescope_mount.observing.axis_demand import Track
from telescope_mount.observing.frame_choice import Exposures
from telescope_mount.observing.instruments import MOUNT

SUB = 10  # steps of the swing in a step of the bench


class SoftMount(Live):
    """An axis is a spring on its drive: a frequency in Hz, a damping, and no more."""

    frequency, damping, length = 0.5, 0.15, 1.0

    def __init__(self, plan, **settings):
        super().__init__(plan, **settings)
        self.driven, self.velocity = self.position.copy(), np.zeros(2)
        self.seen = []
        self.every = 1e9  # exposed here

    def _slew(self):
        before = self.driven.copy()
        if self.track is not None:
            self.driven += np.clip(self._at(self.track, self.stamp) - self.driven,
                                   -SPEED * STEP, SPEED * STEP)
        self.position, self.velocity = self._swing @ [
            self.position, self.velocity, before, self.driven]

    @cached_property
    def _swing(self):
        """Position and velocity a step later: each the sum of so much of both, and of the drive
        before and after.
        """
        position, velocity, before, driven = np.eye(4)
        omega, h = 2.0 * np.pi * self.frequency, STEP / SUB
        for i in range(SUB):
            drive = before + (driven - before) * (i + 1) / SUB
            rate = (driven - before) / STEP
            pull = omega**2 * (drive - position) + 2.0 * self.damping * omega * (rate - velocity)
            velocity = velocity + h * pull
            position = position + h * velocity
        return np.array([position, velocity])

    def tick(self):
        super().tick()
        if self.star is None:
            return
        star = self._at(self.star, self.stamp)
        miss = np.array([wrap(star[0] - self.position[0]) * np.cos(star[1]),
                         star[1] - self.position[1]])
        self.seen.append((self.stamp, miss))
        if self.stamp - self.seen[0][0] >= self.length * SECOND - 1:
            stamps, images = zip(*self.seen)
            mean = np.trapezoid(images, dx=1.0, axis=0) / (len(images) - 1)
            found = np.hypot(*mean) < 0.3 * DEG and np.ptp(images, axis=0).max() < 0.05 * DEG
            self.seen = self.seen[-1:]
            self._try(self.instruments.take_frame, (stamps[0] + stamps[-1]) // 2,
                      *(mean + ARCSEC * next(self.noise) if found else (np.nan, np.nan)))


def radial(exposure, stars=8, **changes):
    bench = SoftMount(f'stars {stars}', exposure_s=exposure, absolute=False)
    for name, value in changes.items():
        setattr(bench, name, value)
    bench.until(lambda: not bench.plan.busy, 60000)
    assert bench.plan.progress.state == 'done', bench.plan.text
    return bench, np.array([offset(row) for row in bench.rows])


@pytest.fixture(scope='module')
def soft():
    return radial(1.0)


def test_on_a_soft_mount_offsets_are_as_good_as_their_noise(soft):
    bench, offsets = soft
    assert len(offsets) == 8 and bench.plan.progress.lost == 0
    # 1 arcsec an axis: 16 numbers, whose rms is within 2.6 sigma of that
    assert np.sqrt(np.mean(offsets**2)) == pytest.approx(1.0, abs=2.6 / np.sqrt(32))


def test_a_reading_in_the_middle_alone_is_not(soft):
    _, middle = radial(0.0)
    assert np.sqrt(np.mean(middle**2)) > 2.0


def test_a_mount_that_never_rests_is_named():
    bench = Live('stars 3', exposure_s=1.0)
    bench.reads = lambda angles: (angles[0], angles[1] + 8.0 * ARCSEC * np.sin(
        np.pi * (bench.stamp % (2 * SECOND)) / SECOND))
    bench.lasts(40.0)
    assert not bench.rows
    text = bench.statuses[-1][1]
    assert f'instrument {MOUNT}: moves by 1' in text
    assert 'arcsec beside its track within an exposure, smear_arcsec = 5; look at brakes' in text


# --- the numerics ---------------------------------------------------------------------------------


def paired(wave, stamp=5 * SECOND, exposure=1.0, smear=5.0, tolerance=30.0):
    """Exposures with readings at 100 Hz beside a track that goes on evenly."""
    out = Exposures(['enc'])
    times = np.array([0.0, 20.0])
    track = np.column_stack([0.1 + 1e-4 * times, 0.5 + 2e-4 * times])
    out.begin(Track(0, times, track, None))
    for i in range(1001):
        t = i / 100.0
        out.add_reading('enc', round(t * SECOND), (0.1 + 1e-4 * t + wave(t) * ARCSEC,
                                                   0.5 + 2e-4 * t))
    out.add_frame(stamp, 0.0, 0.0)
    return out, out.take(tolerance * ARCSEC, None, exposure, smear * ARCSEC)


def test_the_reading_of_an_exposure_is_its_mean():
    wave = lambda t: 4.0 * (t - 5.0) ** 2 - 1.0  # noqa: E731
    out, found = paired(wave)
    assert found is not None
    angles, _ = out.over('enc', 5 * SECOND, 1.0)
    assert angles[0] == pytest.approx(0.1 + 5e-4 + (4.0 / 12.0 - 1.0) * ARCSEC, abs=1e-3 * ARCSEC)
    assert angles[1] == pytest.approx(0.5 + 1e-3, abs=1e-12)


@pytest.mark.parametrize('wave, counts', [
    (lambda t: 0.0, True),
    (lambda t: 20.0, True),  # beside the track, and at rest
    (lambda t: 40.0, False),
    (lambda t: 40.0 * (t < 4.52), False),  # off target at the begin
    (lambda t: 6.0 * (t - 5.0), False),  # moves, and is right in the middle
    (lambda t: 4.0 * (t - 5.0), True),
    (lambda t: 40.0 * (t < 4.48) + 40.0 * (t > 5.52), True),  # of before and after
])
def test_an_exposure_counts_when_all_of_it_was_on_target(wave, counts):
    out, found = paired(wave)
    assert (found is not None) is counts


def test_an_exposure_that_began_before_the_track_does_not_count():
    assert paired(lambda t: 0.0, stamp=4 * SECOND // 10)[1] is None
    assert paired(lambda t: 0.0, stamp=6 * SECOND // 10)[1] is not None


def test_an_exposure_waits_for_the_readings_of_its_end():
    assert paired(lambda t: 0.0, stamp=96 * SECOND // 10)[1] is None
    assert paired(lambda t: 0.0, stamp=95 * SECOND // 10)[1] is not None


def test_what_moved_is_remembered():
    out, _ = paired(lambda t: 12.0 * (t - 5.0))
    assert np.array(out.restless) / ARCSEC == pytest.approx([12.0 * np.cos(0.501)], rel=1e-3)
