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

"""Parts of a page as HTML, for `page_html.whole`.

Where a function takes text it also takes markup of this module, a list of both, or None (nothing).
Empty sections are omitted with their heading.
"""

import json
from html import escape
from itertools import zip_longest

import numpy as np

from pointing_model.effects.base import arcsec

from .number_wording import number

#: marks of a legend: kind and text
MARKS = (('before', 'before'), ('after', 'after'))


class Markup(str):
    """Finished markup."""


def clean(text):
    """`text` escaped for HTML and XML, without characters that XML does not allow."""
    text = ''.join(c if c.isprintable() else '\ufffd' for c in str(text))
    return escape(text, quote=True)


def drawn(part):
    """Markup of a part: what is none yet is escaped as text; a list is joined; None is ''."""
    if part is None:
        return Markup()
    if isinstance(part, list | tuple):
        return Markup(''.join(map(drawn, part)))
    return part if isinstance(part, Markup) else Markup(clean(part))


def _tag(name, inside, kind=''):
    """An element with a class; '' if it is empty."""
    return Markup(f'<{name}{_class(kind)}>{inside}</{name}>' if inside else '')


def _class(kind):
    return f' class="{kind}"' if kind else ''


# ------------------------------------------------------------------------------ in a line of text

def size(value, when='', sign=False):
    """An angle in arcsec; `when`: it is the RMS of the residuals ``before`` or ``after``."""
    text = clean(arcsec(value, sign))
    return Markup(f'<span{_of_rms(when)}>{text}</span>' if when else text)


def _of_rms(when=''):
    """Attribute of an RMS that a refit in the page updates."""
    return f' data-rms="{when}"' if when else ''


def code(text):
    """Monospaced text: a command or a checksum."""
    return _tag('code', clean(text))


def link(text, place):
    """A link to another page."""
    return Markup(f'<a href="{clean(place)}">{clean(text)}</a>')


def numbered(row, text):
    """A name with its number in a table."""
    return Markup(f'<b>{row}</b>\u2002{clean(text)}')


def filled_bar(part, inset=False):
    """A small bar, filled from 0 to 1; `inset`: highlighted."""
    return Markup(f'<span class="gauge"><i class="{"inset" if inset else ""}" '
                  f'style="width:{100 * part:.0f}%"></i></span>')


def correlation(value, diagonal=False):
    """A number from -1 to 1 on a colour scale; no colour on the diagonal of a matrix."""
    strength = 0.0 if diagonal else min(abs(value), 1.0)
    colour = '213,94,0' if value > 0 else '0,114,178'
    return Markup(f'<span class="corr" style="background:rgba({colour},'
                  f'{0.75 * strength**1.5:.2f})">{number(value)}</span>')


# ------------------------------------------------------------------------------------------ texts

def heading(text):
    """Heading of the page."""
    return _tag('h1', clean(text))


def paragraph(text, kind=''):
    """Text; `kind`: ``meta`` or ``note``."""
    return _tag('p', drawn(text), kind)


def footer(text):
    """Footer: what applies to all figures of the page."""
    return _tag('footer', clean(text))


def sentence_list(texts):
    """Sentences as a list; empty ones are omitted."""
    return _tag('ul', ''.join(_tag('li', clean(text)) for text in texts if text))


def definitions(rows):
    """Definition list: pairs of text."""
    return _tag('dl', ''.join(f'<dt>{clean(word)}</dt><dd>{clean(text)}</dd>'
                              for word, text in rows))


# --------------------------------------------------------------------------------------- sections

def section(title, parts, note=''):
    """A part of the page with a heading, and a `note` below it."""
    body = drawn(parts)
    return body and _tag('section', f'<h2>{clean(title)}</h2>{paragraph(note, "note")}{body}')


def folded_section(title, parts, note=''):
    """A section that opens on a click."""
    body = drawn(parts)
    return body and _tag('section', _folded(
        f'<h2>{clean(title)}</h2>', paragraph(note, 'note') + body), 'fold')


def _folded(summary, body):
    return f'<details><summary>{summary}</summary>{body}</details>' if body else ''


def subsection(title, parts):
    """A part of a section with a heading."""
    body = drawn(parts)
    return Markup(body and f'<h3>{clean(title)}</h3>{body}')


def folded(summary, parts):
    """Parts that open on a click."""
    return Markup(_folded(clean(summary), drawn(parts)))


def block(parts, kind=''):
    """A container, kept if empty; kind ``scroll``: scrolls rather than shrink its content."""
    return Markup(f'<div{_class(kind)}>{drawn(parts)}</div>')


def figure_pair(parts):
    """Figures side by side if the page is wide enough."""
    return block(parts, 'pair')


def verdict_section(headline, parts=(), badge='', kind=''):
    """The first section: the main result.

    Parameters
    ----------
    headline : str
    parts
        `cards`, and parts below them.
    badge : str
        The verdict in a word.
    kind : str
        Determines the colour.
    """
    badge = f'<span class="badge">{clean(badge)}</span>' if badge else ''
    return _tag('section', f'{badge}<h2>{clean(headline)}</h2>{drawn(parts)}',
                f'verdict {kind}'.rstrip())


