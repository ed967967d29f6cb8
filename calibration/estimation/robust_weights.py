"""Robust weights of the rows of a fit, by their residuals at a noise."""

import numpy as np

from msg_tools.units import ARCSEC

from .in_cache import MANY, parts
from .robust import BISQUARE, BISQUARE_VARIANCE, HUBER, sigma_of

TOLERANCE = 1e-9 * ARCSEC  # of the rounds, on the sky


class Room:
    """Arrays of many rows that the rounds of a fit work in, one after the other.

    A new one of a million rows costs the system up to 30 ms, ten times what is done with it.
    """

    def __init__(self):
        self._weights = self._residual = None

    def weights(self, n):
        """For weights and their roots, shape (2, n)."""
        if self._weights is None or self._weights.shape[1] != n:
            self._weights = np.empty((2, n))
        return self._weights

    def residual(self, n):
        """For residuals, shape (n,)."""
        if self._residual is None or len(self._residual) != n:
            self._residual = np.empty(n)
        return self._residual


class Weigher:
    """Robust weights of rows by their residuals, at the noise `scales` of each axis.

    Parameters
    ----------
    base : ndarray, shape (2n,), or None
        Weights by the given sigmas; then the scales are in sigmas.
    n : int
    room : Room
    """

    def __init__(self, base, n, room):
        self.base, self.n, self.room = base, n, room
        self.root = None if base is None else np.sqrt(base)
        self.many = 2 * n >= MANY
        self.floor = TOLERANCE if base is None else 1e-9

    def squares(self, residual, part=slice(None)):
        """Of both axes, in sigmas where they were given; shape (2, n), or of a part."""
        squares = np.square(residual.reshape(2, self.n)[:, part])
        if self.base is not None:
            squares *= self.base.reshape(2, self.n)[:, part]
        return squares

    def noise(self, residual, dof_factor):
        """Of each axis, from the medians."""
        standard = residual if self.root is None else residual * self.root
        both = sigma_of(standard.reshape(2, self.n), dof_factor, axis=1,
                        room=self.room.weights(self.n) if self.many else None)
        return [max(one, self.floor) for one in both.tolist()]

    def huber(self, residual, scales):
        """Weights, shape (n,)."""
        u = self.distance(residual, scales)
        np.sqrt(u, out=u)
        np.maximum(u, HUBER, out=u)
        return np.divide(HUBER, u, out=u)

    @staticmethod
    def huber_longer(weights):
        """By what a step at a fixed normal matrix is too short, with Huber's weights."""
        total = float(np.add.reduce(weights))
        return total / (0.5 * (total + np.count_nonzero(weights == 1.0)))

    def bisquare(self, residual, scales):
        """Weights and their roots, shape (n,) each; of many rows, until it is asked again."""
        bends = bends_of(scales)
        if not self.many:
            kept = roots_of(self.squares(residual), bends)
            return np.square(kept), kept
        weights, kept = self.room.weights(self.n)
        for part in parts(self.n):
            self.weigh(residual, part, bends)
        return weights, kept

    def weigh(self, residual, part, bends):
        """As `bisquare`, of some of many rows."""
        weights, kept = self.room.weights(self.n)
        np.square(roots_of(self.squares(residual, part), bends, kept[part]), out=weights[part])

    def variances(self, residual, scales):
        """Mean square of each axis, by the bisquare's weights at these scales."""
        bends, squares, total = bends_of(scales), 0.0, 0.0
        for part in parts(self.n) if self.many else (slice(None),):
            of_part = self.squares(residual, part)
            kept = roots_of(of_part, bends)
            total += float(np.dot(kept, kept))
            squares = squares + of_part @ np.square(kept)
        return (squares / (max(total, 1e-9) * BISQUARE_VARIANCE)).tolist()

    @staticmethod
    def bisquare_longer(kept, formed):
        """As `huber_longer`, with a matrix that was formed at weights of the sum `formed`."""
        total = float(np.dot(kept, kept))
        slope = 3.0 * total - 2.0 * float(np.add.reduce(kept))
        return min(total / slope, 1.9) * formed / total if slope > 0.0 else 1.0

    def distance(self, residual, scales):
        """Square of the radial distance in standard deviations, shape (n,)."""
        return np.dot([1.0 / scale**2 for scale in scales], self.squares(residual))

    def least(self, scales):
        """The smaller noise of a residual, radians."""
        return min(scales) if self.root is None else min(scales) / float(self.root.max())

    def both(self, weights):
        """For x and y of all rows, with the given sigmas."""
        out = np.concatenate((weights, weights))
        if self.base is not None:
            out *= self.base
        return out


def bends_of(scales):
    """What the squares of x and y take of the root of a bisquare weight."""
    return [(-1.0 / BISQUARE**2) / scale**2 for scale in scales]


def roots_of(squares, bends, out=None):
    """Those of the bisquare's weights."""
    kept = np.dot(bends, squares, out=out)
    kept += 1.0
    return np.maximum(kept, 0.0, out=kept)
