"""Rows of named numbers in a message: a PointCloud2 with a float64 field for each column."""

import numpy as np

from .convert import MOUNT_FRAME, to_stamp

_FLOAT32, _FLOAT64 = 7, 8  # PointField.FLOAT32, FLOAT64


def table_to_cloud(columns, ns, points=None, frame=MOUNT_FRAME):
    """A PointCloud2, one point a row.

    Parameters
    ----------
    columns : dict of str to array_like, shape (n,)
        Numbers.
    ns : int
        Stamp.
    points : array_like, shape (3, n), optional
        x, y, z for programs that draw the points, ahead of the columns as float32.
    frame : str
        ``frame_id`` of the message.
    """
    from sensor_msgs.msg import PointCloud2, PointField
    drawn = [] if points is None else list(zip('xyz', points))
    # so that the float64 begin at a multiple of 8 bytes
    pad = [('', '<f4')] if drawn else []
    dtype = np.dtype([*((name, '<f4') for name, _ in drawn), *pad,
                      *((name, '<f8') for name in columns)])
    rows = np.zeros(len(next(iter(columns.values()))), dtype)
    for name, values in [*drawn, *columns.items()]:
        rows[name] = values
    fields = [PointField(name=name, offset=dtype.fields[name][1], datatype=datatype, count=1)
              for names, datatype in (([name for name, _ in drawn], _FLOAT32),
                                      (columns, _FLOAT64)) for name in names]
    message = PointCloud2(height=1, width=len(rows), fields=fields, is_bigendian=False,
                          point_step=dtype.itemsize, row_step=dtype.itemsize * len(rows),
                          data=rows.tobytes(), is_dense=True)
    message.header.stamp = to_stamp(ns)
    message.header.frame_id = frame
    return message


def cloud_to_table(message, required=(), what='table'):
    """The float64 columns of a PointCloud2.

    Parameters
    ----------
    message : sensor_msgs.msg.PointCloud2
    required : iterable of str
        Columns that must be there.
    what : str
        What it is, for the error.

    Returns
    -------
    dict of str to ndarray, shape (n,)

    Raises
    ------
    ValueError
        A required column is missing, or the data do not fill the rows that are declared.
    """
    rows = message.width * message.height
    fields = {f.name: f.offset for f in message.fields if f.datatype == _FLOAT64 and f.count == 1}
    missing = [name for name in required if name not in fields]
    if missing:
        raise ValueError(f'{what} without float64 field {", ".join(missing)}')
    step = message.point_step
    if len(message.data) < rows * step or any(o + 8 > step for o in fields.values()):
        raise ValueError(f'{what}: {len(message.data)} bytes for {rows} rows of {step} bytes')
    order = '>' if message.is_bigendian else '<'
    dtype = np.dtype({'names': list(fields), 'formats': [f'{order}f8'] * len(fields),
                      'offsets': list(fields.values()), 'itemsize': step})
    data = np.frombuffer(bytes(message.data), dtype, rows)
    return {name: data[name].astype(float) for name in fields}
