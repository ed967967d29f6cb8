"""The messages of a pointing run: a PointCloud2, one point an observation, and back."""

import numpy as np

from msg_tools.convert import MOUNT_FRAME, to_stamp

from .run import REQUIRED, PointingRun

_FLOAT32, _FLOAT64 = 7, 8  # PointField.FLOAT32, FLOAT64


def run_to_cloud(run, ns):
    """A PointCloud2, one point an observation: x, y, z on the unit sphere, then its columns.

    Parameters
    ----------
    run : PointingRun
        Numeric columns only.
    ns : int
        Stamp.
    """
    from sensor_msgs.msg import PointCloud2, PointField
    names = list(run.columns)
    dtype = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('', '<f4'),
                      *((name, '<f8') for name in names)])
    rows = np.zeros(len(run), dtype)
    az, el = run['az'], run['el']
    rows['x'], rows['y'] = np.cos(el) * np.sin(az), np.cos(el) * np.cos(az)
    rows['z'] = np.sin(el)
    for name in names:
        rows[name] = run[name]
    fields = [PointField(name=n, offset=dtype.fields[n][1], datatype=_FLOAT32, count=1)
              for n in 'xyz']
    fields += [PointField(name=n, offset=dtype.fields[n][1], datatype=_FLOAT64, count=1)
               for n in names]
    message = PointCloud2(height=1, width=len(run), fields=fields, is_bigendian=False,
                          point_step=dtype.itemsize, row_step=dtype.itemsize * len(run),
                          data=rows.tobytes(), is_dense=True)
    message.header.stamp = to_stamp(ns)
    message.header.frame_id = MOUNT_FRAME
    return message


def cloud_to_run(message):
    """The float64 columns of a PointCloud2 of observations.

    Returns
    -------
    PointingRun

    Raises
    ------
    ValueError
        A required column is missing, or the data do not fill the rows that are declared.
    """
    rows = message.width * message.height
    fields = {f.name: f.offset for f in message.fields if f.datatype == _FLOAT64 and f.count == 1}
    missing = [name for name in REQUIRED if name not in fields]
    if missing:
        raise ValueError(f'observation without float64 field {", ".join(missing)}')
    step = message.point_step
    if len(message.data) < rows * step or any(o + 8 > step for o in fields.values()):
        raise ValueError(f'observation: {len(message.data)} bytes for {rows} rows of {step} bytes')
    order = '>' if message.is_bigendian else '<'
    dtype = np.dtype({'names': list(fields), 'formats': [f'{order}f8'] * len(fields),
                      'offsets': list(fields.values()), 'itemsize': step})
    data = np.frombuffer(bytes(message.data), dtype, rows)
    return PointingRun({name: data[name].astype(float) for name in fields})
