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

"""The star camera: measures how far the brightest star of the field is from the boresight."""

import numpy as np

from msg_tools import convert, topics
from msg_tools.node import Param
from msg_tools.units import ARCSEC, wrap
from pointing_model.sky.sky_params import SKY_PARAMS, sky_of
from pointing_model.sky.star_catalogue import satellite_target

from .device_params import DEVICE_PARAMS, MountedDevice
from .mount_geometry import FORWARD, MountGeometry, bent
from .star_camera import Camera
from .wind_gusts import WindLoad

#: up to so many samples per exposure the axes move smoothly, or the samples show no more
SMOOTH = 3
#: row for readers of `/diagnostics`
STAMPS = 'stamp of miss_distance', 'middle of the exposure'
PARAMS = (
    *DEVICE_PARAMS, *SKY_PARAMS,
    Param('exposure_s', 1.0, 'length of an exposure; one follows the other [s]', 0.01, 3600.0),
    Param('smear_limit_arcsec', 60.0, 'a star that moves farther in an exposure is not measured '
          '[arcsec]', 0.1, 36000.0),
    Param('satellite', '', 'one more light in the sky: a file of two-line elements, gps-26690, or '
          'a name and a file of its orbit',
          check=satellite_target, fixed=True),
)


class StarCamera(MountedDevice):
    """Exposes whenever true angles arrive; NaN if no star was measured."""

    def __init__(self, **kwargs):
        super().__init__('camera', PARAMS, hardware_id='simulated camera', **kwargs)
        self._samples = []
        self._without = 0
        self._wind = WindLoad(self.scenario.wind, self.value('seed'))
        self._camera = None
        self._build()
        self._pub = self.publisher(topics.MISS_DISTANCE)
        self.subscribe(topics.TRUTH_JOINTS, self._on_truth)

    def _build(self):
        before = self._camera
        self._camera = Camera(self.scenario, self.value('seed'), *sky_of(self), self.start * 1e-9,
                              satellite_target(self.value('satellite')),
                              self.value('exposure_s'))
        if before is not None:
            self._camera.exposed = before.exposed
        self._geometry = MountGeometry(
            self.scenario.mount, self.start * 1e-9, self.value('seed'),
            self._camera.site.latitude)

    def parameters_changed(self, names):
        """Recompute the sky with the new atmosphere."""
        self._build()

    def _on_truth(self, message):
        stamp, angles, rates, side = convert.read_joints(message)
        length = self.value('exposure_s')
        samples = self._samples
        # a gap ends an exposure, since the mount has moved
        if samples and not 0 < stamp - samples[-1][0] <= 1e9 * length:
            samples.clear()
        samples.append((stamp, angles, side))
        if stamp - samples[0][0] >= 1e9 * length - 1:
            self._expose()
            self._samples = samples[-1:]

    def _expose(self):
        stamps, angles, sides = map(np.array, zip(*self._samples))
        begin, end = stamps[0], stamps[-1]
        middle = begin + (end - begin) // 2
        # use differences of stamps: nanoseconds since 1970 are too coarse as floats
        since = (stamps - begin).astype(float)
        at = np.array([0.0, float(middle - begin), float(end - begin)])
        turned, raised = wrap(angles[:, 0] - angles[0, 0]), angles[:, 1]
        az, el = (np.interp(at, since, moved) for moved in (turned, raised))
        if len(since) > SMOOTH:
            # an image is centred on the mean axis position
            az[1], el[1] = (np.trapezoid(moved, since) / since[-1] for moved in (turned, raised))
        az += angles[0, 0]
        moments = np.array([begin, middle, end])
        side = np.nan_to_num(sides[-1])
        frames = self._geometry.frames(
            az, el, time=moments * 1e-9,
            temperature=self.warmth(moments, self.scenario.mount.behind_air),
            approach_az=side[0], approach_el=side[1])
        if self._wind.bends:
            frames = bent(frames, self._wind.bend(
                (moments - self.start) * 1e-9, frames[:, FORWARD], self.value('exposure_s')))
        measured = self._camera.expose(moments, frames)
        stars = measured.miss if len(set(measured.hip)) == 1 else np.full((3, 2), np.nan)
        # follow the object of the field that moves least on the chip
        tracks = [stars, self._camera.expose_satellite(moments, frames)]
        smear = [np.hypot(*(track[2] - track[0])) for track in tracks]
        best = int(np.argmin(np.nan_to_num(smear, nan=np.inf)))
        miss = tracks[best][1]
        if not smear[best] <= self.value('smear_limit_arcsec') * ARCSEC:
            miss = np.full(2, np.nan)
        self._without += int(np.isnan(miss[0]))
        self._pub.publish(convert.sky_vector(int(middle), *miss))

    def details(self):
        """Number of exposures without a star, and the meaning of the stamp."""
        return [('exposures without a star', str(self._without)), STAMPS]
