"""The encoders' zero from exposures of any stars, by generalised least squares.

An exposure reads the zeros of both axes and what every other term does at its place. The other
terms are held at their model, with its covariance C: beside the noise N the exposures have the
covariance N + D C D', which is the same as fitting the terms with the model as their prior. Without
a model each term is within `held_terms.BROAD`: then the stars themselves tell what they can of
the terms, and the zeros of all power-ons go with the same terms, so that these cancel in the
change.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, fdtrc

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.held_terms import Held, is_a_model, zero_columns
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.terms import design
from pointing_model.zero_exposures import is_marked, way_of

from ...estimation.estimate import Estimate
from ...estimation.least_squares import System
from ...estimation.robust import LOSS
from ...rows import UNREACHABLE, usable
from .polaris_zero import (
    FEWEST_FOR_ROBUST,
    NO_MODEL,
    MeasuredZero,
    contamination,
    other_terms,
    student_factor,
    told_model,
    zero_from_polaris,
)

#: chance with which stars that agree with the model are said not to
_DISAGREE = 0.05
_ROUNDS = 4  # of the linearisation, without a model
#: freedom from which the scatter of the exposures of a star about their mean tells the noise
_ENOUGH = 3.0
_FLOOR = 1e-3  # arcsec: noise is no less
_SETTLED = 1e-5  # arcsec: residuals of an iteration
_ROUNDS_OF_NOISE = 20
_RCOND = 1e-12  # the prior determines what the exposures do not


def zeros_of_power_ons(parts, reference, *, encoder='enc'):
    """The zero of each power-on from its exposures.

    Parameters
    ----------
    parts : dict of int to PointingRun
        Number of the power-on -> its exposures for a zero, at least one.
    reference : PointingModel
        Of an earlier night; one without terms: none.
    encoder : {'enc', 'abs'}

    Returns
    -------
    dict of int to MeasuredZero
        By Polaris as `polaris_zero.zero_from_polaris` gives it. Where stars were exposed and there
        is no reference, all power-ons together.

    Raises
    ------
    ValueError
        A power-on has no usable exposure, or too few.
    """
    if is_alone(parts, reference):
        return {number: zero_from_exposures(part, reference, encoder=encoder, run=number)
                for number, part in parts.items()}
    solved = _solve(list(parts.values()), [f'power-on {number}' for number in parts], None,
                    encoder)
    return {number: solved.zero(place, number, NO_MODEL)
            for place, number in enumerate(parts)}


def is_alone(parts, reference):
    """Whether the zero of each power-on has nothing to do with others; see `zeros_of_power_ons`."""
    return is_a_model(reference) or not any(is_marked(part).any() for part in parts.values())


def zero_from_exposures(exposures, reference, *, encoder='enc', model=None, run=None,
                        reference_name='an earlier power-on', means=None):
    """Change of the encoders' zero since a reference, from exposures of Polaris or of stars.

    Parameters
    ----------
    exposures : PointingRun
        All of its rows are for the zero, see `zero_exposures.is_for_zero`.
    reference, encoder, model, run, reference_name, means
        As of `polaris_zero.zero_from_polaris`, which does it where all exposures are of Polaris.
        With reference exposures, `model` was not fitted to them nor to `exposures`: else their
        noise would count as if it were of other stars.

    Returns
    -------
    MeasuredZero

    Raises
    ------
    ValueError
        No usable exposure, or too few of them; `model` beside a reference that is one.
    """
    since = isinstance(reference, PointingRun)
    if not is_marked(exposures).any() and not (since and is_marked(reference).any()):
        return zero_from_polaris(exposures, reference, encoder=encoder, model=model, run=run,
                                 reference_name=reference_name, means=means)
    if not since:
        if model is not None:
            raise ValueError('the reference is a model already; leave out the second one')
        return _solve([exposures], ['tonight'], reference, encoder).zero(
            0, run, told_model(reference))
    solved = _solve([exposures, reference], ['tonight', reference_name], model, encoder)
    return solved.change(run, f'{solved.used[1]} exposures of {solved.ways[1]}, {reference_name}')


class _ZeroRows(NamedTuple):
    """Usable exposures of all groups, on the sky in seconds of arc."""

    az: np.ndarray
    el: np.ndarray
    enc: np.ndarray  # (2, n), what the encoder reads, radians
    sigmas: np.ndarray | None  # (2, n)
    context: Context | None
    group: np.ndarray
    star: np.ndarray  # a number for each star of each group
    mount: object


class _StarZeros(NamedTuple):
    """Zeros of the groups and what they rest on; angles in seconds of arc."""

    value: np.ndarray  # (2g,)
    covariance: np.ndarray
    noise: np.ndarray
    response: np.ndarray  # (2g, 2n): zeros by offsets, x of all rows and then y
    rows: _ZeroRows
    weights: np.ndarray
    ways: list
    used: list
    lost: list
    sigma_from: str
    misfit: float

    def zero(self, place, run, reference):
        """Of a group, a MeasuredZero."""
        pick = np.arange(2) + 2 * place
        return self._made(np.eye(len(self.value))[pick], pick[:1] // 2, run, reference)

    def change(self, run, reference):
        """Of the first group since the second."""
        pick = np.zeros((2, len(self.value)))
        pick[:, :2], pick[:, 2:4] = np.eye(2), -np.eye(2)
        return self._made(pick, [0], run, reference, only_now=True)

    def _made(self, pick, groups, run, reference, only_now=False):
        rows, place = self.rows, int(groups[0])
        names = other_terms(rows.mount)
        false = np.concatenate(design(names, rows.az, rows.el, rows.mount))
        if only_now:  # a term that has changed is as it was in the exposures of before
            false = false * np.tile(rows.group == place, 2)[:, None]
        value = pick @ self.value * ARCSEC
        return MeasuredZero(
            run=run, az=float(value[0]), el=float(value[1]),
            covariance=pick @ self.covariance @ pick.T * ARCSEC**2,
            noise=pick @ self.noise @ pick.T * ARCSEC**2, n=self.used[place],
            reference=reference, sigma_from=self.sigma_from,
            contamination=contamination(names, pick @ self.response @ false),
            rejected=self.lost[place], by=self.ways[place], mount=rows.mount,
            misfit=self.misfit)


def _solve(groups, names, model, encoder):
    """Zeros of groups of exposures that share the held terms, a `_StarZeros`."""
    rows = _collected(groups, names, model, encoder)
    mount, n, g = rows.mount, len(rows.az), len(groups)
    held = Held(model, mount)
    zeros = zero_columns(rows.az, rows.el, mount)
    columns = np.concatenate([
        *(zeros * (rows.group == k)[:, None] for k in range(g)),
        held.columns(rows.az, rows.el) / ARCSEC], axis=2)  # (2, n, k)
    prior = np.r_[np.zeros(2 * g), np.ones(columns.shape[2] - 2 * g)]
    if is_a_model(model):
        fit = _estimate(columns, _left(rows, model), prior, rows)
    else:  # about the terms as they are found: rotations are not linear
        found = np.zeros(len(prior))
        for _ in range(_ROUNDS):
            values = dict(zip(held.names, held.root @ found[2 * g:]))
            about = PointingModel(values, mount=mount)
            left = _left(rows, about) + columns[:, :, 2 * g:] @ found[2 * g:]
            fit = _estimate(columns, left, prior, rows)
            found = fit.coefficients
    weights, sigma = fit.weights, _sigma(fit.scatter, rows)
    misfit = _misfit(fit, prior, rows, g)
    inflation = LOSS.inflation if fit.robust else 1.0
    if rows.sigmas is None:
        inflation *= np.square([student_factor(max(free, 1.0)) for free in fit.freedom])[:, None]
    wide = weights / (np.square(sigma) * inflation)
    final = _normal(columns, wide) + np.diag(prior)
    own = np.linalg.pinv(_normal(columns[:, :, :2 * g], wide), hermitian=True)
    plain = (columns * (weights / np.square(sigma))[:, :, None]).reshape(2 * n, -1)
    by_group = [rows.group == k for k in range(g)]
    return _StarZeros(
        fit.coefficients[:2 * g], np.linalg.inv(final)[:2 * g, :2 * g] * misfit**2, own * misfit**2,
        fit.covariance[:2 * g] @ plain.T, rows, weights,
        [way_of(part) for part in groups],
        [int(np.count_nonzero(weights[at] > 0.0)) for at in by_group],
        [int(np.count_nonzero(weights[at] == 0.0)) for at in by_group],
        'measured scatter' if rows.sigmas is None else 'given sigmas', misfit)


def _collected(groups, names, model, encoder):
    """Usable exposures of all groups, `_ZeroRows`."""
    parts, stars, contexts = [], 0, []
    mount = groups[0].mount
    effects = model is not None and model.effects
    for number, (run, name) in enumerate(zip(groups, names)):
        found = usable(run, encoder)
        if is_a_model(model):
            context = Context.of_run(run, encoder) if effects else None
            at = np.stack(model.sky_to_encoder(run['az'], run['el'], context))
            found = found.only(np.isfinite(at[:, found.rows]).all(axis=0), UNREACHABLE)
        count = len(found.rows)
        if count == 0:
            raise ValueError(f'no usable exposure for a zero ({name}); observe some first')
        if count == 1 and found.sigmas is None:
            raise ValueError(f'one exposure for a zero ({name}) has no scatter; give sigma_x and '
                             'sigma_y or expose again')
        _, star = np.unique(run['star'][found.rows], return_inverse=True)
        parts.append((found.az, found.el, np.stack((found.az_enc, found.el_enc)),
                      None if found.sigmas is None else found.sigmas.reshape(2, count),
                      np.full(count, number), stars + star))
        contexts.append(run.select(found.rows))
        stars += star.max() + 1
    az, el, enc, sigmas, group, star = zip(*parts)
    given = all(s is not None for s in sigmas)
    context = Context.of_run(PointingRun.concatenate(contexts), encoder) if effects else None
    return _ZeroRows(np.concatenate(az), np.concatenate(el), np.concatenate(enc, axis=1),
                 np.concatenate(sigmas, axis=1) / ARCSEC if given else None, context,
                 np.concatenate(group), np.concatenate(star), mount)


def _left(rows, model):
    """Encoder - model on the sky, shape (2, n), arcsec."""
    first, second = model.sky_to_encoder(rows.az, rows.el, rows.context)
    return np.stack((wrap(rows.enc[0] - first) * np.cos(rows.el),
                     wrap(rows.enc[1] - second))) / ARCSEC


def _normal(columns, weights):
    """Normal matrix of columns (2, n, k) with weights (2, n)."""
    return np.tensordot(columns * weights[:, :, None], columns, ((0, 1), (0, 1)))


def _sigma(scatter, rows):
    """Noise of the exposures, shape (2, n)."""
    return (np.broadcast_to(np.array(scatter)[:, None], (2, len(rows.az)))
            if rows.sigmas is None else rows.sigmas)


def _estimate(columns, left, prior, rows):
    """Zeros and held terms by the exposures, an `Estimate`.

    Of it the covariance is the inverse of the normal matrix with the prior, the scatter the noise
    of an exposure in each axis, and the freedom that of this noise.

    Parameters
    ----------
    columns : ndarray, shape (2, n, k)
    left : ndarray, shape (2, n)
    prior : ndarray, shape (k,)
    rows : _ZeroRows
    """
    _, n, k = columns.shape
    design = np.moveaxis(columns, 2, 0).reshape(k, 2 * n)
    scatter, robust, rank, before = np.ones(2), False, 0.0, np.inf
    for _ in range(_ROUNDS_OF_NOISE):
        system = System(design, left.ravel(), 1.0 / np.square(_sigma(scatter, rows)).ravel(),
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
            if robust or n < FEWEST_FOR_ROBUST or 2 * n - rank < _ENOUGH + 1.0:
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
    """What tells the noise of each axis: squares, (2,), and their freedom, (2,).

    About the mean of each star, where they are enough: what the model lacks at a place is no noise.
    """
    squares, free = _within(residual, weights, rows)
    if free >= _ENOUGH:
        return squares, np.full(2, free)
    squares, free = np.square(residual) @ weights, weights.sum() - taken
    if free.min() >= _ENOUGH:
        return squares, free
    if free.sum() < 0.5 and rows.sigmas is None:
        raise ValueError(f'{len(weights)} exposures for a zero do not tell their noise; '
                         'expose more often')
    return np.full(2, squares.sum()), np.full(2, free.sum())


def _misfit(fit, prior, rows, groups):
    """How much more the stars disagree than their noise and what is held allow; 1: they do not."""
    weights, sigma = fit.weights, _sigma(fit.scatter, rows)
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
    p = chdtrc(dof, between) if rows.sigmas is not None else fdtrc(dof, 2.0 * free, ratio)
    return float(np.sqrt(ratio)) if ratio > 1.0 and p < _DISAGREE else 1.0
