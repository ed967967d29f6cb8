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

from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools import convert
from pointing_model.mount_shape import (
    TUBE,
    TURNS,
    frames_of,
    parts_of,
    placed,
    urdf,
)
from pointing_model.mounts import parse_mount

MOUNTS = [parse_mount(text, latitude) for text in ('altaz', 'equatorial', 'german', 'free:30,40,20')
          for latitude in (-0.6, 0.0, 1.5)]


def chain(text, angles, link='boresight'):
    """Rotation of a link by the joints of a URDF, as a publisher of tf has it."""
    joints = {joint.find('child').get('link'): joint
              for joint in ElementTree.fromstring(text).iter('joint')}
    out = np.eye(3)
    while link in joints:
        joint = joints[link]
        turn = np.eye(3)
        if joint.get('type') != 'fixed':
            x, y, z = (float(v) for v in joint.find('axis').get('xyz').split())
            k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            a = angles[joint.get('name')]
            turn = np.eye(3) + np.sin(a) * k + (1.0 - np.cos(a)) * k @ k  # Rodrigues
        rpy = [float(v) for v in joint.find('origin').get('rpy').split()]
        out = Rotation.from_euler('xyz', rpy).as_matrix() @ turn @ out
        link = joint.find('parent').get('link')
    assert link == 'mount_enu'
    return out


@pytest.mark.parametrize('mount', MOUNTS)
def test_the_boresight_looks_where_the_mount_does(mount):
    text = urdf(mount)
    for angles in np.random.default_rng(5).uniform(-4.0, 4.0, (20, 2)):
        frames = frames_of(mount, angles)
        np.testing.assert_allclose(frames[TUBE][:, 0], mount.direction(*angles), atol=1e-12)
        joints = dict(zip(mount.names.keys, angles))
        np.testing.assert_allclose(chain(text, joints), frames[TUBE], atol=1e-7)


@pytest.mark.parametrize('mount', MOUNTS)
@pytest.mark.parametrize('right, up', [(0.0, 1e-4), (0.0, -1e-4), (-1e-4, 0.0), (1e-4, 0.0)],
                         ids=['up', 'down', 'left', 'right'])
def test_a_star_beside_the_boresight_is_there_in_the_optical_frame(mount, right, up):
    message = convert.sky_vector(1, right, up)
    assert np.sign([message.vector.x, message.vector.y]).tolist() == np.sign([right, -up]).tolist()
    assert convert.read_sky_vector(message) == (right, up)
    angles = np.array([0.4, 0.9])
    star = mount.direction(*(angles + [right / np.cos(angles[1]), up]))
    optical = chain(urdf(mount), dict(zip(mount.names.keys, angles)), message.header.frame_id)
    seen = optical @ [message.vector.x, message.vector.y, 1.0]
    np.testing.assert_allclose(seen / np.linalg.norm(seen), star, atol=2e-8)


@pytest.mark.parametrize('mount', MOUNTS)
def test_a_pose_turns_the_axes_as_the_joints_do(mount):
    rng = np.random.default_rng(7)
    angles, root = rng.uniform(-3.0, 3.0, 2), rng.normal(size=(2, 2))
    covariance = root @ root.T
    message = convert.pose(1, angles, covariance)
    turn = message.pose.pose.orientation
    frame = chain(urdf(mount), {}, message.header.frame_id) @ Rotation.from_quat(
        [turn.x, turn.y, turn.z, turn.w]).as_matrix()
    np.testing.assert_allclose(frame, frames_of(mount, angles)[TUBE], atol=1e-7)
    # yaw and pitch are the angles with the other sign: the same variances
    full = np.reshape(message.pose.covariance, (6, 6))
    np.testing.assert_array_equal(full[4:, 4:], covariance[::-1, ::-1])
    assert not full[:4].any() and np.isnan(convert.pose(1, angles, None).pose.covariance[35])


def test_a_tube_at_rest_has_its_left_and_its_up_as_rep_103_says():
    frame = frames_of(parse_mount('altaz', 0.6), (0.0, 0.0))[TUBE]
    np.testing.assert_allclose(frame, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize('mount', MOUNTS)
def test_parts_are_turned_by_quaternions_of_which_w_is_last(mount):
    for angles in np.random.default_rng(6).uniform(-1.5, 1.5, (10, 2)):
        frames = frames_of(mount, angles)
        for part in (part for part in parts_of(mount) if not any(part.rpy)):
            x, y, z, w = placed(part, frames)[1]
            assert w >= 0.0
            np.testing.assert_allclose(frames[part.link][:, 0], [
                1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)], atol=1e-12)


@pytest.mark.parametrize('hour_angle, declination', [(60.0, 20.0), (120.0, 150.0)])
def test_the_counterweight_of_a_german_mount_hangs_down_on_both_sides(hour_angle, declination):
    mount = parse_mount('german', 0.6)
    frames = frames_of(mount, np.radians([hour_angle, declination]))
    weight = min((part for part in parts_of(mount) if part.link == TURNS), key=lambda p: p.xyz[1])
    tube = next(part for part in parts_of(mount) if part.link == TUBE)
    assert placed(weight, frames)[0][2] < -0.1 < 0.1 < placed(tube, frames)[0][2]
