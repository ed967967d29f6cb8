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

"""The encoders' zero from exposures of Polaris, or any stars, by generalised least squares.

An exposure measures the zeros of both axes plus the effect of all other terms at its position. The
other terms are held at the model, with its covariance C: the exposures have the covariance
N + D C D' with noise N, which is equivalent to fitting the terms with the model as prior. Without a
model the prior sigma of each term is `zero_held_terms.BROAD`. Then the stars themselves determine
the terms as far as they can, and the zeros of all power-ons share these terms, so that their errors
cancel in a change. Polaris alone is at one position, where nothing can be separated: without a
model its zero is the whole offset there.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import design
from pointing_model.runs.run import PointingRun
from pointing_model.zero import is_marked, way_of
from pointing_model.zero_held_terms import Held, is_a_model, zero_columns

from ...estimation.estimate import Estimate
from ...estimation.least_squares import System
from ...estimation.robust import LOSS
from ...estimation.step_scan import student_factor
from ...rows import UNREACHABLE, usable

#: with fewer exposures robust weights do not help: one exposure 20" off causes an error of 6.5"
#: among 3 and 4.2" among 4 with weights, 6.7" and 5.0" without; 1.6" and 4.0" among 5, 0.4" and
#: 2.6" among 8
_FEWEST_FOR_ROBUST = 5
#: false-alarm probability of the test whether stars agree with the model
_DISAGREE = 0.05
_ROUNDS = 4  # iterations of the linearisation, without a model
#: fewest degrees of freedom to take the noise from the scatter of exposures of each star
_ENOUGH = 3.0
_FLOOR = 1e-3  # arcsec, smallest noise
_SETTLED = 1e-5  # arcsec, change of residuals at convergence
_ROUNDS_OF_NOISE = 20
_RCOND = 1e-12  # the prior determines what the exposures do not


class ZeroRows(NamedTuple):
    """Usable exposures of all groups; offsets on the sky in arcsec."""

    az: np.ndarray
    el: np.ndarray
    enc: np.ndarray  # (2, n), encoder angles, radians
    sigmas: np.ndarray | None  # (2, n)
    context: Context | None
    group: np.ndarray
    star: np.ndarray  # a number for each star of each group
    mount: object

    def offsets(self, model):
        """Encoder - model, shape (2, n)."""
        first, second = model.sky_to_encoder(self.az, self.el, self.context)
        return np.stack((wrap(self.enc[0] - first) * np.cos(self.el),
                         wrap(self.enc[1] - second))) / ARCSEC

    def noise(self, scatter):
        """Noise of each exposure, (2, n): given sigmas, or else the scatter (2,)."""
        return (np.broadcast_to(np.array(scatter)[:, None], (2, len(self.az)))
                if self.sigmas is None else self.sigmas)


class ZeroEstimate(NamedTuple):
    """Zeros of g groups of exposures; angles in arcsec.

    Attributes
    ----------
    value : ndarray, shape (2g,)
    covariance, noise : ndarray, shape (2g, 2g)
        With the held terms, and from the noise of the exposures alone.
    response : ndarray, shape (2g, 2n)
        Derivatives of the zeros with respect to the offsets, x of all rows and then y.
    rows : ZeroRows
    used, rejected : list of int
        Exposures of each group with a weight, and without.
    ways : list of str
    misfit : float
        Factor by which sigma is widened because the stars disagree; 1: they agree.
    """

    value: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    response: np.ndarray
    rows: ZeroRows
    used: list
    rejected: list
    ways: list
    misfit: float

    def contamination(self, pick, place=None):
        """Names of the terms, and the change of combinations `pick` of the zeros per unit change of
        each term, (p, k).

        The change affects the exposures of the group `place` only; None: all.
        """
        of = self.rows.mount.names
        names = tuple(name for name in of.physical if name not in of.index)
        columns = np.concatenate(design(names, self.rows.az, self.rows.el, self.rows.mount))
        if place is not None:
            columns = columns * np.tile(self.rows.group == place, 2)[:, None]
        return names, pick @ self.response @ columns


def estimate_zeros(groups, names, model, encoder):
    """Zeros of groups of exposures that share the held terms.

    Parameters
    ----------
    groups : list of PointingRun
        Exposures of one power-on each.
    names : list of str
        Names of the groups for error messages.
    model : PointingModel or None
        Model of the held terms.
    encoder : {'enc', 'abs'}

    Returns
    -------
    ZeroEstimate

    Raises
    ------
    ValueError
        A group has no usable exposure, or too few.
    """
    rows = _collected(groups, names, model, encoder)
    mount, n, g = rows.mount, len(rows.az), len(groups)
    marked = any(is_marked(group).any() for group in groups)
    held = Held(model, mount) if is_a_model(model) or marked else Held.certain(mount)
    zeros = zero_columns(rows.az, rows.el, mount)
    columns = np.concatenate([
        *(zeros * (rows.group == k)[:, None] for k in range(g)),
        held.columns(rows.az, rows.el) / ARCSEC], axis=2)  # (2, n, k)
    prior = np.r_[np.zeros(2 * g), np.ones(columns.shape[2] - 2 * g)]
    about, found = model, np.zeros(len(prior))
    for _ in range(1 if is_a_model(model) or not held.names else _ROUNDS):
        if not is_a_model(model):  # linearise at the current terms: rotations are not linear
            about = PointingModel(dict(zip(held.names, held.root @ found[2 * g:])), mount=mount)
        offsets = rows.offsets(about) + columns[:, :, 2 * g:] @ found[2 * g:]
        fit = _fit(columns, offsets, prior, rows)
        found = fit.coefficients
    weights, sigma = fit.weights, rows.noise(fit.scatter)
    misfit = _misfit(fit, prior, rows, g) if marked else 1.0
    inflation = LOSS.inflation if fit.robust else 1.0
    if rows.sigmas is None:
        inflation *= np.square(student_factor(np.maximum(fit.freedom, 1.0)))[:, None]
    wide = weights / (np.square(sigma) * inflation)
    final = _normal(columns, wide) + np.diag(prior)
    own = np.linalg.pinv(_normal(columns[:, :, :2 * g], wide), hermitian=True)
    plain = (columns * (weights / np.square(sigma))[:, :, None]).reshape(2 * n, -1)
    used = [int(np.count_nonzero(weights[rows.group == k] > 0.0)) for k in range(g)]
    return ZeroEstimate(
        fit.coefficients[:2 * g], np.linalg.inv(final)[:2 * g, :2 * g] * misfit**2, own * misfit**2,
        fit.covariance[:2 * g] @ plain.T, rows, used,
        [int(np.count_nonzero(rows.group == k)) - count for k, count in enumerate(used)],
        [way_of(part) for part in groups], misfit)


def _collected(groups, names, model, encoder):
    """Usable exposures of all groups, `ZeroRows`."""
    run = PointingRun.concatenate(groups)
    group = np.repeat(np.arange(len(groups)), [len(one) for one in groups])
    found = usable(run, encoder)
    effects = model is not None and model.effects
    if is_a_model(model):
        context = Context.from_run(run, encoder) if effects else None
        at = np.stack(model.sky_to_encoder(run['az'], run['el'], context))
        found = found.only(np.isfinite(at[:, found.rows]).all(axis=0), UNREACHABLE)
    group = group[found.rows]
    for number, name in enumerate(names):
        count = np.count_nonzero(group == number)
        if count == 0:
            raise ValueError(f'no usable exposure for a zero ({name}); observe some first')
        if count == 1 and found.sigmas is None:
            raise ValueError(f'one exposure for a zero ({name}) has no scatter; give sigma_x and '
                             'sigma_y or expose again')
    used = run.select(found.rows)
    _, star = np.unique(np.stack((group, used['star'])), axis=1, return_inverse=True)
    return ZeroRows(
        found.az, found.el, np.stack((found.az_enc, found.el_enc)),
        None if found.sigmas is None else found.sigmas.reshape(2, -1) / ARCSEC,
        Context.from_run(used, encoder) if effects else None, group, star.ravel(), run.mount)


def _normal(columns, weights):
    """Normal matrix of columns (2, n, k) with weights (2, n)."""
    return np.tensordot(columns * weights[:, :, None], columns, ((0, 1), (0, 1)))


def _fit(columns, offsets, prior, rows):
    """Fit zeros and held terms to the exposures, an `Estimate`.

    Its covariance is the inverse of the normal matrix with the prior, its scatter the noise of an
    exposure in each axis, and its freedom the degrees of freedom of this noise.

    Parameters
    ----------
    columns : ndarray, shape (2, n, k)
    offsets : ndarray, shape (2, n)
    prior : ndarray, shape (k,)
    rows : ZeroRows
    """
    _, n, k = columns.shape
    design = np.moveaxis(columns, 2, 0).reshape(k, 2 * n)
    scatter, robust, rank, before = np.ones(2), False, 0.0, np.inf
    for _ in range(_ROUNDS_OF_NOISE):
        system = System(design, offsets.ravel(), 1.0 / np.square(rows.noise(scatter)).ravel(),
                        _RCOND, prior=prior)
        if robust:
            solution, weights = system.solve_robust(
                LOSS, (1.0, 1.0), system.solve_huber(rank)[0].residual, _SETTLED)
        if not robust or weights.sum() < 1.0:
            robust, weights, solution = False, np.ones(n), system.solve()
        residual = solution.residual.reshape(2, n)
        taken = np.array([np.vdot(solution.inverse, system.normal(weights, axis))
                          for axis in (0, 1)])
        squares, freedom = _noise(residual, weights, taken, rows)
        if rows.sigmas is None:
            scatter = np.maximum(np.sqrt(squares / freedom / (
                LOSS.variance if robust else 1.0)), _FLOOR)
        rank = taken.sum()
        if np.abs(residual - before).max() < _SETTLED:
            if robust or n < _FEWEST_FOR_ROBUST or 2 * n - rank < _ENOUGH + 1.0:
                break
            robust = True
        before = residual
    return Estimate(solution.p, solution.inverse, freedom, tuple(scatter), residual, weights,
                    solution.rank, robust)


def _within(residual, weights, rows):
    """Sum of squares about the mean of each star, (2,), and its degrees of freedom."""
    count = rows.star.max() + 1
    total = np.bincount(rows.star, weights, count)
    squares = []
    for one in residual:
        mean = np.bincount(rows.star, weights * one, count) / np.maximum(total, 1e-12)
        squares.append(weights @ np.square(one - mean[rows.star]))
    return np.array(squares), weights.sum() - np.count_nonzero(total > 1e-6)


def _noise(residual, weights, taken, rows):
    """Sum of squares, (2,), and degrees of freedom, (2,), to estimate the noise of each axis.

    About the mean of each star if there are enough exposures: model errors at a position are no
    noise. With one star there is no other way.
    """
    squares, free = _within(residual, weights, rows)
    if free >= (1.0 if rows.star.max() == rows.group.max() else _ENOUGH):
        return squares, np.full(2, free)
    squares, free = np.square(residual) @ weights, weights.sum() - taken
    if free.min() >= _ENOUGH:
        return squares, free
    if free.sum() < 0.5 and rows.sigmas is None:
        raise ValueError(f'{len(weights)} exposures for a zero do not show their noise; '
                         'expose more often')
    return np.full(2, squares.sum()), np.full(2, free.sum())


def _misfit(fit, prior, rows, groups):
    """Ratio of the disagreement of stars to that allowed by noise and held terms; 1: they agree."""
    weights, sigma = fit.weights, rows.noise(fit.scatter)
    whole = (weights * np.square(fit.residual / sigma)).sum() + (
        prior @ np.square(fit.coefficients))
    if rows.sigmas is None:
        squares, free = _within(fit.residual, weights, rows)
        if free < _ENOUGH:
            return 1.0
        seen = len(np.unique(rows.star[weights > 1e-6]))
        between, dof = whole - (squares / np.square(fit.scatter)).sum(), 2 * seen - 2 * groups
    else:
        between, dof = whole, 2 * np.count_nonzero(weights > 1e-6) - 2 * groups
    if dof <= 0:
        return 1.0
    ratio = between / dof
    from scipy.special import chdtrc, fdtrc  # takes 0.25 s to load
    p = chdtrc(dof, between) if rows.sigmas is not None else fdtrc(dof, 2.0 * free, ratio)
    return float(np.sqrt(ratio)) if ratio > 1.0 and p < _DISAGREE else 1.0
