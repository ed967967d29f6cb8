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

"""Motion of the two axes: slews that catch up with a commanded trajectory, then tracking.

Index 0 is the first axis (azimuth, hour angle), 1 the second. Time is in UTC seconds, but any
monotonic time is possible.
"""

import math
from dataclasses import dataclass

import numpy as np

from msg_tools.units import DEG

from .field_kinds import number

AXES = ('azimuth', 'elevation')
_TURN = 2.0 * np.pi
# the ringing is damped by this many time constants, and oscillates so often, in the settling time
_DECAY, _SWINGS = 8.0, 4.0
#: number of previous commands for which `MountAxes.state` can still be evaluated
_MEMORY = 64


@dataclass(frozen=True)
class AxisDynamics:
    """Limits of the motion of an axis.

    Attributes
    ----------
    max_rate, max_acceleration : float
        rad/s and rad/s^2.
    settling_time : float
        Time from the end of a slew until the ringing has died out, s.
    settling_amplitude : float
        Amplitude of the ringing just after a slew at full rate, rad.
    travel_min, travel_max : float
        Limits of the travel, rad.
    """

    max_rate: float = number(6.0, 'deg_s', 1e-3, 360.0)
    max_acceleration: float = number(3.0, 'deg_s2', 1e-3, 3600.0)
    settling_time: float = number(1.0, 's', 0.0, 60.0)
    settling_amplitude: float = number(0.0, 'arcsec', 0.0, 600.0)
    travel_min: float = number(-36000.0, 'deg', -36000.0, 36000.0)
    travel_max: float = number(36000.0, 'deg', -36000.0, 36000.0)


@dataclass(frozen=True)
class AxisMove:
    """A trapezoidal move: one acceleration, a cruise, the opposite acceleration, and rest.

    Position and rate are relative to the start of the move, in the frame of the target.
    """

    distance: float
    start_rate: float
    cruise_rate: float
    acceleration: float
    accelerating: float
    cruising: float
    braking: float

    @property
    def duration(self):
        """Duration of the move, s."""
        return self.accelerating + self.cruising + self.braking

    def at(self, t):
        """Position (rad) and rate (rad/s) `t` seconds after the start, with the shape of `t`."""
        t = np.asarray(t, dtype=float)
        speeding = np.clip(t, 0.0, self.accelerating)
        cruising = np.clip(t - self.accelerating, 0.0, self.cruising)
        braking = np.clip(t - self.accelerating - self.cruising, 0.0, self.braking)
        gain = self.cruise_rate - self.start_rate
        first = np.sign(gain) * self.acceleration
        last = -np.sign(self.cruise_rate) * self.acceleration
        position = (
            (self.start_rate + 0.5 * first * speeding) * speeding
            + self.cruise_rate * cruising
            + (self.cruise_rate + 0.5 * last * braking) * braking
        )
        rate = self.start_rate + first * speeding + last * braking
        moving = t < self.duration
        return np.where(moving, position, self.distance), np.where(moving, rate, 0.0)


def plan_move(distance, rate, limits, frame_rate=0.0):
    """The fastest move over `distance` that ends at rest.

    Parameters
    ----------
    distance : float
        rad, signed.
    rate : float
        Initial rate, rad/s.
    limits : AxisDynamics
        Limits of the axis.
    frame_rate : float
        Rate of the frame in which the move is described, which is that of its target, rad/s.

    Returns
    -------
    AxisMove

    Raises
    ------
    ValueError
        The target is as fast as the axis, or faster.
    """
    top, a = limits.max_rate - abs(frame_rate), limits.max_acceleration
    if top <= 0.0:
        raise ValueError(
            f'target at {abs(frame_rate) / DEG:.3g} deg/s is faster than the axis '
            f'({limits.max_rate / DEG:.3g} deg/s): ask for a slower one'
        )
    beyond = distance - rate * abs(rate) / (2.0 * a)
    leading = beyond if beyond != 0.0 else rate
    sign = float(leading > 0.0) - float(leading < 0.0)
    d, v = sign * distance, sign * rate
    peak = min(math.sqrt(max(a * d + 0.5 * v * v, 0.0)), top)
    accelerating, braking = abs(peak - v) / a, peak / a
    rest = d - 0.5 * (peak + v) * accelerating - 0.5 * peak * braking
    cruising = max(rest, 0.0) / peak if peak > 0.0 else 0.0
    return AxisMove(distance, rate, sign * peak, a, accelerating, cruising, braking)


