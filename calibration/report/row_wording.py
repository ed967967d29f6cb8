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

"""Words for rows: how many were used, which were excluded, and why."""

from pathlib import PurePath

import numpy as np

from calibration.analysis.diagnosis.readings import MIRRORED, NEGATED, Reading, without_signs
from pointing_model.effects.base import arcsec
from pointing_model.mount_kinds import kind_of
from pointing_model.runs.columns.run_table import AS_NAMED

_NAMED = 5  # largest number of outliers in a sentence
_REASONS = 12  # largest number of lines on excluded rows
_FOOT = 1.01  # smallest residual ratio at which a row counts as worse
#: p-value of the worst row under noise alone, above which it is not reported
_BY_CHANCE = 0.05
#: largest number of rows of one star that are listed
_VISITS = 4
#: ratio of fit residuals to the noise between visits, above which they are more than noise
_MORE = 1.3


def used_sentence(counts):
    """The first line of the output: number of rows used.

    Parameters
    ----------
    counts : dict
        With ``rows_used``, ``rows_read``, ``rows_taken_back``.

    Returns
    -------
    str
    """
    more = counts.get('rows_taken_back')
    return f'{counts["rows_used"]} of {counts["rows_read"]} rows used' + (
        f'; {more} more {"is" if more == 1 else "are"} commented out or rejected in the file'
        if more else '')


def expected_sentence(document):
    """The expected error of the model, from a document with ``expected``; None if unknown."""
    expected = document.get('expected')
    if not expected:
        return None
    return (f'expected on new stars in the {expected.get("within", "half hour")} after: '
            f'{expected["rms_arcsec"]:.2f} arcsec radial, {expected["low_arcsec"]:.2f} to '
            f'{expected["high_arcsec"]:.2f} ({100 * expected["confidence"]:.0f} %)')


def outlier_sentence(document):
    """Which rows are outliers, and the RMS with them; '' if there are none.

    Parameters
    ----------
    document : dict
        With ``outliers``, ``rms_with_outliers_arcsec``, ``after`` and ``rows_are``.

    Returns
    -------
    str
    """
    rows = document.get('outliers') or []
    if not rows:
        return ''
    word = document.get('rows_are') or 'row'
    named = ', '.join(
        (f'{row["source"]} ' if 'source' in row else '')
        + f'{word} {row["row"]} ('
        + (f'star {row["star"]}, ' if 'star' in row else '')
        + f'{far_text(np.hypot(row["x_arcsec"], row["y_arcsec"]))} off)'
        for row in rows[:_NAMED])
    more = f' and {len(rows) - _NAMED} more' if len(rows) > _NAMED else ''
    return (f'{len(rows)} outlier{"s" * (len(rows) > 1)} excluded: {named}{more}. RMS '
            f'{document["after"]["rms_arcsec"]:.2f}″, with {"it" if len(rows) == 1 else "them"} '
            f'{document["rms_with_outliers_arcsec"]:.1f}″.')


def far_text(arcsec):
    """Size of an error in arcsec, or in deg from 1 deg on."""
    return f'{arcsec:.0f} arcsec' if arcsec < 3600.0 else f'{arcsec / 3600.0:.2f} deg'


def left_out_lines(excluded, several=False, word='row'):
    """Excluded rows and reasons: a line for each reason.

    Parameters
    ----------
    excluded : list of dict
        ``row`` (the line in the file), ``reason``, ``source``.
    several : bool
        Whether there are several files, so that the lines name them.
    word : str
        See `RowCounts`.

    Returns
    -------
    list of str
    """
    reasons = {}
    for one in excluded:
        source = PurePath(str(one['source'])).name if several and one.get('source') else ''
        reasons.setdefault((source, one['reason']), []).append(one['row'])
    lines = [f'{source}{": " if source else ""}{word}{"s" * (len(rows) > 1)} {listed(rows)} '
             f'left out: {reason}' for (source, reason), rows in reasons.items()]
    if len(lines) <= _REASONS:
        return lines
    others = list(reasons.values())[_REASONS:]
    return [*lines[:_REASONS], f'{sum(map(len, others))} {word}s more left out, for {len(others)} '
            'other reasons (--json FILE has them all)']


def listed(rows, limit=10):
    """Numbers as text, consecutive ones as a range: 3, 7-9; if many, the first and the total."""
    rows = sorted(set(rows))
    breaks = [i for i, (a, b) in enumerate(zip(rows, rows[1:]), 1) if b != a + 1]
    parts = [rows[i:j] for i, j in zip([0, *breaks], [*breaks, len(rows)])]
    texts = [f'{p[0]}' if len(p) == 1 else f'{p[0]}-{p[-1]}' for p in parts]
    more = f', ... ({len(rows)} rows)' if len(texts) > limit else ''
    return ', '.join(texts[:limit]) + more


