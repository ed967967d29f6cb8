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

"""Nights of a mount that drifts and jumps, for `tracking.py`: truth, stars, compared methods.

Offsets are from exact rotations, not from the filter's columns.
"""

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from calibration.estimation.gaussian_sum import GaussianSum, PossibleJump
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import design

#: of an ordinary mount, arcsec
TERMS = {'IA': 140.0, 'IE': -80.0, 'CA': 45.0, 'NPAE': -20.0, 'AN': 35.0, 'AW': -25.0,
         'TF': 18.0, 'TX': 6.0}
NAMES = tuple(TERMS)
BASE = np.array(list(TERMS.values())) * ARCSEC
K = len(NAMES)
#: where the pointing is judged, and how often between two stars
PLACES, BETWEEN = 60, 4
HOUR = 3_600_000_000_000
EVENING_STARS = 40


#: distribution of stars and places: ``area``, uniform on the sky between 20 and 85 degrees;
#: ``elevation``, uniform in elevation between 20 and 88 degrees
DRAWN = 'area'


def sky(rng, n):
    """Random azimuths and elevations, distributed as in `DRAWN`."""
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    if DRAWN == 'elevation':
        return az, rng.uniform(20 * DEG, 88 * DEG, n)
    return az, np.arcsin(rng.uniform(np.sin(20 * DEG), np.sin(85 * DEG), n))


def columns(az, el):
    """Design matrix of the terms, shape (n, 2, k)."""
    return np.stack(design(NAMES, az, el), axis=1)


@cache
def grid():
    """Design matrix of places that sample the sky."""
    return columns(*sky(np.random.default_rng(5), PLACES))


def radial(off):
    """Mean and mean square of the radial error over the sky for errors `off` of the terms, rad."""
    length = np.hypot(*(grid() @ off).T)
    return length.mean(), np.mean(length**2)


@dataclass
class Truth:
    """Parameters of a night.

    Attributes
    ----------
    rate, tilt : float
        Random walk of the zeros and of the tilt, rad per square root of an hour.
    noise : float
        Of a star, rad, in each of x and y.
    jump : float or None
        Time when an axis jumps by 20 to 60 arcsec, h.
    drift : {'walk', 'settling', 'sine', 'changing'}
        Random walk; zeros settling by ten times the rate with a time constant of 1.5 h; zeros
        oscillating by four times the rate with a period of an hour; random walk with a third of the
        rate in the first half and three times the rate in the second.
    colour : {'white', 'ar1', 't4'}
        Noise of the stars: white; AR(1) with 0.6; Student's t with four degrees of freedom (same
        variance).
    wrong : float
        Fraction of wrong stars.
    """

    rate: float
    tilt: float = None
    noise: float = ARCSEC
    jump: float | None = None
    drift: str = 'walk'
    colour: str = 'white'
    wrong: float = 0.0
    hours: float = 8.0
    every: float = 1.0 / 6.0
    walk: np.ndarray = field(init=False)

    def __post_init__(self):
        self.tilt = self.rate / 5.0 if self.tilt is None else self.tilt
        zeros = [self.rate if name in ('IA', 'IE') else 0.0 for name in NAMES]
        tilts = [self.tilt if name in ('AN', 'AW') else 0.0 for name in NAMES]
        self.walk = np.array(zeros) + np.array(tilts)


