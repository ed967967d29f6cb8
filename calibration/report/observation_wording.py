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

"""Words for proposed observations: position, causes they separate, expected gain."""

from itertools import groupby

import numpy as np

from calibration.estimation.equal_causes import SET_WIDTH
from pointing_model.effects.base import arcsec, readable
from pointing_model.mount_kinds import KINDS, USUAL

from .cause_wording import open_causes, plain_name, short_cause, still_open

_MOST_PLACES = 6  # largest number of proposals on the terminal
#: why a proposal has a time
_WHY_LATER = ' (something in one of the explanations changes with time)'
_LEVEL = np.sin(np.radians(0.5))  # smallest height of a raised counterweight


def causes_of(document):
    """Name of an effect -> its cause in words, dict."""
    return {name: one['cause'] for row in document['effects']
            for one in (*still_open(row), *(row.get('causes') or ())) for name in one['effects']}


def proposals(document):
    """Proposed observations that separate causes with different wording."""
    words = causes_of(document)
    return [item for item in document.get('next_observations') or []
            if len({words.get(name, name) for name in item['separates']}) > 1]


def serves_sentence(document):
    """Sentence if the proposals do not concern the largest effect; else ''."""
    rows = [row for row in document['effects'] if row.get('causes')]
    serves = {item['separates'][0] for item in proposals(document)}
    largest = max(rows, key=lambda row: row.get('removes_rms_arcsec') or 0.0, default=None)
    if not serves or largest is None or largest['name'] in serves:
        return ''
    kind = document.get('mount') or USUAL
    open_ = open_causes(largest) > 1
    return (f'These serve the smaller effects only. The largest is '
            f'{plain_name(largest["name"], kind)} ({arcsec(largest["removes_rms_arcsec"])} RMS on '
            'the sky): ' + (
                'no observation separates its causes; inspect the mount.' if open_ else
                'it has one likely cause; inspect the mount.'))


def no_star_sentences(document):
    """Name of each effect whose causes no observation separates -> a sentence, dict."""
    words = causes_of(document)
    short = {name: short_cause(cause) for name, cause in words.items()}
    return {one: _no_star(*((short.get(one, one), _either(others, short))
                            if short.get(one) not in map(short.get, others) else
                            (words.get(one, one), _either(others, words))))
            for one, *others in document.get('no_star') or []}


def _no_star(one, others):
    return f'No star separates {one} from {others}. Inspect the mount.'


def _either(names, words):
    """Causes without duplicates: a; b or c."""
    causes = list(dict.fromkeys(words.get(name, name) for name in names))
    return ' or '.join(filter(None, ['; '.join(causes[:-1]), causes[-1]]))


def next_sentence(document, row):
    """Which observation would separate the causes of an effect, or that none would.

    Parameters
    ----------
    document : dict
    row : dict
        An effect of the document.

    Returns
    -------
    str
        '' if it has one cause.
    """
    if open_causes(row) < 2:
        return ''
    words = {name: one['cause'] for one in (*row['causes'], *still_open(row))
            for name in one['effects']}
    mine = [item for item in proposals(document) if item['separates'][0] == row['name']]
    if mine:
        kind = document.get('mount') or USUAL
        both = [words[row['name']], words.get(mine[0]['separates'][1], 'the next')]
        if len({short_cause(one) for one in both}) > 1:
            both = [short_cause(one) for one in both]
        both = [one.partition(':')[0] for one in both]
        return (f'Observe first {place_words(mine[0], kind)}'
                f'{_WHY_LATER * bool(mine[0].get("after_hours"))}. That separates '
                f'{" from ".join(both)}. {_enough(mine)}.')
    for one, *others in document.get('no_star') or []:
        if one == row['name']:
            rest = {words.get(name) for name in others} >= set(words.values()) - {words[one]}
            # the causes were compared with the best only, not with each other
            last = ('the other' + 's' * (open_causes(row) > 2)) if rest else _either(others, words)
            return _no_star(words[one], last)
    return ''


