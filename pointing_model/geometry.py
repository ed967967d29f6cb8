"""The exact geometry of an alt-az mount: rotations in closed form, both ways.

In east-north-up coordinates the line of sight is::

    s = T(AN, AW) Rz(-a) N(NPAE) Rx(e) b(CA),    b = (-sin CA, cos CA, 0)

with the axis angles a = A_enc - IA and e = E_enc - IE - TF cos E. Rx turns about the elevation
axis (to the right of the tube), N lifts the right end of that axis by NPAE, Rz turns the mount
from north to east, and T is the shortest rotation that leans the azimuth axis by (AN, AW) to
north and west: T = exp of the rotation vector (-AN, -AW, 0). To first order this is the design
of `terms`; to second order it is not, and 60" of tilt with 60" of collimation make 0.26" at 85
degrees of elevation.

E in the flexure TF cos E is the catalogue elevation, as in the design columns and in every
other empirical term; it is undone by iteration, which shrinks an error by TF in each step.
"""

import numpy as np

from msg_tools.units import ARCSEC, wrap

#: The coefficients that this module understands.
GEOMETRIC = ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF')

_TOLERANCE = 1e-8 * ARCSEC
_STEPS = 50


def _values(coefficients):
    unknown = [name for name in coefficients if name not in GEOMETRIC]
    if unknown:
        raise ValueError(
            f'{", ".join(unknown)} is no geometric term; this rotation knows {", ".join(GEOMETRIC)}'
        )
    return [float(coefficients.get(name, 0.0)) for name in GEOMETRIC]


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


def _axes(az, el, ca, npae, an, aw):
    """Axis angles and the vectors on the way: u on the mount's base, v before the azimuth turn."""
    ux, uy, uz = _turn(_unit(az, el), an, aw)
    sin_c, cos_c, sin_n, cos_n = np.sin(ca), np.cos(ca), np.sin(npae), np.cos(npae)
    sin_e = (uz + sin_c * sin_n) / (cos_c * cos_n)
    vx = -sin_c * cos_n - cos_c * sin_n * sin_e
    with np.errstate(invalid='ignore'):  # a direction closer to the axis than the line of sight
        vy = np.sqrt(ux * ux + uy * uy - vx * vx)
    e = np.arctan2(sin_e, vy / cos_c)
    a = np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy)
    return a, e, (ux, uy, uz), (vx, vy), sin_e


def sky_to_encoder(az, el, coefficients):
    """Encoder angles at which the mount looks at a direction.

    Parameters
    ----------
    az, el : float or ndarray
        Catalogue place, radians.
    coefficients : dict of str to float
        Any of `GEOMETRIC`, radians; a missing one is zero.

    Returns
    -------
    az_enc, el_enc : ndarray
        Radians; the azimuth on the branch nearest to `az`. NaN where the mount cannot look:
        nearer to its zenith than collimation and non-perpendicularity allow. The mount's other
        solution, with the tube past the zenith, is not returned.

    Raises
    ------
    ValueError
        A name in `coefficients` is not geometric.
    """
    ia, ie, ca, npae, an, aw, tf = _values(coefficients)
    az, el = np.asarray(az, float), np.asarray(el, float)
    if ca or npae or an or aw:
        a, e = _axes(az, el, ca, npae, an, aw)[:2]
        return az + wrap(a + ia - az), e + ie + tf * np.cos(el)
    return az + ia, el + ie + tf * np.cos(el)


