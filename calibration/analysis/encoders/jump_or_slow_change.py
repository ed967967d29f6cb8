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

"""A slow change is no jump: what goes slowly inside a power-on, and how much likelier a jump is.

A step is a poor picture of what goes slowly, but the best of those that are tried, and noise alone
makes nothing like it: its chance is that of a model that is wrong. So jumps stand against slow
changes by likelihood, each number paid by ln n (BIC): a disc that turns on its hub, or goes off its
axis, while the night goes on, and a zero that goes along a curve of time.
"""

from typing import NamedTuple

import numpy as np

from ...estimation.step_scan import clipped, neighbour_noise

#: BIC by which jumps must be better than any slow change: strong evidence (Kass and Raftery 1995,
#: section 3.2)
LEAD = 6.0
#: slow changes that are fitted beside each other, at most
_MOST = 3
#: rad through which the disc turns in the night, at most; between those tried: half of it is the
#: error of the phase at either end
_FARTHEST, _SPACING = 20.0, 1.0
#: numbers of a step (size, moment) and of a drift
NUMBERS = {'step': 2, 'drift': 1}


class SlowChange(NamedTuple):
    """What may go slowly on an axis.

    Attributes
    ----------
    kind : {'disc turns', 'disc shifts', 'zero drifts slowly'}
    columns : ndarray, shape (k, n)
        Of the axis' angle.
    numbers : int
        That it is free in.
    turn : float
        Angle through which the disc turns in the night, rad; NaN of others.
    """

    kind: str
    columns: np.ndarray
    numbers: int
    turn: float = np.nan


def slow_changes(night, axis):
    """Slow changes of an axis, a list of `SlowChange`; none of a night without length.

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
    """By how much jumps are better than the best slow change, BIC, and that one.

    Parameters
    ----------
    slow : list of SlowChange
        Columns as `y` has them.
    design : GroupColumns
        What is fitted anyway.
    y : ndarray
    run : ndarray, shape (n,)
    jumps : list of ndarray
        Columns as `y` has them.
    numbers : int
        That they are free in.

    Returns
    -------
    lead : float
        Infinite where there is no slow change.
    best : SlowChange or None
    """
    if not slow:
        return np.inf, None
    first, n = _best(slow, design, y), len(y)
    # outliers of neither, for both
    tame = clipped(design.beside(*jumps, *first.columns), y)

    def cost(beside, models):
        """-2 ln L of each model and what it pays, with the noise beside one of them."""
        noise = neighbour_noise(design.beside(*beside), tame, run)
        basis = design.basis(noise)
        rest = basis.off(noise.whiten(tame))
        return [n * np.log(_left(basis, noise, rest, columns)) + noise.log_det + k * np.log(n)
                for columns, k in models]

    against = cost(first.columns, [(one.columns, one.numbers) for one in slow])
    own, = cost(jumps, [(np.array(jumps), numbers)])
    return float(min(against) - own), slow[int(np.argmin(against))]


def jumps_or_slow(search, slow, design, y, run, column, kind=lambda one: one.kind):
    """What a search finds that is far likelier than any slow change.

    Where a slow change is as likely, it is fitted too, and the search goes on beside it.

    Parameters
    ----------
    search : callable
        Design -> list of jumps and drifts.
    slow, design, y, run
        As of `lead_over`.
    column, kind : callable
        Of what was found: its column as `y` has it, and a key of `NUMBERS`.

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
        kinds = [kind(one) for one in found]
        # a drift is a slow change itself
        rivals = [one for one in slow if one.kind != 'zero drifts slowly' or 'step' in kinds]
        lead, best = lead_over(rivals, design, y, run, [column(one) for one in found],
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
    """Square of what columns leave of something beyond a design."""
    white = basis.off(np.array(columns if noise is None else noise.whiten(columns)))
    q, r = np.linalg.qr(white.T)
    live = np.abs(np.diagonal(r)) > 1e-6 * np.abs(np.diagonal(r)).max(initial=1e-300)
    along = q[:, live].T @ rest
    return max(float(rest @ rest - along @ along), 1e-300)
