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

"""Every topic of the graph: relative name, type, quality of service. Nodes take them from here."""

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import NamedTuple


class Quality(NamedTuple):
    """Quality of service: the arguments of `make_qos`, usable without ROS."""

    depth: int
    reliable: bool = True
    latched: bool = False


@cache
def _profile(quality):
    return make_qos(quality.depth, reliable=quality.reliable, latched=quality.latched)


def make_qos(depth, *, reliable=True, latched=False):
    """A QoS profile that keeps `depth` messages; `latched`: late subscribers get the last ones."""
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


@cache
def _message(type_name):
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


RELIABLE = Quality(100)
# An encoder at 1 kHz may run a few seconds ahead of a busy subscriber before a sample is lost.
DEEP = Quality(5000)
LATCHED = Quality(1, latched=True)
HISTORY = Quality(100, latched=True)
SENSOR = Quality(5, reliable=False)


@dataclass(frozen=True)
class Topic:
    """A topic of the graph.

    Parameters
    ----------
    name : str
        Relative to the namespace of the mount, absolute where ROS fixes it.
    type : str
        As in ``ros2 topic list -t``, for instance ``sensor_msgs/msg/JointState``.
    quality : Quality or rclpy.qos.QoSProfile
        Quality of service of both sides; a user may override it by parameter.
    many : bool
        Whether several nodes may publish it; otherwise a second publisher ends at its start.
    computed : bool
        Whether the nodes fed by a replay publish it themselves: results and reports of their own
        state.
    """

    name: str
    type: str
    quality: object
    many: bool = False
    computed: bool = False

    @property
    def qos(self):
        """The rclpy.qos.QoSProfile, one shared object per quality."""
        return _profile(self.quality) if isinstance(self.quality, Quality) else self.quality

    @property
    def message(self):
        """The Python class of the message."""
        return _message(self.type)

    @property
    def latched(self):
        """Whether late subscribers still get the last message."""
        if isinstance(self.quality, Quality):
            return self.quality.latched
        return self.quality.durability.name == 'TRANSIENT_LOCAL'


CLOCK = Topic('/clock', 'rosgraph_msgs/msg/Clock', RELIABLE, computed=True)
# trajectories requested by commanders; only the guard publishes `command`, after checking them
REQUEST = Topic('request', 'trajectory_msgs/msg/JointTrajectory', RELIABLE, many=True)
# node that made the request, and the stamp of the request, ns
REQUEST_OWNER = Topic('request/owner', 'diagnostic_msgs/msg/KeyValue', HISTORY, many=True)
GUARD_STATUS = Topic('guard/status', 'diagnostic_msgs/msg/DiagnosticStatus', LATCHED, computed=True)
COMMAND = Topic('command', 'trajectory_msgs/msg/JointTrajectory', RELIABLE)
# only the simulated hardware may subscribe to these
TRUTH_JOINTS = Topic('truth/joint_states', 'sensor_msgs/msg/JointState', DEEP)
TRUTH_ZERO = Topic('truth/incremental_zero', 'sensor_msgs/msg/JointState', HISTORY)
TRUTH_SCENARIO = Topic('truth/scenario', 'std_msgs/msg/String', LATCHED)
INCREMENTAL = Topic('incremental/joint_states', 'sensor_msgs/msg/JointState', DEEP)
# number and start of its power-on, see msg_tools/power_on.py
INCREMENTAL_POWER_ON = Topic(
    'incremental/power_on', 'diagnostic_msgs/msg/DiagnosticArray', LATCHED)
HOMING = Topic('incremental/homing', 'sensor_msgs/msg/PointCloud2', LATCHED)
# velocities are measured by the encoders: NaN if one reading alone gives none
ABSOLUTE = Topic('absolute/joint_states', 'sensor_msgs/msg/JointState', DEEP)
ABSOLUTE_POWER_ON = Topic('absolute/power_on', 'diagnostic_msgs/msg/DiagnosticArray', LATCHED)
# the same angles with their covariance, from the image alone. Older logs have the standard errors,
# rad, as positions of `absolute/sigma`, sensor_msgs/msg/JointState
ABSOLUTE_POSE = Topic('absolute/pose', 'geometry_msgs/msg/PoseWithCovarianceStamped', DEEP)
ABSOLUTE_FRAME = Topic('absolute/frame', 'sensor_msgs/msg/Image', SENSOR)
MISS_DISTANCE = Topic('camera/miss_distance', 'geometry_msgs/msg/Vector3Stamped', RELIABLE)
AMBIENT = Topic('ambient/temperature', 'sensor_msgs/msg/Temperature', HISTORY)
# tilt of the base to the north (x) and to the west (y), rad; with arbitrary origin
INCLINOMETER = Topic('inclinometer', 'geometry_msgs/msg/Vector3Stamped', RELIABLE)
OBSERVATION = Topic('observation', 'sensor_msgs/msg/PointCloud2', DEEP)
OBSERVATIONS = Topic('observations', 'sensor_msgs/msg/PointCloud2', LATCHED)
OFFSET = Topic('offset', 'geometry_msgs/msg/Vector3Stamped', RELIABLE)
OBSERVER_STATUS = Topic(
    'observer/status', 'diagnostic_msgs/msg/DiagnosticStatus', LATCHED, computed=True)
