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

"""Rows of a file, and the rules for converting cells to numbers, the same for every format."""

import re
from collections import Counter

import numpy as np

from msg_tools.iso_time import read_iso

_BLOCK = 5000  # times parsed at once
#: cells that mean "no value", in lower case
UNKNOWN = ('', 'n/a', 'na', '-', '--', 'none', 'null', '?', 'unknown')
_POINT = re.compile(r'[-+]?\d*\.\d+(?:[eE][-+]?\d+)?', re.ASCII)
_COMMA = re.compile(r'[-+]?\d*,\d+(?:[eE][-+]?\d+)?', re.ASCII)
_NO_TIME = 'is neither ISO 8601 (2021-08-21T04:36:01.5Z) nor seconds since 1970'
YEAR_1900, YEAR_2100 = -2208988800.0, 4102444800.0  # s since 1970
CLOCK = 1e8  # s: smaller times count from an arbitrary start


class Exclusions:
    """Base class with ``reasons`` for excluding rows: ndarray of object, 0 for rows in use."""

    def exclude(self, mask, text):
        """Exclude the rows of `mask`; the first reason is kept."""
        self.reasons[mask & (self.reasons == 0)] = text

    def exclude_row(self, row, text):
        """Exclude a single row, by its index; the first reason is kept."""
        if self.reasons[row] == 0:
            self.reasons[row] = text


class TextRows(Exclusions):
    """Rows of a file whose cells are converted to numbers.

    A bad cell excludes its row. If most cells of a column are bad, the file is refused.

    Parameters
    ----------
    path : Path or str
        For messages.
    lines : sequence of int, shape (n,)
        Line of the file that each row is on.
    strict : bool
        Refuse the file for a single bad cell.
    """

    def __init__(self, path, lines, strict=False):
        self.path, self.lines, self.strict = path, np.array(lines, dtype=int), strict
        self.reasons = np.zeros(len(self.lines), dtype=object)

    def __len__(self):
        return len(self.lines)

    def refuse(self, label, cells, bad):
        """Exclude the rows of bad cells.

        Parameters
        ----------
        label : str
            Name of the column.
        cells : sequence of str, shape (n,)
        bad : dict of int to str
            Row index -> what is wrong with its cell.

        Raises
        ------
        ValueError
            Most cells are bad; it names file, row and column.
        """
        if not bad:
            return
        if self.strict or 2 * len(bad) > sum(map(bool, cells)):
            i = min(bad)
            raise ValueError(f'{self.path}, row {self.lines[i]}, column {label}: '
                             f'{cells[i][:40]!r} {bad[i]}')
        for i, what in bad.items():
            self.exclude_row(i, f'{label} {cells[i][:40]!r} {what}')

    def floats(self, label, cells):
        """Cells as numbers; empty and unknown ones are NaN.

        Parameters
        ----------
        label, cells
            See `refuse`.

        Returns
        -------
        ndarray, shape (n,)
            NaN where a cell is not a number.

        Raises
        ------
        ValueError
            See `refuse`.
        """
        cells = decimal_points(cells)
        try:
            return np.array([cell or 'nan' for cell in cells], dtype=float)
        except ValueError:
            pass
        values, bad = np.full(len(cells), np.nan), {}
        for i, cell in enumerate(cells):
            if is_number(cell):
                values[i] = float(cell)
            elif cell.lower() not in UNKNOWN:
                bad[i] = _no_number(cell)
        self.refuse(label, cells, bad)
        return values

    def iso_times(self, label, cells):
        """Seconds since 1970 of ISO 8601 times; UTC if no zone is given, NaN if empty.

        Parameters
        ----------
        label, cells
            See `refuse`; for the accepted forms `msg_tools.iso_time.read_iso`.

        Raises
        ------
        ValueError
            See `refuse`. A bad cell is not an ISO 8601 time, or is outside 1900 to 2100.
        """
        values = np.empty(len(cells))
        for i in range(0, len(cells), _BLOCK):  # matches take ten times the memory of the cells
            whole, fraction = read_iso(cells[i:i + _BLOCK])
            values[i:i + _BLOCK] = whole + fraction
        bad = {int(i): _NO_TIME for i in np.flatnonzero(np.isnan(values))
               if cells[i].lower() not in UNKNOWN}
        outside = (values < YEAR_1900) | (values > YEAR_2100)
        bad |= {int(i): 'is outside 1900 to 2100' for i in np.flatnonzero(outside)}
        self.refuse(label, cells, bad)
        return np.where(outside, np.nan, values)

    def times(self, label, cells):
        """Times as seconds since 1970 or ISO 8601, whichever most cells are.

        Parameters
        ----------
        label, cells
            See `refuse`.

        Raises
        ------
        ValueError
            See `refuse`; or half of the times are seconds and half ISO 8601.
        """
        known = [i for i, cell in enumerate(cells) if cell.lower() not in UNKNOWN]
        seconds = [i for i in known if is_number(cells[i])]
        if 2 * len(seconds) == len(known) > 0:
            other = next(i for i in known if not is_number(cells[i]))
            if not np.isnan(read_iso([cells[other]])[1][0]):
                raise ValueError(f'{self.path}, column {label}: mixes seconds (row '
                                 f'{self.lines[seconds[0]]}) and ISO 8601 (row '
                                 f'{self.lines[other]})')
        if 2 * len(seconds) < len(known) or not known:
            return self.iso_times(label, cells)
        values = self.floats(label, cells)
        outside = np.isfinite(values) & ((values < YEAR_1900) | (values > YEAR_2100))
        self.refuse(label, cells, {
            int(i): f'is outside 1900 to 2100{_likely_unit(values[i])}; give seconds since 1970 or '
            'ISO 8601' for i in np.flatnonzero(outside)})
        return np.where(outside, np.nan, values)


