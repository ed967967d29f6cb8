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

"""Evaluates images taken one after the other while the bolts of a mount are turned."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.image_alignment import AT_REST, LEAST_TURN, axis_after, axis_of_arc, expected
from pointing_model.mounts import through_pole
from pointing_model.sky.places import SIDEREAL

#: largest turn of the first axis, apart from tracking, that still counts as the same position
_TURNED = 3.0 * DEG
#: an error is significant above this many sigma
_CLEAR = 5.0
#: growth of an error, relative to its former value, that shows a turn in the wrong direction
_DOUBLE = 2.0
THREE, ONE, COLLECTED, STOPPED = 'three', 'one', 'collected', 'stopped'


class BoltReading(NamedTuple):
    """Result of an image.

    Attributes
    ----------
    kind : str
        `THREE` (axis from three images), `ONE` (from one image, other parts unmoved),
        `COLLECTED` (one of the three), `STOPPED` (an error has doubled).
    axis : PolarAxis or None
        For `COLLECTED` only with a model: from this image alone.
    count : int
        Number of images solved for it.
    again : bool
        For `THREE`: the bolts were turned before.
    moved : tuple of float or None
        For `THREE` after a turn: change in azimuth and altitude since the last image, rad.
    bolt : str
        Bolt whose error has doubled.
    before : float
        Its former error, rad.
    """

    kind: str
    axis: object = None
    count: int = 1
    again: bool = False
    moved: tuple | None = None
    bolt: str = ''
    before: float = 0.0


class BoltWatch:
    """Remaining corrections, image by image.

    It starts with three images at different hour angles, or with a model. Then each image gives the
    remaining error, until the first axis turns: three more images then measure the axis again.

    Parameters
    ----------
    latitude : float
        rad.
    refraction : float
        Refraction at the reference pole, rad.
    model : PointingModel, optional
        Model of the mount before the bolts are turned.
    axis : PolarAxis, optional
        Axis of this model.
    """

    def __init__(self, latitude, refraction=0.0, model=None, axis=None):
        self.latitude, self.refraction = latitude, refraction
        self.model, self.axis = model, axis
        self._reference, self._arc, self._last, self._now = None, [], None, axis
        self._turning = axis is not None
        self._turned = False

    def add(self, image):
        """Take an image.

        Parameters
        ----------
        image : pointing_model.image_alignment.Image

        Returns
        -------
        BoltReading

        Raises
        ------
        ValueError
            The three images do not give an axis; they are discarded.
        """
        last, self._last = self._last, image
        if self._turning and last is not None and self._axis_turned(last, image):
            self._turning, self._arc = False, []
        if self._turning:
            return self._one(image)
        self._arc = [one for one in self._arc
                     if abs(wrap(one.first - image.first)) > LEAST_TURN] + [image]
        if len(self._arc) < 3:
            known = self.model and axis_after(self.axis, *self._given(image))
            return BoltReading(COLLECTED, known, len(self._arc))
        arc, self._arc = self._arc, []
        found = axis_of_arc(arc, self.latitude, self.refraction)
        moved = self._turned and (wrap(found.azimuth - self._now.azimuth),
                                  found.altitude - self._now.altitude)
        reading = BoltReading(THREE, found, len(arc), self._turned, moved or None)
        # the axis in the model is out of date
        self.model, self.axis, self._reference, self._now = None, found, arc[-1], found
        self._turning = True
        return reading

    def _axis_turned(self, last, image):
        turned = wrap(image.first - last.first)
        track = min(max(SIDEREAL * (image.time - last.time), 0.0), np.pi)
        return min(abs(turned), abs(wrap(turned - track))) > _TURNED

    def _one(self, image):
        self._now = now = axis_after(self.axis, *self._given(image))
        self._turned = True
        for bolt, one, was, error in zip(
                ('azimuth', 'altitude'), (now.azimuth_error, now.altitude_error),
                (self.axis.azimuth_error, self.axis.altitude_error), now.sigmas):
            if abs(was) > _CLEAR * error and one * was > 0.0 \
                    and abs(one) > _DOUBLE * abs(was) - 2.0 * error:
                return BoltReading(STOPPED, now, bolt=bolt, before=was)
        return BoltReading(ONE, now)

    def _given(self, image):
        """Expected direction at these readings with untouched bolts; the image; its sigma."""
        if self.model is None:
            if abs(wrap(image.second - self._reference.second)) > AT_REST:
                raise ValueError('the declination axis moved since the three images: do not '
                                 'move it, or give a model')
            return (expected(self._reference, self.axis, image.first, self.latitude), image,
                    self._reference.sigma)
        seen = self.model.encoder_to_sky(image.first, image.second)
        place = self.model.mount.direction(*seen)
        sky = through_pole(*seen, np.cos(seen[1]) < 0.0)
        sigma = np.hypot(*self.model.sigma(*sky)) / np.sqrt(2.0)
        return place, image, float(np.nan_to_num(sigma))
