"""Figures and tables of the diagnosis page, each a piece of HTML."""

from pathlib import PurePath

import numpy as np

from calibration.estimation.significance import SET_WIDTH
from pointing_model.effects.base import AXES as AXIS_WORDS
from pointing_model.effects.base import SIDES, arcsec, readable
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import ALTAZ
from pointing_model.rms import rms

from . import page_parts as html
from .drawing import MAX_NAMED, Panel, SkyMap, clean, limit_of, padded, svg

_MEASURES = (('holdout_rms_arcsec', 'held-out runs'), ('cv_rms_arcsec', 'cross-validated'),
             ('rms_arcsec', 'fit residuals'), ('rms_x_arcsec', 'fit residuals, {}'),
             ('rms_y_arcsec', 'fit residuals, {}'))

#: words of pages and tables, and what they mean; docs/glossary.md has them too
WORDS = {
    'sawtooth': 'it grows evenly, falls back at once, and begins again, a period apart',
    'memory': 'after a reversal the new side is reached little by little: 63 % of the way after '
              'so many degrees of motion',
    'RMS': 'root of the mean of the squares: about two of three stars are nearer than this',
    'RMS on the sky': 'of an effect: what it adds to the error of the stars beyond what the terms '
                      'could take up, which is the residual that it leaves if it is not in the '
                      'model. Several add up as squares do',
    'equally well': 'their evidence differs by less than 6 in ΔBIC, so the rows do not rank them',
    'smooth curve': 'a line without corners through what is left, where no cause is known',
    'wave': 'a sine, which rises and falls once a period',
    'bump': 'it is off at one place and little elsewhere',
    'wanders': 'the error moves slowly, so that neighbouring rows err alike, and nothing that was '
               'recorded moves with it',
    'from lowest to highest': 'of an effect: over the rows of this run, beyond what the terms '
                              'could take up, on the axis where that is larger',
    'ΔBIC': 'how much better an effect explains the rows than its coefficients cost; 6 is strong '
            'evidence',
    'noise floor': 'RMS of the fit residuals, corrected for degrees of freedom: seeing, and all '
                   'that nothing here describes',
    'line of sight': 'where the tube looks: it swings where what holds the tube bends or turns, '
                     'and no encoder is wrong then',
    'nods': 'the tube goes up and down as the mount turns, and no encoder is wrong',
    'hysteresis': 'the reading depends on the side from which the star was reached',
}


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
    note = ('RMS on the sky in arcsec (″), radial unless an axis is named. A gain counts on rows '
            f'that neither the fit nor the choice has seen. {_floor_note(document)}')
    return html.gains([(label, [(one, 'before', 'before'), (other, 'after', 'after')])
                       for label, one, other in rows], document.get('noise_floor_arcsec'),
                      view.floor) + ''.join(
        html.paragraph(text, 'note') for text in (note, view.spread, view.choice))


def _floor_note(document):
    """What the last bar is."""
    return ('The last bar is the RMS of the fit residuals, corrected for degrees of freedom: '
            + ('noise of each row, and drift.' if (document.get('wander') or {}).get('slow') else
               'seeing, and all that nothing here describes.'))


def explained(text):
    """Of `WORDS` those that are in a text: list of (word, what it means)."""
    low = text.lower()
    return [(word, meaning) for word, meaning in WORDS.items() if word.lower() in low]


def words(text):
    """What words of a text mean, folded away."""
    return html.folded('Words', html.definitions(explained(text)))


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
    note = 'RMS on the sky in arcsec, of all rows: those set aside as outliers too.' * bool(nights)
    return html.subsection('Runs held out', html.table(head, rows, 'numbers folding'),
                           html.paragraph(note, 'note'))


def legend(fit=False):
    """What the marks mean."""
    marks = [('before', 'before'), ('after', 'after')]
    return html.legend(*marks, *[('fit', 'what the added effects, and the terms fitted anew '
                                'beside them, take away')] * fit)


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
        top = _panel(driver, 24, 120, limit, '', 'before [arcsec]', title)
        low = _panel(driver, 156, 120, limit, driver.label, 'after [arcsec]', '')
        top.points(x[used], before[used], 'before')
        if view.changed:
            top.dashes(x[used], (before - after)[used], 'fit')
        low.points(x[used], after[used], 'after')
        out.append(svg(420, 320, [*top.parts, *low.parts], f'Residual, {title}, {driver.label}'))
    missing = int((~np.isfinite(driver.values[used])).sum())
    caption = f'Unknown in {missing} rows.' if missing else ''
    return html.subsection(driver.title, html.figure(html.pair(out), caption))


def driver_figures(view, limit=8):
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
        'What no term and no other effect can take up, all of them fitted beside it: the effect '
        f'(strokes, {arcsec(float(rms(*own[:, used])))} RMS) and the effect with what is left '
        f'(dots), against {driver.label}. The effect is there as far as the dots go with the '
        f'strokes.{_how_to_read(driver, effect)}')


def _how_to_read(driver, effect):
    """How a figure against a driver of a few values is read."""
    if not driver.levels:
        return ''
    text = (' One column for each; within it dots are moved sideways only so that they do not '
            'hide each other. The effect is the jump of the strokes from one column to the '
            'other, and holds as far as the dots follow it.')
    if effect.gradual:
        text += (' Strokes between the two belong to rows reached by a move too short to be wholly '
                 'on the new side.')
    if effect.fades:
        text += (' On the sky the jump is smaller where cos E is, so strokes of one column lie at '
                 'several heights.')
    return text


# ------------------------------------------------------------------------------- the candidates

