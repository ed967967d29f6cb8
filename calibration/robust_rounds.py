"""The rounds of the weights of a fit: the noise by its residuals, then the bisquare at that noise.

A round costs two products of the design with a vector: it goes on with the normal matrix that is
there. Of few rows, where weights follow residuals so closely that such rounds converge slowly, the
change of the weights is in the matrix (Newton's method).
"""

import numpy as np

from msg_tools.units import ARCSEC

from .in_cache import MANY, apart, change, largest, parts
from .least_squares import Solution, inverse_of, weighted_solve
from .robust import BISQUARE, BISQUARE_VARIANCE, HUBER, sigma_of

TOLERANCE = 1e-9 * ARCSEC  # of the rounds, on the sky
#: of the change in a round, that of the next: from it on the normal matrix is formed again
_SLOW = 0.2
#: of the noise: a change of residuals that changes no weight by more
_LITTLE = 1e-6
#: of the noise: a change of residuals that ends the search for it
_SETTLED = 0.01
#: as that, of a linearisation that will be left
_ROUGHLY = 0.1
#: rows up to which Newton's matrix costs less than the rounds that it saves
_NEWTON = 400
#: of the noise: a step by it that is longer is none; one that is shorter leaves it as it is
_LONG, _SHORT = 0.5, 1e-3


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

    def residual(self, like):
        """For residuals."""
        if self._residual is None or len(self._residual) != len(like):
            self._residual = np.empty_like(like)
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
        bends = _bends(scales)
        if not self.many:
            kept = _roots(self.squares(residual), bends)
            return np.square(kept), kept
        weights, kept = self.room.weights(self.n)
        for part in parts(self.n):
            self.weigh(residual, part, bends)
        return weights, kept

    def weigh(self, residual, part, bends):
        """As `bisquare`, of some of many rows."""
        weights, kept = self.room.weights(self.n)
        np.square(_roots(self.squares(residual, part), bends, kept[part]), out=weights[part])

    def variances(self, residual, scales):
        """Mean square of each axis, by the bisquare's weights at these scales."""
        bends, squares, total = _bends(scales), 0.0, 0.0
        for part in parts(self.n) if self.many else (slice(None),):
            of_part = self.squares(residual, part)
            kept = _roots(of_part, bends)
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


def _bends(scales):
    return [(-1.0 / BISQUARE**2) / scale**2 for scale in scales]


def _roots(squares, bends, out=None):
    """Of the bisquare's weights."""
    kept = np.dot(bends, squares, out=out)
    kept += 1.0
    return np.maximum(kept, 0.0, out=kept)


