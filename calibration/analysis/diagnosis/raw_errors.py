"""What the errors are as the encoders read them, before any term is taken off."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms
from pointing_model.terms import stacked_design

from .page_figures import correlations

_MOVED = 2.0  # sigma, from where it is said what a term is beside the effects


def raw_rms_arcsec(obs, weights):
    """Radial RMS of what the encoders read beyond the catalogue, arcsec, of rows with weight.

    Parameters
    ----------
    obs : Observations
    weights : ndarray, shape (n,)

    Returns
    -------
    float or None
    """
    keep = weights > 0.0
    return _radial(obs.observed.reshape(2, -1)[:, keep]) if keep.any() else None


def raw_terms(diagnosis):
    """What the terms, fitted alone, are of the errors as read, the largest first.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    list of dict
        ``name``, ``value_arcsec`` (of a term that each run has for itself the median) and
        ``rms_arcsec``, what it is on the sky over the rows with weight. Of one that effects have
        moved by more than two of its standard errors: ``beside_effects_arcsec``, and
        ``resembles`` (the effect that it is most correlated with) with ``correlation``. Of one
        that the stars do not determine: ``undetermined``.
    """
    # beside effects that are nearly the same curve a term is a difference of large numbers
    obs, terms = diagnosis.observations, diagnosis.base_model.terms
    keep = np.flatnonzero(diagnosis.weights > 0.0)
    if not len(keep) or not terms:
        return []
    columns = stacked_design(tuple(terms), obs.context.az[keep], obs.context.el[keep],
                             obs.run.mount).reshape(len(terms), 2, -1)
    moved = _moved(diagnosis)
    out = [{'name': name, 'value_arcsec': value / ARCSEC,
            'rms_arcsec': _radial(value * column), **moved.get(name, {}),
            **({'undetermined': True} if name in diagnosis.base_model.undetermined else {})}
           for (name, value), column in zip(terms.items(), columns)]
    return sorted(out, key=lambda row: -row['rms_arcsec'])


def _moved(diagnosis):
    """Of terms that the effects have moved: what they are beside them, and whom they resemble."""
    model, base = diagnosis.model, diagnosis.base_model
    if not diagnosis.effects:
        return {}
    moved = [name for (name, value), s in zip(base.terms.items(), base.sigmas)
             if name not in diagnosis.base.own and name in model.terms
             and abs(model.terms[name] - value) > _MOVED * s]
    names, matrix = correlations(diagnosis) if moved else ([], None)
    found = [i for i, (_, coefficient) in enumerate(names) if coefficient is not None]
    out = {}
    for name in moved:
        one = {'beside_effects_arcsec': model.terms[name] / ARCSEC}
        if found and (name, None) in names:
            row = matrix[names.index((name, None))]
            most = max(found, key=lambda i, row=row: abs(row[i]))
            one.update(resembles=names[most][0], correlation=float(row[most]))
        out[name] = one
    return out


def _radial(residual):
    return float(np.hypot(*(rms(one) for one in residual))) / ARCSEC
