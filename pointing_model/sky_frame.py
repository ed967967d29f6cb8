"""The frame of a site at any time: ERFA's astrom, of which most changes slowly.

Precession, nutation and the motion of the Earth are computed on a grid of two hours, at the
geocentre, and go straight between: their curvature leaves 0.00005". What turns with the Earth is
not in them: its angle grows evenly, and the observer's own motion is ERFA's diurnal aberration. The
grid is the same in every process and whatever was asked before, and so is the answer.
"""

from functools import lru_cache
from threading import Lock

import erfa
import numpy as np

from msg_tools.units import wrap

from .earth import TURN_RATE, earth_orientation, split_utc

#: s; a part of the day, as UTC and the tables of the IERS change their rules at 0h
GRID = 7200.0
#: rad: by more (0.5 ms of UT1) the Earth's angle and pole do not leave a straight line in `GRID`,
#: but for a step of UTC or the end of a table; there everything is computed
_STEADY = 4e-8
_MOST = 20_000  # points of the grid that are kept; a year has 4400
#: points of the grid from which times so scattered need more of them than there are times
_SCATTERED = 50
_FIELDS = erfa.dt_eraASTROM.itemsize // 8
_ERAL = erfa.dt_eraASTROM.fields['eral'][1] // 8
#: of its numbers, those that the site gives: all from this one on
_OF_SITE = np.arange(_FIELDS) >= erfa.dt_eraASTROM.fields['along'][1] // 8

_slow = {}  # point of the grid -> (astrom of the geocentre, Earth rotation angle, sp, xp, yp)
_lock = Lock()


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
        piece = _piece(int(time // GRID), site) if abs(time) < 1e11 else None
        if piece is None:
            return full_frame(np.float64(time), site)
        begin, grows, at = piece
        return (begin + (time - at) * grows).view(erfa.dt_eraASTROM)[0]
    if not np.isfinite(time).all():
        return full_frame(time, site)  # which says what is wrong
    moments, inverse = time, None
    if np.any(time[1:] <= time[:-1]):
        moments, inverse = np.unique(time, return_inverse=True)
    if not (moments.size and abs(moments[0]) < 1e11 and abs(moments[-1]) < 1e11):
        return full_frame(time, site)
    out = _between(moments, site)
    return out if inverse is None else out[inverse]


def _between(moments, site):
    points = np.floor(moments / GRID).astype(int)
    begins = np.flatnonzero(np.diff(points, prepend=points[0] - 1))
    needed = {int(k) + i for k in points[begins] for i in (0, 1)}
    if len(needed) > max(_SCATTERED, 1.5 * len(moments)):
        return full_frame(moments, site)
    _compute(needed)
    out = np.empty((len(moments), _FIELDS))
    for first, last in zip(begins, [*begins[1:], len(moments)]):
        piece = _piece(int(points[first]), site)
        if piece is None:
            out[first:last] = _numbers(full_frame(moments[first:last], site))
        else:
            begin, grows, at = piece
            np.multiply((moments[first:last] - at)[:, None], grows, out=out[first:last])
            out[first:last] += begin
    return out.view(erfa.dt_eraASTROM)[:, 0]


def full_frame(time, site):
    """As `frame`, all of it computed for each time."""
    earth = earth_orientation(time)
    astrom, _, status = erfa.ufunc.apco13(
        *split_utc(time), earth.dut1, site.longitude, site.latitude, site.height, earth.xp,
        earth.yp, 0.0, 0.0, 0.0, 0.5)
    if np.any(status < 0):
        raise ValueError('time is not one that ERFA can convert: give UTC since 1970-01-01')
    return np.array(astrom)


def _numbers(astrom):
    astrom = np.array(astrom)
    return np.atleast_1d(astrom).view(float).reshape(*astrom.shape, _FIELDS)


@lru_cache(maxsize=2000)
def _piece(point, site):
    """Astrom at a point of the grid, its growth in a second, and when that is; None: not even."""
    ends = _compute({point, point + 1})
    if ends is None:
        return None
    both = []
    for k in (point, point + 1):
        geocentre, angle, sp, xp, yp = ends[k]
        there = _numbers(erfa.ufunc.apio(sp, angle, site.longitude, site.latitude, site.height,
                                         xp, yp, 0.0, 0.0))
        both.append(np.where(_OF_SITE, there, geocentre))
    turned = TURN_RATE * GRID
    uneven = wrap(both[1][_ERAL] - both[0][_ERAL] - turned)
    if abs(uneven) > _STEADY or max(
            abs(one - other) for one, other in zip(ends[point][3:], ends[point + 1][3:])) > _STEADY:
        return None
    grows = (both[1] - both[0]) / GRID
    grows[_ERAL] = (turned + uneven) / GRID
    return both[0], grows, point * GRID


def _compute(points):
    """What is slow at points of the grid, by point; None where one is outside 1900-2100."""
    with _lock:
        missing = sorted(points - _slow.keys())
        if missing:
            time = np.array(missing) * GRID
            try:
                earth, utc = earth_orientation(time), split_utc(time)
            except ValueError:
                return None
            tt = erfa.ufunc.taitt(*erfa.ufunc.utctai(*utc)[:2])[:2]
            geocentre, _ = erfa.ufunc.apci13(*tt)
            angle = erfa.ufunc.era00(*erfa.ufunc.utcut1(*utc, earth.dut1)[:2])
            sp = erfa.ufunc.sp00(*tt)
            if len(_slow) + len(missing) > _MOST:
                _slow.clear()
            numbers = _numbers(geocentre)
            for i, point in enumerate(missing):
                _slow[point] = numbers[i], angle[i], sp[i], earth.xp[i], earth.yp[i]
        return {point: _slow[point] for point in points}
