"""Figures that a page of a diagnosis shows beside its result."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.estimation.correlated_noise import WhiteNoise
from msg_tools.units import ARCSEC

_NEIGHBOURS, _PLACES = 4, 12  # rows of one place at least, places of a driver at most
_ALIKE = 0.1  # of their range, within which means are as low or as high as the one that is
_ROUND = 340.0  # degrees, from where an axis has been all round and no end is one
_FOLLOWED = 0.5  # of the variance, from where the values are said to follow a driver


def live_rows(diagnosis):
    """Rows with weight, and their places in x and y stacked."""
    rows = np.flatnonzero(diagnosis.weights > 0.0)
    return rows, np.concatenate((rows, rows + len(diagnosis.weights)))


def effect_offsets(found):
    """What an effect moves in each row, shape (2, n), arcsec on the sky.

    Parameters
    ----------
    found : DiagnosedEffect
    """
    return np.tensordot(found.fitted.coefficients, found.columns, axes=1) / ARCSEC


def beyond_base(diagnosis, offsets):
    """RMS of the part of some offsets that the declared terms cannot take up, radial.

    Parameters
    ----------
    diagnosis : Diagnosis
    offsets : ndarray, shape (2, n)
        arcsec.

    Returns
    -------
    float
        arcsec.
    """
    left = _beyond(diagnosis, offsets)
    return float(np.sqrt(np.square(left).sum() / max(left.shape[1], 1)))


def _beyond(diagnosis, offsets):
    """What the declared terms leave of some offsets, shape (2, m), of the rows with weight."""
    obs = diagnosis.observations
    _, both = live_rows(diagnosis)
    return diagnosis.base.columns(obs.context, obs.label).rows(both).left_of(
        offsets.reshape(-1)[both], WhiteNoise(np.ones(len(both)))).reshape(2, -1)


def by_size(diagnosis):
    """Put the effects of a diagnosis, and of its model, in the order of what they take off.

    Parameters
    ----------
    diagnosis : Diagnosis
        Changed in place.
    """
    for found in diagnosis.effects:
        found.removes_arcsec = beyond_base(diagnosis, effect_offsets(found))
    if len(diagnosis.effects) < 2:
        return
    diagnosis.effects.sort(key=lambda found: -found.removes_arcsec)
    place = {found.fitted.effect.name: i for i, found in enumerate(diagnosis.effects)}
    last = len(place)
    diagnosis.model = replace(diagnosis.model, effects=tuple(sorted(
        diagnosis.model.effects, key=lambda f: place.get(f.effect.name, last))))
    diagnosis.next_observations.sort(key=lambda row: place.get(row['separates'][0], last))
    diagnosis.no_star.sort(key=lambda pair: place.get(pair[0], last))


def its_own(diagnosis, found):
    """The part of an effect that no term and no other effect can take up, all of them refitted.

    Against it the residual shows what the rows say of this effect alone (an added-variable plot;
    Cook & Weisberg 1982, Residuals and Influence in Regression, section 2.3.2): beside terms that
    are nearly the same curve the effect itself is a difference of large numbers.

    Parameters
    ----------
    diagnosis : Diagnosis
    found : DiagnosedEffect

    Returns
    -------
    ndarray, shape (2, n)
        arcsec on the sky; NaN in rows without weight.
    """
    obs, (rows, both) = diagnosis.observations, live_rows(diagnosis)
    others = [e.columns.reshape(-1, 2 * len(obs))[:, both] for e in diagnosis.effects
              if e is not found and e.fitted.effect.kind != 'known']
    columns = diagnosis.base.columns(obs.context, obs.label).rows(both).beside(*others)
    out = np.full((2, len(obs)), np.nan)
    out[:, rows] = columns.left_of(effect_offsets(found).reshape(-1)[both],
                                   WhiteNoise(np.ones(len(both)))).reshape(2, -1)
    return out


def over_the_rows(diagnosis, offsets):
    """What some offsets do beyond the declared terms, on the axis where it goes farther.

    Parameters
    ----------
    diagnosis : Diagnosis
    offsets : ndarray, shape (2, n)
        arcsec.

    Returns
    -------
    rows : ndarray of int, shape (m,)
        With weight.
    values : ndarray, shape (m,)
        arcsec on the sky.
    """
    left, (rows, _) = _beyond(diagnosis, offsets), live_rows(diagnosis)
    return rows, left[int(np.argmax(np.ptp(left, axis=1)))] if left.size else np.zeros(0)


@dataclass
class Extreme:
    """Where something is lowest or highest along a driver.

    Attributes
    ----------
    at, low, high : float
        There, and from where to where it is hardly less so.
    end : bool
        The rows end there: beyond it may be lower or higher still.
    """

    at: float
    low: float
    high: float
    end: bool


def ends(driver, values):
    """Places of a driver around which some values are lowest and highest.

    A single row is no place: what is stretched by the other axis, or reversed through the pole,
    has its lowest and its highest at one and the same. Means of neighbours are compared.

    Parameters
    ----------
    driver, values : ndarray, shape (m,)

    Returns
    -------
    tuple of Extreme or None
        Where the means are lowest and highest; None where the driver is not what most of the
        values follow.
    """
    known = np.isfinite(driver)
    driver, values = driver[known], values[known]
    parts = min(len(driver) // _NEIGHBOURS, _PLACES)
    if parts < 3:
        return None
    order = np.argsort(driver, kind='stable')
    groups = np.array_split(order, parts)
    means = np.array([values[group].mean() for group in groups])
    between = sum(len(group) * (mean - values.mean())**2 for group, mean in zip(groups, means))
    if not between > _FOLLOWED * np.square(values - values.mean()).sum():
        return None
    places = np.array([np.median(driver[group]) for group in groups])
    alike = _ALIKE * np.ptp(means)
    round_ = np.ptp(driver) > _ROUND
    if not round_:
        places[[0, -1]] = driver.min(), driver.max()
    return tuple(_extreme(places, size <= size.min() + alike, int(size.argmin()), round_)
                 for size in (means, -means))


def _extreme(places, alike, k, round_):
    """`Extreme` at the place `k`, with the neighbours that are as low or as high."""
    low = high = k
    while low > 0 and alike[low - 1]:
        low -= 1
    while high + 1 < len(places) and alike[high + 1]:
        high += 1
    return Extreme(*(float(places[i]) for i in (k, low, high)),
                   bool(not round_ and (low == 0 or high == len(places) - 1)))


def correlations(diagnosis):
    """Correlations of the common terms and the effects, all else fitted beside them.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    names : list of (str, str or None)
        Term; or effect and coefficient.
    matrix : ndarray, shape (k, k)
    """
    obs, base = diagnosis.observations, diagnosis.base
    n = len(obs)
    rows, both = live_rows(diagnosis)
    found = [e for e in diagnosis.effects if e.fitted.effect.kind != 'known']
    shared = base.columns(obs.context, obs.label).rows(both)
    parts = [e.columns.reshape(-1, 2 * n)[:, both] for e in found]
    names = [(t, None) for t in base.terms if t not in base.own]
    at = np.arange(len(names)).tolist()
    start = len(names) + 2 * base.harmonic_count
    for e in found:
        coefficients = e.fitted.effect.coefficient_names
        names += [(e.fitted.effect.name, c) for c in coefficients]
        at += range(start, start + len(coefficients))
        start += len(coefficients)
    weight = np.sqrt(diagnosis.weights[rows])
    if obs.inverse_sigma is None:
        scale = np.sqrt(np.mean(np.square(diagnosis.residual_after[:, rows]), axis=1))
        root = np.concatenate([weight / max(s, 1e-15) for s in scale])
    else:
        root = obs.inverse_sigma[both] * np.concatenate((weight, weight))
    inverse = shared.beside(*parts).solver(WhiteNoise(root)).inverse[np.ix_(at, at)]
    size = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    return names, inverse / np.outer(size, size)


def histogram(before, after, limit):
    """Counts of residuals before and after in the same bins; what is beyond is in the last ones.

    Parameters
    ----------
    before, after : ndarray, shape (n,)
    limit : float
        Of the bins, on both sides.

    Returns
    -------
    edges : ndarray, shape (b + 1,)
    counts : list of ndarray, shape (b,)
    sigmas : list of float
        Standard deviations.
    """
    bins = int(np.clip(np.sqrt(len(before)) * 1.6, 9, 41)) | 1
    edges = np.linspace(-limit, limit, bins + 1)
    both = before, after
    return (edges, [np.histogram(np.clip(v, -limit, limit), edges)[0] for v in both],
            [float(np.std(v)) if len(v) else np.nan for v in both])
