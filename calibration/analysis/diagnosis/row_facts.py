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

"""What a diagnosis did to single rows: facts for people."""

from pathlib import PurePath

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms

from ..finding import Finding

_PLACES_NAMED = 4  # places that stand twice, that are named


def worst_rows(diagnosis):
    """The worst of the rows that count, before and after.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    dict or None
        ``before`` and ``after``: each with ``row``, ``source`` (of several files), ``az_deg``,
        ``el_deg`` (of the axes of the mount), ``before_arcsec`` and ``after_arcsec``. None
        without an effect.
    """
    used = np.flatnonzero(diagnosis.weights > 0.0)
    if not diagnosis.effects or not len(used):
        return None
    obs = diagnosis.observations
    sizes = {when: np.hypot(*getattr(diagnosis, f'residual_{when}')) / ARCSEC
             for when in ('before', 'after')}
    several = len(set(obs.sources)) > 1
    az, el = np.degrees(obs.run['az']), np.degrees(obs.run['el'])
    if obs.run.mount.vertical:
        az = np.mod(az, 360.0)
    return {when: {'row': int(obs.lines[i]), 'az_deg': float(az[i]), 'el_deg': float(el[i]),
                   **({'source': PurePath(str(obs.sources[i])).name} if several else {}),
                   **{f'{key}_arcsec': float(one[i]) for key, one in sizes.items()}}
            for when, size in sizes.items() for i in [used[np.argmax(size[used])]]}


def repeats(rows):
    """A Finding on rows that are of one place, and how much they differ; none where many are.

    Parameters
    ----------
    rows : ResidualRows

    Returns
    -------
    list of Finding
    """
    group, left = rows.sequence.group, rows.residual
    pairs = [np.flatnonzero(group == g) for g, count in zip(*np.unique(
        group, return_counts=True)) if count > 1]
    if not 0 < len(pairs) <= _PLACES_NAMED:
        return []
    off = np.hstack([left[:, pair[1:]] - left[:, pair[:-1]] for pair in pairs])
    return [Finding('star measured again', float(np.hypot(*(rms(one) for one in off))) / ARCSEC,
                    evidence={'word': rows.word,
                              'rows': [[rows.lines[i] for i in pair] for pair in pairs]})]
