"""First-order pointing terms of an alt-az mount, by the names that the field uses (TPOINT).

A term is a pair of design columns (x, y): what a coefficient of one radian adds to
encoder - catalogue, on the sky, x = delta-A cos E and y = delta-E, with A (from north through
east) and E of the catalogue place.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: A column that is zero everywhere; the fit tells it by identity and skips it.
ZERO = 0.0


class Trig:
    """Sines and cosines of a direction, computed once for all terms.

    Parameters
    ----------
    az, el : float or ndarray
        Catalogue place, radians.
    """

    __slots__ = ('az', 'el', 'sin_az', 'cos_az', 'sin_el', 'cos_el')

    def __init__(self, az, el):
        self.az, self.el = az, el
        self.sin_az, self.cos_az = np.sin(az), np.cos(az)
        self.sin_el, self.cos_el = np.sin(el), np.cos(el)


@dataclass(frozen=True)
class Term:
    """One pointing term.

    Attributes
    ----------
    name : str
        Name of the coefficient here.
    doc : str
        What it is, in words.
    tpoint_name : str or None
        The same term in TPOINT, None if it has none.
    tpoint_sign : int
        coefficient here = ``tpoint_sign`` x coefficient in TPOINT. TPOINT's corrections take the
        encoder to the star and its internal azimuth is zero in the south and 90 degrees in the
        east, hence the signs.
    of : callable
        `Trig` -> (x, y); an entry that is zero everywhere is `ZERO`.
    """

    name: str
    doc: str
    tpoint_name: str | None
    tpoint_sign: int
    of: Callable

    def columns(self, az, el):
        """Design columns.

        Parameters
        ----------
        az, el : float or ndarray, shape (n,)
            Catalogue place, radians.

        Returns
        -------
        x, y : ndarray, shape (n,)
            On-sky offset (encoder - catalogue) for a unit coefficient.
        """
        x, y = self.of(Trig(np.asarray(az, float), np.asarray(el, float)))
        shape = np.broadcast_shapes(np.shape(az), np.shape(el))
        return np.broadcast_to(x, shape).astype(float), np.broadcast_to(y, shape).astype(float)


def _terms():
    rows = [
        ('IA', 'azimuth index', 'IA', 1, lambda t: (t.cos_el, ZERO)),
        ('IE', 'elevation index', 'IE', -1, lambda t: (ZERO, 1.0)),
        ('CA', 'collimation, positive where the line of sight is left of the tube', 'CA', 1,
         lambda t: (1.0, ZERO)),
        ('NPAE', 'elevation axis not perpendicular to the azimuth axis, its right end high',
         'NPAE', 1, lambda t: (t.sin_el, ZERO)),
        ('AN', 'azimuth axis leans north', 'AN', 1,
         lambda t: (t.sin_az * t.sin_el, t.cos_az)),
        ('AW', 'azimuth axis leans west', 'AW', 1,
         lambda t: (t.cos_az * t.sin_el, -t.sin_az)),
        ('TF', 'tube flexure, cos E', 'TF', 1, lambda t: (ZERO, t.cos_el)),
        ('TX', 'flexure or refraction constant, cot E', 'TX', 1,
         lambda t: (ZERO, t.cos_el / t.sin_el)),
        ('TX3', 'third order of the refraction, cot^3 E', None, 1,
         lambda t: (ZERO, (t.cos_el / t.sin_el) ** 3)),
        ('ECES', 'elevation encoder centring, sin E', 'ECES', -1, lambda t: (ZERO, t.sin_el)),
        ('HECE2', 'elevation, cos 2E', 'HECE2', -1, lambda t: (ZERO, np.cos(2 * t.el))),
        ('HESE2', 'elevation, sin 2E', 'HESE2', -1, lambda t: (ZERO, np.sin(2 * t.el))),
        ('ACEC', 'azimuth encoder centring, cos A', 'ACEC', -1,
         lambda t: (t.cos_az * t.cos_el, ZERO)),
        ('ACES', 'azimuth encoder centring, sin A', 'ACES', 1,
         lambda t: (t.sin_az * t.cos_el, ZERO)),
        ('HACA2', 'azimuth encoder, cos 2A', 'HACA2', 1,
         lambda t: (np.cos(2 * t.az) * t.cos_el, ZERO)),
        ('HASA2', 'azimuth encoder, sin 2A', 'HASA2', -1,
         lambda t: (np.sin(2 * t.az) * t.cos_el, ZERO)),
        ('HECA', 'elevation nod, cos A', 'HECA', 1, lambda t: (ZERO, t.cos_az)),
        ('HESA', 'elevation nod, sin A', 'HESA', -1, lambda t: (ZERO, t.sin_az)),
        ('HECA2', 'elevation nod, cos 2A', 'HECA2', -1, lambda t: (ZERO, np.cos(2 * t.az))),
        ('HESA2', 'elevation nod, sin 2A', 'HESA2', 1, lambda t: (ZERO, np.sin(2 * t.az))),
        ('HVCA2', 'azimuth axis wobble across the line of sight, cos 2A', 'HVCA2', 1,
         lambda t: (np.cos(2 * t.az) * t.sin_el, ZERO)),
        ('HVSA2', 'azimuth axis wobble across the line of sight, sin 2A', 'HVSA2', -1,
         lambda t: (np.sin(2 * t.az) * t.sin_el, ZERO)),
    ]
    return {row[0]: Term(*row) for row in rows}


#: name -> `Term`
TERMS = _terms()

#: The geometry of an alt-az mount and Hooke's law flexure.
PHYSICAL = ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF')

#: The usual six of telescopes with well squared axes.
STANDARD6 = ('IA', 'IE', 'CA', 'AN', 'AW', 'TF')


def known_terms(names):
    """The `Term` of each name.

    Parameters
    ----------
    names : iterable of str

    Returns
    -------
    list of Term

    Raises
    ------
    ValueError
        A name is unknown or given twice.
    """
    names = tuple(names)
    unknown = [name for name in names if name not in TERMS]
    if unknown:
        raise ValueError(
            f'unknown pointing term {", ".join(map(str, unknown))}; choose from {", ".join(TERMS)}'
        )
    if len(set(names)) < len(names):
        raise ValueError(f'a pointing term is named twice in {", ".join(names)}; name it once')
    return [TERMS[name] for name in names]


def stacked_design(names, az, el):
    """The design of both axes in one array, a row a term: x of all stars, then y of all stars.

    Contiguous rows make the products of the fit fast.

    Parameters
    ----------
    names : sequence of str, length k
    az, el : ndarray, shape (n,)
        Catalogue place, radians.

    Returns
    -------
    ndarray, shape (k, 2n)

    Raises
    ------
    ValueError
        A name is unknown or given twice.
    """
    terms = known_terms(names)
    n = len(az)
    trig = Trig(az, el)
    out = np.zeros((len(terms), 2 * n))
    for x_row, y_row, term in zip(out[:, :n], out[:, n:], terms):
        x, y = term.of(trig)
        if x is not ZERO:
            x_row[:] = x
        if y is not ZERO:
            y_row[:] = y
    return out


def design(names, az, el):
    """First-order design matrices.

    Parameters
    ----------
    names : sequence of str, length k
    az, el : ndarray, shape (n,)
        Catalogue place, radians.

    Returns
    -------
    x, y : ndarray, shape (n, k)
        On-sky offset (encoder - catalogue) for unit coefficients.

    Raises
    ------
    ValueError
        A name is unknown or given twice.
    """
    az, el = np.broadcast_arrays(np.atleast_1d(az), np.atleast_1d(el))
    both = stacked_design(names, az, el)
    return both[:, : len(az)].T, both[:, len(az):].T


def mean_columns(names, az, el):
    """Mean over some rows of the derivatives of the encoder angles, as of Polaris' exposures.

    Parameters
    ----------
    names : sequence of str, length k
    az, el : ndarray, shape (n,)
        Catalogue place, radians.

    Returns
    -------
    ndarray, shape (2, k)
        Of azimuth (the coordinate angle, not on the sky) and elevation, for unit coefficients.
    """
    x, y = design(names, az, el)
    return np.stack((np.mean(x / np.cos(el)[:, None], axis=0), np.mean(y, axis=0)))
