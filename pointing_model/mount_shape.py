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

"""Shape of a mount: its parts, as a URDF and as positions in the horizon frame.

Frames follow REP 103: x forward along the tube, y left, z up. `mount_enu` has x east, y north,
z up, and its origin where the axes meet. The sizes are generic: the tube reaches to 0.45 m, so
the unit sphere with the stars of `observation` is the sky around it.
"""

import warnings
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

#: links: the fixed part, the part on the first axis, the part on the second
PIER, TURNS, TUBE = 'pier', 'first_axis', 'tube'
#: root of the tree, the frame of observations
ROOT = 'mount_enu'
#: frame of the camera: z along the tube, x right, y down
OPTICAL = 'boresight_optical'
GREY, DARK, WHITE = (0.45, 0.47, 0.5), (0.2, 0.22, 0.25), (0.88, 0.88, 0.9)
#: rotations about y that lay a cylinder (along z) along x, and about x along y
_ALONG_X, _ALONG_Y = (0.0, np.pi / 2.0, 0.0), (np.pi / 2.0, 0.0, 0.0)


@dataclass(frozen=True)
class MountPart:
    """A cylinder (radius, length, along z) or a box (x, y, z) of a link, metres.

    Parameters
    ----------
    link : str
    size : tuple of float
        Two numbers for a cylinder, three for a box.
    xyz, rpy : tuple of float
        Pose of its centre in the frame of the link: metres, radians about the fixed x, y, z.
    colour : tuple of float
        Red, green, blue, 0 to 1.
    """

    link: str
    size: tuple
    xyz: tuple = (0.0, 0.0, 0.0)
    rpy: tuple = (0.0, 0.0, 0.0)
    colour: tuple = GREY


def parts_of(mount):
    """Parts of a `mounts.Mount`, a list of MountPart.

    The pier is upright, in `ROOT`; the others are in the frames of their axes at rest.
    """
    pier = MountPart(PIER, (0.08, 0.5), (0.0, 0.0, -0.6), colour=DARK)
    if mount.two_sided:  # the tube is on the left when facing the meridian
        tube = 0.22
        return [
            pier, MountPart(PIER, (0.06, 0.35), (0.0, 0.0, -0.2), colour=DARK),
            MountPart(TURNS, (0.05, 0.3), (0.0, 0.0, 0.0), colour=DARK),
            MountPart(TURNS, (0.03, 0.5), (0.0, -0.05, 0.0), _ALONG_Y),
            MountPart(TURNS, (0.09, 0.08), (0.0, -0.3, 0.0), _ALONG_Y, DARK),
            MountPart(TUBE, (0.07, 0.8), (0.05, tube, 0.0), _ALONG_X, WHITE),
            MountPart(TUBE, (0.075, 0.06), (0.4, tube, 0.0), _ALONG_X, DARK)]
    return [
        pier, MountPart(PIER, (0.12, 0.06), (0.0, 0.0, -0.36), colour=DARK),
        MountPart(TURNS, (0.2, 0.04), (0.0, 0.0, -0.28)),
        MountPart(TURNS, (0.12, 0.03, 0.36), (0.0, 0.15, -0.1)),
        MountPart(TURNS, (0.12, 0.03, 0.36), (0.0, -0.15, -0.1)),
        MountPart(TUBE, (0.02, 0.3), (0.0, 0.0, 0.0), _ALONG_Y, DARK),
        MountPart(TUBE, (0.09, 0.6), (0.12, 0.0, 0.0), _ALONG_X, WHITE),
        MountPart(TUBE, (0.095, 0.05), (0.4, 0.0, 0.0), _ALONG_X, DARK)]


def base_of(mount):
    """The frame of the first axis at rest: x where both angles are zero, z along the axis.

    Returns
    -------
    ndarray, shape (3, 3)
        Columns are its axes in east, north, up.
    """
    right, forward, pole = np.array(mount.frame)
    return np.column_stack((forward, -right, pole))


