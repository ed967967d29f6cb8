"""The messages of a pointing run: a PointCloud2, one point an observation, and back."""

import numpy as np

from msg_tools.tables import cloud_to_table, table_to_cloud

from .run import REQUIRED, PointingRun


def run_to_cloud(run, ns):
    """A PointCloud2, one point an observation: x, y, z on the unit sphere, then its columns.

    Parameters
    ----------
    run : PointingRun
        Numeric columns only.
    ns : int
        Stamp.
    """
    az, el = run['az'], run['el']
    return table_to_cloud(run.columns, ns, [
        np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])


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
    return PointingRun(cloud_to_table(message, REQUIRED, 'observation'))
