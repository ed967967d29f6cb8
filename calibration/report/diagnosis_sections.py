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

"""Figures and tables of the diagnosis page, each a piece of HTML."""

from itertools import pairwise
from pathlib import PurePath

import numpy as np

from calibration.estimation.significance import SET_WIDTH
from pointing_model.effects.base import AXES as AXIS_WORDS
from pointing_model.effects.base import SIDES, arcsec, readable
from pointing_model.mount_kinds import KINDS, kind_of
from pointing_model.mounts import ALTAZ
from pointing_model.rms import rms

from . import page_parts as html
from .diagnosis_summary import MOST_OUTLIERS
from .diagnosis_wording import limit_words
from .drawing import MAX_NAMED, Panel, SkyMap, clean, limit_of, padded, svg

_MEASURES = (('holdout_rms_arcsec', 'held-out runs'), ('cv_rms_arcsec', 'cross-validated'),
             ('rms_arcsec', 'fit residuals'), ('rms_x_arcsec', 'fit residuals, {}'),
             ('rms_y_arcsec', 'fit residuals, {}'))


# ------------------------------------------------------------------------------ before and after

def gain_bars(view):
    """Bars of the error before and after, each measure, with the noise floor."""
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
        return ''
    return html.gains([(label, [(one, 'before', 'before'), (other, 'after', 'after')])
                       for label, one, other in rows], document.get('noise_floor_arcsec'),
                      view.floor)


