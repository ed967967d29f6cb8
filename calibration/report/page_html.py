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

"""The HTML of a page: renders all parts to a self-contained file."""

import json
import re
from base64 import b64encode
from functools import singledispatch
from hashlib import sha256
from importlib.resources import files
from itertools import zip_longest

import numpy as np

from pointing_model.effects.base import arcsec

from . import page_parts as page
from .drawing import clean
from .number_wording import number

#: style: colours distinguishable by the colour-blind; light, dark and print. Scripts: highlighting
#: of rows in all plots, sorting of tables, filtering of nights; zooming and saving of plots;
#: exclusion of rows. The page is complete without scripts
CSS, *_SCRIPTS = ('\n' + files(__package__).joinpath(f'page{name}').read_text(encoding='utf-8')
                  for name in ('.css', '.js', '_plots.js', '_refit.js'))
#: the scripts, wrapped for a page that is also XML
SCRIPT = '//<![CDATA[' + re.sub('\n +', '\n', ''.join(_SCRIPTS)) + '//]]>'
_BODY = re.compile('<main>\n(.*)\n</main>', re.DOTALL)
#: parts removed when a page is included in another: control bar and refit data
_ALONE = re.compile('<div (?:class="controls"|id="refit").*?</div>', re.DOTALL)
#: an injected script cannot run: only the page's own script has this hash
_POLICY = ("default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-"
           + b64encode(sha256(SCRIPT.encode()).digest()).decode() + "'")


def whole(title, parts, kind=''):
    """A page: one self-contained file, also well-formed XML.

    Parameters
    ----------
    title : str
    parts : list
        See `page_parts`.
    kind : str
        Description in the head of the page.

    Returns
    -------
    str
    """
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"/>'
            '<meta name="viewport" content="width=device-width, initial-scale=1"/>'
            f'<meta http-equiv="Content-Security-Policy" content="{clean(_POLICY)}"/>'
            + (f'<meta name="description" content="{clean(kind)}"/>' if kind else '')
            + f'<title>{clean(title)}</title><style>{CSS}</style></head><body><main>\n'
            + '\n'.join(filter(None, map(drawn, parts)))
            + f'\n</main><script>{SCRIPT}</script></body></html>\n')


def body_of(text):
    """The body of a page made by `whole`, for inclusion in another page.

    Parameters
    ----------
    text : str

    Returns
    -------
    Markup
        '' if it is no such page.
    """
    found = _BODY.search(text)
    # a page has one main heading and one control bar only
    return page.Markup(_ALONE.sub('', found[1]).replace('<h1>', '<h2 class="part">').replace(
        '</h1>', '</h2>') if found else '')


@singledispatch
def drawn(part):
    """Render a part of a page as HTML; other objects as text, and None as ''.

    Parameters
    ----------
    part
        See `page_parts`.

    Returns
    -------
    str
    """
    return '' if part is None else clean(part)


@drawn.register(list)
@drawn.register(tuple)
def _(parts):
    return ''.join(map(drawn, parts))


@drawn.register
def _(part: page.Markup):
    return part


def _tag(name, inside, kind=''):
    """An element with a class; '' if it is empty."""
    kind = f' class="{kind}"' if kind else ''
    return f'<{name}{kind}>{inside}</{name}>' if inside else ''


_TAGS = {page.Heading: 'h1', page.Footer: 'footer', page.Code: 'code'}


@drawn.register(page.Heading)
@drawn.register(page.Footer)
@drawn.register(page.Code)
def _(part):
    return _tag(_TAGS[type(part)], clean(part.text))


# ------------------------------------------------------------------------------ in a line of text

@drawn.register
def _(part: page.Number):
    return number(part.value, part.digits, part.sign)


@drawn.register
def _(part: page.Size):
    text = clean(arcsec(part.value, part.sign))
    return f'<span{_of_rms(part.when)}>{text}</span>' if part.when else text


def _of_rms(when=''):
    """Attribute of an RMS that a refit in the page updates."""
    return f' data-rms="{when}"' if when else ''


@drawn.register
def _(part: page.Link):
    return f'<a href="{clean(part.place)}">{clean(part.text)}</a>'


@drawn.register
def _(part: page.Numbered):
    return f'<b>{part.number}</b>\u2002{clean(part.text)}'


@drawn.register
def _(part: page.FilledBar):
    return (f'<span class="gauge"><i class="{"inset" if part.inset else ""}" '
            f'style="width:{100 * part.part:.0f}%"></i></span>')


@drawn.register
def _(part: page.Correlation):
    strength = 0.0 if part.diagonal else min(abs(part.value), 1.0)
    colour = '213,94,0' if part.value > 0 else '0,114,178'
    return (f'<span class="corr" style="background:rgba({colour},{0.75 * strength**1.5:.2f})">'
            f'{number(part.value)}</span>')


# ------------------------------------------------------------------------------------------ texts

@drawn.register
def _(part: page.Paragraph):
    return _tag('p', drawn(part.text), part.kind)


@drawn.register
def _(part: page.SentenceList):
    return _tag('ul', ''.join(_tag('li', clean(text)) for text in part.texts if text))


