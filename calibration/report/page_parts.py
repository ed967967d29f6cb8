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

"""Pieces of HTML of which a page is made: sections, figures, tables, numbers, the page itself."""

import re
from base64 import b64encode
from hashlib import sha256
from importlib.resources import files

import numpy as np

from pointing_model.effects.base import arcsec

from .drawing import clean

#: colours that the colour-blind tell apart, light and dark, and paper; what a page does when it is
#: touched: rows light up in every plot, tables sort, nights filter; plots zoom and are saved; rows
#: are excluded. Everything is on the page without it
CSS, *_SCRIPTS = ('\n' + files(__package__).joinpath(f'page{name}').read_text(encoding='utf-8')
                  for name in ('.css', '.js', '_plots.js', '_refit.js'))
#: of a page that is XML too
SCRIPT = '//<![CDATA[' + re.sub('\n +', '\n', ''.join(_SCRIPTS)) + '//]]>'
_BODY = re.compile('<main>\n(.*)\n</main>', re.DOTALL)
#: of a page alone: its bar, and what a refit of its rows needs
_ALONE = re.compile('<div (?:class="controls"|id="refit").*?</div>', re.DOTALL)
#: a script in a name could not run even if it came through: only ours has this sum
_POLICY = ("default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-"
           + b64encode(sha256(SCRIPT.encode()).digest()).decode() + "'")
#: of pages of residuals
FOOTER = ('<footer>All offsets are encoder − catalogue, on the sky, in seconds of arc (arcsec, ″). '
          'RMS values are radial unless an axis is named.</footer>')


class Markup(str):
    """A cell that is HTML already."""


def whole(title, parts, kind=''):
    """A page: one file that refers to nothing outside itself, well-formed as XML too.

    Parameters
    ----------
    title : str
    parts : sequence of str
        HTML; empty ones are left out.
    kind : str
        Of what it is a page, in its head.

    Returns
    -------
    str
    """
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"/>'
            '<meta name="viewport" content="width=device-width, initial-scale=1"/>'
            f'<meta http-equiv="Content-Security-Policy" content="{clean(_POLICY)}"/>'
            + (f'<meta name="description" content="{clean(kind)}"/>' if kind else '')
            + f'<title>{clean(title)}</title><style>{CSS}</style></head><body><main>\n'
            + '\n'.join(part for part in parts if part)
            + f'\n</main><script>{SCRIPT}</script></body></html>\n')


def body_of(page):
    """What is on a page that `whole` has made, to be a part of another.

    Parameters
    ----------
    page : str

    Returns
    -------
    str
        '' if it is none.
    """
    found = _BODY.search(page)
    # one page has one heading and one bar
    return _ALONE.sub('', found[1]).replace('<h1>', '<h2 class="part">').replace(
        '</h1>', '</h2>') if found else ''


def section(title, *parts, note=''):
    """A part of the page with a heading; nothing if there is nothing in it."""
    body = ''.join(part for part in parts if part)
    if not body:
        return ''
    return f'<section><h2>{clean(title)}</h2>{paragraph(note, "note")}{body}</section>'


def folded_section(title, *parts, note=''):
    """A part of the page that opens on a click; nothing if there is nothing in it."""
    body = ''.join(part for part in parts if part)
    if not body:
        return ''
    inside = folded(f'<h2>{clean(title)}</h2>', paragraph(note, 'note') + body)
    return f'<section class="fold">{inside}</section>'


def subsection(title, *parts):
    """A part of a section with a heading; nothing if there is nothing in it."""
    body = ''.join(parts)
    return f'<h3>{clean(title)}</h3>{body}' if body else ''


def paragraph(text, kind=''):
    """A paragraph of a class; nothing of no text."""
    kind = f' class="{kind}"' if kind else ''
    return f'<p{kind}>{clean(text)}</p>' if text else ''


def definitions(rows):
    """Words, and what each is, as a list; nothing of none."""
    items = ''.join(f'<dt>{clean(word)}</dt><dd>{clean(text)}</dd>' for word, text in rows)
    return f'<dl>{items}</dl>' if items else ''


def verdict(badge, headline, sentences, cards='', kind='', more='', body='', then=''):
    """The first section: what there is to know.

    Parameters
    ----------
    badge, headline : str
    sentences : sequence of str
    cards : str
        As `cards` makes them.
    kind : str
        Class, for its colour.
    more : str
        HTML below.
    body : str
        HTML between the large numbers and what is below.
    then : str
        Of the headline, what is set smaller.
    """
    badge = f'<span class="badge">{clean(badge)}</span>' if badge else ''
    return (f'<section class="verdict{" " * bool(kind)}{kind}">{badge}<h2>{clean(headline)}</h2>'
            f'{paragraph(then, "then")}{listed(sentences)}{cards}{body}{more}</section>')


def cards(rows):
    """Large numbers: value in arcsec or text, and what it is; None is left out.

    A third entry, ``before`` or ``after``, says that it is the RMS of those residuals.
    """
    out = ''.join(f'<div><b{_of_rms(*when)}>'
                  f'{clean(value if isinstance(value, str) else arcsec(value))}</b>'
                  f'<span>{clean(text)}</span></div>'
                  for value, text, *when in rows if value is not None)
    return f'<div class="numbers-row">{out}</div>' if out else ''


def _of_rms(when=''):
    return f' data-rms="{when}"' if when else ''


