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

"""The exact geometry of a mount: rotations in closed form, both ways.

In the frame of the mount's axes (of an alt-azimuth mount east, north, up; see `mounts`) the line
of sight is::

    s = T(AN, AW) Rz(-a) N(NPAE) Rx(e) b(CA),    b = (-sin CA, cos CA, 0)

with the axis angles a = A_enc - IA and e = E_enc - IE. Rx turns about the elevation
axis (to the right of the tube), N lifts the right end of that axis by NPAE, Rz turns the mount
from north to east, and T is the shortest rotation that tilts the azimuth axis by (AN, AW) to
north and west: T = exp of the rotation vector (-AN, -AW, 0). To first order this is the design
of `pointing_terms`. The second order differs: 60" of tilt with 60" of collimation make 0.26"
at 85 degrees of elevation.

In another frame the terms have other names (IH ID CH NP MA ME; `Mount.names`), with the same
rotations. A place (a, e) with e beyond the pole is reached with cos e < 0: of the two solutions
the one on that side is taken, so no sign has to be switched with the side. If errors act on the
sky (`Mount.errors`), all of this is done at the place folded back to the sky.

The flexure TF cos E follows gravity on any mount: the direction is lifted by it toward the zenith
before the rotations. E is the catalogue elevation, as in the design columns and in every other
empirical term. It is inverted by iteration; each step reduces the error by a factor TF.
"""

from math import cos, hypot, sin

import numpy as np

from msg_tools.units import ARCSEC, wrap

from .mount_kinds import CANONICAL
from .mounts import ALTAZ, OF_MOUNT, sides
from .pointing_terms import TERMS, Trig

_TOLERANCE = 1e-8 * ARCSEC
_STEPS = 50


def values(coefficients, mount):
    """Coefficients in the order of `CANONICAL`, radians; ValueError for an unknown name."""
    terms = mount.names.terms
    unknown = [name for name in coefficients if name not in terms]
    if unknown:
        raise ValueError(
            f'{", ".join(unknown)} is no geometric term; this rotation knows {", ".join(terms)}'
        )
    by_name = {own: sign * float(coefficients.get(name, 0.0))
               for name, (own, sign) in terms.items()}
    return [by_name[name] for name in CANONICAL]


def _tilted(place, wx, wy):
    """Vectors, shape (3, ...), rotated by the horizontal vector (wx, wy, 0) (Rodrigues)."""
    angle = hypot(wx, wy) / np.pi
    cross = np.array([[0.0, 0.0, wy], [0.0, 0.0, -wx], [-wy, wx, 0.0]])
    turn = np.eye(3) + np.sinc(angle) * cross + 0.5 * np.sinc(angle / 2.0)**2 * cross @ cross
    return np.tensordot(turn, place, 1)


def _lift(trig, tf):
    """By TF cos E toward the zenith: what to multiply a direction by, what to add of the zenith."""
    angle = tf * trig.zenith.cos_el
    along = tf * np.sinc(angle / np.pi)
    return np.cos(angle) - along * trig.zenith.sin_el, np.multiply.outer(trig.mount.zenith, along)


def _unit(trig):
    return np.array([trig.cos_el * trig.sin_az, trig.cos_el * trig.cos_az, trig.sin_el])


def sky_to_encoder(az, el, coefficients, mount=ALTAZ):
    """Encoder angles at which the mount points at a direction.

    Parameters
    ----------
    az, el : float or ndarray
        Catalogue place by the axes of the mount (`Mount.axes_of`), radians.
    coefficients : dict of str to float
        Any of the mount's geometric terms, radians; a missing one is zero.
    mount : Mount, optional

    Returns
    -------
    az_enc, el_enc : ndarray
        Radians; the azimuth is on the branch nearest to `az`. NaN where the mount cannot point:
        closer to its pole than collimation and non-perpendicularity allow. The solution is on
        the same side as the place.

    Raises
    ------
    ValueError
        A name in `coefficients` is not geometric.
    """
    az, el = np.broadcast_arrays(np.asarray(az, float), np.asarray(el, float))
    trig, known = Trig(az, el, mount), values(coefficients, mount)
    ia, ie, *turning = known
    if any(turning):
        d_az, d_el, _ = _to_axes(trig, known)
    else:  # a perfect mount can point at its pole
        d_az, d_el = ia, ie
    return az + wrap(d_az), el + (d_el if trig.side is None else trig.side * wrap(d_el))


