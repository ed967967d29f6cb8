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

"""Sample driver of a mount: follows `command`, offers `home`. Put your hardware into `ask`."""

import socket
from contextlib import suppress
from math import degrees

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory


class MountDriver(Node):

    def __init__(self):
        super().__init__('mount_driver')
        self.axes = self.declare_parameter('axes', ['azimuth', 'elevation']).value
        port = self.declare_parameter('port', 7625).value
        self.hardware = socket.create_connection(('localhost', port), 30).makefile('rw')
        self.knots = []
        self.create_subscription(JointTrajectory, 'command', self.on_command, 10)
        self.create_service(Trigger, 'home', self.on_home)
        self.create_timer(0.05, self.steer)

    def ask(self, line):
        print(line, file=self.hardware, flush=True)
        return self.hardware.readline()

    def on_command(self, message):  # the newest one replaces what was before
        def seconds(time):
            return time.sec + 1e-9 * time.nanosec
        i, j = (message.joint_names.index(axis) for axis in self.axes)
        self.knots = [(seconds(message.header.stamp) + seconds(p.time_from_start),
                       (p.positions[i], p.positions[j]), (p.velocities[i], p.velocities[j]))
                      for p in message.points]

    def steer(self):
        now = self.get_clock().now().nanoseconds * 1e-9
        later = next((n for n, knot in enumerate(self.knots) if knot[0] >= now), None)
        if later is None:  # no track, or at its end: stand still
            return self.ask('stop')
        (t0, p0, v0), (t1, p1, v1) = self.knots[max(later - 1, 0)], self.knots[later]
        h = t1 - t0
        s = max((now - t0) / h, 0.0) if h else 0.0
        where, rate = [], []
        for a, b, va, vb in zip(p0, p1, v0, v1):  # the cubic with these ends and rates
            c, d = 3 * (b - a) - h * (2 * va + vb), h * (va + vb) - 2 * (b - a)
            where.append(degrees(a + s * (h * va + s * (c + s * d))))
            rate.append(degrees(va + s * (2 * c + 3 * s * d) / h) if h else 0.0)
        self.ask('move {} {} {} {} {}'.format(now, *where, *rate))

    def on_home(self, request, response):
        self.ask('home')
        response.success, response.message = True, 'both axes have met their marks'
        return response


rclpy.init()
with suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(MountDriver())
