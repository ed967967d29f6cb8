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

"""Least-squares fits of pointing terms (geometric ones as exact rotations) and harmonics."""

from dataclasses import replace

import numpy as np

from msg_tools.units import wrap
from pointing_model import geometry
from pointing_model.context import Context
from pointing_model.geometry import linearised, values
from pointing_model.harmonics import DEGREE, Harmonics, columns_of, names_of
from pointing_model.model import PointingModel
from pointing_model.mount_kinds import CANONICAL
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import PHYSICAL, Trig, stacked_design
from pointing_model.zero import NO_ZERO, PowerOnZero, Zeros

from ..estimation.gauss_newton import LinearProblem, gauss_newton
from ..estimation.group_columns import GroupColumns
from ..estimation.least_squares import weighted_solve
from ..estimation.robust import LOSS
from ..rows import UNREACHABLE, mild_sigmas, usable
from .finding import Finding
from .fit_result import make_result

#: Directions of the (column-scaled) coefficients with a singular value below this part of the
#: largest are not determined by the stars, and dropped. Measured for the seven terms: 30 stars over
#: the sky 1e-2 to 3e-2, a field of 5 degrees 1.2e-4, one of 1 degree 5e-6, the circle of Polaris
#: 9e-6. So it separates a field, which determines something, from a single direction.
RCOND = 1e-5
#: The same for the harmonics. The functions themselves have 1.8e-4 (200 stars above 20 degrees),
#: 30 stars 0.5e-4 to 1.7e-4: smaller values are due to few stars, not to dependent functions.
RCOND_HARMONICS = 1e-4

#: rad, distance from the axis within which azimuth differences are wrapped to half a turn
_CLOSE = 0.05


def _turning(names, mount):
    """Index -> name and sign of the equivalent alt-azimuth rotation, for terms that are rotations.

    Without the zeros of the axes, whose columns are constant.
    """
    known = mount.names.terms
    return {i: known[name] for i, name in enumerate(names)
            if name in known and known[name][0] not in ('IA', 'IE')}


class RotationProblem:
    """A problem for `gauss_newton`: geometric terms are exact rotations, the others linear.

    Parameters
    ----------
    trig : pointing_terms.Trig
        Of the n catalogue places.
    terms : sequence of str
        The fitted terms; further rows of the design are linear.
    turned : dict of str to float
        Held values of geometric terms, radians; a fitted one is added.
    observed : ndarray, shape (2n,)
        Encoder - catalogue on the sky, x of all rows, then y, radians.
    columns : ndarray, shape (k, 2n)
        Columns of the terms; those of the geometric ones are overwritten.
    first_order : ndarray, or GroupColumns
        The same array, or a GroupColumns that contains it.
    mount : Mount
    """

    linear = False

    def __init__(self, trig, terms, turned, observed, columns, first_order, mount):
        self.trig, self.mount = trig, mount
        self.observed, self.first_order = observed, first_order
        own = mount.names.terms
        self._held = values(turned, mount)
        #: row -> name and sign of the rotation of an alt-azimuth mount
        self._places = {i: own[name] for i, name in enumerate(terms) if name in own}
        self._turning = _turning(terms, mount)
        self._terms, self._columns = columns, {}

    def residual(self, p):
        """See `gauss_newton.LinearProblem`."""
        at = list(self._held)
        for i, (name, sign) in self._places.items():
            at[CANONICAL.index(name)] += sign * float(p[i])
        trig = self.trig
        x, y, self._columns = linearised(
            trig, at, [name for name, _ in self._turning.values()])
        if trig.side is not None:
            x, y = trig.side * x, trig.side * y
        residual = self.observed - np.concatenate((x, y))
        if len(self._places) < len(p):
            rest = p.copy()
            rest[list(self._places)] = 0.0
            if rest.any():
                residual -= rest @ self.first_order
        close = np.flatnonzero((np.abs(trig.cos_el) < _CLOSE) & (trig.cos_el != 0.0))
        if len(close):  # near the axis azimuths may differ by half a turn
            cos_el = trig.cos_el[close]
            residual[close] = wrap(residual[close] / cos_el) * cos_el
        return residual

    def columns(self):
        """See `gauss_newton.LinearProblem`; geometric ones at the last call of `residual`."""
        n, side = len(self.observed) // 2, self.trig.side
        for i, (name, sign) in self._turning.items():
            row, by = self._terms[i], sign if side is None else sign * side
            row[:n], row[n:] = (by * of for of in self._columns[name])
        return self.first_order


