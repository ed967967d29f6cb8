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

"""Words for the notes of a diagnosis: rows, sessions, dropped effects."""

from pointing_model.context import UNKNOWN
from pointing_model.effects.base import arcsec, readable, the
from pointing_model.mount_kinds import kind_of

from .number_wording import value_and_error

_FIRST = 2  # effects that a first answer names


def _first_answer(found):
    rms = f'fit RMS {found.before:.2f}″'
    if not found.causes:
        return f'first answer, not yet validated: no effect found; {rms}'
    named, more = found.causes[:_FIRST], len(found.causes) - _FIRST
    return (f'first answer, not yet validated: {"; ".join(map(readable, named))}'
            f'{f"; {more} more" if more > 0 else ""}; {rms} without, {found.after:.2f}″ with')


def limit_words(kind):
    """Name -> words for each effect with a detection limit, for a `mount_kinds.MountKind`."""
    out = {'line_of_sight_2': 'line of sight error, twice per turn',
           'refraction': 'error of the refraction constant',
           f'{kind.keys[1]}_nod_2': 'wobble, twice per turn',
           f'{kind.keys[0]}_hysteresis_cosE': f'backlash of the {kind.shafts[0]}',
           f'{kind.keys[1]}_hysteresis': f'backlash of the {kind.shafts[1]}'}
    for key, word in zip(kind.keys, kind.axes):
        out |= {f'{key}_encoder_1': f'{word} encoder error, once per turn',
                f'{key}_encoder_2': f'{word} encoder error, twice per turn',
                f'{key}_zero_with_temperature': f'{word} zero vs temperature',
                **{f'{key}_zero_with_{driver}': f'{word} zero drift'
                   for driver in ('time', 'run_hours', 'order')}}
    return out


def limit_rows(document):
    """Effects and their detection limits, pairs of str."""
    words = limit_words(kind_of(document))
    return [(words[row['name']],
             arcsec(row['amplitude_arcsec']) + row['unit'].removeprefix('arcsec'))
            for row in document.get('detectable') or ()]


def _undecided(found):
    text = ''
    if found.causes:
        text = ('Significant, but not confirmed by cross-validation, so not added: '
                f'{"; ".join(found.causes)}. ')
    text += (f'Cross-validated, the model is off by {found.size:.1f}\u2033, with a noise of '
             f'{found.before:.1f}\u2033' if found['misses'] else
             'It would remove most of the error')
    return f'{text}: the observations are too few or too unequal to ' + (
        'distinguish an effect from a peculiarity of one session. Observe the whole sky in one '
        'more session.' if found.todo == 'another session' else
        'judge an effect. Observe more stars, over the whole sky.')


def _figures(found):
    """RMS before and after of a worse prediction, and its axis."""
    place = f', in {found["axis"]}' if found['axis'] else ''
    return f'({found.before:.2f}\u2033 to {found.after:.2f}\u2033{place})'


def _columns_not_taken(found):
    how = 'to use one: --cause COLUMN'
    if found['unnamed']:
        how += ('; if one is the air temperature: telescope-mount export RUN run.csv, and name '
                'the column temperature_c')
    return ('columns not tried as causes, because they may be results of the measurement: '
            f'{", ".join(found["columns"])} ({how})')


def _another_model(found):
    own, other = map(readable, found.causes)
    beside = ', '.join(map(readable, found['beside'])) or 'none'
    more, better = found['more'], found['better']
    text = (f'{other} instead of {own} fits the run equally well. Other effects then: {beside}')
    if more:
        text += f'. That takes {more} more effect{"s" * (more > 1)}'
    if more and better:
        text += (f', but fits better (ΔBIC {better:.0f} better); the model with fewer was '
                 'kept')
    return text


def _dropped(why):
    return lambda found: (f'significant, but {why}, so not added: '
                          + '; '.join(map(readable, found.causes)))


#: driver -> unit of a slope in a sentence, and its size in units of the driver
_BY = {'temperature': (' per °C', 1.0), 'time': (' a day', 86400.0)}


def _moving(found):
    low, high = (' ± '.join(value_and_error(*found[key])).replace('-', '−')
                 for key in ('low', 'high'))
    text = (f'{found.causes[0]} differs between the {found["sessions"]} sessions: {low}″ to '
            f'{high}″; the model has the median')
    if follows := found['follows']:
        unit, times = _BY.get(follows['driver'], (' a unit', 1.0))
        slope, r = arcsec(follows['slope'] * times, sign=True), min(abs(follows['r']), 0.999)
        text += f'. It follows {the(follows["driver"])}, {slope}{unit} (|r| = {r:.3f})'
    return text


def _sessions(found):
    return f'{found["source"]}: {found["sessions"]} sessions, at gaps of more than {found.size:g} h'


def _lag(found):
    what, driver = readable(found.causes[0]).partition(' with ')[0], the(found['driver'])
    if found['why'] == 'start':
        return (f'the lag of the {what} behind {driver} is unknown: log {driver} from '
                f'{found["before"]:.0f} min before the first star (rows without angles count)')
    if found['why']:
        return (f'the lag of the {what} behind {driver} is unknown: the change in this run is too '
                'even')
    return (f'the {what} lags {driver} by {found.size:.0f} min ({found["low"]:.0f} to '
            f'{found["high"]:.0f} min)')


