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

"""Conversion of a pointing run to a PointCloud2 message, one point per observation, and back.

For mounts other than alt-azimuth ones each row has the kind of mount (its index in `KINDS`, where
new kinds go at the end) and the direction of the first axis: columns ``mount_kind``, ``pole_az``,
``pole_el`` and ``pole_roll``, rad. Older logs have these in the frame: `msg_tools.older_frames`.
"""

import numpy as np

from msg_tools.cloud_tables import cloud_to_table, table_to_cloud
from msg_tools.older_frames import mount_in
from msg_tools.units import DEG

from ..mount_kinds import KINDS
from ..mounts import ALTAZ, mount_by_pole, parse_mount, pole_of
from .run import REQUIRED, PointingRun

_OF_MOUNT = ('mount_kind', 'pole_az', 'pole_el', 'pole_roll')


def _old_mount(frame):
    """The `Mount` of a ``frame_id`` of an older log.

    Raises
    ------
    ValueError
        It names an invalid mount.
    """
    try:
        found = mount_in(frame)
        return parse_mount(found[0], found[1] * DEG) if found else ALTAZ
    except ValueError as err:
        raise ValueError(f'frame_id {frame!r} of an observation: {err}') from None


def _mount_of(numbers):
    """The `Mount` from the first row of the columns `_OF_MOUNT`; ValueError if it is invalid."""
    number, *pole = (float(column[0]) for column in numbers)
    if number not in range(len(KINDS)):
        raise ValueError(f'mount_kind {number:g} of an observation: 0 to {len(KINDS) - 1}')
    return mount_by_pole(list(KINDS)[int(number)], *pole)


def run_to_cloud(run, ns):
    """PointCloud2 with one point per observation: x, y, z on the unit sphere, then the columns.

    Parameters
    ----------
    run : PointingRun
        Numeric columns only.
    ns : int
        Stamp.
    """
    columns = run.columns
    if not run.mount.vertical:
        numbers = list(KINDS).index(run.mount.kind), *pole_of(run.mount)
        columns = columns | {name: np.full(len(run), number)
                             for name, number in zip(_OF_MOUNT, numbers)}
    return table_to_cloud(columns, ns, run.mount.direction(run['az'], run['el']))


def cloud_to_run(message):
    """The float64 columns of a PointCloud2 of observations.

    Returns
    -------
    PointingRun

    Raises
    ------
    ValueError
        A required column is missing, the data do not fill the declared rows, or the mount is
        invalid.
    """
    table = cloud_to_table(message, REQUIRED, 'observation')
    numbers = [table.pop(name) for name in _OF_MOUNT if name in table]
    if len(numbers) == len(_OF_MOUNT) and len(numbers[0]):
        mount = _mount_of(numbers)
    else:
        mount = _old_mount(message.header.frame_id)
    return PointingRun(table, {} if mount.vertical else {'mount': mount})
