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

"""A sky map: arrows of residuals, positions to observe, dashed grid of the mount axes."""

import numpy as np

from .drawing import clean, pt, text

#: margin for arrows that extend beyond the map
ARROW_MARGIN = 40.0
#: grid lines of the second and of the first axis, deg
_EACH, _ROUND = np.arange(-60.0, 61.0, 30.0), np.arange(-150.0, 181.0, 30.0)


class SkyMap:
    """Sky map oriented like a compass: zenith in the centre, north up, east to the right.

    Parameters
    ----------
    size : float
        Side of the square drawing.
    lowest : float
        Elevation at the rim, degrees.
    grid : tuple, optional
        Coordinate grid of the mount, see `grid_of`, drawn dashed.
    """

    def __init__(self, size, lowest, grid=None):
        self.size, self.centre, self.radius = size, size / 2, size / 2 - 24
        self.lowest = lowest
        self.parts = []
        #: how far arrows extend beyond the drawing: left, above, right, below; and the number of
        #: arrows drawn shortened
        self.beyond, self.shortened = np.zeros(4), 0
        c, r = self.centre, self.radius
        for elevation in np.arange(np.ceil(lowest / 30.0) * 30.0, 90.0, 30.0):
            rr = r * (90.0 - elevation) / (90.0 - lowest)
            self.parts.append(f'<circle class="grid" cx="{pt(c)}" cy="{pt(c)}" r="{pt(rr)}"/>')
            if elevation > lowest:
                self.parts.append(text(c + 3, c - rr + 11, f'{elevation:g}°', anchor='start'))
        self.parts.append(f'<circle class="rim" cx="{pt(c)}" cy="{pt(c)}" r="{pt(r)}"/>'
                          f'<path class="grid" d="M{pt(c - r)} {pt(c)}h{pt(2 * r)}M{pt(c)} '
                          f'{pt(c - r)}v{pt(2 * r)}"/>')
        for side, dx, dy in (('N', 0, -1), ('E', 1, 0), ('S', 0, 1), ('W', -1, 0)):
            self.parts.append(text(c + dx * (r + 12), c + dy * (r + 12), side, 'label', dy='.35em'))
        if grid is not None:
            self._axes_of(*grid)

    def _axes_of(self, lines, names):
        """Draw the coordinate grid of a mount and its labels."""
        d = ''
        for az, el in lines:
            seen = np.degrees(el) >= self.lowest - 1e-6  # below the rim a line is broken
            for i, (x, y) in enumerate(zip(*self.place(az, el))):
                if seen[i]:
                    d += f'{"L" if i and seen[i - 1] else "M"}{pt(x)} {pt(y)}'
        self.parts.append(f'<path class="grid axes" d="{d}"/>')
        for az, el, name in names:
            x, y = self.place(az, el)
            # keep clear of the elevation labels above the centre
            if np.degrees(el) >= self.lowest + 3.0 and np.hypot(x - self.centre - 12.0,
                                                                y - self.centre) > 12.0:
                self.parts.append(text(x - 3, y - 3, name, 'axes', anchor='end'))

    def place(self, az, el):
        """Drawing coordinates of directions, radians."""
        distance = self.radius * (90.0 - np.degrees(el)) / (90.0 - self.lowest)
        return self.centre + distance * np.sin(az), self.centre - distance * np.cos(az)

    def _vectors(self, az, el, x, y):
        """Start points of arrows, and their components at one drawing unit per arcsec."""
        s, c = np.sin(az), np.cos(az)
        return *self.place(az, el), x * c - y * s, x * s + y * c

    def _room(self, px, py, dx, dy):
        """Largest scale with which each arrow ends within the drawing and its margin."""
        low, high = -ARROW_MARGIN, self.size + ARROW_MARGIN
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.min([np.where(d == 0.0, np.inf, (np.where(d > 0.0, high, low) - p) / d)
                           for p, d in ((px, dx), (py, dy))], axis=0)

    def scale_for(self, az, el, x, y, wanted):
        """Scale with which all arrows end within the drawing and its margin.

        Parameters
        ----------
        az, el, x, y : ndarray, shape (n,)
            See `arrows`.
        wanted : float
            Largest scale, drawing units per arcsec; the result is at least half of it.
        """
        room = self._room(*self._vectors(az, el, x, y))
        return float(np.clip(room.min(initial=np.inf), 0.5 * wanted, wanted))

    def arrows(self, az, el, x, y, scale, style, names, keys=None):
        """Draw residual vectors, toward increasing azimuth and elevation.

        Parameters
        ----------
        az, el : ndarray, shape (n,)
            Radians.
        x, y : ndarray, shape (n,)
            On the sky, arcsec.
        scale : float
            Drawing units per arcsec.
        names, keys : sequence of str
            See `Panel.points`.
        """
        px, py, dx, dy = self._vectors(az, el, x, y)
        dx, dy = dx * scale, dy * scale
        cap = np.minimum(1.0, 0.6 * self.radius / np.maximum(np.hypot(dx, dy), 1e-12))
        cap = np.minimum(cap, self._room(px, py, dx, dy))
        self.shortened += int((cap < 1.0 - 1e-9).sum())
        ends = np.array((px + cap * dx, py + cap * dy))
        self.beyond = np.maximum(self.beyond, np.concatenate((
            -ends.min(axis=1, initial=0.0), ends.max(axis=1, initial=self.size) - self.size)))
        self.parts.append(f'<g class="{style}" data-arrows="{scale:.6g} {0.6 * self.radius:g}">')
        for i, (a, b, u, v) in enumerate(zip(px, py, dx * cap, dy * cap)):
            key = '' if keys is None else f' data-i="{keys[i]}"'
            title = '' if names is None else f'<title>{clean(names[i])}</title>'
            self.parts.append(f'<g{key}>{title}<circle cx="{pt(a)}" cy="{pt(b)}" r="1.7"/>'
                              f'<path d="{_arrow(a, b, u, v)}"/></g>')
        self.parts.append('</g>')

    def marks(self, az, el, style, texts):
        """Draw numbered positions."""
        for i, (a, b) in enumerate(zip(*self.place(az, el))):
            self.parts.append(
                f'<g class="{style}"><title>{clean(texts[i])}</title><circle cx="{pt(a)}" '
                f'cy="{pt(b)}" r="9"/><text text-anchor="middle" x="{pt(a)}" y="{pt(b)}" '
                f'dy=".35em">{i + 1}</text></g>')


