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

"""Camera faults found from the rows alone: no measurement, or axes rotated during the night.

For an image that is rotated, mirrored or has exchanged axes: the observer corrects the pointing by
the miss distances of earlier stars. If the camera measures C d for a star at d from the boresight,
a row is off by (I - C^-1) m, m being the measured miss distance: by 2 m on a mirrored axis. A sound
camera has no such rows: its miss distance is part of the encoder angle of the row, and at most half
of it remains in the residual, for the other half was carried over from the star before.
"""

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.pointing_terms import stacked_design
from pointing_model.rms import sigma_of

#: I - C^-1 of the tested faults: mirrored, upside down, exchanged, rotated, half the scale
SENSES = {
    'x mirrored': ((2, 0), (0, 0)),
    'y mirrored': ((0, 0), (0, 2)),
    'x and y mirrored': ((2, 0), (0, 2)),
    'x and y exchanged': ((1, -1), (-1, 1)),
    'x and y exchanged and mirrored': ((1, 1), (1, 1)),
    'turned by 90 deg': ((1, -1), (1, 1)),
    'turned by -90 deg': ((1, 1), (-1, 1)),
    'half the scale': ((-1, 0), (0, -1)),
}
#: successive rows whose miss distances agree this closely are of a frozen camera; a camera of 1"
#: noise makes such a series with a probability of 3e-16, one of 0.05" with 3e-8
SAME_ROWS, SAME_WITHIN = 4, 0.005 * ARCSEC
#: successive exposures with identical miss distances, to the last bit, of a frozen camera
SAME_FRAMES = 6
#: fewest rows tested, and fewest rows reported as wrong
LEAST, FEWEST = 12, 2
#: reduction of chi-squared needed for a rotated camera; one row contributes at most the square of
#: `CAP`, so that a misidentified star does not decide
GAIN, CAP = 50.0, 6.0
#: except a row beyond the first limit (in sigmas) without the fault and within the second with it,
#: which suffices alone
CLEAR, EXPLAINED = 12.0, 3.0
#: least noise of an axis, rad
LEAST_NOISE = 0.2 * ARCSEC
#: rows tested together (windows overlap by half), if the largest miss distance is this many times
#: the median
LOOK, GROWN = 100, 2.5
#: most searches in a window, each without the rows found before
LOOKS = 4


