"""The rows of the night, one an observation."""

import numpy as np

from ..mounts import ALTAZ
from ..run import PointingRun
from ..zero_exposures import MARK

#: of each row, to go on with a night
NEEDED = ('time', 'run', 'block', 'star')


class Table:
    """Rows as dicts by the names of `run.COLUMNS`, and their ``stamp`` in ns.

    Parameters
    ----------
    mount : Mount, optional
        Whose axes the angles are of.
    """

    def __init__(self, mount=ALTAZ):
        self.rows = []
        self._meta = {} if mount.altaz else {'mount': mount}
        self._given = 0

    def __len__(self):
        return len(self.rows)

    def restore(self, run, stamp):
        """Take the rows of the night so far, of another table.

        Parameters
        ----------
        run : PointingRun
            With the column ``time``.
        stamp : int
            Of the last row, ns: as seconds it is not known to the last one.

        Raises
        ------
        ValueError
            A column is missing: these are no rows of an observer.
        """
        missing = [name for name in NEEDED if name not in run.columns]
        if missing:
            raise ValueError(f'rows of the night without column {", ".join(missing)}: they are of '
                             'no observer')
        stamps = [round(time * 1e9) for time in run['time'].tolist()]
        stamps[-1] = stamp
        self.rows = [{'stamp': at, MARK: 0.0, **{name: float(values[i]) for name, values in
                                      run.columns.items()}} for i, at in enumerate(stamps)]

    def trailing(self, block):
        """How many of the last rows are of step `block` of the plan."""
        count = 0
        while count < len(self.rows) and self.rows[-1 - count]['block'] == block:
            count += 1
        return count

    def add(self, row):
        """Keep a row; as a run of its own, PointingRun."""
        self.rows.append(row)
        return self._run([row])

    @property
    def newest(self):
        """Stamp of the last row, ns; 0 without one."""
        return self.rows[-1]['stamp'] if self.rows else 0

    def stars_since(self, stamp):
        """Numbers of the stars that were observed from `stamp` (ns) on, a set."""
        return {int(row['star']) for row in self.rows if row['stamp'] >= stamp}

    def last_stars(self, count):
        """Numbers of the stars of so many rows, the last ones, a set."""
        return {int(row['star']) for row in self.rows[-count:]}

    def last_of(self, run):
        """The last row, if it is of power-on `run`, else None."""
        return self.rows[-1] if self.rows and self.rows[-1]['run'] == run else None

    def all(self, again=False):
        """All rows, a PointingRun; None where they were given before, unless `again`."""
        if not self.rows or (len(self.rows) == self._given and not again):
            return None
        self._given = len(self.rows)
        return self._run(self.rows)

    def _run(self, rows):
        # what a parameter adds in the night, the rows before have not
        names = [name for name in dict.fromkeys(n for row in rows for n in row) if name != 'stamp']
        return PointingRun({name: np.array([row.get(name, np.nan) for row in rows], float)
                            for name in names}, self._meta)
