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

"""A mount by plain rotation matrices."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.geometry import linearised, values
from pointing_model.mount_kinds import CANONICAL
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import Trig

LARGE = dict(zip(CANONICAL, np.array([150, -90, 300, -240, 280, -310, 120]) * ARCSEC))


def forward_by_matrices(a, e, c):
    """Line of sight of a mount, from plain rotation matrices about x east, y north, z up."""

    def about(axis, angle):
        k = np.zeros((3, 3))
        x, y, z = axis
        k[:] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k

    tilt = np.hypot(c['AN'], c['AW'])
    lean = np.array([-c['AW'], c['AN'], 0.0]) / tilt  # horizontal direction of the lean
    # turning the zenith towards `lean` is a rotation about zenith x lean
    base = about(np.cross([0, 0, 1], lean), tilt)
    azimuth = about([0, 0, 1], -a)
    # the right end of the elevation axis (east when looking north) up: from x to z
    skew = about([0, 1, 0], -c['NPAE'])
    elevation = about([1, 0, 0], e)
    sight = about([0, 0, 1], c['CA']) @ [0, 1, 0]  # to the left of the tube
    return base @ azimuth @ skew @ elevation @ sight


def offsets_and_jacobian(az, el, coefficients, names, mount=ALTAZ):
    """`linearised` by names of the mount's own terms, on the side of each place."""
    trig = Trig(az, el, mount)
    own = [mount.names.terms[name] for name in names]
    x, y, columns = linearised(trig, values(coefficients, mount), [name for name, _ in own])
    side = 1.0 if trig.side is None else trig.side
    return side * x, side * y, {name: tuple(sign * side * v for v in columns[canonical])
                                for name, (canonical, sign) in zip(names, own)}