class Trajectory:
    """A commanded joint trajectory: cubic Hermite interpolation between its points.

    Before the first and after the last point the axes move at the rate of that point, so that
    one point with a rate tracks until the next command.

    Parameters
    ----------
    times : array_like, shape (n,)
        Increasing, s.
    positions : array_like, shape (n, 2)
        Of both axes, rad. The first axis may jump by whole turns.
    velocities : array_like, shape (n, 2)
        rad/s.
    """

    def __init__(self, times, positions, velocities):
        self.times = np.asarray(times, dtype=float)
        self.positions = np.array(positions, dtype=float)
        self.positions[:, 0] = np.unwrap(self.positions[:, 0])
        self.velocities = np.array(velocities, dtype=float)

    def shifted(self, first):
        """The same trajectory with `first` (rad) added to the first axis."""
        return Trajectory(self.times, self.positions + [first, 0.0], self.velocities)

    def at(self, t):
        """Angles (m, 2) in rad and rates (m, 2) in rad/s at times `t` (m,)."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        if len(self.times) == 1:
            dt = (t - self.times[0])[:, np.newaxis]
            return self.positions + dt * self.velocities, np.repeat(self.velocities, len(t), 0)
        i = np.clip(np.searchsorted(self.times, t, side='right') - 1, 0, len(self.times) - 2)
        h = (self.times[i + 1] - self.times[i])[:, np.newaxis]
        dt = (t - self.times[i])[:, np.newaxis]
        inside = np.clip(dt, 0.0, h)
        s = inside / h
        p0, p1 = self.positions[i], self.positions[i + 1]
        v0, v1 = self.velocities[i], self.velocities[i + 1]
        step = p1 - p0
        position = (
            p0
            + s * s * (3.0 - 2.0 * s) * step
            + h * s * (1.0 - s) * ((1.0 - s) * v0 - s * v1)
        )
        rate = (
            6.0 * s * (1.0 - s) * step / h
            + (1.0 - s) * (1.0 - 3.0 * s) * v0
            + s * (3.0 * s - 2.0) * v1
        )
        return position + (dt - inside) * rate, rate


def _short_way(angle, trajectory, limits, word):
    """Whole turns to add to the trajectory's first angle, rad: the nearest within the travel.

    So the travel limits of a German mount keep its counterweight down.
    """
    nearest = -np.round((trajectory.positions[0, 0] - angle) / _TURN)
    low, high = trajectory.positions[:, 0].min(), trajectory.positions[:, 0].max()
    fewest = np.ceil((limits.travel_min - low) / _TURN)
    most = np.floor((limits.travel_max - high) / _TURN)
    if fewest > most:
        raise ValueError(
            f'{word} from {low / DEG:.3f} to {high / DEG:.3f} deg does not fit into the travel '
            f'of {limits.travel_min / DEG:g} to {limits.travel_max / DEG:g} deg'
        )
    return _TURN * float(np.clip(nearest, fewest, most))


@dataclass(frozen=True)
class Leg:
    """Execution of one command: the catch-up of each axis, then the trajectory.

    Attributes
    ----------
    start : float
        Start time, s.
    trajectory : Trajectory
        Trajectory with resolved turns of the first axis.
    moves : tuple of Move
        Catch-up of each axis, in the frame of the target at the time of arrival.
    arrival : ndarray, shape (2,)
        Time at which each axis has caught up, s.
    settled : float
        Time at which both have caught up and settled, s.
    """

    start: float
    trajectory: Trajectory
    moves: tuple
    arrival: np.ndarray
    settled: float
    limits: tuple
    origin: np.ndarray
    frame_rate: np.ndarray

    @property
    def approach(self):
        """Sign of the motion with which each axis reached its target, shape (2,)."""
        return np.sign([move.cruise_rate for move in self.moves])

    def state(self, t):
        """Angles (m, 2) and rates (m, 2) of the axes at times `t` (m,)."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        angles, rates = self.trajectory.at(t)
        for i, move in enumerate(self.moves):
            slewing = t < self.arrival[i]
            if slewing.any():
                dt = t - self.start
                position, rate = move.at(dt)
                angles[slewing, i] = (self.origin[i] + self.frame_rate[i] * dt + position)[slewing]
                rates[slewing, i] = (self.frame_rate[i] + rate)[slewing]
            self._ring(i, t, angles, rates)
        return angles, rates

    def _ring(self, i, t, angles, rates):
        limits = self.limits[i]
        if limits.settling_time <= 0.0 or limits.settling_amplitude <= 0.0:
            return
        # a slower slew excites less ringing; the first swing continues in the slew's direction
        size = limits.settling_amplitude * self.moves[i].cruise_rate / limits.max_rate
        decay = _DECAY / limits.settling_time
        turn = _TURN * _SWINGS / limits.settling_time
        dt = np.maximum(t - self.arrival[i], 0.0)
        envelope = size * np.exp(-decay * dt)
        swing = 0.5 * (1.0 - np.cos(turn * dt))
        angles[:, i] += envelope * swing
        rates[:, i] += envelope * (0.5 * turn * np.sin(turn * dt) - decay * swing)


