"""What a fit of terms iterates: offsets of exact rotations, and their derivatives."""

import numpy as np

from pointing_model.geometry import linearised
from pointing_model.rotations import values
from pointing_model.trig import BLOCK

from .gauss_newton import every


class Rotating:
    """For `gauss_newton`: the geometric terms turn the mount, the others are linear.

    Parameters
    ----------
    trig : terms.Trig
        Of the catalogue places, n of them.
    terms : sequence of str
        The fitted ones; rows beyond them are linear.
    turned : dict of str to float
        Geometric terms that are held, radians; a fitted one is added.
    observed : ndarray, shape (2n,)
        Encoder - catalogue on the sky, x of all rows, then y, radians.
    first_order : ndarray, shape (k, 2n)
        Their columns; of the geometric terms they are replaced by those of `columns`.
    mount : Mount
    """

    linear = False

    def __init__(self, trig, terms, turned, observed, first_order, mount):
        self.trig, self.terms, self.turned, self.mount = trig, terms, turned, mount
        self.observed, self.first_order = observed, first_order
        self.moved = False
        own = mount.names.terms
        #: row -> name and sign of the rotation of an alt-azimuth mount
        self.places = {i: own[name] for i, name in enumerate(terms) if name in own}
        self.at = None

    def residual(self, p):
        """As of `gauss_newton.Linear`."""
        self.at = None
        if not self.turned and not p.any():
            return self.observed, None
        named = dict(self.turned)
        for i in self.places:
            named[self.terms[i]] = named.get(self.terms[i], 0.0) + float(p[i])
        self.at = values(named, self.mount)
        rest = p.copy()
        rest[list(self.places)] = 0.0
        residual = self.observed - rest @ self.first_order if rest.any() else self.observed.copy()
        n = len(residual) // 2
        for part in self._blocks():
            x, y, _ = self._linearised(part, ())
            residual[part] -= x
            residual[n + part.start:n + part.stop] -= y
        if np.isfinite(residual[:n].sum()):
            return residual, None
        feasible = np.isfinite(residual[:n])
        residual[np.concatenate((~feasible, ~feasible))] = 0.0
        return residual, feasible

    def columns(self):
        """As of `gauss_newton.Linear`."""
        if self.at is None:
            return self.first_order
        n, self.moved = len(self.observed) // 2, True
        names = [name for name, _ in self.places.values()]
        for part in self._blocks():
            columns = self._linearised(part, names)[2]
            there = slice(n + part.start, n + part.stop)
            for i, (name, sign) in self.places.items():
                x, y = columns[name]
                row = self.first_order[i]
                row[part], row[there] = (x, y) if sign > 0 else (-x, -y)
        return self.first_order

    def part(self, step):
        """As of `gauss_newton.Linear`."""
        return Rotating(self.trig.every(step), self.terms, self.turned,
                        *every(step, self.observed, self.first_order), self.mount)

    def _blocks(self):
        n = len(self.observed) // 2
        return (slice(i, min(i + BLOCK, n)) for i in range(0, n, BLOCK))

    def _linearised(self, part, names):
        trig = self.trig if part == slice(0, len(self.trig.az)) else self.trig.every(part)
        x, y, columns = linearised(
            trig.az, trig.el, (trig.sin_az, trig.cos_az, trig.sin_el, trig.cos_el), self.at,
            names, trig.mount)
        if trig.side is not None:
            x, y = trig.side * x, trig.side * y
            columns = {name: (trig.side * a, trig.side * b) for name, (a, b) in columns.items()}
        return x, y, columns