def frames_of(mount, angles):
    """Rotation matrices of the links to east, north, up, by name.

    Parameters
    ----------
    mount : Mount
    angles : (float, float)
        Angles of both axes, rad.

    Returns
    -------
    dict of str to ndarray, shape (3, 3)
    """
    turned = base_of(mount) @ Rotation.from_euler('z', -angles[0]).as_matrix()
    return {PIER: np.eye(3), TURNS: turned,
            TUBE: turned @ Rotation.from_euler('y', -angles[1]).as_matrix()}


def placed(part, frames):
    """Pose of a part in `ROOT`: position (3,) in metres and quaternion (x, y, z, w)."""
    frame = Rotation.from_matrix(frames[part.link])
    turned = frame * Rotation.from_euler('xyz', part.rpy)  # URDF: about the fixed x, y, z
    return frame.apply(part.xyz), turned.as_quat(canonical=True)


def urdf(mount, name='mount'):
    """The mount as a URDF, str; joints are named as in `joint_states`.

    Links are `mount_enu`, `pier`, `axes`, `first_axis`, `tube`, `boresight` (its x is the line of
    sight) and `boresight_optical` (its z is the line of sight, x to the right, y down).

    Parameters
    ----------
    mount : Mount
    name : str
        Name of the robot.
    """
    robot = ElementTree.Element('robot', name=name)
    for link in (ROOT, PIER, 'axes', TURNS, TUBE, 'boresight', OPTICAL):
        element = ElementTree.SubElement(robot, 'link', name=link)
        for part in parts_of(mount):
            if part.link == link:
                _visual(element, part)
    _joint(robot, 'pier_stands', ROOT, PIER)
    _joint(robot, 'axes_stand', PIER, 'axes', rpy=_roll_pitch_yaw(base_of(mount)))
    travel = [np.radians(ends) for ends in mount.names.travel_deg]
    for key, axis, parent, child, ends in zip(
            mount.names.keys, ('0 0 -1', '0 -1 0'), ('axes', TURNS), (TURNS, TUBE), travel):
        whole = mount.vertical and child == TURNS
        joint = _joint(robot, key, parent, child, 'continuous' if whole else 'revolute')
        ElementTree.SubElement(joint, 'axis', xyz=axis)
        limits = {} if whole else {'lower': f'{ends[0]:.6f}', 'upper': f'{ends[1]:.6f}'}
        ElementTree.SubElement(joint, 'limit', effort='0', velocity='0', **limits)
    _joint(robot, 'looks_along', TUBE, 'boresight')
    _joint(robot, 'optics', 'boresight', OPTICAL, rpy=(-np.pi / 2.0, 0.0, -np.pi / 2.0))
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding='unicode') + '\n'


def _visual(link, part):
    visual = ElementTree.SubElement(link, 'visual')
    ElementTree.SubElement(visual, 'origin', xyz=_numbers(part.xyz), rpy=_numbers(part.rpy))
    geometry = ElementTree.SubElement(visual, 'geometry')
    if len(part.size) == 2:
        radius, length = map(str, part.size)
        ElementTree.SubElement(geometry, 'cylinder', radius=radius, length=length)
    else:
        ElementTree.SubElement(geometry, 'box', size=_numbers(part.size))
    colour = bytes(round(255 * value) for value in part.colour).hex()
    material = ElementTree.SubElement(visual, 'material', name=f'colour_{colour}')
    ElementTree.SubElement(material, 'color', rgba=_numbers((*part.colour, 1.0)))


def _joint(robot, name, parent, child, kind='fixed', rpy=(0.0, 0.0, 0.0)):
    joint = ElementTree.SubElement(robot, 'joint', name=name, type=kind)
    ElementTree.SubElement(joint, 'parent', link=parent)
    ElementTree.SubElement(joint, 'child', link=child)
    ElementTree.SubElement(joint, 'origin', xyz='0 0 0', rpy=_numbers(rpy))
    return joint


def _roll_pitch_yaw(matrix):
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # at a pitch of 90 deg roll and yaw are degenerate
        return Rotation.from_matrix(matrix).as_euler('xyz')


def _numbers(values):
    return ' '.join(f'{value:.9g}' for value in values)
