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

"""Offset between the clocks of camera and encoder, from one star while the axes drift across it.

The image of a star is stamped T + late by the camera, and the encoder reading of T + late is used:
it is off by the axis rate times `late`. If every star is tracked, this equals a clock error of the
sky (for an alt-azimuth mount exactly IA + AW), which no pointing run can detect. It shows if
the axes drift past a star at different known rates: readings at the same place then differ by
`late` times the difference of the rates.
"""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.rms import sigma_of

from .axis_demand import Pointing

#: exposures per leg; legs go back and forth, without jumps in between
LEG = 2
#: fractions of the full rate: with two speeds an effect of the direction alone (backlash, friction)
#: is not mistaken for a delay
SHARES = 1.0, 0.2
#: directions of both axes for pairs of legs: all four
SENSES = ((1, 1), (-1, -1), (1, -1), (-1, 1))
#: beyond this distance from the star a leg leads back to it, rad
FARTHEST = 240.0 * ARCSEC
#: largest trail of a star within an exposure, arcsec
TRAIL = 30.0
#: least number of exposures for the fit
LEAST = 12
#: exposures with residuals beyond this multiple of the scatter are outliers
OUTLIER = 4.0
#: significance (multiple of sigma) and size (s) above which clocks are reported as off
SIGMAS, WORTH = 4.0, 0.02


class Drifting(Pointing):
    """A star past which the axes drift.

    Parameters
    ----------
    pointing : Pointing
        Pointing at the star, centred.
    start : int
        ns.
    place, rate : ndarray, shape (2,)
        Offset from the star at `start`, on the sky (rad), and its rate (rad/s).
    """

    def __init__(self, pointing, start, place, rate):
        self.__dict__.update(vars(pointing))
        self._star, self._start, self._place, self._rate = pointing, start, place, rate

    def beside(self, stamps):
        """Intended offset of the boresight from the star, on the sky, rad, shape (n, 2)."""
        return self._place + np.multiply.outer((stamps - self._start) * 1e-9, self._rate)

    def demand(self, stamps, conditions):
        """Encoder angles (n, 2), rad, at each stamp (n,), ns."""
        star = self._star.demand(stamps, conditions)
        beside = self.beside(stamps)
        return star + np.column_stack([beside[:, 0] / np.cos(star[:, 1]), beside[:, 1]])


