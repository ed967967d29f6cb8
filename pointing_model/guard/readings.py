"""Readings of the axes' encoders, and which of them cannot be."""

import math

import numpy as np

from msg_tools.units import DEG, wrap

from .judging import NO_ANGLE

#: faster than an axis can be by this factor, and farther than this (rad), is a jump
FASTER, FARTHER = 1.5, 2.0 * DEG
#: so many readings of a place that was jumped to are believed
BELIEVED = 5
#: readings beyond the travel by more cannot be, rad
BEYOND = 10.0 * DEG
#: periods of an instrument after which it is silent
PERIODS = 5.0


class Readings:
    """Where the axes are.

    Parameters
    ----------
    limits : limits.Limits
    wall : callable
        Seconds of a steady clock.

    Attributes
    ----------
    here, rate : ndarray, shape (2,), or None
        rad and rad/s, the turns of the first axis counted; None where it is not known.
    stamp : int
        ns.
    """

    def __init__(self, limits, wall):
        self._limits, self._wall = limits, wall
        self.here = self.rate = None
        self.stamp, self._jumped, self._odd = 0, None, 0
        self._heard = self._period = None

    def take(self, stamp, angles, rates):
        """A reading, rad and rad/s (NaN: not told); ValueError for one that cannot be."""
        now = self._wall()
        if self._heard is not None and now > self._heard:
            passed = now - self._heard
            # bursts and single gaps are not its period
            self._period = passed if self._period is None else (
                self._period + 0.1 * (min(passed, 2.0 * self._period) - self._period))
        self._heard = now
        # two numbers a thousand times a second: floats cost a third of arrays
        angles = [float(angle) for angle in angles]
        if not all(map(math.isfinite, angles)):
            self.here = self.rate = self._jumped = None
            self.stamp = stamp
            return
        self._check(angles)
        seconds = (stamp - self.stamp) * 1e-9
        if self.here is None or seconds <= -1.0:
            self.here, self.stamp, self.rate = np.array(angles), stamp, np.array(rates, float)
            return
        if seconds <= 0.0:
            return  # out of order
        before = self.here.tolist()
        step = [angle - here for angle, here in zip(angles, before)]
        if self._limits.mount.altaz:  # others stay on their turn, however far they went
            step[0] = wrap(step[0])
        beyond = [abs(one) - FARTHER - FASTER * seconds * axis.rate
                  for one, axis in zip(step, self._limits.axes)]
        if max(beyond) > 0.0 and not self._again(np.array(angles)):
            i = beyond.index(max(beyond))
            word = self._limits.mount.names.axes[i]
            raise ValueError(
                f'the reading of {word} jumped by {step[i] / DEG:.1f} deg in {seconds:.2f} s: '
                'look at the encoder, and that it gives radians')
        self._jumped = None
        self.here = np.array([here + one for here, one in zip(before, step)])
        self.rate = np.array([one / seconds if math.isnan(rate) else rate
                              for rate, one in zip(map(float, rates), step)])
        self.stamp = stamp

    @property
    def doubtful(self):
        """Whether the last reading contradicts `here`, and is not believed yet."""
        return self._jumped is not None

    def stand(self, still):
        """Whether both axes are known to be slower than `still`, rad/s."""
        return self.here is not None and float(np.nanmax(np.abs(self.rate))) < still

    def _again(self, angles):
        """Whether readings keep to where one jumped to."""
        near = self._jumped is not None and np.all(np.abs(angles - self._jumped) < FARTHER)
        self._odd = self._odd + 1 if near else 1
        self._jumped = angles
        return self._odd >= BELIEVED

    def _check(self, angles):
        words = self._limits.mount.names.axes
        for axis, angle, word in zip(self._limits.axes, angles, words):
            turned, low, high = wrap(angle), axis.low - BEYOND, axis.high + BEYOND
            inside = (low <= angle <= high or low <= turned <= high
                      or low <= turned + 2.0 * math.pi <= high)
            if abs(angle) > NO_ANGLE or not inside or (
                    word is words[1] and abs(angle) > 2.0 * np.pi):
                raise ValueError(f'a reading of {word} of {angle:.6g} rad cannot be: '
                                 'give radians, within the travel')

    def quiet(self, seconds):
        """For how long nothing was read, s, where that is too long; else 0."""
        if self._heard is None:
            return 0.0
        passed = self._wall() - self._heard
        return passed if passed > max(seconds, PERIODS * (self._period or 0.0)) else 0.0
