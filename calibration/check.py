"""External check: fit on half of the stars, judge on the others (paper 000)."""

from typing import NamedTuple

import numpy as np

from pointing_model.rms import Rms, rms_arcsec

from .fit import fit_terms


class ExternalCheck(NamedTuple):
    """Residuals of a fit on the stars that it used and on those that it did not.

    Attributes
    ----------
    fitted, held_out : Rms
        arcsec on the sky, all rows of the half, robustly rejected ones included.
    used : ndarray of bool, shape (n,)
        The rows of the (first) fit.
    fits : tuple of FitResult
        One, or two if it was done both ways.
    """

    fitted: Rms
    held_out: Rms
    used: np.ndarray
    fits: tuple


def split_half(run, seed=0):
    """Choose half of the rows, spread over the sky like the whole.

    Within each night (column ``run``, if present) the rows are sorted into bands of equal number
    in elevation and by azimuth within a band; of each pair of neighbours a coin takes one.

    Parameters
    ----------
    run : PointingRun
    seed : int

    Returns
    -------
    ndarray of bool, shape (n,)
        The rows to fit; the others are the check. Of an odd number the coin decides who gets
        the odd row.

    Raises
    ------
    ValueError
        Fewer than two rows.
    """
    n = len(run)
    if n < 2:
        raise ValueError(f'{n} observations cannot be split in halves; observe more')
    rng = np.random.default_rng(seed)
    night = np.asarray(run['run']) if 'run' in run else np.zeros(n)
    used = np.zeros(n, bool)
    odd = rng.integers(2)  # alternates, so that odd nights do not all favour one half
    for number in np.unique(night):
        rows = np.flatnonzero(night == number)
        bands = max(1, round(np.sqrt(len(rows) / 4.0)))
        order = rows[np.argsort(run['el'][rows], kind='stable')]
        az = np.mod(run['az'], 2.0 * np.pi)
        # every band but the last has an even number, so that no pair straddles two
        size = 2 * int(np.ceil(len(rows) / bands / 2.0))
        sequence = np.concatenate([
            band[np.argsort(az[band], kind='stable')]
            for band in (order[i:i + size] for i in range(0, len(order), size))])
        pairs = len(sequence) // 2
        coin = rng.integers(2, size=pairs)
        used[sequence[2 * np.arange(pairs) + coin]] = True
        if len(sequence) % 2:
            used[sequence[-1]] = bool(odd)
            odd = 1 - odd
    return used


def _judge(run, used, fit, options):
    result = fit(run.select(used), **options)
    keep = {name: options[name] for name in ('encoder', 'zero') if name in options}
    x, y = result.model.residuals(run.select(~used), **keep)
    return result, rms_arcsec(x, y)


def _mean_square(parts):
    """Rms of two folds together, weighted by their rows."""
    n = sum(p.n for p in parts)

    def mean(name):
        return float(np.sqrt(sum(p.n * getattr(p, name) ** 2 for p in parts) / n))

    return Rms(mean('x'), mean('y'), mean('radial'), n)


def external_check(run, *, seed=0, used=None, both_ways=False, fit=fit_terms, **options):
    """Fit on one half of a run and judge on the other.

    Parameters
    ----------
    run : PointingRun
    seed : int
        Of `split_half`, unless `used` is given.
    used : ndarray of bool, shape (n,), optional
        The rows to fit.
    both_ways : bool
        Fit each half and judge on the other; every row is then held out once and the RMS are
        over both.
    fit : callable
        ``fit(run, **options) -> FitResult``, for instance `fit_terms` or `fit_harmonics`.
    options
        For `fit`. A ``zero`` must hold for any row (a pair of numbers, or a dict by run).

    Returns
    -------
    ExternalCheck

    Raises
    ------
    ValueError
        A half has no row, or too few for the fit.
    """
    used = split_half(run, seed) if used is None else np.asarray(used, bool)
    if used.shape != (len(run),) or used.all() or not used.any():
        raise ValueError('external check needs rows to fit and rows to judge; change `used`')
    folds = [_judge(run, rows, fit, options) for rows in ([used, ~used] if both_ways else [used])]
    fitted = [result.rms_arcsec() for result, _ in folds]
    held_out = [rms for _, rms in folds]
    return ExternalCheck(
        _mean_square(fitted), _mean_square(held_out), used, tuple(r for r, _ in folds))
