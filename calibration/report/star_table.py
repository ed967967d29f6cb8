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

"""Sortable table of all rows of a run, linked to the plots."""

from datetime import datetime, timezone

import numpy as np

from . import page_parts as page
from .number_wording import group_name

WHENS = ('before', 'after')
#: largest number of rows of the table
MAX_TABLE = 1500
_STAR = 'star'


def stars_table(data):
    """Table of all rows, worst first; sortable by any column, rows are highlighted in the plots."""
    if not len(data.used):
        return page.paragraph('There is no row.')
    size = np.hypot(*data.after)
    order = np.argsort(-np.where(np.isfinite(size), size, -1.0), kind='stable')[:MAX_TABLE]
    first, second = (word.split(' × ')[0] for word in data.axes)
    # a prefix common to all names goes to the header
    word, names = _shared_word(data.names)
    head = [word, data.group_word if data.groups is not None else None,
            None if data.time is None else 'UTC' if data.utc else 'time s',
            f'{data.place_words[0]} °', f'{data.place_words[1]} °']
    whens = [page.column(f'{when} {name} ″', when, (when, name) == ('after', 'radial'))
             for when in WHENS for name in (first, second, 'radial')]
    days = data.time is not None and np.nanmax(data.time) - np.nanmin(data.time) > 86400.0
    places = np.degrees(data.places or (np.mod(data.az, 2.0 * np.pi), data.el))
    groups = [] if data.groups is None else [group_name(data.groups[i]) for i in order]
    rows = []
    for k, i in enumerate(order):
        cells = [names[i], *groups[k:k + 1]]
        if data.time is not None:
            cells.append(_clock(data.time[i], days, data.utc))
        cells += [page.number(place[i], 1) for place in places]
        for x, y in (data.before[:, i], data.after[:, i]):
            cells += [page.number(x, 2, True), page.number(y, 2, True), page.number(np.hypot(x, y))]
        rows.append([*cells, data.words[i]])
    some = f'The worst {len(order)} of {len(size)} rows.' if len(order) < len(size) else ''
    return [page.paragraph(some, 'note'), page.table(
        [*(word for word in head if word is not None), *whens, 'what became of it'], rows,
        'stars sort', 'Rows of the run, the worst first', [data.keys[i] for i in order], groups,
        tall=True)]


def _shared_word(names):
    """The first word common to all names, and the rest of each; 'star' if they differ."""
    parts = [str(name).partition(' ') for name in names]
    words = {word if rest else '' for word, _, rest in parts}
    one = next(iter(words)) if len(words) == 1 else ''
    if not one.isalpha():
        return 'star', names
    rows = [rest.partition(f', {_STAR} ') for *_, rest in parts]
    if all(star for *_, star in rows):
        return f'{one}, {_STAR}', [f'{row}, {star}' for row, _, star in rows]
    return one, [rest for *_, rest in parts]


def _clock(seconds, days, utc):
    if not np.isfinite(seconds):
        return '–'
    if not utc:
        return f'{seconds:.0f}'
    moment = datetime.fromtimestamp(seconds, timezone.utc)
    return f'{moment:%m-%d %H:%M:%S}' if days else f'{moment:%H:%M:%S}'