def columns_alike(readings):
    """Sentence on readings of the columns that fit equally well."""
    return ('another reading of the columns fits equally well. Check: '
            + '. Or: '.join(readings))


def signs_sentences(alike, names, taken=AS_NAMED):
    """Sentences on ambiguities of the columns (signs, exchange) that no fit can detect.

    Parameters
    ----------
    alike : sequence of str
        `Diagnosis.columns_alike`.
    names : mount_kinds.MountKind
    taken : str
        ``meta['taken']`` of the run: how offsets are counted.

    Returns
    -------
    list of str
    """
    sentences, images = [], [one.text(names=names) for one in (MIRRORED, NEGATED)]
    mirror = ''.join(f', or {one}' for one in images if one in alike)
    if Reading(exchanged=True).text() in alike or mirror:
        sentences.append(f'signs: {taken}; positive: the encoder reads too much. No run can '
                         f'confirm it: check that the file does not exchange mount and '
                         f'catalogue{mirror}')
    rest = without_signs(alike, names)
    return sentences + [columns_alike(rest)] * bool(rest)


def _reading_as_good(found):
    zero, tilt = found['sizes_deg']
    own_zero, own_tilt = found['as_written_deg']
    return (f'{found["where"]}{found.causes[0]} would fit as well: zero {zero:.3g} deg, tilt '
            f'{tilt:.3g} instead of {own_zero:.3g} and {own_tilt:.3g}. Check the '
            f'{found["what"]}')


def worst_sentence(document):
    """Whether the effects made the worst row worse, or another row the worst; '' if neither.

    Parameters
    ----------
    document : dict
        With ``worst_rows``, ``rows_are`` and ``mount``.

    Returns
    -------
    str
        Also '' if noise alone explains the worst of so many rows.
    """
    rows = document.get('worst_rows')
    if not rows:
        return ''
    before, after = rows['before'], rows['after']
    word = document.get('rows_are') or 'row'
    axes = kind_of(document).axes

    def named(row):
        text = (f'{row["source"]} ' if 'source' in row else '') + f'{word} {row["row"]}'
        if 'az_deg' not in row:
            return text
        return f'{text} ({axes[0]} {row["az_deg"]:.0f}°, {axes[1]} {row["el_deg"]:.0f}°)'.replace(
            '-', '−')

    def moved(row):
        return f'{arcsec(row["before_arcsec"])} before, {arcsec(row["after_arcsec"])} after'

    def worse(row):
        return row['after_arcsec'] > max(_FOOT * row['before_arcsec'], by_chance)
    by_chance = _worst_by_chance(document)
    same = before == after
    sentences = []
    if worse(before):
        sentences.append(f'The worst row, {named(before)}, became worse: {moved(before)}.')
    if not same and worse(after):
        sentences.append(f'Now the worst row is {named(after)}: {moved(after)}.')
    if not sentences:
        return ''
    return ' '.join(sentences) + (
        ' The effects help on the whole, not there: look at that observation.')


def _worst_by_chance(document):
    """Critical value of the largest residual of all rows under noise alone, arcsec."""
    left, count = document.get('after') or {}, document.get('observations')
    sigma = max(left.get('rms_x_arcsec') or 0.0, left.get('rms_y_arcsec') or 0.0)
    return float(sigma * np.sqrt(2.0 * np.log(count / _BY_CHANCE))) if count else 0.0


def bad_nights(document, axes):
    """A sentence for each bad night.

    Parameters
    ----------
    document : dict
        With ``held_out``.
    axes : sequence of str
        Names of x and y.

    Returns
    -------
    list of str
    """
    nights = document.get('held_out') or []
    good = [night for night in nights if not night['bad']]
    sentences = []
    for night in nights:
        if not night['bad']:
            continue
        after, times = night['after'], night['bad']
        each = ', '.join(
            f'{word} {after[f"rms_{key}_arcsec"]:.1f}\u2033 RMS, '
            + (f'{times[key]:.1f} times the scatter of the others' if times[key] > 1.5
               else 'as the others') for key, word in zip('xy', axes))
        sentences.append(f'The night {night["run"]} is noisy, or its terms are others: {each}'
                    + (f'; {night["set_aside"]} of its {night["rows"]} rows are excluded as '
                       'outliers' if night['set_aside'] else '')
                    + '. Fit it alone to see which; judge the model without it'
                    + (': on the other' + ('s' if len(good) > 1 else '') + ' it leaves '
                       + _together(good, 'after') + f' (before {_together(good, "before")}).'
                       if good else '.'))
    return sentences


