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

"""Mechanical corrections: how far to move the bolts, feet or shims of a mount to align it.

The terms of the first axis tilt it by exact rotations (`geometry`). On an equatorial mount the end
of the axis above the horizon has an azimuth and an altitude, and on a level base each of two bolts
moves one of them: MA / cos(latitude) is the turn in azimuth to first order only (57" wrong after
two rounds at 70 degrees). In the axis frame (x west, y to the meridian, z north pole) the pole is

    p = (MA sin t / t, ME sin t / t, cos t),    t = hypot(MA, ME)

In the south the end above the horizon is -p: MA > 0 needs the base turned clockwise, seen from
above, in both hemispheres; ME > 0 needs a lower axis in the north and a higher one in the south.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import DEG, wrap

#: closer to a pole of the Earth than this an azimuth bolt does not move the axis, rad
_POLAR = 1.0 * DEG
_STEP = 1e-6


@dataclass(frozen=True)
class PolarAxis:
    """Direction of the polar axis, at its end above the horizon.

    Attributes
    ----------
    azimuth, altitude : float
        Direction of the axis, rad; azimuth from north through east.
    azimuth_error, altitude_error : float
        Axis minus pole, rad: turn the base by the opposite amount. A larger azimuth is clockwise,
        seen from above.
    covariance : ndarray, shape (2, 2)
        Covariance of azimuth and altitude, rad^2.
    latitude : float
        rad.
    pole : float
        Altitude of the reference pole (true or refracted), rad.
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
    """Azimuth and altitude of the end of the axis above the horizon, from MA and ME, rad."""
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
    """Direction of the polar axis of a fitted equatorial mount.

    Parameters
    ----------
    model : PointingModel
        With MA and ME.
    refraction : float
        Height of the reference pole above the true one, rad. Fitted terms refer to the true
        pole if refraction is applied to the star places.

    Returns
    -------
    PolarAxis

    Raises
    ------
    ValueError
        Another mount, MA or ME not fitted or undetermined, or a site at a pole of the Earth.
    """
    mount = model.mount
    if not mount.celestial:
        raise ValueError(f'{mount.names.words} has no polar axis')
    tilts, covariance = _of(model, ('MA', 'ME'))
    if np.pi / 2.0 - abs(mount.latitude) < _POLAR:
        raise ValueError('within a degree of a pole of the Earth no bolt in azimuth moves the axis')
    return axis_at(_angles(tilts, mount.latitude), mount.latitude, refraction,
                   _carried(lambda v: _angles(v, mount.latitude), tilts, covariance))


def axis_at(place, latitude, refraction=0.0, covariance=None):
    """A `PolarAxis` from azimuth and altitude of its end above the horizon, rad."""
    pole = abs(latitude) + refraction
    return PolarAxis(
        float(place[0] % (2.0 * np.pi)), float(place[1]),
        float(wrap(place[0] - (np.pi if latitude < 0.0 else 0.0))), float(place[1] - pole),
        np.zeros((2, 2)) if covariance is None else covariance, latitude, pole)


def _of(model, names):
    """Values and covariance of terms; ValueError if they are not fitted or undetermined."""
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
    """Covariance propagated through a function of a few values."""
    steps = _STEP * np.eye(len(values))
    slopes = np.stack([wrap(function(values + d) - function(values - d)) / (2.0 * _STEP)
                       for d in steps], axis=-1)
    return slopes @ covariance @ slopes.T


@dataclass(frozen=True)
class Shim:
    """The shim that aligns the tube with its mount.

    Attributes
    ----------
    angle, sigma : float
        Angle of the line of sight to the left of the square direction, rad.
    thickness, thickness_sigma : float
        Thickness of the shim under one end of the base, in the unit of the base's length.
    rear : bool
        Whether it goes under the rear end, seen along the tube, of a saddle on the right of the
        tube; otherwise under the front end.
    """

    angle: float
    sigma: float
    thickness: float
    thickness_sigma: float
    rear: bool


def cone_shim(model, base):
    """The shim that removes the cone error.

    A line of sight left of square (CH > 0; on a German mount away from the saddle, which is on the
    right of the tube when that looks forward and up) is corrected by moving the rear end left.

    Parameters
    ----------
    model : PointingModel
        With the collimation term (CH, or its name on this mount).
    base : float
        Distance between the supports of the tube, any unit of length.

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
    """How high to lift the feet of a base.

    Attributes
    ----------
    azimuths : ndarray, shape (n,)
        Azimuths of the feet from the centre of their circle, rad.
    lifts : ndarray, shape (n,)
        In the unit of the radius; the highest foot is not lifted.
    sigmas : ndarray, shape (n,)
        Standard errors of the lifts relative to the centre of the circle.
    tilt : float
        Tilt of the axis, rad.
    toward : float
        Azimuth toward which it is tilted, rad.
    """

    azimuths: np.ndarray
    lifts: np.ndarray
    sigmas: np.ndarray
    tilt: float
    toward: float


def foot_lifts(model, radius, azimuths):
    """Lifts of the feet that make the azimuth axis of an alt-azimuth mount vertical.

    Parameters
    ----------
    model : PointingModel
        With AN and AW.
    radius : float
        Radius of the circle of feet, any unit of length.
    azimuths : array_like, shape (n,)
        Azimuths of three or more feet, rad.

    Returns
    -------
    Feet

    Raises
    ------
    ValueError
        Another mount, AN or AW not fitted or undetermined, fewer than three feet.
    """
    if not model.mount.vertical:
        raise ValueError(f'{model.mount.names.words} stands on bolts, not on feet: this '
                         'is of alt-azimuth mounts')
    azimuths = np.asarray(azimuths, float)
    if len(azimuths) < 3 or not radius > 0.0:
        raise ValueError('give the radius of the circle of feet, and three of them or more')
    tilts, covariance = _of(model, ('AN', 'AW'))

    def heights(values):
        # plane perpendicular to the axis: low on the side toward which it is tilted
        size = np.hypot(*values)
        north, west = np.asarray(values) * np.sinc(size / np.pi)
        return radius * (north * np.cos(azimuths) - west * np.sin(azimuths)) / np.cos(size)
    lifts = heights(tilts)
    sigmas = np.sqrt(np.maximum(np.diag(_carried(heights, tilts, covariance)), 0.0))
    return Feet(azimuths, lifts - lifts.min(), sigmas, float(np.hypot(*tilts)),
                float(np.arctan2(-tilts[1], tilts[0]) % (2.0 * np.pi)))
