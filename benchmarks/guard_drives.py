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

"""Drives, sky and horizon for the benchmark of the guard, without code of the guard.

All cases are integrated together in steps of 0.05 s. Each axis has its own controller, speed and
acceleration. Directions come from the definition of a mount, the Sun from ERFA, skylines from their
corners.
"""

import erfa
import numpy as np
from scipy import ndimage

DEG = np.pi / 180.0
#: s; of the sky, rad/s
STEP, TURNING = 0.05, 7.292115e-5
#: looked at every so many steps
LOOK = 2
#: commands are carried out for so long, s
SECONDS = 600.0
#: most corners of a skyline, knots of a track and points of a way around
CORNERS, KNOTS = 12, 13


class Setting:
    """A mount, where it stands and what it must not do; plain numbers.

    Parameters
    ----------
    kind : str
    pole : (float, float), optional
        Azimuth and elevation of the first axis, rad; roll 0. Not for an alt-azimuth mount.
    latitude, longitude : float
        rad.
    time : float
        UTC, s since 1970.
    travel, rate, acceleration : array_like
        rad: (2, 2), (2,), (2,).
    least, corners, sun, timing
        Of the guard: horizon, skyline ((n, 2), sorted by azimuth), distance from the Sun, timing.
    """

    def __init__(self, kind, pole, latitude, longitude, time, travel, rate, acceleration, least,
                 corners, sun, timing):
        self.kind, self.least, self.sun, self.timing = kind, least, sun, timing
        self.time = time
        self.travel, self.rate = np.array(travel, float), np.array(rate, float)
        self.acceleration, self.corners = np.array(acceleration, float), np.array(corners, float)
        if kind == 'altaz':
            self.frame = np.eye(3)
        else:
            z = along(*pole)
            y = np.array([0.0, 0.0, 1.0]) - z * z[2]
            y /= np.linalg.norm(y)
            self.frame = np.array([np.cross(y, z), y, z])
        celestial = np.array([0.0, np.cos(latitude), np.sin(latitude)])
        place = sun_direction(time, latitude, longitude)
        axis = celestial * (celestial @ place)
        # A + B cos wt + C sin wt, westward, in the frame of the axes
        self.path = self.frame @ np.array([axis, place - axis, np.cross(place, celestial)]).T
        self.elevation = np.arcsin(place[2])
        top = max([least, *self.corners[:, 1]]) if len(self.corners) else least
        self.top = top

    def regions(self, margin):
        """Connected regions of axis angles that keep `margin` (rad) from all limits.

        On a grid of 1 degree over the travel: its first angles, its second angles, and the number
        of the region at each point; 0 where a limit is nearer within the next ten minutes.
        """
        ends = [(low + margin, high - margin) for low, high in self.travel]
        grids = [np.linspace(low, high, int((high - low) / DEG) + 1) for low, high in ends]
        a, b = (v.ravel() for v in np.meshgrid(*grids, indexing='ij'))
        free = np.ones(a.shape, bool)
        one = Many([self], np.zeros(len(a), int))
        for seconds in (0.0, 600.0):
            above, apart = one.clearances(np.array([a, b]), seconds, margin)
            free &= (above > margin) & (apart > margin)
        return *grids, ndimage.label(free.reshape([len(g) for g in grids]))[0]


def along(az, el):
    """Unit vector (east, north, up) of a direction."""
    return np.array([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])


def sun_direction(time, latitude, longitude):
    """Unit vector (east, north, up) of the Sun from ERFA, with UT1 = UTC."""
    day, part = 2440587.5, time / 86400.0
    tt = part + 69.2 / 86400.0
    earth = erfa.epv00(day, tt)[0]['p']
    x, y, z = erfa.c2t06a(day, tt, day, part, 0.0, 0.0) @ (-earth / np.linalg.norm(earth))
    hour = longitude - np.arctan2(y, x)
    dec = np.arcsin(z)
    return np.array([
        -np.cos(dec) * np.sin(hour),
        np.sin(dec) * np.cos(latitude) - np.cos(dec) * np.cos(hour) * np.sin(latitude),
        np.sin(dec) * np.sin(latitude) + np.cos(dec) * np.cos(hour) * np.cos(latitude)])


