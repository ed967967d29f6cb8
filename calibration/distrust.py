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

"""Observations that are not to be used because an instrument lied, and models that are not to be
published because of what is known against them.
"""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import sigma_of

from .analysis.camera_faults import SAME_ROWS, frozen_rows, turned_rows

#: so large a part of the observations that is not to be trusted speaks against all of them
MOST_DISTRUSTED = 1.0 / 3.0
#: RMS on stars held out, in units of the noise that the fit itself found, beyond which an alarm
#: and the model cannot both be lived with
CONTRADICTED = 10.0

TURNED_CAMERA = 'what the camera measured fits the pointing with {} alone'
FROZEN_CAMERA = 'the camera said the same miss distance in {} observations in a row or more'
#: rows from which their scatter tells something
_FEW = 8
#: noise of a centroid that the air leaves, 1 sigma of an axis, rad: image motion in short exposures
#: in seeing of 0.8" (r0 = 126 mm) through 4 m, 0.42 wavelength D^(-1/6) r0^(-5/6)
#: (Martin 1987, PASP 99, 1360). Smaller telescopes see more; exposures of many seconds less.
AIR = 0.2 * ARCSEC


def distrusted(rows):
    """Rows that an instrument has falsified, by what it says itself.

    Parameters
    ----------
    rows : PointingRun
        In the order in which they were taken. Only those of an observer are tested, which have
        the column ``encoder_start``: in a file zeros may stand for what was not measured.

    Returns
    -------
    ndarray of bool, shape (n,)
        Of a camera that was frozen, or that was mirrored or turned amid the night.
    """
    return np.logical_or.reduce([np.zeros(len(rows), bool), *(bad for bad, _ in _faults(rows))])


def _is_of_observer(rows):
    return all(name in rows for name in ('encoder_start', 'miss_x', 'miss_y'))


def _faults(rows):
    """Masks of the rows that an instrument has falsified, and how it has, in words."""
    if not _is_of_observer(rows):
        return []
    frozen = frozen_rows(rows['miss_x'], rows['miss_y'])
    out = [(frozen, FROZEN_CAMERA.format(SAME_ROWS))]
    if 'run' in rows:
        turned = np.zeros(len(rows), bool)
        # a satellite is off by its elements
        stars = np.flatnonzero((np.asarray(rows.get('star', turned)) >= 0) & ~frozen)
        turned[stars], sense = turned_rows(rows.select(stars))
        out.append((turned, TURNED_CAMERA.format(sense)))
    return out


def reasons(rows):
    """What `distrusted` says of the rows, sentences; empty where all can be used."""
    return [f'{len(bad)} of {len(rows)} observations left out, rows {bad[0]} to {bad[-1]}: {why}'
            for bad, why in ((np.flatnonzero(mask), why) for mask, why in _faults(rows))
            if len(bad)]


def notes_of(rows):
    """What the miss distances give away: `reasons`, and a camera that sees less than the air.

    A camera that always says about the same makes a fit that looks too good: it gives back the
    model by which the mount was pointed, and what is left is the noise of the encoders. A long
    exposure through steady air may do as well, so the rows are used, and it is reported.

    Parameters
    ----------
    rows : PointingRun
        As for `distrusted`.

    Returns
    -------
    list of str
        Sentences; empty where there is nothing to say.
    """
    out, bad = reasons(rows), distrusted(rows)
    if not _is_of_observer(rows):
        return out
    miss = np.stack((rows['miss_x'], rows['miss_y']))[:, ~bad]
    miss = miss[:, np.isfinite(miss).all(axis=0)]
    if miss.shape[1] < _FEW:
        return out
    sigma = float(sigma_of(miss - np.median(miss, axis=1, keepdims=True), axis=1).max())
    if sigma >= AIR:
        return out
    return [*out, f'miss distances of {miss.shape[1]} observations scatter by only '
            f'{sigma / ARCSEC:.2f} arcsec, less than image motion by seeing '
            f'({AIR / ARCSEC:.1f}): check that the camera measures at all']


def contradiction(rows, report=None):
    """Why a model is not to be published; '' if it may be.

    Parameters
    ----------
    rows : PointingRun
        All observations of the night: see `distrusted`.
    report : dict, optional
        Of the fit, as `CalibrationState.fit` makes it; None before there is one.

    Returns
    -------
    str
        One sentence.
    """
    share = float(np.mean(distrusted(rows))) if len(rows) else 0.0
    if share > MOST_DISTRUSTED:
        return f'not published: {reasons(rows)[0]}'
    alarms = report['witnesses']['alarms'] if report else ()
    if not alarms:
        return ''
    held_out = report['steps'][-1]['held_out']['radial']
    noise = float(np.hypot(*report['noise_arcsec']))
    if held_out <= CONTRADICTED * noise:
        return ''
    return (f'not published: it leaves {held_out:.0f} arcsec on stars held out, where the noise is '
            f'{noise:.1f}, and the cross-check of the encoders says why: {alarms[0]}')
