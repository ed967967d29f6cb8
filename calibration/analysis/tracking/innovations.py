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

"""Measurements of a tracker, its updates, and the consistency test of its innovations.

The normalised innovation squared (NIS) of a star has the mean 2 for a consistent filter. Its sum
over the last stars is chi squared (Bar-Shalom, Li and Kirubarajan 2001, section 5.4). A star is
included once it is decided that nothing jumped before it and that it was no wrong star.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, gammaincinv

from msg_tools.units import ARCSEC

from ..finding import Finding

#: smallest and largest number of last stars in a test
FEWEST, WINDOW = 12, 24
#: false-alarm probability of the test at one star. The sums of neighbouring stars are highly
#: correlated: in a night of 48 stars it is 1 % (docs/tracking.md)
LEVEL = 5e-4
#: correlation of neighbouring innovations below which the filter overshoots
TURNS = -0.2
#: largest factor of noise or drift
MOST = 5.0
HONEST, OVER, UNDER = 'honest', 'over-confident', 'under-confident'


@dataclass(frozen=True)
class Measurement:
    """A measurement as in a log.

    Attributes
    ----------
    what : {'star', 'difference', 'inclinometer', 'power_on'}
        The method of `Tracker` that takes it.
    stamp : int
        ns.
    values : tuple
        The other arguments of the method.
    """

    what: str
    stamp: int
    values: tuple = ()


@dataclass(frozen=True)
class TrackerUpdate:
    """Result of a measurement.

    Attributes
    ----------
    stamp : int
        ns.
    what : str
        See `Measurement`.
    taken : bool
        False: refused, and nothing has changed.
    why : Finding or None
        Why it was refused, or why the covariance was widened.
    innovation : ndarray, shape (m,), or None
        Measured minus predicted, rad.
    covariance : ndarray, shape (m, m), or None
        Covariance of the innovation if no event occurred, rad^2.
    chances : dict of str to float
        Probabilities of events just before: a jump of each part, ``wrong star``, and ``nothing``.
        All 0 for the first stars of a night, used by `WarmStart`.
    events : tuple of Finding
        Events decided now, including those before earlier stars.
    consistency : Finding or None
        Set if the filter has just been found over- or under-confident.
    row : tuple or None
        Input of the filter: columns (m, n), values (m,) minus those of `Tracker.plain`, and 1 sigma
        of their noise (m,), rad.
    """

    stamp: int
    what: str
    taken: bool
    why: Finding | None = None
    innovation: np.ndarray | None = None
    covariance: np.ndarray | None = None
    chances: dict | None = None
    events: tuple = ()
    consistency: Finding | None = None
    row: tuple | None = None

    @property
    def nis(self):
        """Normalised innovation squared; its mean is m for a consistent filter."""
        if self.innovation is None:
            return float('nan')
        return float(self.innovation @ np.linalg.solve(self.covariance, self.innovation))

    @property
    def findings(self):
        """All its findings, in order."""
        return [one for one in (self.why, *self.events, self.consistency) if one is not None]

    def document(self):
        """Document for JSON, with findings; angles in arcsec."""
        out = {'stamp': self.stamp, 'what': self.what, 'taken': self.taken, 'why': self.why or ''}
        if self.taken:
            out |= {'innovation_arcsec': (self.innovation / ARCSEC).tolist(),
                    'sigma_arcsec': (np.sqrt(np.diag(self.covariance)) / ARCSEC).tolist(),
                    'nis': self.nis, 'chances': self.chances, 'called': list(self.events),
                    'confidence': self.consistency or ''}
        return out


@dataclass(frozen=True)
class ExpectedError:
    """Expected pointing error of the mount.

    Attributes
    ----------
    covariance : ndarray, shape (..., 2, 2)
        Covariance of x and y on the sky, rad^2.
    jump : float
        Probability of a jump in the time ahead, which is not in the covariance.
    """

    covariance: np.ndarray
    jump: float

    @property
    def radial(self):
        """Radial RMS, rad."""
        return np.sqrt(np.trace(self.covariance, axis1=-2, axis2=-1))


class FilterConsistency:
    """Consistency test of the last innovations, and resulting factors of noise and drift.

    Attributes
    ----------
    noise, walk : float
        Factors of the noise of stars and of all random walks (in sigma); 1 by default.
    verdict : str
        `HONEST`, `OVER` (errors are larger than predicted) or `UNDER` (smaller).
    tested : tuple of (int, float) or None
        Last test with a verdict other than `HONEST`: number of stars, and RMS error relative to the
        predicted one (above 1 for `OVER`, below 1 for `UNDER`).
    """

    def __init__(self):
        self.noise, self.walk, self.verdict, self.tested = 1.0, 1.0, HONEST, None
        self._last = []  # [x, y] of each star, in sigmas, decided

    def add(self, off, fastest=0.0):
        """Add the innovation of a star without an event.

        Parameters
        ----------
        off : sequence of float, length 2
            Normalised innovation: its squares sum to the NIS.
        fastest : float
            Current probability of the fastest random walk hypothesis. If it is likely, the mount
            drifts even faster, unless consecutive innovations are anticorrelated: a filter that
            follows noise overshoots.

        Returns
        -------
        Finding or None
            If the verdict has changed.
        """
        self._last = [*self._last[1 - WINDOW:], [float(v) for v in off]]
        count = len(self._last)
        if count < FEWEST:
            return None
        last = np.array(self._last)
        total = float(np.sum(last * last))
        # limits of the sum for a consistent filter
        low, high = 2.0 * gammaincinv(count, LEVEL), chdtri(2 * count, LEVEL)
        size = float(np.sqrt(total / (2.0 * count)))
        if total > high:
            self.verdict, self.tested, self._last = OVER, (count, size), []
            drifts = fastest > 0.5 and np.sum(last[1:] * last[:-1]) > TURNS * total
            what = 'walk' if drifts else 'noise'
            setattr(self, what, min(getattr(self, what) * size, MOST))
            return self._finding(what)
        if total < low:
            known, widened = self.verdict == UNDER, self.noise * self.walk > 1.0
            self.verdict, self.tested, self._last = UNDER, (count, size), []
            self.noise, self.walk = max(1.0, self.noise * size), max(1.0, self.walk * size)
            if widened:
                return self._finding('both')
            return None if known else self._finding('neither')
        if count == WINDOW and self.noise * self.walk == 1.0:
            self.verdict, self.tested = HONEST, None
        return None

    def _finding(self, changed):
        return Finding('filter widened', unit='', evidence={
            'verdict': self.finding(), 'changed': changed, 'noise': self.noise,
            'walk': self.walk})

    def finding(self):
        """The verdict, and the ratio that it is based on."""
        return Finding('filter consistency', unit='', evidence={
            'verdict': self.verdict, 'tested': self.tested})
