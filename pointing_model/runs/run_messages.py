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

"""The messages of a pointing run: a PointCloud2, one point an observation, and back.

Its ``frame_id`` says of which mount the angles are: ``mount_enu`` of an alt-azimuth one,
``mount_enu/german@34.3`` with the latitude (deg) of another.
"""

from msg_tools.cloud_tables import cloud_to_table, table_to_cloud
from msg_tools.convert import MOUNT_FRAME
from msg_tools.units import DEG

from ..mounts import ALTAZ, mount_text, parse_mount
from .run import REQUIRED, PointingRun


def frame_of(mount):
    """The ``frame_id`` of angles of a `Mount`."""
    if mount.vertical:
        return MOUNT_FRAME
    return f'{MOUNT_FRAME}/{mount_text(mount)}@{mount.latitude / DEG!r}'


def mount_of(frame):
    """The `Mount` of a ``frame_id``, the way back from `frame_of`.

    Raises
    ------
    ValueError
        It names no mount.
    """
    head, _, text = frame.partition('/')
    if head != MOUNT_FRAME or not text:
        return ALTAZ
    kind, _, latitude = text.rpartition('@')
    try:
        return parse_mount(kind, float(latitude) * DEG)
    except ValueError as err:
        raise ValueError(f'frame_id {frame!r} of an observation: {err}') from None


def run_to_cloud(run, ns):
    """A PointCloud2, one point an observation: x, y, z on the unit sphere, then its columns.

    Parameters
    ----------
    run : PointingRun
        Numeric columns only.
    ns : int
        Stamp.
    """
    return table_to_cloud(run.columns, ns, run.mount.direction(run['az'], run['el']),
                          frame_of(run.mount))


def cloud_to_run(message):
    """The float64 columns of a PointCloud2 of observations.

    Returns
    -------
    PointingRun

    Raises
    ------
    ValueError
        A required column is missing, the data do not fill the rows that are declared, or the
        frame names no mount.
    """
    mount = mount_of(message.header.frame_id)
    return PointingRun(cloud_to_table(message, REQUIRED, 'observation'),
                       {} if mount.vertical else {'mount': mount})