def turned_rows(rows):
    """Rows whose miss distances are of a rotated or mirrored camera.

    Parameters
    ----------
    rows : PointingRun
        In the order in which they were taken, with ``miss_x``, ``miss_y`` and ``run``.

    Returns
    -------
    wrong : ndarray of bool, shape (n,)
    sense : str
        Fault in the last of them, of `SENSES`; '' if none.
    """
    n = len(rows)
    wrong, sense = np.zeros(n, bool), ''
    off = np.hypot(rows['miss_x'], rows['miss_y'])
    for begin in range(0, max(n - LOOK // 2, 1), LOOK // 2):
        part = np.arange(begin, min(begin + LOOK, n))
        there = off[part][np.isfinite(off[part])]
        # the error of a rotated camera is carried over to the next star, and grows
        if len(there) >= LEAST and there.max() > GROWN * np.median(there):
            found, name = _turned_of(rows.select(part))
            wrong[part] |= found
            sense = name or sense
    return wrong, sense


def _turned_of(rows):
    """`turned_rows` in one window."""
    wrong, sense = np.zeros(len(rows), bool), ''
    miss = np.stack((rows['miss_x'], rows['miss_y']))
    left = _left(rows, np.isfinite(miss).all(axis=0))
    for _ in range(LOOKS):
        found = None if left is None else _best(left(wrong), miss, wrong)
        if found is None:
            break
        begin, end, name = found
        if wrong[begin:end].all() and name == sense:
            break  # the same result again
        wrong, sense = np.zeros(len(rows), bool), name
        wrong[begin:end] = True
    return wrong, sense


def rotation(rows):
    """Angle by which a camera is rotated against the axes, and its standard error.

    An angle f, positive from x to y, leaves sin f (-m_y, m_x) of a miss distance m in a row.
    Neither noise nor what the terms lack does so: they are in m and in the residual alike, and
    their product cancels.

    Parameters
    ----------
    rows : PointingRun
        With ``miss_x``, ``miss_y`` and ``run``, of a camera that is not mirrored.

    Returns
    -------
    angle, sigma : float
        rad; NaN where there are too few rows.
    """
    x, y = rows['miss_x'], rows['miss_y']
    terms = _terms(rows, np.isfinite(x + y))
    if terms is None:
        return np.nan, np.nan
    known, columns, offsets = terms
    columns = np.column_stack((columns, np.where(np.tile(known, 2), np.append(-y, x), 0.0)))
    out, found, weights = _robust(columns, offsets, known)
    scatter = np.sum(weights * out**2) / max(weights.sum() - columns.shape[1], 1.0)
    covariance = np.linalg.pinv((columns.T * weights) @ columns, rcond=1e-12, hermitian=True)
    angle = np.arcsin(np.clip(found[-1], -1.0, 1.0))
    return float(angle), float(np.sqrt(scatter * covariance[-1, -1]))


def _left(rows, known):
    """Function ``left(wrong)``: residuals of all rows, terms fitted without `wrong`; or None."""
    terms = _terms(rows, known)
    if terms is None:
        return None
    known, columns, offsets = terms

    def left(wrong):
        out, _, _ = _robust(columns, offsets, known & ~wrong)
        return np.where(known, out.reshape(2, -1), np.nan)
    return left


def _terms(rows, known):
    """Usable rows, columns of the terms and zeros, and offsets, rad; None if rows are too few."""
    places = np.stack((rows['az'], rows['el']))
    known &= np.isfinite(places).all(axis=0) & np.isfinite(rows['az_enc'] + rows['el_enc'])
    if known.sum() < LEAST:
        return None
    mount, (first, second) = rows.mount, np.where(known, places, 0.0)
    cosine = np.cos(second)
    columns = [*stacked_design(mount.names.physical, first, second, mount)]
    for number in np.unique(rows['run'])[1:]:  # each power-on has its own zero
        own, none = rows['run'] == number, np.zeros(len(rows))
        columns += [np.append(own * cosine, none), np.append(none, own)]
    return known, np.array(columns).T, np.append(
        wrap(rows['az_enc'] - first) * cosine, rows['el_enc'] - second)


def _robust(columns, offsets, used):
    """Residuals of a fit to the rows `used`, coefficients and weights; for misidentified stars."""
    used = np.tile(used, 2)
    weights = used.astype(float)
    for _ in range(5):
        root = np.sqrt(weights)
        found = np.linalg.lstsq(columns * root[:, np.newaxis],
                                np.where(used, offsets, 0.0) * root, rcond=1e-6)[0]
        out = offsets - columns @ found
        far = np.hypot(*out.reshape(2, -1)) / max(_noise(out[used]), LEAST_NOISE)
        weights = np.where(used, np.tile((1.0 - np.minimum(far / 6.0, 1.0)**2)**2, 2), 0.0)
    return out, found, weights


def _noise(left):
    """Robust 1 sigma of an axis."""
    return float(sigma_of(left)) if left.size else 0.0


def _best(left, miss, wrong):
    """Begin, end and fault of the stretch that a rotated camera explains best; or None."""
    kept = np.isfinite(left[0]) & ~wrong
    if kept.sum() < LEAST // 2:
        return None
    noise = max(_noise(left[:, kept]), LEAST_NOISE)
    off = np.array(list(SENSES.values()), float) @ miss  # of each sense, (2, n)
    plain = np.nan_to_num(np.hypot(*left) / noise)
    turned = np.nan_to_num(np.hypot(*np.moveaxis(left - off, 1, 0)) / noise)
    gain = np.minimum(plain, CAP)**2 - np.minimum(turned, CAP)**2
    explained = turned < EXPLAINED
    gain[(plain > CLEAR) & explained] = 1.2 * GAIN
    gain[(plain > EXPLAINED) & ~explained] = -EXPLAINED**2  # another cause
    total = np.zeros((len(gain), left.shape[1] + 1))
    np.cumsum(gain, axis=1, out=total[:, 1:])
    rise = total - np.minimum.accumulate(total, axis=1)
    best, found = GAIN, None
    for name, whole, own, end in zip(SENSES, total, rise, np.argmax(rise, axis=1)):
        begin = int(np.argmin(whole[:end])) if end else 0
        if end - begin >= FEWEST and own[end] > best:
            best, found = own[end], (begin, int(end), name)
    return found


def frozen_rows(miss_x, miss_y):
    """Rows of a frozen camera: miss distances with too little scatter.

    Parameters
    ----------
    miss_x, miss_y : array_like, shape (n,)
        Miss distances in the order in which rows were taken, rad; NaN where unknown.

    Returns
    -------
    ndarray of bool, shape (n,)
        True in stretches of at least `SAME_ROWS` rows, each within `SAME_WITHIN` of the one
        before.
    """
    x, y = (np.asarray(v, float) for v in (miss_x, miss_y))
    with np.errstate(invalid='ignore'):
        same = (np.abs(np.diff(x)) <= SAME_WITHIN) & (np.abs(np.diff(y)) <= SAME_WITHIN)
    stretch = np.append(0, np.cumsum(~same))[:len(x)]
    return np.bincount(stretch)[stretch] >= SAME_ROWS
