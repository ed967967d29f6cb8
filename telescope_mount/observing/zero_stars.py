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

"""Chooses stars to set a zero, and the number of exposures of each.

Errors of the other terms bias the zeros, so the covariance of the held terms counts (generalised
least squares) besides the noise of the exposures. Low stars are therefore not always the best. A
greedy choice with exchanges (Fedorov) minimises the product of the variances of both zeros
(D_s-optimal design). Without a model a night needs the change between power-ons, in which held
terms cancel if the same stars are exposed again: the variances of this change, due to noise alone,
then count more.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import ALTAZ
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import POLARIS_HIP
from pointing_model.zero_held_terms import Held, is_a_model, zero_columns

from .star_choice import ANYWHERE, axes_at, observable

#: noise of an exposure on the sky per axis, rad. The choice depends only weakly on its ratio to the
#: errors of the held terms
NOISE = 1.0 * ARCSEC
#: number of different stars: a slew costs as much as several exposures, and errors common to four
#: similar stars are mistaken for the zero
FEWEST, MOST = 4, 8
#: more different stars are taken if they reduce a sigma by this factor
_WORTH = 1.05
_PASSES = 4
#: weight of the change in a night without a model: with 16, sixteen exposures give it with 1.25
#: times the sigma of Polaris at +34 deg, and the zeros themselves with 1.6 times their best; with 4
#: it is 1.35 and 1.1 (benchmarks/zero_on_stars.py)
_CHANGE_COUNTS = 16.0
_UNKNOWN = 1.0 * DEG  # prior sigma of a zero: wider than any


class ZeroStars(NamedTuple):
    """Stars for a zero.

    Attributes
    ----------
    rows : ndarray of int, shape (g,)
        Rows of the candidates, in observing order.
    counts : ndarray of int, shape (g,)
        Number of exposures of each.
    sigma : ndarray, shape (2,)
        Expected sigma of the zeros of both axes, radians; with earlier exposures that of their
        change since then.
    """

    rows: np.ndarray
    counts: np.ndarray
    sigma: np.ndarray


class Before(NamedTuple):
    """Exposures already made.

    Attributes
    ----------
    az, el : ndarray, shape (n,)
        Catalogue place in the axes of the mount, radians.
    current : ndarray of bool, shape (n,)
        Whether they are of the power-on whose zero is needed; otherwise of another one, since
        which the change is needed.
    """

    az: np.ndarray
    el: np.ndarray
    current: np.ndarray


def exposure_noise(up):
    """Relative noise of exposures at an elevation: image motion grows as root of the air mass.

    Parameters
    ----------
    up : ndarray
        Elevation, radians, for any mount.
    """
    return 1.0 / np.sqrt(np.maximum(np.sin(up), 0.05))


class _NormalMatrices:
    """Normal matrices of (present zeros, earlier zeros, held directions) in seconds of arc."""

    def __init__(self, held, before=None, change_too=False):
        self._held = held
        self._change_too = change_too
        j = held.columns(np.zeros(1), np.full(1, 0.7)).shape[2]
        self.base = np.eye(4 + j)  # the held directions have unit variance
        self.base[:4, :4] *= (ARCSEC / _UNKNOWN) ** 2
        self.want = np.eye(2, 4 + j)
        if before is not None and len(before.az):
            self.base = self.base + self.information(
                before.az, before.el, np.where(before.current, 0, 1))
            if not before.current.all():
                self.want[:, 2:4] = -np.eye(2)
                self._change_too = False  # it is needed already

    def columns(self, az, el, group=0):
        """Design columns of exposures, shape (n, 2, k), in units of their noise."""
        held = self._held
        zeros = zero_columns(az, el, held.mount)
        rest = held.columns(az, el) / ARCSEC
        out = np.zeros((len(az), 2, len(self.base)))
        group = np.broadcast_to(group, (len(az),))
        for number in (0, 1):
            at = group == number
            out[at, :, 2 * number:2 * number + 2] = zeros.transpose(1, 0, 2)[at]
        out[:, :, 4:] = rest.transpose(1, 0, 2)
        up = held.mount.horizon_of(az, el)[1]
        return out / (NOISE / ARCSEC * exposure_noise(up))[:, None, None]

    def information(self, az, el, group):
        """Normal matrix of exposures, shape (k, k)."""
        columns = self.columns(az, el, group).reshape(-1, len(self.base))
        return columns.T @ columns

    def costs(self, normal, weighted):
        """Log of the variances of both zeros after adding each exposure, shape (m,).

        Parameters
        ----------
        normal : ndarray, shape (k, k)
        weighted : ndarray, shape (m, 2, k)
            Columns of each exposure.
        """
        out = np.log(_variances(normal, self.want, weighted)).sum(axis=1)
        if self._change_too:
            own = np.ix_((0, 1), (0, 1))
            out += _CHANGE_COUNTS * np.log(
                _variances(normal[own], np.eye(2), weighted[:, :, :2])).sum(axis=1)
        return out

    def sigma(self, normal):
        """Sigma of the required zeros, shape (2,), radians."""
        return np.sqrt(np.diag(self.want @ np.linalg.inv(normal) @ self.want.T)) * ARCSEC


def _variances(normal, want, weighted):
    """Variances of combinations `want` (w, k) with two more rows (m, 2, k) each, shape (m, w)."""
    inverse = np.linalg.inv(normal)
    # for thousands of small matrices, whole columns are five times faster
    along = (weighted.reshape(-1, len(inverse)) @ inverse).reshape(weighted.shape)
    first, second = along[:, 0], along[:, 1]
    a = 1.0 + np.einsum('mj,mj->m', first, weighted[:, 0])
    b = np.einsum('mj,mj->m', first, weighted[:, 1])
    d = 1.0 + np.einsum('mj,mj->m', second, weighted[:, 1])
    x, y = (first @ want.T).T, (second @ want.T).T
    less = (d * x**2 - 2.0 * b * x * y + a * y**2) / (a * d - b**2)
    return np.maximum(np.diag(want @ inverse @ want.T)[:, None] - less, 1e-30).T


def zero_sigma(az, el, *, model=None, mount=ALTAZ, held=True, before=None):
    """Expected sigma of a zero from some exposures.

    Parameters
    ----------
    az, el : ndarray, shape (n,)
        Catalogue place of each exposure in the axes of the mount, radians.
    model : PointingModel, optional
        Held terms: see `zero_held_terms.Held`.
    mount : Mount, optional
        Used if no model gives it.
    held : bool
        Whether errors of the held terms count.
    before : Before, optional

    Returns
    -------
    ndarray, shape (2,)
        For both axes (coordinate angles), radians.
    """
    what = Held(model, mount) if held else Held.certain(mount if model is None else model.mount)
    design = _NormalMatrices(what, before)
    return design.sigma(design.base + design.information(az, el, 0))


def choose_places(az, el, n, *, model=None, mount=ALTAZ, before=None, keep=(), start=None,
                  most=MOST):
    """Choose the places whose exposures determine the zeros best.

    Parameters
    ----------
    az, el : ndarray, shape (m,)
        Candidates: catalogue places in the axes of the mount, radians.
    n : int
        Number of exposures.
    model : PointingModel, optional
        Held terms, with their covariance; by default each of the other terms within
        `zero_held_terms.BROAD`.
    mount : Mount, optional
        Used if no model gives it.
    before : Before, optional
        Earlier exposures that are used, too.
    keep : sequence of int
        Candidates that must be taken (those of the previous power-on).
    start : (float, float), optional
        Present axis angles of the mount, radians.
    most : int
        Largest number of different stars.

    Returns
    -------
    ZeroStars

    Raises
    ------
    ValueError
        No candidates.
    """
    if not len(az):
        raise ValueError('no star to set a zero by')
    design = _NormalMatrices(Held(model, mount), before, change_too=not is_a_model(model))
    columns = design.columns(az, el)
    # at least two exposures each, to estimate the noise from their scatter
    most = min(most, max(n // 2, 1), len(az))
    keep = list(keep)[:most]
    best = None
    for count in range(max(len(keep), min(FEWEST, most), 1), most + 1, 2):
        rows = _exchanged(design, columns, n, count, keep)
        rows, counts, normal = _exposures(design, columns, rows, n)
        sigma = design.sigma(normal)
        if best is None or np.any(best[2] > _WORTH * sigma):
            best = rows, counts, sigma
    rows, counts, sigma = best
    order = _short_way(az[rows], el[rows], mount if model is None else model.mount, start)
    return ZeroStars(rows[order], counts[order], sigma)


def _exchanged(design, columns, n, count, keep):
    """Rows of `count` candidates, for n / count exposures each."""
    weighted = columns * np.sqrt(n / count)

    def gram(row):
        return weighted[row].T @ weighted[row]

    chosen = list(keep)
    normal = design.base + sum(map(gram, chosen), np.zeros_like(design.base))
    while len(chosen) < count:
        f = design.costs(normal, weighted)
        f[chosen] = np.inf
        chosen.append(int(np.argmin(f)))
        normal = normal + gram(chosen[-1])
    for _ in range(_PASSES):
        changed = False
        for place in range(len(keep), count):
            without = normal - gram(chosen[place])
            f = design.costs(without, weighted)
            f[np.delete(chosen, place)] = np.inf
            other = int(np.argmin(f))
            if f[other] < f[chosen[place]] - 1e-6:
                chosen[place], changed = other, True
            normal = without + gram(chosen[place])
        if not changed:
            break
    return np.array(chosen)


def _exposures(design, columns, rows, n):
    """Number of exposures for each: one (or two if possible), then more where they help most."""
    grams = np.einsum('ncj,nck->njk', columns[rows], columns[rows])
    counts = np.full(len(rows), min(2, n // len(rows)))
    normal = design.base + np.tensordot(counts, grams, 1)
    while counts.sum() < n:
        best = int(np.argmin(design.costs(normal, columns[rows])))
        counts[best] += 1
        normal = normal + grams[best]
    return rows, counts, normal


def _short_way(az, el, mount, start):
    """Order with short moves of the axes: always to the closest star."""
    az, el = mount.on_travel(np.asarray(az, float), np.asarray(el, float))
    left = list(range(len(az)))
    here = (az[0], el[0]) if start is None else start
    order = []
    turns = not mount.two_sided  # its travel ends at the pier
    while left:
        first = az[left] - here[0]
        move = np.maximum(np.abs(wrap(first) if turns else first), np.abs(el[left] - here[1]))
        order.append(left.pop(int(np.argmin(move))))
        here = az[order[-1]], el[order[-1]]
    return np.array(order)


def zero_stars(stars, time, n, *, site=DEFAULT_SITE, weather=DEFAULT_WEATHER, mount=ALTAZ,
               model=None, before=None, prefer=(), exclude=(), min_el=20.0 * DEG,
               max_el=85.0 * DEG, mag_limit=6.0, duration=0.0, start=None, limits=ANYWHERE):
    """Choose stars of the catalogue for a zero.

    Parameters
    ----------
    stars : Stars
        The catalogue. Load it two magnitudes deeper than `mag_limit`, to include disturbing
        neighbours.
    time : float
        Begin of the exposures, UTC seconds since 1970-01-01.
    n : int
        Number of exposures.
    site, weather : Site, Weather
    mount : Mount
    model : PointingModel, optional
        Held terms: see `choose_places`.
    before : Before, optional
    prefer : sequence of int
        Hipparcos numbers to take again if they are up: from the previous power-on.
    exclude : sequence of int
        Hipparcos numbers to exclude: stars for validation.
    min_el, max_el : float
        Limits of observed elevation, radians.
    mag_limit : float
        Faintest magnitude Hp.
    duration : float
        Duration of the exposures, s: a star stays within the limits for this time.
    start : (float, float), optional
        Present axis angles of the mount, radians.
    limits : star_choice.AxisLimits
        Limits of the axes; for `max_el` see then `star_choice.choose_stars`.

    Returns
    -------
    ZeroStars
        Its rows are rows of `stars`. Polaris is never included.

    Raises
    ------
    ValueError
        No star within the limits.
    """
    bright, places, up, known, lonely = observable(
        stars, [time, time + 0.5 * duration, time + duration], site, weather, min_el, max_el,
        mag_limit, [POLARIS_HIP, *exclude], mount, limits)
    up &= lonely & ~known
    if not up.any():
        raise ValueError(
            f'no star visible to Hp {mag_limit:g} between {min_el / DEG:g} and {max_el / DEG:g} '
            'degrees of elevation to set the zero by: widen the limits')
    az, el = (angle[up] for angle in places[1])
    rows = bright[up]
    first, second = axes_at(mount, az, el, limits, stars.hip[rows])
    found = choose_places(
        first, second, n, model=model, mount=mount, before=before, start=start,
        keep=[row for number in prefer for row in np.flatnonzero(stars.hip[rows] == number)])
    return found._replace(rows=rows[found.rows])
