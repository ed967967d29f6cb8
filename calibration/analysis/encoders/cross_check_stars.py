"""What encoders and stars that were exposed for a zero said in one power-on.

Stars stand elsewhere than Polaris, and what the disc of an encoder does there is no change. So two
power-ons are compared by the stars that were exposed in both, each with one voice however often it
was exposed.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import wrap

from ...estimation.robust import bisquare, sigma_of
from .cross_check_noise import inflation
from .cross_check_records import Witness

#: stars that two power-ons must have in common to be compared
FEWEST_STARS = 3
_FEWEST_EXPOSURES = 4


@dataclass(frozen=True)
class StarsSeen:
    """Exposures of a power-on, each star once.

    Attributes
    ----------
    run : float
        The power-on, see `witness_records.Witness`.
    star : ndarray, shape (s,)
        Numbers, ascending.
    az, el : ndarray, shape (s,)
        Mean catalogue place, rad.
    offsets : ndarray, shape (2, 2, s)
        Encoder - catalogue on the sky, rad: incremental and absolute, x and y.
    noise : ndarray, shape (2, 2)
        Of an exposure, 1 sigma: incremental and absolute, by axis; with what they resemble each
        other.
    apart : ndarray, shape (2, s)
        Incremental - absolute, coordinate angles, rad.
    apart_noise : ndarray, shape (2,)
        Of an exposure, by axis.
    count : ndarray, shape (s,)
        Exposures that count.
    """

    run: float
    star: np.ndarray
    az: np.ndarray
    el: np.ndarray
    offsets: np.ndarray
    noise: np.ndarray
    apart: np.ndarray
    apart_noise: np.ndarray
    count: np.ndarray

    def witness(self, stars):
        """By some of the stars, a Witness whose `mean` takes anything over its places."""
        at = np.isin(self.star, stars)
        el, count = self.el[at], self.count[at]
        weights = np.stack([np.cos(el) / np.sum(np.cos(el) ** 2), np.full(len(el), 1 / len(el))])
        angles = np.einsum('as,eas->ea', weights, self.offsets[:, :, at])
        # the difference of coordinate angles, as the zero weighs it
        own = weights * np.stack([np.cos(el), np.ones(len(el))])
        per = np.sum(np.square(weights) / count, axis=1)
        enc, second = np.square(self.noise) * per
        apart = np.square(self.apart_noise) * np.sum(np.square(own) / count, axis=1)
        most = np.sqrt(enc * second)
        both = np.clip(0.5 * (enc + second - apart), -most, most)
        return Witness(
            self.run, float(np.arctan2(np.sin(self.az[at]).mean(), np.cos(self.az[at]).mean())),
            float(el.mean()), angles[0], angles[1],
            np.moveaxis(np.array([[enc, both], [both, second]]), 2, 0),
            np.sum(own * self.apart[:, at], axis=1), np.sqrt(apart), max(int(count.sum()), 2),
            (self.az[at], el, weights))


def stars_seen(run, rows, model, rho):
    """The exposures of stars for the zero of a power-on.

    Parameters
    ----------
    run : float
    rows : PointingRun
        Those exposures, finite, with both encoders.
    model : PointingModel or None
        Tells which exposures are wild, and no more: without it all count.
    rho : ndarray, shape (2, 2)
        How much exposures resemble those before them, by axis; incremental and absolute encoder.

    Returns
    -------
    StarsSeen or None
        None where they are too few.
    """
    if len(rows) < _FEWEST_EXPOSURES:
        return None
    weights = np.ones(len(rows))
    if model is not None:
        left = np.array(model.residuals(rows))
        left = left - np.median(left, axis=1, keepdims=True)
        scale = np.maximum(sigma_of(left, axis=1), 1e-12)[:, None]
        weights = (bisquare(np.hypot(*(left / scale))) > 0.0).astype(float)
    rows = rows.select(weights > 0.0)
    star, member, count = np.unique(rows['star'], return_inverse=True, return_counts=True)
    free = len(rows) - len(star)
    if free < 1:
        return None

    def mean(values):
        return np.stack([np.bincount(member, v) / count for v in values])

    def scatter(values):
        return np.sqrt(np.sum(np.square(values - mean(values)[:, member]), axis=1) / free)
    offsets = [np.stack(rows.offsets(encoder)) for encoder in ('enc', 'abs')]
    apart = np.stack([wrap(rows[f'{axis}_enc'] - rows[f'{axis}_abs']) for axis in ('az', 'el')])
    more = np.array([[inflation(r, len(rows)) for r in both] for both in rho])
    # no azimuth is near half a turn of another of the same star
    az = np.arctan2(*mean((np.sin(rows['az']), np.cos(rows['az']))))
    return StarsSeen(
        run, star, az, mean((rows['el'],))[0], np.stack([mean(v) for v in offsets]),
        np.stack([scatter(v) for v in offsets]) * np.sqrt(more.T), mean(apart), scatter(apart),
        count)


def compared(before, now):
    """Two witnesses as they can be compared.

    Parameters
    ----------
    before, now : Witness or StarsSeen

    Returns
    -------
    before, now : Witness
        Of stars, those by the stars of both.

    Raises
    ------
    ValueError
        They have nothing in common, in words.
    """
    by_stars = [isinstance(one, StarsSeen) for one in (before, now)]
    if not any(by_stars):
        return before, now
    if not all(by_stars):
        raise ValueError('one has a zero by Polaris, the other by stars')
    both = np.intersect1d(before.star, now.star)
    if len(both) < FEWEST_STARS:
        raise ValueError('they have zeros by other stars')
    return before.witness(both), now.witness(both)