def fit_first_order(az, el, x, y, names=PHYSICAL, sx=None, sy=None, *, rcond=RCOND,
                    mount=ALTAZ):
    """Linear least-squares fit of first-order terms to on-sky offsets.

    A minimal fit, fast for many stars or many fits; `fit_terms` is the complete one.

    Parameters
    ----------
    az, el : ndarray, shape (n,)
        Catalogue place, radians.
    x, y : ndarray, shape (n,)
        Encoder - catalogue on the sky, radians; finite.
    names : sequence of str, length k
        Terms to fit.
    sx, sy : ndarray, shape (n,), optional
        1-sigma noise of x and y, radians. Without them all rows have the same weight and the
        covariance is scaled by the measured scatter of each axis.
    rcond : float
        Relative singular value below which a direction is dropped.
    mount : Mount, optional
        Mount whose axes `az` and `el` refer to.

    Returns
    -------
    Estimate
        Radians.

    Raises
    ------
    ValueError
        Too few rows, an unknown term, or only one of `sx` and `sy`.
    """
    if (sx is None) != (sy is None):
        raise ValueError('a sigma of one axis only; give sx and sy, or none')
    sigmas = None if sx is None else np.concatenate(np.broadcast_arrays(sx, sy))
    design = stacked_design(names, np.asarray(az), np.asarray(el), mount)
    return gauss_newton(LinearProblem(np.concatenate((x, y)), design), sigmas, None, rcond)


def fit_terms(run, names=None, *, held=None, robust=True, geometry=None, encoder='enc',
              zero=NO_ZERO, run_zeros=False, rcond=RCOND, provenance=None, **solver):
    """Fit pointing terms to a run.

    Gauss-Newton: the geometric terms act as exact rotations (`pointing_model.geometry`) and are
    linearised only inside the iteration; all other terms are linear.

    Parameters
    ----------
    run : PointingRun
        The columns ``sigma_x`` and ``sigma_y`` weight the rows if both exist; else all have the
        same weight. If an axis scatters significantly more than its sigmas, these are multiplied
        by the ratio. Rows with values that are not finite are excluded and listed.
    names : sequence of str, optional
        Terms to fit, of `pointing_terms.terms_of` the run's mount; by default its physical ones.
    held : PointingModel, or dict of str to float, optional
        Held fixed: a complete model (terms, harmonics, effects), or values of terms, radians. It
        becomes part of the resulting model, with its own covariance (none for a dict); the effect
        of its errors on the fitted terms is ignored. For a term in both, the model has the sum with
        the covariance of this fit, and `FitResult.coefficients` the amount added.
    robust : bool
        Downweight rows far from the fit: Huber to find the noise of each axis (median absolute
        residual), then Tukey's bisquare of the radial distance at that noise.
    geometry : {'rotation', 'first_order'}, optional
        Exact rotations, or first-order columns throughout; by default that of `held`, or
        rotations.
    encoder : {'enc', 'abs'}
        The encoder columns to fit.
    zero : PowerOnZero or Zeros
        Subtracted from the encoder's angles.
    run_zeros : bool
        Also fit the zero of each run (column ``run``) relative to that of the first, see
        `FitResult.zeros`.
    rcond : float
        Relative singular value below which a direction is dropped and reported.
    provenance : dict, optional
        Entries added to the provenance of the model.
    **solver
        See `gauss_newton.gauss_newton`.

    Returns
    -------
    FitResult

    Raises
    ------
    ValueError
        Too few usable rows, an unknown term, geometry or encoder, or no convergence.
    """
    mount = run.mount
    names = mount.names.physical if names is None else tuple(names)
    if not names:
        raise ValueError('no term to fit; name at least one, for instance '
                         f'{mount.names.index[0]}')
    base = held if isinstance(held, PointingModel) else PointingModel(
        held or {}, geometry=geometry or 'rotation', mount=mount)
    if geometry not in (None, base.geometry):
        base = replace(base, geometry=geometry)
    linear = base.geometry == 'first_order' or not _turning(names, mount)
    used = usable(run, encoder, zero)
    turned = {}
    if held is not None:
        if not linear:
            turned = {n: v for n, v in base.terms.items() if n in mount.names.terms}
        used = _beyond(base, turned, used, run, encoder)
    trig = Trig(used.az, used.el, mount)
    x = (used.az_enc - used.az) * trig.cos_el
    observed = np.concatenate((x if trig.side is None else x * trig.side, used.el_enc - used.el))
    terms, columns = names, stacked_design(names, used.az, used.el, mount, trig)
    design, runs, names_of_zeros = _with_zeros(columns, run, used, run_zeros)
    names = terms + names_of_zeros
    zeros_of_axes = [i for i, name in enumerate(names) if name.split('[')[0] in mount.names.index]
    problem = LinearProblem(observed, design) if linear else RotationProblem(
        trig, terms, turned, observed, columns, design, mount)
    found = gauss_newton(problem, used.sigmas, LOSS if robust else None, rcond,
                         used.mild_sigmas, zeros_of_axes, **solver)
    used = used.with_ratios(found.ratios)
    facts = {'method': 'terms', 'encoder': encoder, 'rcond': rcond}
    if held is not None:
        facts['held'] = base.provenance.get('source') or ', '.join(base.terms)
    if run_zeros:
        zero = _fitted_zeros(zero, runs, found, len(terms))
    model = _on_top(base, terms, found.coefficients, found.covariance)
    return make_result(run, names, used, found, model, zero, {**facts, **(provenance or {})})


