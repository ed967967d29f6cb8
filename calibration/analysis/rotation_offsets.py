"""What a fit of terms iterates: offsets of exact rotations, and their derivatives."""

import numpy as np

from msg_tools.units import all_finite, wrap
from pointing_model.geometry import linearised
from pointing_model.mount_names import CANONICAL
from pointing_model.rotations import values
from pointing_model.trig import BLOCK

from ..estimation.gauss_newton import part_of

#: rad from the axis: nearer to it no row tells anything; and all that turns a mount may be so much
_CLOSE, _WIDE = 1e-4, 0.05


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
    first_order : ndarray, shape (k, 2n), or RunColumns
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
        held = values(turned, mount)
        #: row -> place of the rotation in `CANONICAL`, its sign, and what of it is held
        self._rotations = [(i, at, sign, held[at]) for i, (name, sign) in self.places.items()
                           for at in [CANONICAL.index(name)]]
        self._held = held
        #: the zeros of the axes, and the flexure of an alt-azimuth mount, have columns that stay
        self._turning = {i: of for i, of in self.places.items()
                         if of[0] not in (('IA', 'IE', 'TF') if mount.altaz else ('IA', 'IE'))}
        self.at = self._residual = self._least = None

    def residual(self, p, columns, each=None):
        """As of `gauss_newton.Linear`; until the next call.

        `each(residual, part)` is called for a part of the rows as soon as it is there.
        """
        self.at, self.filled = None, True
        if each is None and not self.turned and not p.any() and not self.moved:
            return self.observed, None
        self.at = list(self._held)
        for i, at, sign, held in self._rotations:
            self.at[at] = held + sign * float(p[i])
        if self._residual is None:
            self._residual = np.empty_like(self.observed)
        residual = self._residual  # that of the call before is not needed any more
        np.copyto(residual, self.observed)
        if len(self.places) < len(p):
            rest = p.copy()
            rest[list(self.places)] = 0.0
            if rest.any():
                residual -= rest @ self.first_order
        n, self.filled = len(residual) // 2, columns
        for part in self._blocks():
            x, y = self._linearised(part, columns)
            residual[part] -= x
            residual[n + part.start:n + part.stop] -= y
            if self._least_cos < _WIDE:
                self._in_turn(residual[part], part)
            if each is not None:
                each(residual, part)
        if all_finite(residual[:n]):
            return residual, None
        feasible = np.isfinite(residual[:n])
        residual[np.concatenate((~feasible, ~feasible))] = 0.0
        return residual, feasible

    def columns(self):
        """As of `gauss_newton.Linear`."""
        if not self.filled:
            for part in self._blocks():
                self._linearised(part, True)
            self.filled = True
        return self.first_order

    def _in_turn(self, x, part):
        """By the axis, where azimuths differ by half a turn, of two ways round the shorter."""
        cos_el = self.trig.cos_el[part]
        close = (np.abs(cos_el) < _WIDE) & (cos_el != 0.0)
        x[close] = wrap(x[close] / cos_el[close]) * cos_el[close]

    def curvature(self):
        """Bound of the second derivatives of all residuals to two coefficients, where it was last.

        Those of an on-sky offset grow as 1 / cos E, and without bound where the line of sight
        cannot go.
        """
        room = self._least_cos - 4.0 * self._size()
        return 4.0 / room if room > 0.0 else np.inf

    @property
    def steep(self):
        """As `curvature`, where the line of sight can go."""
        return 4.0 / max(self._least_cos, _CLOSE)

    @property
    def _least_cos(self):
        if self._least is None:
            self._least = float(self.trig.cos_el.min())
            if self._least < 0.0:
                self._least = float(np.abs(self.trig.cos_el).min())
        return self._least

    def _size(self):
        """Of all that turns the mount, radians."""
        return sum(map(abs, (self.at or ())[2:]))

    def beyond(self, way, since):
        """Bound of what the residuals after a step have beyond what the columns tell, radians.

        The columns neglect the square of the coefficients, and how a flexure that turns the
        direction goes with the other terms.

        Parameters
        ----------
        way, since : float
            Sums of the absolute changes of the coefficients: in the step that led here from the
            last `residual`, and from where the columns were made to here.
        """
        neglected = self._size() ** (2 if self.mount.altaz else 1)
        return self.curvature() * way * (way + since + neglected)

    def part(self, rows):
        """As of `gauss_newton.Linear`."""
        return Rotating(self.trig.part(rows), self.terms, self.turned,
                        part_of(self.observed, rows), part_of(self.first_order, rows), self.mount)

    def _blocks(self):
        n = len(self.observed) // 2
        return (slice(i, min(i + BLOCK, n)) for i in range(0, n, BLOCK))

    def _linearised(self, part, fill):
        """Offsets (x, y) of some rows; `fill`: with their columns."""
        trig, n = self.trig, len(self.observed) // 2
        if part.stop - part.start < n:
            trig = trig.part(part)
        x, y, columns = linearised(
            trig.az, trig.el, (trig.sin_az, trig.cos_az, trig.sin_el, trig.cos_el), self.at,
            [name for name, _ in self._turning.values()] if fill else (), trig.mount)
        if trig.side is not None:
            x, y = trig.side * x, trig.side * y
            columns = {name: (trig.side * a, trig.side * b) for name, (a, b) in columns.items()}
        if fill:
            self.moved = True
            for i, (name, sign) in self._turning.items():
                row, there = self.first_order[i], slice(n + part.start, n + part.stop)
                row[part], row[there] = columns[name] if sign > 0 else (
                    -v for v in columns[name])
        return x, y
