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

"""The rows of status messages that programs read: one description for writers and readers.

Whatever else is in a DiagnosticStatus is for people and may be worded anew at any time. The
rows about endpoints, which `/endpoints` carries, are those of `readiness`.
"""

import json
from dataclasses import dataclass, fields
from typing import NamedTuple

#: rows of `calibration/status`, see `Taken`
OBSERVATIONS, POWER_ONS, FORGOTTEN, NEWEST = ('observations', 'kept_power_ons', 'forgotten',
                                              'newest_ns')
#: rows of `calibration/status` after an observer came that knows nothing of the night: observations
#: on `calibration/table`, and where its plan stood
GIVEN_BACK, PLAN_LEFT = 'given_back', 'plan_left'


@dataclass
class Progress:
    """How far a plan is: the rows of `observer/status`, with the names of these fields.

    Attributes
    ----------
    state : str
        ``waiting``, ``observing``, ``done``, ``failed`` or ``cancelled``.
    step : str
        Of the plan.
    block : int
        Its number.
    done, total : int
        Exposures of it.
    observations, lost : int
        Rows published, stars not found, of the whole plan.
    run : int
        Number of the power-on.
    plan : str
        All steps, separated by commas; '' in older logs.
    refused : int
        Targets that the guard refused, of the whole plan; 0 in older logs.
    forgotten : int
        Rows published of power-ons so long ago that the observer does not keep them; 0 in older
        logs.
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
        """How many the plan has."""
        return sum(bool(part.strip()) for part in self.plan.split(','))

    def rows(self):
        """Key and value of each row, dict."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def read(cls, message):
        """The way back from a DiagnosticStatus with `rows`; None, before the first, is all zero.

        Raises
        ------
        ValueError
            A row is missing, or no number.
        """
        if message is None:
            return cls()
        rows = {'plan': '', 'refused': 0, 'forgotten': 0,
                **{row.key: row.value for row in message.values}}
        return cls(**{field.name: field.type(_row(rows, field.name)) for field in fields(cls)})


class Taken(NamedTuple):
    """Observations that the calibration has taken.

    Attributes
    ----------
    kept : int
        That it has.
    power_ons : int
        They are of the last so many power-ons; 0: of all.
    forgotten : int
        That it had before.
    newest : int
        Stamp of the newest, ns; 0: there is none, or it does not report it.
    """

    kept: int = 0
    power_ons: int = 0
    forgotten: int = 0
    newest: int = 0

    def has(self, count, newest):
        """Whether it has so many of the power-ons that it keeps, the newest of that stamp (ns).

        By their number alone it could not be determined: with a new power-on it becomes less.
        """
        return self.kept >= count and (self.newest >= newest or not self.newest)

    def rows(self):
        """Key and value of each row, dict."""
        return dict(zip((OBSERVATIONS, POWER_ONS, FORGOTTEN, NEWEST), self))

    @classmethod
    def read(cls, message):
        """The way back from a DiagnosticStatus with `rows`; None, before the first, is all 0.

        Raises
        ------
        ValueError
            It does not say, or is no number.
        """
        if message is None:
            return cls()
        rows = {row.key: row.value for row in message.values}
        return cls(int(_row(rows, OBSERVATIONS)), int(rows.get(POWER_ONS, 0)),
                   int(rows.get(FORGOTTEN, 0)), int(rows.get(NEWEST, 0)))


class Stage(NamedTuple):
    """How far long work is: rows of `calibration/status` while a diagnosis is under way.

    Attributes
    ----------
    stage : str
        What is done now; '' where it is not reported.
    done, total : int
        Its parts; of 0 nobody knows how many there are.
    """

    stage: str = ''
    done: int = 0
    total: int = 0

    def __str__(self):
        return self.stage + (f', {self.done} of {self.total}' if self.total else '')

    @classmethod
    def read(cls, message):
        """That of a DiagnosticStatus with rows of these names; None where it has none.

        Raises
        ------
        ValueError
            A row is missing, or no number.
        """
        rows = {row.key: row.value for row in message.values}
        if 'stage' not in rows:
            return None
        return cls(rows['stage'], int(_row(rows, 'done')), int(_row(rows, 'total')))


def handover_rows(count, progress):
    """Rows with which the calibration gives a night back to an observer that has lost it.

    Parameters
    ----------
    count : int
        Observations in the table that goes with them.
    progress : Progress or None
        The last that was heard of the plan.

    Returns
    -------
    dict of str to str
    """
    return {GIVEN_BACK: str(count), PLAN_LEFT: json.dumps(progress and progress.rows())}


def handover(message):
    """The way back from `handover_rows`.

    Returns
    -------
    (int, Progress or None) or None
        None where the status gives nothing back.

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
