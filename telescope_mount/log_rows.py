"""Rows of a night that its nodes do not keep any more, from its logs."""

from contextlib import suppress

from msg_tools import topics
from msg_tools.bag import BagReader
from msg_tools.bag.names import prefix_of
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import cloud_to_run


def with_rows_before(kept, folder):
    """Rows of a night with all that came before them.

    Parameters
    ----------
    kept : PointingRun
        With the column ``time``.
    folder : Path
        Of the night: its logs are ``bag*`` in it, one for each time that it was started.

    Returns
    -------
    PointingRun
        What cannot be read is left out.
    """
    rows = {}
    for path in sorted(folder.glob('bag*')):
        with suppress(ValueError, OSError):  # one that was killed may be damaged
            rows.update(_rows_of(path))
    before = [rows[time] for time in sorted(rows) if time < kept['time'][0]]
    return PointingRun.concatenate([*before, kept])


def _rows_of(path):
    """Time and row of each observation of a log, but of that of the simulator's truth."""
    log = BagReader(path)
    if log.has_truth:
        return
    for message in log.messages(f'{prefix_of(log)}{topics.OBSERVATION.name}', decode=True):
        row = cloud_to_run(message.data)
        yield row['time'][0], row
