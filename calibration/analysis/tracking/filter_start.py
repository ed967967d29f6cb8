"""What a filter begins with: the terms of a model, and what may have changed since its night."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.held_terms import BROAD
from pointing_model.model import PointingModel

#: what a term is known no better than, where a covariance is singular, rad
_FLOOR = 0.5 * ARCSEC


def model_of_fit(fit):
    """The model of a batch fit, with what its stars did not determine as unknown.

    Parameters
    ----------
    fit : FitResult
        Directions that it dropped are not in its covariance; here they are, within `BROAD`.

    Returns
    -------
    PointingModel
    """
    model, names = fit.model, list(fit.model.terms)
    covariance = np.array(model.covariance)
    for dropped in fit.dropped:
        way = np.zeros(len(names))
        for name, value in dropped['direction'].items():
            if name in names:
                way[names.index(name)] = value
        covariance += BROAD**2 * np.outer(way, way)
    return PointingModel(model.terms, covariance, model.harmonics, model.provenance,
                         model.geometry, model.effects, model.mount)


def night_to_night(states, mount, settings):
    """What may have changed since another night.

    Parameters
    ----------
    states : sequence of str
        Of `causes.states_of`.
    mount : Mount
    settings : Settings

    Returns
    -------
    ndarray, shape (n, n)
        rad^2.
    """
    sizes = dict.fromkeys(mount.names.index, settings.night_zero)
    sizes |= {mount.names.named(name): settings.night_lean for name in ('AN', 'AW')}
    sizes |= {name: settings.night_zero for name in states if name.startswith('difference')}
    sizes |= {name: settings.night_lean for name in states if name.startswith('lean')}
    return np.diag([sizes.get(name, 0.0) ** 2 for name in states])


def complete(model, notes):
    """Terms with the zeros of both axes, and a covariance that is one.

    Parameters
    ----------
    model : PointingModel
    notes : list of str
        What had to be widened is added here.

    Returns
    -------
    terms : dict of str to float
        rad.
    covariance : ndarray, shape (k, k)
        rad^2.

    Raises
    ------
    ValueError
        The covariance is not symmetric, or negative in a direction.
    """
    terms, covariance = dict(model.terms), np.array(model.covariance)
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    values = np.linalg.eigvalsh(0.5 * (covariance + covariance.T)) if terms else np.zeros(0)
    if terms and values.min() < -1e-9 * max(values.max(), 0.0) or not np.allclose(
            covariance, covariance.T, rtol=1e-6, atol=1e-9 * np.max(size**2, initial=0.0)):
        raise ValueError('tracking: the covariance of the model is none (not symmetric, or '
                         'negative in a direction); fit it again')
    if terms and values.min() <= 1e-9 * values.max():
        covariance = covariance + _FLOOR**2 * np.eye(len(terms))
        notes.append(f'the covariance of the model is singular: {_FLOOR / ARCSEC:.1f} arcsec are '
                     'added to each term')
    missing = [name for name in model.mount.names.index if name not in terms]
    if missing:
        k = len(terms)
        whole = np.zeros((k + len(missing),) * 2)
        whole[:k, :k] = covariance
        whole[range(k, len(whole)), range(k, len(whole))] = BROAD**2
        covariance = whole
        terms |= dict.fromkeys(missing, 0.0)
        notes.append(f'the model has no {", ".join(missing)}: added, unknown within '
                     f'{BROAD / ARCSEC:.0f} arcsec')
    return terms, covariance


def switched_on(states, mount, axes, sigma):
    """What an incremental encoder that is switched on does to what is known.

    Parameters
    ----------
    states, mount
        As of `night_to_night`.
    axes : sequence of int
    sigma : float
        By how much its zero is another one, rad.

    Returns
    -------
    ndarray, shape (n, n)
        rad^2.
    """
    out = np.zeros((len(states), len(states)))
    for axis in axes:
        shape = np.zeros(len(states))
        shape[states.index(mount.names.index[axis])] = 1.0
        if f'difference_{axis + 1}' in states:
            shape[states.index(f'difference_{axis + 1}')] = -1.0
        out += sigma**2 * np.outer(shape, shape)
    return out
