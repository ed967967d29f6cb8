"""The exact geometry of a mount: rotations in closed form, both ways.

In the frame of the mount's axes (of an alt-azimuth mount east, north, up; see `mounts`) the line
of sight is::

    s = T(AN, AW) Rz(-a) N(NPAE) Rx(e) b(CA),    b = (-sin CA, cos CA, 0)

with the axis angles a = A_enc - IA and e = E_enc - IE - TF cos E. Rx turns about the elevation
axis (to the right of the tube), N lifts the right end of that axis by NPAE, Rz turns the mount
from north to east, and T is the shortest rotation that leans the azimuth axis by (AN, AW) to
north and west: T = exp of the rotation vector (-AN, -AW, 0). To first order this is the design
of `terms`; to second order it is not, and 60" of tilt with 60" of collimation make 0.26" at 85
degrees of elevation.

In another frame the names are others (IH ID CH NP MA ME; `Mount.names`) and the rotations the
same. A place (a, e) with e beyond the pole is reached there with cos e < 0: of the two solutions
the one on that side is taken, so that signs which change with the side need not be known. Where
errors act on the sky (`Mount.errors`), all of this is done at the place folded back to it.

E in the flexure TF cos E is the catalogue elevation, as in the design columns and in every
other empirical term; it is undone by iteration, which shrinks an error by TF in each step. It
lifts the line of sight toward the zenith: of an alt-azimuth mount it is added to the elevation,
of another the direction is turned by it before the rotations.
"""

import numpy as np

from msg_tools.units import ARCSEC, wrap

from .mount_names import CANONICAL
from .mounts import ALTAZ, OF_MOUNT, sides

#: The coefficients that this module understands, of an alt-azimuth mount.
GEOMETRIC = CANONICAL

_TOLERANCE = 1e-8 * ARCSEC
_STEPS = 50


def _values(coefficients, mount):
    terms = mount.names.terms
    unknown = [name for name in coefficients if name not in terms]
    if unknown:
        raise ValueError(
            f'{", ".join(unknown)} is no geometric term; this rotation knows {", ".join(terms)}'
        )
    by_name = {own: sign * float(coefficients.get(name, 0.0))
               for name, (own, sign) in terms.items()}
    return [by_name[name] for name in CANONICAL]


def _unit(az, el):
    cos_el = np.cos(el)
    return cos_el * np.sin(az), cos_el * np.cos(az), np.sin(el)


def _turn(vector, wx, wy):
    """Rotate `vector` by the horizontal rotation vector (wx, wy, 0) (Rodrigues)."""
    x, y, z = vector
    angle = np.hypot(wx, wy)
    if angle == 0.0:
        return vector
    sine = np.sin(angle) / angle
    versine = 2.0 * (np.sin(angle / 2.0) / angle) ** 2  # (1 - cos) / angle^2 without cancellation
    along = versine * (wx * x + wy * y)
    cosine = np.cos(angle)
    return (
        cosine * x + sine * wy * z + along * wx,
        cosine * y - sine * wx * z + along * wy,
        cosine * z + sine * (wx * y - wy * x),
    )


def _lifted(place, tf, zenith):
    """Unit vectors turned toward the zenith by TF cos E."""
    x, y, z = place
    sin_el = x * zenith[0] + y * zenith[1] + z * zenith[2]
    cos_el = np.sqrt(np.maximum(1.0 - sin_el * sin_el, 0.0))
    angle = tf * cos_el
    # sin(angle) / cos E, of which nothing is left at the zenith
    along = tf * np.sinc(angle / np.pi)
    kept = np.cos(angle) - along * sin_el
    return tuple(kept * p + along * c for p, c in zip(place, zenith))


def _lowered(place, tf, zenith, star):
    """The inverse of `_lifted`: by as much as it lifts `star`."""
    sin_el = star[0] * zenith[0] + star[1] * zenith[1] + star[2] * zenith[2]
    angle = tf * np.sqrt(np.maximum(1.0 - sin_el * sin_el, 0.0))
    high = place[0] * zenith[0] + place[1] * zenith[1] + place[2] * zenith[2]
    along = np.sin(angle) / np.sqrt(np.maximum(1.0 - high * high, 1e-300))
    kept = np.cos(angle) + along * high
    return tuple(kept * p - along * c for p, c in zip(place, zenith))


def _side(el, mount):
    """-1 where a place is one through the pole."""
    return 1.0 if mount.altaz else np.where(np.cos(el) < 0.0, -1.0, 1.0)


