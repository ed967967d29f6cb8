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
    first, second = (f'a{"n" * (word[0] in "aeh")} {word}' for word in kind.axes)
    out = {'line_of_sight_2': 'a line of sight that swings twice per turn',
           'refraction': 'a refraction constant wrong',
           f'{kind.keys[1]}_nod_2': 'a nod twice per turn',
           f'{kind.keys[0]}_hysteresis_cosE': f'a backlash of the {kind.shafts[0]}',
           f'{kind.keys[1]}_hysteresis': f'a backlash of the {kind.shafts[1]}'}
    for key, word in zip(kind.keys, (first, second)):
        out |= {f'{key}_encoder_1': f'{word} encoder wrong once per turn',
                f'{key}_encoder_2': f'{word} encoder wrong twice per turn',
                f'{key}_zero_with_temperature': f'{word} zero that follows the temperature',
                **{f'{key}_zero_with_{driver}': f'{word} zero that drifts'
                   for driver in ('time', 'run_hours', 'order')}}
    return out


def limit_rows(document):
    """Effects and their detection limits, pairs of str."""
    words = limit_words(kind_of(document))
    return [(words[row['name']],
             f'{row["amplitude_arcsec"]:.2f}{_UNITS.get(row["unit"], "″")}')
            for row in document.get('detectable') or ()]


_UNITS = {'arcsec/h': '″/h', 'arcsec/K': '″/K', 'arcsec/run': '″/run'}


def _undecided(found):
    text = ''
    if found.causes:
        text = ('Beyond chance, but not added, for it does not hold where a part of the '
                f'observations is left out: {"; ".join(found.causes)}. ')
    text += (f'Where a part is left out the model misses it by {found.size:.1f}\u2033 beside a '
             f'noise of {found.before:.1f}\u2033' if found['misses'] else
             'It would remove most of the error')
    return f'{text}: the observations are too few or too unequal to ' + (
        'distinguish an effect from a peculiarity of one session. Observe the whole sky in one '
        'session more.' if found.todo == 'another session' else
        'judge an effect. Observe more stars, over the whole sky.')


def _figures(found):
    """RMS before and after of a worse prediction, and its axis."""
    place = f', in {found["axis"]}' if found['axis'] else ''
    return f'({found.before:.2f}\u2033 to {found.after:.2f}\u2033{place})'


def _columns_not_taken(found):
    how = '--cause COLUMN takes one'
    if found['unnamed']:
        how += ('; one that is the air temperature: telescope-mount export RUN run.csv, and call '
                'the column temperature_c')
    return ('not taken as causes, for they may be outcomes of a measurement: '
            f'{", ".join(found["columns"])} ({how})')


def _another_model(found):
    own, other = map(readable, found.causes)
    beside = ', '.join(map(readable, found['beside'])) or 'none'
    more, better = found['more'], found['better']
    text = (f'{other} instead of {own} explains the run as well. Other effects then: {beside}')
    if more:
        text += f'. That is {more} effect{"s" * (more > 1)} more'
    if more and better:
        text += (f', which the rows pay for (ΔBIC {better:.0f} better); the model with fewer was '
                 'kept')
    return text


