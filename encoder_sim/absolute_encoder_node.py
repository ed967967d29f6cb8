"""The absolute encoders of both axes: read their discs from the image on a linear CCD."""

import sys

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.node import MountNode, run_node

from .absolute_reading import AbsoluteEncoder
from .device_params import DEVICE_PARAMS, MAX_RATE, Decimator, parse_utc
from .scenario import load_scenario


class AbsoluteEncoders(MountNode):
    """Turns true axis angles into readings; NaN where an image could not be read."""

    def __init__(self, **kwargs):
        super().__init__('absolute_encoder', (*DEVICE_PARAMS, MAX_RATE),
                         hardware_id='simulated absolute encoder', **kwargs)
        scenario = load_scenario(self.value('scenario'))
        start = parse_utc(self.value('start_time')) * 1e-9
        self._encoders = [
            AbsoluteEncoder(getattr(scenario.absolute, axis), self.value('seed'), axis,
                            start=start)
            for axis in convert.AXES]
        self._warmth = lambda stamp: scenario.temperature(stamp * 1e-9, start)
        self._decimator = Decimator()
        self._unread = 0
        self._pub = self.publisher(topics.ABSOLUTE)
        self._frame_pub = self.publisher(topics.ABSOLUTE_FRAME)
        self.subscribe(topics.TRUTH_JOINTS, self._on_truth)

    def _on_truth(self, message):
        stamp, angles, rates = convert.read_joints(message)[:3]
        if not self._decimator.passes(stamp, self.value('max_rate_hz')):
            return
        warmth = self._warmth(stamp)
        reading = [float(encoder.read(stamp, angle, rate, warmth)[0][0])
                   for encoder, angle, rate in zip(self._encoders, angles, rates)]
        self._unread += int(np.isnan(reading).sum())
        self._pub.publish(convert.joint_state(stamp, reading, rates))
        if self._frame_pub.get_subscription_count() > 0:
            self._frame_pub.publish(self._image(stamp, angles, rates, warmth))

    def _image(self, stamp, angles, rates, warmth):
        from sensor_msgs.msg import Image
        rows = np.concatenate([np.atleast_2d(encoder.frame(stamp, angle, rate, warmth))
                               for encoder, angle, rate in zip(self._encoders, angles, rates)])
        image = Image(height=rows.shape[0], width=rows.shape[1], encoding='mono8',
                      is_bigendian=0, step=rows.shape[1], data=rows.astype(np.uint8).tobytes())
        image.header.stamp = convert.to_stamp(stamp)
        image.header.frame_id = 'absolute_encoder'
        return image

    def required(self):
        """It needs axes to sit on."""
        return {self.resolve_topic_name(topics.TRUTH_JOINTS.name)}

    def problems(self):
        """Images that could not be read."""
        if not self._unread:
            return []
        return [(DiagnosticStatus.WARN, f'{self._unread} images could not be read')]


def main(args=None):
    """Entry point of ``ros2 run telescope_mount absolute_encoder``."""
    sys.exit(run_node(AbsoluteEncoders, args))


if __name__ == '__main__':
    main()