def _axes(az, el, ca, npae, an, aw, tf, mount):
    """Axis angles and the vectors on the way: u on the mount's base, v before the azimuth turn."""
    place = _unit(az, el)
    if tf and not mount.altaz:
        place = _lifted(place, tf, mount.zenith)
    ux, uy, uz = _turn(place, an, aw)
    sin_c, cos_c, sin_n, cos_n = np.sin(ca), np.cos(ca), np.sin(npae), np.cos(npae)
    sin_e = (uz + sin_c * sin_n) / (cos_c * cos_n)
    vx = -sin_c * cos_n - cos_c * sin_n * sin_e
    with np.errstate(invalid='ignore'):  # a direction closer to the axis than the line of sight
        vy = _side(el, mount) * np.sqrt(ux * ux + uy * uy - vx * vx)
    e = np.arctan2(sin_e, vy / cos_c)
    if not mount.altaz:
        e = el + wrap(e - el)
    a = np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy)
    return a, e, (ux, uy, uz), (vx, vy), sin_e


def sky_to_encoder(az, el, coefficients, mount=ALTAZ):
    """Encoder angles at which the mount looks at a direction.

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
        Radians; the azimuth on the branch nearest to `az`. NaN where the mount cannot look:
        nearer to its pole than collimation and non-perpendicularity allow. The solution is that
        on the side of the place; of an alt-azimuth mount never the one past the zenith.

    Raises
    ------
    ValueError
        A name in `coefficients` is not geometric.
    """
    az, el = np.asarray(az, float), np.asarray(el, float)
    if mount.on_sky:
        a, e, side = sides(az, el)
        a_enc, e_enc = sky_to_encoder(a, e, coefficients, mount.with_errors(OF_MOUNT))
        return az + wrap(a_enc - a), el + side * wrap(e_enc - e)
    ia, ie, ca, npae, an, aw, tf = _values(coefficients, mount)
    bend = tf * np.cos(el) if mount.altaz else 0.0
    if ca or npae or an or aw or (tf and not mount.altaz):
        a, e = _axes(az, el, ca, npae, an, aw, tf, mount)[:2]
        return az + wrap(a + ia - az), e + ie + bend
    return az + ia, el + ie + bend


def encoder_to_sky(az_enc, el_enc, coefficients, added=None, mount=ALTAZ):
    """Direction at which the mount looks with given encoder angles: the inverse.

    Parameters
    ----------
    az_enc, el_enc : float or ndarray
        Encoder angles, radians; an elevation beyond 90 degrees is a tube past the zenith.
    coefficients : dict of str to float
        Any of the mount's geometric terms, radians; a missing one is zero.
    added : callable, optional
        ``added(az, el) -> (d_az, d_el)``: what else was added to the encoder angles, as a
        function of the catalogue place, radians.
    mount : Mount, optional

    Returns
    -------
    az, el : ndarray
        Catalogue place, radians, inverse of `sky_to_encoder` below 1e-6 arcsec; the azimuth on
        the branch nearest to the encoder's. Of an alt-azimuth mount the elevation is folded back
        to below 90 degrees; of another a place through the pole stays one. NaN where the
        iteration for flexure and `added` does not converge (within their size from the pole).

    Raises
    ------
    ValueError
        A name in `coefficients` is not geometric.
    """
    az_enc, el_enc = np.asarray(az_enc, float), np.asarray(el_enc, float)
    if mount.on_sky:
        return _folded(az_enc, el_enc, coefficients, added, mount.with_errors(OF_MOUNT))
    ia, ie, ca, npae, an, aw, tf = _values(coefficients, mount)
    sin_c, cos_c, sin_n, cos_n = np.sin(ca), np.cos(ca), np.sin(npae), np.cos(npae)

    def look(a, e, star=None):
        sin_e = np.sin(e)
        vx = -sin_c * cos_n - cos_c * sin_n * sin_e
        vy = cos_c * np.cos(e)
        vz = cos_c * cos_n * sin_e - sin_c * sin_n
        sin_a, cos_a = np.sin(a), np.cos(a)
        place = _turn((vx * cos_a + vy * sin_a, vy * cos_a - vx * sin_a, vz), -an, -aw)
        if star is not None:
            place = _lowered(place, tf, mount.zenith, star)
        x, y, z = place
        if mount.altaz:
            return az_enc + wrap(np.arctan2(x, y) - az_enc), np.arctan2(z, np.hypot(x, y))
        side = np.where(vy < 0.0, -1.0, 1.0)
        az, el = np.arctan2(side * x, side * y), np.arctan2(z, side * np.hypot(x, y))
        return az_enc + wrap(az - az_enc), el_enc + wrap(el - el_enc)

    a, e = az_enc - ia, el_enc - ie
    az, el = look(a, e)
    if tf == 0.0 and added is None:
        return az, el
    for _ in range(_STEPS):
        d_az, d_el = added(az, el) if added is not None else (0.0, 0.0)
        if mount.altaz:
            az_new, el_new = look(a - d_az, e - d_el - tf * np.cos(el))
        else:
            az_new, el_new = look(a - d_az, e - d_el, _unit(az, el) if tf else None)
        step = np.hypot(wrap(az_new - az) * np.cos(el_new), wrap(el_new - el))
        az, el = az_new, el_new
        open_ = step > _TOLERANCE
        if not open_.any():
            return az, el
    return np.where(open_, np.nan, az), np.where(open_, np.nan, el)


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


