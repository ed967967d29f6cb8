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
    formula : str
        Its columns (x, y).
    tpoint_sign : int or None
        coefficient here = ``tpoint_sign`` x coefficient in TPOINT, where the term has the same
        name; None if it has none. TPOINT's corrections take the encoder to the star and its
        internal azimuth is zero in the south and 90 degrees in the east, hence the signs.
    of : callable
        `Trig` -> (x, y); an entry that is zero everywhere is `ZERO`.
    """

    name: str
    doc: str
    formula: str
    tpoint_sign: int | None
    of: Callable


#: name -> `Term`
TERMS = {row[0]: Term(*row) for row in (
    ('IA', 'azimuth index', '(cos E, 0)', 1, lambda t: (t.cos_el, ZERO)),
    ('IE', 'elevation index', '(0, 1)', -1, lambda t: (ZERO, 1.0)),
    ('CA', 'collimation, positive where the line of sight is left of the tube', '(1, 0)', 1,
     lambda t: (1.0, ZERO)),
    ('NPAE', 'elevation axis not perpendicular to the azimuth axis, its right end high',
     '(sin E, 0)', 1, lambda t: (t.sin_el, ZERO)),
    ('AN', 'azimuth axis leans north', '(sin A sin E, cos A)', 1,
     lambda t: (t.sin_az * t.sin_el, t.cos_az)),
    ('AW', 'azimuth axis leans west', '(cos A sin E, -sin A)', 1,
     lambda t: (t.cos_az * t.sin_el, -t.sin_az)),
    ('TF', 'tube flexure, cos E', '(0, cos E)', 1, lambda t: (ZERO, t.cos_el)),
    ('TX', 'flexure or refraction constant, cot E', '(0, cot E)', 1,
     lambda t: (ZERO, t.cos_el / t.sin_el)),
    ('TX3', 'third order of the refraction, cot^3 E', '(0, cot^3 E)', None,
     lambda t: (ZERO, (t.cos_el / t.sin_el) ** 3)),
    ('ECES', 'elevation encoder centring, sin E', '(0, sin E)', -1, lambda t: (ZERO, t.sin_el)),
    ('HECE2', 'elevation, cos 2E', '(0, cos 2E)', -1, lambda t: (ZERO, np.cos(2 * t.el))),
    ('HESE2', 'elevation, sin 2E', '(0, sin 2E)', -1, lambda t: (ZERO, np.sin(2 * t.el))),
    ('ACEC', 'azimuth encoder centring, cos A', '(cos A cos E, 0)', -1,
     lambda t: (t.cos_az * t.cos_el, ZERO)),
    ('ACES', 'azimuth encoder centring, sin A', '(sin A cos E, 0)', 1,
     lambda t: (t.sin_az * t.cos_el, ZERO)),
    ('HACA2', 'azimuth encoder, cos 2A', '(cos 2A cos E, 0)', 1,
     lambda t: (np.cos(2 * t.az) * t.cos_el, ZERO)),
    ('HASA2', 'azimuth encoder, sin 2A', '(sin 2A cos E, 0)', -1,
     lambda t: (np.sin(2 * t.az) * t.cos_el, ZERO)),
    ('HECA', 'elevation nod, cos A', '(0, cos A)', 1, lambda t: (ZERO, t.cos_az)),
    ('HESA', 'elevation nod, sin A', '(0, sin A)', -1, lambda t: (ZERO, t.sin_az)),
    ('HECA2', 'elevation nod, cos 2A', '(0, cos 2A)', -1, lambda t: (ZERO, np.cos(2 * t.az))),
    ('HESA2', 'elevation nod, sin 2A', '(0, sin 2A)', 1, lambda t: (ZERO, np.sin(2 * t.az))),
    ('HVCA2', 'azimuth axis wobble across the line of sight, cos 2A', '(cos 2A sin E, 0)', 1,
     lambda t: (np.cos(2 * t.az) * t.sin_el, ZERO)),
    ('HVSA2', 'azimuth axis wobble across the line of sight, sin 2A', '(sin 2A sin E, 0)', -1,
     lambda t: (np.sin(2 * t.az) * t.sin_el, ZERO)),
)}

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
