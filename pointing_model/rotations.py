"""The rotations of `geometry` in the sines and cosines of the angles.

What a mount adds to an angle is small, so it comes from its own sine: `arctan2` and the turns
that it loses are for the few places near the pole where it is not.
"""

from math import cos, hypot, sin
from typing import NamedTuple

import numpy as np

from msg_tools.units import wrap

from .mount_kinds import CANONICAL

#: squares of angles, rad: `small_angle` has more digits than a float below it, with a term less
_SMALL, _TINY = 1e-4, 1e-5
#: cos E, of all that turns the mount: from it on no axis angle is an eighth of a turn off
_BESIDE = 4.0
#: |TF| up to which the flexure is a small angle
_BENT = 0.005
_STEPS = 50
_TOLERANCE = 5e-14  # rad, 1e-8 arcsec


class Way(NamedTuple):
    """Vectors on the way from a direction to the axis angles.

    Attributes
    ----------
    ux, uy, horizontal : ndarray
        The direction on the mount's base, and the square of its length beside the axis.
    vx, vy, sin_e, cos_e : ndarray
        Before the azimuth turn, and before the other rotations about it.
    room : ndarray, shape (4, ...), or None
        ux, uy, sin e, and one row that is not filled; None of a single place.
    """

    ux: np.ndarray
    uy: np.ndarray
    horizontal: np.ndarray
    vx: np.ndarray
    vy: np.ndarray
    sin_e: np.ndarray
    cos_e: np.ndarray
    room: np.ndarray | None


def values(coefficients, mount):
    """Coefficients in the order of `CANONICAL`, radians; ValueError: an unknown one."""
    terms = mount.names.terms
    unknown = [name for name in coefficients if name not in terms]
    if unknown:
        raise ValueError(
            f'{", ".join(unknown)} is no geometric term; this rotation knows {", ".join(terms)}'
        )
    by_name = {own: sign * float(coefficients.get(name, 0.0))
               for name, (own, sign) in terms.items()}
    return [by_name[name] for name in CANONICAL]


def small_angle(sine, cosine):
    """The angle of a sine and cosine, to the last digit where it is small; radians.

    `cosine` None: below an eighth of a turn.
    """
    square = sine * sine
    if square.ndim == 0:
        small = square < _SMALL and cosine > 0.0
        return _of_sine(sine, square, square) if small else np.arctan2(sine, cosine)
    if not square.size:
        return square
    most = np.maximum.reduce(square, axis=None)
    angle = _of_sine(sine, square, most)
    if cosine is None:
        if not most < _SMALL:  # or NaN
            far = square >= _SMALL
            angle[far] = np.arcsin(sine[far])
    elif not (most < _SMALL and np.minimum.reduce(cosine, axis=None) > 0.0):
        far = ~((square < _SMALL) & (cosine > 0.0))
        angle[far] = np.arctan2(sine[far], cosine[far])
    return angle


def _of_sine(sine, square, most):
    """The small angle of a sine, its square and the largest of those."""
    if most < _TINY:  # the next term is below the last digit
        angle = square * (3.0 / 40.0)
    else:
        angle = square * (15.0 / 336.0)
        angle += 3.0 / 40.0
        angle *= square
    angle += 1.0 / 6.0
    angle *= square
    angle *= sine
    angle += sine
    return angle


def turned(place, wx, wy):
    """Rotate a vector by the horizontal rotation vector (wx, wy, 0) (Rodrigues)."""
    if wx == wy == 0.0:
        return place
    x, y, z = place
    return tuple(a * x + b * y + c * z for a, b, c in _turning(wx, wy))


def _turning(wx, wy):
    """The rotation of `turned`, its rows."""
    angle = hypot(wx, wy)
    if angle == 0.0:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    sine = sin(angle) / angle
    versine = 2.0 * (sin(angle / 2.0) / angle) ** 2  # (1 - cos) / angle^2 without cancellation
    cosine, both = cos(angle), versine * wx * wy
    return ((cosine + versine * wx * wx, both, sine * wy),
            (both, cosine + versine * wy * wy, -sine * wx),
            (-sine * wy, sine * wx, cosine))


