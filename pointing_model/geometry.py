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

from .mount_kinds import CANONICAL
from .mounts import ALTAZ, OF_MOUNT, sides
from .rotations import derivatives, in_turn, lowered, to_axes, to_sky, turned, values
from .trig import BLOCK, sincos

#: The coefficients that this module understands, of an alt-azimuth mount.
GEOMETRIC = CANONICAL

_TOLERANCE = 1e-8 * ARCSEC
_STEPS = 50


def _blockwise(function, first, second):
    """``function(first, second)`` of as many places at a time as stay in the cache."""
    if first.ndim == 0:
        return function(first[()], second[()])
    if first.size <= BLOCK:
        return function(first, second)
    out = np.empty((2, *first.shape))
    flat, pairs = out.reshape(2, -1), (first.reshape(-1), second.reshape(-1))
    for begin in range(0, first.size, BLOCK):
        part = slice(begin, begin + BLOCK)
        flat[0, part], flat[1, part] = function(pairs[0][part], pairs[1][part])
    return out[0], out[1]


def _unit(az, el):
    cos_el = np.cos(el)
    return cos_el * np.sin(az), cos_el * np.cos(az), np.sin(el)


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
        on the side of the place.

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
    known = values(coefficients, mount)
    ia, ie, ca, npae, an, aw, tf = known
    if not (ca or npae or an or aw or (tf and not mount.vertical)):
        return az + ia, el + ie + (tf * np.cos(el) if tf else 0.0)
    az, el = np.broadcast_arrays(az, el)

    def ends(a, e):
        sines = *sincos(a), *sincos(e)
        d_az, d_el, _ = to_axes(sines, known, mount)
        d_el += ie
        if tf and mount.vertical:
            d_el += tf * sines[3]
        return a + in_turn(d_az + ia), e + d_el

    return _blockwise(ends, az, el)


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
    known = values(coefficients, mount)
    ia, ie, ca, npae, an, aw, tf = known
    if added is None:
        return _to_sky(az_enc, el_enc, known, mount)
    sin_c, cos_c, sin_n, cos_n = np.sin(ca), np.cos(ca), np.sin(npae), np.cos(npae)

    def look(a, e, star=None):
        sin_e = np.sin(e)
        vx = -sin_c * cos_n - cos_c * sin_n * sin_e
        vy = cos_c * np.cos(e)
        vz = cos_c * cos_n * sin_e - sin_c * sin_n
        sin_a, cos_a = np.sin(a), np.cos(a)
        place = turned((vx * cos_a + vy * sin_a, vy * cos_a - vx * sin_a, vz), -an, -aw)
        if star is not None:
            place = lowered(place, tf, mount.zenith, star)
        x, y, z = place
        side = np.where(vy < 0.0, -1.0, 1.0)
        az, el = np.arctan2(side * x, side * y), np.arctan2(z, side * np.hypot(x, y))
        return az_enc + wrap(az - az_enc), el if mount.vertical else el_enc + wrap(el - el_enc)

    a, e = az_enc - ia, el_enc - ie
    az, el = look(a, e)
    for _ in range(_STEPS):
        d_az, d_el = added(az, el)
        if mount.vertical:
            az_new, el_new = look(a - d_az, e - d_el - tf * np.cos(el))
        else:
            az_new, el_new = look(a - d_az, e - d_el, _unit(az, el) if tf else None)
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


def _to_sky(az_enc, el_enc, known, mount):
    """`encoder_to_sky` of the rotations alone, without trigonometry but of the readings."""

    def place(a, e):
        d_az, d_el = to_sky((*sincos(a - known[0]), *sincos(e - known[1])), known, mount)
        d_el -= known[1]
        # an elevation in another turn has its place within the first
        return (a + in_turn(d_az - known[0]),
                in_turn(e + d_el) if mount.vertical else e + in_turn(d_el))

    return _blockwise(place, *np.broadcast_arrays(az_enc, el_enc))


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
    known = values(coefficients, mount)
    sines = *sincos(az), *sincos(el)
    x, y, columns = linearised(az, el, sines, known, _canonical(names, mount), mount)
    return x, y, {name: columns[own] if sign > 0 else tuple(-v for v in columns[own])
                  for name, (own, sign) in ((n, mount.names.terms[n]) for n in names)}


def _canonical(names, mount):
    return [mount.names.terms[name][0] for name in names]


def linearised(az, el, sines, known, names, mount):
    """As `offsets_and_jacobian`, in the names of `CANONICAL` and with the sines at hand.

    Parameters
    ----------
    az, el : ndarray, shape (n,)
        Radians.
    sines : tuple of ndarray, shape (n,)
        sin A, cos A, sin E, cos E.
    known : sequence of float
        Coefficients in the order of `CANONICAL`, radians.
    names : sequence of str
        Derivatives to these.
    mount : Mount
        Whose errors are its own.
    """
    ia, ie, tf = known[0], known[1], known[6]
    cos_el = sines[3]
    d_az, d_el, way = to_axes(sines, known, mount)
    d_az += ia
    x = in_turn(d_az) * cos_el
    d_el += ie
    if tf and mount.vertical:
        d_el += tf * cos_el

    def tangent():
        return tuple(np.tensordot((0.0, 0.0, 1.0), t, 1) for t in mount.tangents(az, el))

    return x, d_el, derivatives(sines, known, way, names, mount, tangent)
