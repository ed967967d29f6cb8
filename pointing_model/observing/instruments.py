"""The instruments as the observer knows them: what they said last, and which are silent."""

import time

import numpy as np

from msg_tools.units import DEG

from .pairing import Exposures

MOUNT, ABSOLUTE, CAMERA = 'mount and incremental encoder', 'absolute encoder', 'camera'
#: an axis slower than this stands still, rad/s
STILL = 0.01 * DEG


class Instruments:
    """Mount, encoders and camera.

    Parameters
    ----------
    first_run : int
        Number of the first power-on.
    wall : callable
        Seconds of a clock that goes on while simulated time stands still.

    Attributes
    ----------
    exposures : Exposures
        Readings and frames since the last command.
    stamp : int
        Of the last reading of the incremental encoder, ns; 0 before the first.
    here, rate : ndarray, tuple
        Its angles, rad, and rates, rad/s, shape (2,); None before the first.
    homed : bool
    run : int
        Number of the power-on: each time that the encoder has been homed is one.
    """

    def __init__(self, first_run=1, wall=time.monotonic):
        self.exposures = Exposures()
        self.stamp, self.here, self.rate = 0, None, None
        self.homed = False
        self.run = first_run - 1
        self._wall = wall
        self._asked, self._heard = {}, {}

    def take_incremental(self, stamp, angle, rate):
        """Take a reading; True where the clock went back. ValueError for one out of order."""
        back = self.exposures.add_reading('enc', stamp, angle)
        self.stamp, self.here, self.rate = stamp, np.array(angle), rate
        homed = bool(np.isfinite(angle).all())
        if homed and not self.homed:
            self.run += 1
        self.homed = homed
        self.hear(MOUNT)
        return back

    def take_absolute(self, stamp, angle):
        """As `take_incremental`, of the absolute encoder."""
        back = self.exposures.add_reading('abs', stamp, angle)
        self.hear(ABSOLUTE)
        return back

    def take_frame(self, stamp, x, y):
        """Take a measured miss distance, rad."""
        self.exposures.add_frame(stamp, x, y)
        self.hear(CAMERA)

    def homed_since(self, stamp):
        """Whether a reading after `stamp` says so, with the axes at rest.

        Which reading comes in first must not decide what follows.
        """
        return (self.homed and self.stamp > stamp
                and not np.any(np.abs(self.rate) > STILL))

    def hear(self, name):
        """Count the silence of an instrument from now on."""
        self._heard[name] = self._wall()

    def ask(self):
        """All of them are to answer from now on."""
        self._asked = dict.fromkeys((MOUNT, ABSOLUTE, CAMERA), self._wall())
        self._heard = dict(self._asked)

    def silent(self, seconds):
        """Names of those that have said nothing for so long."""
        limit = self._wall() - seconds
        return [name for name, heard in self._heard.items() if heard < limit]

    def unanswered(self, seconds):
        """Names of those that have not answered `ask`, else of those silent for so long."""
        mute = [name for name, heard in self._heard.items() if heard == self._asked.get(name)]
        return mute or self.silent(seconds)