def _dot(place, zenith):
    x, y, z = zenith
    return place[0] * x + place[1] * y + place[2] * z


def _beside(place, zenith):
    """Sine of the distance from the zenith, without the cancellation of 1 - sin^2 E there."""
    (x, y, z), (a, b, c) = place, zenith
    return np.sqrt(np.square(y * c - z * b) + np.square(z * a - x * c) + np.square(x * b - y * a))


def _lifted(place, tf, zenith):
    """Unit vectors turned toward the zenith by TF cos E."""
    sin_el, cos_el = _dot(place, zenith), _beside(place, zenith)
    angle = tf * cos_el
    sine, cosine = _of_small(angle, tf)
    # sin(angle) / cos E, which is TF where nothing is left of either
    along = sine / cos_el if cos_el.all() else tf * np.sinc(angle / np.pi)
    kept = cosine - along * sin_el
    return tuple(kept * p + along * c for p, c in zip(place, zenith))


def lowered(place, tf, zenith, star, height=None):
    """The inverse of `_lifted`: by as much as it lifts `star`; `height`: `height_of` the place."""
    high, low = height_of(place, zenith) if height is None else height
    sine, cosine = _of_small(tf * _beside(star, zenith), tf)
    along = sine / low
    kept = cosine + along * high
    return tuple(kept * p - along * c for p, c in zip(place, zenith))


def height_of(place, zenith):
    """Sine and cosine of the elevation; the cosine never 0."""
    return _dot(place, zenith), np.maximum(_beside(place, zenith), 1e-150)


def _of_small(angle, most):
    """Sine and cosine of angles that are not beyond `most`."""
    if abs(most) > _BENT:
        return np.sin(angle), np.cos(angle)
    square = angle * angle  # the next terms are below 1e-16
    return (angle * (1.0 - square * (1.0 / 6.0 - square / 120.0)),
            1.0 - square * (0.5 - square * (1.0 / 24.0 - square / 720.0)))


def to_axes(sines, coefficients, mount):
    """What the rotations add to the angles of a direction, but for the zeros of the axes.

    Parameters
    ----------
    sines : tuple of ndarray, shape (n,)
        sin A, cos A, sin E, cos E of the catalogue place; one through the pole has a negative
        cos E, and the solution is that on its side.
    coefficients : sequence of float
        In the order of `CANONICAL`, radians. Flexure acts here for a mount that is not an
        alt-azimuth one.
    mount : Mount
        Whose errors are its own.

    Returns
    -------
    d_az, d_el : ndarray
        Radians, in -pi to pi; NaN where the mount cannot look.
    way : Way
    """
    _, _, ca, npae, an, aw, tf = coefficients
    sin_a, cos_a, sin_el, cos_el = sines
    sin_c, cos_c, sin_n, cos_n = sin(ca), cos(ca), sin(npae), cos(npae)
    if np.ndim(sin_el) == 0:
        place = cos_el * sin_a, cos_el * cos_a, sin_el
        if tf and not mount.vertical:
            place = _lifted(place, tf, mount.zenith)
        ux, uy, uz = turned(place, an, aw)
        sin_e = (uz + sin_c * sin_n) / (cos_c * cos_n)
        clear, room, beyond = False, None, bool(cos_el < 0.0)
    else:  # a call of numpy costs as much as tens of stars: all that is linear in one product
        place = np.empty((3, *sin_el.shape))
        np.multiply(cos_el, sin_a, out=place[0])
        np.multiply(cos_el, cos_a, out=place[1])
        place[2] = sin_el
        if tf and not mount.vertical:
            place = np.array(_lifted(place, tf, mount.zenith))
        room = np.empty((4, *sin_el.shape))
        np.matmul(np.array(_turning(an, aw)), place.reshape(3, -1), out=room[:3].reshape(3, -1))
        ux, uy, sin_e = room[:3]
        sin_e += sin_c * sin_n
        sin_e *= 1.0 / (cos_c * cos_n)
        lowest = np.minimum.reduce(cos_el, axis=None, initial=1.0)
        clear = mount.vertical and lowest > _BESIDE * (hypot(an, aw) + abs(ca) + abs(npae))
        beyond = False if lowest >= 0.0 else cos_el < 0.0  # NaN is below nothing
    vx = (-cos_c * sin_n) * sin_e - sin_c * cos_n
    horizontal = ux * ux + uy * uy
    with np.errstate(invalid='ignore', divide='ignore'):
        # NaN: a direction closer to the axis than the line of sight
        vy = np.sqrt(horizontal - vx * vx)
        if beyond is not False:
            vy = np.where(beyond, -vy, vy)
        cos_e = vy * (1.0 / cos_c)
        across, along = ux * cos_a - uy * sin_a, ux * sin_a + uy * cos_a
        if np.ndim(sin_el) == 0:
            d_az = small_angle((vy * across - vx * along) / horizontal,
                               (vx * across + vy * along) / horizontal)
            d_el = small_angle(sin_e * cos_el - cos_e * sin_el, cos_e * cos_el + sin_e * sin_el)
        else:
            sine = np.empty((2, *sin_el.shape))
            np.divide(vy * across - vx * along, horizontal, out=sine[0])
            np.subtract(sin_e * cos_el, cos_e * sin_el, out=sine[1])
            cosine = None
            if not clear:
                cosine = np.empty_like(sine)
                np.divide(vx * across + vy * along, horizontal, out=cosine[0])
                np.add(cos_e * cos_el, sin_e * sin_el, out=cosine[1])
            d_az, d_el = small_angle(sine, cosine)
    return d_az, d_el, Way(ux, uy, horizontal, vx, vy, sin_e, cos_e, room)