def _with_zeros(columns, run, used, run_zeros):
    """The design with zeros of later runs relative to the first; the runs; names of the zeros."""
    runs = np.unique(run['run'][used.rows]) if run_zeros else np.empty(0)
    names = tuple(f'{axis}[{number:g}]' for number in runs[1:] for axis in run.mount.names.index)
    if names and 2 * len(used.rows) < len(columns) + len(names):
        raise ValueError(f'{len(used.rows)} usable observations do not determine {len(columns)} '
                         f'coefficients and the zeros of {len(runs)} power-ons; observe more stars '
                         'in one power-on')
    if names:
        columns = GroupColumns.of_runs(columns, run['run'][used.rows], np.cos(used.el))
    return columns, runs, names


def _fitted_zeros(zero, runs, found, first):
    """Zeros of the runs: the subtracted one plus the coefficients fitted from index `first` on."""
    out = []
    for place, number in enumerate(runs.tolist()):
        before = zero[number] if isinstance(zero, Zeros) else zero
        at = slice(first + 2 * place - 2, first + 2 * place)
        change, covariance = (found.coefficients[at], found.covariance[at, at]) if place else (
            np.zeros(2), None)
        az, el = (before.angles + change).tolist()
        out.append(PowerOnZero(az, el, covariance, number))
    return Zeros(out)


def _beyond(held, turned, used, run, encoder):
    """Rows with a held model, without its terms `turned`, subtracted from the encoder angles."""
    known = replace(held, terms={n: v for n, v in held.terms.items() if n not in turned},
                    covariance=None)
    context = Context.from_run(run, encoder) if known.effects else None
    x, y = (v[used.rows] for v in known.offsets(run['az'], run['el'], context))
    left = (used.az_enc - used.az) * np.cos(used.el) - x
    return used._replace(
        az_enc=used.az + left / np.cos(used.el), el_enc=used.el + (used.el_enc - used.el - y),
    ).only(np.isfinite(left) & np.isfinite(y), UNREACHABLE)