def _to_axes(trig, known):
    """Offsets that the coefficients add to the axis angles of a direction.

    Parameters
    ----------
    trig : Trig
        Trigonometric functions of the directions.
    known : sequence of float
        Coefficients in the order of `CANONICAL`, radians.

    Returns
    -------
    d_az, d_el : ndarray
        Radians; NaN where the mount cannot point.
    way : tuple of ndarray
        On the way: horizontal components of the direction in the base frame, and the sum of their
        squares; components before the azimuth rotation, sine and cosine of the second angle.
    """
    ia, ie, ca, npae, an, aw, tf = known
    sin_az, cos_az, sin_el, cos_el = trig.sin_az, trig.cos_az, trig.sin_el, trig.cos_el
    sin_c, cos_c, sin_n, cos_n = sin(ca), cos(ca), sin(npae), cos(npae)
    place = _unit(trig)
    if tf:
        kept, lifted = _lift(trig, tf)
        place *= kept
        place += lifted
    ux, uy, uz = _tilted(place, an, aw)
    sin_e = (uz + sin_c * sin_n) / (cos_c * cos_n)
    vx = -cos_c * sin_n * sin_e - sin_c * cos_n
    horizontal = ux * ux + uy * uy
    with np.errstate(invalid='ignore'):
        vy = np.sqrt(horizontal - vx * vx)
    vy = np.where(cos_el < 0.0, -vy, vy)
    cos_e = vy / cos_c
    across, along = ux * cos_az - uy * sin_az, ux * sin_az + uy * cos_az
    d_az = np.arctan2(vy * across - vx * along, vx * across + vy * along)
    d_el = np.arctan2(sin_e * cos_el - cos_e * sin_el, cos_e * cos_el + sin_e * sin_el)
    return d_az + ia, d_el + ie, (ux, uy, horizontal, vx, vy, sin_e, cos_e)


def encoder_to_sky(az_enc, el_enc, coefficients, added=None, mount=ALTAZ):
    """Direction in which the mount points at given encoder angles: the inverse.

    Parameters
    ----------
    az_enc, el_enc : float or ndarray
        Encoder angles, radians; an elevation beyond 90 degrees is a tube past the zenith.
    coefficients : dict of str to float
        Any of the mount's geometric terms, radians; a missing one is zero.
    added : callable, optional
        ``added(az, el) -> (d_az, d_el)``: further offsets of the encoder angles, as a function
        of the catalogue place, radians.
    mount : Mount, optional

    Returns
    -------
    az, el : ndarray
        Catalogue place, radians, inverse of `sky_to_encoder` to 1e-6 arcsec; the azimuth is on
        the branch nearest to the encoder's. For an alt-azimuth mount the elevation is folded
        back below 90 degrees; for others a place through the pole remains so. NaN where the
        iteration for flexure and `added` does not converge (within their size from the pole).

    Raises
    ------
    ValueError
        A name in `coefficients` is not geometric.
    """
    az_enc, el_enc = np.broadcast_arrays(np.asarray(az_enc, float), np.asarray(el_enc, float))
    if mount.on_sky:
        return _folded(az_enc, el_enc, coefficients, added, mount.with_errors(OF_MOUNT))
    ia, ie, ca, npae, an, aw, tf = values(coefficients, mount)
    sin_c, cos_c, sin_n, cos_n = sin(ca), cos(ca), sin(npae), cos(npae)

    def look(a, e, star=None):
        sin_e, sin_a, cos_a = np.sin(e), np.sin(a), np.cos(a)
        vx = -sin_c * cos_n - cos_c * sin_n * sin_e
        vy = cos_c * np.cos(e)
        vz = cos_c * cos_n * sin_e - sin_c * sin_n
        place = _tilted(np.array([vx * cos_a + vy * sin_a, vy * cos_a - vx * sin_a, vz]), -an, -aw)
        if star is not None:
            kept, lifted = _lift(star, tf)
            place -= lifted
            place /= kept
        x, y, z = place
        side = np.where(vy < 0.0, -1.0, 1.0)
        az, el = np.arctan2(side * x, side * y), np.arctan2(z, side * np.hypot(x, y))
        return az_enc + wrap(az - az_enc), el if mount.vertical else el_enc + wrap(el - el_enc)

    a, e = az_enc - ia, el_enc - ie
    az, el = look(a, e)
    for _ in range(_STEPS):
        d_az, d_el = added(az, el) if added else (0.0, 0.0)
        az_new, el_new = look(a - d_az, e - d_el, Trig(az, el, mount) if tf else None)
        step = np.hypot(wrap(az_new - az) * np.cos(el_new), wrap(el_new - el))
        az, el = az_new, el_new
        open_ = step > _TOLERANCE
        if not open_.any():
            break
    else:
        az, el = np.where(open_, np.nan, az), np.where(open_, np.nan, el)
    if mount.vertical:
        az, el, _ = sides(az, el)
        az = az_enc + wrap(az - az_enc)
    return az, el


