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

"""Where to observe next, as tables and on a sky map."""

import numpy as np

from pointing_model.effects.base import SIDES
from pointing_model.mount_kinds import KINDS, USUAL

from . import page_parts as page
from .drawing import svg
from .number_wording import number
from .sky_map import SkyMap

#: largest number of pairs of causes whose observations are listed
_PAIRS = 2


def next_observations(groups, kind=KINDS[USUAL], grid=None):
    """Proposed observations, as tables and on a sky map.

    Parameters
    ----------
    groups : list of (list of str, list of dict, str)
        See `observation_wording.proposal_groups`.
    kind : MountKind
        Gives the names of motions of the axes.
    grid : tuple, optional
        Coordinate grid of the mount on the sky, see `sky_map.grid_of`.
    """
    if not groups:
        return None
    rows = sorted((row for _, group, _ in groups[:_PAIRS] for row in group),
                  key=lambda row: row['number'])
    more = f'{len(groups) - _PAIRS} more in the JSON result.' * (len(groups) > _PAIRS)
    tables = [_next_group(*group, kind) for group in groups[:_PAIRS]]
    sky = SkyMap(320, 0.0, grid)
    az, el = (np.radians([float(row[name]) for row in rows]) for name in ('az_deg', 'el_deg'))
    sky.marks(az, el, 'next', [f'{a:.0f}° azimuth, {e:.0f}° elevation'
                               for a, e in zip(np.degrees(az), np.degrees(el))])
    return page.Block([page.Figure(svg(320, 320, sky.parts, 'Where to observe next')),
                       page.Block([tables, page.Paragraph(more, 'note')])], 'side')


def _next_group(head, group, note, kind):
    timed = any(row.get('after_hours') is not None for row in group)
    places = {f'{column}_deg': word for column, word in zip(
        (*kind.columns, 'az', 'el'), (*kind.axes, 'azimuth', 'elevation'))
        if f'{column}_deg' in group[0]}
    cells, ways = [], []
    for row in group:
        sides = [words[row[key] > 0] for key, words in zip(SIDES, kind.sides)
                 if row.get(key) in (-1, 1)]
        if row.get('through_pole'):
            sides.insert(0, 'through the pole')
        if row['counterweight_up']:
            sides.insert(0, 'counterweight up')
        if row.get('last_move_deg'):
            sides.append(f'{row["last_move_deg"]:g}° back')
        hours = f'{number(row.get("after_hours"), 1)} {row.get("utc") or ""}'
        cells.append([str(row['number']), *(page.Number(row[key], 0) for key in places),
                      *[hours] * timed,
                      page.Number(row.get('separation_after'), 1)])
        ways.append(', '.join(sides))
    moved = any(ways)
    if moved:
        for row, way in zip(cells, ways):
            row.insert(1 + len(places), way or 'any')
    way = 'side, last motion' if kind.two_sided or any(
        row.get('through_pole') for row in group) else 'last motion'
    return page.Subsection('Separates' if head else 'Proposed', [
        page.SentenceList(head), page.Paragraph(note, 'note'),
        page.Table(['', *(f'{word} [°]' for word in places.values()), *[way] * moved,
                    *['hours from the last row [h], UTC'] * timed, 'expected ΔBIC'], cells)])
