"""What goes over many rows, by parts that stay in the cache.

A million rows have designs of 100 MB and residuals of 16 MB: each pass over them takes as long as
the memory gives, and each new array as long as the system takes to give its pages.
"""

import numpy as np

#: rows at a time; an array of them is smaller than what `msg_tools.memory` keeps apart
BLOCK = 16_000
#: values up to which a call of numpy costs more than it works on
FEW = 20_000
#: values, x and y, from which a fit goes by parts: its design is 8 MB then
MANY = 150_000


def parts(n):
    """Slices of `n` rows, one after the other."""
    return (slice(i, min(i + BLOCK, n)) for i in range(0, n, BLOCK))


def largest(values):
    """The largest absolute value."""
    if len(values) < FEW:
        return float(np.maximum.reduce(np.abs(values)))
    return max(float(values.max()), -float(values.min()))


def apart(a, b):
    """The largest absolute difference of two arrays."""
    if len(a) < FEW:
        return largest(a - b)
    # NaN where one is: max() alone would lose it
    return float(np.max([largest(a[part] - b[part]) for part in parts(len(a))]))


def change(values, step, rows, out):
    """``values - step @ rows``, in `out`; the largest absolute change.

    Parameters
    ----------
    values, out : ndarray, shape (m,)
        `out` may be `values`.
    step : ndarray, shape (k,)
    rows : ndarray, shape (k, m)
    """
    far = []
    for part in parts(len(values)):
        moved = step @ rows[:, part]
        far.append(max(float(moved.max()), -float(moved.min())))
        np.subtract(values[part], moved, out=out[part])
    return float(np.max(far))
