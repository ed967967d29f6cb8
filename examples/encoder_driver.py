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

"""Sample driver of the axis encoders. Put your hardware into `read`."""

import socket
from contextlib import suppress
from math import radians

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import JointState


class EncoderDriver(Node):

    def __init__(self):
        super().__init__('encoder_driver')
        self.axes = self.declare_parameter('axes', ['azimuth', 'elevation']).value
        port = self.declare_parameter('port', 7625).value
        self.hardware = socket.create_connection(('localhost', port), 30).makefile('rw')
        self.publisher = self.create_publisher(JointState, 'incremental/joint_states', 100)
        self.create_timer(0.05, self.read)

    def read(self):
        print('axes', file=self.hardware, flush=True)
        time, *numbers = map(float, self.hardware.readline().split())
        message = JointState(name=self.axes)
        message.header.frame_id = 'mount_enu'
        message.header.stamp = Time(nanoseconds=round(time * 1e9)).to_msg()  # when it was read
        message.position = [radians(v) for v in numbers[:2]]  # nan until it is homed
        message.velocity = [radians(v) for v in numbers[2:]]
        self.publisher.publish(message)


rclpy.init()
with suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(EncoderDriver())
