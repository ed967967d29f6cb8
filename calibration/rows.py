"""Which rows a fit may see, and which are there to judge it by."""

import numpy as np

from pointing_model.run import PointingRun


def is_kept_out(rows):
    """Mask of the rows to judge by: those whose column ``check`` is not 0.

    The observer marks a row when it takes it, so that nothing has to be guessed from the plan.

    Parameters
    ----------
    rows : PointingRun

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return np.asarray(rows.get('check', 0.0), dtype=float) != 0.0


def for_fitting(rows):
    """The rows that fits and choices may see: no satellites, and nothing that is kept out.

    Parameters
    ----------
    rows : PointingRun
        With column `star`; negative: a satellite, which is for checks only.
    """
    return rows.select((rows['star'] >= 0) & ~is_kept_out(rows))


def with_check(rows):
    """The rows with a column ``check``: joined with others, they must not take theirs away."""
    if 'check' in rows:
        return rows
    return PointingRun({**rows.columns, 'check': np.zeros(len(rows))}, rows.meta)
