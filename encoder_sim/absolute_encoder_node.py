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

"""The absolute encoders of both axes: images of their discs on a linear CCD, and the readings.

The effort of a reading is its quality: 0 exact, 1 corrected, 2 rejected; a rejected one is NaN.
"""

import dataclasses
import math

import numpy as np

from encoder_reading.angle_output import AngleOutput, Batch
from encoder_reading.frame_messages import frame_message
from msg_tools import convert, topics
from msg_tools.node import Param
from msg_tools.power_on import PowerOn, power_on_message, since

from .absolute import AbsoluteEncoder
from .device_params import DEVICE_PARAMS, MAX_RATE, Decimator, MountedDevice

PARAMS = (
    *DEVICE_PARAMS, MAX_RATE,
    Param('publishes', 'angles', 'angles, which it reads in its own process, and images on demand; '
          'or frames: every image, reliable, and no angles, for a frame_reader',
          choices=('angles', 'frames'), fixed=True),
    Param('max_batch', 32, 'most samples taken at once when they come faster than they are read',
          1, 256),
    Param('frame_rate_hz', 10.0, 'most images a second of simulated time, made only while somebody '
          'subscribes; 0: one for every reading [Hz]', 0.0, 2000.0),
)
#: with this quality of service no image is lost on the way to its reader
EVERY_FRAME = dataclasses.replace(topics.ABSOLUTE_FRAME, quality=topics.DEEP)


class AbsoluteEncoders(MountedDevice):
    """Converts true axis angles to readings; NaN if an image could not be read."""

    def __init__(self, **kwargs):
        super().__init__('absolute_encoder', PARAMS, hardware_id='simulated absolute encoder',
                         **kwargs)
        self._encoders = self.encoders(
            AbsoluteEncoder, self.scenario.absolute,
            lowest=convert.LOWEST_READING.get(self.scenario.mount.at().kind))
        self._decimator, self._frame_decimator = Decimator(), Decimator()
        self._output = None
        if self.value('publishes') == 'angles':
            self._output = AngleOutput(self, [encoder.reader for encoder in self._encoders])
        self._frame_pub = self.publisher(topics.ABSOLUTE_FRAME if self._output else EVERY_FRAME)
        self._batch = Batch(self._work, lambda: self.value('max_batch'))
        self._power_on_pub = self.publisher(topics.ABSOLUTE_POWER_ON)
        self._power_on = None  # from the first sample of a power-on on
        self.subscribe(topics.TRUTH_JOINTS, self._on_truth, self._batch.finish)
        self.serve('absolute/power_cycle', self._power_cycle, once=True)

    def _on_truth(self, message):
        stamp, angles, rates = convert.read_joints(message)[:3]
        if not all(map(math.isfinite, angles)):
            raise ValueError('a true angle is not finite')
        if self._decimator.passes(stamp, self.value('max_rate_hz')):
            self._batch.add((stamp, angles, rates))

    def _work(self, samples):
        stamps, angles, rates = zip(*samples)
        angles = np.array(angles)
        known = np.where(np.isfinite(rates), rates, 0.0)
        when = np.array(stamps, dtype=np.int64)
        warmth = self.warmth(when)
        power_ons = self._note_power_ons(when)
        frames = [encoder.frames(when, angles[:, axis], known[:, axis], warmth)
                  for axis, encoder in enumerate(self._encoders)]
        rate = 0.0
        if self._output:
            self._output.read(stamps, frames, power_ons)
            rate = self.value('frame_rate_hz')
        if self._frame_pub.get_subscription_count() > 0:
            for i, stamp in enumerate(stamps):
                if self._frame_decimator.passes(stamp, rate):
                    self._frame_pub.publish(
                        frame_message(stamp, [part[:, i] for part in frames]))

    def _note_power_ons(self, stamps):
        """The `PowerOn` of each reading; publishes new ones."""
        numbers = np.max([encoder.power_ons(stamps) for encoder in self._encoders], axis=0)
        out = []
        for stamp, number in zip(stamps.tolist(), numbers.tolist()):
            if self._power_on is None or self._power_on.number != number:
                self._power_on = PowerOn(number, since(stamp))
                self._power_on_pub.publish(power_on_message(self._power_on, stamp))
            out.append(self._power_on)
        return out

    def _power_cycle(self):
        self._batch.finish()  # earlier samples belong to the previous power-on
        for encoder in self._encoders:
            encoder.power_cycle()
        return True, f'absolute encoder: power-on {self._encoders[0].power_on}'

    def required(self):
        """Requires the mount, and a reader of frames unless it reads them itself."""
        other = set() if self._output else {self._frame_pub.topic_name}
        return super().required() | other
