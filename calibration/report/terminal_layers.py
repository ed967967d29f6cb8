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

"""What a terminal shows first: 24 lines of 80 columns; the rest with --verbose."""

from io import StringIO
from textwrap import wrap

from rich.console import Console

#: of a terminal, whatever is written into a page beside
LINES, COLUMNS = 24, 80
MORE = '{} more: --verbose'


def height_of(part):
    """Lines of a text or table on a terminal of 80 columns."""
    if isinstance(part, str):
        return sum(len(wrap(line, COLUMNS)) or 1 for line in part.split('\n'))
    console = Console(file=StringIO(), width=COLUMNS, markup=False, emoji=False, highlight=False)
    console.print(part)
    return console.file.getvalue().count('\n')


def layered(first, more=(), verbose=False, files=0, rest=()):
    """Parts of a result that are printed.

    Parameters
    ----------
    first : list
        What is always printed: texts and tables.
    more : list
        What comes after it, the most important first: without `verbose` what has room.
    verbose : bool
        Print all.
    files : int
        Lines that are printed after it: names of files.
    rest : list
        What is printed only with `verbose`.

    Returns
    -------
    list
        Of these parts; at its end a line that counts what is left out.
    """
    first, more, rest = ([part for part in parts if part] for parts in (first, more, rest))
    if verbose:
        return [*first, *more, *rest]
    room = LINES - files - sum(map(height_of, first))
    heights, shown = list(map(height_of, more)), []
    for i, part in enumerate(more):
        # the last line counts those left out, if there are any
        line = bool(rest) or len(shown) < i or i + 1 < len(more)
        if heights[i] + line <= room:
            shown.append(part)
            room -= heights[i]
    hidden = len(more) - len(shown) + len(rest)
    return [*first, *shown, *([MORE.format(hidden)] if hidden else [])]
