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

"""Causes simulated by independent geometry, not with effects of the dictionary.

For `mount_causes.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap

U = 5.0 * ARCSEC  # size before it is scaled


@dataclass(frozen=True)
class Cause:
    """A simulated cause.

    Attributes
    ----------
    names : tuple of str
        Beginnings of its names in the dictionary.
    signal : callable
        (columns, mount, rng) -> offsets (2, n), radians on the sky along the axes.
    mounts : tuple of str
    alike : tuple of str
        Beginnings of the names of near aliases.
    prepare : callable, optional
        (columns, mount, rng) -> columns more, or other ones; ``turns``: whole turns that the first
        encoder reads beyond its angle.
    sizes : tuple of (int, float), optional
        Rows and lambda, where they are not those of all.
    """

    names: tuple
    signal: Callable
    mounts: tuple = ('altaz', 'german')
    alike: tuple = ()
    prepare: Callable | None = None
    sizes: tuple | None = None


def _elevation(c, mount):
    return mount.horizon_of(c['az'], c['el'])[1]


def _first(c, angle):
    return np.array([angle * np.cos(c['el']), 0.0 * angle])


def _second(angle):
    return np.array([0.0 * angle, angle])


# ---------------------------------------------------------------------------- a mirror that flops

def _flop(c, mount, rng, play=0.0):
    """A mirror that rests on one stop or the other, by the pull of gravity across it."""
    el = _elevation(c, mount)
    at = np.quantile(el, rng.uniform(0.25, 0.75))
    # what pulls it over is not enough until it has gone `play` beyond
    at = at + play * c['approach_el']
    low = np.cos(el) > np.cos(at)
    return U * low * np.array([[0.3 * rng.normal()], [1.0]])


def _flop_over(c, mount, rng):
    """The same between its sides, near where the tube is highest."""
    over = np.sin(c['az']) > np.sin(rng.uniform(-10.0, 10.0) * DEG)
    return U * over * rng.normal(size=(2, 1))


def _jump(c, mount, rng):
    """An encoder tape that begins anew at its joint: beyond it all readings of the axis are off."""
    if rng.random() < 0.5:
        return _second(U * (c['el'] > np.quantile(c['el'], rng.uniform(0.25, 0.75))))
    end = 0.0 if mount.vertical else -0.5 * np.pi  # of the turn, where no star is
    angle = np.mod(c['az'] - end, 2.0 * np.pi)
    return _first(c, U * (angle > np.quantile(angle, rng.uniform(0.25, 0.75))))


# ----------------------------------------------------------------------------------- rail joints

def _joints(c, mount, rng, count=1):
    """Wheels sink in at joints of the track: the tube dips where it looks over one."""
    width = rng.uniform(2.5, 5.0) * DEG
    while True:
        at = rng.uniform(0.0, 2.0 * np.pi) + 2.0 * np.pi / count * np.arange(count)
        away = np.abs(wrap(c['az'][:, None] - at)).min(axis=1)
        if np.sum(away < width) >= 3:
            break
    depth = np.exp(-0.5 * (away / width)**2)
    return _second(-U * depth)


# ----------------------------------------------------------------------- what knows whole turns

def _winding(c, mount, rng, reach=270.0 * DEG):
    """The mount goes on by the shorter way, within its travel: whole turns of the encoder."""
    turns, at = np.zeros(len(c['az'])), rng.uniform(-reach, reach)
    for i, angle in enumerate(c['az']):
        ways = angle + 2.0 * np.pi * np.arange(-2, 3)
        ways = ways[np.abs(ways) <= reach]
        at = ways[np.argmin(np.abs(ways - at) + rng.exponential(2.0, len(ways)))]
        turns[i] = np.rint((at - angle) / (2.0 * np.pi))
    return {'turns': turns}


def _wound(c, mount, rng):
    """As `_winding`, over the 1.2 turns from where a cage may be told from the axis."""
    while True:
        out = _winding(c, mount, rng)
        if np.ptp(c['az'] + 2.0 * np.pi * out['turns']) > 1.25 * 2.0 * np.pi:
            return out


def _cage(c, mount, rng):
    """Balls of a bearing go round with their cage: (1 - d / D cos a) / 2 turns a turn."""
    way = rng.uniform(0.35, 0.6) * (c['az'] + 2.0 * np.pi * c['turns']) + rng.uniform(0.0, 6.0)
    lean_y, lean_x = U * np.cos(way), U * np.sin(way) * rng.integers(0, 2)
    return np.array([lean_x * np.sin(c['el']), lean_y])


def _drag(c, mount, rng):
    """A bundle of cables that is wound up: a spring that stiffens toward either end."""
    way = (c['az'] + 2.0 * np.pi * c['turns']) / (270.0 * DEG) - rng.uniform(-0.3, 0.3)
    pull = way + 0.5 * rng.normal() * way**3
    return _first(c, U * pull) if rng.integers(0, 2) else _second(U * pull)


# ------------------------------------------------------------------------------- not the mount's

def _off_axis(c, mount, rng):
    """The mean of the places of two cameras, c to the left and c to the right."""
    out = np.zeros((2, len(c['az'])))
    for side in (-1.0, 1.0):
        e = c['el']
        across = side * 1.3 * DEG
        seen = np.arcsin(np.sin(e) * np.cos(across))
        out[1] += 0.5 * wrap(np.where(np.cos(e) < 0.0, np.pi - seen, seen) - e)
    return -out


# ------------------------------------------------------------------------------- side of the pier

def _side_sag(c, mount, rng):
    """A focuser that hangs in its thread: it sags by the pull across it, more on one side."""
    a, e = c['az'], c['el']
    pulls = []
    for da, de in ((1e-5, 0.0), (0.0, 1e-5)):  # how fast the height grows along either axis
        up = [np.sin(mount.horizon_of(a + s * da, e + s * de)[1]) for s in (-0.5, 0.5)]
        pulls.append((up[1] - up[0]) / 1e-5)
    right, up = pulls[0] / np.cos(e), pulls[1]
    beyond = np.cos(e) < 0.0
    size = U * np.where(beyond, 1.0, -1.0 if rng.integers(0, 2) else 0.2)
    return size * (np.array([right, 0.0 * up]) if rng.integers(0, 2) else np.array([right, up]))


# ---------------------------------------------------------------------------------------- shapes

def _no_nod(c, mount, rng):
    """Five times a turn, and gone at the horizon and at the zenith."""
    return _second(U * np.cos(5.0 * c['az'] + rng.uniform(0.0, 6.0)) * np.sin(2.0 * c['el']))


def _turning(c, mount, rng):
    """A disc whose centre goes round its axis while the night goes on."""
    hours = (c['time'] - c['time'][0]) / 3600.0
    toward = rng.uniform(0.0, 6.0) + rng.choice((-1, 1)) * rng.uniform(0.6, 2.5) * hours
    x, y = np.cos(c['az']) - U * np.cos(toward), np.sin(c['az']) - U * np.sin(toward)
    return _first(c, wrap(np.arctan2(y, x) - c['az']))


def _six_hours(c, mount, rng):
    n = len(c['az'])
    return {'time': 1.7e9 + np.sort(rng.uniform(0.0, 6.0 * 3600.0, n))}


def _wave(c, mount, rng):
    order, phase = int(rng.integers(3, 9)), rng.uniform(0.0, 6.0)
    return U * np.array([np.cos(order * c['el'] + phase), 0.0 * c['el']])


CAUSES = {
    'flop': Cause(('flop',), _flop),
    'flop with play': Cause(('flop',), lambda c, m, r: _flop(c, m, r, 5.0 * DEG), ('altaz',)),
    'flop over': Cause(('flop_sideways',), _flop_over, ('equatorial',)),
    'reading jump': Cause(('azimuth_jump', 'elevation_jump', 'hour_angle_jump', 'declination_jump'),
                          _jump, ('altaz', 'german', 'equatorial'), ('flop',)),
    'rail joint': Cause(('track_bump',), _joints),
    'rail joints, six': Cause(('track_bump',), lambda c, m, r: _joints(c, m, r, 6), ('altaz',)),
    'bearing cage': Cause(('bearing_cage',), _cage, ('altaz',), prepare=_wound),
    'cable drag': Cause(('cable_drag',), _drag, ('altaz',), prepare=_winding),
    'off-axis camera': Cause(('off_axis',), _off_axis),
    'sag by side': Cause(('TF_by_side', 'focuser_sag'), _side_sag, ('german',)),
    'a nod that is none': Cause(('nod_unlike',), _no_nod, ('altaz', 'german'),
                                sizes=((60, 14.0),)),
    'turning eccentricity': Cause(('turning',), _turning, ('altaz',), prepare=_six_hours,
                                  sizes=((60, 14.0), (60, 25.0))),
    # sin E cos 2E is half of sin 3E, and a term
    'wave of the second angle': Cause(('harmonic',), _wave, alike=(
        'elevation_axis_wobble', 'declination_axis_wobble')),
}
