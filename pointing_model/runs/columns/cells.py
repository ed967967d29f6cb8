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

"""Tables of cells as people and spreadsheets write them, with the same rules for every file.

A row with more or fewer cells than the header is excluded. The file is refused if most rows are
such, or if a column occurs twice. Cells are separated by commas, semicolons or tabs, whichever the
header has most of, else by blanks. For bad numbers and times see `cell_values.TextRows`.
"""

import csv
import re

import numpy as np

from .cell_values import TextRows, is_number
from .run_table import EMPTY, content

_BLOCK = 5000  # lines split at once
MOST_COLUMNS = 1000  # no program writes so many; ten thousand take minutes
#: what a spreadsheet takes for a formula, also after blanks
_FORMULA = re.compile(r"[\s']*[=+\-@\t\r＝＋－＠]")
#: control characters of terminals, and those that change the direction of text
_CONTROL = re.compile('[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]')


class Cells(TextRows):
    """A table with a header row.

    Attributes
    ----------
    header : list of str
    delimiter : str
    """

    def __init__(self, path, lines, delimiter=None):
        """Split a file.

        Parameters
        ----------
        path : Path or str
            For messages.
        lines : list of str
            Of the file, see `run_table.read_lines`.
        delimiter : str, optional
            By default that of the header.

        Raises
        ------
        ValueError
            A column occurs twice, most rows have another length, or there are too many columns.
        """
        body = content(lines)
        if not body:
            raise ValueError(EMPTY.format(path))
        self.delimiter = delimiter or delimiter_of(body[0][1])
        if self.delimiter == ' ':
            body = [(number, line.expandtabs()) for number, line in body]
        header = split_row(body[0][1], self.delimiter)
        if header is None:
            raise ValueError(f'{path}, row {body[0][0]}: a quoted name does not end on its line')
        self.header = [plain_text(name.strip()) for name in header]
        if len(self.header) > MOST_COLUMNS:
            raise ValueError(f'{path}: {len(self.header)} columns, at most {MOST_COLUMNS} are '
                             'read; keep those of the observations')
        twice = [name for name in self.header if name and self.header.count(name) > 1]
        if twice:
            raise ValueError(f'{path}: column {twice[0]!r} is there twice')
        super().__init__(path, [number for number, _ in body[1:]])
        # bytes: a million rows of str would take most of the memory
        self._blocks = []
        for i in range(1, len(body), _BLOCK):
            rows = self._split(body[i:i + _BLOCK], i - 1)
            self._blocks.append([np.array([cell.encode() for cell in cells])
                                 for cells in zip(*rows)])
        self._refuse_lengths(path, body)

    def column(self, i):
        """Cells of column `i`, a list of str."""
        return [plain_text(cell.decode()) for block in self._blocks for cell in block[i].tolist()]

    def __getitem__(self, name):
        """Cells of the column `name`."""
        return self.column(self.header.index(name))

    def _split(self, body, first):
        """Rows of a block; one of another length is blanked and gets a reason."""
        width = len(self.header)
        try:
            rows = list(csv.reader((line for _, line in body), delimiter=self.delimiter,
                                   strict=True, skipinitialspace=True))
        except csv.Error:
            rows = []
        if len(rows) != len(body):  # a quoted cell does not end on its line
            rows = [split_row(line, self.delimiter) for _, line in body]
        for i, row in enumerate(rows):
            if row is not None:
                while len(row) > width and not row[-1].strip():
                    row.pop()
                if len(row) == width:
                    rows[i] = [cell.strip() for cell in row]
                    continue
            rows[i] = [''] * width
            self.reasons[first + i] = 'a quoted cell does not end on its line' if row is None \
                else f'{len(row)} cells, but the header has {width}'
        return rows

    def _refuse_lengths(self, path, body):
        bad = np.flatnonzero(self.reasons != 0)
        if 2 * len(bad) <= len(self):
            return
        hint = ''
        if self.delimiter == ',' and re.search(r'\d,\d', body[1 + bad[0]][1]) and len(
                body[1 + bad[0]][1].split(',')) > len(self.header):
            hint = '; are there decimal commas? Write points, or semicolons between the cells'
        raise ValueError(f'{path}, row {self.lines[bad[0]]}: {self.reasons[bad[0]]}{hint}')


def split_row(line, delimiter):
    """Cells of a line; None if a quoted one does not end on it."""
    try:
        rows = list(csv.reader([line], delimiter=delimiter, strict=True, skipinitialspace=True))
    except csv.Error:
        return None
    return rows[0] if len(rows) == 1 else None


def delimiter_of(line):
    """Separator of a header's cells: comma, semicolon or tab; a blank if it has none of them."""
    best = max(',;\t', key=lambda delimiter: len(split_row(line, delimiter) or ()))
    return best if best in line else ' '


def plain_text(cell):
    """A cell without the apostrophe that `safe_text` adds."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell


def safe_text(text):
    r"""Text that spreadsheets do not run and terminals do not obey.

    What looks like a formula gets an apostrophe in front, which `plain_text` removes. Control
    characters are escaped, as ``\\x1b``. Numbers are unchanged.
    """
    text = _CONTROL.sub(lambda found: found[0].encode('unicode_escape').decode(), text)
    return f"'{text}" if _FORMULA.match(text) and not is_number(text) else text


def write_rows(stream, rows, *, delimiter=',', quoting=csv.QUOTE_MINIMAL):
    """Write rows of cells as CSV, with `safe_text` for texts.

    Parameters
    ----------
    stream : file
        Open for text, with ``newline=''``.
    rows : iterable of sequence
    delimiter : str
    quoting : int
        A ``QUOTE_`` constant of the module ``csv``.
    """
    writer = csv.writer(stream, delimiter=delimiter, quoting=quoting, lineterminator='\n')
    writer.writerows([safe_text(cell) if isinstance(cell, str) else cell for cell in row]
                     for row in rows)
