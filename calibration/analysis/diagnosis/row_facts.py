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

"""What a diagnosis did to single rows, and to nights that it has not seen: facts for people."""

from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import rms, sigma_of

from ..finding import Finding
from .reading_fits import MOST_LEFT_OUT

#: times the scatter of the others from where a night held out is bad: of 67 nights of one
#: telescope in six years, seven terms fitted to each, 61 leave less than 1.5 times their median
#: and 64 less than 2 times
BAD_NIGHT = 2.0
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


@dataclass
class HeldOutNight:
    """A run held out, judged for itself.

    Attributes
    ----------
    name : str
    rows, set_aside : int
        Rows, and of these the ones that are outliers among all runs held out.
    before, after : dict
        ``radial``, ``x``, ``y``: RMS of all its rows, arcsec.
    typical : ndarray, shape (2,)
        Robust scatter of x and y with the effects, arcsec.
    """

    name: str
    rows: int
    set_aside: int
    before: dict
    after: dict
    typical: np.ndarray

    def to_dict(self, bad):
        """JSON-ready."""
        return {'run': self.name, 'rows': self.rows, 'set_aside': self.set_aside,
                'before': _entry(self.before), 'after': _entry(self.after), 'bad': bad}


def _entry(values):
    return {f'rms_{"" if key == "radial" else key + "_"}arcsec': value
            for key, value in values.items()}


def nights_held_out(obs, left, kept, result):
    """Each run held out for itself, and whether it is bad.

    A night is bad whose robust scatter is `BAD_NIGHT` times that which the others have, with the
    run that was fitted as one of them, or of which more than a third are outliers.

    Parameters
    ----------
    obs : Observations
        Of the runs held out.
    left : sequence of ndarray, shape (2, n)
        What the model leaves there without and with the effects, radians.
    kept : ndarray of bool, shape (n,)
        No outliers.
    result : Diagnosis

    Returns
    -------
    list of dict
        ``run``, ``rows``, ``set_aside``, ``before`` and ``after`` (``rms_arcsec``,
        ``rms_x_arcsec``, ``rms_y_arcsec`` of all its rows) and ``bad``: None, or ``times`` the
        others' scatter in ``x`` and ``y``.
    """
    nights = []
    for label in np.unique(obs.label):
        rows = obs.label == label
        nights.append(HeldOutNight(_name(obs, rows), int(rows.sum()), int((rows & ~kept).sum()),
                                *(_axes(one[:, rows]) for one in left),
                                _scatter(left[1][:, rows])))
    own = _scatter(result.residual_after[:, result.weights > 0.0])
    out = []
    for i, night in enumerate(nights):
        others = np.median([own, *(n.typical for j, n in enumerate(nights) if j != i)], axis=0)
        times = night.typical / np.maximum(others, 1e-9)
        many = night.set_aside > MOST_LEFT_OUT * night.rows
        bad = many or np.hypot(*night.typical) > BAD_NIGHT * np.hypot(*others)
        out.append(night.to_dict(dict(zip('xy', times.tolist())) if bad else None))
    return out


def _name(obs, rows):
    run = obs.runs[int(obs.label[rows][0])]
    if isinstance(run, str) and ':' in run:
        path, _, number = run.rpartition(':')
        name = PurePath(path).name
        several = sum(isinstance(r, str) and r.rpartition(':')[0] == path for r in obs.runs) > 1
        return f'{name}, run {number}' if several else name
    source = PurePath(str(obs.sources[np.flatnonzero(rows)[0]])).name
    return source if len(obs.runs) == 1 else f'{source}, run {run:g}' \
        if isinstance(run, (int, float)) else str(run)


def _axes(residual):
    x, y = (float(rms(one)) / ARCSEC for one in residual)
    return {'radial': float(np.hypot(x, y)), 'x': x, 'y': y}


def _scatter(residual):
    return np.array([float(sigma_of(one)) for one in residual]) / ARCSEC


def repeats(group, lines, residual, word='row'):
    """Finding on rows that are of one place, and how much they differ; None where many are.

    Parameters
    ----------
    group : ndarray of int, shape (n,)
        As `star_groups` gives it.
    lines : ndarray, shape (n,)
        What the rows are called by.
    residual : ndarray, shape (2, n)
        What is left, radians.
    word : {'row', 'line'}

    Returns
    -------
    Finding or None
    """
    pairs = [np.flatnonzero(group == g) for g, count in zip(*np.unique(
        group, return_counts=True)) if count > 1]
    if not 0 < len(pairs) <= _PLACES_NAMED:
        return None
    off = np.concatenate([residual[:, rows[1:]] - residual[:, rows[:-1]] for rows in pairs], axis=1)
    return Finding('star measured again', float(np.hypot(*(rms(one) for one in off))) / ARCSEC,
                   evidence={'word': word, 'rows': [[lines[i] for i in rows] for rows in pairs]})
