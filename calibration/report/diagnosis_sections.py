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

"""Tables of the diagnosis page."""

from pathlib import PurePath

import numpy as np

from calibration.estimation.equal_causes import SET_WIDTH
from pointing_model.effects.base import AXES as AXIS_WORDS
from pointing_model.effects.base import SIDES, arcsec, readable
from pointing_model.mount_kinds import KINDS, USUAL

from . import page_parts as page
from .diagnosis_summary import MOST_OUTLIERS, repeats
from .drawing import svg
from .number_wording import number, probability
from .sky_map import SkyMap

_MEASURES = (('holdout_rms_arcsec', 'held-out runs'), ('cv_rms_arcsec', 'cross-validated'),
             ('rms_arcsec', 'fit residuals'), ('rms_x_arcsec', 'fit residuals, {}'),
             ('rms_y_arcsec', 'fit residuals, {}'))


# ------------------------------------------------------------------------------ before and after

def gain_bars(view):
    """Bars of the error before and after, for each measure, with the noise floor."""
    document = view.document
    before, after = document['before'], document['after']
    words = dict(zip(('rms_x_arcsec', 'rms_y_arcsec'), view.residuals.axes))
    rows = [(label.format(words.get(key)), before.get(key), after.get(key))
            for key, label in _MEASURES
            if before.get(key) is not None or after.get(key) is not None]
    blocks = document.get('cv_contiguous')
    if blocks:
        at = next((i for i, row in enumerate(rows) if row[0].startswith('fit')), len(rows))
        rows.insert(at, ('cross-validated in blocks of time', blocks['before'], blocks['after']))
    if not rows:
        return None
    return page.bar_chart([(label, [(one, 'before', 'before'), (other, 'after', 'after')])
                           for label, one, other in rows], document.get('noise_floor_arcsec'),
                     view.floor)


def evidence(view):
    """Table of the evidence for each effect, and overall figures."""
    rows = [(one.title, page.size(row['removes_rms_arcsec']), _gain(row.get('cv_gain_arcsec')),
             page.number(row.get('delta_bic'), 1), probability(row.get('p_family')),
             _found_in(view.document, row))
            for one, row in zip(view.effects, view.document['effects'])]
    document = view.document
    spread, expected = document['after'].get('cv_spread') or {}, document.get('expected')
    figures = []
    if spread.get('partitions', 0) > 1:
        figures.append((f'cross-validated, {spread["partitions"]} partitions',
                        f'{arcsec(spread["min_arcsec"])} to {arcsec(spread["max_arcsec"])}'))
    if rows and spread.get('folds'):
        same = max(spread.get('same_choice', 0), spread.get('same_set', 0))
        figures.append(('exactly this set', f'{same}/{spread["folds"]} resamples'))
    if expected:
        figures.append((f'new stars, {expected.get("within", "half hour")} ahead',
                        f'{arcsec(expected["rms_arcsec"])} ({arcsec(expected["low_arcsec"])} to '
                        f'{arcsec(expected["high_arcsec"])}, '
                        f'{100 * expected["confidence"]:.0f} %)'))
    return [page.table(('effect', 'RMS removed', 'CV improvement', 'ΔBIC', 'p', 'resamples'), rows,
                       'numbers folding', 'Evidence for each effect'), page.definitions(figures)]


def _gain(value):
    return None if value is None else page.size(value, sign=True)


def _found_in(document, row):
    found, folds = repeats(document, row)
    return None if found is None else f'{found}/{folds}'


def held_out(document, axes):
    """Table of the held-out runs."""
    nights = document.get('held_out') or []
    keys = [f'rms_{key}arcsec' for key in ('x_', 'y_', '')]
    rows = [[f'{night["run"]}: differs' if night['bad'] else night['run'], str(night['rows']),
             str(night['set_aside']),
             *(page.number(night[when][key]) for when in ('before', 'after') for key in keys)]
            for night in nights]
    names = [*(axis.partition(' × ')[0] for axis in axes), 'radial']
    head = ['run', 'rows', 'set aside',
            *(f'{when}, {name}' for when in ('before', 'after') for name in names)]
    note = 'RMS on the sky, arcsec, with outliers.' * bool(nights)
    return page.subsection('Runs held out', [page.table(head, rows, 'numbers folding'),
                                             page.paragraph(note, 'note')])


# ------------------------------------------------------------------------------- the candidates

