"""Readings of the axes' encoders, and which of them cannot be."""

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
        angles = np.array(angles, float)
        if not np.isfinite(angles).all():
            self.here = self.rate = self._jumped = None
            self.stamp = stamp
            return
        self._check(angles)
        if self.here is None:
            self.rate = np.array(rates, float)
            self.here, self.stamp = angles, stamp
            return
        seconds = (stamp - self.stamp) * 1e-9
        if seconds <= 0.0:
            if seconds > -1.0:
                return  # out of order
            self.here, self.stamp, self.rate = angles, stamp, np.array(rates, float)
            return
        step = angles - self.here
        if self._limits.mount.altaz:  # others stay on their turn, however far they went
            step[0] = wrap(step[0])
        most = FARTHER + FASTER * seconds * np.array([axis.rate for axis in self._limits.axes])
        if np.any(np.abs(step) > most) and not self._again(angles):
            i = int(np.argmax(np.abs(step) - most))
            word = self._limits.mount.names.axes[i]
            raise ValueError(
                f'the reading of {word} jumped by {step[i] / DEG:.1f} deg in {seconds:.2f} s: '
                'look at the encoder, and that it gives radians')
        self._jumped = None
        rate = np.array(rates, float)
        unknown = np.isnan(rate)
        rate[unknown] = step[unknown] / seconds
        self.here, self.rate, self.stamp = self.here + step, rate, stamp

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
        for axis, angle, word in zip(self._limits.axes, angles.tolist(), words):
            turned = float(wrap(angle))
            inside = any(axis.low - BEYOND <= a <= axis.high + BEYOND for a in (
                angle, turned, turned + 2.0 * np.pi))
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