def offsets_and_jacobian(az, el, coefficients, names, mount=ALTAZ):
    """Exact offsets and their derivatives to the coefficients: one step of a Gauss-Newton fit.

    Parameters
    ----------
    az, el : ndarray, shape (n,)
        Catalogue place, radians.
    coefficients : dict of str to float
        Where to linearise; any of the mount's geometric terms, radians.
    names : sequence of str, length k
        Derivatives to these, each of the mount's geometric terms.
    mount : Mount, optional

    Returns
    -------
    x, y : ndarray, shape (n,)
        delta-A cos E and delta-E, radians.
    jacobian : dict of str to (ndarray or float, ndarray or float)
        On-sky columns (x, y) of each of `names`. Those of AN and AW neglect the square of the
        tilt against one (4e-7 at 300"); that of TF of another mount than an alt-azimuth one is
        of first order.
    """
    if mount.on_sky:
        az, el, side = sides(az, el)
        x, y, jacobian = offsets_and_jacobian(az, el, coefficients, names,
                                              mount.with_errors(OF_MOUNT))
        return side * x, side * y, {name: tuple(side * v for v in both)
                                    for name, both in jacobian.items()}
    ia, ie, ca, npae, an, aw, tf = _values(coefficients, mount)
    a, e, (ux, uy, uz), (vx, vy), sin_e = _axes(az, el, ca, npae, an, aw, tf, mount)
    cos_el = np.cos(el)
    x = wrap(a + ia - az) * cos_el
    y = e + ie + (tf * cos_el if mount.altaz else 0.0) - el
    sin_c, cos_c, sin_n, cos_n = np.sin(ca), np.cos(ca), np.sin(npae), np.cos(npae)
    cos_e = vy / cos_c
    horizontal = ux * ux + uy * uy

    def columns(d_sin_e, d_vx, dux=0.0, duy=0.0):
        d_vy = (ux * dux + uy * duy - vx * d_vx) / vy
        d_a = (dux * uy - ux * duy + d_vy * vx - d_vx * vy) / horizontal
        return d_a * cos_el, d_sin_e / cos_e

    def tilt(wx, wy):
        # right Jacobian of the rotation to first order: w + (w x tilt) / 2 about the zenith
        wz = 0.5 * (an * wy - aw * wx)
        dux, duy, duz = wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux
        d_sin_e = duz / (cos_c * cos_n)
        return columns(d_sin_e, -cos_c * sin_n * d_sin_e, dux, duy)

    def ca_column():
        d = (sin_c * cos_n * sin_e + cos_c * sin_n) / (cos_c * cos_n)
        return columns(d, -cos_c * cos_n + sin_c * sin_n * sin_e - cos_c * sin_n * d)

    def npae_column():
        d = (cos_c * sin_n * sin_e + sin_c * cos_n) / (cos_c * cos_n)
        return columns(d, sin_c * sin_n - cos_c * cos_n * sin_e - cos_c * sin_n * d)

    def bend():
        if mount.altaz:
            return 0.0, cos_el
        return tuple(np.tensordot((0.0, 0.0, 1.0), t, 1) for t in mount.tangents(az, el))

    jacobian = {
        'IA': lambda: (cos_el, 0.0), 'IE': lambda: (0.0, 1.0), 'TF': bend,
        'CA': ca_column, 'NPAE': npae_column,
        'AN': lambda: tilt(1.0, 0.0), 'AW': lambda: tilt(0.0, 1.0),
    }
    out = {}
    for name in names:
        own, sign = mount.names.terms[name]
        one = jacobian[own]()
        out[name] = one if sign > 0 else tuple(-v for v in one)
    return x, y, out