def _dropped(why):
    return lambda found: (f'beyond chance, but {why}, so not added: '
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
        return (f'how late the {what} follows {driver} is unknown: log {driver} from '
                f'{found["before"]:.0f} min before the run on (rows without angles count)')
    if found['why']:
        return (f'how late the {what} follows {driver} is unknown: it goes too straight through '
                'the run')
    return (f'the {what} follows {driver} {found.size:.0f} min late ({found["low"]:.0f} to '
            f'{found["high"]:.0f} min)')


def _cannot_judge(found):
    runs, driver = found['runs'], the(found['driver'])
    named = ', '.join(runs[:_FIRST]) + f' and {len(runs) - _FIRST} more' * (len(runs) > _FIRST)
    why = UNKNOWN.get(found['driver'], f'{driver} is not known (column {found["column"]})') \
        if found['column'] else 'it follows the time, and these rows are beyond the times fitted'
    return f'{named} cannot judge "{readable(found["effect"])}": {why}.'


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
        f'(ΔBIC {found.size:.0f}); if the column is a cause, say --cause {found["column"]}'),
    'too few rows': lambda found: (
        f'{found.size} of {found["read"]} rows could be used. With more than a third left out no '
        'effect is claimed: what the others show may come from what is wrong with those. Check '
        'the excluded rows, and the columns.'),
    'undecided': _undecided,
    'not from run to run': lambda found: (
        'More is significant, but not in all runs, so it is not added (the notes have the names). '
        'A peculiarity of one run looks like an effect.'),
    'dropped, worse on rows left out': lambda found: (
        f'More is significant, but predicts left-out {found["what"]} worse '
        f'{_figures(found)}, so it is not added (the notes have the names).'),
    'worse on rows left out': lambda found: (
        f'The effects predict left-out {found["what"]} worse {_figures(found)}: they may hold for '
        'these observations alone. Validate them on another run (--holdout).'),
    'held-out night contradicts': lambda found: (
        f'The night {found["run"]} contradicts what was found: {arcsec(found.before)} without it, '
        f'{arcsec(found.after)} with it. Do not use the effects beyond the run that was fitted.'),
    'rows searched': lambda found: (
        f'{found.size} of {found["all"]} rows were searched, spread evenly over each run. An '
        f'effect must be {(found["all"] / found.size)**0.5:.1f} times as large to be found as '
        'with all of them. The model was fitted to all rows, the other figures are of those '
        'searched'),
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
        f'{found.size} rows are nearer to the zenith than the mount can look'),
    'curve': lambda found: (
        f'unknown error that follows {the(found["driver"])}: the model has a curve for it, '
        f'{found["shape"]}'),
    'columns of some runs': lambda found: (
        f'not in all runs, so not used: {", ".join(found["columns"])}'),
    'two clocks': lambda found: (
        'time is UTC in some runs and counts from an arbitrary start in others: not used'),
    'undetermined base': lambda found: (
        'the directions do not determine all terms of the base: only predictions there have a '
        'meaning'),
    'reading set right': lambda found: (
        f'the {found["axis"]} encoder was read whole {found["graduation"]} beside the true '
        'place, and set right, in '
        + ', '.join(f'{found["word"]} {row} ({m:+d})' for row, m in found['rows'])),
    'sessions': _sessions,
    'sessions found': lambda found: (
        f'{_sessions(found)}: zeros of their own explain the rows better (--sessions 0 takes them '
        'as one)'),
    'gaps without sessions': lambda found: (
        f'{found["source"]}: gaps of more than {found.size:g} h, but separate zeros explain the '
        'rows no better: one session (--sessions HOURS separates them)'),
    'zeros of the newest run': lambda found: (
        f'the model has the zeros of run {found["run"]:g}, the newest: '
        + ', '.join(f'{name} {value:+.2f}' for name, value in found['terms'].items()) + ' arcsec'),
    'medians of the runs': lambda found: (
        f'the model has the medians of {found["runs"]} runs, '
        + ', '.join(f'{name} {value:+.2f}' for name, value in found['terms'].items())
        + (' arcsec: set a zero, or fit the night, before you point by it'
           if found['newest'] is None else
           f' arcsec, and their zeros: apply takes that of the newest, run {found["newest"]:g}')),
    'term of each session': _moving,
    'terms of sessions': lambda found: (
        f'each session has its own {", ".join(found.causes)}: they move from session to session '
        '(--own says otherwise)'),
    'held-out night cannot judge': _cannot_judge,
    'rows held out judge nothing': lambda found: (
        f'held out, judge nothing (what drives an effect is not known): {found.size} rows'),
    'outliers held out': lambda found: f'held out, outliers set aside: {found.size}',
    'runs held out': lambda found: (
        f'held out: {found.size} observations of {found["runs"]} runs, '
        f'{", ".join(found["refitted"])} refitted in each, nothing else'),
    'rows left out': lambda found: f'{", ".join(found["rows"])} left out: {found["why"]}',
}