def evidence(view):
    """What speaks for each effect, in numbers; and figures of the whole."""
    rows = [(one.title, arcsec(row['removes_rms_arcsec']), _gain(row.get('cv_gain_arcsec')),
             html.number(row.get('delta_bic'), 1), html.probability(row.get('p_family')),
             _found_in(view.document, row['name']))
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
    return html.table(('effect', 'RMS removed', 'CV improvement', 'ΔBIC', 'p', 'resamples'), rows,
                      'numbers folding', 'Evidence for each effect') + html.definitions(figures)


def _gain(value):
    return None if value is None else arcsec(value, True)


def _found_in(document, name):
    spread = document['after'].get('cv_spread') or {}
    found = (spread.get('chosen_set') or spread.get('chosen') or {}).get(name)
    return None if found is None else f'{found}/{spread["folds"]}'


def detection_limits(document):
    """What these rows would have shown, as a table; nothing where an effect was found."""
    words, units = limit_words(kind_of(document)), {
        'arcsec/h': '″/h', 'arcsec/K': '″/K', 'arcsec/run': '″/run'}
    return html.table(('error', 'limit'), [
        (words[row['name']], f'{row["amplitude_arcsec"]:.2f}{units.get(row["unit"], "″")}')
        for row in document.get('detectable') or ()], 'numbers', 'Detection limits')


def held_out(document, axes):
    """Runs held out, each for itself."""
    nights = document.get('held_out') or []
    keys = [f'rms_{key}arcsec' for key in ('x_', 'y_', '')]
    rows = [[f'{night["run"]}: bad' if night['bad'] else night['run'], str(night['rows']),
             str(night['set_aside']),
             *(html.number(night[when][key]) for when in ('before', 'after') for key in keys)]
            for night in nights]
    names = [*(axis.partition(' × ')[0] for axis in axes), 'radial']
    head = ['run', 'rows', 'set aside',
            *(f'{when}, {name}' for when in ('before', 'after') for name in names)]
    note = 'RMS on the sky, arcsec, with outliers.' * bool(nights)
    return html.subsection('Runs held out', html.table(head, rows, 'numbers folding'),
                           html.paragraph(note, 'note'))


def legend(fit=False):
    """What the marks mean."""
    marks = [('before', 'before'), ('after', 'after')]
    return html.legend(*marks, *[('fit', 'effects')] * fit)


# ----------------------------------------------------------------------------- against a driver

def _spread(driver):
    """Values to draw: those of few levels side by side."""
    if not driver.levels:
        return driver.values
    return driver.values + 0.28 * (np.modf(np.arange(len(driver.values)) * 0.618)[0] - 0.5) * 2


def _panel(driver, top, height, limit, x_label, y_label, title):
    """Residuals up to a limit against a driver: a panel with its axes."""
    places = texts = None
    span = padded(driver.values, 0.03)
    if driver.levels:
        places = sorted(driver.levels)
        texts, span = [driver.levels[k] for k in places], (places[0] - 0.5, places[-1] + 0.5)
    panel = Panel((58, top, 350, height), span, (-limit, limit))
    panel.axes(x_label, y_label, title, places, texts)
    return panel


def driver_figure(view, driver):
    """Both axes against one driver: before with the fit drawn in, after below."""
    out = []
    x, data = _spread(driver), view.residuals
    used = data.used
    for axis, title in enumerate(data.axes):
        before, after = data.before[axis], data.after[axis]
        limit = limit_of(before[used], after[used])
        top = _panel(driver, 24, 120, limit, '', '[″]', title)
        low = _panel(driver, 156, 120, limit, driver.label, '[″]', '')
        for panel, values, when in ((top, before, 'before'), (low, after, 'after')):
            linked = len(data) <= _LINKED
            panel.points(x[used], values[used], when,
                         keys=[data.keys[i] for i in np.flatnonzero(used)] if linked else None,
                         moves=f' data-when="{when}"{panel.moving((None, axis))}' * linked)
        if view.changed:
            top.dashes(x[used], (before - after)[used], 'fit')
        out.append(svg(420, 320, [*top.parts, *low.parts], f'Residual, {title}, {driver.label}',
                       'link'))
    missing = int((~np.isfinite(driver.values[used])).sum())
    caption = f'Unknown in {missing} rows.' if missing else ''
    return html.figure(html.pair(out), caption)


#: rows up to which figures against drivers have every row to point at
_LINKED = 300


def driver_figures(view, limit=6):
    """All drivers; those after the first `limit` fold away."""
    drawn = [driver_figure(view, driver) for driver in view.drivers]
    shown, more = ''.join(drawn[:limit]), ''.join(drawn[limit:])
    return shown + html.folded(f'{len(drawn) - limit} more drivers', more)


def effect_figure(view, effect):
    """What is left without this effect alone, and the effect drawn in, against its driver."""
    driver = effect.driver
    if driver is None:
        return ''
    data, own = view.residuals, effect.own
    x, used = _spread(driver), data.used & np.isfinite(own).all(axis=0)
    out = []
    for axis, title in enumerate(data.axes):
        if not np.any(np.abs(effect.fitted[axis][used]) > 1e-9):
            continue
        fitted = own[axis]
        partial = data.after[axis] + fitted
        limit = limit_of(partial[used], fitted[used])
        panel = _panel(driver, 26, 190, limit, driver.label, 'residual [arcsec]', title)
        names = [data.names[i] for i in np.flatnonzero(used)] if used.sum() <= MAX_NAMED else None
        panel.points(x[used], partial[used], 'before', names)
        panel.dashes(x[used], fitted[used], 'fit', 26.0 if driver.levels else 7.0)
        out.append(svg(420, 262, panel.parts, f'{effect.name}, {title}'))
    if not out:
        return ''
    return html.figure(
        out[0] if len(out) == 1 else html.pair(out),
        f'Strokes: the effect, {arcsec(float(rms(*own[:, used])))} RMS; dots: effect plus '
        f'residual{_how_to_read(driver, effect)}.')


def _how_to_read(driver, effect):
    """What else a figure against a driver of a few values needs."""
    return ', spread sideways' * bool(driver.levels) + ' (smaller higher up)' * bool(
        driver.levels and effect.fades)


# ------------------------------------------------------------------------------- the candidates

def ranking(rows, slow=(), limit=6):
    """The best candidates, with those that the data cannot distinguish marked.

    Parameters
    ----------
    rows : list of dict
        ``name, delta_bic, in_set, driver, axes``.
    slow : sequence of str
        Names of those that correlated noise explains as well.
    limit : int
        Rows shown; the JSON result has all.
    """
    if not rows:
        return ''
    cells = _candidates(rows[:limit])
    marked = any(row['name'] in slow for row in rows[:limit])
    for cell, row in zip(cells, rows):
        if row['name'] in slow:
            cell[4] = f'{cell[4]}~'
    more = len(rows) - limit
    return html.table(_RANKING, cells, 'ranking') + html.paragraph(
        f'●: within {SET_WIDTH:g} of the best ΔBIC' + '; ~: or correlated noise' * marked
        + f'; {more} more in the JSON result' * (more > 0) + '.', 'note')


_RANKING = ('', 'candidate', 'axis', 'ΔBIC', 'set')


def _candidates(rows):
    """Cells of the ranking's table."""
    top = max((r['delta_bic'] for r in rows if np.isfinite(r['delta_bic'])), default=1.0)
    out = []
    for i, r in enumerate(rows, 1):
        gain = r['delta_bic']
        part = np.clip(gain / top, 0.0, 1.0) if np.isfinite(gain) and top > 0 else 0.0
        bar = html.Markup(f'<span class="gauge"><i class="{"inset" if r["in_set"] else ""}" '
                          f'style="width:{100 * part:.0f}%"></i></span>{html.number(gain, 1)}')
        out.append([str(i), readable(r['name']), AXIS_WORDS.get(r.get('axes'), r.get('axes')),
                    bar, '●' if r['in_set'] else ''])
    return out


def causes(rows):
    """Likely causes of an effect: evidence, coefficients, what to look at."""
    rows = [list(row) for row in rows]
    for before, row in reversed(list(pairwise(rows))):
        if row[-1] and row[-1] == before[-1]:
            row[-1] = 'the same'
    return html.table(('cause', 'ΔBIC', 'coefficients ″', 'check'), rows, 'folding stack')


# ------------------------------------------------------------------------ exclusions, proposals

def outliers(document, limit=8):
    """Outliers, the farthest first; nothing where a sentence has all of them."""
    rows = sorted(document.get('outliers') or (),
                  key=lambda row: -np.hypot(row['x_arcsec'], row['y_arcsec']))
    word = document.get('rows_are') or 'row'
    if len(rows) <= MOST_OUTLIERS:
        return ''
    return html.table((word, 'star', 'off on the sky'), [
        (f'{row.get("source", "")} {row["row"]}'.strip(), row.get('star'),
         arcsec(np.hypot(row['x_arcsec'], row['y_arcsec']))) for row in rows[:limit]],
        'numbers') + html.paragraph(
            f'And {len(rows) - limit} more.' * (len(rows) > limit), 'note')


def exclusions(excluded, word='row', limit=12):
    """What was left out, by reason, with the rows."""
    reasons = {}
    for one in excluded:
        reasons.setdefault(str(one.get('reason')), []).append(one)
    several = len({one.get('source') for one in excluded if one.get('source')}) > 1
    rows = []
    for reason, ones in sorted(reasons.items(), key=lambda item: -len(item[1])):
        places = [f'{PurePath(str(one["source"])).name}:{one.get("row")}'
                  if several and one.get('source') else str(one.get('row')) for one in ones]
        first, more = (clean(', '.join(some)) for some in (places[:limit], places[limit:]))
        more = html.folded(f'and {len(places) - limit} more', more)
        rows.append([reason, str(len(ones)), html.Markup(f'{first} {more}'.rstrip())])
    return html.table(['reason', 'count', f'{word}s'], rows)


#: pairs of causes whose observations are listed
_PAIRS = 2


def next_observations(groups, mount=ALTAZ):
    """Proposed observations, as tables and on the sky.

    Parameters
    ----------
    groups : list of (list of str, list of dict, str)
        As of `observation_wording.proposal_groups`.
    mount : Mount
        Whose kind says what a motion of its axes is called.
    """
    if not groups:
        return ''
    rows = sorted((row for _, group, _ in groups[:_PAIRS] for row in group),
                  key=lambda row: row['number'])
    sky = SkyMap(320, 0.0, mount)
    az, el = (np.radians([float(row[name]) for row in rows]) for name in ('az_deg', 'el_deg'))
    sky.marks(az, el, 'next', [f'{a:.0f}° azimuth, {e:.0f}° elevation'
                               for a, e in zip(np.degrees(az), np.degrees(el))])
    drawing = html.figure(svg(320, 320, sky.parts, 'Where to observe next'), '')
    tables = ''.join(_next_group(*group, KINDS[mount.kind]) for group in groups[:_PAIRS])
    more = f'{len(groups) - _PAIRS} more in the JSON result.' * (len(groups) > _PAIRS)
    return (f'<div class="side">{drawing}<div>{tables}{html.paragraph(more, "note")}</div></div>')


def _next_group(head, group, note, names):
    timed = any(row.get('after_hours') is not None for row in group)
    places = {f'{column}_deg': word for column, word in zip(
        (*names.columns, 'az', 'el'), (*names.axes, 'azimuth', 'elevation'))
        if f'{column}_deg' in group[0]}
    cells, ways = [], []
    for row in group:
        sides = [words[row[key] > 0] for key, words in zip(SIDES, names.sides)
                 if row.get(key) in (-1, 1)]
        if row.get('through_pole'):
            sides.insert(0, 'through the pole')
        if row['counterweight_up']:
            sides.insert(0, 'counterweight up')
        if row.get('last_move_deg'):
            sides.append(f'{row["last_move_deg"]:g}° back')
        hours = f'{html.number(row.get("after_hours"), 1)} {row.get("utc") or ""}'
        cells.append([str(row['number']), *(html.number(row[key], 0) for key in places),
                      *[hours] * timed,
                      html.number(row.get('separation_after'), 1)])
        ways.append(', '.join(sides))
    moved = any(ways)
    if moved:
        for row, way in zip(cells, ways):
            row.insert(1 + len(places), way or 'any')
    return html.subsection(
        'Separates' if head else 'Proposed', html.listed(head), html.paragraph(note, 'note'),
        html.table(['', *(f'{word} [°]' for word in places.values()),
               *(['side, last motion' if names.two_sided or any(
                   row.get('through_pole') for row in group) else 'last motion'] if moved else []),
               *(['hours from the last row [h], UTC'] if timed else []), 'expected ΔBIC'], cells))


_SAME_CURVE = 'same as terms of the base here'
_UNKNOWN = ' is not known'
_REASONS = 8  # why effects cannot be tested, at most


def untestable(rows, limit=2):
    """What the run cannot show, and why, by reason; of many effects some are named."""
    reasons = {}
    for name, reason in rows:
        reasons.setdefault(reason or _SAME_CURVE, []).append(readable(name))
    named = [[reason, ', '.join(names[:limit])
              + f', {len(names) - limit} more' * (len(names) > limit)]
             for reason, names in list(reasons.items())[:_REASONS]]
    unknown = [[reason.removesuffix(_UNKNOWN), names] for reason, names in named
               if reason.endswith(_UNKNOWN)]
    return html.table(['not known', 'effects'], unknown) + html.table(
        ['reason', 'effects'], [row for row in named if not row[0].endswith(_UNKNOWN)])


def run_terms_table(runs):
    """Terms that each run fitted for itself."""
    names = list(dict.fromkeys(name for terms in runs.values() for name in terms))
    rows = [[PurePath(str(run)).name, *(html.number(terms.get(name), 2, True) for name in names)]
            for run, terms in runs.items()]
    return html.folded('Terms that each run fits for itself', html.table(
        ['run', *(f'{name} [arcsec]' for name in names)], rows, 'numbers'))
