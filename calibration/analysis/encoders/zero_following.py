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

"""Correction of an active zero by the absolute encoder, if the incremental counts drift."""

import numpy as np

from pointing_model.zero_drift import AxisFollowing, Following, harmonic_columns

from .count_drift import movements
from .cross_check_rows import AXES, INCREMENTAL, SHORT, USUAL, CrossCheckNight

#: smallest posterior probability that the incremental encoder drifts, to correct its zero
SURE = 0.9


def zero_following(rows, budget=USUAL):
    """Axes whose zero must be corrected by the absolute encoder, from the rows of a night.

    Parameters
    ----------
    rows : PointingRun
        With ``run``, ``star`` and ``time``; without a second encoder nothing is corrected.
    budget : Budget

    Returns
    -------
    Following
        Axes on which, according to the stars, the incremental counts drift. Not those where the
        stars cannot determine which encoder drifts, or where it is the absolute one.
    """
    if any(name not in rows for name in ('az_abs', 'el_abs', 'run', 'star', 'time')):
        return Following()
    night = CrossCheckNight(rows, None)
    if not len(night.run):
        return Following()
    found, axes = movements(night, None, budget, []), {}
    for axis, drift in found.drifts.items():
        event = next(one for one in found.events if one.axis == AXES[axis] and one.kind == 'walk')
        if event.moved == INCREMENTAL and event.confidence >= SURE:
            references, starts = _references(night, axis, drift)
            axes[SHORT[axis]] = AxisFollowing(
                drift.discs, references, drift.noise, drift.step, starts)
    return Following(axes)


def _references(night, axis, drift):
    """Reference difference of the encoders in each power-on, and start of the absolute encoder.

    Taken at the exposures for a zero if there are any, where the zero was measured. A power-on of
    the absolute encoder may change its readings: the newest with such exposures is used.
    """
    smooth = night.difference[axis] - harmonic_columns(
        night.rows[f'{SHORT[axis]}_enc']) @ drift.discs
    began = night.rows['absolute_start']
    references, starts = {}, {}
    for run in night.tonight:
        mine = night.run == run
        at = mine & night.for_zero
        at = at if at.any() else mine
        at &= night.interval == night.interval[at].max()
        references[int(run)] = float(np.median(smooth[at]))
        if np.isfinite(began[at]).any():
            starts[int(run)] = float(began[at][np.isfinite(began[at])][-1])
    return references, starts
