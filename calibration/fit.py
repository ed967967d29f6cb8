"""Least-squares fits of the pointing model: physical terms as rotations, and harmonics."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model import geometry as rotation
from pointing_model.harmonics import COUNT, Harmonics, basis, sky_factor
from pointing_model.model import PointingModel
from pointing_model.terms import PHYSICAL, known_terms, stacked_design
from pointing_model.zero import NO_ZERO, RunZero, Zeros

from .least_squares import (
    TOLERANCE,
    Solution,
    Spectrum,
    covariance_of,
    normal_matrices,
    robust_solve,
    spectrum_of,
    weighted_solve,
)

#: Directions in the space of the (column-scaled) coefficients whose singular value is below this
#: part of the largest are not determined by the stars, and left out.
RCOND = 1e-5
RCOND_HARMONICS = 1e-4

_INNER = 0.01  # of rcond, within the directions kept


class Rms(NamedTuple):
    """Root mean squares on the sky, arcsec, and the number of rows they are of."""

    x: float
    y: float
    radial: float
    n: int


def rms_arcsec(x, y):
    """RMS per axis and radial of on-sky offsets.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Radians; rows that are not finite are left out.

    Returns
    -------
    Rms
        arcsec.
    """
    good = np.isfinite(x) & np.isfinite(y)
    n = int(np.count_nonzero(good))
    if n == 0:
        return Rms(np.nan, np.nan, np.nan, 0)
    xx = float(np.mean(np.square(x[good]))) / ARCSEC**2
    yy = float(np.mean(np.square(y[good]))) / ARCSEC**2
    return Rms(xx**0.5, yy**0.5, (xx + yy) ** 0.5, n)


def _dropped(spectrum, rank, names, basis=None):
    """Directions that the data do not determine, in words."""
    out = []
    for i in range(len(spectrum.s) - rank):
        row = spectrum.vectors[:, i] / spectrum.scale
        if basis is not None:
            row = basis @ row
        row = row / row[np.argmax(np.abs(row))]
        main = [(name, float(v)) for name, v in zip(names, row) if abs(v) >= 0.1]
        main.sort(key=lambda pair: -abs(pair[1]))
        out.append({
            'text': ' '.join(f'{v:+.2f} {name}' for name, v in main),
            'direction': dict(main),
            'relative_singular_value': float(spectrum.s[i] / spectrum.s[-1]),
        })
    return out


class LinearFit(NamedTuple):
    """Result of `fit_first_order`; radians."""

    coefficients: np.ndarray
    covariance: np.ndarray
    residual_x: np.ndarray
    residual_y: np.ndarray
    rank: int


def _need_rows(n, k, given):
    # with given sigmas the covariance needs no redundancy
    if 2 * n < k or (2 * n == k and not given) or n == 0:
        raise ValueError(
            f'{n} usable observations do not determine {k} coefficients; observe at least '
            f'{k // 2 + 1} stars or fit fewer terms')


def fit_first_order(az, el, x, y, names=PHYSICAL, sx=None, sy=None, *, rcond=RCOND):
    """Linear least-squares fit of first-order terms to on-sky offsets.

    The bare fit, for many stars or many fits; `fit_terms` is the one with everything.

    Parameters
    ----------
    az, el : ndarray, shape (n,)
        Catalogue place, radians.
    x, y : ndarray, shape (n,)
        Encoder - catalogue on the sky, radians; finite.
    names : sequence of str, length k
        Terms to fit.
    sx, sy : ndarray, shape (n,), optional
        1-sigma noise of x and y, radians. Without them all rows weigh the same and the
        covariance is scaled by the measured scatter of each axis.
    rcond : float
        Relative singular value below which a direction is left out.

    Returns
    -------
    LinearFit

    Raises
    ------
    ValueError
        Too few rows, an unknown term, or only one of `sx` and `sy`.
    """
    n = len(az)
    _need_rows(n, len(names), sx is not None)
    if (sx is None) != (sy is None):
        raise ValueError('a sigma of one axis only; give sx and sy, or none')
    rows = stacked_design(names, np.asarray(az), np.asarray(el))
    b = np.concatenate((x, y))
    base = None
    if sx is not None:
        sigma = np.empty(2 * n)
        sigma[:n], sigma[n:] = sx, sy
        base = 1.0 / np.square(sigma)
    solution = weighted_solve(rows, b, base, rcond)
    covariance, _ = covariance_of(solution, base, None, base is not None)
    r = solution.residual
    return LinearFit(solution.p, covariance, r[:n], r[n:], solution.rank)


@dataclass(frozen=True)
class FitResult:
    """A fitted model and how good it is.

    Attributes
    ----------
    model : PointingModel
        What was fitted (on top of the model it was fitted on).
    names : tuple of str, length k
        The fitted coefficients.
    coefficients : ndarray, shape (k,)
        Radians.
    covariance : ndarray, shape (k, k)
        Radians^2. Directions in `dropped` are not in it: there the coefficients are those of the
        smallest norm, and only predictions among the observed stars have a meaning.
    covariance_from : {'given sigmas', 'measured scatter'}
        What the covariance is scaled by.
    scatter : tuple of float
        Noise of x and y, radians (per axis, with the degrees of freedom that the fit took).
    rank : int
    singular_values : ndarray, shape (k,)
        Of the first-order design, weighted by the sigmas, with columns of unit length,
        descending.
    dropped : list of dict
        Directions below `rcond`: ``text`` with the main terms, ``direction``,
        ``relative_singular_value``.
    residual_x, residual_y : ndarray, shape (n,)
        On the sky, radians, a row of the run each; NaN in excluded rows.
    weights : ndarray, shape (n,)
        Robust weight of each row, 0 (rejected or excluded) to 1.
    excluded : list of dict
        ``row`` and ``reason`` of the rows that could not be used.
    robust : bool
        Whether rows were downweighted (never with fewer than 1.5 values a coefficient).
    iterations : int
    run_zeros : Zeros, optional
        By how much the zero of each run lies above that of the first.
    """

    model: PointingModel
    names: tuple
    coefficients: np.ndarray
    covariance: np.ndarray
    covariance_from: str
    scatter: tuple
    rank: int
    singular_values: np.ndarray
    dropped: list
    residual_x: np.ndarray
    residual_y: np.ndarray
    weights: np.ndarray
    excluded: list
    robust: bool
    iterations: int
    run_zeros: Zeros | None = None

    @property
    def sigma(self):
        """Standard errors of the coefficients, radians, shape (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def correlations(self):
        """Correlation matrix of the coefficients, shape (k, k)."""
        sigma = self.sigma
        sigma = np.where(sigma > 0.0, sigma, 1.0)
        return self.covariance / np.outer(sigma, sigma)

    @property
    def condition(self):
        """Condition number of the design with columns of unit length."""
        smallest = self.singular_values[-1]
        return float(self.singular_values[0] / smallest) if smallest > 0.0 else np.inf

    @property
    def rejected(self):
        """Indices of the rows that the robust fit gave no weight, without the excluded ones."""
        return np.flatnonzero((self.weights == 0.0) & np.isfinite(self.residual_x))

    def rms_arcsec(self, rejected=True):
        """RMS of the residuals on the fitted rows.

        Parameters
        ----------
        rejected : bool
            Whether rows that the robust fit rejected are in it.

        Returns
        -------
        Rms
            arcsec on the sky; `n` is the number of rows.
        """
        keep = slice(None) if rejected else self.weights > 0.0
        return rms_arcsec(self.residual_x[keep], self.residual_y[keep])


def _usable(run, encoder, zero):
    """Finite rows with their offsets.

    Returns
    -------
    rows : ndarray of int, shape (m,)
    az, el, az_enc, el_enc : ndarray, shape (m,)
    sigmas : ndarray, shape (2m,), or None
    excluded : list of dict
    """
    columns = {name: np.asarray(run[name], float)
               for name in ('az', 'el', f'az_{encoder}', f'el_{encoder}')}
    zero_az, zero_el = zero.of_rows(run)
    columns[f'az_{encoder}'] = columns[f'az_{encoder}'] - zero_az
    columns[f'el_{encoder}'] = columns[f'el_{encoder}'] - zero_el
    sigmas = None
    if 'sigma_x' in run and 'sigma_y' in run:
        sigmas = [np.asarray(run[name], float) for name in ('sigma_x', 'sigma_y')]
        if all(np.isnan(s).all() for s in sigmas):
            sigmas = None
    good = np.ones(len(run), bool)
    for value in columns.values():
        good &= np.isfinite(value)
    if sigmas is not None:
        for value in sigmas:
            good &= np.isfinite(value) & (value > 0.0)
    excluded = []
    for row in np.flatnonzero(~good):
        bad = [name for name, v in columns.items() if not np.isfinite(v[row])]
        reason = f'{", ".join(bad)} not finite' if bad else 'sigma not finite and positive'
        excluded.append({'row': int(row), 'reason': reason})
    rows = np.flatnonzero(good)
    keep = rows if excluded else slice(None)
    if sigmas is not None:
        sigmas = np.concatenate([s[keep] for s in sigmas])
    return rows, [v[keep] for v in columns.values()], sigmas, excluded


def _check_encoder(run, encoder):
    if encoder not in ('enc', 'abs'):
        raise ValueError(f'unknown encoder {encoder!r}; take enc or abs')
    for name in (f'az_{encoder}', f'el_{encoder}'):
        if name not in run:
            raise ValueError(f'pointing run without column {name}; fit the other encoder')


class _Solved(NamedTuple):
    p: np.ndarray
    solution: Solution  # in the coordinates of `basis`
    rows: np.ndarray
    basis: np.ndarray | None  # directions kept, (k, r); None if all are
    spectrum: Spectrum  # of the first-order design
    base: np.ndarray | None
    row_weights: np.ndarray | None
    feasible: np.ndarray
    iterations: int


def _gauss_newton(start, first_order, base, robust, rcond, linear):
    """Iterate `start(p) -> (residual, rows, feasible)` to the (robust) least-squares solution.

    What the stars determine is decided once, by the first-order design: in the second order
    aliases differ a little, and the iteration would run away along them.
    """
    normals = normal_matrices(first_order, first_order if base is None else first_order * base)
    spectrum = spectrum_of(first_order, base, normals[1])
    rank = spectrum.rank(rcond)
    k = len(first_order)
    basis = None if rank == k else spectrum.vectors[:, -rank:] / spectrum.scale[:, None]
    p = np.zeros(k)
    scales = row_weights = None
    for iteration in range(1, 31):
        residual, rows, feasible = start(p)
        if basis is not None:
            rows = basis.T @ rows
        weights = base
        if not feasible.any():
            raise ValueError(
                'the fit runs to a mount that can point nowhere; look for rows with degrees of '
                'error or fit fewer terms')
        if not feasible.all():
            both = np.concatenate((feasible, feasible)).astype(float)
            weights = both if base is None else base * both
        if robust:
            if iteration <= 2:
                scales = None  # the linearisation at zero can be seconds of arc off
            solution, scales, row_weights = robust_solve(
                rows, residual, weights, _INNER * rcond, scales, row_weights)
        else:
            known = rows is first_order and weights is base
            solution = weighted_solve(
                rows, residual, weights, _INNER * rcond, normals if known else None)
        p = p + (solution.p if basis is None else basis @ solution.p)
        if linear:
            break
        if np.abs(solution.residual - residual).max() < TOLERANCE and (
                not robust or iteration > 2):
            break
    else:
        raise ValueError(
            'the fit does not converge; look for rows with degrees of error or fit fewer terms')
    return _Solved(p, solution, rows, basis, spectrum, weights, row_weights, feasible, iteration)


def _result(run, names, rows_used, excluded, sigmas, solved, make_model, provenance, notes):
    solution, basis, feasible = solved.solution, solved.basis, solved.feasible
    row_weights = solved.row_weights
    if row_weights is not None:
        row_weights = row_weights * feasible
    covariance, scatter = covariance_of(
        solution, solved.base, row_weights, sigmas is not None, int(np.sum(~feasible)))
    if basis is not None:
        covariance = basis @ covariance @ basis.T
    n = len(rows_used)
    r = solution.residual
    residual_x, residual_y, w = (np.full(len(run), v) for v in (np.nan, np.nan, 0.0))
    residual_x[rows_used], residual_y[rows_used] = r[:n], r[n:]
    w[rows_used] = 1.0 if row_weights is None else row_weights
    if not feasible.all():
        lost = rows_used[~feasible]
        residual_x[lost], residual_y[lost], w[lost] = np.nan, np.nan, 0.0
        excluded = excluded + [
            {'row': int(i), 'reason': 'nearer to the zenith than the collimation lets the mount '
                                      'look'} for i in lost]
        excluded.sort(key=lambda e: e['row'])
    if sigmas is not None:
        x_unit, y_unit = (float(np.sqrt(np.mean(s**2))) for s in (sigmas[:n], sigmas[n:]))
        scatter = scatter[0] * x_unit, scatter[1] * y_unit
    dropped = _dropped(solved.spectrum, len(solution.p), names)
    if solution.rank < len(solution.p):  # the robust weights took the stars that determine it
        both = np.concatenate((row_weights, row_weights))
        both = both if solved.base is None else both * solved.base
        dropped += _dropped(
            spectrum_of(solved.rows, both, solution.normal), solution.rank, names, basis)
    rms = rms_arcsec(residual_x, residual_y)
    covariance_from = 'measured scatter' if sigmas is None else 'given sigmas'
    facts = {
        **notes,
        'source': run.meta.get('source'),
        'rows': rms.n,
        'rows_excluded': len(excluded),
        'robust': row_weights is not None,
        'covariance_from': covariance_from,
        'rank': solution.rank,
        'fitted_rms_arcsec': {'x': rms.x, 'y': rms.y, 'radial': rms.radial},
        **(provenance or {}),
    }
    return FitResult(
        model=make_model(solved.p, covariance, facts), names=tuple(names),
        coefficients=solved.p, covariance=covariance, covariance_from=covariance_from,
        scatter=scatter, rank=solution.rank, singular_values=solved.spectrum.s[::-1],
        dropped=dropped, residual_x=residual_x, residual_y=residual_y, weights=w,
        excluded=excluded, robust=row_weights is not None, iterations=solved.iterations)


def fit_terms(run, names=PHYSICAL, *, robust=True, geometry='rotation', encoder='enc',
              zero=NO_ZERO, run_zeros=False, rcond=RCOND, provenance=None):
    """Fit pointing terms to a run.

    Gauss-Newton: the geometric terms act as exact rotations (`pointing_model.geometry`) and are
    linearised only inside the iteration; all other terms are linear.

    Parameters
    ----------
    run : PointingRun
        The columns ``sigma_x`` and ``sigma_y`` weigh the rows if both are there; else all weigh
        the same. Rows with values that are not finite are left out and listed.
    names : sequence of str
        Terms to fit, of `terms.TERMS`.
    robust : bool
        Downweight rows far from the fit: Huber to find the noise of each axis (median absolute
        residual), then Tukey's bisquare of the radial distance at that noise.
    geometry : {'rotation', 'first_order'}
        Exact rotations, or first-order columns throughout.
    encoder : {'enc', 'abs'}
        The encoder columns to fit.
    zero : RunZero or Zeros
        To subtract from the encoder's angles.
    run_zeros : bool
        Fit with the terms how far the zero of each run (column ``run``) lies from that of the
        first: `FitResult.run_zeros`.
    rcond : float
        Relative singular value below which a direction is left out and reported.
    provenance : dict, optional
        Kept in the model beside what the fit itself writes.

    Returns
    -------
    FitResult

    Raises
    ------
    ValueError
        Too few usable rows, an unknown term, geometry or encoder, or no convergence.
    """
    names = tuple(names)
    known_terms(names)
    if not names:
        raise ValueError('no term to fit; name at least one, for instance IA')
    if geometry not in ('rotation', 'first_order'):
        raise ValueError(f'unknown geometry {geometry!r}; take rotation or first_order')
    _check_encoder(run, encoder)
    rows_used, (az, el, az_enc, el_enc), sigmas, excluded = _usable(run, encoder, zero)
    n = len(rows_used)
    runs = np.unique(run['run'][rows_used]) if run_zeros else ()
    terms, names = names, names + tuple(
        f'{axis}[{number:g}]' for number in runs[1:] for axis in ('IA', 'IE'))
    _need_rows(n, len(names), sigmas is not None)
    observed = np.empty(2 * n)
    observed[:n] = wrap(az_enc - az) * np.cos(el)
    observed[n:] = el_enc - el
    first_order = stacked_design(terms, az, el)
    if len(names) > len(terms):
        member = run['run'][rows_used] == runs[1:, None]
        nothing = np.zeros_like(member, float)
        zeros = np.stack((np.hstack((member * np.cos(el), nothing)), np.hstack((nothing, member))),
                         axis=1)
        first_order = np.vstack((first_order, zeros.reshape(-1, 2 * n)))
    everywhere = np.ones(n, bool)
    turned = [i for i, name in enumerate(terms) if name in rotation.GEOMETRIC]
    # IA, IE and TF alone are linear
    linear = geometry == 'first_order' or not {'CA', 'NPAE', 'AN', 'AW'} & set(terms)

    def start(p):
        if not p.any():
            return observed, first_order, everywhere
        values = {names[i]: float(p[i]) for i in turned}
        x, y, jacobian = rotation.offsets_and_jacobian(az, el, values, list(values))
        rest = p.copy()
        rest[turned] = 0.0
        residual = observed - rest @ first_order
        residual[:n] -= x
        residual[n:] -= y
        rows = first_order.copy()
        for i in turned:
            rows[i, :n], rows[i, n:] = jacobian[names[i]]
        feasible = np.isfinite(x)
        if not feasible.all():
            lost = np.concatenate((~feasible, ~feasible))
            residual[lost] = 0.0
            rows[:, lost] = 0.0
        return residual, rows, feasible

    base = None if sigmas is None else 1.0 / np.square(sigmas)
    robust = robust and 4 * n >= 3 * len(names)
    solved = _gauss_newton(start, first_order, base, robust, rcond, linear)

    def make_model(p, covariance, facts):
        k = len(terms)
        return PointingModel(
            dict(zip(terms, p[:k].tolist())), covariance[:k, :k], None, facts, geometry)

    result = _result(run, names, rows_used, excluded, sigmas, solved, make_model, provenance,
                   {'method': 'terms', 'encoder': encoder, 'rcond': rcond})
    if not run_zeros:
        return result
    shifts = result.coefficients[len(terms):].reshape(-1, 2)
    return replace(result, run_zeros=Zeros(
        RunZero(float(a), float(e), run=float(number))
        for number, (a, e) in zip(runs, np.vstack((np.zeros(2), shifts)))))


def fit_harmonics(run, reading='zenith', *, model=None, robust=True, encoder='enc',
                  zero=NO_ZERO, rcond=RCOND_HARMONICS, provenance=None):
    """Fit the 13 spherical harmonics an axis of paper 000 (eq. 6-8).

    Least squares of the error on the sky in both readings, so that their residuals compare; the
    printed reading's f_A = delta-A sin E is weighted accordingly.

    Parameters
    ----------
    run : PointingRun
    reading : {'zenith', 'printed'}
        What the paper's E means (see `pointing_model.harmonics`).
    model : PointingModel, optional
        Fit what this model leaves (physical terms first), and keep its terms in the result.
    robust, encoder, zero, provenance
        As in `fit_terms`.
    rcond : float
        Relative singular value below which a direction is left out and reported: with few stars
        the series is ill-conditioned.

    Returns
    -------
    FitResult
        ``names`` are A0..A12, B0..B12; ``model`` has the terms of `model` and the harmonics.

    Raises
    ------
    ValueError
        Too few usable rows, unknown reading or encoder, or `model` has harmonics already.
    """
    _check_encoder(run, encoder)
    if model is not None and model.harmonics is not None:
        raise ValueError('the model has harmonics already; fit them to its terms alone')
    rows_used, (az, el, az_enc, el_enc), sigmas, excluded = _usable(run, encoder, zero)
    if model is not None:
        at_az, at_el = model.sky_to_encoder(az, el)
        reachable = np.isfinite(at_az) & np.isfinite(at_el)
        if not reachable.all():
            excluded = sorted(
                excluded + [{'row': int(i), 'reason': 'the model cannot point there'}
                            for i in rows_used[~reachable]], key=lambda e: e['row'])
            if sigmas is not None:
                sigmas = sigmas[np.concatenate((reachable, reachable))]
            rows_used, az, el, az_enc, el_enc, at_az, at_el = (
                v[reachable] for v in (rows_used, az, el, az_enc, el_enc, at_az, at_el))
    else:
        at_az, at_el = az, el
    n = len(rows_used)
    _need_rows(n, 2 * COUNT, sigmas is not None)
    observed = np.concatenate((wrap(az_enc - at_az) * np.cos(el), el_enc - at_el))
    functions = basis(az, el, reading).T
    rows = np.zeros((2 * COUNT, 2 * n))
    rows[:COUNT, :n] = functions * sky_factor(el, reading)
    rows[COUNT:, n:] = functions
    names = [f'A{i}' for i in range(COUNT)] + [f'B{i}' for i in range(COUNT)]
    base = None if sigmas is None else 1.0 / np.square(sigmas)
    robust = robust and 4 * n >= 3 * len(names)
    everywhere = np.ones(n, bool)
    solved = _gauss_newton(lambda p: (observed, rows, everywhere), rows, base, robust, rcond,
                           linear=True)

    def make_model(p, covariance, facts):
        harmonics = Harmonics(reading, p[:COUNT], p[COUNT:], covariance)
        if model is None:
            return PointingModel({}, None, harmonics, facts)
        facts = {**facts, 'terms': model.provenance}
        return PointingModel(model.terms, model.covariance, harmonics, facts, model.geometry)

    return _result(run, names, rows_used, excluded, sigmas, solved, make_model, provenance,
                   {'method': f'harmonics, {reading} reading', 'encoder': encoder,
                    'rcond': rcond})