class Rounds:
    """Robust least squares of one linearisation.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n), or RunColumns
    b : ndarray, shape (2n,)
    base : ndarray, shape (2n,), or None
    rcond : float
    inverse : ndarray, shape (k, k), or None
        About that of the normal matrix: the rounds begin where b is, and not at plain least
        squares.
    before : Rounds, optional
        Of an earlier linearisation at the same noise: its matrices are those of the weights.
    normals : tuple of ndarray, optional
        Of the design without robust weights, where they are known: a rough beginning.
    plain : ndarray, shape (k,), optional
        Plain least squares, where it is known but for the second order.
    room : Room, optional
        Of the rounds before, which nobody asks any more.
    """

    def __init__(self, rows, b, base, rcond, inverse=None, before=None, normals=None,
                 plain=None, room=None):
        self.rows, self.b, self.base, self.rcond = rows, b, base, rcond
        self._room = room or Room()
        self.weigher = Weigher(base, len(b) // 2, self._room)
        self.solution, self.p, self.residual = None, np.zeros(len(rows)), b
        #: sum of the weights that the matrix was formed with
        self.total = float(len(b) // 2)
        self.unweighted = before is None
        self.inverse, self.newton = inverse, None
        if before is not None:
            self.solution, self.newton, self.total = before.solution, before.newton, before.total
            self.inverse = self.solution.inverse
        self._known = None  # the force at the last weights, where a pass has found it
        self.begun = self.inverse is not None
        if not self.begun and plain is not None:
            self.residual = b - plain @ rows
        elif not self.begun:
            self.solve(None, normals)
            self.plain = self.p
            self.begun = normals is not None

    def solve(self, weights, normals=None):
        """Exactly, with these weights of the rows (None: 1); the residual before."""
        before, self._known = self.residual, None
        if weights is None:
            both = self.base
        else:
            both = weights if self.base is None else self.weigher.both(weights)
        self.solution = weighted_solve(self.rows, self.b, both, self.rcond, normals)
        self.p, self.residual = self.solution.p, self.solution.residual
        self.inverse = self.solution.inverse
        if weights is not None:
            self.total, self.unweighted = float(np.add.reduce(weights)), False
        return before

    def force(self, weights):
        """What the weighted residuals pull the coefficients by, shape (k,)."""
        known, self._known = self._known, None
        if known is not None:
            return known
        if self._by_parts:
            return sum(self._force_of(weights, part) for part in parts(len(weights)))
        weighted = (self.residual.reshape(2, -1) * weights).reshape(-1)
        if self.base is not None:
            weighted *= self.base
        return self.rows @ weighted

    def _force_of(self, weights, part):
        """That of some rows."""
        x_and_y = 2, len(weights)
        weighted = self.residual.reshape(x_and_y)[:, part] * weights[part]
        if self.base is not None:
            weighted *= self.base.reshape(x_and_y)[:, part]
        x, y = np.moveaxis(self.rows.reshape(-1, *x_and_y)[:, :, part], 1, 0)
        return x @ weighted[0] + y @ weighted[1]

    def step(self, weights, longer):
        """One with the normal matrix that is there; how far it moves a residual at most."""
        return self.go(longer * (self.inverse @ self.force(weights)))

    def step_and_weigh(self, weights, longer, scales):
        """As `step`, and the bisquare's weights and their roots after it.

        Of many rows in one pass over the design, with the next step's force.
        """
        if not self._by_parts:
            return self.step(weights, longer), *self.weigher.bisquare(self.residual, scales)
        step = longer * (self.inverse @ self.force(weights))
        before, after, far, force = self.residual, self._room.residual(self.b), [], 0.0
        self.p, self.residual = self.p + step, after
        n, bends = len(weights), _bends(scales)
        weights, kept = self._room.weights(n)
        for part in parts(n):
            for rows in (part, slice(n + part.start, n + part.stop)):
                far.append(change(before[rows], step, self.rows[:, rows], after[rows]))
            self.weigher.weigh(after, part, bends)
            force += self._force_of(weights, part)
        self._known = force
        return float(np.max(far)), weights, kept

    def go(self, step, most=np.inf):
        """Change the coefficients unless a residual moves by more than `most`; how far it does."""
        self._known = None
        if self._by_parts and most == np.inf:
            out = self._room.residual(self.b)
            far = change(self.residual, step, self.rows, out)
            self.p, self.residual = self.p + step, out
            return far
        moved = step @ self.rows
        far = largest(moved)
        if far <= most:
            self.p = self.p + step
            self.residual = np.subtract(self.residual, moved, out=moved)
        return far

    @property
    def _by_parts(self):
        return self.weigher.many and isinstance(self.rows, np.ndarray)

    def by_newton(self, weights, kept, scales, form):
        """As `step`, by the matrix with the change of the weights; None where it leads nowhere.

        `form`: at these weights, not as it was formed before.
        """
        rows, n = self.rows, len(weights)
        if form:
            pull = rows * self.residual
            if self.base is not None:
                pull *= self.base
            x, y = pull[:, :n], pull[:, n:]
            by_weights = x * scales[0]**-2 + y * scales[1]**-2
            by_weights *= (4.0 / BISQUARE**2) * kept
            matrix = (rows * self.weigher.both(weights)) @ rows.T - (x + y) @ by_weights.T
            try:
                self.newton = inverse_of(matrix)
            except np.linalg.LinAlgError:
                return None
        force = self.force(weights)
        step = self.newton @ force
        most = _LONG * self.weigher.least(scales)
        moved = self.go(step, most) if force @ step >= 0.0 else np.inf
        return moved if moved <= most else None

    def far(self, weights):
        """Whether steps with the normal matrix that is there could go too far."""
        return float(np.add.reduce(weights)) < 0.5 * self.total

    def find_noise(self, rank, rough=False):
        """Huber's weights, with the noise by the medians; then that of what the bisquare keeps.

        `rough`: only the weights.
        """
        weigher, dof_factor = self.weigher, self._dof_factor(rank)
        exactly, last = not self.begun, np.inf
        for _ in range(30):
            scales = weigher.noise(self.residual, dof_factor)
            weights = weigher.huber(self.residual, scales)
            if exactly or self.unweighted and self.far(weights):
                before = self.solve(weights)
                moved = float(weigher.distance(self.residual - before, scales).max()) ** 0.5
            else:
                longer = weigher.huber_longer(weights)
                if self.unweighted:
                    longer *= self.total / float(np.add.reduce(weights))
                moved = self.step(weights, longer) / weigher.least(scales)
                exactly, last = moved > 0.5 * last, moved
            if moved < (_ROUGHLY if rough else _SETTLED):
                break
        return None if rough else self._noise_of(self.residual, dof_factor)

    def noise_at(self, step, rank):
        """As `find_noise`, where Huber's weights are known to lead: `step` from here."""
        if self._by_parts and self.residual is self.b:
            residual = self._room.residual(self.b)
            change(self.residual, step, self.rows, residual)
        else:
            residual = self.residual - step @ self.rows
        return self._noise_of(residual, self._dof_factor(rank))

    def _dof_factor(self, rank):
        return (len(self.b) / max(len(self.b) - rank, 1)) ** 0.5

    def _noise_of(self, residual, dof_factor):
        weigher = self.weigher
        scales = weigher.noise(residual, dof_factor)
        # the median is wasteful: take the bisquare's own variance of what it keeps
        for _ in range(3):
            scales = [max(dof_factor * square ** 0.5, scale / 1.5)
                      for square, scale in zip(weigher.variances(residual, scales), scales)]
        return scales

    def approach(self, scales):
        """Two steps of the bisquare; a `Solution` without matrices."""
        weights, kept = self.weigher.bisquare(self.residual, scales)
        _, weights, kept = self.step_and_weigh(
            weights, self.weigher.bisquare_longer(kept, self.total), scales)
        self.step(weights, self.weigher.bisquare_longer(kept, self.total))
        return Solution(self.p, self.inverse, None, None, self.residual, len(self.p))

    def bisquare(self, scales):
        """Down to the minimum at this noise; the weights there, shape (n,)."""
        weigher, least = self.weigher, self.weigher.least(scales)
        last, way = np.inf, 0.0
        little = _LITTLE * least if self.solution is not None else 0.0
        weights, kept = weigher.bisquare(self.residual, scales)
        if self.far(weights):
            self.solve(weights)
            weights, kept = weigher.bisquare(self.residual, scales)
        newton = len(weights) <= _NEWTON and isinstance(self.rows, np.ndarray)
        for _ in range(100):
            moved, form = None, self.newton is None or _SHORT * least < last < np.inf
            if newton:
                moved = self.by_newton(weights, kept, scales, form)
                newton = moved is not None
            if moved is None:
                moved, weights, kept = self.step_and_weigh(
                    weights, weigher.bisquare_longer(kept, self.total), scales)
            else:
                weights, kept = weigher.bisquare(self.residual, scales)
            way += moved
            less = moved / last  # what the next would be of this; square, by a matrix of its own
            less = max(less * less if form else less, 1e-5) if newton else max(less, 1e-3)
            if less * moved >= 0.5 * TOLERANCE and moved <= _SLOW * last:
                last = moved
                continue
            if moved <= _SLOW * last and way < little:  # the matrix is as good as that of before
                self.solution = self.solution._replace(p=self.p, residual=self.residual)
                break
            newton = newton and moved <= _SLOW * last
            before = self.solve(weights)
            last, moved = np.inf, apart(self.residual, before)
            if moved < TOLERANCE:
                break
            weights, kept = weigher.bisquare(self.residual, scales)
        return weights