def encoder_to_sky(az_enc, el_enc, coefficients, added=None):
    """Direction at which the mount looks with given encoder angles: the inverse.

    Parameters
    ----------
    az_enc, el_enc : float or ndarray
        Encoder angles, radians; an elevation beyond 90 degrees is a tube past the zenith.
    coefficients : dict of str to float
        Any of `GEOMETRIC`, radians; a missing one is zero.
    added : callable, optional
        ``added(az, el) -> (d_az, d_el)``: what else was added to the encoder angles, as a
        function of the catalogue place, radians.

    Returns
    -------
    az, el : ndarray
        Catalogue place, radians, inverse of `sky_to_encoder` below 1e-6 arcsec; the azimuth on
        the branch nearest to the encoder's. NaN where the iteration for flexure and `added`
        does not converge (within their size from the zenith).

    Raises
    ------
    ValueError
        A name in `coefficients` is not geometric.
    """
    ia, ie, ca, npae, an, aw, tf = _values(coefficients)
    az_enc, el_enc = np.asarray(az_enc, float), np.asarray(el_enc, float)
    sin_c, cos_c, sin_n, cos_n = np.sin(ca), np.cos(ca), np.sin(npae), np.cos(npae)

    def look(a, e):
        sin_e = np.sin(e)
        vx = -sin_c * cos_n - cos_c * sin_n * sin_e
        vy = cos_c * np.cos(e)
        vz = cos_c * cos_n * sin_e - sin_c * sin_n
        sin_a, cos_a = np.sin(a), np.cos(a)
        x, y, z = _turn((vx * cos_a + vy * sin_a, vy * cos_a - vx * sin_a, vz), -an, -aw)
        return az_enc + wrap(np.arctan2(x, y) - az_enc), np.arctan2(z, np.hypot(x, y))

    a, e = az_enc - ia, el_enc - ie
    az, el = look(a, e)
    if tf == 0.0 and added is None:
        return az, el
    for _ in range(_STEPS):
        d_az, d_el = added(az, el) if added is not None else (0.0, 0.0)
        az_new, el_new = look(a - d_az, e - d_el - tf * np.cos(el))
        step = np.hypot(wrap(az_new - az) * np.cos(el_new), el_new - el)
        az, el = az_new, el_new
        open_ = step > _TOLERANCE
        if not open_.any():
            return az, el
    return np.where(open_, np.nan, az), np.where(open_, np.nan, el)


def offsets(az, el, coefficients):
    """Encoder - catalogue of the exact rotations, on the sky.

    Parameters
    ----------
    az, el : float or ndarray
        Catalogue place, radians.
    coefficients : dict of str to float
        Any of `GEOMETRIC`, radians.

    Returns
    -------
    x, y : ndarray
        delta-A cos E and delta-E, radians.
    """
    az_enc, el_enc = sky_to_encoder(az, el, coefficients)
    return wrap(az_enc - az) * np.cos(el), el_enc - el


def offsets_and_jacobian(az, el, coefficients, names):
    """Exact offsets and their derivatives to the coefficients: one step of a Gauss-Newton fit.

    Parameters
    ----------
    az, el : ndarray, shape (n,)
        Catalogue place, radians.
    coefficients : dict of str to float
        Where to linearise; any of `GEOMETRIC`, radians.
    names : sequence of str, length k
        Derivatives to these, each in `GEOMETRIC`.

    Returns
    -------
    x, y : ndarray, shape (n,)
        delta-A cos E and delta-E, radians.
    jacobian : dict of str to (ndarray or float, ndarray or float)
        On-sky columns (x, y) of each of `names`. Those of AN and AW neglect the square of the
        tilt against one (4e-7 at 300").
    """
    ia, ie, ca, npae, an, aw, tf = _values(coefficients)
    a, e, (ux, uy, uz), (vx, vy), sin_e = _axes(az, el, ca, npae, an, aw)
    cos_el = np.cos(el)
    x = wrap(a + ia - az) * cos_el
    y = e + ie + tf * cos_el - el
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

    jacobian = {
        'IA': lambda: (cos_el, 0.0), 'IE': lambda: (0.0, 1.0), 'TF': lambda: (0.0, cos_el),
        'CA': ca_column, 'NPAE': npae_column,
        'AN': lambda: tilt(1.0, 0.0), 'AW': lambda: tilt(0.0, 1.0),
    }
    return x, y, {name: jacobian[name]() for name in names}
