"""The frame of a site at any time: ERFA's astrom, of which most changes slowly.

Within two hours all of it goes straight: the curvature leaves 0.00007". Precession, nutation (to
0.0005": `nutation`) and the place of the Earth are computed once, for the middle of the two hours
and the geocentre; how they go on follows from the Earth's velocity, its fall towards Sun and Moon,
and the path of the pole by the short series IAU 2000B. What turns with the Earth is computed for
two times in them: its angle grows evenly, and the observer's own motion is ERFA's diurnal
aberration. These cells are the same in every process and whatever was asked before, and so is the
answer.
"""

import math
from array import array
from functools import lru_cache
from operator import mul

import erfa
import numpy as np

from msg_tools.units import ARCSEC, wrap

from .earth import FIRST, LAST, check_time, clock_and_pole, earth_orientation, split_utc
from .nutation import nutation

#: s; a part of the day, as UTC and the tables of the IERS change their rules at 0h
GRID = 7200.0
_APART = 0.5 * GRID  # s, of the two times
#: cells from which times so scattered are computed one by one
_SCATTERED = 50
_ASTROM = erfa.dt_eraASTROM
_FIELDS = _ASTROM.itemsize // 8
#: the first of its numbers that the site gives, and the angle among those
_OF_SITE = _ASTROM.fields['along'][1] // 8
_TURN = _ASTROM.fields['eral'][1] // 8 - _OF_SITE
_PMT, _EB, _EH, _EM, _V, _BPN = (
    slice(at // 8, (at + field.itemsize) // 8)
    for field, at in (_ASTROM.fields[name][:2] for name in ('pmt', 'eb', 'eh', 'em', 'v', 'bpn')))
_LIGHT = erfa.CMPS / erfa.DAU  # AU/s
# how fast the Earth falls, c/s: towards the Sun at 1 AU, towards the Moon
_BY_SUN = (0.01720209895 / erfa.DAYSEC) ** 2 / _LIGHT
_BY_MOON = 3.32e-5 / erfa.CMPS
_OBLIQUITY = erfa.ufunc.obl06(erfa.DJ00, 0.0)
_SIN_OBLIQUITY, _COS_OBLIQUITY = math.sin(_OBLIQUITY), math.cos(_OBLIQUITY)
#: rad/s, and rad/s a century, of the pole in x, and in y (IERS Conventions 2010, eq. 5.16)
_PRECESSION = [arcsec * ARCSEC / (erfa.DAYSEC * erfa.DJC)
               for arcsec in (2004.191898, -0.8595658, -44.8145494)]


def frame(time, site):
    """ERFA's astrom, without refraction.

    Parameters
    ----------
    time : ndarray, shape () or (n,)
        UTC, seconds since 1970-01-01.
    site : sky.Site

    Returns
    -------
    ndarray of erfa.dt_eraASTROM, shape () or (n,)
        The caller's own.

    Raises
    ------
    ValueError
        A time is not finite or outside 1900-2100.
    """
    if time.ndim == 0:
        time = float(time)
        if not FIRST <= time <= LAST:
            check_time(time)
        middle, grows, at = _cell(int(time // GRID), site)
        return (middle + (time - at) * grows).view(_ASTROM)[0]
    check_time(time)
    moments, inverse = time, None
    if np.any(time[1:] <= time[:-1]):
        moments, inverse = np.unique(time, return_inverse=True)
    out = _of_cells(moments, site)
    return out if inverse is None else out[inverse]


def _of_cells(moments, site):
    cells = np.floor(moments / GRID).astype(int)
    begins = np.flatnonzero(np.diff(cells, prepend=cells[:1] - 1))
    if len(begins) > max(_SCATTERED, 0.6 * len(moments)):
        return full_frame(moments, site)
    out = np.empty((len(moments), _FIELDS))
    for first, last in zip(begins, [*begins[1:], len(moments)]):
        middle, grows, at = _cell(int(cells[first]), site)
        np.multiply((moments[first:last] - at)[:, None], grows, out=out[first:last])
        out[first:last] += middle
    return out.view(_ASTROM)[:, 0]


def full_frame(time, site):
    """As `frame`, all of it computed for each time."""
    earth = earth_orientation(time)
    astrom, _, status = erfa.ufunc.apco13(
        *split_utc(time), earth.dut1, site.longitude, site.latitude, site.height, earth.xp,
        earth.yp, 0.0, 0.0, 0.0, 0.5)
    if np.any(status < 0):
        raise ValueError('time is not one that ERFA can convert: give UTC since 1970-01-01')
    return np.array(astrom)


@lru_cache(maxsize=5000)  # a year has 4400
def _cell(number, site):
    """Numbers of astrom in the middle of a cell, their growth in a second, and when that is."""
    geocentre, geocentre_grows, (sp, angle, xp, yp) = _geocentre(number)
    ends = erfa.ufunc.apio(sp, angle, site.longitude, site.latitude, site.height, xp, yp, 0.0, 0.0)
    ends = ends.view(float).tolist()
    one = ends[_OF_SITE:_FIELDS]
    change = [after - before for before, after in zip(one, ends[_FIELDS + _OF_SITE :])]
    change[_TURN] = wrap(change[_TURN])
    return (np.array([*geocentre, *(a + 0.5 * c for a, c in zip(one, change))]),
            np.array([*geocentre_grows, *(c / _APART for c in change)]), (number + 0.5) * GRID)


# few numbers: plain floats are faster than ndarrays, an array is smaller than a list
@lru_cache(maxsize=64)  # for several sites at a time: one asks once
def _geocentre(number):
    """As `_cell`, of the geocentre; then what a site needs: sp, and at two times angle and pole."""
    day, tt, ut1, xp, yp = clock_and_pole((number + 0.5) * GRID, _APART)
    century = (day - erfa.DJ00 + tt) / erfa.DJC
    longitude, obliquity, change = nutation(day, tt, _APART / erfa.DAYSEC)
    middle = _astrom(day, tt, longitude, obliquity)
    velocity = [v * _LIGHT for v in middle[_V]]
    from_sun, (distance,) = middle[_EH], middle[_EM]
    away = sum(map(mul, velocity, from_sun))
    grows = [0.0] * _OF_SITE
    grows[_PMT] = 1.0 / (erfa.DAYSEC * erfa.DJY),
    grows[_EB], grows[_EM] = velocity, (away,)
    grows[_EH] = [(v - away * e) / distance for v, e in zip(velocity, from_sun)]
    grows[_V] = _fall(from_sun, distance, century)
    # the origin does not rotate about the pole: its path is all the turn that there is
    x, y = _path_of_pole(change, century)
    bpn = middle[_BPN]
    first, second, third = bpn[:3], bpn[3:6], bpn[6:]
    grows[_BPN] = [*(-x * v for v in third), *(-y * v for v in third),
                   *(x * v + y * w for v, w in zip(first, second))]
    return (array('d', middle), array('d', grows),
            (erfa.ufunc.sp00(day, tt), erfa.ufunc.era00(day, ut1), xp, yp))


def _astrom(day, tt, longitude, obliquity):
    """Its numbers for the geocentre, as ``apci13``, with a nutation."""
    around_sun, from_barycentre, _ = erfa.ufunc.epv00(day, tt)
    gamma, phi, psi, epsilon = erfa.ufunc.pfw06(day, tt)
    x, y = erfa.ufunc.bpn2xy(
        erfa.ufunc.fw2m(gamma, phi, psi + longitude, epsilon + obliquity))
    astrom = erfa.ufunc.apci(day, tt, from_barycentre, around_sun['p'], x, y,
                             erfa.ufunc.s06(day, tt, x, y))
    return np.frombuffer(astrom, count=_OF_SITE).tolist()


def _fall(from_sun, distance, century):
    """Acceleration of the Earth by the Sun, and by the Moon at its mean longitude, c/s."""
    moon = float(erfa.ufunc.faf03(century)) + float(erfa.ufunc.faom03(century))
    along = math.sin(moon)
    toward = math.cos(moon), _COS_OBLIQUITY * along, _SIN_OBLIQUITY * along
    by_sun = _BY_SUN / distance**2
    return [t * _BY_MOON - e * by_sun for t, e in zip(toward, from_sun)]


def _path_of_pole(change, century):
    """Motion of the celestial pole in x and y, rad/s: precession, and nutation."""
    in_longitude, in_obliquity = (both / _APART for both in change)
    return (in_longitude * _SIN_OBLIQUITY + _PRECESSION[0] + _PRECESSION[1] * century,
            in_obliquity + _PRECESSION[2] * century)
