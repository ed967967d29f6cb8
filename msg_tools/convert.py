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
#: kind of mount -> where a turn of the readings of its second axis begins, rad, that none jumps on
#: its travel: of a German mount -90 to 270 degrees
LOWEST_READING = {'german': -0.5 * math.pi}
#: links of the URDF: x east, y north, z up; along the tube z forward, x right, y down (REP 103)
MOUNT_FRAME, OPTICAL_FRAME = 'mount_enu', 'boresight_optical'
#: that of the first axis at rest: both axes at zero look along its x
AXES_FRAME = 'axes'
#: temperatures that air has, degC: those for which the refraction is worked out
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

    Given parts would be made beside those that it makes itself.
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
    """A JointState of both axes; all three arrays are filled, NaN is unknown.

    Parameters
    ----------
    ns : int
        Stamp.
    position, velocity, effort : sequence of 2 float
        First and second axis, rad, rad/s, and what the topic defines.
    names : sequence of str
        Of the axes, one of `JOINTS`.
    """
    from sensor_msgs.msg import JointState
    message = stamped(JointState, ns, frame)
    message.name = list(names)
    for values, own in ((position, message.position), (velocity, message.velocity),
                        (effort, message.effort)):
        own.extend(map(float, values))
    return message


def joints_of(names):
    """Which pair of `JOINTS` is among the names of joints, in whatever order.

    Raises
    ------
    ValueError
        None is.
    """
    return _joints_of(tuple(names))[0]


@lru_cache(maxsize=16)  # each reading has the same
def _joints_of(names):
    """As `joints_of`, and where the first and the second axis stand."""
    found = next((pair for pair in JOINTS.values() if set(pair) <= set(names)), None)
    if found is None:
        known = dict.fromkeys(' and '.join(pair) for pair in JOINTS.values())
        raise ValueError(f'joint names {list(names)}: need {", or ".join(known)}')
    return found, tuple(names.index(axis) for axis in found)


def read_joints(message):
    """Both axes of a JointState, whatever their order.

    Returns
    -------
    ns : int
        Stamp.
    position, velocity, effort : tuple of 2 float
        First and second axis; NaN where the message does not say.

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
    """A PoseWithCovarianceStamped in `AXES_FRAME`: how the tube is turned by two angles.

    The first axis turns about −z, the second about −y: their variances are the covariances of yaw
    and pitch, elements 35 and 28.

    Parameters
    ----------
    ns : int
        Stamp.
    angles : sequence of 2 float
        First and second axis, rad.
    covariance : array_like, shape (2, 2), or None
        Of them, rad²; NaN in the message where it is not known.
    """
    from geometry_msgs.msg import PoseWithCovarianceStamped
    halves = [0.5 * float(angle) for angle in angles]  # of each reading: numpy takes twice as long
    (s1, s2), (c1, c2) = map(math.sin, halves), map(math.cos, halves)
    (one, both), (_, two) = ((math.nan,) * 2,) * 2 if covariance is None else covariance
    message = stamped(PoseWithCovarianceStamped, ns, AXES_FRAME)
    turn, full = message.pose.pose.orientation, message.pose.covariance
    turn.x, turn.y, turn.z, turn.w = -s1 * s2, -c1 * s2, -s1 * c2, c1 * c2
    full[28], full[29], full[34], full[35] = two, both, both, one
    return message


def vector(ns, x, y):
    """A Vector3Stamped in `OPTICAL_FRAME`, whose z is 0."""
    from geometry_msgs.msg import Vector3Stamped
    message = stamped(Vector3Stamped, ns, OPTICAL_FRAME)
    message.vector.x, message.vector.y = float(x), float(y)
    return message


def sky_vector(ns, right, up):
    """A Vector3Stamped in `OPTICAL_FRAME`: what lies `right` and `up` of the boresight, rad.

    Right is toward a rising first angle, up toward a rising second one: x and −y of the message.
    """
    return vector(ns, right, -up)


def read_sky_vector(message):
    """Right and up of a Vector3Stamped, rad: the way back from `sky_vector`.

    In older logs, and of older drivers, y is up: `older_frames`.
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
        Of the axes, one of `JOINTS`.
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
    """The way back from `trajectory`.

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
        No point, an axis missing, lengths that differ, values not finite, times not increasing.
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
        It is no number, or none that air has.
    """
    celsius = message.temperature
    low, high = AIR_TEMPERATURES
    if not low <= celsius <= high:
        raise ValueError(f'a temperature of {celsius:g} degC, which no air has ({low:g} to '
                         f'{high:g}); the last one holds')
    return from_stamp(message.header.stamp), celsius


def figures(ns, groups):
    """A DiagnosticArray of groups of numbers, dict of str to dict of str to float."""
    return values_message(ns, {name: {key: f'{value:.12g}' for key, value in rows.items()}
                               for name, rows in groups.items()})


def values_message(ns, groups):
    """A DiagnosticArray of named values, dict of str to dict of str to str or number."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    return DiagnosticArray(header=header(ns, MOUNT_FRAME), status=[
        DiagnosticStatus(level=DiagnosticStatus.OK, name=name, values=[
            KeyValue(key=key, value=str(value)) for key, value in rows.items()])
        for name, rows in groups.items()])


def values_of(message, name, version):
    """One group of `values_message`, dict of str to str; empty where there is no such group.

    Raises
    ------
    ValueError
        Its value ``version`` is another.
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
