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

"""Terminal output: at most 24 lines of 80 columns first; tables that never cut a number."""

from io import StringIO
from textwrap import wrap

from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from msg_tools.terminal_signs import spelled

#: assumed size of the terminal
LINES, COLUMNS = 24, 80
MORE = '{} more: --verbose'
#: spaces between two columns, and on the left of a table
_GAP, _MARGIN = 3, 1
#: smallest width of a column of words before the table is stacked
_WORDS = 14


class TerminalTable(Table):
    """A `rich` table that wraps words, and then stacks its columns, rather than cut a number.

    It has its natural width if there is room. Otherwise headers and columns of words are wrapped at
    spaces. If that is not enough, each row becomes a paragraph: its first cell, and below it the
    header and value of each other column.
    """

    def __rich_console__(self, console, options):
        cells = [[spelled(str(cell), console.encoding) for cell in (column.header, *column.cells)]
                 for column in self.columns]
        room = options.max_width - _MARGIN - _GAP * (len(cells) - 1)
        widths = _folded([_Column(column) for column in cells], room)
        if widths is None:
            yield from _stacked(self.title, cells, options.max_width, console.encoding)
            return
        if self.title:
            title = spelled(str(self.title), console.encoding)
            widths = _as_wide_as(len(title), widths, room)
            yield Text(title, style='bold')
            yield Text('')
        yield from _laid_out(cells, widths, self.columns, console)
        yield Text('')

    def __rich_measure__(self, console, options):
        return Measurement(min(40, options.max_width), options.max_width)


class _Column:
    """Natural and smallest width of a column."""

    def __init__(self, cells):
        header, *body = cells
        self.natural = max(map(_width, cells))
        longest = max((cell_len(word) for cell in cells for word in cell.split()), default=0)
        self.words = any(_is_words(cell) for cell in body)
        self.least = min(self.natural, max(longest, _WORDS)) if self.words else max(
            max(map(_width, body), default=0),
            max((cell_len(word) for word in header.split()), default=0))


def _width(cell):
    return max(map(cell_len, cell.split('\n')), default=0)


def _is_words(cell):
    """Whether a cell may be wrapped at spaces: it has at least two words with letters."""
    return sum(any(sign.isalpha() for sign in word) for word in cell.split()) > 1


def _folded(columns, room):
    """Widths with which all columns fit in `room`, shrinking the widest first; or None."""
    widths = [column.natural for column in columns]
    while sum(widths) > room:
        able = [i for i, column in enumerate(columns) if widths[i] > column.least]
        if not able:
            return None
        # wrap headers of numbers before words: a second line does no harm there
        widest = max(able, key=lambda i: (not columns[i].words, widths[i]))
        widths[widest] -= 1
    return widths


def _as_wide_as(title, widths, room):
    """Widths of a table widened to the width of its title, in proportion."""
    missing = min(title - _GAP * (len(widths) - 1), room) - sum(widths)
    total = sum(widths)
    out = []
    for width in widths:
        more = max(0, -(-width * missing // total)) if total else 0  # rounded up
        out.append(width + more)
        missing, total = missing - more, total - width
    return out


def _laid_out(cells, widths, columns, console):
    """Lines of a table: header, rule, rows; without trailing blanks."""
    rows = list(zip(*cells))
    total = _MARGIN + sum(widths) + _GAP * (len(widths) - 1)
    for number, row in enumerate(rows):
        parts = [_broken(cell, width, console) for cell, width in zip(row, widths)]
        height = max(map(len, parts))
        if number == 0:  # align headers to the rule
            parts = [[''] * (height - len(part)) + part for part in parts]
        for i in range(height):
            line = ' ' * _MARGIN + (' ' * _GAP).join(
                _justified(part[i] if i < len(part) else '', width, column.justify)
                for part, width, column in zip(parts, widths, columns))
            yield Text(line.rstrip(), style='bold' if number == 0 else '', no_wrap=True,
                       overflow='ignore')
        if number == 0:
            rule = spelled('─', console.encoding) * (total - _MARGIN)
            yield Text(f' {rule}', no_wrap=True, overflow='ignore')


def _justified(text, width, justify):
    blank = ' ' * (width - cell_len(text))
    return blank + text if justify == 'right' else text + blank


def _broken(cell, width, console):
    """The wrapped lines of a cell; lines that fit keep their blanks."""
    return [line for part in cell.split('\n') for line in (
        [part] if cell_len(part) <= width else
        [text.plain.rstrip() for text in Text(' '.join(part.split())).wrap(console, width)])]


def _stacked(title, cells, width, encoding):
    """Each row as a paragraph: the first cell, and below it header and value of the others."""
    if title:
        yield Text(spelled(str(title), encoding), style='bold')
    headers = [column[0] for column in cells]
    for row in zip(*(column[1:] for column in cells)):
        yield Text(' '.join(f'{headers[0]} {row[0]}'.split()) if _is_number(row[0]) else row[0])
        line, pairs = ' ', [' '.join(f'{header} {cell}'.split())
                            for header, cell in zip(headers[1:], row[1:]) if cell.strip()]
        for pair in pairs:
            if line.strip() and cell_len(f'{line}  {pair}') > width:
                yield Text(line)
                line = ' '
            line += f' {pair}' if not line.strip() else f'  {pair}'
        if line.strip():
            yield Text(line)
    yield Text('')


def _is_number(cell):
    try:
        float(cell)
        return True
    except ValueError:
        return False


def height_of(part):
    """Number of lines of a text or table on a terminal of 80 columns."""
    if isinstance(part, str):
        return sum(len(wrap(line, COLUMNS)) or 1 for line in part.split('\n'))
    console = Console(file=StringIO(), width=COLUMNS, markup=False, emoji=False, highlight=False)
    console.print(part)
    return console.file.getvalue().count('\n')


def layered(first, more=(), verbose=False, files=0, rest=()):
    """Select the parts of a result to print.

    Parameters
    ----------
    first : list
        Texts and tables that are always printed.
    more : list
        Parts printed after them, most important first; without `verbose` as many as fit.
    verbose : bool
        Print all.
    files : int
        Number of lines printed afterwards: names of files.
    rest : list
        Parts printed only with `verbose`.

    Returns
    -------
    list
        Parts to print, and a last line with the number of omitted parts.
    """
    first, more, rest = ([part for part in parts if part] for parts in (first, more, rest))
    if verbose:
        return [*first, *more, *rest]
    room = LINES - files - sum(map(height_of, first))
    heights, shown = list(map(height_of, more)), []
    for i, part in enumerate(more):
        # reserve the last line for the number of omitted parts, if any
        line = bool(rest) or len(shown) < i or i + 1 < len(more)
        if heights[i] + line <= room:
            shown.append(part)
            room -= heights[i]
    hidden = len(more) - len(shown) + len(rest)
    return [*first, *shown, *([MORE.format(hidden)] if hidden else [])]
