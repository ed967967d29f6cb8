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

"""The sky that a mount of an INDI server sees: where a star lies from the boresight.

By the plate solves of any camera of the server; or, without one, by what a simulator tells of
where it truly looks. What a driver of a real mount reports is what it believes, and no camera.
"""

from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.node import Param
from msg_tools.node_lifecycle import AUTOSTART, WorkerNode
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.sky_params import KIND_OF_MOUNT, SKY_PARAMS, mount_of, sky_of
from pointing_model.sky.star_catalogue import satellite_target

from .indi_sources import SERVER_PARAMS, SolvedSky, TrueSky
from .star_field import StarField

#: of what is looked at, whoever gives it
FIELD_PARAMS = (
    Param('field_deg', 0.33, 'radius of the field [deg]', 0.01, 5.0, fixed=True),
    Param('magnitude_limit', 8.0, 'faintest star, Hipparcos magnitude', -2.0, 12.0, fixed=True),
    Param('noise_arcsec', 0.3, 'of a simulator, noise of each axis [arcsec]', 0.0, 60.0,
          fixed=True),
    Param('seed', 1, 'of the noise', 0, 2**31 - 1, fixed=True),
    Param('satellite', '', 'one more light in the sky: a name and a file of its orbit',
          check=satellite_target, fixed=True),
    Param('rate_hz', 2.0, 'of a simulator, exposures a second at most [Hz]', 0.1, 20.0,
          fixed=True),
)
PARAMS = (
    AUTOSTART, *SERVER_PARAMS, *SKY_PARAMS, KIND_OF_MOUNT,
    Param('camera', '', 'name of the camera on the server whose images are solved; empty: the '
          'position of a simulator', fixed=True),
    Param('exposure_s', 1.0, 'of the camera [s]', 1e-3, 600.0, fixed=True),
    Param('solver', '', 'solve-field or astap, or the path of one; empty: the first that is '
          'installed', fixed=True),
    Param('solve_timeout_s', 20.0, 'for one image [s]', 1.0, 600.0, fixed=True),
    Param('least_scale_arcsec', 0.0, 'least scale of the images, arcsec a pixel; 0: not known '
          '[arcsec]', 0.0, 3600.0, fixed=True),
    Param('greatest_scale_arcsec', 0.0, 'greatest scale of the images; 0: not known [arcsec]',
          0.0, 3600.0, fixed=True),
    *FIELD_PARAMS,
)


class IndiSky(WorkerNode):
    """Publishes each exposure; NaN says that no star was measured. None while it is inactive."""

    def __init__(self, name='indi_sky', params=PARAMS, hardware_id='what an INDI mount sees',
                 **kwargs):
        super().__init__(name, params, hardware_id=hardware_id, **kwargs)
        value = self.value
        self.worker = self._source = self.make_source(StarField(
            mount_of(self), *sky_of(self), value('field_deg') * DEG, value('magnitude_limit'),
            value('noise_arcsec') * ARCSEC, value('seed'), satellite_target(value('satellite'))))
        self._source.switch(False)
        self._without = 0
        self._pub = self.publisher(topics.MISS_DISTANCE)
        self.every(0.05, self._expose)

    def make_source(self, field):
        """That of the parameters, a `indi_sources.Source`."""
        value = self.value
        where = value('host'), value('port'), field
        if not value('camera'):
            return TrueSky(*where, value('device'), value('axes'), value('rate_hz'))
        self.subscribe(topics.INCREMENTAL, self._on_reading)
        return SolvedSky(*where, value('camera'), self._solver(), value('exposure_s'))

    def activated(self):
        """Begin with exposures."""
        self._source.switch(True)

    def deactivated(self):
        """The exposure under way is the last one."""
        self._source.switch(False)

    def _solver(self):
        from pointing_model.runs.plate_solves.solvers import find_solver
        scale = self.value('least_scale_arcsec'), self.value('greatest_scale_arcsec')
        return find_solver(self.value('solver') or None, self.value('solve_timeout_s'),
                           scale if all(scale) else None)

    def check_together(self, values):
        """Both ends of the scale, the lower one first."""
        low, high = (values.get(f'{end}_scale_arcsec', 0.0) for end in ('least', 'greatest'))
        if bool(low) != bool(high) or low > high:
            raise ValueError(f'scale of the images from {low:g} to {high:g} arcsec a pixel: give '
                             'both, the least first')

    def _on_reading(self, message):
        self._source.take_axes(convert.read_joints(message)[1][1])

    def _expose(self):
        source = self._source
        if not self.active:
            return
        while source.exposures:
            stamp, miss = source.exposures.popleft()
            self._without += int(miss[0] != miss[0])
            self._pub.publish(convert.sky_vector(stamp, *miss))
        self.log_change(source.why or source.note, 'exposures come')

    def problems(self):
        """No connection, no camera, or a driver that does not know where it looks."""
        source = self._source
        if not self.started:
            return []
        if source.why:
            return [(DiagnosticStatus.ERROR, source.why)]
        return [(DiagnosticStatus.WARN, source.note)] if source.note else []

    def details(self):
        """Exposures without a star, what their time is."""
        return [*super().details(), ('exposures without a star', str(self._without)),
                ('stamp of miss_distance', 'middle of the exposure')]
