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

"""Words for the causes of an effect: possible causes, contenders, what to check."""

import re

from calibration.estimation.equal_causes import SET_WIDTH
from pointing_model.effects.base import EFFORTS, readable
from pointing_model.mount_kinds import KINDS

#: largest number of causes named; the others are counted
_MOST_CAUSES = 5
_NUMBERS = ('no', 'one', 'two', 'three', 'four', 'five', 'six', 'seven', 'eight', 'nine', 'ten',
            'eleven', 'twelve')


def counted(number, word):
    """A small number in words, followed by a noun: "two effects"."""
    text = _NUMBERS[number] if number < len(_NUMBERS) else f'{number}'
    return f'{text} {word}{"" if number == 1 else "s"}'


def open_causes(row):
    """Number of possible causes, as worded for users, of an effect of the document."""
    return max(len(row.get('causes') or ()), 1) + len(still_open(row))


def still_open(row):
    """Contenders of an effect of the document that leave its cause open."""
    return [one for one in row.get('contenders') or () if one['open']]


def plain(cause):
    """A cause as one clause, without semicolons: these separate causes in a sentence."""
    return cause.replace('; it ', ', which ').replace('; ', ', ')


def causes_sentence(causes):
    """Sentences on equally good causes, best first."""
    texts = [plain(one['cause']) + (
        f' (needs {counted(one["more_effects"], "other effect")} with it)'
        if one.get('more_effects') else '') for one in causes]
    if len(texts) > _MOST_CAUSES:
        texts = [*texts[:_MOST_CAUSES], f'{len(texts) - _MOST_CAUSES} more']
    return (f'{counted(len(causes), "cause").capitalize()} explain it equally well. '
            + ' '.join(f'({i}) {text[:1].upper()}{text[1:]}.' for i, text in enumerate(texts, 1)))


def short_cause(cause):
    """A cause without "(... per turn)", where that is stated elsewhere."""
    return re.sub(r' \([^()]*per turn[^()]*\)', '', plain(cause))


def alternatives_sentence(row, found):
    """Contenders that lost to an effect, and by how much; '' if there are none.

    Parameters
    ----------
    row : dict
        An effect of a document.
    found : str
        Its cause as worded for users.
    """
    sentences = []
    for one in row.get('contenders') or ():
        text = short_cause(one['cause'])
        text = f'{text[:1].upper()}{text[1:]}'
        gains = (f'alone it fits as well (ΔBIC {one["alone"]:.0f}, against '
                 f'{one["found_alone"]:.0f})' if abs(one['alone'] - one['found_alone']) < SET_WIDTH
                 else '')
        behind = (f'with all effects in the model its ΔBIC is {one["behind"]:.0f} worse'
                  if one['behind'] > 0.0 else '')
        often = (f'it was chosen instead in {one["instead"]} of {one["folds"]} resamples'
                 if one['instead'] else '')
        why = '. But '.join(filter(None, [' and '.join(filter(None, [gains, often])), behind]))
        sentences.append(
            f'{text} {"is not excluded" if one["open"] else "fits worse"}: {why}.')
    if still_open(row) and len(row.get('causes') or ()) < 2:
        sentences.insert(0, f'Best with all rows: {short_cause(found)}.')
    return ' '.join(sentences)


def first_check(document, row):
    """What to check for an effect, and, with several causes, what to check first and why.

    Parameters
    ----------
    document : dict
    row : dict
        An effect of the document.

    Returns
    -------
    str
        '' if the document has no causes.
    """
    causes = [one for one in row.get('causes') or () if one.get('look_at')]
    if not causes:
        return ''
    if len(causes) == 1 and open_causes(row) - len(still_open(row)) == 1:
        return _only_check(row, causes[0])
    # causes that need more effects come last
    own = [one for one in causes if not one.get('more_effects')] or causes
    one = min(own, key=lambda each: each.get('effort', 1))
    least = one.get('effort', 1)
    # flexure and refraction have the same curve
    terms = [term['name'] for term in document.get('unphysical') or () if row.get('axes') == 'el'
             and row.get('driver') == 'elevation' and term['name'] in ('TF', 'TX')]
    head = f'It has the same curve as {terms[0]} (above): check that first. Then: ' \
        if terms else 'Check first: '
    tested = [each for each in causes if each['look_at'] == one['look_at']]
    rest = [each for each in causes if each not in tested]
    names = f'"{plain(one["cause"])}"' if len(causes) == 1 else (
        f'cause{"s" * (len(tested) > 1)} '
        + ' and '.join(str(causes.index(each) + 1) for each in tested))
    return (f'{head}{one["look_at"]}. It tests {names}: {EFFORTS[least]}{_rest(rest, own, least)}. '
            'The data cannot distinguish the causes.')


def _only_check(row, cause):
    """What to check for the only best cause, and for its contenders."""
    more = ''.join(f'. For "{short_cause(one["cause"])}": {one["look_at"]}'
                   for one in still_open(row) if one.get('look_at'))
    # the shape may be the only evidence: other parts with the same period cause it, too
    else_ = ', and other parts that repeat as often' * bool(cause.get('only_shape'))
    text = f'Look at {cause["look_at"]}{else_}{more}.'
    if str(row.get('name')).startswith('smooth_of'):
        text += (' Until its cause is known the model has a curve for it, valid within these rows '
                 'only.')
    return text


def _rest(rest, own, least):
    """Effort for the causes that the first check does not test."""
    if not rest:
        return ''
    efforts = [each.get('effort', 1) for each in rest]
    many = len(rest) > 1
    if not any(each in own for each in rest):
        text = 'need other effects with them' if many else 'needs other effects with it'
    else:
        what = 'as much' if max(efforts) == least else 'more' if min(efforts) > least else \
            'as much or more'
        text = f'take{"" if many else "s"} {what} effort'
    return f'; the other{"s" * many} {text}'


def plain_name(name, kind):
    """`readable`, adapted to the kind of mount: a German one has a saddle, no fork."""
    return readable(name.replace('fork', 'saddle') if KINDS[kind].carrier == 'saddle' else name)
