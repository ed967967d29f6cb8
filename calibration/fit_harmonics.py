"""Fit of the spherical harmonics of paper 000, alone or on what the terms leave."""

from dataclasses import replace

import numpy as np

from msg_tools.units import wrap
from pointing_model.context import Context
from pointing_model.harmonics import COUNT, Harmonics, basis, sky_factor
from pointing_model.model import PointingModel
from pointing_model.zero import NO_ZERO

from .fit_result import make_result
from .gauss_newton import gauss_newton, need_rows
from .rows import UNREACHABLE, usable

#: As `fit.RCOND`, for the harmonics. The functions themselves have 1.8e-4 (200 stars above 20
#: degrees), 30 stars 0.5e-4 to 1.7e-4: what is below is for want of stars, not of independence.
RCOND_HARMONICS = 1e-4


def fit_harmonics(run, interpretation='zenith', *, held=None, zero=NO_ZERO,
                  rcond=RCOND_HARMONICS):
    """Fit the 13 spherical harmonics an axis of paper 000 (eq. 6-8).

    Least squares of the error on the sky in both interpretations, so that their residuals
    compare; f_A = delta-A sin E of the printed one is weighted accordingly.

    Parameters
    ----------
    run : PointingRun
    interpretation : {'zenith', 'printed'}
        What the paper's E means (see `pointing_model.harmonics`).
    held : PointingModel, optional
        Fit what this model leaves (physical terms first); the result has its terms and effects.
    zero : RunZero or Zeros
        To subtract from the encoder's angles.
    rcond : float
        Relative singular value below which a direction is left out and reported: with few stars
        the series is ill-conditioned.

    Returns
    -------
    FitResult
        ``names`` are A0..A12, B0..B12; ``model`` has what `held` has, and the harmonics.

    Raises
    ------
    ValueError
        Too few usable rows, unknown interpretation, or `held` has harmonics.
    """
    if held is not None and held.harmonics is not None:
        raise ValueError('the model has harmonics already; fit them to its terms alone')
    used = usable(run, zero=zero)
    if held is not None:
        context = Context.of_run(run) if held.effects else None
        at = np.stack(held.sky_to_encoder(run['az'], run['el'], context))
        used = used.only(np.isfinite(at[:, used.rows]).all(axis=0), UNREACHABLE)
        at_az, at_el = at[:, used.rows]
    else:
        at_az, at_el = used.az, used.el
    az, el, sigmas = used.az, used.el, used.sigmas
    n = len(used.rows)
    need_rows(n, 2 * COUNT, sigmas is not None)
    observed = np.concatenate((wrap(used.az_enc - at_az) * np.cos(el), used.el_enc - at_el))
    functions = basis(az, el, interpretation).T
    rows = np.zeros((2 * COUNT, 2 * n))
    rows[:COUNT, :n] = functions * sky_factor(el, interpretation)
    rows[COUNT:, n:] = functions
    names = [f'A{i}' for i in range(COUNT)] + [f'B{i}' for i in range(COUNT)]
    base = None if sigmas is None else 1.0 / np.square(sigmas)
    everywhere = np.ones(n, bool)
    solved = gauss_newton(lambda p: (observed, rows, everywhere), rows, base,
                          4 * n >= 3 * len(names), rcond, linear=True)

    def make_model(p, covariance, facts):
        harmonics = Harmonics(interpretation, p[:COUNT], p[COUNT:], covariance)
        if held is None:
            return PointingModel({}, None, harmonics, facts)
        facts = {**facts, 'terms': held.provenance}
        return replace(held, harmonics=harmonics, provenance=facts)

    return make_result(run, names, used, solved, make_model, None, {
        'method': f'harmonics, {interpretation} reading', 'encoder': 'enc', 'rcond': rcond})
