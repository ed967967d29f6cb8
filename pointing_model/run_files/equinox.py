"""Catalogue places of an unnamed equinox: J2000 or of date, whichever fits."""

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.mounts import is_beyond
from pointing_model.terms import stacked_design

_ALIKE = 1.02  # times the smaller misfit, within which the two cannot be told apart
_ROUNDS = 20


def which_fits(table, rows, icrs, of_date, mount):
    """Azimuth and elevation of the rows, by the equinox with which the mount's terms fit.

    Parameters
    ----------
    table : Table
        With the readings, radians. A note says what was decided, and by how much.
    rows : ndarray of bool, shape (n,)
        Those that the places are of.
    icrs : tuple of ndarray
        Observed azimuth and elevation with the places taken as ICRS.
    of_date : tuple
        Right ascension, declination, time, site and weather of the places, which may be apparent
        ones of the moment.
    mount : Mount

    Returns
    -------
    az, el : ndarray
    """
    from pointing_model.plate_solved.frames import OF_DATE, to_icrs
    from pointing_model.sky import icrs_to_observed
    reading = [table.columns[name][rows] for name in ('az_enc', 'el_enc')]
    ra, dec, time, *air = of_date
    time = np.broadcast_to(time, np.shape(ra))
    ways = {'J2000': icrs,
            'of date': icrs_to_observed(*to_icrs(ra, dec, OF_DATE, time), time, *air)}
    left = {name: _misfit(place, reading, mount) for name, place in ways.items()}
    best = min(left, key=left.get)
    said = ', '.join(f'{v:.1f} arcsec if {name}' for name, v in left.items())
    if max(left.values()) < _ALIKE * min(left.values()):
        best = 'J2000'
        said += ', which cannot be told apart'
    table.meta['notes'].append(
        f'the file does not say the equinox of its catalogue: taken as {best}; the '
        f'{len(mount.names.physical)} terms leave (median) {said}')
    return ways[best]


def _misfit(place, reading, mount):
    """Robust radial noise that the physical terms leave, arcsec."""
    first, second = mount.axes_of(*place, is_beyond(reading[1]))
    off = [wrap(reading[0] - first) * np.cos(second), wrap(reading[1] - second)]
    both, n = np.concatenate(off), len(first)
    good = np.isfinite(both[:n]) & np.isfinite(both[n:])
    if good.sum() <= len(mount.names.physical):
        return np.inf
    design = stacked_design(mount.names.physical, first, second, mount)[:, np.tile(good, 2)]
    both, n = both[np.tile(good, 2)], int(good.sum())
    weight = np.ones(n)
    for _ in range(_ROUNDS):
        root = np.tile(np.sqrt(weight), 2)
        p = np.linalg.lstsq((design * root).T, both * root, rcond=None)[0]
        radial = np.hypot(*(both - p @ design).reshape(2, n))
        noise = max(float(np.median(radial)) / 1.1774, 1e-12)
        weight = 1.5 / np.maximum(radial / noise, 1.5)
    return float(np.sqrt(np.mean(weight * radial**2) / weight.mean())) / ARCSEC