def _cannot_judge(found):
    runs, driver = found['runs'], the(found['driver'])
    named = ', '.join(runs[:_FIRST]) + f' and {len(runs) - _FIRST} more' * (len(runs) > _FIRST)
    why = UNKNOWN.get(found['driver'], f'{driver} is not known (column {found["column"]})') \
        if found['column'] else 'it depends on time, and these rows are outside the fitted times'
    return f'{named} cannot test "{readable(found["effect"])}": {why}.'


_LONGEST = {1: 'the longest', 2: 'the second longest', 3: 'the third longest'}


def _slip(found):
    place = _LONGEST.get(found['longer'], f'number {found["longer"]} in length')
    return (f'the {found["axis"]} zero jumped with the slew to line {found["line"]} '
            f'({found.size:.0f}°, {place} of {found["slews"]}): did a clutch or coupling slip?')


#: kind of a `Finding` -> its sentence
KINDS = {
    'lag of temperature': _lag,
    'slip of a slew': _slip,
    'column explains better': lambda found: (
        f'{found["cause"]}: that explains {readable(found.causes[0])} better '
        f'(ΔBIC {found.size:.0f}); if this column is the cause, use --cause {found["column"]}'),
    'too few rows': lambda found: (
        f'{found.size} of {found["read"]} rows are usable. With more than a third excluded no '
        'effect is claimed: the same fault may affect the other rows. Check '
        'the excluded rows and the columns.'),
    'undecided': _undecided,
    'not from run to run': lambda found: (
        'More effects are significant, but not in all runs, so they are not added (see the notes). '
        'A peculiarity of one run looks like an effect.'),
    'dropped, worse on rows left out': lambda found: (
        f'More effects are significant, but predict held-out {found["what"]} worse '
        f'{_figures(found)}, so they are not added (see the notes).'),
    'worse on rows left out': lambda found: (
        f'The effects predict held-out {found["what"]} worse {_figures(found)}: they may be valid '
        'for these observations only. Validate them on another run (--holdout).'),
    'held-out night contradicts': lambda found: (
        f'The night {found["run"]} contradicts the effects: RMS {arcsec(found.before)} without '
        f'them, {arcsec(found.after)} with them. Use them for the fitted run only.'),
    'rows searched': lambda found: (
        f'{found.size} of {found["all"]} rows, spread evenly over each run, were searched for '
        f'effects: detection limits are {(found["all"] / found.size)**0.5:.1f} times those of '
        'all rows. The model was fitted to all rows; the other figures are of the searched '
        'rows'),
    'first answer': _first_answer,
    'columns not taken': _columns_not_taken,
    'terms beside correlated noise': lambda found: (
        'the terms were fitted beside correlated noise. `fit`, which ignores it, leaves '
        f'{found.before:.2f} instead of {found.after:.2f} arcsec on these rows: its terms absorb a '
        'part of the drift'),
    'another model': _another_model,
    'no gain on rows left out': _dropped('no cross-validated improvement'),
    'not repeated': _dropped('cross-validated worse with it'),
    'beyond the zenith': lambda found: (
        f'{found.size} rows are closer to the zenith than the mount can point'),
    'curve': lambda found: (
        f'error of unknown cause, depends on {the(found["driver"])}: the model has a curve for it, '
        f'{found["shape"]}'),
    'columns of some runs': lambda found: (
        f'not in all runs, so not used: {", ".join(found["columns"])}'),
    'two clocks': lambda found: (
        'time is UTC in some runs and counts from an arbitrary start in others: not used'),
    'undetermined base': lambda found: (
        'these directions do not determine all terms of the base: use the model for predictions '
        'there only'),
    'reading set right': lambda found: (
        f'the {found["axis"]} encoder readings were off by whole {found["graduation"]}, and '
        'were corrected, in '
        + ', '.join(f'{found["word"]} {row} ({m:+d})' for row, m in found['rows'])),
    'sessions': _sessions,
    'sessions found': lambda found: (
        f'{_sessions(found)}: separate zeros fit the rows better (--sessions 0 fits one zero to '
        'all)'),
    'gaps without sessions': lambda found: (
        f'{found["source"]}: gaps of more than {found.size:g} h, but separate zeros explain the '
        'rows no better: one session (--sessions HOURS separates them)'),
    'zeros of the newest run': lambda found: (
        f'the model has the zeros of run {found["run"]:g}, the newest: '
        + ', '.join(f'{name} {value:+.2f}' for name, value in found['terms'].items()) + ' arcsec'),
    'medians of the runs': lambda found: (
        f'the model has the medians of {found["runs"]} runs, '
        + ', '.join(f'{name} {value:+.2f}' for name, value in found['terms'].items())
        + (' arcsec: set a zero, or fit the night, before you point with it'
           if found['newest'] is None else
           f' arcsec, and their zeros: apply uses that of the newest, run {found["newest"]:g}')),
    'term of each session': _moving,
    'terms of sessions': lambda found: (
        f'each session has its own {", ".join(found.causes)}: they change between sessions '
        '(--own overrides this)'),
    'held-out night cannot judge': _cannot_judge,
    'rows held out judge nothing': lambda found: (
        f'held out, but no test (driver of an effect unknown): {found.size} rows'),
    'outliers held out': lambda found: f'held out, outliers excluded: {found.size}',
    'runs held out': lambda found: (
        f'held out: {found.size} observations of {found["runs"]} runs; only '
        f'{", ".join(found["refitted"])} refitted in each'),
    'rows left out': lambda found: f'{", ".join(found["rows"])} left out: {found["why"]}',
}
