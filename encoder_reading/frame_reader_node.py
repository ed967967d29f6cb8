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

"""Reads the absolute encoders of both axes from the images of their CCDs, simulated or real.

The effort of a reading is its quality: 0 exact, 1 corrected, 2 rejected; a rejected one is NaN.
Velocities are differences of readings within a second (`angle_output.LONGEST_GAP`).
"""

from dataclasses import fields

import numpy as np

from msg_tools import convert, topics
from msg_tools.node import MountNode, Param
from msg_tools.power_on import PowerOns

from .angle_output import AngleOutput, Batch
from .axis_reader import AxisReader
from .design import UNITS, Design, disc_of
from .frame_messages import read_frame


def _param(axis, item):
    """Parameter of an axis for a field of `Design`, in the unit of a data sheet."""
    rules, value = item.metadata, item.default
    unit, low_high = rules.get('unit', ''), rules.get('range', (None, None))
    return Param(
        f'{axis}.{item.name}' + (f'_{unit}' if unit else ''),
        value / UNITS[unit] if isinstance(value, float) else value,
        f'{axis} encoder: {rules["doc"]}' + (f' [{unit}]' if unit else ''), *low_high,
        choices=rules.get('choice', ()), check=disc_of if item.name == 'code' else None,
        fixed=True)


#: parameters of each axis, with the corresponding fields of `Design`
DESIGN_PARAMS = {axis: [(item, _param(axis, item)) for item in fields(Design)]
                 for axis in convert.AXES}
PARAMS = (
    Param('mount', 'altaz', 'kind of the mount, which names the joints; the parameters '
          'azimuth.* are of its first axis, elevation.* of its second',
          choices=tuple(convert.JOINTS), fixed=True),
    *(param for axis in convert.AXES for _, param in DESIGN_PARAMS[axis]),
    Param('max_batch', 32, 'most images read at once when they come faster than they are read',
          1, 256),
)


def axes_of(values):
    """The readers of both axes.

    Parameters
    ----------
    values : dict
        Values of all parameters.

    Raises
    ------
    ValueError
        A design is inconsistent or cannot be read; the message names the axis.
    """
    out = []
    lowest = convert.LOWEST_READING.get(values['mount'])
    for name, (axis, params) in zip(convert.JOINTS[values['mount']], DESIGN_PARAMS.items()):
        drawing = {item.name: values[param.name] * UNITS[item.metadata['unit']]
                   if item.type is float else values[param.name] for item, param in params}
        try:
            out.append(AxisReader(Design(**drawing), name, lowest))
        except ValueError as err:
            raise ValueError(f'{axis} encoder: {err}') from None
    return out


class FrameReader(MountNode):
    """Converts images to readings; NaN if an image could not be read."""

    def __init__(self, **kwargs):
        super().__init__('frame_reader', PARAMS, hardware_id='absolute encoder, its images',
                         **kwargs)
        self._axes = axes_of({param.name: self.value(param.name) for param in PARAMS})
        self._output = AngleOutput(self, self._axes)
        self._batch = Batch(self._read, lambda: self.value('max_batch'))
        self._power_ons = PowerOns()
        self.subscribe(topics.ABSOLUTE_POWER_ON, self._power_ons.take)
        self.subscribe(topics.ABSOLUTE_FRAME, self._on_frame, self._batch.finish)

    def check_together(self, values):
        """Check that both designs can be read."""
        axes_of(values)

    def _on_frame(self, message):
        self._batch.add((*read_frame(message, self._axes), self._power_ons.of(message.header)))

    def _read(self, images):
        stamps, frames, power_ons = zip(*images)
        self._output.read(stamps, [np.stack(axis, axis=1) for axis in zip(*frames)], power_ons)

    def required(self):
        """Requires images."""
        return {self.resolve_topic_name(topics.ABSOLUTE_FRAME.name)}