def _folded(az_enc, el_enc, coefficients, added, mount):
    """`encoder_to_sky` of a mount whose errors act on the sky, before the flip."""
    a_enc, e_enc, side = sides(az_enc, el_enc)

    def unfolded(a, e):
        return az_enc + wrap(a - a_enc), el_enc + side * wrap(e - e_enc)

    def added_there(a, e):
        d_az, d_el = added(*unfolded(a, e))
        return d_az, side * d_el
    return unfolded(*encoder_to_sky(a_enc, e_enc, coefficients, added and added_there, mount))


def offsets(az, el, coefficients, mount=ALTAZ):
    """Encoder - catalogue of the exact rotations, on the sky.

    Parameters
    ----------
    az, el : float or ndarray
        Catalogue place, radians.
    coefficients : dict of str to float
        Any of the mount's geometric terms, radians.
    mount : Mount, optional

    Returns
    -------
    x, y : ndarray
        delta-A cos E and delta-E, radians; through the pole both are reversed on the sky.
    """
    az_enc, el_enc = sky_to_encoder(az, el, coefficients, mount)
    return wrap(az_enc - az) * np.cos(el), el_enc - el


def linearised(trig, known, names):
    """Exact offsets and their derivatives with respect to the coefficients, for Gauss-Newton steps.

    Parameters
    ----------
    trig : Trig
        Trigonometric functions of the catalogue places.
    known : sequence of float
        Point of linearisation: coefficients in the order of `CANONICAL`, radians.
    names : sequence of str
        Names from `CANONICAL` to differentiate by.

    Returns
    -------
    x, y : ndarray, shape (n,)
        delta-A cos E and delta-E, radians, without the sign of the side.
    jacobian : dict of str to (ndarray or float, ndarray or float)
        On-sky columns (x, y) of each of `names`. Those of AN and AW neglect the square of the
        tilt relative to one (4e-7 at 300"). That of TF is of first order.
    """
    d_az, d_el, way = _to_axes(trig, known)
    return wrap(d_az) * trig.cos_el, d_el, {
        name: _derivative(name, trig, known, way) for name in names}


def _derivative(name, trig, known, way):
    """On-sky column (x, y) of one coefficient of `CANONICAL`, at the solution of `_to_axes`."""
    cos_el = trig.cos_el
    if name == 'IA':
        return cos_el, 0.0
    if name == 'IE':
        return 0.0, 1.0
    if name == 'TF':
        return TERMS['TF'].of(trig)
    _, _, ca, npae, an, aw, _ = known
    ux, uy, horizontal, vx, vy, sin_e, cos_e = way
    sin_c, cos_c, sin_n, cos_n = sin(ca), cos(ca), sin(npae), cos(npae)
    high, skew, low = cos_c * cos_n, -cos_c * sin_n, sin_c * sin_n
    to_x, slope = cos_el / horizontal, vx / vy
    if name in ('CA', 'NPAE'):
        tan_c, tan_n = sin_c / cos_c, sin_n / cos_n
        if name == 'CA':
            d_sin_e, d_vx = tan_c * sin_e + tan_n, low * sin_e - high
        else:
            d_sin_e, d_vx = tan_n * sin_e + tan_c, low - high * sin_e
        x = 0.0
    else:
        # right Jacobian of the rotation to first order: w + (w x tilt) / 2 about the zenith
        wx, wy = (1.0, 0.0) if name == 'AN' else (0.0, 1.0)
        wz = 0.5 * (an * wy - aw * wx)
        d_ux, d_uy = wy * (high * sin_e - low) - wz * uy, wz * ux - wx * (high * sin_e - low)
        d_sin_e, d_vx = (wx * uy - wy * ux) / high, 0.0
        x = to_x * ((uy + ux * slope) * d_ux + (uy * slope - ux) * d_uy)
    return x - to_x * (vx * slope + vy) * (d_vx + skew * d_sin_e), d_sin_e / cos_e
