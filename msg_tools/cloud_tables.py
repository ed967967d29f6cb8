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

"""Tables of named numbers as messages: a PointCloud2 with a float64 field for each column."""

from functools import lru_cache
from itertools import count

import numpy as np

from .convert import MOUNT_FRAME, stamped

_FLOAT32, _FLOAT64 = 7, 8  # PointField.FLOAT32, FLOAT64
#: numpy's names of the data types of PointField, from 1 on
_KINDS = ('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8')
# words of 8 bytes for x, y, z as float32 and padding, so that float64 fields are aligned
_DRAWN = 2


def table_to_cloud(columns, ns, points=None):
    """A table as PointCloud2, with one point per row.

    Parameters
    ----------
    columns : dict of str to array_like, shape (n,)
        Columns of numbers.
    ns : int
        Stamp.
    points : array_like, shape (3, n), optional
        x, y, z as float32 in front of the columns, in `MOUNT_FRAME`, for programs that draw points.
    """
    from sensor_msgs.msg import PointCloud2
    rows, message = _rows(columns, points), stamped(PointCloud2, ns, MOUNT_FRAME)
    message.height, message.width, message.is_dense = 1, len(rows), True
    message.fields = list(_fields(tuple(columns), points is not None))
    message.point_step, message.row_step = 8 * rows.shape[1], rows.nbytes
    message.data = rows.tobytes()
    return message


def _rows(columns, points):
    """All rows as 8-byte words, shape (n, words)."""
    values = np.array([*map(np.atleast_1d, columns.values())], '<f8')
    if points is None:
        return values.T.copy()
    rows = np.zeros((values.shape[1], _DRAWN + len(values)), '<f8')
    rows[:, _DRAWN:] = values.T
    rows.view('<f4')[:, :3] = np.transpose(points)
    return rows


@lru_cache(maxsize=16)
def _fields(names, drawn):
    """The PointFields; cached, since nobody changes them."""
    from sensor_msgs.msg import PointField
    first = 8 * _DRAWN if drawn else 0
    return tuple(PointField(name=name, offset=offset, datatype=datatype, count=1)
                 for name, offset, datatype in (
                     *((name, 4 * i, _FLOAT32) for i, name in enumerate('xyz' if drawn else '')),
                     *zip(names, count(first, 8), [_FLOAT64] * len(names))))


def cloud_to_table(message, required=(), what='table'):
    """The float64 columns of a PointCloud2.

    Parameters
    ----------
    message : sensor_msgs.msg.PointCloud2
    required : iterable of str
        Columns that must be there.
    what : str
        Name of the table in error messages.

    Returns
    -------
    dict of str to ndarray, shape (n,)

    Raises
    ------
    ValueError
        A required column is missing, or the data do not match the declared number of rows.
    """
    fields = [f for f in message.fields if f.datatype == _FLOAT64 and f.count == 1]
    there = {f.name for f in fields}
    missing = [name for name in required if name not in there]
    if missing:
        raise ValueError(f'{what} without float64 field {", ".join(missing)}')
    data = cloud_points(message, fields, what)
    return {name: data[name].astype(float) for name in data.dtype.names}


def cloud_points(message, fields=None, what='points'):
    """The points of a PointCloud2.

    Parameters
    ----------
    message : sensor_msgs.msg.PointCloud2
    fields : list of sensor_msgs.msg.PointField, optional
        Fields to read; all by default.
    what : str
        Name of the points in error messages.

    Returns
    -------
    ndarray of structures, shape (n,)

    Raises
    ------
    ValueError
        The data do not match the declared number of rows, or a field has an invalid type.
    """
    rows, step = message.width * message.height, message.point_step
    order = '>' if message.is_bigendian else '<'
    fields = {f.name: f for f in (message.fields if fields is None else fields)}
    if not all(1 <= f.datatype <= len(_KINDS) for f in fields.values()):
        raise ValueError(f'{what}: a field of no kind that PointField has')
    kinds = [np.dtype((f'{order}{_KINDS[f.datatype - 1]}', f.count) if f.count > 1 else
                      f'{order}{_KINDS[f.datatype - 1]}') for f in fields.values()]
    if len(message.data) < rows * step or any(
            f.offset + kind.itemsize > step for f, kind in zip(fields.values(), kinds)):
        raise ValueError(f'{what}: {len(message.data)} bytes for {rows} rows of {step} bytes')
    dtype = np.dtype({'names': list(fields), 'formats': kinds,
                      'offsets': [f.offset for f in fields.values()], 'itemsize': step})
    return np.frombuffer(bytes(message.data), dtype, rows)
