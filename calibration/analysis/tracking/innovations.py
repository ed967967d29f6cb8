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

"""What a tracker takes, what came of it, and whether its innovations are as large as predicted.

The normalised innovation squared (NIS) of a star has the mean 2 where the filter is consistent.
Over the last stars its sum is chi squared (Bar-Shalom, Li and Kirubarajan 2001, section 5.4). Stars
count once it is decided that nothing jumped before them and that they were no wrong ones.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, gammaincinv

from msg_tools.units import ARCSEC

from ..finding import Finding

#: stars of a test: from, and the last so many
FEWEST, WINDOW = 12, 24
#: chance that a consistent filter is called over- or under-confident at one star. The sums of
#: neighbouring stars are much alike: in a night of 48 stars it happens to 1 % (docs/tracking.md)
LEVEL = 5e-4
#: correlation of neighbouring innovations below which they turn back
TURNS = -0.2
#: the noise is taken no more than so many times as large
MOST = 5.0
HONEST, OVER, UNDER = 'honest', 'over-confident', 'under-confident'


@dataclass(frozen=True)
class Measurement:
    """A measurement as it is in a log.

    Attributes
    ----------
    what : {'star', 'difference', 'inclinometer', 'power_on'}
        The method of `Tracker` that takes it.
    stamp : int
        ns.
    values : tuple
        The rest of what the method takes.
    """

    what: str
    stamp: int
    values: tuple = ()


@dataclass(frozen=True)
class TrackerUpdate:
    """What came of a measurement.

    Attributes
    ----------
    stamp : int
        ns.
    what : str
        As of `Measurement`.
    taken : bool
        False: refused, and nothing has changed.
    why : Finding or None
        Why it was refused, or what was widened for it.
    innovation : ndarray, shape (m,), or None
        Beyond what was expected, rad.
    covariance : ndarray, shape (m, m), or None
        Of it, if nothing has happened, rad^2.
    chances : dict of str to float
        What may have happened just before: each that may have jumped, ``wrong star``; and
        ``nothing``. All 0 for the first stars of a night that decide how it begins (`WarmStart`).
    events : tuple of Finding
        What is decided now, also of the stars before.
    consistency : Finding or None
        Where the filter has just found itself over- or under-confident.
    row : tuple or None
        As the filter took it: columns (m, n), and values (m,) beyond the terms of `Tracker.plain`
        and 1 sigma of their noise (m,), rad.
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
        """Normalised innovation squared: of mean m where the filter is consistent."""
        if self.innovation is None:
            return float('nan')
        return float(self.innovation @ np.linalg.solve(self.covariance, self.innovation))

    @property
    def findings(self):
        """All that it says, in order."""
        return [one for one in (self.why, *self.events, self.consistency) if one is not None]

    def document(self):
        """For JSON, with findings in it; angles in arcsec."""
        out = {'stamp': self.stamp, 'what': self.what, 'taken': self.taken, 'why': self.why or ''}
        if self.taken:
            out |= {'innovation_arcsec': (self.innovation / ARCSEC).tolist(),
                    'sigma_arcsec': (np.sqrt(np.diag(self.covariance)) / ARCSEC).tolist(),
                    'nis': self.nis, 'chances': self.chances, 'called': list(self.events),
                    'confidence': self.consistency or ''}
        return out


@dataclass(frozen=True)
class ExpectedError:
    """How far the mount is expected to point off.

    Attributes
    ----------
    covariance : ndarray, shape (..., 2, 2)
        Of x and y on the sky, rad^2.
    jump : float
        Chance that something jumps in the time ahead, which is not in the covariance.
    """

    covariance: np.ndarray
    jump: float

    @property
    def radial(self):
        """Radial RMS, rad."""
        return np.sqrt(np.trace(self.covariance, axis1=-2, axis2=-1))


class FilterConsistency:
    """The last innovations, and by how much noise or drift are taken larger for them.

    Attributes
    ----------
    noise, walk : float
        Factors of the noise of stars and of all random walks (as lengths); 1 as given.
    verdict : str
        `HONEST`, `OVER` (errors are larger than predicted) or `UNDER` (smaller).
    tested : tuple of (int, float) or None
        Of the test that gave a verdict other than `HONEST`: stars, and their errors as a part of
        the predicted ones (RMS): above 1 where it is `OVER`, below where it is `UNDER`.
    """

    def __init__(self):
        self.noise, self.walk, self.verdict, self.tested = 1.0, 1.0, HONEST, None
        self._last = []  # [x, y] of each star, in sigmas, decided

    def add(self, off, fastest=0.0):
        """Take the innovation of a star of which it is decided that nothing happened.

        Parameters
        ----------
        off : sequence of float, length 2
            Normalised: its squares add up to the NIS.
        fastest : float
            How likely the fastest walk of all that are thought of is by now. Where it is, the
            mount drifts still faster, unless innovations turn back from star to star: a filter
            that runs after noise overshoots.

        Returns
        -------
        Finding or None
            Where the verdict is another one now.
        """
        self._last = [*self._last[1 - WINDOW:], [float(v) for v in off]]
        count = len(self._last)
        if count < FEWEST:
            return None
        last = np.array(self._last)
        total = float(np.sum(last * last))
        # sums beyond which a filter is not consistent
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
        """The verdict, and the ratio that it rests on."""
        return Finding('filter consistency', unit='', evidence={
            'verdict': self.verdict, 'tested': self.tested})
