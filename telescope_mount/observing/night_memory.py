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

"""The rows of the night in memory, one per observation; for their content see `exposure`."""

from array import array
from itertools import zip_longest

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.mounts import ALTAZ
from pointing_model.rms import rms
from pointing_model.runs.run import PointingRun, first_of_last
from pointing_model.zero import MARK

#: columns needed to resume a night
NEEDED = ('time', 'run', 'block', 'star')


class NightMemory:
    """Rows by the names of `run.COLUMNS`, and their ``stamp`` in ns.

    A row takes 8 bytes per column, instead of 2 kB as a dict. Rows are numbered from the first of
    the night, whether it is still kept or not.

    Parameters
    ----------
    mount : Mount, optional
        Its axes define the angles.
    power_ons : int
        Number of power-ons whose rows are kept, the latest ones; 0: all.

    Attributes
    ----------
    forgotten : int
        Number of rows that are no longer kept.
    """

    def __init__(self, mount=ALTAZ, power_ons=0):
        self._meta = {} if mount.vertical else {'mount': mount}
        self._given, self._power_ons = 0, power_ons
        self.rows = ()

    def __len__(self):
        return self.forgotten + len(self._rows)

    @property
    def rows(self):
        """The kept rows, list of dict: names to numbers, and ``stamp``."""
        return self.rows_from(0)

    @rows.setter
    def rows(self, rows):
        self._names, self._rows, self.forgotten = [], [], 0
        for row in rows:
            self._take(row)

    def rows_from(self, first):
        """Rows from number `first` on, like `rows`; negative numbers count from the end."""
        if first >= 0:
            first = max(0, first - self.forgotten)
        return [{'stamp': stamp, **dict(zip_longest(self._names, values, fillvalue=np.nan))}
                for stamp, values in self._rows[first:]]

    def latest(self, names, count):
        """Columns of the last `count` rows, for a `PointingRun`."""
        return {name: self._column(name, -count) for name in names}

    def _take(self, row):
        # columns that a parameter adds during the night are missing in earlier rows
        self._names += [name for name in row if name != 'stamp' and name not in self._names]
        self._rows.append((row['stamp'], array('d', [
            row.get(name, 0.0 if name == MARK else np.nan) for name in self._names])))
        runs = self._column('run')
        if self._power_ons and len(runs) > 1 and runs[-1] != runs[-2]:
            old = first_of_last(runs, self._power_ons)
            del self._rows[:old]
            self.forgotten += old

    def newest_rows(self, power_ons):
        """Number of kept rows of the last `power_ons` power-ons; 0: of all."""
        return len(self._rows) - first_of_last(self._column('run'), power_ons)

    def _column(self, name, first=0):
        place = self._names.index(name) if name in self._names else np.inf
        return np.array([values[place] if place < len(values) else np.nan
                         for _, values in self._rows[first:]], float)

    def restore(self, run, stamp, before=0):
        """Take the rows of the night so far from another table.

        Parameters
        ----------
        run : PointingRun
            With the column ``time``.
        stamp : int
            Stamp of the last row, ns: its time in seconds is not exact.
        before : int
            Number of rows of the night that were not kept.

        Raises
        ------
        ValueError
            A column is missing: not rows of an observer.
        """
        missing = [name for name in NEEDED if name not in run.columns]
        if missing:
            raise ValueError(f'rows of the night without column {", ".join(missing)}: they are of '
                             'no observer')
        stamps = [round(time * 1e9) for time in run['time'].tolist()]
        stamps[-1] = stamp
        self.rows = ({'stamp': at, MARK: 0.0, **{name: float(values[i]) for name, values in
                                                 run.columns.items()}}
                     for i, at in enumerate(stamps))
        self.forgotten += before

    def trailing(self, block):
        """Number of trailing rows that are of step `block` of the plan."""
        others = np.flatnonzero(self._column('block') != block)
        return len(self._rows) - (int(others[-1]) + 1 if len(others) else 0)

    def add(self, row):
        """Add a row; returns it as a PointingRun of one row."""
        self._take(row)
        return PointingRun({name: np.array([value], float) for name, value in row.items()
                            if name != 'stamp'}, self._meta)

    @property
    def newest(self):
        """Stamp of the last row, ns; 0 without rows."""
        return self._rows[-1][0] if self._rows else 0

    def stars_since(self, stamp):
        """Numbers of the stars observed since `stamp` (ns), a set."""
        return {int(star) for (when, _), star in zip(self._rows, self._column('star'))
                if when >= stamp}

    def last_stars(self, count):
        """Numbers of the stars of the last `count` rows, a set."""
        return set(self._column('star')[-count:].astype(int).tolist())

    def last_of(self, run):
        """The last row, if it is of power-on `run`, else None."""
        last = self.rows_from(-1)
        return last[0] if last and last[0]['run'] == run else None

    def all(self, again=False):
        """The kept rows, a PointingRun; None if unchanged since the last call, unless `again`."""
        if not self._rows or (len(self) == self._given and not again):
            return None
        self._given = len(self)
        return PointingRun({name: self._column(name) for name in self._names}, self._meta)


CHECKS_FORMAT = 'telescope_mount/blind_checks'
CHECKS_VERSION = 1


def blind_summary(miss, lost=0, model=None):
    """RMS of the miss distances of new stars pointed at blind: the pointing error.

    Parameters
    ----------
    miss : array_like, shape (n, 2)
        Star - boresight towards +A and +E, rad, of first exposures, with active model and zero
        and without centring.
    lost : int
        Stars that were not in the field, not included in the statistics.
    model : PointingModel, optional
        The active model.

    Returns
    -------
    dict
        ``stars``, ``lost``, ``rms_arcsec`` (radial), ``rms_x_arcsec``, ``rms_y_arcsec``,
        ``mean_x_arcsec``, ``mean_y_arcsec``, ``max_arcsec``, None without stars; ``terms`` and
        ``effects`` of the model.
    """
    miss = np.asarray(miss, dtype=float).reshape(-1, 2) / ARCSEC
    names = ('rms_arcsec', 'rms_x_arcsec', 'rms_y_arcsec', 'mean_x_arcsec', 'mean_y_arcsec',
             'max_arcsec')
    values = [None] * len(names)
    if len(miss):
        x, y = miss.T
        values = [rms(x, y), rms(x), rms(y), x.mean(), y.mean(), np.hypot(x, y).max()]
    return {'stars': len(miss), 'lost': int(lost),
            **{n: None if v is None else float(v) for n, v in zip(names, values)},
            'terms': list(model.terms) if model else [],
            'effects': [e.effect.name for e in model.effects] if model else []}
