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

"""The night so far on disk, so that a killed observer can resume it.

One line of JSON per row and per change of the plan's state, each on disk before it is published. A
line that a crash has truncated is ignored.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple

from msg_tools.status_rows import Progress
from msg_tools.whole_files import reason

FORMAT, VERSION = 'telescope_mount plan state', 1


class NightState(NamedTuple):
    """Content of a file.

    Attributes
    ----------
    rows : list of dict
        Rows of the night, see `NightMemory`.
    left : Progress or None
        State of its plan.
    evening : int
        Begin of the night, ns.
    before : int
        Number of rows of earlier plans.
    """

    rows: list = []
    left: Progress | None = None
    evening: int = 0
    before: int = 0


class NightFile:
    """Stores the rows and the state of the plan of one night.

    Parameters
    ----------
    path : str or Path
        '': nothing is stored.
    mount : str
        Kind of the mount: rows of another one are refused.

    Attributes
    ----------
    kept : NightState
        Content of the file at the start.
    error : str
        Disk error, '' if none. The night continues, and waiting lines are written when there is
        room again.

    Raises
    ------
    ValueError
        Not such a file, or one of another mount.
    OSError
        It cannot be read or written.
    """

    def __init__(self, path='', mount=''):
        self._path, self._mount, self._file = path and Path(path), mount, None
        self._last, self._whole, self._waiting, self.error = None, 0, b'', ''
        self.kept = self._read() if path else NightState()

    def _read(self):
        rows, left, evening, before = [], None, 0, 0
        try:
            lines = self._path.read_bytes().split(b'\n')
        except FileNotFoundError:
            return NightState()
        self._whole = sum(len(line) + 1 for line in lines[:-1])  # the last line was truncated
        for number, line in enumerate(lines[:-1], 1):
            try:
                entry = json.loads(line)
                if number == 1:
                    self._check(entry)
                elif 'row' in entry:
                    rows.append(entry['row'])
                else:
                    left, evening, before = (
                        Progress(**entry['plan']), entry['evening'], entry['before'])
            except (ValueError, TypeError, KeyError) as err:
                raise ValueError(f'{self._path}, line {number}: {err}; remove the file to begin '
                                 'anew') from None
        return NightState(rows, left, evening, before)

    def _check(self, head):
        if (head['format'], head['version']) != (FORMAT, VERSION):
            raise ValueError('not the state of a plan')
        if head['mount'] != self._mount:
            raise ValueError(f'the state of a plan of a mount {head["mount"]}, and this one is '
                             f'{self._mount}')

    def forget(self):
        """Start again; the old file is renamed."""
        self.close()
        if self._path and self._path.exists():
            self._path.replace(self._path.with_name(self._path.name + '.before'))
        self._whole, self._waiting, self.kept = 0, b'', NightState()

    def row(self, row):
        """Store a row, a dict."""
        self._write({'row': row})

    def plan_state(self, progress, evening, before):
        """Store the state of the plan; see `NightState`."""
        if not self._path:
            return
        entry = {'plan': progress.rows(), 'evening': evening, 'before': before}
        place = {**entry['plan'], 'observations': 0, 'run': 0}
        if progress.state == 'waiting':
            place['state'] = 'observing'
        if (place, evening) != self._last:
            self._last = place, evening
            self._write(entry)

    def _write(self, entry):
        if not self._path:
            return
        if self._file is None:
            self._file = self._path.open('ab', buffering=0)
        if not self._whole and not self._waiting:
            self._waiting = _line({'format': FORMAT, 'version': VERSION, 'mount': self._mount})
        self._waiting += _line(entry)
        try:
            self._file.truncate(self._whole)  # drop a truncated line
            rest = memoryview(self._waiting)
            while rest:
                rest = rest[self._file.write(rest):]
            os.fsync(self._file.fileno())
        except OSError as err:
            self.error = f'the state of the plan is not kept: {self._path}: {reason(err)}'
        else:
            self._whole += len(self._waiting)
            self._waiting, self.error = b'', ''

    def close(self):
        """Close the file."""
        if self._file is not None:
            self._file.close()
        self._file = None


def _line(entry):
    return json.dumps(entry, default=float).encode() + b'\n'
