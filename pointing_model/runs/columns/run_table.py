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

"""`RunTable`, the result of the readers of pointing runs, and functions that they share."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mount_kinds import KINDS, MountKind
from pointing_model.mounts import ALTAZ
from pointing_model.runs.run import COLUMNS, column_name

from .cell_values import Exclusions

#: columns that a file may have in place of `az, el` and the encoder angles, and their units in SI;
#: they keep the file's name, which is reserved
SPECIAL = {'ra_deg': DEG, 'dec_deg': DEG, 'ra_enc_deg': DEG, 'x_arcsec': ARCSEC,
           'y_arcsec': ARCSEC, 'lst_given': DEG}
#: names that a diagnosis computes itself: see `pointing_model.context.Context`
DERIVED = frozenset((
    'azimuth', 'elevation', 'row', 'ra', 'dec', 'lst', 'order', 'pm_x', 'pm_y', 'reading_az',
    'reading_el', 'unwrapped_az', 'unwrapped_el', 'travel_az', 'travel_el', 'slew_az', 'slew_el',
    'before_az', 'before_el', 'run_hours', 'counterweight',
    *(key for kind in KINDS.values() for key in kind.keys)))
_HOURS_OF_A_DAY = 24.0
_RADIANS = 6.3  # a little more than a turn


#: first bytes of files that are not text, and what they are
_BINARY = {b'\x89MCAP': 'an MCAP log', b'PAR1': 'a Parquet file', b'SIMPLE  =': 'a FITS file',
           b'\x89HDF': 'an HDF5 file', b'\x1f\x8b': 'compressed (gzip)',
           b'PK\x03\x04': 'a workbook of a spreadsheet or an archive',
           b'\xd0\xcf\x11\xe0': 'a workbook of a spreadsheet'}


#: what to say of a file without a table
EMPTY = '{} is empty: give a header row, and a row for each observation'


class NoObservations(ValueError):
    """A valid file without rows."""


#: `RunFormat.taken` of formats with column names
AS_NAMED = 'the columns were taken as the file names them'


class RunFormat(NamedTuple):
    """A format of run files; each module of `runs.formats` declares one as `FORMAT`.

    Attributes
    ----------
    wording : str
        Name of the format, for people.
    looks_like : callable
        Returns whether the lines of a file have this format.
    read : callable
        Returns the `RunTable` of a path and its lines.
    taken : str
        Which columns were taken as catalogue and as mount, for people.
    rank : int
        Formats of lower rank are tried first: 0 for files that only one log or program writes.
    of_encoder : bool
        Whether `read` has a third argument, the encoder that is wanted.
    """

    wording: str
    looks_like: Callable
    read: Callable
    taken: str = 'the columns were taken as this format has them'
    rank: int = 0
    of_encoder: bool = False


@dataclass
class RunTable(Exclusions):
    """A run as in the file: every row, in the file's units and sense of azimuth.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        Keys are the names of `pointing_model.runs.run.COLUMNS` and `SPECIAL`; others are drivers.
    lines : ndarray of int, shape (n,)
        Line of the file that each row begins on, from 1.
    meta : dict
        ``format``, ``notes`` and other data of the file.
    reasons : ndarray of object, shape (n,), optional
        Why a row is excluded, 0 if it is not.
    commented : list of int
        Lines with an observation that is commented out.
    names : MountKind
        Names of the axes in the file's columns.
    written : dict of str to ndarray, shape (n,)
        Axis angles as in the file, if those of `columns` were placed beyond the pole or zenith;
        ``beyond``: whether the column ``pier_side`` puts the row through the pole.
    """

    columns: dict
    lines: np.ndarray
    meta: dict
    reasons: np.ndarray = None
    commented: list = field(default_factory=list)
    names: MountKind = ALTAZ.names
    written: dict = field(default_factory=dict)

    def label(self, name):
        """Name of a column in the file."""
        return column_name(name, self.names)

    def __post_init__(self):
        if self.reasons is None:
            self.reasons = np.zeros(len(self.lines), dtype=object)


def read_lines(path):
    """Lines of a text file, numbered as an editor does.

    Raises
    ------
    ValueError
        The path is a folder, or the file is an MCAP log, empty or binary.
    OSError
        The file cannot be read.
    """
    if path.is_dir():
        raise ValueError(f'{path} is a folder, not a file with a table')
    return lines_of(path, path.read_bytes())


def lines_of(path, data):
    """Lines of a text file from its bytes, see `read_lines`; `path` is for messages."""
    for begin, what in _BINARY.items():
        if data.startswith(begin):
            raise ValueError(f'{path} is {what}: save its table as CSV and give that')
    if not data.strip():
        raise ValueError(EMPTY.format(path))
    if data.startswith((b'\xff\xfe', b'\xfe\xff')):  # what some spreadsheets call Unicode text
        try:
            data = data.decode('utf-16').encode()
        except UnicodeDecodeError:
            raise ValueError(f'{path} is UTF-16 and breaks off; save it as CSV in UTF-8') from None
    # control characters other than tab, newline, form feed, carriage return, DOS end of file
    if re.search(rb'[\x00-\x08\x0b\x0e-\x19\x1b-\x1f]', data):
        raise ValueError(f'{path} is a binary file, not a table')
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError:
        text = data.decode('latin-1')
    # str.splitlines would also break at form feeds and Unicode separators
    lines = re.split(r'\r\n|\n|\r', text.replace('\x1a', ''))
    if re.fullmatch(r'"?sep=[,;\t]"?', lines[0].strip(' ')):  # Excel's separator line
        lines[0] = ''
    return lines


def content(lines, comment='#'):
    """(line number, text) of lines that are neither blank nor comments."""
    return [(number, line) for number, line in enumerate(lines, 1)
            if line.strip() and not line.lstrip().startswith(comment)]


def own_name(name, taken, notes):
    """Name under which a user's column is kept.

    Parameters
    ----------
    name : str
        In the file.
    taken : collection of str
        All names in the file.
    notes : list of str
        Gets a note if the column is renamed.

    Returns
    -------
    str
    """
    if name not in DERIVED and name not in COLUMNS and name not in SPECIAL:
        return name
    new = f'column_{name}'
    while new in taken:
        new = f'column_{new}'
    notes.append(f'column {name!r} is kept as {new!r}: {name} is a reserved name')
    return new


def numbered_runs(names, notes):
    """Number named runs in order of appearance; a note lists the numbers."""
    numbers = {name: i for i, name in enumerate(dict.fromkeys(names), 1)}
    notes.append('runs are numbered: ' + ', '.join(
        f'{i} {name[:40]!r}' for name, i in numbers.items()))
    return np.array([numbers[name] for name in names])


def sidereal_name(values, taken, notes):
    """Name under which a column ``lst`` is kept, from its unit (hours or radians).

    Parameters
    ----------
    values : ndarray, shape (n,)
    taken : collection of str
        All names in the file.
    notes : list of str
        Gets a note on the choice.

    Returns
    -------
    str
    """
    known = values[np.isfinite(values)]
    low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
    if 'lst_h' in taken or low < -_RADIANS or high > _HOURS_OF_A_DAY or (
            low < 0.0 and high > _RADIANS):
        notes.append('lst_h is the name of the sidereal time, in hours')
        return own_name('lst', taken, notes)
    if high > _RADIANS:
        notes.append(f"column 'lst' goes to {high:.4g}: taken as hours, kept as lst_h")
        return 'lst_h'
    notes.append(f"column 'lst' never exceeds {_RADIANS}: taken as radians; call it lst_h if it is "
                 'in hours')
    return 'lst'
