"""The rounds of the weights of a fit: the noise by its residuals, then the bisquare at that noise.

A round costs two products of the design with a vector: it goes on with the normal matrix that is
there. Of few rows, where weights follow residuals so closely that such rounds converge slowly, the
change of the weights is in the matrix (Newton's method).
"""

import numpy as np

from .in_cache import apart, largest
from .least_squares import Solution, inverse_of, weighted_solve
from .robust import BISQUARE
from .robust_weights import TOLERANCE, Room, Weigher

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


class Rounds:
    """Robust least squares of one linearisation.

    Attributes
    ----------
    p, residual : ndarray, shapes (k,) and (2n,)
        Where the rounds are.
    moved : float or None
        How far they have moved a residual at most, where they know it.

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

    moved = None

    def __init__(self, rows, b, base, rcond, inverse=None, before=None, normals=None,
                 plain=None, room=None):
        self.rows, self.b, self.base, self.rcond = rows, b, base, rcond
        self.room = room or Room()
        self.weigher = Weigher(base, len(b) // 2, self.room)
        self.solution, self.p, self.residual = None, np.zeros(len(rows)), b
        #: sum of the weights that the matrix was formed with
        self.total = float(len(b) // 2)
        self.unweighted = before is None
        self.inverse, self.newton = inverse, None
        if before is not None:
            self.solution, self.newton, self.total = before.solution, before.newton, before.total
            self.inverse = self.solution.inverse
        self.begun = self.inverse is not None
        if not self.begun and plain is not None:
            self.residual = b - plain @ rows
        elif not self.begun:
            self.solve(None, normals)
            self.plain = self.p
            self.begun = normals is not None

    def solve(self, weights, normals=None):
        """Exactly, with these weights of the rows (None: 1); the residual before."""
        before = self.residual
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

    def settle(self, weights):
        """As `solve`; how far it moves a residual at most."""
        before = self.solve(weights)
        return apart(self.residual, before)

    def force(self, weights):
        """What the weighted residuals pull the coefficients by, shape (k,)."""
        weighted = (self.residual.reshape(2, -1) * weights).reshape(-1)
        if self.base is not None:
            weighted *= self.base
        return self.rows @ weighted

    def way(self, weights, kept):
        """A step by the bisquare's weights and their roots, with the matrix that is there."""
        return self.weigher.bisquare_longer(kept, self.total) * (
            self.inverse @ self.force(weights))

    def step_and_weigh(self, step, scales):
        """As `go`, and the bisquare's weights and their roots after it."""
        return self.go(step), *self.weigher.bisquare(self.residual, scales)

    def go(self, step, most=np.inf):
        """Change the coefficients unless a residual moves by more than `most`; how far it does."""
        moved = step @ self.rows
        far = largest(moved)
        if far <= most:
            self.p = self.p + step
            self.residual = np.subtract(self.residual, moved, out=moved)
        return far

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
                moved = (self.go(longer * (self.inverse @ self.force(weights)))
                         / weigher.least(scales))
                exactly, last = moved > 0.5 * last, moved
            if moved < (_ROUGHLY if rough else _SETTLED):
                break
        return None if rough else self._noise_of(self.residual, dof_factor)

    def noise_at(self, step, rank):
        """As `find_noise`, where Huber's weights are known to lead: `step` from here."""
        return self._noise_of(self.residual_at(step), self._dof_factor(rank))

    def residual_at(self, step):
        """What a step would leave."""
        return self.residual - step @ self.rows

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
        first, weights, kept = self.step_and_weigh(self.first_step(scales), scales)
        if self.far(weights) or self.go(self.way(weights, kept)) > _SLOW * first:
            # the matrix leads elsewhere: solve, from where it began
            self.p, self.residual = np.zeros_like(self.p), self.b
            self.settle(self.weigher.bisquare(self.residual, scales)[0])
        return Solution(self.p, self.inverse, None, None, self.residual, len(self.p))

    def first_step(self, scales):
        """Where `approach` begins, shape (k,)."""
        return self.way(*self.first_weights(scales))

    def first_weights(self, scales):
        """The bisquare's weights and their roots where the rounds are."""
        return self.weigher.bisquare(self.residual, scales)

    def bisquare(self, scales):
        """Down to the minimum at this noise; the weights there, shape (n,)."""
        weigher, least = self.weigher, self.weigher.least(scales)
        last, way = np.inf, 0.0
        little = _LITTLE * least if self.solution is not None else 0.0
        weights, kept = self.first_weights(scales)
        if self.far(weights):
            self.settle(weights)
            weights, kept = weigher.bisquare(self.residual, scales)
        newton = len(weights) <= _NEWTON and isinstance(self.rows, np.ndarray)
        for _ in range(100):
            moved, form = None, self.newton is None or _SHORT * least < last < np.inf
            if newton:
                moved = self.by_newton(weights, kept, scales, form)
                newton = moved is not None
            if moved is None:
                moved, weights, kept = self.step_and_weigh(self.way(weights, kept), scales)
            else:
                weights, kept = weigher.bisquare(self.residual, scales)
            way += moved
            less = moved / last  # what the next would be of this; square, by a matrix of its own
            less = max(less * less if form else less, 1e-5) if newton else max(less, 1e-3)
            if less * moved >= 0.5 * TOLERANCE and moved <= _SLOW * last:
                last = moved
                if newton or less * moved >= _LITTLE * least or less**2 * moved >= 0.5 * TOLERANCE:
                    continue
                moved = self.go(self.way(weights, kept))  # too short to change a weight
                way, less = way + moved, max(moved / last, 1e-3)
            if less * moved < 0.5 * TOLERANCE and moved <= _SLOW * last and way < little:
                # the matrix is as good as that of before
                self.solution = self.solution._replace(p=self.p, residual=self.residual)
                break
            newton = newton and moved <= _SLOW * last
            last, moved = np.inf, self.settle(weights)
            if moved < TOLERANCE:
                break
            weights, kept = weigher.bisquare(self.residual, scales)
        return weights
