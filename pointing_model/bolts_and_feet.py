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

"""The way back to the bolts: how far the parts of a mount have to be moved to stand true.

The terms of the first axis lean it by exact rotations (`geometry`). Of an equatorial mount its end
above the horizon has an azimuth and an altitude, and each of two bolts moves one of them where
the base is level: MA / cos(latitude) is the turn in azimuth to first order alone (57" wrong after
two rounds at 70 degrees). In the axis frame (x west, y to the meridian, z north pole) the pole is

    p = (MA sin t / t, ME sin t / t, cos t),    t = hypot(MA, ME)

and in the south the end above the horizon is -p: MA > 0 wants the base clockwise, seen from
above, in both hemispheres, and ME > 0 a lower axis in the north and a higher one in the south.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import DEG, wrap

#: nearer to a pole of the Earth than this no bolt in azimuth moves the axis, rad
_POLAR = 1.0 * DEG
_STEP = 1e-6


@dataclass(frozen=True)
class PolarAxis:
    """Where the polar axis points, its end above the horizon.

    Attributes
    ----------
    azimuth, altitude : float
        Of the axis, rad; azimuth from north through east.
    azimuth_error, altitude_error : float
        Axis minus pole, rad: the base has to be turned by as much the other way. A larger azimuth
        is clockwise, seen from above.
    covariance : ndarray, shape (2, 2)
        Of azimuth and altitude, rad^2.
    latitude : float
        rad.
    pole : float
        Altitude of the pole that is meant, rad.
    """

    azimuth: float
    altitude: float
    azimuth_error: float
    altitude_error: float
    covariance: np.ndarray
    latitude: float
    pole: float

    @property
    def south(self):
        """Whether the pole is the southern one."""
        return self.latitude < 0.0

    @property
    def sigmas(self):
        """Standard errors of azimuth and altitude, rad."""
        return tuple(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).tolist())

    @property
    def pole_distance(self):
        """Angle between axis and pole and its standard error, rad."""
        along = np.cos(self.altitude) * np.cos(self.pole)
        half = (np.sin(0.5 * self.altitude_error)**2
                + along * np.sin(0.5 * self.azimuth_error)**2)
        toward = np.array([self.azimuth_error * along, self.altitude_error])
        length = np.hypot(toward[0] / np.sqrt(along), toward[1])
        if not length:
            toward, length = np.array([0.0, 1.0]), 1.0
        return (float(2.0 * np.arcsin(np.sqrt(half))),
                float(np.sqrt(toward @ self.covariance @ toward) / length))


def _angles(tilts, latitude):
    """Azimuth and altitude of the end of the axis above the horizon; MA and ME, rad."""
    ma, me = tilts
    size = np.hypot(ma, me)
    along = np.sinc(size / np.pi)
    west, meridian, north = ma * along, me * along, np.cos(size)
    s, c = np.sin(latitude), np.cos(latitude)
    place = np.array([-west, c * north - s * meridian, s * north + c * meridian])
    if latitude < 0.0:
        place = -place
    return np.array([np.arctan2(place[0], place[1]), np.arctan2(place[2], np.hypot(*place[:2]))])


def polar_axis(model, refraction=0.0):
    """Where the polar axis of a fitted equatorial mount points.

    Parameters
    ----------
    model : PointingModel
        With MA and ME.
    refraction : float
        By how much the pole that is meant is above the true one, rad. The terms of a fit are
        against the true pole, where the refraction is in the places of its stars.

    Returns
    -------
    PolarAxis

    Raises
    ------
    ValueError
        Another mount, MA or ME not fitted or undetermined, or a pole of the Earth.
    """
    mount = model.mount
    if not mount.celestial:
        raise ValueError(f'a mount that is {mount.kind} has no polar axis')
    tilts, covariance = _of(model, ('MA', 'ME'))
    if np.pi / 2.0 - abs(mount.latitude) < _POLAR:
        raise ValueError('within a degree of a pole of the Earth no bolt in azimuth moves the axis')
    return axis_at(_angles(tilts, mount.latitude), mount.latitude, refraction,
                   _carried(lambda v: _angles(v, mount.latitude), tilts, covariance))


def axis_at(place, latitude, refraction=0.0, covariance=None):
    """A `PolarAxis` by where its end above the horizon is, azimuth and altitude, rad."""
    pole = abs(latitude) + refraction
    return PolarAxis(
        float(place[0] % (2.0 * np.pi)), float(place[1]),
        float(wrap(place[0] - (np.pi if latitude < 0.0 else 0.0))), float(place[1] - pole),
        np.zeros((2, 2)) if covariance is None else covariance, latitude, pole)


def _of(model, names):
    """Values and covariance of terms; ValueError where they are not known."""
    missing = [name for name in names if name not in model.terms]
    if missing:
        raise ValueError(f'{", ".join(missing)} is not among the terms of the model: fit it')
    unknown = [name for name in names if name in model.undetermined]
    if unknown:
        raise ValueError(f'{", ".join(unknown)} is undetermined by these stars: observe other '
                         'parts of the sky')
    order = list(model.terms)
    at = [order.index(name) for name in names]
    return np.array([model.terms[name] for name in names]), model.covariance[np.ix_(at, at)]


def _carried(function, values, covariance):
    """A covariance carried through a function of a few values."""
    steps = _STEP * np.eye(len(values))
    slopes = np.stack([wrap(function(values + d) - function(values - d)) / (2.0 * _STEP)
                       for d in steps], axis=-1)
    return slopes @ covariance @ slopes.T


@dataclass(frozen=True)
class Shim:
    """What squares the tube on its mount.

    Attributes
    ----------
    angle, sigma : float
        By which the line of sight is to the left of the tube's square, rad.
    thickness, thickness_sigma : float
        Under one end of the base, in the unit of its length.
    rear : bool
        Under the rear end, seen along the tube, of a saddle on the right of the tube; else under
        the front one.
    """

    angle: float
    sigma: float
    thickness: float
    thickness_sigma: float
    rear: bool


def cone_shim(model, base):
    """The shim that takes the cone error off.

    A line of sight left of the square (CH > 0, of a German mount away from the saddle, which is
    on the right of the tube that looks forward and up) comes back where the rear end is moved
    left.

    Parameters
    ----------
    model : PointingModel
        With the collimation (CH, or what the mount has for it).
    base : float
        Distance of the points that carry the tube, any unit of length.

    Returns
    -------
    Shim

    Raises
    ------
    ValueError
        No such term, or undetermined; a base that is not positive.
    """
    if not base > 0.0:
        raise ValueError(f'a base of {base:g}: give the distance of the points that carry the tube')
    (angle,), covariance = _of(model, (model.mount.names.named('CA'),))
    sigma = float(np.sqrt(covariance[0, 0]))
    return Shim(float(angle), sigma, float(abs(np.tan(angle)) * base),
                float(base * sigma / np.cos(angle)**2), bool(angle > 0.0))


@dataclass(frozen=True)
class Feet:
    """How high the feet of a base have to be lifted.

    Attributes
    ----------
    azimuths : ndarray, shape (n,)
        From the middle of their circle, rad.
    lifts : ndarray, shape (n,)
        In the unit of the radius; the highest foot stays.
    sigmas : ndarray, shape (n,)
        Of the lift against the middle of the circle.
    tilt : float
        Of the axis, rad,
    toward : float
        and the azimuth toward which it is tilted.
    """

    azimuths: np.ndarray
    lifts: np.ndarray
    sigmas: np.ndarray
    tilt: float
    toward: float


def foot_lifts(model, radius, azimuths):
    """The lifts of feet that bring the azimuth axis of an alt-azimuth mount upright.

    Parameters
    ----------
    model : PointingModel
        With AN and AW.
    radius : float
        Of the circle of the feet, any unit of length.
    azimuths : array_like, shape (n,)
        Of the feet, rad, three or more.

    Returns
    -------
    Feet

    Raises
    ------
    ValueError
        Another mount, AN or AW not fitted or undetermined, fewer than three feet.
    """
    if not model.mount.vertical:
        raise ValueError(f'a mount that is {model.mount.kind} stands on bolts, not on feet: this '
                         'is of alt-azimuth mounts')
    azimuths = np.asarray(azimuths, float)
    if len(azimuths) < 3 or not radius > 0.0:
        raise ValueError('give the radius of the circle of feet, and three of them or more')
    tilts, covariance = _of(model, ('AN', 'AW'))

    def heights(values):
        # the plane across the axis: the side toward which it is tilted is low
        size = np.hypot(*values)
        north, west = np.asarray(values) * np.sinc(size / np.pi)
        return radius * (north * np.cos(azimuths) - west * np.sin(azimuths)) / np.cos(size)
    lifts = heights(tilts)
    sigmas = np.sqrt(np.maximum(np.diag(_carried(heights, tilts, covariance)), 0.0))
    return Feet(azimuths, lifts - lifts.min(), sigmas, float(np.hypot(*tilts)),
                float(np.arctan2(-tilts[1], tilts[0]) % (2.0 * np.pi)))
