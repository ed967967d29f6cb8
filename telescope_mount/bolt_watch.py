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

"""Images one after the other while the bolts of a mount are turned: what each of them tells."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.image_alignment import AT_REST, LEAST_TURN, axis_after, axis_of_arc, expected
from pointing_model.mounts import through_pole
from pointing_model.sky.places import SIDEREAL

#: of one image: the first axis did not turn, but for a track, by more than this
_TURNED = 3.0 * DEG
#: an error that is shown is so many times its sigma
_CLEAR = 5.0
#: an error that grew to this many times of what was shown: the wrong way
_DOUBLE = 2.0
THREE, ONE, COLLECTED, STOPPED = 'three', 'one', 'collected', 'stopped'


class BoltReading(NamedTuple):
    """What an image tells.

    Attributes
    ----------
    kind : str
        `THREE` (an axis by three images), `ONE` (by one, all else held), `COLLECTED` (one of the
        three), `STOPPED` (an error has doubled).
    axis : PolarAxis or None
        Of `COLLECTED` where a model is known: by this image alone.
    count : int
        Images that are solved for it.
    again : bool
        Of three: the bolts were turned before.
    moved : tuple of float or None
        Of three after a turn: azimuth and altitude minus what the last image had, rad.
    bolt : str
        Of which the error has doubled.
    before : float
        What it was, rad.
    """

    kind: str
    axis: object = None
    count: int = 1
    again: bool = False
    moved: tuple | None = None
    bolt: str = ''
    before: float = 0.0


class BoltWatch:
    """What is left to turn, image by image.

    It begins with three images at different hour angles, or with a model. Then each image tells
    what is left, until the first axis turns: three images more measure the axis anew.

    Parameters
    ----------
    latitude : float
        rad.
    refraction : float
        Of the pole that is meant, rad.
    model : PointingModel, optional
        Of the mount before the bolts are turned,
    axis : PolarAxis, optional
        and its axis.
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
            The three images do not give an axis; they are forgotten.
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
        # what a model has of the axis is no longer so
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
        """Where it would look with its readings, had no bolt been turned; the image; the sigma."""
        if self.model is None:
            if abs(wrap(image.second - self._reference.second)) > AT_REST:
                raise ValueError('the declination axis moved since the three images: leave it, or '
                                 'give a model')
            return (expected(self._reference, self.axis, image.first, self.latitude), image,
                    self._reference.sigma)
        seen = self.model.encoder_to_sky(image.first, image.second)
        place = self.model.mount.direction(*seen)
        sky = through_pole(*seen, np.cos(seen[1]) < 0.0)
        sigma = np.hypot(*self.model.sigma(*sky)) / np.sqrt(2.0)
        return place, image, float(np.nan_to_num(sigma))
