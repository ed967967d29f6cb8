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

"""The rows of a calibration, of the last power-ons, in order."""

import numpy as np

from msg_tools.status_rows import Taken
from pointing_model.runs.run import REQUIRED, PointingRun

from .rows import by_power_on, check_mount, with_marks


class RowTable:
    """Rows of one mount, a block for each power-on.

    Columns are those that all rows have.

    Parameters
    ----------
    power_ons : int
        Number of power-ons (column ``run``), the last ones, whose rows are kept; 0: all.

    Attributes
    ----------
    last_stamp : int
        Stamp of the newest row, ns; 0 before the first.
    forgotten : int
        Number of dropped rows, of earlier power-ons.
    """

    def __init__(self, power_ons=0):
        self.power_ons = power_ons
        self.last_stamp = self.forgotten = 0
        self._blocks = {}  # number of the power-on -> its rows, and the stamp of each on arrival

    def __len__(self):
        return sum(len(rows) for rows, _ in self._blocks.values())

    @property
    def power_on_numbers(self):
        """Numbers of the power-ons with rows, ascending."""
        return sorted(self._blocks)

    @property
    def newest(self):
        """Number of the newest power-on; ValueError before the first row."""
        self._check_any()
        return self.power_on_numbers[-1]

    @property
    def mount(self):
        """`Mount` of the rows; None before the first."""
        return next((rows.mount for rows, _ in self._blocks.values()), None)

    @property
    def taken(self):
        """Numbers of rows kept and dropped, a `msg_tools.status_rows.Taken`."""
        return Taken(len(self), self.power_ons, self.forgotten, self.last_stamp)

    def add(self, run, stamp):
        """Add rows; those not newer than the newest row are ignored as known.

        Parameters
        ----------
        run : PointingRun
            With columns `star` and `run`.
        stamp : int
            Stamp of the newest row, ns.

        Raises
        ------
        ValueError
            A column is missing, or the rows are of another mount.
        """
        self._check(run)
        if stamp <= self.last_stamp:
            return
        self.last_stamp = stamp
        for number, rows in by_power_on(with_marks(run)).items():
            stamps = np.full(len(rows), stamp, np.int64)
            if int(number) in self._blocks:
                before, came = self._blocks[int(number)]
                rows = PointingRun.concatenate([before, rows])
                stamps = np.concatenate([came, stamps])
            self._blocks[int(number)] = rows, stamps
        if self.power_ons:
            for number in self.power_on_numbers[:-self.power_ons]:
                self.forgotten += len(self._blocks.pop(number)[0])

    def add_table(self, run, stamp):
        """Add the table of all rows so far, if it has more rows.

        Parameters
        ----------
        run : PointingRun
            All rows of the night, or of its last power-ons; rows of earlier ones are kept.
        stamp : int
            Stamp of the newest row, ns.

        Returns
        -------
        int
            Number of new rows.

        Raises
        ------
        ValueError
            See `add`.
        """
        count, new = self.missing(run)
        if stamp < self.last_stamp or count <= 0:
            return 0
        if new is None:
            new = self.last_of(run)
            for number in by_power_on(new):
                self._blocks.pop(int(number), None)
        self.last_stamp = 0
        self.add(new, stamp)
        return count

    def last_of(self, table):
        """The rows of a table that would be kept, of its last power-ons."""
        numbers = np.unique(table['run'])[-self.power_ons:]  # 0: all
        return table.select(np.isin(table['run'], numbers))

    def missing(self, table):
        """Rows of a table that are not known yet.

        Parameters
        ----------
        table : PointingRun
            All rows of some power-ons.

        Returns
        -------
        count : int
            Number of missing rows; 0 or less: none.
        rows : PointingRun or None
            The missing rows, if they follow the known ones; None if some in between are missing.

        Raises
        ------
        ValueError
            See `add`.
        """
        self._check(table)
        table = self.last_of(table)
        here = [self._blocks[int(number)][0] for number in by_power_on(table)
                if int(number) in self._blocks]
        known = sum(map(len, here))
        count = len(table) - known
        if count <= 0 or any(not np.array_equal(np.concatenate([rows[name] for rows in here]),
                                                table[name][:known])
                             for name in REQUIRED if known):
            return count, None
        return count, table.select(slice(known, None))

    def all(self, until=0, number=None):
        """Rows so far, a PointingRun.

        Parameters
        ----------
        until : int
            Only rows received by that stamp (ns), if there were any; 0: all.
        number : int, optional
            Only rows of that power-on.

        Raises
        ------
        ValueError
            There are none.
        """
        self._check_any()
        numbers = self.power_on_numbers if number is None else [number]
        blocks = [self._blocks[one] for one in numbers]
        run = PointingRun.concatenate([rows for rows, _ in blocks])
        come = np.concatenate([stamps for _, stamps in blocks]) <= until
        return run.select(come) if until and come.any() else run

    def _check_any(self):
        if not self._blocks:
            raise ValueError('no observation has come yet; observe first')

    def _check(self, run):
        for name in ('star', 'run'):
            if name not in run:
                raise ValueError(f'observation without column {name}')
        check_mount(run.mount, {'the observations before': self.mount})