class Many:
    """Arrays for many cases, each of which has one of several settings."""

    def __init__(self, settings, index):
        self._settings, self._index = settings, index
        self._take()

    def _take(self):
        def of(name):
            return np.array([getattr(s, name) for s in self._settings])[self._index]
        self.frame, self.path = of('frame'), of('path')
        self.least, self.top, self.sun = of('least'), of('top'), of('sun')
        self.travel = np.moveaxis(of('travel'), 0, -1)  # axis, end, case
        self.rate, self.acceleration = of('rate').T, of('acceleration').T
        self._up = self.frame[:, :, 2].T.copy()
        self._by_sun = self.sun > 0.0
        corners = np.full((len(self._settings), CORNERS + 2, 2), np.nan)
        for row, setting in zip(corners, self._settings):
            if len(setting.corners):
                az, el = setting.corners.T
                n = len(az) + 2
                row[:n, 0] = [az[-1] - 2.0 * np.pi, *az, az[0] + 2.0 * np.pi]
                row[:n, 1] = [el[-1], *el, el[0]]
        self._corners = corners

    def keep(self, rows):
        """The same of some of the cases."""
        self._index = self._index[rows]
        self._take()

    def sky(self, sines, cosines, second_sines, second_cosines):
        """Direction components in the frame of the axes, from sines and cosines of the angles."""
        return second_cosines * sines, second_cosines * cosines, second_sines

    def suns(self, seconds):
        """The Sun in the frame of the axes, (3, n)."""
        angle = TURNING * np.asarray(seconds)
        a, b, c = np.moveaxis(self.path, -1, 0)
        return (a + b * np.cos(angle)[..., None] + c * np.sin(angle)[..., None]).T

    def lowest(self, rows, place, beside=0.0):
        """Elevation of the skyline, rad; the highest within `beside` to either side of `place`."""
        if not len(rows):
            return np.zeros(0)
        frame = self.frame[rows]
        east, north, up = np.einsum('nkj,kn->jn', frame, place)
        az = np.arctan2(east, north)
        out = self.least[rows].copy()
        corners = self._corners[self._index[rows]]
        wide = np.minimum(beside / np.maximum(np.hypot(east, north), 1e-3), np.pi)
        for k in np.linspace(-1.0, 1.0, 9) if beside else (0.0,):
            at = np.mod(az + k * wide, 2.0 * np.pi)
            right = np.sum(corners[:, :, 0] <= at[:, None], 1)
            right = np.clip(right, 1, np.maximum(np.sum(np.isfinite(corners[:, :, 0]), 1) - 1, 1))
            n = np.arange(len(rows))
            (a0, e0), (a1, e1) = corners[n, right - 1].T, corners[n, right].T
            with np.errstate(invalid='ignore', divide='ignore'):
                el = e0 + (e1 - e0) * (at - a0) / (a1 - a0)
            out = np.fmax(out, el)
        return out

    def clearances(self, angles, seconds, beside=0.0):
        """Distances above the skyline and from the Sun's circle, rad, each (n,)."""
        first, second = angles
        place = np.array(self.sky(np.sin(first), np.cos(first), np.sin(second), np.cos(second)))
        up = np.clip(np.sum(self._up * place, 0), -1.0, 1.0)
        above, least = np.arcsin(up), self.least.copy()
        low = np.flatnonzero((above < self.top) & (self.top > self.least))
        least[low] = self.lowest(low, place[:, low], beside)
        apart = np.arccos(np.clip(np.sum(self.suns(np.broadcast_to(
            seconds, first.shape)) * place, 0), -1.0, 1.0)) - self.sun
        return above - least, np.where(self._by_sun, apart, np.inf)

    def inside(self, angles):
        """Distance from the nearest end of the travel, rad, (n,)."""
        return np.minimum(angles - self.travel[:, 0], self.travel[:, 1] - angles).min(0)


def hermite(times, angles, rates, t):
    """Angles and rates of a track at times (m,): (m, 2) each; its ends at rest beyond them."""
    if len(times) == 1:
        return np.repeat(angles, len(t), 0), np.zeros((len(t), 2))
    k = np.clip(np.searchsorted(times, t, 'right') - 1, 0, len(times) - 2)
    h = np.diff(times)[k][:, None]
    s = np.clip((t - times[k])[:, None] / h, 0.0, 1.0)
    p0, p1, v0, v1 = angles[k], angles[k + 1], rates[k] * h, rates[k + 1] * h
    c2, c3 = 3.0 * (p1 - p0) - 2.0 * v0 - v1, 2.0 * (p0 - p1) + v0 + v1
    speed = (v0 + s * (2.0 * c2 + 3.0 * s * c3)) / h
    speed[t > times[-1]] = 0.0
    return p0 + s * (v0 + s * (c2 + s * c3)), speed


