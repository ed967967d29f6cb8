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

"""A node for the sky seen by a mount of a server: offsets of stars from the boresight."""

from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.node import Param
from msg_tools.node_lifecycle import WorkerNode
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.sky_params import mount_of, sky_of
from pointing_model.sky.star_catalogue import satellite_target

from .star_field import StarField

#: parameters of the field, for all protocols
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


class SkyBridge(WorkerNode):
    """Publishes each exposure, NaN without a star; publishes nothing while it is inactive.

    A protocol has `make_source(field)`, which returns a `star_field.SkySource`.

    Parameters
    ----------
    name, params, hardware_id, **kwargs
        See `WorkerNode`; the parameters include `FIELD_PARAMS`.
    """

    def __init__(self, name, params, hardware_id, **kwargs):
        super().__init__(name, params, hardware_id=hardware_id, **kwargs)
        value = self.value
        self.worker = self._source = self.make_source(StarField(
            mount_of(self), *sky_of(self), value('field_deg') * DEG, value('magnitude_limit'),
            value('noise_arcsec') * ARCSEC, value('seed'), satellite_target(value('satellite'))))
        self._source.switch(False)
        self._without = 0
        self._pub = self.publisher(topics.MISS_DISTANCE)
        self.every(0.05, self._expose)

    def activated(self):
        """Start exposures."""
        self._source.switch(True)

    def deactivated(self):
        """Stop after the current exposure."""
        self._source.switch(False)

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
        """No connection, no camera, or a driver that does not know its true pointing."""
        source = self._source
        if not self.started:
            return []
        if source.why:
            return [(DiagnosticStatus.ERROR, source.why)]
        return [(DiagnosticStatus.WARN, source.note)] if source.note else []

    def details(self):
        """Number of exposures without a star, and the meaning of the stamp."""
        return [*super().details(), ('exposures without a star', str(self._without)),
                ('stamp of miss_distance', 'middle of the exposure')]
