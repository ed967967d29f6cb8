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

"""Slow changes inside a power-on, and their likelihood ratio to jumps.

A slow change can be mistaken for a step: the step fits poorly but better than noise alone, so its
p-value is significant although the model is wrong. Therefore jumps are compared with slow changes
by BIC (ln n per parameter): a disc that turns on its hub or shifts off its axis during the night,
and a zero that follows a smooth curve of time.
"""

from typing import NamedTuple

import numpy as np

from ...estimation.step_scan import clipped, neighbour_noise

#: BIC by which jumps must beat all slow changes: strong evidence (Kass and Raftery 1995, section
#: 3.2)
LEAD = 6.0
#: largest number of slow changes fitted together
_MOST = 3
#: rad: largest turn of the disc in the night, and grid spacing (half of it is the phase error at
#: either end)
_FARTHEST, _SPACING = 20.0, 1.0
#: number of parameters of a step (size, time) and of a drift
NUMBERS = {'step': 2, 'drift': 1}


class SlowChange(NamedTuple):
    """A possible slow change of an axis.

    Attributes
    ----------
    kind : {'disc turns', 'disc shifts', 'zero drifts slowly'}
    columns : ndarray, shape (k, n)
        Design columns for the angle of the axis.
    numbers : int
        Number of free parameters.
    turn : float
        Angle by which the disc turns in the night, rad; NaN for other kinds.
    """

    kind: str
    columns: np.ndarray
    numbers: int
    turn: float = np.nan


def slow_changes(night, axis):
    """Slow changes of an axis, a list of `SlowChange`; empty for a night of zero length.

    Parameters
    ----------
    night : CrossCheckNight
    axis : {0, 1}
    """
    tonight = night.run >= 0.0
    time, angle = night.rows['time'], night.rows[('az', 'el')[axis]]
    length = np.ptp(time[tonight]) if tonight.any() else 0.0
    if length <= 0.0:
        return []
    u = np.where(tonight, (time - time[tonight].mean()) / length, 0.0)
    waves = np.stack([np.cos(angle), np.sin(angle)]) * tonight
    out = [SlowChange('disc shifts', waves * u, 2)]
    for turn in np.arange(_SPACING, _FARTHEST + 0.5 * _SPACING, _SPACING):
        out += [SlowChange('disc turns', tonight * np.stack(
            [np.cos(angle - one * u), np.sin(angle - one * u)]), 3, one) for one in (turn, -turn)]
    bends = np.stack([u, u**2 * tonight, u**3])
    return [*out, SlowChange('zero drifts slowly', bends[:2], 2),
            SlowChange('zero drifts slowly', bends, 3)]


def lead_over(slow, design, y, run, jumps, numbers):
    """Gain in BIC of jumps over the best slow change, and that slow change.

    Parameters
    ----------
    slow : list of SlowChange
        With columns for the values of `y`.
    design : GroupColumns
        Columns that are always fitted.
    y : ndarray
    run : ndarray, shape (n,)
    jumps : list of ndarray
        Columns for the values of `y`.
    numbers : int
        Number of free parameters of the jumps.

    Returns
    -------
    lead : float
        Infinite if there is no slow change.
    best : SlowChange or None
    """
    if not slow:
        return np.inf, None
    first, n = _best(slow, design, y), len(y)
    # clip outliers from a model with both, for a fair comparison
    tame = clipped(design.beside(*jumps, *first.columns), y)

    def cost(beside, models):
        """BIC of each model, with the noise estimated with the columns `beside`."""
        noise = neighbour_noise(design.beside(*beside), tame, run)
        basis = design.basis(noise)
        rest = basis.off(noise.whiten(tame))
        return [n * np.log(_left(basis, noise, rest, columns)) + noise.log_det + k * np.log(n)
                for columns, k in models]

    against = cost(first.columns, [(one.columns, one.numbers) for one in slow])
    own, = cost(jumps, [(np.array(jumps), numbers)])
    return float(min(against) - own), slow[int(np.argmin(against))]


def jumps_or_slow(search, slow, design, y, run, candidates):
    """Jumps and drifts found by a search that are far more likely than any slow change.

    If a slow change is as likely, it is added to the design, and the search is repeated.

    Parameters
    ----------
    search : callable
        Design -> list of jumps and drifts, `step_scan.Detection`.
    slow, design, y, run
        See `lead_over`.
    candidates : LocalColumns
        For the values of `y`, labelled (run, kind, time); kind is a key of `NUMBERS`.

    Returns
    -------
    found : list
    lead : float
    instead : list of SlowChange
    """
    instead, slow = [], list(slow)
    for _ in range(_MOST):
        found = search(design)
        if not found:
            break
        kinds = [candidates.labels[one.place][1] for one in found]
        # a drift is a slow change itself: do not compare it with a drifting zero
        rivals = [one for one in slow if one.kind != 'zero drifts slowly' or 'step' in kinds]
        lead, best = lead_over(
            rivals, design, y, run, [candidates.column(one.place) for one in found],
            sum(NUMBERS[one] for one in kinds))
        if lead >= (LEAD if 'step' in kinds else 0.0):
            return found, lead, instead
        instead.append(best)
        design = design.beside(*best.columns)
        slow = [one for one in slow if one.kind != best.kind]
    return [], np.inf, instead


def _best(slow, design, y):
    basis = design.basis()
    rest = basis.off(clipped(design, y))
    return min(slow, key=lambda one: _left(basis, None, rest, one.columns))


def _left(basis, noise, rest, columns):
    """Residual sum of squares of `rest`, which is beyond a design, after fitting columns."""
    white = basis.off(np.array(columns if noise is None else noise.whiten(columns)))
    q, r = np.linalg.qr(white.T)
    live = np.abs(np.diagonal(r)) > 1e-6 * np.abs(np.diagonal(r)).max(initial=1e-300)
    along = q[:, live].T @ rest
    return max(float(rest @ rest - along @ along), 1e-300)
