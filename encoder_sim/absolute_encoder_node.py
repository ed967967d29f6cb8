"""The absolute encoders of both axes: read their discs from the image on a linear CCD.

The effort of a reading is its quality: 0 exact, 1 corrected, 2 rejected; a rejected one is NaN.
"""

import array
import math
import sys

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.node import MountNode, Param, run_node

from .absolute import REJECTED, AbsoluteEncoder, read_frames
from .device_params import DEVICE_PARAMS, MAX_RATE, Decimator, parse_utc
from .scenario_file import load_scenario

PARAMS = (
    *DEVICE_PARAMS, MAX_RATE,
    Param('max_batch', 32, 'most samples taken at once when they come faster than they are read',
          1, 256),
    Param('frame_rate_hz', 10.0, 'most images a second of simulated time, made only while somebody '
          'subscribes; 0: one for every reading [Hz]', 0.0, 2000.0),
)
_BOTH = np.arange(2)
_QUALITIES = ('exact', 'corrected', 'rejected')


class AbsoluteEncoders(MountNode):
    """Turns true axis angles into readings; NaN where an image could not be read."""

    def __init__(self, **kwargs):
        super().__init__('absolute_encoder', PARAMS, hardware_id='simulated absolute encoder',
                         **kwargs)
        scenario = load_scenario(self.value('scenario'))
        start = parse_utc(self.value('start_time')) * 1e-9
        self._encoders = [
            AbsoluteEncoder(getattr(scenario.absolute, axis), self.value('seed'), axis,
                            start=start)
            for axis in convert.AXES]
        self._warmth = lambda stamps: scenario.temperature(stamps * 1e-9, start)
        self._decimator, self._frame_decimator = Decimator(), Decimator()
        self._counts = np.zeros((2, 3), dtype=np.int64)  # of each axis and quality
        self._pub = self.publisher(topics.ABSOLUTE)
        self._frame_pub = self.publisher(topics.ABSOLUTE_FRAME)
        self._truth = self.subscribe(topics.TRUTH_JOINTS, self._on_truth)
        self._truth_counter = self._subscriptions_of[self._truth.topic_name][-1][1]

    def _on_truth(self, message):
        samples = []
        rate = self.value('max_rate_hz')
        for truth in [message, *self._waiting()]:
            try:
                stamp, angles, rates = convert.read_joints(truth)[:3]
                if not all(map(math.isfinite, angles)):
                    raise ValueError('a true angle is not finite')
            except ValueError as err:
                self.reject(topics.TRUTH_JOINTS.name, str(err))
                continue
            if self._decimator.passes(stamp, rate):
                samples.append((stamp, angles, rates))
        if samples:
            self._read(samples)

    def _waiting(self):
        """The messages behind the one that the executor brought: it brings one a turn."""
        out = []
        most = self.value('max_batch') - 1
        with self._truth.handle:
            while len(out) < most:
                taken = self._truth.handle.take_message(self._truth.msg_type, False)
                if taken is None:
                    break
                self._truth_counter.received(taken[1])
                out.append(taken[0])
        return out

    def _read(self, samples):
        stamps = np.array([sample[0] for sample in samples], dtype=np.int64)
        angles = np.array([sample[1] for sample in samples])
        rates = np.array([sample[2] for sample in samples])
        known = np.where(np.isfinite(rates), rates, 0.0)
        warmth = self._warmth(stamps)
        frames = [encoder.frames(stamps, angles[:, axis], known[:, axis], warmth)
                  for axis, encoder in enumerate(self._encoders)]
        readings = read_frames(self._encoders, frames)
        np.add.at(self._counts, (_BOTH, readings.quality), 1)
        for (stamp, _, rate), angle, quality in zip(
                samples, readings.angle.tolist(), readings.quality.tolist()):
            self._pub.publish(convert.joint_state(stamp, angle, rate, quality))
        if self._frame_pub.get_subscription_count() > 0:
            rate = self.value('frame_rate_hz')
            for i, sample in enumerate(samples):
                if self._frame_decimator.passes(sample[0], rate):
                    self._frame_pub.publish(
                        _image(sample[0], np.concatenate([axis[:, i] for axis in frames])))

    def required(self):
        """It needs axes to sit on."""
        return {self.resolve_topic_name(topics.TRUTH_JOINTS.name)}

    def problems(self):
        """Images that could not be read."""
        rejected = int(self._counts[:, REJECTED].sum())
        if not rejected:
            return []
        return [(DiagnosticStatus.WARN, f'{rejected} images could not be read')]

    def details(self):
        """How many readings were of which quality."""
        return [(f'{axis} {name}', str(count))
                for axis, counts in zip(convert.AXES, self._counts)
                for name, count in zip(_QUALITIES, counts)]


def _image(stamp, rows):
    """A mono8 image, a row per reading head: those of azimuth, then of elevation."""
    from sensor_msgs.msg import Image
    image = Image(height=rows.shape[0], width=rows.shape[1], encoding='mono8', is_bigendian=0,
                  step=rows.shape[1], data=array.array('B', rows.tobytes()))
    image.header.stamp = convert.to_stamp(stamp)
    image.header.frame_id = 'absolute_encoder'
    return image


def main(args=None):
    """Entry point of ``ros2 run telescope_mount absolute_encoder``."""
    sys.exit(run_node(AbsoluteEncoders, args))


if __name__ == '__main__':
    main()
