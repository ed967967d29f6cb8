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

"""A zero that jumps without a power-on is told from an axis that does not follow."""

import numpy as np
import pytest
from live_bench import Live

from msg_tools.units import ARCSEC, DEG
from telescope_mount.observing.axis_demand import Track
from telescope_mount.observing.instrument_health import ABSOLUTE, MOUNT
from telescope_mount.observing.instruments import Instruments
from telescope_mount.observing.zero_jumps import ZeroJumps

SECOND = 10**9
TRACK = Track(0, np.array([0.0, 60.0]), np.array([[1.0, 0.7], [1.0 + 900.0 * ARCSEC, 0.7]]), None)


def seen(path, hertz=20.0, seconds=4.0, track=TRACK, own_zero=False):
    """What is said of a path of both axes, rad, of seconds; noise of 0.2 arcsec."""
    jumps, rng = ZeroJumps(own_zero), np.random.default_rng(3)
    out = []
    for t in np.arange(0.0, seconds, 1.0 / hertz):
        place = np.array(path(t)) + 0.2 * ARCSEC * rng.standard_normal(2)
        found = jumps.take(round(t * SECOND), place, track.demand if track else lambda _: None)
        if found:
            out.append((found[0], round(found[1] / ARCSEC, -1)))
    return out


def on_track(t):
    return np.array([1.0 + 15.0 * ARCSEC * t, 0.7])


@pytest.mark.parametrize('hertz', [10.0, 20.0, 1000.0])
@pytest.mark.parametrize('axis, jump', [(0, 360.0), (1, -360.0), (0, -3600.0)])
def test_a_jump_of_a_zero_on_a_track_is_seen_once(hertz, axis, jump):
    def path(t):
        place = on_track(t)
        place[axis] += jump * ARCSEC * (t > 2.0)
        return place
    assert seen(path, hertz) == [(axis, jump)]


def test_a_jump_is_seen_of_an_encoder_with_another_zero_and_of_one_axis_alone():
    def path(t):
        return on_track(t)[0] + 2.0 * DEG + 360.0 * ARCSEC * (t > 2.0), np.nan
    assert seen(path, own_zero=True) == [(0, 360.0)]
    assert seen(path) == []  # it was not on its track before


@pytest.mark.parametrize('path', [
    on_track,
    # centred by 360 arcsec, gone to with 3 deg/s^2, and a drive that loses its track
    lambda t: on_track(t) - (360.0 * ARCSEC * (t < 1.0), 0.0),
    lambda t: on_track(t) + (1.5 * DEG * max(t - 1.0, 0.0)**2, 0.0),
    lambda t: on_track(t) - (min(20.0 * ARCSEC * t, 360.0 * ARCSEC), 0.0),
    lambda t: on_track(t) - (0.3 * max(t - 1.0, 0.0), 0.0)])
def test_what_an_axis_does_is_no_jump_of_its_zero(path):
    assert seen(path) == []


def test_without_a_command_nothing_is_said():
    assert seen(lambda t: on_track(t) + (360.0 * ARCSEC * (t > 2.0), 0.0), track=None) == []


@pytest.mark.parametrize('axis, word', [(0, 'azimuth'), (1, 'elevation')])
def test_a_zero_that_jumps_is_named_and_not_the_mount(axis, word):
    bench = Live('stars 16', star_seed=2)
    bench.lasts(25.0)
    bench.until(lambda: bench.track is not None and np.abs(
        bench._at(bench.track, bench.stamp) - bench.position).max() < ARCSEC, 600)
    bench.lasts(0.5)
    shift = np.zeros(2)
    shift[axis] = 364.0 * ARCSEC
    bench.reads = lambda angles: tuple(angles + shift)
    bench.names(f'instrument {MOUNT}: zero of the {word} encoder jumped by +36')
    assert 'arcsec without a power-on; home it' in bench.plan.faults[0]
    bench.lasts(20.0)
    assert not any('stays' in text or 'contradicts' in text for text in bench.plan.faults)
    bench.reads = lambda angles: (np.nan, np.nan)  # it is homed
    bench.lasts(0.2)
    bench.reads = tuple
    bench.lasts(5.0)
    assert not any('jumped' in text for text in bench.plan.faults)


@pytest.mark.parametrize('axis, word', [(0, 'azimuth'), (1, 'elevation')])
def test_a_zero_of_the_absolute_encoder_that_jumps_is_named(axis, word):
    """Beside the incremental one: its own zero is degrees from that, and not known."""
    bench = Live('stars 16', star_seed=2)
    zero = np.array([1.3, -0.7]) * DEG
    bench.reads_absolute = lambda angles: tuple(angles + zero)
    bench.lasts(30.0)
    assert bench.plan.faults == []
    zero[axis] += 364.0 * ARCSEC
    bench.names(f'instrument {ABSOLUTE}: zero of the {word} encoder jumped by +36')
    assert len(bench.plan.faults) == 1
    bench.reads_absolute = lambda angles: (np.nan, np.nan)
    bench.lasts(1.0)
    assert bench.plan.faults == []


@pytest.mark.parametrize('both', [True, False])
def test_an_absolute_encoder_is_not_named_for_a_mount_that_is_knocked(both):
    instruments = Instruments()
    for i in range(80):
        knocked = 600.0 * ARCSEC * (i > 40)
        angles = on_track(0.05 * i) + (knocked, 0.0)
        instruments.take_incremental(50_000_000 * (i + 1), angles - (0.0 if both else knocked, 0.0),
                                     (0.0, 0.0))
        instruments.take_absolute(50_000_000 * (i + 1) - 1, angles)
    assert [name == ABSOLUTE for name, _ in instruments.health.sentences] == [True] * (not both)


def test_a_night_without_a_fault_has_no_jump():
    bench = Live('stars 16', star_seed=1)
    bench.lasts(120.0)
    assert bench.plan.faults == [] and len(bench.rows) > 5