def derivatives(sines, coefficients, way, names, mount, tangent=None):
    """On-sky columns (x, y) of some of `CANONICAL` where `to_axes` has been.

    Parameters
    ----------
    sines, coefficients, mount
        As of `to_axes`.
    way : Way
    names : sequence of str
        Of `CANONICAL`.
    tangent : callable, optional
        ``tangent() -> (x, y)``: the column of the flexure of another mount than an alt-azimuth one.

    Returns
    -------
    dict of str to (ndarray or float, ndarray or float)
        Those of AN and AW neglect the square of the tilt against one.
    """
    _, _, ca, npae, an, aw, _ = coefficients
    cos_el = sines[3]
    out = {}
    for name in names:
        if name in ('IA', 'IE', 'TF'):
            out[name] = ((cos_el, 0.0) if name == 'IA' else (0.0, 1.0) if name == 'IE' else
                         (0.0, cos_el) if mount.vertical else tangent())
    ux, uy, horizontal, vx, vy, sin_e, cos_e, room = way
    sin_c, cos_c, sin_n, cos_n = sin(ca), cos(ca), sin(npae), cos(npae)
    high, skew, low = cos_c * cos_n, -cos_c * sin_n, sin_c * sin_n
    # what sin e, vx, ux and uy change by, each in parts of ux, uy, sin e and 1
    by_e, by_vx, by_ux, by_uy = [], [], [], []
    tilts = [tilt for tilt in (('AN', 1.0, 0.0), ('AW', 0.0, 1.0)) if tilt[0] in names]
    for _, wx, wy in tilts:
        # right Jacobian of the rotation to first order: w + (w x tilt) / 2 about the zenith
        wz = 0.5 * (an * wy - aw * wx)
        by_e.append((-wy / high, wx / high, 0.0, 0.0))
        by_vx.append((-wy * skew / high, wx * skew / high, 0.0, 0.0))
        by_ux.append((0.0, -wz, wy * high, -wy * low))  # of uz = high sin e - low
        by_uy.append((wz, 0.0, -wx * high, wx * low))
    squares = [of for of in (('CA', sin_c / cos_c, sin_n / cos_n, low, -high),
                             ('NPAE', sin_n / cos_n, sin_c / cos_c, -high, low)) if of[0] in names]
    for _, per_sine, more, vx_per_sine, vx_more in squares:
        by_e.append((0.0, 0.0, per_sine, more))
        by_vx.append((0.0, 0.0, vx_per_sine + skew * per_sine, vx_more + skew * more))
    if not by_e:
        return out
    if room is None:
        ux, uy, sin_e = np.broadcast_arrays(ux, uy, sin_e)
        room = np.array((ux, uy, sin_e, sin_e))
    room[3] = 1.0
    of = np.array(by_e + by_vx + by_ux + by_uy) @ room.reshape(4, -1)
    of = of.reshape(len(of), *ux.shape)
    m, k = len(by_e), len(tilts)
    y, x = of[:m], of[m:2 * m]
    to_x, slope = cos_el / horizontal, vx / vy
    x *= -to_x * (vx * slope + vy)
    if k:
        across, along = of[2 * m:2 * m + k], of[2 * m + k:]
        across *= to_x * (uy + ux * slope)
        along *= to_x * (uy * slope - ux)
        across += along
        x[:k] += across
    y *= 1.0 / cos_e
    out.update((name, (x[i], y[i])) for i, (name, *_) in enumerate(tilts + squares))
    return out