class Tracks:
    """Tracks of many cases, followed step by step."""

    def __init__(self, tracks):
        n = len(tracks)
        self.times = np.full((n, KNOTS + 1), np.inf)
        self.cubics = np.zeros((n, KNOTS + 1, 4, 2))
        for row, cubics, (times, angles, rates) in zip(self.times, self.cubics, tracks):
            m = len(times)
            h = np.diff(times)[:, None]
            step, v0, v1 = np.diff(angles, axis=0), rates[:-1], rates[1:]
            row[:m] = times
            cubics[:m - 1, 0], cubics[:m - 1, 1] = angles[:-1], v0
            cubics[:m - 1, 2] = (3.0 * step / h - 2.0 * v0 - v1) / h
            cubics[:m - 1, 3] = (v0 + v1 - 2.0 * step / h) / h**2
            cubics[m - 1, 0] = angles[-1]
        self.leg = np.zeros(n, int)
        self._at()

    def _at(self):
        rows = np.arange(len(self.leg))
        self._now = np.moveaxis(self.cubics[rows, self.leg], 0, -1).copy()
        self._begin = self.times[rows, self.leg].copy()
        self._end = self.times[rows, self.leg + 1].copy()

    def keep(self, rows):
        """The same of some of the cases."""
        self.times, self.cubics, self.leg = self.times[rows], self.cubics[rows], self.leg[rows]
        self._at()

    def at(self, t):
        """Angles and rates, (2, n); `t` never goes back."""
        while (over := t >= self._end).any():
            rows = np.flatnonzero(over)
            self.leg[rows] += 1
            legs = self.leg[rows]
            self._now[:, :, rows] = np.moveaxis(self.cubics[rows, legs], 0, -1)
            self._begin[rows], self._end[rows] = self.times[rows, legs], self.times[rows, legs + 1]
        u = t - self._begin
        p, v, a, j = self._now
        return p + u * (v + u * (a + u * j)), v + u * (2.0 * a + 3.0 * u * j)

    @property
    def over(self):
        """Mask of the tracks that have ended."""
        return ~np.isfinite(self._end)