def catch_up(start, angles, rates, trajectory, limits, words=AXES):
    """Plan the catch-up of both axes with a trajectory.

    Parameters
    ----------
    start : float
        Current time, s.
    angles, rates : array_like, shape (2,)
        Current state of the axes, rad and rad/s.
    trajectory : Trajectory
        Trajectory to follow. The first axis takes the shortest way that its travel allows.
    limits : sequence of AxisDynamics, length 2
        Limits of both axes.
    words : sequence of str, length 2
        Names of the axes, for people.

    Returns
    -------
    Leg

    Raises
    ------
    ValueError
        The trajectory leaves the travel of an axis or is faster than an axis.
    """
    low, high = trajectory.positions[:, 1].min(), trajectory.positions[:, 1].max()
    if low < limits[1].travel_min or high > limits[1].travel_max:
        raise ValueError(
            f'{words[1]} from {low / DEG:.3f} to {high / DEG:.3f} deg leaves the travel of '
            f'{limits[1].travel_min / DEG:g} to {limits[1].travel_max / DEG:g} deg'
        )
    trajectory = trajectory.shifted(_short_way(angles[0], trajectory, limits[0], words[0]))
    moves, arrival, frame_rate = [], np.empty(2), np.empty(2)
    start, angles, rates = float(start), [float(v) for v in angles], [float(v) for v in rates]
    for i, limit in enumerate(limits):
        def meeting(duration, i=i, limit=limit):
            """The move if it takes that long, and the target's rate."""
            target, rate = (float(values[0, i]) for values in trajectory.at(start + duration))
            distance = target - rate * duration - angles[i]
            return plan_move(distance, rates[i] - rate, limit, rate), rate

        duration = 0.0
        # arrival time and the target's state at arrival depend on each other: iterate
        for _ in range(60):
            move, rate = meeting(duration)
            before, duration = duration, move.duration
            if abs(duration - before) < 1e-12:
                break
        # for tiny moves the iteration may alternate between two roots a microsecond apart
        if abs(duration - before) > 1e-4:
            move, rate, duration = _met(meeting, max(duration, before))
        if move is None:
            raise ValueError(
                f'{words[i]} cannot catch up with the trajectory: ask for a slower one')
        moves.append(move)
        arrival[i], frame_rate[i] = start + duration, rate
    settled = max(
        time + limit.settling_time * (move.duration > 0.0)
        for time, limit, move in zip(arrival, limits, moves)
    )
    return Leg(
        start, trajectory, tuple(moves), arrival, float(settled), tuple(limits),
        np.array(angles, dtype=float), frame_rate,
    )