class Night:
    """A simulated night: its stars, and the true terms (minus `BASE`) between them."""

    def __init__(self, truth, rng):
        self.truth = truth
        self.count = int(round(truth.hours / truth.every))
        columns_of = columns(*sky(rng, EVENING_STARS)).reshape(-1, K)
        self.evening_covariance = np.linalg.inv(columns_of.T @ columns_of) * truth.noise**2
        self.evening = rng.multivariate_normal(np.zeros(K), self.evening_covariance)
        self.az, self.el = sky(rng, self.count)
        self.columns = columns(self.az, self.el)
        self.hours = truth.every * np.arange(1, self.count + 1)
        self.stamps = np.rint(self.hours * HOUR).astype(np.int64)
        self.jump_axis, size = int(rng.integers(2)), rng.uniform(20, 60) * rng.choice([-1, 1])
        path = self._path(rng)
        times = truth.every / BETWEEN * np.arange(1, self.count * BETWEEN + 1)
        self.jump_star = None
        if truth.jump is not None:
            path[times >= truth.jump, self.jump_axis] += size * ARCSEC
            self.jump_star = int(np.searchsorted(self.hours, truth.jump))
        #: terms between the stars, shape (stars, BETWEEN, k); the last is at the star
        self.path = path.reshape(self.count, BETWEEN, K)
        self.is_wrong = rng.random(self.count) < truth.wrong
        off = np.array([PointingModel(dict(zip(NAMES, BASE + x))).offsets(a, e) for x, a, e in
                        zip(self.path[:, -1], self.az, self.el)])
        far = rng.normal(size=(self.count, 2)) * 100.0 * ARCSEC
        self.offsets = off + self._noise(rng) + far * self.is_wrong[:, None]

    def _path(self, rng):
        t, n = self.truth, self.count * BETWEEN
        step = t.every / BETWEEN
        times = step * np.arange(1, n + 1)
        moves = rng.normal(size=(n, K)) * t.walk * np.sqrt(step)
        if t.drift == 'changing':
            moves *= np.where(times < t.hours / 2.0, 1.0 / 3.0, 3.0)[:, None]
        path = np.cumsum(moves, axis=0)
        shape = rng.choice([-1.0, 1.0], 2) * t.rate
        if t.drift == 'settling':
            path[:, :2] = 10.0 * shape * -np.expm1(-times / 1.5)[:, None]
        if t.drift == 'sine':
            phase = rng.uniform(0.0, 2.0 * np.pi, 2)
            path[:, :2] = 4.0 * shape * (np.sin(2.0 * np.pi * times[:, None] + phase)
                                         - np.sin(phase))
        return path

    def _noise(self, rng):
        t, shape = self.truth, (self.count, 2)
        if t.colour == 't4':
            return t.noise * rng.standard_t(4, size=shape) / np.sqrt(2.0)
        noise = rng.normal(size=shape)
        if t.colour == 'ar1':
            for k in range(1, self.count):
                noise[k] = 0.6 * noise[k - 1] + 0.8 * noise[k]
        return t.noise * noise

    def model(self):
        """The evening's model."""
        return PointingModel(dict(zip(NAMES, BASE + self.evening)), self.evening_covariance)

    def linear(self, k):
        """A star's offset minus that of `BASE`: to first order, the offset by the other terms."""
        base = PointingModel(dict(zip(NAMES, BASE))).offsets(self.az[k], self.el[k])
        return self.offsets[k] - np.array(base)

    def others(self):
        """Active terms before each star for the methods compared, each shape (stars, k).

        Returns
        -------
        dict of str to ndarray
            ``a`` the evening's model; ``b`` a refit of all stars so far and the evening's;
            ``c`` a filter that knows rates and jump times; ``d`` both zeros reset on the last star.
        """
        t = self.truth
        weight = np.linalg.inv(self.evening_covariance)
        right = weight @ self.evening
        oracle = GaussianSum(self.evening, self.evening_covariance, [np.diag(t.walk**2)],
                             outliers=1e-9)
        far = PossibleJump('', np.eye(K)[:, [self.jump_axis]], 100.0 * ARCSEC, 0.0)
        out = {key: np.tile(self.evening, (self.count, 1)) for key in 'abcd'}
        for k in range(self.count):
            h, y = self.columns[k], self.linear(k)
            oracle.wait(t.every)
            if k == self.jump_star:
                oracle.widen(far.covariance)
            oracle.observe(h, y, np.full(2, t.noise))
            if k + 1 == self.count:
                break
            weight = weight + h.T @ h / t.noise**2
            right = right + h.T @ y / t.noise**2
            out['b'][k + 1] = np.linalg.solve(weight, right)
            out['c'][k + 1] = oracle.estimate()[0]
            left = y - h @ self.evening
            out['d'][k + 1, :2] += left / np.array([h[0, 0], h[1, 1]])
        return out

    def errors(self, terms):
        """Mean radial error over the sky, and its mean square, between the stars.

        Parameters
        ----------
        terms : ndarray, shape (stars, k)
            Active before each star, minus `BASE`.

        Returns
        -------
        mean, square : ndarray, shape (stars,)
        """
        both = np.array([[radial(mine - path) for path in paths]
                         for mine, paths in zip(terms, self.path)])
        return both[..., 0].mean(axis=1), both[..., 1].mean(axis=1)