def _arrow(x, y, dx, dy):
    length = float(np.hypot(dx, dy))
    d = f'M{pt(x)} {pt(y)}l{pt(dx)} {pt(dy)}'
    if length > 3.0:
        head = min(5.0, 0.45 * length)
        ux, uy = dx / length, dy / length
        for side in (1.0, -1.0):
            hx, hy = -ux + 0.5 * side * uy, -uy - 0.5 * side * ux
            d += f'M{pt(x + dx)} {pt(y + dy)}l{pt(head * hx)} {pt(head * hy)}'
    return d


def grid_of(mount):
    """The coordinate grid of a mount; None for an alt-azimuth mount, whose grid is the map's.

    Parameters
    ----------
    mount : pointing_model.mounts.Mount

    Returns
    -------
    lines : list of (ndarray, ndarray)
        Azimuth and elevation, rad, of lines of constant axis angle.
    names : list of (float, float, str)
        Azimuth, elevation and text of each label.
    """
    if mount.vertical:
        return None
    along, across = np.radians(np.arange(-180.0, 181.0, 3.0)), np.radians(_EACH)
    up = along[np.abs(along) <= 0.5 * np.pi]
    one, other = mount.names.letters
    names = (*((0.0, angle, f'{other} {angle:g}°') for angle in _EACH), (0.0, 90.0, 'pole'),
             (0.0, -90.0, 'pole'),
             *((angle, 0.0, f'{one} {angle:g}°') for angle in _ROUND if angle))
    return ([*(mount.horizon_of(along, angle + 0.0 * along) for angle in across),
             *(mount.horizon_of(angle + 0.0 * up, up) for angle in np.radians(_ROUND))],
            [(*mount.horizon_of(*np.radians([first, second])), name)
             for first, second, name in names])
