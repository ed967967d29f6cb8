"""Which rows are kept by who runs for months: those of the last power-ons."""

import numpy as np

from msg_tools.params import Param

KEPT_POWER_ONS = Param(
    'kept_power_ons', 10, 'power-ons of the encoder whose rows are kept, the last ones: memory and '
    'the time of a fit stay as they are over months; the log has all rows. 0: all', 0, 100000,
    fixed=True)


def first_of_last(runs, count):
    """The first row that is kept: from there on there are `count` power-ons.

    Parameters
    ----------
    runs : array_like, shape (n,)
        Number of the power-on of each row, in the order in which they were taken.
    count : int
        Power-ons to keep; 0: all.

    Returns
    -------
    int
        0 where none is left out.
    """
    if not count:
        return 0
    runs = np.asarray(runs)
    # of each power-on the last row, the newest first
    last = np.sort(len(runs) - 1 - np.unique(runs[::-1], return_index=True)[1])[::-1]
    return int(last[count]) + 1 if len(last) > count else 0


def kept_words(runs, count):
    """That older rows have no part in something, a sentence; '' where there can be none.

    Parameters
    ----------
    runs : array_like
        Numbers of the power-ons that are there.
    count : int
        As of `first_of_last`.
    """
    if not count or len(np.unique(runs)) < count:
        return ''
    return (f'of the last {count} power-ons alone (kept_power_ons): rows of earlier ones, if there '
            'are any, are in the log')
