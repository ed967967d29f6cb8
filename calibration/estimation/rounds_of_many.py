"""The rounds of `robust_rounds` for many rows: one pass over the design does all that is due.

A design of a million rows is 100 MB, and reading it costs as much as what is done with it. So each
part of it, while it is in the cache, gives the residual after a step, the weights there and what
the next step needs; the first of them while the exact residuals are made (`Sight`).
"""

import numpy as np

from .in_cache import MANY, change, parts
from .least_squares import coefficients_of
from .robust_rounds import Rounds
from .robust_weights import Weigher, bends_of


def are_many(rows):
    """Whether the rounds of a design are those of many rows."""
    return isinstance(rows, np.ndarray) and rows.shape[1] >= MANY


def _axes(part, n):
    """The values of some rows: those of x, and those of y."""
    return part, slice(n + part.start, n + part.stop)


def _pull(rows, residual, weights, base, part):
    """Of some rows: what their weighted residuals pull the coefficients by, shape (k,)."""
    n, out = len(weights), 0.0
    for of in _axes(part, n):
        weighted = residual[of] * weights[part]
        if base is not None:
            weighted *= base[of]
        out = out + rows[:, of] @ weighted
    return out


class Sight:
    """What rounds need of exact residuals, found part by part while those are made.

    Parameters
    ----------
    rows : ndarray, shape (k, 2n)
        The design.
    base : ndarray, shape (2n,), or None
    scales : sequence of float
        The noise of x and y.
    room : Room
    step : ndarray, shape (k,), optional
        Also the residual there, where the noise is to be found.

    Attributes
    ----------
    force : ndarray, shape (k,)
        What the weighted residuals pull the coefficients by.
    normals : ndarray, shape (2, k, k), or None
        The parts that x and y make of the normal matrix with the weights; without a `step`.
    residual : ndarray, shape (2n,), or None
        After the `step`.
    """

    def __init__(self, rows, base, scales, room, step=None):
        n = rows.shape[1] // 2
        self._rows, self._base, self._step = rows, base, step
        self._weigher, self._bends = Weigher(base, n, room), bends_of(scales)
        self.weights, self.kept = room.weights(n)
        self.residual = None if step is None else room.residual(2 * n)
        self.force = np.zeros(len(rows))
        self.normals = None if step is not None else np.zeros((2, len(rows), len(rows)))
        self._weighted = np.empty((len(rows), 0))

    def __call__(self, residual, part):
        """Look at some rows, a slice, whose residual and columns are there."""
        self._weigher.weigh(residual, part, self._bends)
        if self._step is not None:
            self.force += _pull(self._rows, residual, self.weights, self._base, part)
            for of in _axes(part, len(self.weights)):
                change(residual[of], self._step, self._rows[:, of], self.residual[of])
            return
        if self._weighted.shape[1] < part.stop - part.start:
            self._weighted = np.empty((len(self._rows), part.stop - part.start))
        weighted = self._weighted[:, :part.stop - part.start]
        for normal, of in zip(self.normals, _axes(part, len(self.weights))):
            rows, weights = self._rows[:, of], self.weights[part]
            np.multiply(rows, weights if self._base is None else weights * self._base[of],
                        out=weighted)
            normal += weighted @ rows.T
            self.force += weighted @ residual[of]


class RoundsOfMany(Rounds):
    """As `Rounds`, with a design that is an array."""

    def __init__(self, *args):
        #: the force at the last weights, and what a sight found, until the coefficients change
        self._known = self._sight = None
        #: how far all steps have moved a residual at most; None: not known
        self.moved = 0.0
        super().__init__(*args)

    def see(self, sight):
        """Go on with what was found of `b`."""
        if self.far(sight.weights):
            return
        self._sight, self._known = sight, sight.force
        if sight.normals is not None:
            self._form(sight.weights, sight.force, (sight.normals[0], sum(sight.normals)))
        self._first = self.way(sight.weights, sight.kept)

    def _form(self, weights, pull=None, normals=None):
        """The matrices at these weights; the step that they give, shape (k,).

        `pull`, `normals`: as of `coefficients_of`, where they are known.
        """
        both = weights if self.base is None else self.weigher.both(weights)
        solution = coefficients_of(self.rows, self.residual, both, self.rcond, normals, pull)
        self.solution = solution._replace(p=self.p, residual=self.residual)
        self.inverse, self.unweighted = solution.inverse, False
        self.total = float(np.add.reduce(weights))
        return solution.p

    def solve(self, weights, normals=None):
        self._known = self._sight = self.moved = None
        return super().solve(weights, normals)

    def settle(self, weights):
        step = self._form(weights)
        if self.solution.rank < len(step):  # of those left the smallest, which a step is not
            return super().settle(weights)
        moved = self.go(step)
        self.solution = self.solution._replace(p=self.p, residual=self.residual)
        return moved

    def force(self, weights):
        if self._known is not None:
            return self._known
        return sum(_pull(self.rows, self.residual, weights, self.base, part)
                   for part in parts(len(weights)))

    def find_noise(self, rank, rough=False):
        self._known = self._sight = None
        return super().find_noise(rank, rough)

    def go(self, step, most=np.inf):
        if most < np.inf:
            self._known = self._sight = self.moved = None
            return super().go(step, most)
        return self._pass(step, None)

    def step_and_weigh(self, step, scales):
        return self._pass(step, bends_of(scales)), *self.room.weights(len(self.b) // 2)

    def _pass(self, step, bends):
        """Step, and with `bends` find the weights and the force there."""
        before, after = self.residual, self.room.residual(len(self.b))
        far, force, n = [], 0.0, len(self.b) // 2
        for part in parts(n):
            for of in _axes(part, n):
                far.append(change(before[of], step, self.rows[:, of], after[of]))
            if bends is not None:
                self.weigher.weigh(after, part, bends)
                force = force + _pull(self.rows, after, self.room.weights(n)[0], self.base, part)
        self.p, self.residual = self.p + step, after
        self._known, self._sight = None if bends is None else force, None
        far = float(np.max(far))
        self.moved = None if self.moved is None else self.moved + far
        return far

    def first_weights(self, scales):
        if self._sight is not None:
            return self._sight.weights, self._sight.kept
        self._known = None
        return super().first_weights(scales)

    def first_step(self, scales):
        # found with the noise of a part of the rows, which is good enough for a way there
        return super().first_step(scales) if self._sight is None else self._first

    def residual_at(self, step):
        if self._sight is not None:
            return self._sight.residual
        out = self.room.residual(len(self.b))
        if self.residual is out:
            return super().residual_at(step)
        change(self.residual, step, self.rows, out)
        return out
