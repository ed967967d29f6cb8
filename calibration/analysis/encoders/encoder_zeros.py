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

"""Zeros of both encoders against the sky in each power-on, and what moved between power-ons.

The sky is Polaris, or stars that were exposed for a zero. Stars are at other positions, where the
disc errors of an encoder differ, which is no change. So two power-ons are compared with the stars
exposed in both, each with the same weight however often it was exposed.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from msg_tools.units import wrap
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import design
from pointing_model.rms import sigma_of
from pointing_model.zero import BY_POLARIS, BY_STARS, is_marked

from ...estimation.robust import bisquare
from ...estimation.step_scan import (
    clipped,
    evidence,
    log_normal,
    probabilities,
    robust_fit,
    two_sided,
)
from ..zero.power_on_zeros import zero_from_exposures
from .cross_check_rows import (
    ABSOLUTE,
    ALIKE,
    AXES,
    BOTH,
    FEWEST_STARS,
    INCREMENTAL,
    LEAST,
    MOUNT,
    NOTHING,
    OTHERS,
    SHORT,
)

#: fewest common stars to compare two power-ons
_FEWEST_COMMON = 3
_FEWEST_EXPOSURES = 4
#: rad, prior sigma of terms common to both hypotheses, wider than those of any mount: the evidence
#: ratio does not depend on it
_ANYTHING = np.radians(1.0)


@dataclass(frozen=True)
class EncoderZeros:
    """Zeros of both encoders at Polaris, or some stars, in a power-on.

    Attributes
    ----------
    run : float
        See `CrossCheckNight.interval`.
    az, el : float
        Mean position of Polaris, rad.
    incremental, absolute : ndarray, shape (2,)
        Encoder - sky at Polaris, azimuth and elevation, coordinate angles, rad.
    covariance : ndarray, shape (2, 2, 2)
        Covariance of both for each axis, rad^2: they share the star's noise.
    difference, difference_sigma : ndarray, shape (2,)
        Incremental - absolute at that position, from all rows of the power-on, and 1 sigma, rad.
    exposures : int
        Number of exposures of Polaris; effective number if they are correlated.
    stars : tuple of ndarray, optional
        If stars were exposed in place of Polaris: azimuth and elevation of each (s,), rad, and the
        weights (2, s) of their on-sky offsets in `incremental` and `absolute`.
    """

    run: float
    az: float
    el: float
    incremental: np.ndarray
    absolute: np.ndarray
    covariance: np.ndarray
    difference: np.ndarray
    difference_sigma: np.ndarray
    exposures: int
    stars: tuple | None = None

    def mean(self, offsets):
        """Weighted mean, as coordinate angles, of ``offsets(az, el)`` on the sky.

        The function returns (s,) or (s, k) for each axis.
        """
        if self.stars is None:
            x, y = offsets(np.array([self.az]), np.array([self.el]))
            return np.stack([x[0] / np.cos(self.el), y[0]])
        az, el, weights = self.stars
        return np.einsum('as,as...->a...', weights, np.stack(offsets(az, el)))


@dataclass(frozen=True)
class StarOffsets:
    """Exposures of stars for the zero of a power-on, averaged per star.

    Attributes
    ----------
    run : float
        See `CrossCheckNight.interval`.
    star : ndarray, shape (s,)
        Numbers, ascending.
    az, el : ndarray, shape (s,)
        Mean catalogue position, rad.
    offsets : ndarray, shape (2, 2, s)
        Encoder - catalogue on the sky, rad: incremental and absolute, x and y.
    noise : ndarray, shape (2, 2)
        1 sigma of an exposure: incremental and absolute, by axis; enlarged for their correlation.
    difference : ndarray, shape (2, s)
        Incremental - absolute, coordinate angles, rad.
    difference_noise : ndarray, shape (2,)
        1 sigma of an exposure, by axis.
    count : ndarray, shape (s,)
        Number of exposures used.
    """

    run: float
    star: np.ndarray
    az: np.ndarray
    el: np.ndarray
    offsets: np.ndarray
    noise: np.ndarray
    difference: np.ndarray
    difference_noise: np.ndarray
    count: np.ndarray

    def zeros(self, stars):
        """EncoderZeros from some of the stars."""
        at = np.isin(self.star, stars)
        el, count = self.el[at], self.count[at]
        weights = np.stack([np.cos(el) / np.sum(np.cos(el) ** 2), np.full(len(el), 1 / len(el))])
        angles = np.einsum('as,eas->ea', weights, self.offsets[:, :, at])
        # the difference of coordinate angles, with the weights of the zero
        own = weights * np.stack([np.cos(el), np.ones(len(el))])
        variance = np.square(self.noise) * np.sum(np.square(weights) / count, axis=1)
        between = np.square(self.difference_noise) * np.sum(np.square(own) / count, axis=1)
        return EncoderZeros(
            self.run, _mean_azimuth(self.az[at]), float(el.mean()), *angles,
            np.array([_covariance(*variance[:, axis], between[axis]) for axis in (0, 1)]),
            np.sum(own * self.difference[:, at], axis=1), np.sqrt(between),
            max(int(count.sum()), 2), (self.az[at], el, weights))


def _mean_azimuth(az):
    return float(np.arctan2(np.sin(az).mean(), np.cos(az).mean()))


def _covariance(incremental, absolute, between):
    """Covariance matrix of two readings whose difference has the variance `between`."""
    most = np.sqrt(incremental * absolute)
    both = float(np.clip(0.5 * (incremental + absolute - between), -most, most))
    return np.array([[incremental, both], [both, absolute]])


def inflation(rho, count):
    """Factor by which the variance of the mean of `count` consecutive rows exceeds scatter / n.

    Exact for AR(1) noise (Priestley 1981, Spectral Analysis and Time Series, section 5.3.2).
    """
    if rho <= 0.0 or count < 2:
        return 1.0
    mean = (1.0 + rho) / (1.0 - rho) - 2.0 * rho * (1.0 - rho**count) / (count * (1.0 - rho) ** 2)
    return mean * (count - 1.0) / max(count - mean, 1.0)


def power_on_zeros(night, noise, model=None):
    """Zeros of each power-on: EncoderZeros from Polaris, or StarOffsets from stars.

    Parameters
    ----------
    night : CrossCheckNight
    noise : NightNoise
    model : PointingModel, optional
        Used only to reject wild exposures of stars; without it all are used.
    """
    out = []
    for interval in np.unique(night.interval):
        rows = night.interval == interval
        part = night.rows.select(rows & night.for_zero)
        if len(part) < 2:
            continue
        if is_marked(part).any():
            stars = star_offsets(float(interval), part.select(is_marked(part)), model, noise.sky)
            out += [stars] if stars is not None else []
            continue
        out.append(_zeros_by_polaris(night, float(interval), rows, part, noise))
    return out


def _zeros_by_polaris(night, interval, rows, part, noise):
    """EncoderZeros of a power-on; `rows`: mask of its rows, `part`: its exposures of Polaris."""
    zeros = [zero_from_exposures(part, PointingModel({}, mount=night.mount), encoder=encoder)
             for encoder in ('enc', 'abs')]
    place = _mean_azimuth(part['az']), float(part['el'].mean())
    difference = np.array([difference_at(night, axis, rows, place[axis], noise)
                           for axis in (0, 1)])
    count = min(zero.n for zero in zeros)
    more = np.array([[inflation(rho, count) for rho in both] for both in noise.sky])
    between = np.var(night.difference[:, rows & night.for_zero], axis=1, ddof=1) / len(part)
    covariance = [_covariance(*(zero.covariance[axis, axis] for zero in zeros), between[axis])
                  * np.sqrt(np.outer(more[axis], more[axis])) for axis in (0, 1)]
    return EncoderZeros(interval, *place, *(zero.angles for zero in zeros), np.array(covariance),
                        *difference.T, max(int(count / more.max()), 2))


def difference_at(night, axis, rows, place, noise):
    """Incremental - absolute at a position, from all `rows` (a mask) of a power-on; and 1 sigma."""
    angle = night.rows[SHORT[axis]][rows]
    columns, at = [np.ones(len(angle))], [1.0]
    if np.count_nonzero(rows & ~night.for_zero) >= FEWEST_STARS:
        columns += [np.cos(angle), np.sin(angle)]
        at += [np.cos(place), np.sin(place)]
    own = noise.difference[axis].rows(np.flatnonzero(rows))
    fit = robust_fit(own.whiten(np.array(columns)).T, own.whiten(night.difference[axis][rows]))
    return float(fit.coefficients @ at), float(np.sqrt(at @ fit.covariance @ at))


def star_offsets(run, rows, model, correlation):
    """The exposures of stars for the zero of a power-on.

    Parameters
    ----------
    run : float
    rows : PointingRun
        The exposures, finite, with both encoders.
    model : PointingModel or None
    correlation : ndarray, shape (2, 2)
        See `NightNoise.sky`.

    Returns
    -------
    StarOffsets or None
        None if there are too few.
    """
    if len(rows) < _FEWEST_EXPOSURES:
        return None
    if model is not None:
        left = np.array(model.residuals(rows))
        left = left - np.median(left, axis=1, keepdims=True)
        scale = np.maximum(sigma_of(left, axis=1), 1e-12)[:, None]
        rows = rows.select(bisquare(np.hypot(*(left / scale))) > 0.0)
    star, member, count = np.unique(rows['star'], return_inverse=True, return_counts=True)
    free = len(rows) - len(star)
    if free < 1:
        return None

    def mean(values):
        return np.stack([np.bincount(member, v) / count for v in values])

    def scatter(values):
        return np.sqrt(np.sum(np.square(values - mean(values)[:, member]), axis=1) / free)
    offsets = [np.stack(rows.offsets(encoder)) for encoder in ('enc', 'abs')]
    difference = np.stack([wrap(rows[f'{axis}_enc'] - rows[f'{axis}_abs']) for axis in SHORT])
    more = np.array([[inflation(rho, len(rows)) for rho in both] for both in correlation])
    # the mean of unit vectors is safe: azimuths of one star are not half a turn apart
    az = np.arctan2(*mean((np.sin(rows['az']), np.cos(rows['az']))))
    return StarOffsets(
        run, star, az, mean((rows['el'],))[0], np.stack([mean(v) for v in offsets]),
        np.stack([scatter(v) for v in offsets]) * np.sqrt(more.T), mean(difference),
        scatter(difference), count)


def comparable(before, now):
    """EncoderZeros of two power-ons, from the stars that they have in common.

    Parameters
    ----------
    before, now : EncoderZeros or StarOffsets

    Raises
    ------
    ValueError
        They have too few in common; the message gives the reason.
    """
    by_stars = [isinstance(one, StarOffsets) for one in (before, now)]
    if not any(by_stars):
        return before, now
    if not all(by_stars):
        raise ValueError('one has a zero by Polaris, the other by stars')
    both = np.intersect1d(before.star, now.star)
    if len(both) < _FEWEST_COMMON:
        raise ValueError('they have zeros by other stars')
    return before.zeros(both), now.zeros(both)


@dataclass(frozen=True)
class ZeroShift:
    """Changes on an axis from one power-on (or night) to the next, rad.

    `incremental` and `absolute` are relative to the sky at Polaris, `difference` is incremental -
    absolute. `pull` is the absolute encoder's change divided by its expected sigma (noise and usual
    changes of the encoder), i.e. the disagreement of the zeros from Polaris and from the absolute
    encoder. `moved`: posterior probabilities if something other than the incremental encoder moved.
    `causes`: probabilities regardless of an alarm, and `cause` the most likely one consistent with
    it. `by`: whether the sky is Polaris or stars.
    """

    axis: str
    since: float
    run: float
    incremental: float
    incremental_sigma: float
    absolute: float
    absolute_sigma: float
    difference: float
    difference_sigma: float
    pull: float
    probability: float
    alarm: bool
    moved: dict
    cause: str
    causes: dict
    by: str = BY_POLARIS


def zero_shift(night, axis, before, now, model, budget, tests, sky):
    """`ZeroShift` of an axis between two power-ons.

    Parameters
    ----------
    night : CrossCheckNight
    axis : {0, 1}
    before, now : EncoderZeros
    model : PointingModel or None
        Corrects for their different positions; None: the terms of the budget widen the errors.
    budget : Budget
    tests : int
        Number of tests, for the Bonferroni correction.
    sky : SkyResiduals or None
    """
    between, extra = _between_places(before, now, model, budget.term, night.mount)
    zeros = np.array([now.incremental[axis] - before.incremental[axis],
                      now.absolute[axis] - before.absolute[axis]])
    incremental, absolute = (wrap(zeros) if axis == 0 else zeros) - between[axis]
    covariance = before.covariance[axis] + now.covariance[axis] + extra[axis]
    difference = wrap(now.difference[axis] - before.difference[axis])
    difference_variance = now.difference_sigma[axis] ** 2 + before.difference_sigma[axis] ** 2
    noise = covariance[1, 1]
    expected = np.sqrt(noise + budget.absolute**2)
    freedom = max(before.exposures + now.exposures - 2, 1)
    with np.errstate(divide='ignore'):  # without any noise the sigma is known exactly
        freedom *= (expected**2 / noise) ** 2  # Welch: only the noise was estimated
    p = float(two_sided(absolute / expected, freedom)) * tests
    alarm = p < budget.false_alarm
    causes = cause_probabilities(difference, difference_variance, absolute, noise, budget.anomaly,
                                 budget.absolute)
    cause = max((ABSOLUTE, BOTH, ALIKE) if alarm else (NOTHING, INCREMENTAL), key=causes.get)
    moved = {}
    if alarm:
        usual = budget.power_on**2
        # if only the absolute encoder moved, incremental - sky shows a usual change; if the mount
        # moved, incremental - absolute does
        moved, tilt = _suspects(
            night, axis, before, now, budget, sky,
            log_normal(incremental, covariance[0, 0] + usual),
            log_normal(difference, difference_variance + usual + budget.absolute**2))
        cause = MOUNT if tilt > 0.5 else cause
    return ZeroShift(
        AXES[axis], before.run, now.run, float(incremental), float(np.sqrt(covariance[0, 0])),
        float(absolute), float(np.sqrt(noise)), float(difference),
        float(np.sqrt(difference_variance)), float(absolute / expected), min(p, 1.0), bool(alarm),
        moved, cause, causes, BY_POLARIS if now.stars is None else BY_STARS)


def _between_places(before, now, model, term_sigma, mount):
    """Difference of the offset between two positions of Polaris, or stars, (2,); its covariance."""
    if model is not None:
        between = now.mean(model.offsets) - before.mean(model.offsets)
        names, spread = tuple(model.terms), model.covariance
    else:
        between, names = np.zeros(2), mount.names.physical[OTHERS]
        spread = np.eye(len(names)) * term_sigma**2
    columns = partial(design, names, mount=mount)
    moved = now.mean(columns) - before.mean(columns)
    return between, np.diag(moved @ spread @ moved.T)


def _suspects(night, axis, before, now, budget, sky, alone, together):
    """Posterior probabilities that the absolute encoder or the mount moved, and of a mount tilt.

    `alone`, `together`: log evidence of the two from the zeros.
    """
    logs = {ABSOLUTE: alone, MOUNT: together + np.log(0.5), 'tilt': together + np.log(0.5)}
    stars = [np.count_nonzero((night.interval == one.run) & ~night.for_zero)
             for one in (before, now)]
    if sky is not None and min(stars) >= FEWEST_STARS:
        rows = np.tile(np.isin(night.interval, (before.run, now.run)), 2)
        after = (night.interval == now.run).astype(float)
        later = sky.terms * np.tile(after, 2)[:, None]
        fixed = np.column_stack([sky.terms, *(
            night.on_sky(k, column) for column in (np.ones(len(after)), after) for k in (0, 1))])
        y = clipped(np.column_stack([fixed, later]), sky.absolute)[rows]
        # the other axis may have moved as well
        wide, width = [_ANYTHING] * 7, [budget.anomaly] * 2
        slip = evidence(fixed[rows], y, sky.noise, [*wide, *width])
        logs[ABSOLUTE] += slip
        logs[MOUNT] += slip  # a turn about the axis itself looks like a slip of both encoders
        width[axis] = budget.absolute
        logs['tilt'] += evidence(np.column_stack([fixed, later])[rows], y, sky.noise,
                                 [*wide, *width, *[budget.anomaly] * sky.terms.shape[1]])
    out = probabilities(logs)
    return {ABSOLUTE: out[ABSOLUTE], MOUNT: out[MOUNT] + out['tilt']}, out['tilt']


def cause_probabilities(difference, difference_variance, absolute, absolute_variance, size,
                        quiet=0.0):
    """Posterior probability of each cause of a jump at a power-on, with equal priors.

    Two differences are measured: incremental - absolute, I - B, and absolute - sky, B + S. A jump
    of one of the three is one unknown for two equations. Different jumps of both encoders are two
    unknowns, which fit anything, and are penalised for that (Occam factor of the Bayesian evidence;
    MacKay 2003, Information Theory, Inference, and Learning Algorithms, ch. 28). Equal jumps of
    both encoders and a turn of the mount about the axis are indistinguishable.

    Parameters
    ----------
    difference, difference_variance : float
        Change of incremental - absolute (rad) and its variance (rad^2).
    absolute, absolute_variance : float
        Change of absolute - sky.
    size : float
        Prior 1 sigma of a jump, rad; hardly matters for a jump far above the noise.
    quiet : float
        1 sigma of the usual change of an encoder without a jump, rad.

    Returns
    -------
    dict of str to float
        Posterior probability of `NOTHING`, `INCREMENTAL`, `ABSOLUTE`, `BOTH` and `ALIKE`.
    """
    moved = {NOTHING: (quiet, quiet, 0.0), INCREMENTAL: (size, quiet, 0.0),
             ABSOLUTE: (quiet, size, 0.0), BOTH: (size, size, 0.0), ALIKE: (quiet, quiet, size)}
    value, logs = np.array([difference, absolute]), {}
    for name, (first, other, mount) in moved.items():
        covariance = np.array([
            [first**2 + other**2 + difference_variance + LEAST**2, -other**2],
            [-other**2, other**2 + mount**2 + absolute_variance + LEAST**2]])
        logs[name] = float(-0.5 * (value @ np.linalg.solve(covariance, value)
                                   + np.linalg.slogdet(2.0 * np.pi * covariance)[1]))
    return probabilities(logs)