class WordRows(TextRows):
    """Rows of words separated by blanks, also after a ``#``.

    Parameters
    ----------
    path : Path or str
        For messages.
    body : list of (int, str)
        Line number in the file and text of each row.

    Attributes
    ----------
    commented : ndarray of bool
        Whether a row is commented out (``#``): the observers have rejected it.
    """

    def __init__(self, path, body):
        super().__init__(path, [number for number, _ in body])
        self.cells = [line.lstrip('# ').split() for _, line in body]
        self.commented = np.array([line.startswith('#') for _, line in body])

    @classmethod
    def of_usual_width(cls, path, body):
        """The rows without comments of another width; and the usual width."""
        width = usual_width(body)
        return cls(path, [(number, line) for number, line in body if not line.startswith('#')
                          or len(line.lstrip('# ').split()) == width]), width

    def column(self, i):
        """Cells of column `i`, a list of str."""
        return [row[i] for row in self.cells]

    def same_width(self, width, what, against):
        """Exclude and blank rows that do not have `width` cells.

        The reason reads "<number> `what`, but `against`".

        Raises
        ------
        ValueError
            Most rows have another width; it names file and row.
        """
        bad = [i for i, row in enumerate(self.cells) if len(row) != width]
        for i in bad:
            self.reasons[i] = f'{len(self.cells[i])} {what}, but {against}'
        if 2 * len(bad) > len(self):
            raise ValueError(f'{self.path}, row {self.lines[bad[0]]}: {self.reasons[bad[0]]}')
        for i in bad:
            self.cells[i] = [''] * width


def is_number(text):
    """Whether `text` is a number (NaN and infinities are)."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def sexagesimal(parts):
    """Degrees (or hours) of degrees, minutes and seconds as words, the sign before the first."""
    size = sum(abs(float(part)) / 60.0**k for k, part in enumerate(parts))
    return -size if parts[0].strip().startswith('-') else size


def commented_rows(lines, is_row):
    """Numbers of the commented-out lines (``#``) that are rows: `is_row` is True of their words."""
    return [number for number, line in enumerate(lines, 1) if line.lstrip().startswith('#')
            and is_row(line.lstrip().lstrip('# ').split())]


def usual_width(body):
    """Most common number of words per line of (line number, text), preferring those without #."""
    lines = [line for _, line in body if not line.startswith('#')] or [line.lstrip('# ')
                                                                       for _, line in body]
    return Counter(len(line.split()) for line in lines).most_common(1)[0][0]


def decimal_points(cells):
    """Replace decimal commas by points, unless some cell of the column has a decimal point."""
    if not any(',' in cell for cell in cells) or any(map(_POINT.fullmatch, cells)):
        return cells
    return [cell.replace(',', '.') if _COMMA.fullmatch(cell) else cell for cell in cells]


def _no_number(cell):
    """Error text for a cell that should be a number."""
    if re.fullmatch(r'[-+]?\d+[ :hd°]\s*\d+.*', cell):
        return 'is not a number; write decimal degrees, as 45.5'
    if _COMMA.fullmatch(cell):
        return 'is not a number; other cells of the column have decimal points'
    if re.fullmatch(r'[-+]?[\d.]+\s*\D+', cell):
        return 'is not a number; leave the unit out: the name of the column has it'
    return 'is not a number'


def day_unit(value):
    """Kind of day count that a number of seconds looks like, in words; '' if none."""
    return 'Julian days' if value > 2.4e6 else 'days (MJD)' if value > 3e4 else ''


def _likely_unit(value):
    """A question naming the unit in which a number would be a plausible time; '' if none."""
    return next((f' (is this {word}?)' for scale, word in (
        (1e3, 'milliseconds'), (1e6, 'microseconds'), (1e9, 'nanoseconds'))
        if CLOCK < value / scale < YEAR_2100), '')
