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

"""What bounds a track, and a slew onto it, holds all of it."""

import numpy as np
import pytest

from msg_tools.units import DEG
from telescope_mount.guard.axis_track import Cubic, resting
from telescope_mount.guard.limits import Axis
from telescope_mount.guard.motion import AxisState, Slew, moment, plan_move

AXES = (Axis(-4.0, 4.0, 4.0 * DEG, 3.0 * DEG), Axis(-2.0, 2.0, 2.0 * DEG, 1.0 * DEG))


def drawn(rng, knots, rate):
    """A track of random rates, rad/s."""
    times = np.cumsum(rng.uniform(0.5, 20.0, knots))
    rates = rng.uniform(-rate, rate, (knots, 2))
    steps = np.diff(times)[:, None] * (rates[1:] + rates[:-1]) * rng.uniform(0.3, 0.7)
    angles = rng.uniform(-1.0, 1.0, 2) + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, 0)])
    return Cubic(times, angles, rates)


@pytest.mark.parametrize('seed', range(12))
def test_ends_and_peaks_of_a_track_are_those_of_all_of_it(seed):
    rng = np.random.default_rng(seed)
    cubic = drawn(rng, rng.integers(2, 13), 0.02)
    t = np.linspace(cubic.times[:-1], cubic.times[1:], 501)  # (501, pieces)
    for i in (0, 1):
        angles, rates = np.array([cubic.at(at, i) for at in t.ravel()]).T.reshape(2, *t.shape)
        assert angles.min() == pytest.approx(cubic.low[i], abs=1e-6)
        assert angles.max() == pytest.approx(cubic.high[i], abs=1e-6)
        assert cubic.hull[0][i] - 1e-12 <= angles.min() and angles.max() <= cubic.hull[1][i] + 1e-12
        assert np.abs(rates).max() == pytest.approx(cubic.peak_rate[i], rel=1e-4)
        assert cubic.most_rate[i] >= cubic.peak_rate[i]
        assert np.abs(np.diff(rates, axis=0) / np.diff(t, axis=0)).max() == pytest.approx(
            cubic.peak_acceleration[i], rel=0.01)
        begin, end = np.sort(rng.uniform(cubic.times[0], cubic.times[-1], 2))
        within = rates[(t >= begin) & (t <= end)]
        assert cubic.change(begin, end, i) >= np.ptp(within) - 1e-12
    turned, turns = cubic.turned(1, -1), [2.0 * np.pi, -2.0 * np.pi]
    assert turned.high == pytest.approx(np.add(cubic.high, turns))
    assert turned.hull[0] == pytest.approx(np.add(cubic.hull[0], turns))


@pytest.mark.parametrize('seed', range(20))
def test_of_a_slew_each_stretch_holds_all_drives_going_and_braking(seed):
    rng = np.random.default_rng(seed)
    cubic = drawn(rng, 4, 1e-4) if seed % 2 else resting(rng.uniform(-1.5, 1.5, 2))
    state = AxisState(tuple(rng.uniform(-1.5, 1.5, 2).tolist()),
                  tuple((rng.uniform(-0.5, 0.5, 2) * [a.rate for a in AXES]).tolist()))
    timing = rng.uniform(0.3, 1.0)
    slew = Slew(state, cubic, AXES, timing)
    assert not slew.chases
    ends = np.sort(rng.uniform(0.0, slew.arrival, (30, 2)), 1)
    held = np.array([slew.outermost(*pair) for pair in ends.tolist()])  # (30, axis, low and high)
    for i, axis in enumerate(AXES):
        for share in (1.0, timing, *rng.uniform(timing, 1.0, 3)):
            move = plan_move(state.angles[i], state.rates[i], cubic, i, share * axis.rate,
                             share * axis.acceleration)
            for (begin, end), (low, high) in zip(ends.tolist(), held[:, i]):
                places = np.array([moment(move, cubic, t, i) for t in np.linspace(begin, end, 50)])
                assert low < places[:, 0].min() and places[:, 0].max() < high
                stop = places[:, 0] + places[:, 1] * np.abs(places[:, 1]) / (
                    2.0 * axis.acceleration)
                assert low < stop.min() and stop.max() < high