# --------------------------------------------------------------------------- figures and numbers

def figure(drawing, caption='', when=''):
    """A drawing with its caption; `when`: ``before`` or ``after`` if it shows only one of them."""
    return _tag('figure', drawn(drawing) + _tag('figcaption', drawn(caption)),
                when and f'when-{when}')


def legend(entries=MARKS):
    """Legend of the marks: pairs (kind, text)."""
    return Markup('<p class="legend">' + ' '.join(
        f'<span class="swatch {kind}"></span>{clean(text)}' for kind, text in entries) + '</p>')


def cards(rows):
    """Large numbers: value in arcsec or text, and a label; None is omitted.

    A third entry, ``before`` or ``after``, marks the RMS of those residuals.
    """
    return _tag('div', ''.join(
        f'<div><b{_of_rms(*when)}>{clean(value if isinstance(value, str) else arcsec(value))}</b>'
        f'<span>{clean(text)}</span></div>'
        for value, text, *when in rows if value is not None), 'numbers-row')


def bar_chart(rows, floor=None, floor_text='noise'):
    """Bars of errors, on one scale.

    Parameters
    ----------
    rows : list of (str, list of (float or None, str, str))
        Label, and for each bar its value in arcsec, its kind and a text.
    floor : float, optional
        Lower limit for any model, arcsec.
    floor_text : str
        Label of `floor`.
    """
    rows = [(label, [bar for bar in bars if bar[0] is not None and np.isfinite(bar[0])])
            for label, bars in rows]
    if floor is not None and np.isfinite(floor) and floor > 0.0:
        rows.append((floor_text, [(floor, 'floor', '')]))
    top = max((value for _, bars in rows for value, *_ in bars), default=0.0) or 1.0
    out = ''
    for name, bars in rows:
        lines = ''.join(
            f'<p><i class="{kind}" style="width:{70.0 * value / top:.2f}%"></i>'
            f'<span>{clean(" ".join(filter(None, (arcsec(value), label))))}</span></p>'
            for value, kind, label in bars)
        if lines:
            out += f'<div>{clean(name)}</div><div>{lines}</div>'
    return _tag('div', out, 'gains')


def column(text, when='', descending=False):
    """Header of a column; `when`: shown for ``before`` or ``after``; rows may be `descending`."""
    order = ' aria-sort="descending"' if descending else ''
    return Markup(f'<th scope="col"{_class(when and f"when-{when}")}{order}>{clean(text)}</th>')


def table(header, rows, kind='', caption='', keys=(), groups=(), tall=False):
    """A table; omitted if it has no rows.

    Parameters
    ----------
    header : sequence of str or Markup
        Texts, or a `column`.
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
    head = ''.join(cell if isinstance(cell, Markup) else column(cell) for cell in header)
    cells = [f'<td data-h="{clean(name)}">' if 'stack' in kind else '<td>' for name in header]
    body = ''.join(
        '<tr' + ('' if key is None else f' data-i="{key}"')
        + ('' if group is None else f' data-g="{clean(group)}"') + '>'
        + ''.join(f'{cell}{"–" if value is None else drawn(value)}</td>'
                  for cell, value in zip(cells, row)) + '</tr>'
        for row, key, group in zip_longest(rows, keys, groups))
    return Markup(body and (
        f'<div class="scroll{" tall" * tall}"><table{_class(kind)}>'
        f'{_tag("caption", clean(caption))}<thead><tr>{head}</tr></thead><tbody>{body}'
        '</tbody></table></div>'))


# ------------------------------------------------------------------------------ what a reader does

def controls(word='', groups=()):
    """Control bar of the page; `groups`: name and sentence for each group, called `word`."""
    whens = ''.join(
        f'<label><input type="radio" name="when" value="{value}"{checked}/> {value}</label>'
        for value, checked in (('both', ' checked="checked"'), ('before', ''), ('after', '')))
    options = ''.join(f'<option value="{clean(name)}" data-say="{clean(say)}">{clean(name)}'
                      '</option>' for name, say in groups)
    choice = (f'<label hidden="hidden">{clean(word)} <select id="group">'
              f'<option value="">all</option>{options}</select></label>') if options else ''
    return Markup(f'<div class="controls"><fieldset><legend>Show</legend>{whens}</fieldset>{choice}'
                  '<span class="foot"><output id="told" aria-live="polite"></output>'
                  '<span id="acts"></span></span></div>')


def refit_data(document):
    """Hidden data for a refit in the page."""
    return Markup(f'<div id="refit" hidden="hidden" data-refit="{clean(json.dumps(document))}">'
                  '</div>')


#: footer of pages with residuals
FOOTER = footer('All offsets are encoder − catalogue, on the sky, in seconds of arc (arcsec, ″). '
                'RMS values are radial unless an axis is named.')