@drawn.register
def _(part: page.Definitions):
    return _tag('dl', ''.join(f'<dt>{clean(word)}</dt><dd>{clean(text)}</dd>'
                              for word, text in part.rows))


# --------------------------------------------------------------------------------------- sections

@drawn.register
def _(part: page.Section):
    body = drawn(part.parts)
    return body and _tag('section', f'<h2>{clean(part.title)}</h2>{_note(part)}{body}')


@drawn.register
def _(part: page.FoldedSection):
    body = drawn(part.parts)
    return body and _tag('section', _folded(f'<h2>{clean(part.title)}</h2>', _note(part) + body),
                         'fold')


def _note(part):
    return _tag('p', clean(part.note), 'note')


def _folded(summary, body):
    return f'<details><summary>{summary}</summary>{body}</details>' if body else ''


@drawn.register
def _(part: page.Subsection):
    body = drawn(part.parts)
    return body and f'<h3>{clean(part.title)}</h3>{body}'


@drawn.register
def _(part: page.Folded):
    return _folded(clean(part.summary), drawn(part.parts))


@drawn.register
def _(part: page.Block):
    kind = f' class="{part.kind}"' if part.kind else ''
    return f'<div{kind}>{drawn(part.parts)}</div>'


@drawn.register
def _(part: page.VerdictSection):
    badge = f'<span class="badge">{clean(part.badge)}</span>' if part.badge else ''
    return _tag('section', f'{badge}<h2>{clean(part.headline)}</h2>{drawn(part.parts)}',
                f'verdict {part.kind}'.rstrip())


# --------------------------------------------------------------------------- figures and numbers

@drawn.register
def _(part: page.Figure):
    return _tag('figure', drawn(part.drawing) + _tag('figcaption', drawn(part.caption)),
                part.when and f'when-{part.when}')


@drawn.register
def _(part: page.Legend):
    return '<p class="legend">' + ' '.join(
        f'<span class="swatch {kind}"></span>{clean(text)}' for kind, text in part.entries) + '</p>'


@drawn.register
def _(part: page.Cards):
    return _tag('div', ''.join(
        f'<div><b{_of_rms(*when)}>{clean(value if isinstance(value, str) else arcsec(value))}</b>'
        f'<span>{clean(text)}</span></div>'
        for value, text, *when in part.rows if value is not None), 'numbers-row')


@drawn.register
def _(part: page.BarChart):
    rows = [(label, [bar for bar in bars if bar[0] is not None and np.isfinite(bar[0])])
            for label, bars in part.rows]
    if part.floor is not None and np.isfinite(part.floor) and part.floor > 0.0:
        rows.append((part.floor_text, [(part.floor, 'floor', '')]))
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


@drawn.register
def _(part: page.Column):
    kind = f' class="when-{part.when}"' if part.when else ''
    order = ' aria-sort="descending"' if part.sorted else ''
    return f'<th scope="col"{kind}{order}>{clean(part.text)}</th>'


@drawn.register
def _(part: page.Table):
    head = ''.join(drawn(cell if isinstance(cell, page.Column) else page.Column(cell))
                   for cell in part.header)
    cells = [f'<td data-h="{clean(name)}">' if 'stack' in part.kind else '<td>'
             for name in part.header]
    body = ''.join(
        '<tr' + ('' if key is None else f' data-i="{key}"')
        + ('' if group is None else f' data-g="{clean(group)}"') + '>'
        + ''.join(f'{cell}{_cell(value)}</td>' for cell, value in zip(cells, row)) + '</tr>'
        for row, key, group in zip_longest(part.rows, part.keys, part.groups))
    kind = f' class="{part.kind}"' if part.kind else ''
    return body and (
        f'<div class="scroll{" tall" * part.tall}"><table{kind}>'
        f'{_tag("caption", clean(part.caption))}<thead><tr>{head}</tr></thead><tbody>{body}'
        '</tbody></table></div>')


def _cell(value):
    """Cell of a table; a dash for None."""
    return '–' if value is None else drawn(value)


# ------------------------------------------------------------------------------ what a reader does

@drawn.register
def _(part: page.Controls):
    whens = ''.join(
        f'<label><input type="radio" name="when" value="{value}"{checked}/> {value}</label>'
        for value, checked in (('both', ' checked="checked"'), ('before', ''), ('after', '')))
    options = ''.join(f'<option value="{clean(name)}" data-say="{clean(say)}">{clean(name)}'
                      '</option>' for name, say in part.groups)
    groups = (f'<label hidden="hidden">{clean(part.word)} <select id="group">'
              f'<option value="">all</option>{options}</select></label>') if options else ''
    return (f'<div class="controls"><fieldset><legend>Show</legend>{whens}</fieldset>{groups}'
            '<span class="foot"><output id="told" aria-live="polite"></output>'
            '<span id="acts"></span></span></div>')


@drawn.register
def _(part: page.RefitData):
    return (f'<div id="refit" hidden="hidden" data-refit="{clean(json.dumps(part.document))}">'
            '</div>')