def _together(nights, when):
    rows = np.array([night['rows'] for night in nights], float)
    squares = np.array([night[when]['rms_arcsec'] for night in nights])**2
    return f'{np.sqrt(rows @ squares / rows.sum()):.2f}\u2033'


def _noise(found):
    both = [f'{arcsec(size)} ({axis})' for size, axis in zip(found['noise_arcsec'], found['axes'])]
    return f'Noise of one star, from these differences: {" and ".join(both)}'


def _visited_again(found):
    more = ' and '.join(f'{arcsec(left)} ({axis})' for axis, left, noise in zip(
        found['axes'], found['left_arcsec'], found['noise_arcsec']) if left > _MORE * noise)
    beside = f' except the zeros of {found["zeros"]} sessions' if found['zeros'] > 1 else ''
    return (f'{found["places"]} places were visited again (within {found["radius_deg"]:g}°), and '
            f'nothing moved between visits{beside}. {_noise(found)}'
            + (f'. Fit residuals are larger, {more}: an error of direction' if more else ''))


def _together_again(rows):
    """Rows of one star; if many, the first and the last."""
    if len(rows) <= _VISITS:
        return ' and '.join(map(str, rows))
    return f'{rows[0]} to {rows[-1]} ({len(rows)})'


def _moved(found):
    size = f'{found.size:+.2f}'.replace('-', '−')
    return (f'the zero of the {found["axis"]} moved by {size} ± {found.sigma:.2f}″ between '
            f'{found["word"]}s {found["before"]} and {found["after"]}, from {found["both"]} places '
            f'visited before and after')


def _step(found):
    text = f'{_moved(found)}: a step, beyond drift or correlated noise. '
    text += 'A session with new zeros begins there. ' * (found.todo == 'own zeros')
    text += _noise(found)
    if found.after is not None:
        text += (f'. With new zeros after it the RMS falls from {found.before:.2f}″ to '
                 f'{found.after:.2f}″: --sessions auto fits them')
    return text


def _cluster(found):
    low, high = found['elevation_deg']
    where = {
        'direction': f'within {found["radius_deg"]:.1f}° of azimuth {found["azimuth_deg"]:.0f}°, '
                     f'elevation {0.5 * (low + high):.0f}°',
        'azimuth': f'within {found["aside_deg"]:.1f}° of azimuth {found["azimuth_deg"]:.0f}°, '
                   f'at elevations from {low:.0f}° to {high:.0f}°',
        'first axis': f'at {found["first_axis"]} from {found["first_deg"][0]:.1f}° to '
                      f'{found["first_deg"][1]:.1f}°',
        'time': f'one after the other ({found["of"]} rows)', 'star': f'of star {found["star"]}',
        'side': 'through the pole' if found['side'] else 'on this side of the pole'}
    look = {
        'time': 'look at what was done then', 'star': 'check the position of that star, and '
        'whether it is double'}
    rows = ', '.join(map(str, found['rows'][:_NAMED])) + (
        f' and {len(found["rows"]) - _NAMED} more' if len(found['rows']) > _NAMED else '')
    return (f'{len(found["rows"])} outliers lie together, {where[found["what"]]}. '
            f'{found["word"].capitalize()}s {rows} are {arcsec(abs(found.size))} too '
            f'{"high" if found.size > 0 else "low"} in {found["axis"]} (chance '
            f'{found["chance"]:.1g}). They are excluded, but probably share a cause: '
            + look.get(found['what'], 'look at what is there (dome, cable, stop, encoder)'))


#: kind of a `Finding` -> its sentence
KINDS = {
    'places visited again': _visited_again,
    'moved between visits': lambda found: (
        f'{_moved(found)}. A step, drift and correlated noise cannot be distinguished here'),
    'step between visits': _step,
    'zeros jumped': lambda found: (
        f'The zero of the {found["axis"]} jumped by {arcsec(found.size, sign=True)} between '
        f'{found["word"]}s {found["before"]} and {found["after"]}. With new zeros there the RMS '
        f'is {arcsec(found.after)}, not {arcsec(found.before)}. Do not trust these terms: look at '
        'power, head and driver of the encoder'),
    'outliers together': _cluster,
    'columns alike': lambda found: columns_alike(found.causes),
    'reading as good': _reading_as_good,
    'better reading': lambda found: (
        f'{found["where"]}{", or ".join(found.causes)} would fit to {found.after:.1f} arcsec, the '
        f'seven terms to {found.before:.1f}. Check the {found["what"]}; an effect beyond the terms '
        'can also cause this'),
    'star measured again': lambda found: (
        f'{found["word"]}s {"; ".join(map(_together_again, found["rows"]))} are repeated '
        'measurements of one star. They stay together in cross-validation. Their '
        f'residuals differ by {arcsec(found.size)}, the centring noise'),
}
