"""The declared terms that the stars do not determine: held, and said, before anything is judged."""

from dataclasses import replace

import numpy as np

from calibration.analysis.fit import fit_terms
from calibration.estimation.degeneracy import undetermined_lines

#: rows that tell what all of many determine
_ROWS = 20000


def determined(obs, base):
    """The base without the terms that the stars do not determine and that are held at zero.

    Parameters
    ----------
    obs : Observations
    base : Base

    Returns
    -------
    base : Base
    fit : FitResult or None
        That says so; None where nothing is undetermined.
    """
    if base.degree or not base.terms:
        return base, None
    run = obs.run.select(slice(None, None, len(obs) // _ROWS + 1))
    try:
        fit = fit_terms(run, base.terms, encoder=obs.encoder, run_zeros=bool(base.own))
    except ValueError:  # whoever fits them says why
        return base, None
    if not fit.undetermined:
        return base, None
    held = fit.model.held
    return replace(base, terms=tuple(t for t in base.terms if t not in held),
                   own=tuple(t for t in base.own if t not in held)), fit


def said(result, fit):
    """A `Diagnosis` whose models have the held terms, and know which are undetermined."""
    for attribute in ('model', 'base_model'):
        model = getattr(result, attribute)
        terms = model.terms | {t: 0.0 for t in fit.model.terms if t not in model.terms}
        covariance = np.zeros((len(terms),) * 2)
        covariance[:len(model.terms), :len(model.terms)] = model.covariance
        setattr(result, attribute, replace(
            model, terms=terms, covariance=covariance, undetermined=fit.model.undetermined,
            directions=fit.model.directions))
    result.notes += undetermined_lines(fit)
    return result
