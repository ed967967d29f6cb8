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

"""Sample driver of a camera: exposes one image after the other. Put yours into `expose`."""

import socket
from contextlib import suppress
from math import radians

import rclpy
from geometry_msgs.msg import Vector3Stamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time


class CameraDriver(Node):

    def __init__(self):
        super().__init__('camera_driver')
        self.exposure = self.declare_parameter('exposure_s', 0.5).value
        port = self.declare_parameter('port', 7625).value
        self.hardware = socket.create_connection(('localhost', port), 30).makefile('rw')
        self.publisher = self.create_publisher(Vector3Stamped, 'camera/miss_distance', 100)
        self.create_timer(self.exposure + 0.1, self.expose)

    def expose(self):
        print('expose', self.exposure, file=self.hardware, flush=True)
        middle, right, up = map(float, self.hardware.readline().split())
        message = Vector3Stamped()
        message.header.frame_id = 'boresight_optical'  # x right, y down
        message.header.stamp = Time(nanoseconds=round(middle * 1e9)).to_msg()
        # star - boresight; nan where no star was measured: say so, do not fall silent
        message.vector.x, message.vector.y = radians(right / 3600), radians(-up / 3600)
        if rclpy.ok():  # it may be ended amid an exposure
            self.publisher.publish(message)


rclpy.init()
with suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(CameraDriver())
