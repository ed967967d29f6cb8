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

"""Priors for a night from earlier ones: distribution of the terms, and their drift rates.

A model of `telescope-mount season` has both in its provenance (`PAST`, `RATES`).
"""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.pointing_terms import design

from .motion_causes import TrackingSettings
from .tracker import Tracker

#: keys of a model's provenance
PAST, RATES = 'past', 'rates'
#: degrees of freedom of the Student's t noise of stars, for robustness against wrong ones
_FREEDOM = 4.0
#: maximum likelihood scale of that distribution for Gaussian pairs, in their sigmas
_SCALE = 0.852
#: prior scatter of a term from run to run, 1 sigma, rad; its weight in runs
_LEAST, _AS_RUNS = 0.3 * ARCSEC, 2.0
#: prior sigma of the terms before any run, rad
_BEFORE = 3000.0 * ARCSEC
#: iterations of the EM, for terms and for rates; weight in nights of the uniform prior on rates
_ROUNDS, _RATE_ROUNDS, _AS_NIGHTS = 12, 50, 0.3


_ARRAYS = {'mean': 1, 'covariance': 2, 'last': 1, 'last_covariance': 2}  # dimensions


@dataclass(frozen=True)
class Past:
    """Prior distribution of the terms in a new run.

    Attributes
    ----------
    names : tuple of str, length k
    mean : ndarray, shape (k,)
        rad.
    covariance : ndarray, shape (k, k)
        Scatter from run to run and the error of the mean, rad^2.
    noise : float
        1 sigma of a star in each of x and y, rad.
    last : ndarray, shape (k,)
        Terms of the last run, rad.
    last_covariance : ndarray, shape (k, k)
        Their covariance, rad^2.
    """

    names: tuple
    mean: np.ndarray
    covariance: np.ndarray
    noise: float
    last: np.ndarray
    last_covariance: np.ndarray

    def document(self):
        """JSON-ready; rad and rad^2."""
        return {'names': list(self.names), 'noise': self.noise,
                **{name: getattr(self, name).tolist() for name in _ARRAYS}}

    @classmethod
    def from_model(cls, model):
        """The record of earlier nights in a model, or None.

        Raises
        ------
        ValueError
            The record is damaged, or has other terms than the model.
        """
        kept = model.provenance.get(PAST)
        if kept is None:
            return None
        try:
            arrays = {name: np.array(kept[name], dtype=float) for name in _ARRAYS}
            out = cls(tuple(kept['names']), noise=float(kept['noise']), **arrays)
        except (KeyError, TypeError, ValueError) as err:
            raise ValueError(f'record of earlier nights in the model is damaged: {err!r:.80}; '
                             'make it again (telescope-mount season)') from None
        k = len(model.terms)
        if out.names != tuple(model.terms) or not out.noise > 0.0 or any(
                arrays[name].shape != (k,) * dimensions or not np.isfinite(arrays[name]).all()
                for name, dimensions in _ARRAYS.items()):
            raise ValueError('record of earlier nights in the model is of other terms, or no '
                             'number: make it again (telescope-mount season)')
        return out


def past_of_runs(runs, names, *, memory=np.inf):
    """Mean of the terms and their scatter from run to run, by maximum likelihood (EM).

    A random effects model: terms that a run does not determine are taken from the others (Dempster,
    Laird and Rubin 1977; Laird and Ware 1982). Stars have Student's t noise (Lange, Little and
    Taylor 1989).

    Parameters
    ----------
    runs : sequence of (PointingRun or (ndarray, ndarray))
        At least one, in order, of one mount. Or columns, shape (n, 2, k), and offsets,
        shape (n, 2), rad.
    names : sequence of str, length k
        Terms; each should be in the dictionary of the mount.
    memory : float
        Number of runs after which the weight of a run has dropped by a factor e.

    Returns
    -------
    Past

    Raises
    ------
    ValueError
        No run.
    """
    if not len(runs):
        raise ValueError('no earlier run: nothing is known of tonight')
    runs = [rows_of(run, names) if hasattr(run, 'offsets') else run for run in runs]
    k = len(names)
    ages = np.arange(len(runs))[::-1]
    share = np.exp(-ages / memory)
    total = share.sum()
    rows = [(h.reshape(-1, k), y.reshape(-1)) for h, y in runs]
    mean, scatter, noise = np.zeros(k), np.eye(k) * _BEFORE**2, 5.0 * ARCSEC
    weights = [np.ones(len(y)) for _, y in runs]
    least = _AS_RUNS * _LEAST**2 * np.eye(k)
    for turn in range(_ROUNDS + 1):
        before = np.linalg.inv(scatter)
        found, left, good = [], 0.0, 0.0
        for place, (h, y) in enumerate(rows):
            w = np.repeat(weights[place], 2)
            covariance = np.linalg.inv(before + (h.T * w) @ h / noise**2)
            terms = covariance @ (before @ mean + (h.T * w) @ y / noise**2)
            found.append((terms, covariance))
            off = y - h @ terms
            square = off**2 + np.einsum('ij,jk,ik->i', h, covariance, h)
            left, good = left + share[place] * (w @ square), good + share[place] * len(y)
            weights[place] = (_FREEDOM + 2.0) / (
                _FREEDOM + square.reshape(-1, 2).sum(axis=1) / noise**2)
        if turn == _ROUNDS:
            break
        mean = sum(s * terms for s, (terms, _) in zip(share, found)) / total
        scatter = (least + sum(s * (np.outer(t - mean, t - mean) + c)
                               for s, (t, c) in zip(share, found))) / (total + _AS_RUNS)
        if turn < 2:  # start uncorrelated: undetermined directions must not seem to scatter more
            scatter = np.diag(np.diag(scatter))
        noise = np.sqrt(left / good)
    return Past(tuple(names), mean, scatter * (1.0 + np.sum(share**2) / total**2),
                float(noise / _SCALE), *found[-1])


