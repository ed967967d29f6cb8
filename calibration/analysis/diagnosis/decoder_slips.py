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


"""Decoder slips: encoder readings off by whole bars of a disc or lines of a grating."""

import numpy as np

from calibration.estimation.robust import GROSS
from msg_tools.units import ARCSEC
from pointing_model.effects import period_of
from pointing_model.effects.base import AXES

_FARTHEST = 30  # largest slip, bars or lines
_DRAWS = 19999  # simulations of uniformly distributed outliers for a p-value


def decode_slips(obs, fit, alpha):
    """Find gross outliers that are whole bars of the disc or lines of the grating off.

    The graduation must be declared and the raw encoder reading known. A gross outlier can be near a
    multiple of a line by chance, the more easily the finer the lines. So the likelihood ratio of
    "half of the outliers of this axis are slips" to "all are uniform between two lines" is compared
    with simulated uniform outliers. Outliers that miss a line count against slips.

    Parameters
    ----------
    obs : Observations
    fit : WeightedFit
        Fit of the base.
    alpha : float
        Probability of reporting any slip if there are none, over all graduations and axes.

    Returns
    -------
    list of (str, str, ndarray of int, ndarray of int, float)
        Axis, graduation, rows (indices in `obs`), multiples, p-value.
    """
    graduation = obs.context.graduation
    tests = [(kind, axis, i) for kind in ('bars', 'grating') for i, axis in enumerate(AXES)
             if kind in graduation.get(axis, ()) and obs.context.get(f'reading_{axis}') is not None]
    n = len(obs)
    raw = fit.raw.reshape(2, n).copy()
    given = np.ones((2, n)) if obs.inverse_sigma is None else obs.inverse_sigma.reshape(2, n)
    noise = fit.scale[:, None] / given
    gross = np.abs(raw / noise) > GROSS
    raw[0] /= obs.context.trig.cos_el
    noise[0] /= np.abs(obs.context.trig.cos_el)
    noise = np.hypot(noise, 0.2 * ARCSEC)
    out, taken = [], np.zeros((2, n), bool)
    for kind, axis, i in tests:
        period = period_of(kind, graduation[axis][kind])
        multiple = np.rint(raw[i] / period)
        tried = gross[i] & ~taken[i] & (multiple != 0) & (np.abs(multiple) <= _FARTHEST)
        if not tried.any():
            continue
        off = np.abs(raw[i] - multiple * period)
        # a slip of this axis does not move the other one, unless that has slipped too
        clean = ~gross[1 - i] | taken[1 - i]
        chance = min(len(tests) * _chance_of_slips(
            np.where(clean, off, 0.5 * period)[tried], noise[i][tried], period), 1.0)
        hit = tried & clean & (off < np.minimum(4.0 * noise[i], period / 12.0))
        if hit.any() and chance <= alpha:
            taken[i] |= hit
            rows = np.flatnonzero(hit)
            out.append((axis, kind, rows, multiple[rows].astype(int), chance))
    return out


def _chance_of_slips(off, noise, period):
    """P-value: how often outliers uniform between two lines are as close to lines as these.

    Parameters
    ----------
    off, noise : ndarray, shape (k,)
        Distance from the nearest line, and its standard deviation, radians.
    period : float
        Distance between two lines, radians.
    """
    def ratio(distance):
        # log-likelihood ratio with half of the outliers slips; none if noise exceeds a line
        slip = period / (np.sqrt(2.0 * np.pi) * noise) * np.exp(-0.5 * (distance / noise)**2)
        return np.log(0.5 + 0.5 * slip).sum(axis=-1)

    rng = np.random.default_rng(0)  # the same rows give the same chance
    anywhere = rng.uniform(0.0, 0.5 * period, (_DRAWS, len(off)))
    return (int(np.count_nonzero(ratio(anywhere) >= ratio(off))) + 1) / (_DRAWS + 1)