def ranking(rows, slow=(), limit=15):
    """Candidates by gain, those that are not told apart marked.

    Parameters
    ----------
    rows : list of dict
        ``name, delta_bic, in_set, driver, axes``.
    slow : sequence of str
        Names of those that a zero that wanders explains as well.
    limit : int
        Rows shown; the others fold away.
    """
    if not rows:
        return ''
    cells = _candidates(rows)
    for cell, row in zip(cells, rows):
        if row['name'] in slow:
            cell[5] = f'{cell[5]}{"; " * bool(cell[5])}or a wander'
    return html.table(_RANKING, cells[:limit], 'ranking') + html.folded(
        f'{len(cells) - limit} more candidates', html.table(_RANKING, cells[limit:], 'ranking')) \
        + html.paragraph(
            f'Candidates within {SET_WIDTH:g} of the best ΔBIC are one set: alone, these '
            'observations do not tell them apart. '
            + ('Those with "or a wander" go with the order of the rows: a zero that wanders '
               'explains them as well, so they were not added. ' * any(
                   row['name'] in slow for row in rows))
            + 'A large gain alone is none beside the effects that were found: of each of these '
            '"What else was tried in its place" has the gains with the others in the model.',
            'note')


_RANKING = ('', 'candidate', 'driver', 'axis', 'gain ΔBIC', 'set')


def _candidates(rows):
    """Cells of the ranking's table."""
    top = max((r['delta_bic'] for r in rows if np.isfinite(r['delta_bic'])), default=1.0)
    out = []
    for i, r in enumerate(rows, 1):
        gain = r['delta_bic']
        part = np.clip(gain / top, 0.0, 1.0) if np.isfinite(gain) and top > 0 else 0.0
        bar = html.Markup(f'<span class="gauge"><i class="{"inset" if r["in_set"] else ""}" '
                          f'style="width:{100 * part:.0f}%"></i></span>{html.number(gain, 1)}')
        out.append([str(i), readable(r['name']), readable(r.get('driver') or '–'),
                    AXIS_WORDS.get(r.get('axes'), r.get('axes')), bar,
                    '● in the set' if r['in_set'] else ''])
    return out


def alternatives(rows, limit=6):
    """The strongest candidates for the place of one effect, folded away."""
    if len(rows) < 2:
        return ''
    return html.folded('What else was tried in its place, all other effects in the model',
                       html.table(_RANKING, _candidates(rows)[:limit], 'ranking'))


# ------------------------------------------------------------------------ exclusions, proposals

def outliers(document, limit=8):
    """Outliers, the farthest first; nothing where there is none."""
    rows = sorted(document.get('outliers') or (),
                  key=lambda row: -np.hypot(row['x_arcsec'], row['y_arcsec']))
    word = document.get('rows_are') or 'row'
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


def next_observations(groups, mount=ALTAZ):
    """Proposed observations, as tables and on the sky.

    Parameters
    ----------
    groups : list of (str, list of dict, str)
        As of `observation_wording.proposal_groups`.
    mount : Mount
        Whose kind says what a motion of its axes is called.
    """
    if not groups:
        return ''
    rows = sorted((row for _, group, _ in groups for row in group), key=lambda row: row['number'])
    sky = SkyMap(320, 0.0, mount)
    az, el = (np.radians([float(row[name]) for row in rows]) for name in ('az_deg', 'el_deg'))
    sky.marks(az, el, 'next', [f'{a:.0f}° azimuth, {e:.0f}° elevation'
                               for a, e in zip(np.degrees(az), np.degrees(el))])
    drawing = html.figure(svg(320, 320, sky.parts, 'Where to observe next'),
                     'Zenith in the middle, horizon at the rim, numbered as in the tables.')
    tables = ''.join(_next_group(*group, KINDS[mount.kind]) for group in groups)
    return f'<div class="side">{drawing}<div>{tables}</div></div>'


def _next_group(head, group, note, names):
    timed = any(row.get('after_hours') is not None for row in group)
    places = {f'{column}_deg': word for column, word in zip(
        (*names.columns, 'az', 'el'), (*names.axes, 'azimuth', 'elevation'))
        if f'{column}_deg' in group[0]}
    cells = []
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
                      ', '.join(sides) or 'any', *[hours] * timed,
                      html.number(row.get('separation_after'), 1)])
    return html.subsection(
        f'Tells {head}' if head else 'Proposed', html.paragraph(note, 'note'),
        html.table(['', *(f'{word} [°]' for word in places.values()),
               'side, last motion' if names.two_sided or any(
                   row.get('through_pole') for row in group) else 'last motion',
               *(['hours from the last row [h], UTC'] if timed else []),
               'ΔBIC expected with it and those above'], cells))


_SAME_CURVE = 'it is the same as terms of the base on these directions'


def untestable(rows):
    """What the run cannot show, and why, by reason."""
    reasons = {}
    for name, reason in rows:
        reasons.setdefault(reason or _SAME_CURVE, []).append(readable(name))
    return html.table(['reason', 'effects'], [[reason, ', '.join(names)]
                                         for reason, names in reasons.items()])


def run_terms_table(runs):
    """Terms that each run fitted for itself."""
    names = list(dict.fromkeys(name for terms in runs.values() for name in terms))
    rows = [[PurePath(str(run)).name, *(html.number(terms.get(name), 2, True) for name in names)]
            for run, terms in runs.items()]
    return html.folded('Terms that each run fits for itself', html.table(
        ['run', *(f'{name} [arcsec]' for name in names)], rows, 'numbers'))