def to_sky(sines, coefficients, mount):
    """What is to be added to axis angles for the direction in which the mount looks.

    Parameters
    ----------
    sines : tuple of ndarray, shape (n,)
        Of the axis angles without their zeros: sin a, cos a, sin e, cos e.
    coefficients : sequence of float
        In the order of `CANONICAL`, radians.
    mount : Mount
        Whose errors are its own.

    Returns
    -------
    d_az, d_el : ndarray
        Radians, in -pi to pi; of an alt-azimuth mount to an elevation below 90 degrees. NaN where
        the flexure does not converge.
    """
    _, _, ca, npae, an, aw, tf = coefficients
    sin_a, cos_a, sin_el, cos_el = sines
    sin_c, cos_c, sin_n, cos_n = sin(ca), cos(ca), sin(npae), cos(npae)

    def look(sin_e, cos_e):
        vx = (-cos_c * sin_n) * sin_e - sin_c * cos_n
        vy = cos_c * cos_e
        vz = (cos_c * cos_n) * sin_e - sin_c * sin_n
        return turned((vx * cos_a + vy * sin_a, vy * cos_a - vx * sin_a, vz), -an, -aw)

    x, y, z = look(sin_el, cos_el)
    settled, side = True, np.where(cos_el < 0.0, -1.0, 1.0)
    if tf and mount.vertical:
        bend = 0.0
        for _ in range(_STEPS):  # bend = TF cos E, by Newton
            step = (tf * side * np.sqrt(x * x + y * y) - bend) / (1.0 - tf * z)
            bend = bend + step
            sine, cosine = _of_small(bend, 2.0 * tf)
            x, y, z = look(sin_el * cosine - cos_el * sine, cos_el * cosine + sin_el * sine)
            # even plain iteration leaves no more
            settled = np.abs(tf * step) <= 10.0 * _TOLERANCE
            if np.all(settled):
                break
    elif tf:
        there, star = (x, y, z), (x, y, z)
        height = height_of(there, mount.zenith)
        for _ in range(_STEPS):
            before, star = star, lowered(there, tf, mount.zenith, star, height)
            step = sum(np.square(one - other) for one, other in zip(star, before))
            settled = step <= _TOLERANCE * _TOLERANCE
            if np.all(settled):
                break
        x, y, z = star
    horizontal = np.sqrt(x * x + y * y)
    if not mount.vertical:
        x, y, horizontal = side * x, side * y, side * horizontal
    with np.errstate(invalid='ignore', divide='ignore'):
        d_el = small_angle(z * cos_el - horizontal * sin_el, horizontal * cos_el + z * sin_el)
        scale = 1.0 / np.sqrt(x * x + y * y)
        d_az = small_angle((x * cos_a - y * sin_a) * scale, (x * sin_a + y * cos_a) * scale)
    if not np.all(settled):
        d_az, d_el = np.where(settled, d_az, np.nan), np.where(settled, d_el, np.nan)
    return d_az, d_el


def in_turn(angle):
    """`wrap` where something is out of it."""
    if angle.ndim == 0:
        return angle if -np.pi <= angle < np.pi else wrap(angle)
    if (angle.ndim == 1 and np.dot(angle, angle) < np.pi * np.pi) or not angle.size:
        return angle  # as the sum of the squares is
    return angle if angle.max() < np.pi and angle.min() >= -np.pi else wrap(angle)
