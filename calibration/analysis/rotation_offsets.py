"""What a fit of terms iterates: offsets of exact rotations, and their derivatives."""

import numpy as np

from msg_tools.units import wrap
from pointing_model.geometry import linearised
from pointing_model.mount_kinds import CANONICAL
from pointing_model.rotations import values

#: rad: nearer to the axis azimuths go the shorter way round
_CLOSE = 0.05


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
    columns : ndarray, shape (k, 2n)
        Of the terms; those of the geometric ones are written over.
    first_order : ndarray, or GroupColumns
        The same array, or what stands on it.
    mount : Mount
    """

    linear = False

    def __init__(self, trig, terms, turned, observed, columns, first_order, mount):
        self.trig, self.mount = trig, mount
        self.observed, self.first_order = observed, first_order
        own = mount.names.terms
        self._held = values(turned, mount)
        #: row -> name and sign of the rotation of an alt-azimuth mount
        self._places = {i: own[name] for i, name in enumerate(terms) if name in own}
        #: the zeros of the axes, and the flexure of an alt-azimuth mount, have columns that stay
        self._turning = {i: of for i, of in self._places.items()
                         if of[0] not in (('IA', 'IE', 'TF') if mount.vertical else ('IA', 'IE'))}
        self._terms, self._columns = columns, {}

    def residual(self, p):
        """As of `gauss_newton.Linear`."""
        at = list(self._held)
        for i, (name, sign) in self._places.items():
            at[CANONICAL.index(name)] += sign * float(p[i])
        trig = self.trig
        x, y, self._columns = linearised(
            trig.az, trig.el, (trig.sin_az, trig.cos_az, trig.sin_el, trig.cos_el), at,
            [name for name, _ in self._turning.values()], trig.mount)
        if trig.side is not None:
            x, y = trig.side * x, trig.side * y
        residual = self.observed - np.concatenate((x, y))
        if len(self._places) < len(p):
            rest = p.copy()
            rest[list(self._places)] = 0.0
            if rest.any():
                residual -= rest @ self.first_order
        close = np.flatnonzero((np.abs(trig.cos_el) < _CLOSE) & (trig.cos_el != 0.0))
        if len(close):  # by the axis, where azimuths differ by half a turn
            cos_el = trig.cos_el[close]
            residual[close] = wrap(residual[close] / cos_el) * cos_el
        return residual

    def columns(self):
        """As of `gauss_newton.Linear`; of the geometric terms where `residual` last was."""
        n, side = len(self.observed) // 2, self.trig.side
        for i, (name, sign) in self._turning.items():
            row, by = self._terms[i], sign if side is None else sign * side
            row[:n], row[n:] = (by * of for of in self._columns[name])
        return self.first_order