def _on_top(held, terms, p, covariance):
    """The held model with the fitted terms added."""
    k = len(terms)
    rest = {name: getattr(held, name) for name in ('harmonics', 'geometry', 'effects', 'mount')}
    if not held.terms:
        return PointingModel(dict(zip(terms, p[:k].tolist())), covariance[:k, :k], **rest)
    values = dict(held.terms)
    values.update({name: values[name] + v if name in values else v
                   for name, v in zip(terms, p[:k].tolist())})
    names = list(values)
    joint = np.zeros((len(names), len(names)))
    joint[:len(held.terms), :len(held.terms)] = held.covariance
    places = [names.index(name) for name in terms]
    joint[places], joint[:, places] = 0.0, 0.0
    joint[np.ix_(places, places)] = covariance[:k, :k]
    return PointingModel(values, joint, **rest)


def fit_harmonics(run, interpretation='zenith', *, degree=DEGREE, held=None, after=None,
                  zero=NO_ZERO, run_zeros=False, encoder='enc', robust=True,
                  rcond=RCOND_HARMONICS):
    """Fit the 13 spherical harmonics per axis of paper 000 (eq. 6-8).

    Both interpretations are fitted by least squares of the error on the sky, so that their
    residuals can be compared; f_A = delta-A sin E of the printed one is weighted accordingly.

    Parameters
    ----------
    run : PointingRun
    interpretation : {'zenith', 'printed'}
        Meaning of the paper's E (see `pointing_model.harmonics`).
    degree : int
        Degree of the series, with 4, 7, 10 or 13 coefficients per axis.
    held : PointingModel, optional
        Fit the residuals of this model (physical terms first); the result has its terms and
        effects.
    after : FitResult, optional
        Instead of `held`: fit the residuals of this fit of terms to the same rows. The covariance
        then excludes the part of the noise that the terms have absorbed, so that the prediction
        error of the model is that of terms and harmonics together.
    zero : PowerOnZero or Zeros
        Subtracted from the encoder's angles.
    run_zeros : bool
        See `fit_terms`.
    encoder : {'enc', 'abs'}
        The encoder columns to fit.
    robust : bool
        See `fit_terms`.
    rcond : float
        Relative singular value below which a direction is dropped and reported: with few stars
        the series is ill-conditioned.

    Returns
    -------
    FitResult
        ``names`` begin with A0..A12, B0..B12, or as many as the degree has; ``model`` is `held`
        with the harmonics added.

    Raises
    ------
    ValueError
        Too few usable rows, unknown interpretation or degree, `held` has harmonics, or the mount
        is no alt-azimuth one.
    """
    if not run.mount.vertical:
        raise ValueError('the harmonics are functions of azimuth and elevation, of alt-azimuth '
                         f'mounts; this one is {run.mount.kind}: leave them out')
    held = held if after is None else after.model
    if held is not None and held.harmonics is not None:
        raise ValueError('the model has harmonics already; fit them to its terms alone')
    names = names_of(degree)
    k = len(names)
    used = usable(run, encoder, zero)
    if held is not None:
        context = Context.from_run(run, encoder) if held.effects else None
        at = np.stack(held.sky_to_encoder(run['az'], run['el'], context))
        used = used.only(np.isfinite(at[:, used.rows]).all(axis=0), UNREACHABLE)
        at_az, at_el = at[:, used.rows]
    else:
        at_az, at_el = used.az, used.el
    az, el = used.az, used.el
    observed = np.concatenate((wrap(used.az_enc - at_az) * np.cos(el), used.el_enc - at_el))
    columns = columns_of(degree, az, el, interpretation).reshape(k, -1)
    design, runs, names_of_zeros = _with_zeros(columns, run, used, run_zeros)
    found = gauss_newton(LinearProblem(observed, design), used.sigmas, LOSS if robust else None,
                         rcond, used.mild_sigmas)
    used = used.with_ratios(found.ratios)
    covariance = found.covariance[:k, :k]
    if after is not None:
        weights = found.weights if used.sigmas is None else (
            found.weights / np.square(used.sigmas.reshape(2, -1)))
        covariance = _without_taken(covariance, np.asarray(design), weights, rcond, after, run,
                                    used)
    model = replace(held or PointingModel({}, mount=run.mount), harmonics=Harmonics.from_degree(
        degree, interpretation, found.coefficients[:k], covariance))
    facts = {'method': f'harmonics, {interpretation} reading', 'degree': degree,
             'encoder': encoder, 'rcond': rcond}
    if run_zeros:
        zero = _fitted_zeros(zero, runs, found, k)
    if held is not None:
        facts['terms'] = held.provenance
    result = make_result(run, names + names_of_zeros, used, found, model, zero, facts)
    if after is not None:
        result = replace(result, covariance=result.model.harmonics.covariance_of_coefficients)
    return result