def legs(count, full):
    """Rates relative to the star, for each exposure.

    Parameters
    ----------
    count : int
    full : float
        Full rate of an axis, rad/s.

    Returns
    -------
    ndarray, shape (count, 2)
    """
    leg = np.arange(count) // LEG
    senses = np.array(SENSES)[leg // len(SHARES) % len(SENSES)]
    # each speed goes back and forth before the other, so the axes stay near the star
    shares = np.array(SHARES)[leg // (len(SHARES) * len(SENSES) // 2) % len(SHARES)]
    to_and_fro = np.where(leg % 2, -1.0, 1.0)
    return full * (shares * to_and_fro)[:, np.newaxis] * senses


def rate_for(exposure, full):
    """Largest rate that does not trail a star too far in an exposure.

    Parameters
    ----------
    exposure : float
        s.
    full : float
        arcsec/s.

    Returns
    -------
    float
        rad/s.
    """
    return min(full, TRAIL / max(exposure, 1e-3)) * ARCSEC


def row_of(stamp, rate, sense, miss, beside):
    """An exposure as a list of numbers, for `offset_of` and the log.

    Parameters
    ----------
    stamp : int
        ns.
    rate : ndarray, shape (2,)
        Rates of the axes relative to the star, on the sky, rad/s.
    sense : ndarray, shape (2,)
        Direction in which the axes turned.
    miss : ndarray, shape (2,)
        Miss distance, rad.
    beside : ndarray, shape (2,)
        Centred reading minus demand of the star, on the sky, rad.
    """
    return [int(stamp), *(float(v) for part in (rate, sense, miss, beside) for v in part)]


def offset_of(exposures):
    """Clock offset by least squares.

    Also fitted are the place of the star and its drift, scale, rotation and shear of the camera,
    and an offset by the direction of each axis.

    Parameters
    ----------
    exposures : list of list
        Lists from `row_of`.

    Returns
    -------
    dict or None
        ``offset_s``: delay of the camera's stamps; ``sigma_s``: its standard error;
        ``exposures``: number used; ``noise_arcsec``: scatter of one exposure per axis. None if
        there are too few.
    """
    rows = np.array([row[1:] for row in exposures], float).reshape(-1, 8)
    stamps = np.array([row[0] for row in exposures], np.int64)
    used = np.isfinite(rows).all(axis=1)
    while True:
        if used.sum() < LEAST:
            return None
        found = _solve(stamps[used], rows[used])
        if found is None:
            return None
        offset, sigma, left, free = found
        scatter = sigma_of(left) * np.sqrt(len(left) / free)
        off = np.hypot(*left.reshape(2, -1))
        worst = int(np.argmax(off))  # one at a time, since it biases the others
        if off[worst] <= OUTLIER * max(scatter, 1e-3 * ARCSEC) or used.sum() <= 0.75 * len(used):
            break
        used[np.flatnonzero(used)[worst]] = False
    noise = np.sqrt(np.sum(left**2) / free)
    return {'offset_s': float(offset), 'sigma_s': float(sigma), 'exposures': int(used.sum()),
            'noise_arcsec': float(noise / ARCSEC)}


def _solve(stamps, rows):
    rate, sense, miss, beside = rows[:, :2], rows[:, 2:4], rows[:, 4:6], rows[:, 6:]
    count = len(rows)
    one = np.ones(count)
    time = (stamps - stamps[0]) * 1e-9
    columns = []
    for axis in (0, 1):
        # for an axis that always turned the same way the direction is part of the constant
        turned = sense[:, axis] - sense[:, axis].mean()
        for part in (one, time - time.mean(), miss[:, 0], miss[:, 1], turned):
            column = np.zeros((2, count))
            column[axis] = part
            columns.append(column.ravel())
    design = np.column_stack([rate.T.ravel(), *columns])
    size = np.linalg.norm(design, axis=0)
    design, size = design[:, size > 0.0] / size[size > 0.0], size[size > 0.0]
    answer, _, rank, _ = np.linalg.lstsq(design, beside.T.ravel(), rcond=1e-7)
    free = 2 * count - rank
    if rank < design.shape[1] or free < 2:
        return None
    left = beside.T.ravel() - design @ answer
    inverse = np.linalg.inv(design.T @ design)
    sigma = np.sqrt(np.sum(left**2) / free * inverse[0, 0]) / size[0]
    return answer[0] / size[0], sigma, left, free


def sentence(found, late=0.0, second=None):
    """Result of the clock measurement, and what to do.

    Parameters
    ----------
    found : dict or None
        Result of `offset_of`.
    late : float
        Delay already subtracted from the camera's stamps, s.
    second : dict, optional
        The offset against the absolute encoder.

    Returns
    -------
    str
    """
    if found is None:
        return 'clocks of camera and encoder: too few exposures for their offset'
    offset, sigma = found['offset_s'], found['sigma_s']
    other = '' if second is None else (
        f' ({second["offset_s"]:+.3f} ± {second["sigma_s"]:.3f} s against the absolute one)')
    if not is_off(found):
        return f'clocks of camera and encoder agree: {offset:+.3f} ± {sigma:.3f} s{other}'
    word = 'late' if offset > 0.0 else 'early'
    return (f"the camera's stamps are {abs(offset):.3f} ± {sigma:.3f} s {word} against the "
            f"encoder's{other}: mend the clock that is off, or set camera_late_s of star_observer "
            f'to {late + offset:.3f}')


def is_off(found):
    """Whether an offset is significant."""
    return found is not None and abs(found['offset_s']) > max(
        SIGMAS * found['sigma_s'], WORTH)
