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

"""Positions of a satellite at epochs, and interpolation between them.

A polynomial goes through the nearest epochs: 14 at steps of a quarter of an hour, 10 at steps of
minutes or if the format says so. Interpolation is in axes without the Earth's mean rotation: there
the orbit is smoother than in ITRF, and with every second epoch of GPS left out the error is smaller
by a factor of one to three. At the ends of the table the epochs are on one side, with a larger
sigma; beyond them there is no position.
"""

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from ..earth import TURN_RATE
from ..elements import turned
from .time_scales import leap_seconds, utc_of, utc_text

#: points of a polynomial at long and short steps, and the least long step, s
LONG, SHORT, LONG_STEP = 14, 10, 600.0
#: most points of a polynomial with velocities
_WITH_RATES = 7
#: steps between epochs from which on there is a gap
_GAP = 2.5
#: first number for satellites that only have names; catalogue numbers have six digits
_FIRST_NUMBER = 10_000_000
#: m, deviation from neighbouring epochs from which a position is wrong
BAD = 200.0


@dataclass(frozen=True)
class Arc:
    """Positions of one satellite without gaps, from one file.

    Attributes
    ----------
    origin : float
        TAI, whole seconds since 1970-01-01.
    epochs : ndarray, shape (n,)
        Seconds since `origin`, ascending.
    places : ndarray, shape (n, 3)
        ITRF, m.
    rates : ndarray, shape (n, 3), or None
        Velocities in ITRF, m/s.
    sigmas : ndarray, shape (n,)
        1-sigma of a coordinate, m.
    source, provider : str
        File, and its provider.
    count : int
        Points of a polynomial; 0: chosen by the step.
    """

    origin: float
    epochs: np.ndarray
    places: np.ndarray
    rates: np.ndarray | None
    sigmas: np.ndarray
    source: str
    provider: str = ''
    count: int = 0

    def __post_init__(self):
        turn = TURN_RATE * self.epochs
        object.__setattr__(self, '_still', turned(self.places, -turn))
        object.__setattr__(self, '_moving', None)
        if self.rates is not None and len(self.epochs) < self.wanted:
            with_earth = self.rates + TURN_RATE * np.stack(
                (-self.places[:, 1], self.places[:, 0], 0.0 * turn), axis=1)
            object.__setattr__(self, '_moving', turned(with_earth, -turn))

    @property
    def wanted(self):
        """Points of a polynomial, if there are enough."""
        return self.count or (LONG if self.step >= LONG_STEP else SHORT)

    @property
    def width(self):
        """Points of a polynomial, as available."""
        return min(self.wanted, len(self.epochs))

    @property
    def step(self):
        """Time between epochs, s."""
        return float(np.median(np.diff(self.epochs))) if len(self.epochs) > 1 else 0.0

    @property
    def begin(self):
        """First epoch, TAI."""
        return self.origin + self.epochs[0]

    @property
    def end(self):
        """Last epoch, TAI."""
        return self.origin + self.epochs[-1]

    def still(self, at, fewer=0):
        """Positions in non-rotating axes, those of ITRF at the origin, shape (m, 3), m."""
        if self._moving is not None:
            count = max(min(_WITH_RATES, len(self.epochs)) - fewer // 2, 1)
            return hermite(self.epochs, self._still, self._moving, at, count)
        return lagrange(self.epochs, self._still, at, max(self.width - fewer, 1))

    def itrf(self, at):
        """Positions in ITRF at seconds from the origin, shape (m, 3), m."""
        return turned(self.still(at), TURN_RATE * at)

    def between(self, at):
        """Approximate interpolation error of a coordinate, shape (m,), m."""
        return _left_out(*(self.still(at, fewer) for fewer in (0, 2, 4))) / np.sqrt(3.0)

    def sigma(self, at):
        """1-sigma of a coordinate, shape (m,), m: error of the orbit and of the interpolation."""
        return np.hypot(np.interp(at, self.epochs, self.sigmas), self.between(at))

    def roughness(self):
        """Deviations of epochs from their neighbours, and the expected deviations, m.

        Returns
        -------
        off, expected : ndarray, shape (n,)
            `expected` is the interpolation error of such a polynomial. Near the ends, where it
            extrapolates, rounding of the epochs causes metres. Empty for few epochs.
        """
        if self._moving is not None or len(self.epochs) < 8:
            return np.empty(0), np.empty(0)
        wide = min(self.width, len(self.epochs) - 1) // 2 * 2
        found = [self._between(width) for width in (wide, wide - 2, wide - 4)]
        return np.linalg.norm(found[0] - self._still, axis=1), _left_out(*found)

    def _between(self, width):
        """Positions at epochs, interpolated from the `width` others around them, shape (n, 3)."""
        rows = np.arange(len(self.epochs))
        first = np.clip(rows - width // 2, 0, len(rows) - width - 1)
        beside = first[:, None] + np.arange(width)
        beside += beside >= rows[:, None]
        nodes = (self.epochs[beside] - self.epochs[:, None]) / self.step
        apart = nodes[:, None, :] - nodes[:, :, None]
        same = np.eye(width, dtype=bool)
        ratio = np.where(same, 1.0, nodes[:, None, :] / np.where(same, 1.0, apart))
        return np.einsum('mk,mkc->mc', np.prod(ratio, axis=2), self._still[beside])

    def without(self, row):
        """The arc without one epoch."""
        keep = np.arange(len(self.epochs)) != row
        return replace(self, epochs=self.epochs[keep], places=self.places[keep],
                       rates=None if self.rates is None else self.rates[keep],
                       sigmas=self.sigmas[keep])

    def parts(self):
        """The arc split at gaps, a list of `Arc`; single epochs are dropped."""
        cuts = np.flatnonzero(np.diff(self.epochs) > _GAP * self.step) + 1
        out = []
        for part in np.split(np.arange(len(self.epochs)), cuts):
            if len(part) > 1:
                out.append(replace(self, epochs=self.epochs[part], places=self.places[part],
                                   rates=None if self.rates is None else self.rates[part],
                                   sigmas=self.sigmas[part]))
        return out

    def followed(self, later):
        """This arc joined with one that continues it."""
        shift = later.origin - self.origin
        both = self.rates is not None and later.rates is not None
        return replace(
            self, epochs=np.append(self.epochs, later.epochs + shift),
            places=np.vstack((self.places, later.places)),
            rates=np.vstack((self.rates, later.rates)) if both else None,
            sigmas=np.append(self.sigmas, later.sigmas),
            source=f'{self.source}, {later.source}', provider=self.provider)

    def goes_on(self, later):
        """Whether another arc starts one step after the end of this one."""
        return (abs(self.step - later.step) < 1e-3
                and 0.5 * self.step < later.begin - self.end < 1.5 * self.step)


def _left_out(best, fewer, fewest):
    """Approximate error of the best of three polynomials with fewer and fewer points, shape (m,).

    The last change, reduced by the ratio of the last two changes; inputs have shape (m, 3).
    """
    last, before = (np.linalg.norm(one - other, axis=1)
                    for one, other in ((best, fewer), (fewer, fewest)))
    return last * np.minimum(last / np.maximum(before, 1e-9), 1.0)


@dataclass(frozen=True)
class Orbit:
    """Orbit of one satellite, from the arcs of one or several files.

    Attributes
    ----------
    name : str
        Name in the files: ``G18``, ``L52``.
    arcs : tuple of Arc
        If several cover a time, the last one is used.
    """

    name: str
    arcs: tuple

    #: whether its sigma is that of a precise orbit, or expected of elements
    precise = True

    @property
    def number(self):
        """A number above those of catalogues, derived from the name: always the same."""
        return _FIRST_NUMBER + crc32(self.name.encode()) % _FIRST_NUMBER

    @property
    def begin(self):
        """UTC seconds since 1970-01-01."""
        return float(utc_of(min(arc.begin for arc in self.arcs)))

    @property
    def end(self):
        """UTC seconds since 1970-01-01."""
        return float(utc_of(max(arc.end for arc in self.arcs)))

    def itrf(self, time, rest=0.0):
        """Positions in ITRF.

        Parameters
        ----------
        time : float or ndarray
            UTC, seconds since 1970-01-01.
        rest : float or ndarray
            Seconds after that, separate to keep all digits.

        Returns
        -------
        ndarray, shape (..., 3)
            m.

        Raises
        ------
        ValueError
            No arc covers a time.
        """
        return self._by_arc(time, rest, Arc.itrf, 3)

    def sigma(self, time, rest=0.0):
        """Standard deviation of a coordinate, shape (...), m; parameters as in `itrf`."""
        return self._by_arc(time, rest, lambda arc, at: arc.sigma(at)[:, None], 1)[..., 0]

    def has(self, time):
        """Whether an arc covers a time and the light travel before it, bool or ndarray of bool."""
        tai = np.asarray(time, float) + leap_seconds(time)
        return np.any([(tai >= arc.begin + 1.0) & (tai <= arc.end) for arc in self.arcs], axis=0)

    def _by_arc(self, time, rest, of, width):
        time = np.asarray(time, float)
        leap = leap_seconds(time)
        shape = np.broadcast_shapes(time.shape, np.shape(rest))
        out = np.full((int(np.prod(shape)), width), np.nan)
        left = np.ones(len(out), bool)
        for arc in reversed(self.arcs):
            at = np.broadcast_to((time - arc.origin) + leap + rest, shape).ravel()
            here = left & (at >= arc.epochs[0]) & (at <= arc.epochs[-1])
            if here.any():
                out[here] = of(arc, at[here])
                left &= ~here
        if left.any():
            tai = np.broadcast_to(time + leap + rest, shape).ravel()[left][0]
            raise ValueError(
                f'{self.name}: no position at {utc_text(tai)} UTC; the files cover '
                + '; '.join(f'{utc_text(arc.begin)} to {utc_text(arc.end)}'
                            for arc in self.arcs[:4]) + '; add the file of that day')
        return out.reshape(*shape, width)


def window(epochs, time, count):
    """Choose the epochs of a polynomial.

    Parameters
    ----------
    epochs : ndarray, shape (n,)
        Ascending.
    time : ndarray, shape (m,)
    count : int
        Number of epochs; at most n.

    Returns
    -------
    ndarray of int, shape (m, count)
        Indices; as many before the time as after it, if available.
    """
    first = np.searchsorted(epochs, time, 'right') - count // 2
    if count % 2:  # the nearest in the middle
        near = np.clip(first + count // 2, 1, len(epochs) - 1)
        first += time - epochs[near - 1] > epochs[near] - time
        first -= 1
    return np.clip(first, 0, len(epochs) - count)[:, None] + np.arange(count)


def _weights(nodes):
    """Barycentric weights of nodes, shape (m, k), and their differences, (m, k, k)."""
    spacing = nodes[:, :, None] - nodes[:, None, :]
    k = np.arange(nodes.shape[1])
    spacing[:, k, k] = 1.0
    return 1.0 / np.prod(spacing, axis=2), spacing


def _in_units(epochs, rows, time):
    """Nodes and time of each window relative to its middle, in units of its step, and the step."""
    nodes = epochs[rows]
    middle, step = nodes[:, [nodes.shape[1] // 2]], (nodes[:, 1] - nodes[:, 0])[:, None]
    return (nodes - middle) / step, (time[:, None] - middle) / step, step


def lagrange(epochs, values, time, count):
    """Polynomial of degree count - 1 through the epochs around each time.

    In barycentric form (Berrut and Trefethen 2004, SIAM Review 46, 501).

    Parameters
    ----------
    epochs : ndarray, shape (n,)
    values : ndarray, shape (n, c)
    time : ndarray, shape (m,)
    count : int

    Returns
    -------
    ndarray, shape (m, c)
    """
    rows = window(epochs, time, count)
    starts, which = np.unique(rows[:, 0], return_inverse=True)
    nodes, _, _ = _in_units(epochs, starts[:, None] + np.arange(count), epochs[starts])
    weights = _weights(nodes)[0][which]
    nodes, at, _ = _in_units(epochs, rows, time)
    off = at - nodes
    hit = off == 0.0
    factor = np.where(hit.any(axis=1)[:, None], hit, weights / np.where(hit, 1.0, off))
    factor /= factor.sum(axis=1)[:, None]
    return np.einsum('mk,mkc->mc', factor, values[rows])


def hermite(epochs, values, rates, time, count):
    """Polynomial of degree 2 count - 1 through values and rates at the epochs around each time.

    Uses the squares of Lagrange's basis polynomials.

    Parameters
    ----------
    epochs : ndarray, shape (n,)
    values, rates : ndarray, shape (n, c)
        Rates per unit of the epochs.
    time : ndarray, shape (m,)
    count : int

    Returns
    -------
    ndarray, shape (m, c)
    """
    rows = window(epochs, time, count)
    nodes, at, step = _in_units(epochs, rows, time)
    weights, spacing = _weights(nodes)
    same = np.eye(count, dtype=bool)
    slope = np.where(same, 0.0, 1.0 / spacing).sum(axis=2)
    off = at - nodes
    factor = np.square(np.prod(np.where(same, 1.0, off[:, None, :]), axis=2) * weights)
    by_value = (1.0 - 2.0 * slope * off) * factor
    return (np.einsum('mk,mkc->mc', by_value, values[rows])
            + np.einsum('mk,mkc->mc', off * factor * step, rates[rows]))
