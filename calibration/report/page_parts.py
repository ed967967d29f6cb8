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

"""Parts of a page, as data: `page_html` draws them.

A part may be text, which is shown as it is, a list of parts, or None: nothing. What has nothing in
it is left out with its heading.
"""

from dataclasses import dataclass
from typing import Any


class Markup(str):
    """What is drawn already: a drawing, or the body of another page."""


# ------------------------------------------------------------------------------ in a line of text

@dataclass(frozen=True)
class Number:
    """A number; None and NaN are a dash."""

    value: float | None
    digits: int = 2
    sign: bool = False


@dataclass(frozen=True)
class Size:
    """An angle in arcsec; `when`: it is the RMS of the residuals ``before`` or ``after``."""

    value: float
    when: str = ''
    sign: bool = False


@dataclass(frozen=True)
class Code:
    """What is typed, or a sum."""

    text: str


@dataclass(frozen=True)
class Link:
    """Where another page lies."""

    text: str
    place: str


@dataclass(frozen=True)
class Numbered:
    """A name with its number in a table."""

    number: int
    text: str


@dataclass(frozen=True)
class FilledBar:
    """A small bar, filled from 0 to 1; `inset`: of one that stands out."""

    part: float
    inset: bool = False


@dataclass(frozen=True)
class Correlation:
    """A number from -1 to 1 on its colour; on the diagonal of a matrix it has none."""

    value: float
    diagonal: bool = False


# ------------------------------------------------------------------------------------------ texts

@dataclass(frozen=True)
class Heading:
    """Of the page."""

    text: str


@dataclass(frozen=True)
class Paragraph:
    """Text, of a kind: ``meta``, ``note``."""

    text: Any
    kind: str = ''


@dataclass(frozen=True)
class Footer:
    """What holds for all figures of the page."""

    text: str


@dataclass(frozen=True)
class SentenceList:
    """Sentences as a list; empty ones are left out."""

    texts: tuple


@dataclass(frozen=True)
class Definitions:
    """Words, and what each is: pairs of text."""

    rows: list


# --------------------------------------------------------------------------------------- sections

@dataclass(frozen=True)
class Section:
    """A part of the page with a heading; `note` stands below it."""

    title: str
    parts: Any
    note: str = ''


@dataclass(frozen=True)
class FoldedSection(Section):
    """A section that opens on a click."""


@dataclass(frozen=True)
class Subsection:
    """A part of a section with a heading."""

    title: str
    parts: Any


@dataclass(frozen=True)
class Folded:
    """What opens on a click."""

    summary: str
    parts: Any


@dataclass(frozen=True)
class Block:
    """A place for parts, kept where it is empty; in one of ``scroll`` nothing becomes too small."""

    parts: Any
    kind: str = ''


@dataclass(frozen=True)
class FigurePair(Block):
    """Beside each other where the page is wide enough."""

    kind: str = 'pair'


@dataclass(frozen=True)
class VerdictSection:
    """The first section: what there is to know.

    Attributes
    ----------
    headline : str
    parts
        `Cards`, and what is below.
    badge : str
        The verdict in a word.
    kind : str
        By which it has its colour.
    """

    headline: str
    parts: Any = ()
    badge: str = ''
    kind: str = ''


# --------------------------------------------------------------------------- figures and numbers

@dataclass(frozen=True)
class Figure:
    """A drawing with its caption; `when`: ``before`` or ``after``, where it shows one alone."""

    drawing: Any
    caption: Any = ''
    when: str = ''


@dataclass(frozen=True)
class Legend:
    """What the marks mean: (kind, text) each."""

    entries: tuple = (('before', 'before'), ('after', 'after'))


@dataclass(frozen=True)
class Cards:
    """Large numbers: value in arcsec or text, and what it is; None is left out.

    A third entry, ``before`` or ``after``, says that it is the RMS of those residuals.
    """

    rows: tuple


@dataclass(frozen=True)
class BarChart:
    """Bars of errors, on one scale.

    Attributes
    ----------
    rows : list of (str, list of (float or None, str, str))
        What it is of, and each bar: its value in arcsec, its kind, what is said beside it.
    floor : float, optional
        Below which no model can come, arcsec.
    floor_text : str
        What that is.
    """

    rows: list
    floor: float | None = None
    floor_text: str = 'noise'


@dataclass(frozen=True)
class Column:
    """Head of a column; `when`: of ``before`` or ``after`` alone; `sorted`: the rows are by it."""

    text: str
    when: str = ''
    sorted: bool = False


@dataclass(frozen=True)
class Table:
    """A table; nothing of no rows.

    Attributes
    ----------
    header : sequence of str or Column
    rows : iterable of sequence
        None is a dash.
    kind : str
        Words; of ``stack`` the cells stand below each other where the window is narrow.
    caption : str
        For readers that do not see it.
    keys : sequence of str
        Of each row: it lights up with the marks that have the same one.
    groups : sequence of str
        Of each row: by it rows are chosen.
    tall : bool
        It scrolls in a window of its own.
    """

    header: Any
    rows: Any
    kind: str = ''
    caption: str = ''
    keys: Any = ()
    groups: Any = ()
    tall: bool = False


# ------------------------------------------------------------------------------ what a reader does

@dataclass(frozen=True)
class Controls:
    """The bar that says what is shown; `groups`: name and a sentence of each, which are `word`."""

    word: str = ''
    groups: tuple = ()


@dataclass(frozen=True)
class RefitData:
    """What a refit in the page needs; nobody sees it."""

    document: dict


#: of pages of residuals
FOOTER = Footer('All offsets are encoder − catalogue, on the sky, in seconds of arc (arcsec, ″). '
                'RMS values are radial unless an axis is named.')