def ranking(rows, limit=6):
    """The best candidates, with those that the data cannot distinguish marked.

    Parameters
    ----------
    rows : list of dict
        ``name, delta_bic, in_set, driver, axes``, and ``or_noise``: whether correlated noise
        explains as much.
    limit : int
        Number of rows shown; the JSON result has all.
    """
    if not rows:
        return None
    cells = _candidates(rows[:limit])
    marked = any(row.get('or_noise') for row in rows[:limit])
    for cell, row in zip(cells, rows):
        if row.get('or_noise'):
            cell[4] = f'{cell[4]}~'
    more = len(rows) - limit
    return [page.table(_RANKING, cells, 'ranking'), page.paragraph(
        f'●: within {SET_WIDTH:g} of the best ΔBIC' + '; ~: or correlated noise' * marked
        + f'; {more} more in the JSON result' * (more > 0) + '.', 'note')]


_RANKING = ('', 'candidate', 'axis', 'ΔBIC', 'set')


def _candidates(rows):
    """Cells of the ranking's table."""
    top = max((r['delta_bic'] for r in rows if np.isfinite(r['delta_bic'])), default=1.0)
    out = []
    for i, r in enumerate(rows, 1):
        gain = r['delta_bic']
        part = np.clip(gain / top, 0.0, 1.0) if np.isfinite(gain) and top > 0 else 0.0
        out.append([str(i), readable(r['name']), AXIS_WORDS.get(r.get('axes'), r.get('axes')),
                    [page.filled_bar(part, r['in_set']), page.number(gain, 1)],
                    '●' if r['in_set'] else ''])
    return out


# ------------------------------------------------------------------------------------- the rows

def outliers(document, limit=8):
    """Table of outliers, largest first; None if a sentence lists all of them."""
    rows = sorted(document.get('outliers') or (),
                  key=lambda row: -np.hypot(row['x_arcsec'], row['y_arcsec']))
    word = document.get('rows_are') or 'row'
    if len(rows) <= MOST_OUTLIERS:
        return None
    return [page.table((word, 'star', 'off on the sky'), [
        (f'{row.get("source", "")} {row["row"]}'.strip(), row.get('star'),
         page.size(np.hypot(row['x_arcsec'], row['y_arcsec']))) for row in rows[:limit]],
        'numbers'), page.paragraph(f'And {len(rows) - limit} more.' * (len(rows) > limit), 'note')]


def exclusions(excluded, word='row', limit=12):
    """Table of excluded rows by reason."""
    reasons = {}
    for one in excluded:
        reasons.setdefault(str(one.get('reason')), []).append(one)
    several = len({one.get('source') for one in excluded if one.get('source')}) > 1
    rows = []
    for reason, ones in sorted(reasons.items(), key=lambda item: -len(item[1])):
        places = [f'{PurePath(str(one["source"])).name}:{one.get("row")}'
                  if several and one.get('source') else str(one.get('row')) for one in ones]
        first, more = (', '.join(some) for some in (places[:limit], places[limit:]))
        rows.append([reason, str(len(ones)), [first, *[
            ' ', page.folded(f'and {len(places) - limit} more', more)] * bool(more)]])
    return page.table(['reason', 'count', f'{word}s'], rows)


_SAME_CURVE = 'same as terms of the base here'
_UNKNOWN = ' is not known'
_REASONS = 8  # largest number of reasons why effects cannot be tested


def untestable(rows, limit=2):
    """Tables of untestable effects by reason; if many, only some are named."""
    reasons = {}
    for name, reason in rows:
        reasons.setdefault(reason or _SAME_CURVE, []).append(readable(name))
    named = [[reason, ', '.join(names[:limit])
              + f', {len(names) - limit} more' * (len(names) > limit)]
             for reason, names in list(reasons.items())[:_REASONS]]
    unknown = [[reason.removesuffix(_UNKNOWN), names] for reason, names in named
               if reason.endswith(_UNKNOWN)]
    return [page.table(['not known', 'effects'], unknown), page.table(
        ['reason', 'effects'], [row for row in named if not row[0].endswith(_UNKNOWN)])]


# ------------------------------------------------------------------------- next observations

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
    return page.block([page.figure(svg(320, 320, sky.parts, 'Where to observe next')),
                       page.block([tables, page.paragraph(more, 'note')])], 'side')


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
        cells.append([str(row['number']), *(page.number(row[key], 0) for key in places),
                      *[hours] * timed,
                      page.number(row.get('separation_after'), 1)])
        ways.append(', '.join(sides))
    moved = any(ways)
    if moved:
        for row, way in zip(cells, ways):
            row.insert(1 + len(places), way or 'any')
    way = 'side, last motion' if kind.two_sided or any(
        row.get('through_pole') for row in group) else 'last motion'
    return page.subsection('Separates' if head else 'Proposed', [
        page.sentence_list(head), page.paragraph(note, 'note'),
        page.table(['', *(f'{word} [°]' for word in places.values()), *[way] * moved,
                    *['hours from the last row [h], UTC'] * timed, 'expected ΔBIC'], cells)])
