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

"""ROS messages to arrays and back. Stamps are integer nanoseconds, angles radians."""

import math
from functools import lru_cache

import numpy as np

from .older_frames import is_y_up

AXES = ('azimuth', 'elevation')
#: kind of mount -> its two joints, the first axis first
JOINTS = {'altaz': AXES, 'equatorial': ('hour_angle', 'declination'),
          'german': ('hour_angle', 'declination'), 'free': ('first_axis', 'second_axis'),
          'xy': ('x_angle', 'y_angle')}
#: kind of mount -> lowest reading of its second axis, rad, chosen so that readings do not wrap
#: within its travel: a German mount has -90 to 270 degrees
LOWEST_READING = {'german': -0.5 * math.pi}
#: links of the URDF: x east, y north, z up; along the tube z forward, x right, y down (REP 103)
MOUNT_FRAME, OPTICAL_FRAME = 'mount_enu', 'boresight_optical'
#: frame of the first axis at rest: with both axes at zero the tube points along its x
AXES_FRAME = 'axes'
#: valid range of air temperatures, degC, for which the refraction is computed
AIR_TEMPERATURES = -90.0, 60.0


def to_stamp(ns):
    """The ROS time message of `ns` nanoseconds since 1970."""
    from builtin_interfaces.msg import Time
    return Time(sec=int(ns // 1_000_000_000), nanosec=int(ns % 1_000_000_000))


def header(ns, frame):
    """The std_msgs Header with a stamp (ns) and a ``frame_id``."""
    from std_msgs.msg import Header
    return Header(stamp=to_stamp(ns), frame_id=frame)


def stamped(kind, ns, frame):
    """A message of class `kind` with a stamp (ns) and a ``frame_id``.

    Sets the fields of the header that the message creates: passing one would create a second.
    """
    message = kind()
    own = message.header
    own.stamp.sec, own.stamp.nanosec = divmod(int(ns), 1_000_000_000)
    own.frame_id = frame
    return message


def from_stamp(stamp):
    """Nanoseconds since 1970 of a ROS time message, int."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def joint_state(ns, position, velocity=(np.nan, np.nan), effort=(np.nan, np.nan),
                frame=MOUNT_FRAME, names=AXES):
    """A JointState of both axes; all three arrays are filled, with NaN for unknown values.

    Parameters
    ----------
    ns : int
        Stamp.
    position, velocity, effort : sequence of 2 float
        First and second axis: rad, rad/s, and what the topic defines as effort.
    names : sequence of str
        Names of the axes, one of `JOINTS`.
    """
    from sensor_msgs.msg import JointState
    message = stamped(JointState, ns, frame)
    message.name = list(names)
    for values, own in ((position, message.position), (velocity, message.velocity),
                        (effort, message.effort)):
        own.extend(map(float, values))
    return message


def joints_of(names):
    """The pair of `JOINTS` that is among some joint names, in any order.

    Raises
    ------
    ValueError
        There is no such pair.
    """
    return _joints_of(tuple(names))[0]


@lru_cache(maxsize=16)  # all readings have the same names
def _joints_of(names):
    """Result of `joints_of`, and the indices of the first and the second axis."""
    found = next((pair for pair in JOINTS.values() if set(pair) <= set(names)), None)
    if found is None:
        known = dict.fromkeys(' and '.join(pair) for pair in JOINTS.values())
        raise ValueError(f'joint names {list(names)}: need {", or ".join(known)}')
    return found, tuple(names.index(axis) for axis in found)


def read_joints(message):
    """Both axes of a JointState, in any order.

    Returns
    -------
    ns : int
        Stamp.
    position, velocity, effort : tuple of 2 float
        First and second axis; NaN where the message has no value.

    Raises
    ------
    ValueError
        An axis or its position is missing.
    """
    _, order = _joints_of(tuple(message.name))
    if len(message.position) != len(message.name):
        raise ValueError(f'{len(message.position)} positions for {len(message.name)} joints')

    def pick(values):
        return tuple(values[i] if i < len(values) else np.nan for i in order)

    return (from_stamp(message.header.stamp), pick(message.position), pick(message.velocity),
            pick(message.effort))


def pose(ns, angles, covariance):
    """Orientation of the tube for two axis angles: a PoseWithCovarianceStamped in `AXES_FRAME`.

    The first axis turns about −z, the second about −y: their variances are the covariances of yaw
    and pitch, elements 35 and 28.

    Parameters
    ----------
    ns : int
        Stamp.
    angles : sequence of 2 float
        First and second axis, rad.
    covariance : array_like, shape (2, 2), or None
        Covariance of the angles, rad²; None: unknown, NaN in the message.
    """
    from geometry_msgs.msg import PoseWithCovarianceStamped
    halves = [0.5 * float(angle) for angle in angles]  # per reading: numpy takes twice as long
    (s1, s2), (c1, c2) = map(math.sin, halves), map(math.cos, halves)
    (one, both), (_, two) = ((math.nan,) * 2,) * 2 if covariance is None else covariance
    message = stamped(PoseWithCovarianceStamped, ns, AXES_FRAME)
    turn, full = message.pose.pose.orientation, message.pose.covariance
    turn.x, turn.y, turn.z, turn.w = -s1 * s2, -c1 * s2, -s1 * c2, c1 * c2
    full[28], full[29], full[34], full[35] = two, both, both, one
    return message


def vector(ns, x, y):
    """A Vector3Stamped in `OPTICAL_FRAME` with z = 0."""
    from geometry_msgs.msg import Vector3Stamped
    message = stamped(Vector3Stamped, ns, OPTICAL_FRAME)
    message.vector.x, message.vector.y = float(x), float(y)
    return message


def sky_vector(ns, right, up):
    """A Vector3Stamped in `OPTICAL_FRAME`: offset `right` and `up` of the boresight, rad.

    Right is toward increasing first angles, up toward increasing second ones: x and −y of the
    message.
    """
    return vector(ns, right, -up)


def read_sky_vector(message):
    """Right and up of a Vector3Stamped, rad: the inverse of `sky_vector`.

    In messages of older logs and drivers, y points up: see `older_frames`.
    """
    right, y = message.vector.x, message.vector.y
    return right, y if is_y_up(message.header.frame_id) else -y


def trajectory(ns, times, positions, velocities, names=AXES):
    """A JointTrajectory of both axes.

    Parameters
    ----------
    ns : int
        Stamp of time zero.
    times : array_like, shape (n,)
        Seconds from the stamp, increasing.
    positions, velocities : array_like, shape (n, 2)
        First and second axis, rad and rad/s.
    names : sequence of str
        Names of the axes, one of `JOINTS`.
    """
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
    message = stamped(JointTrajectory, ns, MOUNT_FRAME)
    message.joint_names = list(names)
    for t, position, velocity in zip(times, positions, velocities):
        point = JointTrajectoryPoint()
        point.positions.extend(map(float, position))
        point.velocities.extend(map(float, velocity))
        since = point.time_from_start
        since.sec, since.nanosec = divmod(round(t * 1e9), 1_000_000_000)
        message.points.append(point)
    return message


def owner(request, node):
    """The KeyValue on `request/owner`: the node, and the stamp of its request, ns."""
    from diagnostic_msgs.msg import KeyValue
    return KeyValue(key=node.get_fully_qualified_name(),
                    value=str(from_stamp(request.header.stamp)))


def read_trajectory(message):
    """The inverse of `trajectory`.

    Returns
    -------
    ns : int
        Stamp of time zero.
    times : ndarray, shape (n,)
        Seconds from the stamp.
    positions, velocities : ndarray, shape (n, 2)
        First and second axis, rad and rad/s; a missing velocity is 0.

    Raises
    ------
    ValueError
        No points, a missing axis, different lengths, a non-finite value, or times not increasing.
    """
    names = message.joint_names
    _, order = _joints_of(tuple(names))
    points = message.points
    if not len(points):
        raise ValueError('trajectory without points')
    for point in points:
        if len(point.positions) != len(names) or len(point.velocities) not in (0, len(names)):
            raise ValueError(f'a trajectory point needs {len(names)} positions, and as many '
                             'velocities or none')
    times = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points])
    positions = np.array([[p.positions[i] for i in order] for p in points])
    velocities = np.array([[p.velocities[i] for i in order] if p.velocities else [0.0, 0.0]
                           for p in points])
    if not (np.isfinite(positions).all() and np.isfinite(velocities).all()):
        raise ValueError('trajectory with a value that is not finite')
    if (times[1:] <= times[:-1]).any():
        raise ValueError('trajectory times must increase')
    return from_stamp(message.header.stamp), times, positions, velocities


def temperature(ns, celsius):
    """A Temperature message; its variance is unknown (0)."""
    from sensor_msgs.msg import Temperature
    return Temperature(header=header(ns, MOUNT_FRAME), temperature=float(celsius))


def read_temperature(message):
    """Stamp (ns) and degC of a Temperature message.

    Raises
    ------
    ValueError
        Not a number, or not a possible temperature of air.
    """
    celsius = message.temperature
    low, high = AIR_TEMPERATURES
    if not low <= celsius <= high:
        raise ValueError(f'a temperature of {celsius:g} degC, which no air has ({low:g} to '
                         f'{high:g}); the last one holds')
    return from_stamp(message.header.stamp), celsius


def figures(ns, groups):
    """A DiagnosticArray of groups of numbers, from a dict of str to dict of str to float."""
    return values_message(ns, {name: {key: f'{value:.12g}' for key, value in rows.items()}
                               for name, rows in groups.items()})


def values_message(ns, groups):
    """A DiagnosticArray of named values, from a dict of str to dict of str to str or number."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    return DiagnosticArray(header=header(ns, MOUNT_FRAME), status=[
        DiagnosticStatus(level=DiagnosticStatus.OK, name=name, values=[
            KeyValue(key=key, value=str(value)) for key, value in rows.items()])
        for name, rows in groups.items()])


def values_of(message, name, version):
    """One group of a `values_message`, dict of str to str; empty if there is no such group.

    Raises
    ------
    ValueError
        The group has another ``version``.
    """
    values = next(({row.key: row.value for row in one.values} for one in message.status
                   if one.name == name), {})
    if values and values.get('version') != str(version):
        raise ValueError(f'{name} of version {values.get("version")!r}: {version} is known')
    return values


def status(level, name, message, **values):
    """A DiagnosticStatus with `values` as its key-value rows."""
    from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
    return DiagnosticStatus(level=level, name=name, message=message, values=[
        KeyValue(key=key, value=str(value)) for key, value in values.items()])