def carry_out(cases, shares, waits=None, beside=0.0):
    """Smallest distance from each limit while commands are executed.

    Parameters
    ----------
    cases : list of dict
        ``setting``; ``angles`` and ``rates`` (2,) at the begin; ``track``; ``vias``.
    shares : ndarray, shape (n, 2, 2)
        Fractions of speed and acceleration (last axis) that each axis uses.
    waits : ndarray, shape (n, 2), optional
        Seconds before each axis starts.
    beside : float
        The highest skyline within this distance on either side counts, rad.

    Returns
    -------
    worst, start : ndarray, shape (n, 3)
        rad: travel, skyline, Sun. `worst` is relative to the limit, or to the start if that is
        beyond it; for the Sun, to the distance that the start would have at that time.
    """
    settings = list({id(c['setting']): c['setting'] for c in cases}.values())
    number = {id(s): k for k, s in enumerate(settings)}
    many = Many(settings, np.array([number[id(c['setting'])] for c in cases]))
    n = len(cases)
    tracks = Tracks([c['track'] for c in cases])
    count = np.array([len(c['vias']) for c in cases])
    vias = np.zeros((n, count.max() + 1, 2))
    for row, case in zip(vias, cases):
        row[:len(case['vias'])] = np.reshape(case['vias'], (-1, 2))
    angle = np.array([c['angles'] for c in cases], float).T
    rate = np.array([c['rates'] for c in cases], float).T
    top = many.rate * shares[:, :, 0].T
    most = many.acceleration * shares[:, :, 1].T
    first = np.array([many.inside(angle), *many.clearances(angle, np.zeros(n), beside)])
    worst, ids, begin = first.copy(), np.arange(n), angle.copy()
    worst[2] -= np.minimum(first[2], 0.0)
    leg, since, error = np.zeros(n, int), np.zeros(n), np.ones((2, n))
    via = vias[ids, 0].T
    for step in range(int(SECONDS / STEP)):
        if step % 100 == 99:
            alive = ~(tracks.over & (leg >= count) & (np.abs(error).max(0) < 0.002 * DEG)
                      & (np.abs(rate).max(0) < 0.01 * DEG))
            if not alive.any():
                break
            if alive.mean() < 0.9:
                many.keep(alive)
                tracks.keep(alive)
                begin = begin[:, alive]
                angle, rate, top, most = angle[:, alive], rate[:, alive], top[:, alive], \
                    most[:, alive]
                leg, since, count, ids = leg[alive], since[alive], count[alive], ids[alive]
                vias, waits = vias[alive], None if waits is None else waits[alive]
                via = vias[np.arange(len(leg)), leg].T
        going = leg >= count
        since = np.where(going, since + STEP, since)
        target, speed = tracks.at(since)
        target, speed = np.where(going, target, via), np.where(going, speed, 0.0)
        error = target - angle
        size = np.abs(error)
        # as fast as can still be braked after this step, relative to the target
        half, sign = 0.5 * most * STEP, np.sign(error)
        room = half * half + 2.0 * most * size - 2.0 * half * sign * (rate - speed)
        way = np.sqrt(np.maximum(room, 0.0)) - half
        wanted = speed + sign * np.minimum(way, size / STEP)
        wanted = np.minimum(np.maximum(wanted, -top), top)
        if waits is not None:
            wanted = np.where(step * STEP < waits.T, 0.0, wanted)
        change = most * STEP
        before = rate
        rate = rate + np.minimum(np.maximum(wanted - rate, -change), change)
        angle = angle + 0.5 * STEP * (before + rate)
        if not going.all():
            there = ~going & (size.max(0) < 0.05 * DEG) & (np.abs(rate).max(0) < 0.05 * DEG)
            if there.any():
                leg = leg + there
                via = vias[np.arange(len(leg)), leg].T
        if step % LOOK == 0:
            _look(many, angle, angle + rate * np.abs(rate) / (2.0 * most), step * STEP, worst, ids,
                  beside, begin)
    worst[:2] -= np.minimum(first[:2], 0.0)
    return worst.T, first.T


def _look(many, here, stop, seconds, worst, ids, beside, begin):
    """The worst of where both axes are, and where they are if one or both of them are stopped."""
    inside = np.minimum(many.inside(here), many.inside(stop))
    sines, cosines = np.sin([here, stop]), np.cos([here, stop])
    sun = many.suns(np.full(len(ids), seconds))
    highest = np.sin(np.maximum(many.top, many.least))
    least_up, near = np.ones(len(ids)), np.full(len(ids), -1.0)
    above = np.full(len(ids), np.inf)
    for i in (0, 1):
        for j in (0, 1):
            place = many.sky(sines[i, 0], cosines[i, 0], sines[j, 1], cosines[j, 1])
            up = many._up[0] * place[0] + many._up[1] * place[1] + many._up[2] * place[2]
            near = np.maximum(near, sun[0] * place[0] + sun[1] * place[1] + sun[2] * place[2])
            least_up = np.minimum(least_up, up)
            low = np.flatnonzero((up < highest + 0.05) & (many.top > many.least))
            if len(low):
                at = np.array(place)[:, low]
                above[low] = np.minimum(above[low], np.arcsin(np.clip(up[low], -1.0, 1.0))
                                        - many.lowest(low, at, beside))
    flat = np.arcsin(np.clip(least_up, -1.0, 1.0)) - many.least
    apart = np.where(many._by_sun, np.arccos(np.clip(near, -1.0, 1.0)) - many.sun, np.inf)
    place = np.array(many.sky(*np.sin(begin[:1]), *np.cos(begin[:1]), *np.sin(begin[1:]),
                              *np.cos(begin[1:])))
    stayed = np.arccos(np.clip(np.sum(sun * place, 0), -1.0, 1.0)) - many.sun
    apart = apart - np.where(many._by_sun, np.minimum(stayed, 0.0), 0.0)
    worst[:, ids] = np.minimum(worst[:, ids], [inside, np.minimum(above, flat), apart])
