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

"""Unequal scatter of the residuals: by elevation, run and axis."""

import math

import numpy as np

from calibration.estimation.robust import scale_law, scale_ratio
from msg_tools.units import ARCSEC
from pointing_model.rms import rms, sigma_of

from ..finding import Finding
from .observations import run_name

#: unequal scatter in three elevation bands: fewest rows per band, largest p-value, and smallest
#: ratio of the scatter
_FEWEST_IN_BAND, _UNEQUAL, _TIMES = 12, 1e-3, 1.5
#: unequal scatter of the axes: fewest rows and smallest ratio
_FEWEST, _AXES_TIMES = 20, 2.0
#: log-likelihood ratio from which a law is named: odds of 30 to 1. The wrong law is named in at
#: most 1 of 1000 nights (20 to 200 rows)
_LAW = float(np.log(30.0))
#: fewest rows and smallest ratio of a run that scatters more than the others; smallest ratio in
#: both axes to count as noise (an effect of one axis is not)
_OF_RUN, _RUN_TIMES, _EACH_AXIS = 12, 2.0, 1.5


def unequal_scatter(diagnosis):
    """Test whether the scatter of the residuals of an axis depends on elevation.

    Compares three bands with equal numbers of rows by the ranks of the absolute residuals (Kruskal
    and Wallis 1952, J. Am. Stat. Assoc. 47, 583).

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    dict or None
        ``axis`` (x, y), ``p`` and ``bands``, from low to high: ``from_deg``, ``to_deg`` of
        elevation and ``rms_arcsec``. None if it does not, or if there are too few rows.
    """
    rows = np.flatnonzero(diagnosis.weights > 0.0)
    elevation = diagnosis.observations.context.on_horizon()[1]
    if len(rows) < 3 * _FEWEST_IN_BAND:
        return None
    rows = rows[np.argsort(elevation[rows], kind='stable')]
    bands, best = np.array_split(np.arange(len(rows)), 3), None
    for axis, left in zip('xy', diagnosis.residual_after[:, rows]):
        ranks = np.empty(len(rows))
        ranks[np.argsort(np.abs(left), kind='stable')] = np.arange(1.0, len(rows) + 1.0)
        off = sum(len(band) * (ranks[band].mean() - 0.5 * (len(rows) + 1.0))**2 for band in bands)
        p = 2.0 * math.exp(-6.0 * off / (len(rows) * (len(rows) + 1.0)))  # chi^2 of 2
        sizes = [float(rms(left[band])) / ARCSEC for band in bands]
        if p < _UNEQUAL and max(sizes) > _TIMES * min(sizes) and (best is None or p < best['p']):
            ends = np.degrees(elevation[rows])
            best = {'axis': axis, 'p': p, 'bands': [
                {'from_deg': float(ends[band[0]]), 'to_deg': float(ends[band[-1]]),
                 'rms_arcsec': size} for band, size in zip(bands, sizes)]}
    return best


def unequal_axes(residual, keep, context):
    """Test whether residuals scatter more in one axis, and how that depends on direction.

    Rotation errors of the first axis (drive, encoder, clock) move stars in x by the cosine of the
    second angle; optics, seeing and camera move them equally everywhere.

    Parameters
    ----------
    residual : ndarray, shape (2, n)
        Radians.
    keep : ndarray of bool, shape (n,)
        Rows that count.
    context : Context

    Returns
    -------
    dict or None
        ``axis`` (x or y, the one that scatters more), ``times``, ``p``, ``sigma_arcsec`` (of x and
        y, robust) and, if x scatters more, its ``law``: ``cosine``, ``even``, or None if
        undetermined. None if the axes scatter alike, or if there are too few rows.
    """
    rows = np.flatnonzero(keep)
    if len(rows) < _FEWEST:
        return None
    left = residual[:, rows]
    time = context.get('time')
    order = None if time is None or not np.isfinite(time).all() else np.argsort(
        time[rows], kind='stable')
    ratio, p = scale_ratio(*left, order)
    if p >= _UNEQUAL or max(ratio, 1.0 / ratio) < _AXES_TIMES:
        return None
    law = scale_law(left[0], np.maximum(np.abs(np.cos(context.el[rows])), 1e-3))
    found = 'cosine' if law > _LAW else 'even' if law < -_LAW else None
    return {'axis': 'x' if ratio > 1.0 else 'y', 'times': float(max(ratio, 1.0 / ratio)), 'p': p,
            'sigma_arcsec': [float(sigma_of(one)) / ARCSEC for one in left],
            'law': found if ratio > 1.0 else None}


def noise_of_runs(obs, left):
    """Noise of each run, if one clearly scatters more than the others.

    Tested by the ranks of the radial residuals (Mann and Whitney 1947, Ann. Math. Stat. 18, 50).

    Parameters
    ----------
    obs : Observations
    left : ndarray, shape (2, n)
        Residuals of all rows, with outliers, radians.

    Returns
    -------
    sigma : ndarray, shape (runs,), or None
        Robust noise per axis, in units of the given sigmas if any. Runs that scatter more in both
        axes have separate values. None if no run does.
    findings : list of Finding
        One for each run that scatters more.
    """
    given = 1.0 if obs.inverse_sigma is None else obs.inverse_sigma.reshape(2, -1)
    standard, count = left * given, np.bincount(obs.label, minlength=len(obs.runs))
    labels = np.flatnonzero(count >= _OF_RUN)
    if len(labels) < 2:
        return None, []
    own = np.array([_sigmas(standard[:, obs.label == label]) for label in labels])
    noisy = {}
    for i, label in enumerate(labels):
        others = np.median(np.delete(own, i, axis=0), axis=0)
        if np.hypot(*own[i]) > _RUN_TIMES * np.hypot(*others) and _chance_larger(
                np.hypot(*standard), obs.label == label) * len(labels) < _UNEQUAL:
            noisy[int(label)] = own[i] / others
    if not noisy:
        return None, []
    rest = ~np.isin(obs.label, [*noisy])
    sigma, findings = np.full(len(obs.runs), _size(standard[:, rest])), []
    for label, times in noisy.items():
        rows, weighed = obs.label == label, bool(times.min() > _EACH_AXIS)
        if weighed:
            sigma[label] = _size(standard[:, rows])
        findings.append(Finding('noisier run', _size(left[:, rows]) / ARCSEC, evidence={
            'run': run_name(obs, rows), 'others': _size(left[:, rest]) / ARCSEC,
            'weighed': weighed}, caution=True))
    return sigma if any(one['weighed'] for one in findings) else None, findings


def _sigmas(left):
    return np.maximum([sigma_of(one) for one in left], 1e-9 * ARCSEC)


def _size(left):
    """Robust noise per axis, from both axes together."""
    return float(np.hypot(*_sigmas(left))) / math.sqrt(2.0)


def _chance_larger(size, rows):
    """One-sided p-value of the Mann-Whitney test that values of some rows are larger."""
    # written out because scipy.stats takes half a second to load
    rank = np.empty(len(size))
    rank[np.argsort(size, kind='stable')] = np.arange(1.0, len(size) + 1.0)
    m, n = int(rows.sum()), len(size)
    off = rank[rows].sum() - 0.5 * m * (n + 1.0)
    return 0.5 * math.erfc(off / math.sqrt(m * (n - m) * (n + 1.0) / 6.0))
