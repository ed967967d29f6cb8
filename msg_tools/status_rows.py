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

"""Rows of status messages for programs: one description for writers and readers.

All other contents of a DiagnosticStatus are for people and may change at any time. The rows about
endpoints on `/endpoints` are described in `readiness`.
"""

import json
from dataclasses import dataclass, fields
from typing import NamedTuple

#: rows of `calibration/status`, see `Taken`
OBSERVATIONS, POWER_ONS, FORGOTTEN, NEWEST = ('observations', 'kept_power_ons', 'forgotten',
                                              'newest_ns')
#: rows of `calibration/status` for a restarted observer: number of observations on
#: `calibration/table`, and the progress of its plan
GIVEN_BACK, PLAN_LEFT = 'given_back', 'plan_left'


@dataclass
class Progress:
    """Progress of a plan: the rows of `observer/status`, with the names of these fields.

    Attributes
    ----------
    state : str
        ``waiting``, ``observing``, ``done``, ``failed`` or ``cancelled``.
    step : str
        Current step of the plan.
    block : int
        Number of the current block.
    done, total : int
        Exposures in it.
    observations, lost : int
        Rows published, and stars not found, in the whole plan.
    run : int
        Number of the power-on.
    plan : str
        All steps, separated by commas; '' in older logs.
    refused : int
        Targets refused by the guard in the whole plan; 0 in older logs.
    forgotten : int
        Rows published in power-ons so old that the observer has dropped them; 0 in older logs.
    """

    state: str = 'waiting'
    step: str = ''
    block: int = 0
    done: int = 0
    total: int = 0
    observations: int = 0
    run: int = 0
    lost: int = 0
    plan: str = ''
    refused: int = 0
    forgotten: int = 0

    @property
    def steps(self):
        """Number of steps in the plan."""
        return sum(bool(part.strip()) for part in self.plan.split(','))

    def rows(self):
        """Keys and values of the rows, dict."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def read(cls, message):
        """The inverse of `rows`, from a DiagnosticStatus; None, before the first, gives zeros.

        Raises
        ------
        ValueError
            A row is missing, or not a number.
        """
        if message is None:
            return cls()
        rows = {'plan': '', 'refused': 0, 'forgotten': 0,
                **{row.key: row.value for row in message.values}}
        return cls(**{field.name: field.type(_row(rows, field.name)) for field in fields(cls)})


class Taken(NamedTuple):
    """Observations received by the calibration.

    Attributes
    ----------
    kept : int
        Number of observations it has now.
    power_ons : int
        Number of last power-ons that these come from; 0: all.
    forgotten : int
        Number of observations it has dropped.
    newest : int
        Stamp of the newest, ns; 0: there is none, or it is not reported.
    """

    kept: int = 0
    power_ons: int = 0
    forgotten: int = 0
    newest: int = 0

    def has(self, count, newest):
        """Whether it has `count` observations of its power-ons, the newest with that stamp (ns).

        The count alone is not enough: it becomes smaller at a new power-on.
        """
        return self.kept >= count and (self.newest >= newest or not self.newest)

    def rows(self):
        """Keys and values of the rows, dict."""
        return dict(zip((OBSERVATIONS, POWER_ONS, FORGOTTEN, NEWEST), self))

    @classmethod
    def read(cls, message):
        """The inverse of `rows`, from a DiagnosticStatus; None, before the first, gives zeros.

        Raises
        ------
        ValueError
            A row is missing, or not a number.
        """
        if message is None:
            return cls()
        rows = {row.key: row.value for row in message.values}
        return cls(int(_row(rows, OBSERVATIONS)), int(rows.get(POWER_ONS, 0)),
                   int(rows.get(FORGOTTEN, 0)), int(rows.get(NEWEST, 0)))


class Stage(NamedTuple):
    """Progress of long work: rows of `calibration/status` during a diagnosis.

    Attributes
    ----------
    stage : str
        Current stage; '' if not reported.
    done, total : int
        Its parts; a total of 0 is unknown.
    """

    stage: str = ''
    done: int = 0
    total: int = 0

    def __str__(self):
        return self.stage + (f', {self.done} of {self.total}' if self.total else '')

    @classmethod
    def read(cls, message):
        """The stage in a DiagnosticStatus with these rows; None if it has none.

        Raises
        ------
        ValueError
            A row is missing, or not a number.
        """
        rows = {row.key: row.value for row in message.values}
        if 'stage' not in rows:
            return None
        return cls(rows['stage'], int(_row(rows, 'done')), int(_row(rows, 'total')))


def handover_rows(count, progress):
    """Rows with which the calibration returns a night to an observer that has lost it.

    Parameters
    ----------
    count : int
        Number of observations in the accompanying table.
    progress : Progress or None
        Last received progress of the plan.

    Returns
    -------
    dict of str to str
    """
    return {GIVEN_BACK: str(count), PLAN_LEFT: json.dumps(progress and progress.rows())}


def handover(message):
    """The inverse of `handover_rows`.

    Returns
    -------
    (int, Progress or None) or None
        None if the status returns nothing.

    Raises
    ------
    ValueError
        The rows are damaged.
    """
    rows = {row.key: row.value for row in message.values}
    if GIVEN_BACK not in rows:
        return None
    try:
        left = json.loads(_row(rows, PLAN_LEFT))
        progress = None if left is None else Progress(**left)
        if progress and any(type(getattr(progress, field.name)) is not field.type
                            for field in fields(Progress)):
            raise TypeError
        return int(rows[GIVEN_BACK]), progress
    except (TypeError, RecursionError):
        raise ValueError(f'status with a {PLAN_LEFT} that is none') from None


def _row(rows, key):
    if key not in rows:
        raise ValueError(f'status without the row {key}')
    return rows[key]
