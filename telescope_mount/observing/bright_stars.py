"""Which stars of the catalogue are bright enough, and alone in the field of a camera."""

from functools import lru_cache

import numpy as np

from msg_tools.units import ARCSEC

NEIGHBOUR_DISTANCE = 30.0 * 60.0 * ARCSEC  # a field of 30 arcmin to its corner, and a mount 8 off
NEIGHBOUR_CONTRAST = 2.0  # magnitudes; a fainter neighbour does not disturb

# what a step along x, y, z changes of a cube's number, and steps to itself and those beside
_CUBES, _BESIDE = np.array([2**20, 2**10, 1]), np.array([-1, 0, 1])


@lru_cache(maxsize=8)
def bright_stars(stars, mag_limit):
    """Stars that are bright enough; kept, as a night asks for the same ones many times.

    Parameters
    ----------
    stars : Stars
    mag_limit : float
        Faintest magnitude Hp.

    Returns
    -------
    rows : ndarray of int, shape (n,)
        Of `stars`.
    bright : Stars
        They alone.
    lonely : ndarray of bool, shape (n,)
        Which of them have no neighbour that a camera could take for them.
    """
    rows = np.flatnonzero(stars.mag <= mag_limit)
    lonely = ~has_neighbour(stars, rows)
    rows.flags.writeable = lonely.flags.writeable = False
    return rows, stars.select(rows), lonely


def has_neighbour(stars, rows):
    """Which stars have another one beside them that a camera could take for them.

    Parameters
    ----------
    stars : Stars
        Neighbours are looked for among all of these.
    rows : ndarray of int, shape (n,)
        The stars in question.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    reach = 2.0 * np.sin(NEIGHBOUR_DISTANCE / 2.0)
    deep = np.flatnonzero(stars.mag < stars.mag[rows].max(initial=-9.0) + NEIGHBOUR_CONTRAST)
    mine, others = (xyz(stars.ra[which], stars.dec[which]) for which in (rows, deep))
    # space in cubes of that size, a number each: who is near is in one beside, or in the same
    of_mine, of_others = (np.floor(at / reach).astype(int) @ _CUBES for at in (mine, others))
    order = np.argsort(of_others)
    deep, others, of_others = deep[order], others[order], of_others[order]
    centre = np.add.outer([x + y for x in _BESIDE * _CUBES[0] for y in _BESIDE * _CUBES[1]],
                          of_mine).ravel()
    first = np.searchsorted(of_others, centre - _CUBES[2], 'left')
    count = np.searchsorted(of_others, centre + _CUBES[2], 'right') - first
    one = np.repeat(np.arange(len(centre)) % max(len(rows), 1), count)
    other = np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)
    keep = deep[other] != rows[one]
    keep &= stars.mag[deep[other]] - stars.mag[rows[one]] < NEIGHBOUR_CONTRAST
    one, other = one[keep], other[keep]
    near = np.zeros(len(rows), bool)
    near[one[np.linalg.norm(mine[one] - others[other], axis=1) <= reach]] = True
    return near


def xyz(az, el):
    """Unit vectors, shape (..., 3), of two angles."""
    return np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=-1)