PLAN_STATUS = Topic(
    'observer/plan/status', 'action_msgs/msg/GoalStatusArray', LATCHED, computed=True)
PLAN_FEEDBACK = Topic(
    'observer/plan/feedback', 'diagnostic_msgs/msg/DiagnosticArray', LATCHED, computed=True)
CHECKS = Topic('observer/checks', 'std_msgs/msg/String', LATCHED, computed=True)
ZERO = Topic('zero', 'sensor_msgs/msg/JointState', LATCHED, computed=True)
# its power-on and model: see pointing_model/calibration_messages.py
ZERO_IDENTITY = Topic(
    'zero/identity', 'diagnostic_msgs/msg/DiagnosticArray', LATCHED, computed=True)
# the same angles with their covariance: encoder readings of axes at rest
ZERO_POSE = Topic(
    'zero/pose', 'geometry_msgs/msg/PoseWithCovarianceStamped', LATCHED, computed=True)
# expected change of the zero since the previous power-on, before Polaris is observed
ZERO_EXPECTED = Topic(
    'zero/expected_change', 'diagnostic_msgs/msg/DiagnosticArray', LATCHED, computed=True)
MODEL = Topic('model', 'std_msgs/msg/String', LATCHED, computed=True)
DIAGNOSIS = Topic('diagnosis', 'std_msgs/msg/String', LATCHED, computed=True)
CALIBRATION_REPORT = Topic('calibration/report', 'std_msgs/msg/String', LATCHED, computed=True)
# terms, zero, RMS and expected error as numbers, and residuals of each star: for plots
CALIBRATION_FIGURES = Topic(
    'calibration/figures', 'diagnostic_msgs/msg/DiagnosticArray', LATCHED, computed=True)
CALIBRATION_RESIDUALS = Topic(
    'calibration/residuals', 'sensor_msgs/msg/PointCloud2', LATCHED, computed=True)
# residuals as one message per star, with its stamp: for time series
CALIBRATION_RESIDUAL = Topic('calibration/residual', 'geometry_msgs/msg/Vector3Stamped',
                             Quality(DEEP.depth, latched=True), computed=True)
CALIBRATION_STATUS = Topic(
    'calibration/status', 'diagnostic_msgs/msg/DiagnosticStatus', LATCHED, computed=True)
# the rows of the night, for an observer that was restarted and has none
CALIBRATION_TABLE = Topic(
    'calibration/table', 'sensor_msgs/msg/PointCloud2', LATCHED, computed=True)
# effect of the last star on a model that is tracked, JSON
TRACKING = Topic('tracking', 'std_msgs/msg/String', LATCHED, computed=True)
# probabilities of the causes that a diagnosis leaves open, and the most informative star, JSON
DISCRIMINATION = Topic('apart', 'std_msgs/msg/String', LATCHED, computed=True)
TARGET = Topic('target', 'trajectory_msgs/msg/JointTrajectory', RELIABLE, many=True)
DEMAND = Topic('demand', 'trajectory_msgs/msg/JointTrajectory', RELIABLE, computed=True)
DEMAND_SIGMA = Topic('demand_sigma', 'geometry_msgs/msg/Vector3Stamped', RELIABLE, computed=True)
# model and zero together: JSON, see pointing_model/calibration_messages.py
ACTIVE = Topic('in_force', 'std_msgs/msg/String', LATCHED, computed=True)
DIAGNOSTICS = Topic(
    '/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', RELIABLE, many=True, computed=True)
ENDPOINTS = Topic(
    '/endpoints', 'diagnostic_msgs/msg/DiagnosticArray', RELIABLE, many=True, computed=True)

ALL = tuple(value for value in list(globals().values()) if isinstance(value, Topic))

# display data, which no log needs: for RViz and Foxglove, from `mount_display`
ROBOT_DESCRIPTION = Topic('robot_description', 'std_msgs/msg/String', LATCHED, computed=True)
JOINTS = Topic('joint_states', 'sensor_msgs/msg/JointState', RELIABLE, computed=True)
MARKERS = Topic('markers', 'visualization_msgs/msg/MarkerArray', RELIABLE, computed=True)

COMPUTED = tuple(value for value in list(globals().values())
                 if isinstance(value, Topic) and value.computed)
#: what a replay leaves out unless it is named: computed topics, and those that would move a mount
NOT_REPLAYED = (*COMPUTED, REQUEST, REQUEST_OWNER, COMMAND)