def rms_text(value, when):
    """An RMS that a refit in the page changes, as HTML."""
    return Markup(f'<span{_of_rms(when)}>{clean(arcsec(value))}</span>')


def listed(texts):
    """Sentences as a list; nothing of none."""
    items = ''.join(f'<li>{clean(text)}</li>' for text in texts if text)
    return f'<ul>{items}</ul>' if items else ''


def figure(drawing, caption, when=''):
    """A drawing with its caption; `when`: ``before`` or ``after``, where it shows one alone."""
    caption = f'<figcaption>{cell_of(caption)}</figcaption>' if caption else ''
    when = f' class="when-{when}"' if when else ''
    return f'<figure{when}>{drawing}{caption}</figure>'


def pair(drawings):
    """Beside each other where the page is wide enough."""
    return f'<div class="pair">{"".join(drawings)}</div>'


def folded(summary, body):
    """What opens on a click; nothing if there is nothing in it."""
    return f'<details><summary>{summary}</summary>{body}</details>' if body else ''


def scrolled(drawing):
    """What must not become too small to read: it scrolls where the window is narrow."""
    return f'<div class="scroll">{drawing}</div>'


def table(header, rows, kind='', caption='', keys=None):
    """A table, nothing of no rows; cells are text, except those that are `Markup`.

    Parameters
    ----------
    header : sequence of str
    rows : iterable of sequence
        None is a dash.
    kind : str
        Class; of ``stack`` the cells stand below each other where the window is narrow.
    caption : str
        For readers that do not see it.
    keys : sequence of str, optional
        Of each row: it lights up with the marks that have the same one.
    """
    head = ''.join(f'<th scope="col">{cell_of(cell)}</th>' for cell in header)
    marks = iter(() if keys is None else (f' data-i="{key}"' for key in keys))
    cells = [f'<td data-h="{clean(name)}">' if 'stack' in kind else '<td>' for name in header]
    body = ''.join(f'<tr{next(marks, "")}>' + ''.join(
        f'{cell}{cell_of(value)}</td>' for cell, value in zip(cells, row)) + '</tr>'
        for row in rows)
    caption = f'<caption>{clean(caption)}</caption>' if caption else ''
    kind = f' class="{kind}"' if kind else ''
    return (f'<div class="scroll"><table{kind}>{caption}<thead><tr>{head}</tr></thead><tbody>'
            f'{body}</tbody></table></div>') if body else ''


def cell_of(value):
    """Content of a cell, as HTML."""
    return value if isinstance(value, Markup) else clean('–' if value is None else value)


def group_name(value):
    """A power-on, night or run, for people."""
    return f'{value:g}' if isinstance(value, (float, np.floating)) else str(value)


def number(value, digits=2, sign=False):
    """A number as text; None and NaN are a dash."""
    if value is None or not np.isfinite(value):
        return '–'
    out = f'{value:{"+" if sign else ""}.{digits}f}'
    if not out.strip('+-0.'):  # what is nothing has no sign
        out = out.lstrip('+-')
    return out.replace('-', '−')


def value_and_error(value, sigma):
    """A value and its standard error as texts, to the second digit of the error.

    Parameters
    ----------
    value : float
    sigma : float or None
        Without it the value has five digits.

    Returns
    -------
    tuple of str
    """
    if sigma is None or not np.isfinite(sigma) or not sigma > 0.0:
        size = abs(value) if np.isfinite(value) else 0.0
        return number(value, _digits(size, 5) if size else 2, True), number(sigma, 3)
    digits = _digits(sigma, 2)
    return number(value, digits, True), number(sigma, digits)


def _digits(size, significant):
    """Decimal places with which a number has so many digits that tell, 6 at most."""
    return int(np.clip(significant - 1 - np.floor(np.log10(float(f'{size:.{significant}g}'))),
                       0, 6))


def probability(p):
    """A p-value as text."""
    if p is None or not np.isfinite(p):
        return '–'
    return f'{p:.1g}' if p < 0.01 else f'{p:.2f}'


def gains(rows, floor=None, floor_text='noise'):
    """Bars of errors, on one scale.

    Parameters
    ----------
    rows : list of (str, list of (float or None, str, str))
        What it is of, and each bar: its value in arcsec, its class, what is said beside it.
    floor : float, optional
        Below which no model can come, arcsec.
    floor_text : str
        What that is.
    """
    rows = [(label, [bar for bar in bars if bar[0] is not None and np.isfinite(bar[0])])
            for label, bars in rows]
    if floor is not None and np.isfinite(floor) and floor > 0.0:
        rows.append((floor_text, [(floor, 'floor', '')]))
    rows = [row for row in rows if row[1]]
    if not rows:
        return ''
    top = max(value for _, bars in rows for value, *_ in bars) or 1.0
    out = []
    for name, bars in rows:
        drawn = ''.join(
            f'<p><i class="{kind}" style="width:{70.0 * value / top:.2f}%"></i>'
            f'<span>{clean(" ".join(filter(None, (arcsec(value), label))))}</span></p>'
            for value, kind, label in bars)
        out.append(f'<div>{clean(name)}</div><div>{drawn}</div>')
    return f'<div class="gains">{"".join(out)}</div>'


def legend(*entries):
    """What the marks mean: (class, text) each; by default before and after."""
    entries = entries or (('before', 'before'), ('after', 'after'))
    return '<p class="legend">' + ' '.join(
        f'<span class="swatch {kind}"></span>{clean(text)}' for kind, text in entries) + '</p>'
