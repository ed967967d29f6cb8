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

"""Mounts: orientation of the two axes relative to the horizon. Names are in `mount_kinds`.

The axis frame is a rotation of the local horizon (east, north, up). Its z is the pole of the
first axis. The first angle grows clockwise as seen from there, from y over x: azimuth from north
through east, and hour angle from the meridian through west. The second angle goes from the equator
of the frame to its pole. So all mounts are the same mount in different frames::

    direction = (cos e sin a, cos e cos a, sin e) in the axis frame

A direction is reached in two ways, (a, e) and, through the pole, (a + 180 deg, 180 deg - e): the
two sides of the pier, or for an alt-azimuth mount either side of the zenith. Catalogue places of
a run are the axis angles of a perfect mount *on the side that it was on*, so second angles beyond
90 degrees are normal. Errors of an axis then have one formula on both sides, and signs that
change on the sky follow from the geometry. Effects of gravity or the sky are rotated from the
horizon into the axis frame, see `Mount.tangents`.

A program that corrects hour angle and declination *before* it chooses the side of the pier has
errors of another kind: they act on the sky, the same on both sides (`Mount.errors`).
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from msg_tools.units import DEG, wrap

from .mount_kinds import KINDS, USUAL, kinds_text

#: frames that differ by less are equal, rad: 0.0002", for a rounded latitude
SAME = 1e-9
#: where the errors of a mount act, see `Mount`
OF_MOUNT, ON_SKY = 'mount', 'sky'
_HORIZON = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Mount:
    """A kind of mount and the orientation of its axes relative to the horizon.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    frame : tuple of tuple of float
        The axes x, y, z of its frame, each as (east, north, up): a rotation matrix.
    errors : {'mount', 'sky'}
        Where its terms act: on the parts of the mount, which go through the pole with it; or, for
        a German mount, on the sky, by a program that applies them before it chooses the side.

    Raises
    ------
    ValueError
        Unknown kind or errors, or the frame is no rotation.
    """

    kind: str = USUAL
    frame: tuple = _HORIZON
    errors: str = OF_MOUNT

    def __post_init__(self):
        if self.kind not in KINDS:
            raise ValueError(f'unknown mount {self.kind!r}; choose from {", ".join(KINDS)}')
        matrix = np.asarray(self.frame, float)
        if matrix.shape != (3, 3) or not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-9) \
                or np.linalg.det(matrix) < 0.0:
            raise ValueError('the frame of a mount is no rotation of the horizon')
        object.__setattr__(self, 'frame', tuple(map(tuple, matrix.tolist())))
        if self.errors not in (OF_MOUNT, ON_SKY):
            raise ValueError(f'errors of a mount that act on {self.errors!r}; choose from '
                             f'{OF_MOUNT}, {ON_SKY}')
        if self.on_sky and not self.two_sided:
            raise ValueError(f'errors that act on the sky before the flip, of {self.names.words}: '
                             'it has none')

    @property
    def on_sky(self):
        """Whether its terms act on the sky, the same on both sides of the pier."""
        return self.errors == ON_SKY

    def with_errors(self, errors):
        """The same mount, with errors that act on the mount or on the sky."""
        return _with_errors(self, errors)

    @classmethod
    def equatorial(cls, latitude, kind='equatorial'):
        """An equatorial mount: its pole is the celestial pole, hour angle 0 is the meridian.

        Parameters
        ----------
        latitude : float
            Radians, north positive.
        kind : {'equatorial', 'german'}
        """
        return cls._with_pole(kind, 0.0, latitude, 0.0)

    @classmethod
    def free(cls, azimuth, elevation, roll=0.0):
        """A mount given by the direction of its first axis.

        Parameters
        ----------
        azimuth, elevation : float
            Pole of the first axis, radians; 0, 0 for an alt-alt mount whose axis goes from south to
            north.
        roll : float
            First angle, clockwise about the pole, at the highest point of the frame's equator.
        """
        return cls._with_pole('free', azimuth, elevation, roll)

    @classmethod
    def _with_pole(cls, kind, azimuth, elevation, roll=0.0):
        s, c = np.sin(azimuth), np.cos(azimuth)
        z = np.array([np.cos(elevation) * s, np.cos(elevation) * c, np.sin(elevation)])
        y = np.array([-np.sin(elevation) * s, -np.sin(elevation) * c, np.cos(elevation)])
        x = np.cross(y, z)
        turn = np.cos(roll), np.sin(roll)
        return cls(kind, (turn[0] * x + turn[1] * y, turn[0] * y - turn[1] * x, z))

    @property
    def names(self):
        """Its `MountKind`."""
        return KINDS[self.kind]

    @property
    def vertical(self):
        """Whether the axis frame is the horizon, whose pole is the zenith."""
        return self.names.vertical

    @property
    def celestial(self):
        """Whether the first axis points to the celestial pole."""
        return self.names.celestial

    @property
    def two_sided(self):
        """Whether it goes through the pole to change sides, as a German mount does."""
        return self.names.two_sided

    def entries(self):
        """Entries of a results document for mounts other than alt-azimuth ones.

        Its ``az`` and ``el`` then refer to these axes.

        Returns
        -------
        dict
            ``mount`` (the kind) and ``mount_axes``; empty for an alt-azimuth mount. ``errors_act``
            if its errors act on the sky.
        """
        if self.vertical:
            return {}
        return {'mount': self.kind, 'mount_axes': list(self.names.axes),
                **({'errors_act': ON_SKY} if self.on_sky else {})}

    def agrees(self, other):
        """Whether it is the same mount, within rounding of the given angles.

        Where the errors act belongs to the model, and is not compared.

        Parameters
        ----------
        other : Mount
        """
        return self.kind == other.kind and (self.frame == other.frame or np.allclose(
            self.frame, other.frame, rtol=0.0, atol=SAME))

    @property
    def latitude(self):
        """Elevation of the pole of the first axis, radians; the latitude of an equatorial mount."""
        return float(np.arcsin(np.clip(self.frame[2][2], -1.0, 1.0)))

    @property
    def zenith(self):
        """Components of the zenith in the axis frame."""
        return tuple(axis[2] for axis in self.frame)

    def axes_of(self, az, el, beyond=False):
        """Axis angles at which a perfect mount points at a place of the horizon.

        Parameters
        ----------
        az, el : float or ndarray
            Azimuth from north through east and elevation, radians.
        beyond : bool or ndarray of bool
            Whether it points there through the pole.

        Returns
        -------
        first, second : ndarray
            Radians, both in -pi to pi.
        """
        x, y, z = np.tensordot(np.array(self.frame), unit_vector(az, el), 1)
        return through_pole(np.arctan2(x, y), np.arctan2(z, np.hypot(x, y)), beyond)

    def on_travel(self, first, second):
        """Axis angles on the turn that such a mount uses.

        A German mount that points through the pole has its first axis at 0 to 180 degrees and its
        second at 90 to 270. Other mounts have angles around 0.

        Parameters
        ----------
        first, second : float or ndarray
            Radians.

        Returns
        -------
        first, second : float or ndarray
            Within half a turn of the centre of the travel.
        """
        if self.vertical:
            return first, second
        middle = np.pi / 2.0 if self.two_sided else 0.0
        return middle + wrap(first - middle), middle + wrap(second - middle)

    def way(self, here, there):
        """Signed turn of the first axis between two angles, radians.

        Azimuth takes the shorter way; other axes stay within their travel.

        Parameters
        ----------
        here, there : float or ndarray
            Radians, see `on_travel`.
        """
        return wrap(there - here) if self.vertical else there - here

    def side_for(self, first, second, limit, beyond):
        """Whether such a mount points through the pole at a place.

        A German mount keeps its counterweight down: it points through the pole east of the meridian
        only.

        Parameters
        ----------
        first, second : float or ndarray
            Angles of the place, not through the pole, radians.
        limit : float
            Limit of the axis past the meridian, radians: within it both sides are possible.
        beyond : bool or ndarray of bool
            The side to take where both are possible.

        Returns
        -------
        bool or ndarray of bool
        """
        if not self.two_sided:
            return np.zeros(np.shape(first), bool)[()]
        first = wrap(first)
        return np.where(np.abs(first) < limit, beyond, first < 0.0)[()]

    def horizon_of(self, first, second):
        """Azimuth (0 to 2 pi) and elevation at which a perfect mount points.

        Parameters
        ----------
        first, second : float or ndarray
            Axis angles, radians; the second may be beyond the pole.
        """
        if self.vertical and not np.any(is_beyond(second)):
            return first, second
        east, north, up = self.direction(first, second)
        return np.mod(np.arctan2(east, north), 2.0 * np.pi), np.arctan2(up, np.hypot(east, north))

    def direction(self, first, second):
        """East, north and up of a direction, shape (3, ...)."""
        place = unit_vector(first, second)
        return place if self.vertical else np.tensordot(np.array(self.frame).T, place, 1)

    def tangents(self, first, second):
        """Unit vectors (east, north, up) of increasing axis angles, each of shape (3, ...).

        Beyond the pole both are reversed on the sky, like the images.
        """
        s, c = np.sin(first), np.cos(first)
        both = (np.array([c, -s, 0.0 * first]),
                np.array([-np.sin(second) * s, -np.sin(second) * c, np.cos(second)]))
        if self.vertical:
            return both
        frame = np.array(self.frame).T
        return tuple(np.tensordot(frame, one, 1) for one in both)


@cache
def _with_errors(mount, errors):
    return replace(mount, errors=errors)


#: azimuth from north through east, elevation
ALTAZ = Mount()


def unit_vector(az, el):
    """East, north, up of azimuths and elevations, shape (3, ...)."""
    return np.array([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az),
                     np.sin(el) * np.ones_like(az)])


def through_pole(first, second, beyond):
    """Axis angles of the same direction, through the pole where `beyond`.

    Parameters
    ----------
    first, second : float or ndarray
        Radians.
    beyond : bool or ndarray of bool

    Returns
    -------
    first, second : ndarray
        Where `beyond`: first + pi, pi - second, each in -pi to pi.
    """
    return (np.where(beyond, wrap(first + np.pi), first),
            np.where(beyond, wrap(np.pi - second), second))


def sides(first, second):
    """Axis angles folded back to the sky, and the sign of on-sky offsets along them.

    Parameters
    ----------
    first, second : float or ndarray
        Radians.

    Returns
    -------
    first, second : ndarray
        Not through the pole, radians.
    side : ndarray
        -1 for a place through the pole: an offset of the first angle is unchanged, but cos of the
        second angle changes its sign, and the second angle runs backwards.
    """
    beyond = is_beyond(second)
    return (*through_pole(first, second, beyond), np.where(beyond, -1.0, 1.0))


def is_beyond(second):
    """Whether a second angle is beyond the pole."""
    return np.cos(second) < 0.0


def centred_second(reading, first, miss, beyond=False):
    """`centred` for the second encoder, each axis of which may be NaN.

    Centring one axis depends slightly on the position of the other: the `first` encoder's reading
    is good enough for it.

    Parameters
    ----------
    reading, first, miss : array_like, shape (2,)
        Radians.
    beyond : bool
        See `centred`.

    Returns
    -------
    ndarray, shape (2,)
    """
    known = np.isfinite(reading)
    return np.where(known, centred(*np.where(known, reading, first), *miss, beyond), np.nan)


def centred(az, el, miss_x, miss_y, beyond=False):
    """The encoder reading that would put the star on the boresight.

    The miss distance is a point in the tangent plane at the pointing. It is projected back to the
    sphere exactly, for stars near the zenith.

    Parameters
    ----------
    az, el : float or ndarray
        Encoder reading, rad.
    miss_x, miss_y : float or ndarray
        Star minus boresight toward the right and the top of the tube, rad: differences of the
        first angle times the cosine of the second, and of the second.
    beyond : bool or ndarray of bool
        Whether the mount points through the pole.

    Returns
    -------
    az, el : float or ndarray
        Radians.
    """
    up = np.cos(el) - miss_y * np.sin(el)
    side = np.where(beyond, -1.0, 1.0)[()]
    new_az = az + np.arctan2(side * miss_x, side * up)
    new_el = np.arctan2(np.sin(el) + miss_y * np.cos(el), side * np.hypot(miss_x, up))
    # on the same turn as the reading
    return new_az, np.where(beyond, el + wrap(new_el - el), new_el)[()]


def rows_by_side(mount, second):
    """Number of places on this side of the pier, and through the pole.

    Parameters
    ----------
    mount : Mount
    second : ndarray, shape (n,)
        Second angles, radians.

    Returns
    -------
    tuple of int, or None
        None unless it is a German mount.
    """
    if not mount.two_sided:
        return None
    beyond = int(np.count_nonzero(is_beyond(second)))
    return len(second) - beyond, beyond


def parse_mount(text, latitude=None):
    """Parse a kind of mount with its orientation.

    Parameters
    ----------
    text : str
        ``altaz``, ``equatorial`` (or ``fork``, ``horseshoe``), ``german``; ``xy``, ``xy:90``: an
        X/Y mount whose X axis points north, or to that azimuth; ``free:0,0`` or ``free:0,0,90``:
        azimuth and elevation of the pole of the first axis, and its roll, deg.
    latitude : float, optional
        Radians; needed for equatorial mounts.

    Raises
    ------
    ValueError
        One line that says what is wrong.
    """
    kind, _, numbers = text.strip().lower().partition(':')
    kind = next((name for name, one in KINDS.items() if kind in one.aliases), kind)
    if kind not in KINDS:
        raise ValueError(f'unknown mount {text!r}; choose from {kinds_text()} (degrees)')
    pole = KINDS[kind].pole
    if pole == 'given':
        try:
            pole = [float(part) * DEG for part in numbers.split(',')]
        except ValueError:
            pole = []
        if len(pole) not in (2, 3) or not np.all(np.isfinite(pole)):
            raise ValueError(f'mount {text!r}: give where its first axis points as '
                             f'{kind}:AZ,EL or {kind}:AZ,EL,ROLL, in degrees')
    elif pole == 'zenith':
        return ALTAZ if kind == USUAL else Mount(kind)
    elif pole == 'celestial':
        if latitude is None:
            raise ValueError(f'{KINDS[kind].words} needs the latitude of its site')
        return Mount.equatorial(latitude, kind)
    elif numbers:
        try:
            pole = (float(numbers) * DEG, *pole[1:])
        except ValueError:
            raise ValueError(f'mount {text!r}: give the azimuth of its first axis as {kind}:AZ, in '
                             'degrees') from None
    return Mount._with_pole(kind, *pole)


def mount_text(mount):
    """Text that `parse_mount` reads as the same mount, given the latitude of an equatorial one."""
    pole = mount.names.pole
    if isinstance(pole, tuple) and not mount.agrees(Mount._with_pole(mount.kind, *pole)):
        return f'{mount.kind}:{float(np.arctan2(*mount.frame[2][:2]) / DEG)!r}'
    if pole != 'given':
        return mount.kind
    return f'{mount.kind}:' + ','.join(repr(v / DEG) for v in pole_of(mount))


def pole_of(mount):
    """Azimuth and elevation of the pole of the first axis, and its roll: rad, 3 float."""
    x, _, z = np.array(mount.frame)
    azimuth, elevation = np.arctan2(z[0], z[1]), np.arctan2(z[2], np.hypot(z[0], z[1]))
    plain = Mount.free(azimuth, elevation)
    roll = np.arctan2(*(np.array(plain.frame)[:2] @ x)[::-1])
    return float(azimuth), float(elevation), float(roll)


def mount_by_pole(kind, azimuth, elevation, roll):
    """The `Mount` of a kind with this `pole_of`, rad; ValueError for an invalid pole."""
    if not np.all(np.isfinite((azimuth, elevation, roll))):
        raise ValueError(f'the pole of {KINDS[kind].words} is no number')
    if KINDS[kind].pole == 'celestial':
        return Mount.equatorial(elevation, kind)
    return Mount._with_pole(kind, azimuth, elevation, roll)


def mount_wording(mount):
    """A `Mount` in words, specific enough to distinguish it from others of its kind."""
    if mount.vertical:
        return mount.kind
    if mount.celestial:
        return f'{mount.kind}, latitude {mount.latitude / DEG:.7g}'
    rows = ', '.join(f'{value:.6g}' for value in (*mount.frame[0], *mount.frame[2]))
    return f'{mount.kind}, its x and z east, north, up {rows}'
