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

An exposure reads the zeros of both axes and what every other term does at its place. The other
terms are held at their model, with its covariance C: beside the noise N the exposures have the
covariance N + D C D', which is the same as fitting the terms with the model as their prior. Without
a model each term is within `zero_held_terms.BROAD`: then the stars themselves show what they can of
the terms, and the zeros of all power-ons go with the same terms, so that these cancel in the
change. Polaris alone stays at one place, where nothing can be separated: without a model its zero
is the whole offset there.
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

#: below, weights do not help: one exposure 20" off leaves 6.5" of error among 3 and 4.2" among 4
#: with them, 6.7" and 5.0" without; among 5 it is 1.6" and 4.0", among 8 0.4" and 2.6"
_FEWEST_FOR_ROBUST = 5
#: chance with which stars that agree with the model are said not to
_DISAGREE = 0.05
_ROUNDS = 4  # of the linearisation, without a model
#: freedom from which the scatter of the exposures of a star about their mean shows the noise
_ENOUGH = 3.0
_FLOOR = 1e-3  # arcsec: noise is no less
_SETTLED = 1e-5  # arcsec: residuals of an iteration
_ROUNDS_OF_NOISE = 20
_RCOND = 1e-12  # the prior determines what the exposures do not


class ZeroRows(NamedTuple):
    """Usable exposures of all groups, on the sky in seconds of arc."""

    az: np.ndarray
    el: np.ndarray
    enc: np.ndarray  # (2, n), what the encoder reads, radians
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
        """Of each exposure, (2, n); where sigmas were not given the scatter (2,)."""
        return (np.broadcast_to(np.array(scatter)[:, None], (2, len(self.az)))
                if self.sigmas is None else self.sigmas)


class ZeroEstimate(NamedTuple):
    """Zeros of g groups of exposures and what they rest on; angles in seconds of arc.

    Attributes
    ----------
    value : ndarray, shape (2g,)
    covariance, noise : ndarray, shape (2g, 2g)
        With the held terms, and by the noise of the exposures alone.
    response : ndarray, shape (2g, 2n)
        Zeros by offsets, x of all rows and then y.
    rows : ZeroRows
    used, rejected : list of int
        Exposures of each group with a weight, and without.
    ways : list of str
    misfit : float
        By how much the covariance is widened since the stars disagree; 1: they do not.
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
        """What a change of each term by one makes of the combinations `pick` of the zeros, (p, k).

        Only the exposures of the group `place` see it; None: all do. Names of the terms come first.
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
        Their exposures, of one power-on each.
    names : list of str
        What they are called where they are too few.
    model : PointingModel or None
        That is held.
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
        if not is_a_model(model):  # about the terms as they are found: rotations are not linear
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
    """Zeros and held terms by the exposures, an `Estimate`.

    Of it the covariance is the inverse of the normal matrix with the prior, the scatter the noise
    of an exposure in each axis, and the freedom that of this noise.

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
    """Squares of the residuals about the mean of each star, (2,), and the freedom left."""
    count = rows.star.max() + 1
    total = np.bincount(rows.star, weights, count)
    squares = []
    for one in residual:
        mean = np.bincount(rows.star, weights * one, count) / np.maximum(total, 1e-12)
        squares.append(weights @ np.square(one - mean[rows.star]))
    return np.array(squares), weights.sum() - np.count_nonzero(total > 1e-6)


def _noise(residual, weights, taken, rows):
    """What shows the noise of each axis: squares, (2,), and their freedom, (2,).

    About the mean of each star, where they are enough: what the model lacks at a place is no noise.
    Of one star there is nothing else.
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
    """How much more the stars disagree than their noise and what is held allow; 1: they do not."""
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
    from scipy.special import chdtrc, fdtrc  # a quarter of a second
    p = chdtrc(dof, between) if rows.sigmas is not None else fdtrc(dof, 2.0 * free, ratio)
    return float(np.sqrt(ratio)) if ratio > 1.0 and p < _DISAGREE else 1.0