def _met(meeting, long):
    """Solve for the meeting with a braking target: move, its rate and duration; Nones if none."""
    early, late = 0.0, long
    for _ in range(10):  # find a time at which the axis would have been early
        if meeting(late)[0].duration <= late:
            break
        early, late = late, 2.0 * late
    for _ in range(60):
        middle = 0.5 * (early + late)
        if meeting(middle)[0].duration > middle:
            early = middle
        else:
            late = middle
    move, rate = meeting(late)
    return (move, rate, late) if abs(move.duration - late) < 1e-4 else (None, None, None)


class MountAxes:
    """Both axes and their recent commands.

    Parameters
    ----------
    first, second : AxisDynamics
        Limits of the axes.
    time : float
        Time at which they are at rest at `angles`, s.
    angles : array_like, shape (2,)
        rad.
    words : sequence of str, length 2
        Names of the axes, for people.
    hair : float
        Shorter moves do not change the direction from which an axis came, rad.
    """

    def __init__(self, first, second, time, angles, words=AXES, hair=0.0):
        self.limits, self._words, self._hair = (first, second), words, hair
        rest = Trajectory([time], [angles], [[0.0, 0.0]])
        nothing = plan_move(0.0, 0.0, first)
        self._legs = [
            Leg(time, rest, (nothing, nothing), np.full(2, time), time, self.limits,
                np.array(angles, dtype=float), np.zeros(2))
        ]
        self._sides = [np.zeros(2)]  # approach direction of each axis, for each leg

    @property
    def leg(self):
        """The command being executed."""
        return self._legs[-1]

    def arrival(self, start, trajectory):
        """Time when both axes would have settled on `trajectory`, if commanded at `start`, s."""
        return self._plan(start, trajectory).settled

    def follow(self, start, trajectory):
        """Execute `trajectory` from `start` on.

        Parameters
        ----------
        start : float
            Not before the previous command, s.
        trajectory : Trajectory

        Returns
        -------
        float
            Time at which both axes have settled on it, s.

        Raises
        ------
        ValueError
            See `catch_up`; the axes then continue with the previous command.
        """
        if start < self._legs[-1].start:
            raise ValueError('command older than the one being carried out: check its stamp')
        leg = self._plan(start, trajectory)
        # an axis that hardly moves keeps its direction
        moved = np.abs([move.distance for move in leg.moves]) >= self._hair
        side = np.where(moved & (leg.approach != 0.0), leg.approach, self._sides[-1])
        self._legs = [*self._legs[1 - _MEMORY :], leg]
        self._sides = [*self._sides[1 - _MEMORY :], side]
        return leg.settled

    def _plan(self, start, trajectory):
        angles, rates = (v[0] for v in self.state(start))
        return catch_up(start, angles, rates, trajectory, self.limits, self._words)

    def _leg_numbers(self, t):
        starts = [leg.start for leg in self._legs]
        return np.maximum(np.searchsorted(starts, t, side='right') - 1, 0)

    def state(self, t):
        """Angles (m, 2) in rad, the first not wrapped, and rates (m, 2) in rad/s at times `t`."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        number = self._leg_numbers(t)
        angles, rates = np.empty((len(t), 2)), np.empty((len(t), 2))
        for k in np.unique(number):
            rows = number == k
            angles[rows], rates[rows] = self._legs[k].state(t[rows])
        return angles, rates

    def approach(self, t):
        """Sign of the last slew of each axis at times `t`, shape (m, 2): -1, 0, 1."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        return np.array(self._sides)[self._leg_numbers(t)]
