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

"""Motion of the polar axis by its bolts, from images taken between the turns.

Three images at different hour angles with the second axis at rest lie on a circle about the polar
axis, wherever the tube points. They determine the axis without any zero, cone error or
declination. While the bolts are turned one image is enough: on a level base the place where the
tube would point at these readings with untouched bolts, and the place where it points, differ by a
turn about the hinge and one about the vertical: two unknown angles from two measured ones.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import ALTAZ, unit_vector

from .bolts_and_feet import axis_at

#: least separation in hour angle of two images of an arc
LEAST_TURN = 5.0 * DEG
#: largest difference of the second axis between them
AT_REST = 60.0 * ARCSEC
#: relative tolerance between the turn of an arc in the images and in the readings
_AGREES = 0.05
_STEP = 1e-6


class Image(NamedTuple):
    """A solved image.

    Attributes
    ----------
    first, second : float
        Readings of the axes, rad.
    place : ndarray, shape (3,)
        Direction that it points to: east, north, up of the observed place.
    sigma : float
        1 sigma of the place per axis, rad.
    time : float
        UTC, s.
    name : str
    """

    first: float
    second: float
    place: np.ndarray
    sigma: float
    time: float = 0.0
    name: str = ''


def turned_about(vector, axis, angle):
    """Vectors rotated about a unit vector, right-handed (Rodrigues)."""
    vector = np.asarray(vector, float)
    return (vector * np.cos(angle) + np.cross(axis, vector) * np.sin(angle)
            + np.multiply.outer(vector @ axis, axis) * (1.0 - np.cos(angle)))


def _normal(places, up):
    """Unit normal of the circle on which places lie, on the side of `up`."""
    _, _, rows = np.linalg.svd(places - places.mean(axis=0))
    normal = rows[2] if len(places) > 2 else np.cross(*rows[:2])
    return normal if normal @ up > 0.0 else -normal


def _horizon(place):
    return np.array([np.arctan2(place[0], place[1]),
                     np.arctan2(place[2], np.hypot(place[0], place[1]))])


def _tangents(place):
    return np.array(ALTAZ.tangents(*_horizon(place)))


def axis_of_arc(images, latitude, refraction=0.0):
    """Direction of the polar axis, from images between turns of the first axis alone.

    Parameters
    ----------
    images : sequence of Image
        Three or more.
    latitude : float
        rad.
    refraction : float
        Refraction at the reference pole, rad.

    Returns
    -------
    PolarAxis

    Raises
    ------
    ValueError
        Fewer than three images, a moved second axis, or readings that disagree with the images.
    """
    if len(images) < 3:
        raise ValueError(f'{len(images)} images; three at different hour angles give the axis')
    moved = np.ptp([one.second for one in images])
    if moved > AT_REST:
        raise ValueError(f'the declination axis moved by {moved / ARCSEC:.0f}" between the images; '
                         'turn the hour axis alone')
    places = np.array([one.place for one in images])
    pole = np.array([0.0, np.cos(latitude), np.sin(latitude)])
    if latitude < 0.0:
        pole = -pole
    axis = _normal(places, pole)
    _check_turn(images, axis, latitude)

    def of(shifts):
        moved = places + np.einsum('nk,nkj->nj', shifts.reshape(-1, 2), tangents)
        return _horizon(_normal(moved / np.linalg.norm(moved, axis=1)[:, None], pole))
    tangents = np.array([_tangents(one) for one in places])
    sigmas = np.repeat([one.sigma for one in images], 2)
    slopes = np.array([wrap(of(d) - of(-d)) / (2.0 * _STEP)
                       for d in _STEP * np.eye(2 * len(places))])
    return axis_at(_horizon(axis), latitude, refraction,
                   (slopes * sigmas[:, None]**2).T @ slopes)


def _check_turn(images, axis, latitude):
    """Refuse readings whose turn disagrees with the images."""
    first, last = images[0], images[-1]
    a, b = (one.place - (one.place @ axis) * axis for one in (first, last))
    seen = -np.arctan2(np.cross(a, b) @ axis, a @ b) * (1.0 if latitude >= 0.0 else -1.0)
    read = wrap(last.first - first.first)
    if abs(seen + read) < _AGREES * abs(read):
        raise ValueError('the hour angle reads with the wrong sign: it grows as the images go '
                         'east. No bolt is named')
    if abs(wrap(seen - read)) > _AGREES * abs(read):
        raise ValueError(f'the hour axis turned by {read / DEG:.2f} deg by its readings and by '
                         f'{seen / DEG:.2f} deg by the images: look at clock, site and readings')


def expected(reference, axis, first, latitude):
    """Where the tube points when the first axis reads `first`, if nothing else has moved.

    Parameters
    ----------
    reference : Image
    axis : PolarAxis
    first : float
        rad.
    latitude : float
        rad.

    Returns
    -------
    ndarray, shape (3,)
    """
    toward = unit_vector(axis.azimuth, axis.altitude)
    # the hour angle grows clockwise, seen from above the northern pole
    sign = -1.0 if latitude >= 0.0 else 1.0
    return turned_about(reference.place, toward, sign * wrap(first - reference.first))


def _turns(before, after, azimuth):
    """Turn in azimuth and in altitude of the axis that takes one place to the other, rad."""
    hinge = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
    upward = np.cross(hinge, before)[2]
    size = np.hypot(before[2], upward)
    base = np.arctan2(upward, before[2])
    away = np.arccos(np.clip(after[2] / size, -1.0, 1.0))
    lift = min(wrap(base + away), wrap(base - away), key=abs)
    there = turned_about(before, hinge, lift)
    return np.array([wrap(np.arctan2(after[0], after[1]) - np.arctan2(there[0], there[1])), lift])


def axis_after(axis, before, image, sigma=0.0):
    """Direction of the axis after its bolts were turned, from one image.

    Parameters
    ----------
    axis : PolarAxis
        The axis before the turn.
    before : ndarray, shape (3,)
        Where the tube would point at the readings of the image with untouched bolts.
    image : Image
    sigma : float
        1 sigma of `before` per axis, rad.

    Returns
    -------
    PolarAxis
    """
    turns = _turns(before, image.place, axis.azimuth)
    tangents = _tangents(image.place)
    slopes = np.array([wrap(_turns(before, image.place + _STEP * t, axis.azimuth)
                            - _turns(before, image.place - _STEP * t, axis.azimuth)) / (2.0 * _STEP)
                       for t in tangents])
    covariance = axis.covariance + (image.sigma**2 + sigma**2) * slopes.T @ slopes
    return axis_at((axis.azimuth + turns[0], axis.altitude + turns[1]), axis.latitude,
                   axis.pole - abs(axis.latitude), covariance)
