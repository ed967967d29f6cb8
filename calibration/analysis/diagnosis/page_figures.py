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

"""Figures shown on the page of a diagnosis in addition to its result."""

from dataclasses import replace

import numpy as np

from calibration.estimation.correlated_noise import WhiteNoise
from msg_tools.units import ARCSEC


def live_rows(diagnosis):
    """Rows with non-zero weight, and their indices in stacked x and y."""
    rows = np.flatnonzero(diagnosis.weights > 0.0)
    return rows, np.concatenate((rows, rows + len(diagnosis.weights)))


def beyond_base(diagnosis, offsets):
    """The part of some offsets that the declared terms cannot absorb, in rows with weight.

    Parameters
    ----------
    diagnosis : Diagnosis
    offsets : ndarray, shape (2, n)
        arcsec.

    Returns
    -------
    ndarray, shape (2, m)
        arcsec.
    """
    obs = diagnosis.observations
    _, both = live_rows(diagnosis)
    return diagnosis.base.columns(obs.context, obs.label).rows(both).left_of(
        offsets.reshape(-1)[both], WhiteNoise(np.ones(len(both)))).reshape(2, -1)


def add_page_figures(diagnosis):
    """Measure the effects of a diagnosis, and sort them, and those of its model, by size.

    Parameters
    ----------
    diagnosis : Diagnosis
        Changed in place.
    """
    for found in diagnosis.effects:
        found.offsets = np.tensordot(found.fitted.coefficients, found.columns, axes=1) / ARCSEC
        found.own = its_own(diagnosis, found)
        found.beyond = left = beyond_base(diagnosis, found.offsets)
        found.removes_arcsec = float(np.sqrt(np.square(left).sum() / max(left.shape[1], 1)))
    diagnosis.effects.sort(key=lambda found: -found.removes_arcsec)
    place = {found.fitted.effect.name: i for i, found in enumerate(diagnosis.effects)}
    last = len(place)
    if len(place) > 1:
        diagnosis.model = replace(diagnosis.model, effects=tuple(sorted(
            diagnosis.model.effects, key=lambda f: place.get(f.effect.name, last))))
    diagnosis.next_observations.sort(key=lambda row: place.get(row['separates'][0], last))
    diagnosis.no_star.sort(key=lambda pair: place.get(pair[0], last))
    diagnosis.correlations = correlations(diagnosis)


def its_own(diagnosis, found):
    """The part of an effect that the terms and the other effects cannot absorb when refitted.

    Residuals plotted against it show the evidence for this effect alone (an added-variable plot;
    Cook & Weisberg 1982, Residuals and Influence in Regression, section 2.3.2). The effect itself
    is not suited: with terms of nearly the same shape it is a difference of large numbers.

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
    out[:, rows] = columns.left_of(found.offsets.reshape(-1)[both],
                                   WhiteNoise(np.ones(len(both)))).reshape(2, -1)
    return out


def correlations(diagnosis):
    """Correlations of the coefficients of the common terms and the effects, in the full fit.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    names : list of (str, str or None)
        (term, None), or (effect, coefficient).
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
