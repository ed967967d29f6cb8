"""The rows of the night, one an observation."""

import numpy as np

from ..run import PointingRun


class Table:
    """Rows as dicts by the names of `run.COLUMNS`, and their ``stamp`` in ns."""

    def __init__(self):
        self.rows = []
        self._given = 0

    def __len__(self):
        return len(self.rows)

    def add(self, row):
        """Keep a row; as a run of its own, PointingRun."""
        self.rows.append(row)
        return _run([row])

    @property
    def newest(self):
        """Stamp of the last row, ns; 0 without one."""
        return self.rows[-1]['stamp'] if self.rows else 0

    def stars_since(self, stamp):
        """Numbers of the stars that were observed from `stamp` (ns) on, a set."""
        return {int(row['star']) for row in self.rows if row['stamp'] >= stamp}

    def last_of(self, run):
        """The last row, if it is of power-on `run`, else None."""
        return self.rows[-1] if self.rows and self.rows[-1]['run'] == run else None

    def all(self, again=False):
        """All rows, a PointingRun; None where they were given before, unless `again`."""
        if not self.rows or (len(self.rows) == self._given and not again):
            return None
        self._given = len(self.rows)
        return _run(self.rows)


def _run(rows):
    names = [name for name in rows[0] if name != 'stamp']
    return PointingRun({name: np.array([row[name] for row in rows], float) for name in names})
