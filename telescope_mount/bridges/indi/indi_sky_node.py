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

"""Offsets of stars from the boresight, for a mount of an INDI server.

Measured by plate solves of a camera of the server, or without one from the true pointing that a
simulator reports. A driver of a real mount reports only its estimate.
"""

from msg_tools import convert, topics
from msg_tools.node import Param
from msg_tools.node_lifecycle import AUTOSTART
from pointing_model.sky.sky_params import KIND_OF_MOUNT, SKY_PARAMS

from ..sky_bridge import FIELD_PARAMS, SkyBridge
from .indi_sources import SERVER_PARAMS, SolvedSky, TrueSky

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


class IndiSky(SkyBridge):
    """`SkyBridge` to an INDI server."""

    def __init__(self, **kwargs):
        super().__init__('indi_sky', PARAMS, 'what an INDI mount sees', **kwargs)

    def make_source(self, field):
        """The source for the parameters."""
        value = self.value
        where = value('host'), value('port'), field
        if not value('camera'):
            return TrueSky(*where, value('device'), value('axes'), value('rate_hz'))
        self.subscribe(topics.INCREMENTAL, self._on_reading)
        return SolvedSky(*where, value('camera'), self._solver(), value('exposure_s'))

    def _solver(self):
        from pointing_model.runs.plate_solves.solvers import find_solver
        scale = self.value('least_scale_arcsec'), self.value('greatest_scale_arcsec')
        return find_solver(self.value('solver') or None, self.value('solve_timeout_s'),
                           scale if all(scale) else None)

    def check_together(self, values):
        """Both limits of the scale are needed, the lower one first."""
        low, high = (values.get(f'{end}_scale_arcsec', 0.0) for end in ('least', 'greatest'))
        if bool(low) != bool(high) or low > high:
            raise ValueError(f'scale of the images from {low:g} to {high:g} arcsec a pixel: give '
                             'both, the least first')

    def _on_reading(self, message):
        self._source.take_axes(convert.read_joints(message)[1][1])