def _without_taken(covariance, rows, weights, rcond, after, run, used):
    """Covariance of harmonics fitted to the residuals of an earlier fit to the same rows.

    These residuals are orthogonal to the columns T of that fit: H+ T cov(p_T) (H+ T)' is subtracted
    from (H+ H+') sigma^2, and the harmonics are independent of its coefficients.
    """
    terms = tuple(name for name in after.names if '[' not in name)
    taken = stacked_design(terms, used.az, used.el, run.mount)
    if len(after.names) > len(terms):
        taken = np.asarray(GroupColumns.of_runs(taken, run['run'][used.rows], np.cos(used.el)))
    weights = np.broadcast_to(weights, (2, len(used.rows))).ravel()
    inverse = weighted_solve(rows, rows[0], weights, rcond).inverse
    onto = (inverse @ (rows * weights) @ taken.T)[:len(covariance)]
    left = covariance - onto @ after.covariance @ onto.T
    # both noises are estimated, so their difference may leave negative eigenvalues along T
    values, vectors = np.linalg.eigh(0.5 * (left + left.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def rotation_start(obs, terms):
    """Starting values of the exact rotations, and their residuals.

    Parameters
    ----------
    obs : Observations
    terms : sequence of str
        Terms of the declared model.

    Returns
    -------
    start : dict of str to float
        Coefficients of the geometric terms, radians.
    left : ndarray, shape (2n,)
        Radians.
    feasible : ndarray of bool, shape (n,)
    """
    names = obs.run.mount.names
    geometric = tuple(t for t in terms if t in names.terms)
    start, left = dict.fromkeys(geometric, 0.0), obs.observed
    if not geometric:
        return start, left, np.ones(len(obs), bool)
    try:
        fit = _rotations(obs, geometric)
    except ValueError:
        # the directions do not determine the rotations: start from the index terms alone
        obs.notes.append(Finding('undetermined base'))
        geometric = tuple(t for t in names.index if t in geometric)
        if not geometric:
            return start, left, np.ones(len(obs), bool)
        fit = _rotations(obs, geometric)
    start.update(zip(geometric, fit.coefficients.tolist()))
    feasible = np.isfinite(fit.residual.reshape(2, -1)).all(axis=0)
    return start, np.where(np.tile(feasible, 2), fit.residual, left), feasible


def _rotations(obs, terms):
    """`Estimate` of geometric terms alone, as exact rotations."""
    context, mount = obs.context, obs.context.mount
    trig = Trig(context.az, context.el, mount)
    columns = stacked_design(terms, context.az, context.el, mount, trig)
    problem = LinearProblem(obs.observed, columns) if not _turning(terms, mount) else (
        RotationProblem(trig, terms, {}, obs.observed, columns, columns, mount))
    sigmas = None if obs.inverse_sigma is None else 1.0 / obs.inverse_sigma
    return gauss_newton(problem, sigmas, LOSS, RCOND, mild_sigmas(sigmas),
                        [i for i, t in enumerate(terms) if t in mount.names.index])


def after_rotation(obs, start):
    """Offsets less the exact rotations, shape (2n,), and mask of rows that the mount can reach."""
    x, y = geometry.offsets(obs.context.az, obs.context.el, start, obs.context.mount)
    feasible = np.isfinite(x) & np.isfinite(y)
    return obs.observed - np.nan_to_num(np.hstack((x, y))), feasible
