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

"""The incremental encoders of both axes: count from their reference marks, which drift."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.homing import homing_to_cloud
from msg_tools.power_on import PowerOn, power_on_message, since
from msg_tools.units import ARCSEC

from .device_params import DEVICE_PARAMS, MAX_RATE, Decimator, MountedDevice
from .drives import ShaftCouplings
from .incremental import IncrementalEncoder

PARAMS = (*DEVICE_PARAMS, MAX_RATE)


class IncrementalEncoders(MountedDevice):
    """Converts true axis angles to counts; NaN until the reference mark has been passed."""

    def __init__(self, **kwargs):
        super().__init__('incremental_encoder', PARAMS,
                         hardware_id='simulated incremental encoder', **kwargs)
        self._stamp, self._samples = self.start, []
        self._encoders = self.encoders(IncrementalEncoder, self.scenario.incremental)
        self._couplings = ShaftCouplings(self.scenario.coupling)
        self._decimator = Decimator()
        self._homed = False
        self._pub = self.publisher(topics.INCREMENTAL)
        self._power_on_pub = self.publisher(topics.INCREMENTAL_POWER_ON)
        self._homing_pub = self.publisher(topics.HOMING)
        self._zero_pub = self.publisher(topics.TRUTH_ZERO)
        self._homing_published = None
        self._power_on = self._counts = None  # from the first sample of a power-on on
        self._publish_homing()
        self.subscribe(topics.TRUTH_JOINTS, self._on_truth, self._work)
        self.serve('power_cycle', self._power_cycle, once=True)

    def _on_truth(self, message):
        stamp, angles, rates = convert.read_joints(message)[:3]
        self._samples.append((stamp, self._couplings.turn(angles), rates))

    def _work(self):
        """Count the samples that have arrived, whether they are published or not."""
        samples, self._samples = self._samples, []
        if not samples:
            return
        stamps, angles, rates = map(np.array, zip(*samples))
        # process samples one by one if the state of the marks may change, to report it in time
        calm = len(samples) > 1 and all(
            encoder.only_counts(stamps, angles[:, axis])
            for axis, encoder in enumerate(self._encoders))
        step = len(samples) if calm else 1
        for i in range(0, len(samples), step):
            part = slice(i, i + step)
            self._count(stamps[part], angles[part], rates[part])

    def _count(self, stamps, angles, rates):
        self._stamp = int(stamps[-1])
        warmth = self.warmth(stamps)
        reading = np.stack([encoder.feed(stamps, angles[:, axis], rates[:, axis], warmth)
                            for axis, encoder in enumerate(self._encoders)], axis=1)
        self._note_power_on(self._stamp)
        homed = bool(np.isfinite(reading[-1]).all())
        if homed and not self._homed:
            self._zero_pub.publish(convert.joint_state(
                self._stamp, [encoder.zero for encoder in self._encoders], names=self.names))
        self._homed = homed
        self._publish_homing()
        rate = self.value('max_rate_hz')
        chosen = [i for i, stamp in enumerate(stamps.tolist())
                if self._decimator.passes(stamp, rate)]
        if not chosen:
            return
        rates = np.stack([encoder.rate(stamps[chosen], angles[chosen, axis], rates[chosen, axis],
                                       warmth[chosen])
                          for axis, encoder in enumerate(self._encoders)], axis=1)
        for stamp, angle, rate in zip(
                stamps[chosen].tolist(), reading[chosen].tolist(), rates.tolist()):
            self._pub.publish(convert.joint_state(
                stamp, angle, rate, names=self.names))

    def _note_power_on(self, stamp):
        counts = [encoder.power_on for encoder in self._encoders]
        if counts != self._counts:
            self._counts, self._power_on = counts, PowerOn(max(counts), since(stamp))
            self._power_on_pub.publish(power_on_message(self._power_on, stamp))

    def _publish_homing(self):
        """Publish the state of the marks, if a mark or the power has changed it."""
        states = [encoder.homing for encoder in self._encoders]
        known = [(s.homed, s.missed_marks, encoder.miscounted, self._power_on)
                 for s, encoder in zip(states, self._encoders)]
        now = [*known, *((s.passages, s.power_on) for s in states)]
        if now != self._homing_published:
            news = self._homing_published is None or known != self._homing_published[:len(known)]
            self._homing_published = now
            started = self._power_on.started if self._power_on else np.nan
            self._homing_pub.publish(homing_to_cloud(
                [s._replace(started=started) for s in states], self._stamp))
            if news and self._power_on is not None:
                self.announce()  # a log without that topic only has the diagnostics

    def _power_cycle(self):
        self._work()  # earlier samples belong to the previous power-on
        for encoder in self._encoders:
            encoder.power_cycle()
        self._homed, self._power_on = False, None
        self._publish_homing()
        return True, f'power-on {self._encoders[0].power_on}; home before measuring'

    def problems(self):
        """Axes that are not homed, or a counter contradicted by the mark."""
        found = []
        for axis, encoder in zip(self.words, self._encoders):
            homing = encoder.homing
            if not homing.homed and homing.missed_marks:
                found.append((DiagnosticStatus.ERROR, f'{axis}: reference mark missed, pulses '
                              f'too short: {homing.missed_marks}; pass it slower'))
            if encoder.miscounted:
                found.append((DiagnosticStatus.WARN, f'{axis}: {homing.mark_error:+.0f} counts '
                              'off at the reference mark: lost counts, a mark that moved, or a '
                              'false index pulse'))
        if not self._homed:
            found.append((DiagnosticStatus.WARN, 'no zero since power-on: call home'))
        return found

    def details(self):
        """Resolution, power-ons, and homing of each axis."""
        rows = [('power-on', str(self._encoders[0].power_on)),
                ('resolution [arcsec]', f'{self._encoders[0].count_angle / ARCSEC:.4f}'),
                ('supply [V]', ', '.join(f'{e.supply:.3f}' for e in self._encoders))]
        for axis, encoder in zip(self.words, self._encoders):
            homing, width = encoder.homing, encoder.params.pulse_width / ARCSEC
            rows += [(f'{axis} homed', str(homing.homed)),
                     (f'{axis} mark met from', homing.side),
                     (f'{axis} mark width [arcsec]', f'{width:.2f}'),
                     (f'{axis} missed marks', str(homing.missed_marks)),
                     (f'{axis} mark error [counts]', f'{homing.mark_error:.0f}')]
        return rows
