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

"""Observations rejected for instrument faults, and models not published for contradictions."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.rms import sigma_of

from .analysis.camera_faults import SAME_ROWS, frozen_rows, rotation, turned_rows

#: if more than this part of the observations is faulty, none is used
MOST_DISTRUSTED = 1.0 / 3.0
#: RMS on held-out stars, over the noise of the fit, above which a model with an alarm is not
#: published
CONTRADICTED = 10.0

TURNED_CAMERA = 'what the camera measured fits the pointing with {} alone'
FROZEN_CAMERA = 'the camera said the same miss distance in {} observations in a row or more'
#: sigmas of a rotation that is reported; what the terms lack makes larger ones than noise, by 1.2
_ROTATED = 5.0
#: fewest rows whose scatter is meaningful
_FEW = 8
#: least noise of a centroid from seeing, 1 sigma of an axis, rad: image motion in short exposures
#: in seeing of 0.8" (r0 = 126 mm) through 4 m, 0.42 wavelength D^(-1/6) r0^(-5/6)
#: (Martin 1987, PASP 99, 1360). Smaller telescopes have more; exposures of many seconds less.
AIR = 0.2 * ARCSEC


def distrusted(rows):
    """Rows falsified by an instrument fault, as its own readings show.

    Parameters
    ----------
    rows : PointingRun
        In the order in which they were taken. Only rows of an observer, with the column
        ``encoder_start``, are tested: in a file a zero may mean "not measured".

    Returns
    -------
    ndarray of bool, shape (n,)
        True for rows of a camera that was frozen, or mirrored or rotated during the night.
    """
    return np.logical_or.reduce([np.zeros(len(rows), bool), *(bad for bad, _ in _faults(rows))])


def _is_of_observer(rows):
    return all(name in rows for name in ('encoder_start', 'miss_x', 'miss_y'))


def _faults(rows):
    """Masks of the rows falsified by an instrument, and the fault, in words."""
    if not _is_of_observer(rows):
        return []
    frozen = frozen_rows(rows['miss_x'], rows['miss_y'])
    out = [(frozen, FROZEN_CAMERA.format(SAME_ROWS))]
    if 'run' in rows:
        turned = np.zeros(len(rows), bool)
        # not satellites: their orbital elements are in error
        stars = np.flatnonzero((np.asarray(rows.get('star', turned)) >= 0) & ~frozen)
        turned[stars], sense = turned_rows(rows.select(stars))
        out.append((turned, TURNED_CAMERA.format(sense)))
    return out


def reasons(rows):
    """Why rows are `distrusted`, sentences; empty where all can be used."""
    return [f'{len(bad)} of {len(rows)} observations left out, rows {bad[0]} to {bad[-1]}: {why}'
            for bad, why in ((np.flatnonzero(mask), why) for mask, why in _faults(rows))
            if len(bad)]


def notes_of(rows):
    """`reasons`, and notes on a rotated camera, and on miss distances that scatter too little.

    A camera that always reports about the same makes a fit look too good: the fit returns the model
    by which the mount was pointed, with residuals as small as the noise of the encoders. Long
    exposures in steady air may scatter as little, so the rows are used, and the note is given.

    Parameters
    ----------
    rows : PointingRun
        See `distrusted`.

    Returns
    -------
    list of str
        Sentences; may be empty.
    """
    out, bad = reasons(rows), distrusted(rows)
    if not _is_of_observer(rows):
        return out
    miss = np.stack((rows['miss_x'], rows['miss_y']))
    used = ~bad & np.isfinite(miss).all(axis=0)
    miss = miss[:, used]
    if 'run' in rows:
        stars = used & (np.asarray(rows.get('star', used)) >= 0)
        out += _rotated(rows.select(np.flatnonzero(stars)))
    if miss.shape[1] < _FEW:
        return out
    sigma = float(sigma_of(miss - np.median(miss, axis=1, keepdims=True), axis=1).max())
    if sigma >= AIR:
        return out
    return [*out, f'miss distances of {miss.shape[1]} observations scatter by only '
            f'{sigma / ARCSEC:.2f} arcsec, less than image motion by seeing '
            f'({AIR / ARCSEC:.1f}): check that the camera measures at all']


def _rotated(rows):
    """A note on a camera whose axes are rotated against those of the mount, as a list."""
    angle, sigma = rotation(rows)
    if not abs(angle) > _ROTATED * sigma:
        return []
    largest = float(np.hypot(rows['miss_x'], rows['miss_y']).max())
    return [f'the camera is rotated by {angle / DEG:+.1f} ± {sigma / DEG:.1f} deg against the axes '
            f'(from x, right, to y, up): rows are off by up to {abs(angle) * largest / ARCSEC:.1f} '
            'arcsec. Rotate its x and y in the driver']


def contradiction(rows, report=None):
    """Reason not to publish a model; '' if there is none.

    Parameters
    ----------
    rows : PointingRun
        All observations of the night: see `distrusted`.
    report : dict, optional
        Report of the fit, see `CalibrationState.fit`; None before the fit.

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
