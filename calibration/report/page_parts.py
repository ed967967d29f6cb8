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

"""Parts of a page as data; `page_html` renders them.

A part may also be plain text, a list of parts, or None (nothing). Empty sections are omitted with
their heading.
"""

from dataclasses import dataclass
from typing import Any


class Markup(str):
    """Finished markup: a drawing, or the body of another page."""


# ------------------------------------------------------------------------------ in a line of text

@dataclass(frozen=True)
class Number:
    """A number; a dash for None and NaN."""

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
    """Monospaced text: a command or a checksum."""

    text: str


@dataclass(frozen=True)
class Link:
    """A link to another page."""

    text: str
    place: str


@dataclass(frozen=True)
class Numbered:
    """A name with its number in a table."""

    number: int
    text: str


@dataclass(frozen=True)
class FilledBar:
    """A small bar, filled from 0 to 1; `inset`: highlighted."""

    part: float
    inset: bool = False


@dataclass(frozen=True)
class Correlation:
    """A number from -1 to 1 on a colour scale; no colour on the diagonal of a matrix."""

    value: float
    diagonal: bool = False


# ------------------------------------------------------------------------------------------ texts

@dataclass(frozen=True)
class Heading:
    """Heading of the page."""

    text: str


@dataclass(frozen=True)
class Paragraph:
    """Text; `kind`: ``meta`` or ``note``."""

    text: Any
    kind: str = ''


@dataclass(frozen=True)
class Footer:
    """Footer: what applies to all figures of the page."""

    text: str


@dataclass(frozen=True)
class SentenceList:
    """Sentences as a list; empty ones are omitted."""

    texts: tuple


@dataclass(frozen=True)
class Definitions:
    """Definition list: pairs of text."""

    rows: list


# --------------------------------------------------------------------------------------- sections

@dataclass(frozen=True)
class Section:
    """A part of the page with a heading, and a `note` below it."""

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
    """Parts that open on a click."""

    summary: str
    parts: Any


@dataclass(frozen=True)
class Block:
    """A container, kept if empty; kind ``scroll``: scrolls rather than shrink its content."""

    parts: Any
    kind: str = ''


@dataclass(frozen=True)
class FigurePair(Block):
    """Figures side by side if the page is wide enough."""

    kind: str = 'pair'


@dataclass(frozen=True)
class VerdictSection:
    """The first section: the main result.

    Attributes
    ----------
    headline : str
    parts
        `Cards`, and parts below them.
    badge : str
        The verdict in a word.
    kind : str
        Determines the colour.
    """

    headline: str
    parts: Any = ()
    badge: str = ''
    kind: str = ''


# --------------------------------------------------------------------------- figures and numbers

@dataclass(frozen=True)
class Figure:
    """A drawing with its caption; `when`: ``before`` or ``after`` if it shows only one of them."""

    drawing: Any
    caption: Any = ''
    when: str = ''


@dataclass(frozen=True)
class Legend:
    """Legend of the marks: pairs (kind, text)."""

    entries: tuple = (('before', 'before'), ('after', 'after'))


@dataclass(frozen=True)
class Cards:
    """Large numbers: value in arcsec or text, and a label; None is omitted.

    A third entry, ``before`` or ``after``, marks the RMS of those residuals.
    """

    rows: tuple


@dataclass(frozen=True)
class BarChart:
    """Bars of errors, on one scale.

    Attributes
    ----------
    rows : list of (str, list of (float or None, str, str))
        Label, and for each bar its value in arcsec, its kind and a text.
    floor : float, optional
        Lower limit for any model, arcsec.
    floor_text : str
        Label of `floor`.
    """

    rows: list
    floor: float | None = None
    floor_text: str = 'noise'


@dataclass(frozen=True)
class Column:
    """Header of a column; `when`: shown for ``before`` or ``after``; `sorted`: rows are by it."""

    text: str
    when: str = ''
    sorted: bool = False


@dataclass(frozen=True)
class Table:
    """A table; omitted if it has no rows.

    Attributes
    ----------
    header : sequence of str or Column
    rows : iterable of sequence
        None is shown as a dash.
    kind : str
        CSS classes; ``stack``: cells are stacked in a narrow window.
    caption : str
        For screen readers.
    keys : sequence of str
        Key of each row: it is highlighted with all marks with the same key.
    groups : sequence of str
        Group of each row, for filtering.
    tall : bool
        Whether it scrolls in a separate window.
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
    """Control bar of the page; `groups`: name and sentence for each group, called `word`."""

    word: str = ''
    groups: tuple = ()


@dataclass(frozen=True)
class RefitData:
    """Hidden data for a refit in the page."""

    document: dict


#: footer of pages with residuals
FOOTER = Footer('All offsets are encoder − catalogue, on the sky, in seconds of arc (arcsec, ″). '
                'RMS values are radial unless an axis is named.')