def proposal_lines(document):
    """A text for each pair of causes: the observations that separate them, in order."""
    causes, kind = causes_of(document), document.get('mount') or USUAL
    for separates, group in groupby(proposals(document)[:_MOST_PLACES],
                                    key=lambda item: item['separates']):
        group = list(group)
        names = '\n  from '.join(causes.get(name) or readable(name) for name in separates)
        yield '\n'.join([f'next, to separate {names}:', f'  {_enough(group)}',
                         *(f'  {place_words(item, kind)}' for item in group)])


def proposal_groups(document):
    """Proposed observations grouped by the pair of causes that they separate.

    Returns
    -------
    list of (list of str, list of dict, str)
        The pair, its rows with ``number`` and ``counterweight_up``, and the expected gain.
    """
    groups, causes = {}, causes_of(document)
    for i, row in enumerate(proposals(document), 1):
        groups.setdefault(tuple(row['separates']), []).append({
            **row, 'number': i,
            'counterweight_up': _counterweight_up(row, document.get('mount') or USUAL)})
    return [([short_cause(causes.get(name) or readable(name)) for name in names], group,
             _group_note(group)) for names, group in groups.items()]


def _group_note(group):
    if None in (group[0].get('separation_before'), group[-1].get('separation_after')):
        return ''
    text = _enough(group)
    if any(row.get('after_hours') for row in group):
        text += f'. Hours count{_WHY_LATER}'
    if group[0].get('next_night'):
        text += '. It is not dark any more tonight: observe in the next night'
    return f'{text[:1].upper()}{text[1:]}.'


def _enough(items):
    """Expected gain of the observations for one pair, and whether that is enough."""
    before, after = items[0]['separation_before'], items[-1]['separation_after']
    text = f'ΔBIC between them is {before:.1f}, expected {after:.1f} with ' + (
        'it' if len(items) == 1 else f'{len(items)} such observations')
    return text + ('' if after >= SET_WIDTH else f', still below {SET_WIDTH:g}')


def _degrees(value):
    return f'{int(round(value))}°'.replace('-', '−')


def _counterweight_up(item, kind):
    """Whether the counterweight of a German mount is above level at a proposed observation."""
    return bool(KINDS[kind].two_sided and 'ha_deg' in item
                and np.sin(np.radians(item['ha_deg'])) < -_LEVEL)


def place_words(item, kind=USUAL):
    """A proposed observation in words.

    Parameters
    ----------
    item : dict
        See `calibration.analysis.diagnosis.next_observations.propose`.
    kind : str
        Key of `pointing_model.mounts.KINDS`.

    Returns
    -------
    str
    """
    names = KINDS[kind]
    place = f'azimuth {_degrees(item["az_deg"])}, elevation {_degrees(item["el_deg"])}'
    keys = [f'{column}_deg' for column in names.columns]
    if keys[0] != 'az_deg' and keys[0] in item:
        own = (f'{axis} {_degrees(item[key])}' for axis, key in zip(names.axes, keys))
        place = f'{", ".join(own)} ({place})'
    sides = [{-1: f'{axis} falling', 1: f'{axis} rising'}[item[key]]
             for key, axis in zip(('approach_az', 'approach_el'), names.axes) if item.get(key)]
    if item.get('through_pole'):
        place += ', through the pole'
    if _counterweight_up(item, kind):
        place += ', counterweight up (only if your mount may)'
    if sides:
        place += ', approached with ' + ' and '.join(sides)
    if item.get('last_move_deg'):
        place += f' by a last move back of {item["last_move_deg"]:g}°'
    if item.get('after_hours'):
        place += f', {item["after_hours"]:g} h after the last row'
        if item.get('utc'):
            place += f' ({"next night, " * item["next_night"]}{item["utc"]} UTC)'
    return place