def rows_of(run, names):
    """Columns, shape (n, 2, k), and offsets, shape (n, 2), rad, of the finite rows of a run."""
    offsets = np.stack(run.offsets(), axis=1)
    good = np.isfinite(offsets).all(axis=1) & np.isfinite(run['az']) & np.isfinite(run['el'])
    columns = np.stack(design(names, run['az'], run['el'], run.mount), axis=1)
    return columns[good], offsets[good]


@dataclass(frozen=True)
class Rates:
    """Drift rates of the terms of a mount, learned from its nights.

    Attributes
    ----------
    weights : ndarray, shape (r,)
        Prior probability of each hypothesis for another night, the `rate_weights` of a `Tracker`.
    facts : list of dict
        The hypotheses, see `Tracker.facts`.
    """

    weights: np.ndarray
    facts: list

    def document(self):
        """JSON-ready: drift rates of zeros and tilt, and the probability of each pair."""
        return [{'zero_arcsec': fact['zero'] / ARCSEC, 'lean_arcsec': fact['tilt'] / ARCSEC,
                 'chance': float(weight)} for fact, weight in zip(self.facts, self.weights)]


def rate_weights_of(document, facts):
    """Probabilities of the hypotheses of a tracker, from `Rates.document`.

    Parameters
    ----------
    document : list of dict or None
    facts : list of dict
        See `Tracker.facts`; hypotheses that differ only in what drifts share a probability.

    Returns
    -------
    ndarray, shape (r,), or None
        None if nothing is known, or if the document has other rates.
    """
    if document is None:
        return None
    try:
        known = [(float(row['zero_arcsec']) * ARCSEC, float(row['lean_arcsec']) * ARCSEC,
                  float(row['chance'])) for row in document]
    except (KeyError, TypeError, ValueError) as err:
        raise ValueError(f'drift rates in the model are damaged: {err!r:.80}; make it again '
                         '(telescope-mount season)') from None
    out = np.array([sum(chance for zero, lean, chance in known
                        if np.allclose((zero, lean), (fact['zero'], fact['tilt']), 1e-6))
                    for fact in facts])
    return out / out.sum() if np.all(out > 0.0) else None


def rates_of_nights(nights, *, settings=None, noise=None):
    """Frequency of each drift rate among nights, by maximum likelihood.

    A mixture of the hypotheses of a tracker, with weights from EM. A uniform prior has the weight
    of `_AS_NIGHTS` nights.

    Parameters
    ----------
    nights : sequence of (PointingModel, PointingRun)
        The active model at the beginning of a night, and its stars in order, with ``time``.
    settings : TrackingSettings, optional
    noise : float, optional
        1 sigma of a star, rad, for runs without ``sigma_x``, ``sigma_y``.

    Returns
    -------
    Rates

    Raises
    ------
    ValueError
        No night, or the noise is unknown.
    """
    if not nights:
        raise ValueError('no earlier night: the rates of the literature hold')
    settings = replace(settings or TrackingSettings(), turn_h=1e9)
    trackers = [tracked(model, run, settings=settings, noise=noise) for model, run in nights]
    facts = trackers[0].facts
    chances = np.array([one.rate_weights * len(facts) for one in trackers])
    before = np.full(len(facts), 1.0 / len(facts))
    weights = before
    for _ in range(_RATE_ROUNDS):
        each = chances * weights
        each /= each.sum(axis=1, keepdims=True)
        weights = (_AS_NIGHTS * before + each.sum(axis=0)) / (_AS_NIGHTS + len(chances))
    return Rates(weights, facts)


def tracked(model, run, *, noise=None, **options):
    """A `Tracker` after the stars of a run.

    Parameters
    ----------
    model : PointingModel
    run : PointingRun
        With ``time``, in order.
    noise : float, optional
        See `rates_of_nights`.
    **options
        Options of `Tracker`.
    """
    time = np.asarray(run['time'], float)
    tracker = Tracker(model, int(round(time[0] * 1e9)) - 1, **options)
    x, y = run.offsets()
    sigma_x, sigma_y = (np.asarray(run.get(f'sigma_{axis}'), float) for axis in 'xy')
    if noise is not None:
        sigma_x, sigma_y = (np.where(np.isfinite(s), s, noise) for s in (sigma_x, sigma_y))
    if not np.isfinite(sigma_x).any():
        raise ValueError('the noise of the stars is not known; give it')
    for k in range(len(run)):
        tracker.star(int(round(time[k] * 1e9)), run['az'][k], run['el'][k], x[k], y[k],
                     (sigma_x[k], sigma_y[k]))
    return tracker
