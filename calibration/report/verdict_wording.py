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

"""The result of a diagnosis in plain sentences."""

from dataclasses import dataclass

from calibration.analysis.diagnosis.mistaken_columns import ABSURD
from pointing_model.effects.base import arcsec, readable
from pointing_model.mount_kinds import kind_of

from .cause_wording import counted, first_check, open_causes
from .diagnosis_wording import limit_rows
from .figure_wording import STAYS, best_pair, beyond, figures_sentence, repeat_sentence, way
from .implausible_wording import implausible_term
from .noise_wording import (
    axes_sentence,
    axes_words,
    cause_words,
    correlation_sentence,
    drift_words,
    explanation,
    is_headline,
    scatter_sentence,
    unexplained,
)
from .observation_wording import next_sentence
from .raw_error_wording import raw_error_sentence
from .row_wording import bad_nights, outlier_sentence, worst_sentence

_NO_GAIN = 0.98  # RMS ratio after / before above which there is no improvement
_LITTLE_GAIN = 0.75  # ... and above which most of the error is unexplained
#: largest number of detection limits that are named
_MOST_NAMED = 8
#: verdict -> its name on pages
VERDICTS = {'none': 'nothing missing', 'wanders': 'the zero drifts', 'undecided': 'undecided',
            'identified': 'cause identified', 'ambiguous': 'found; the cause is open',
            'unknown': 'cause unknown', 'refused': 'nothing concluded',
            'withheld': 'not published', 'taken_back': 'taken back'}
#: verdict -> its headline, if there is no effect to name
HEADLINES = {
    'none': 'No significant error{beyond}.',
    'wanders': 'No effect found{beyond}. The noise is correlated: the zero drifts.',
    'undecided': 'Undecided: an error is significant, but these rows cannot test its cause.',
    'refused': 'Nothing is concluded: too few of the rows are usable.',
    'withheld': 'No change: with the effects that were found the model points worse.',
    'taken_back': 'Effects removed again: with them the model points worse on new stars.'}
#: verdicts that name no effect
_WITHOUT_EFFECTS = ('refused', 'none', 'undecided', 'wanders')


@dataclass
class Statement:
    """One statement for users.

    Attributes
    ----------
    lead : str
        The statement itself.
    more : str
        Reasons, evidence and what to do.
    reach_arcsec : float, optional
        Peak to peak size of an effect.
    """

    lead: str
    more: str = ''
    reach_arcsec: float | None = None

    @property
    def text(self):
        """The full text."""
        return f'{self.lead} {self.more}'.strip()


def short_headline(document, effects):
    """The headline: the largest error, its size, how sure it is.

    Parameters
    ----------
    document : dict
        `Diagnosis.to_dict()`.
    effects : list of error_ranking.ErrorLine
        Largest first.

    Returns
    -------
    str
    """
    text = HEADLINES.get(document['verdict'])
    if document['verdict'] == 'none' and is_headline(document):
        return ' '.join(f'{words[:1].upper()}{words[1:]}.'
                        for words in (axes_words(document), unexplained(document)))
    if text:
        wander = document['wander'] if document['verdict'] == 'wanders' else {}
        like = explanation(wander.get('explained_by', ())) or (
            'an effect of direction or of each star' * bool(wander.get('along_the_sky')))
        return text.format(beyond=_beyond_terms(document)) + \
            f' {like[:1].upper()}{like[1:]} explains it as well.' * bool(like)
    if not effects:
        return f'An error remains{_beyond_terms(document)}; its cause is unknown.'
    first = effects[0]
    text = f'{first.name}, {first.size.split(", ")[0]}' if first.size else first.name
    text += f' ({first.stability})' * bool(first.stability)
    if slow_is_largest(document):
        size = arcsec(document['wander']['removes_rms_arcsec'])
        return (f'Correlated noise, {size} RMS, is the largest error'
                f'{cause_words(document["wander"])}. {text}.')
    count = len(effects)
    which = 'The only error' if count == 1 else f'Largest of {counted(count, "error")}'
    return f'{text}. {which}{_beyond_terms(document) or " found"}.'


def _beyond_terms(document):
    terms = len(document.get('base_terms') or ())
    return f' beyond the {terms}-term model of {kind_of(document).words}' * bool(terms)


def verdict_sentences(document, effects=(), limit=5, caution=''):
    """The verdict of a diagnosis in full sentences, for ``--verbose``, the node and Python.

    Page and terminal show `short_headline` first.

    Parameters
    ----------
    document : dict
        `Diagnosis.to_dict()`.
    effects : sequence of Statement
        Statements on its effects, in the order of the document; sorted here by size.
    limit : int
        Largest number of effects described; the others are counted.
    caution : str
        Caution placed before the effects.

    Returns
    -------
    headline : str
    sentences : list of str
        Cautions; the effects, numbered if there are several; the RMS raw, with terms and with
        effects; further remarks.
    """
    headline, first, rest = _statements(document, effects, caution)
    ranked = [] if document['verdict'] in _WITHOUT_EFFECTS else _ranked(document, effects)
    smaller = len(ranked[limit:])
    named = ranked[:limit]
    if len(named) > 1:
        named = [f'{i}. {text}' for i, text in enumerate(named, 1)]
    return headline, list(filter(None, [
        *first, *named, f'And {smaller} more, smaller.' * bool(smaller),
        f'{way(document)} {raw_error_sentence(document)}'.strip(), *rest]))


def _statements(document, effects, caution):
    """Headline, sentences before the effects, and sentences after them."""
    verdict = document['verdict']
    last = [axes_sentence(document) if verdict != 'none' else '', scatter_sentence(document),
            figures_sentence(document), outlier_sentence(document)]
    odd = [implausible_term(row) for row in document.get('unphysical') or ()]
    if verdict == 'refused':
        return HEADLINES[verdict].removesuffix('.'), [caution], last
    if verdict == 'none':
        return _nothing(document, caution, odd, last)
    if verdict == 'undecided':
        return (HEADLINES[verdict].removesuffix('.'), [caution, *odd],
                ['The model stays as it was.', *last])
    if verdict == 'wanders':
        correlation = document['wander']
        what, then = (
            'Errors of neighbouring rows are correlated: the zero drifts, or the model lacks an '
            'effect of direction', 'Observe once more in an order that mixes the sky.') \
            if correlation.get('along_the_sky') else (
            'The zero drifts, or another effect is present that these rows cannot separate from '
            'a drift'
            if correlation.get('like') else 'The zero drifts; the cause is unknown',
            'The model states how far the zero drifts: set it anew as often as that requires.')
        return (f'{what}{_drifts(document)}', [*_correlation(document), *odd],
                [f'No effect is added. {then}', *last])
    axes = kind_of(document).axes
    first, rest = [*odd, caution, *bad_nights(document, axes)], [worst_sentence(document), *last]
    (first if slow_is_largest(document) else rest)[:0] = _correlation(document)
    return (_long_headline(document, effects),
            [*first, count_sentence(document), repeat_sentence(document)], rest)


def _nothing(document, caution, odd, last):
    """`_statements` for the verdict ``none``."""
    floor, left = document.get('noise_floor_arcsec'), document['before'].get('rms_arcsec')
    looks = f'The residuals, {arcsec(left)} RMS, are consistent with noise'
    looks += f' (noise floor {arcsec(floor)}).' if floor is not None else '.'
    if not caution and (left or 0.0) > ABSURD:
        caution = (f'Residuals of {arcsec(left)} are too large for a mount: check columns, units, '
                   'signs and the zero of azimuth.')
    unequal = axes_sentence(document)
    looks = unequal or looks  # unequal scatter is not consistent with noise
    headline = f'No significant error{beyond(document)}'
    label, before, _ = best_pair(document)
    if before is not None and not caution:
        headline += f': {arcsec(before)} remain, {label}'
    if is_headline(document):
        text = axes_words(document)
        headline = f'{text[:1].upper()}{text[1:]}; {unexplained(document)}'
    if odd:
        headline += '. But check ' + ' and '.join(
            f'{row["name"]}, which is {"negative" if row["what"] == "sign" else "too large"}'
            for row in document['unphysical'])
    return (headline, [*odd, caution or looks, unequal if caution else ''],
            ['The model stays as it was.', limits_sentence(document), *last])


def _by_size(document, effects):
    """Effects of a document with their summaries, largest first."""
    return sorted(zip(document['effects'], effects),
                  key=lambda each: -(each[0].get('removes_rms_arcsec')
                                     or each[0].get('cv_gain_arcsec') or 0.0))


def _ranked(document, effects):
    out = []
    for i, (row, summary) in enumerate(_by_size(document, effects)):
        parts = [summary.text, first_check(document, row)]
        if i == 0 and row.get('causes'):
            parts.append(next_sentence(document, row))
        if row.get('alternatives') and 'causes' not in row:
            parts.append('With these observations it could as well be: '
                         f'{_listed(row["alternatives"])}.')
        out.append(' '.join(filter(None, parts)))
    return out


def _long_headline(document, effects):
    """The largest error and its size, and the remaining RMS."""
    count = len(document['effects'])
    if document['verdict'] in ('withheld', 'taken_back'):
        many, them = ('One effect', 'it') if count == 1 else (f'{count} effects', 'them')
        return (f'{many} seemed to be there, but the model with {them} points worse: the old model '
                'stays active')
    label, before, after = best_pair(document)
    ranked = _by_size(document, effects)
    slow, text = _slow_words(document), 'Something is wrong beyond the terms'
    if ranked:
        text = ranked[0][1].lead
        if slow:
            text = f'{slow}. Second: {text[:1].lower()}{text[1:].removesuffix(".")}'
            text += f'. Other errors: {count}' * (count > 1)
        else:
            text += (f' Largest of {counted(count, "error")}' if count > 1
                     else ' The only error found') + ' beyond the terms of the model'
    if after is None:
        return text
    share = f', {100 * (after / before - 1):+.0f} %'.replace('-', '−') if before else ''
    gained = ''
    if before and after > _NO_GAIN * before:
        gained = ': that is no gain'
    elif before and slow and after > _LITTLE_GAIN * before:
        gained = ': most of the error is unexplained'
    return (f'{text}. RMS {arcsec(after)} with {"it" if count == 1 else "all of them"}, {label} '
            f'({arcsec(before)} without{share}){gained}')


def slow_is_largest(document):
    """Whether the slow drift is larger than any effect found."""
    correlation = document.get('wander') or {}
    size = correlation.get('removes_rms_arcsec')
    return bool(correlation.get('slow') and size is not None and size > max(
        (row.get('removes_rms_arcsec') or 0.0 for row in document['effects']), default=0.0))


def _slow_words(document):
    """Sentence on the slow drift if it is the largest error; else ''."""
    if not slow_is_largest(document):
        return ''
    correlation = document['wander']
    return ('The largest error is a drift '
            + ('with time or over the sky' if correlation.get('along_the_sky') else 'with time')
            + f', cause unknown ({arcsec(correlation["removes_rms_arcsec"])} RMS on the sky)'
            f'{_drifts(document)}')


def _drifts(document):
    """Which axes drift linearly, after a colon; '' if none does."""
    drifts = drift_words(document['wander'], kind_of(document).axes)
    return f': {drifts}' if drifts else ''


def count_sentence(document):
    """Number of effects found, and for how many the cause is open."""
    effects = document['effects']
    unclear = sum(open_causes(row) > 1 or bool('causes' not in row and row.get('alternatives'))
                  for row in effects)
    count = len(effects)
    if document['verdict'] in STAYS:
        return ''
    text = f'{counted(count, "effect").capitalize()}{beyond(document, whose=False) or " found"}'
    if unclear:
        them = '' if count == 1 else f' of {"all" if unclear == count else unclear}'
        text += f'; the cause{them} is open'
    return f'{text}.'


def limits_sentence(document, most=_MOST_NAMED):
    """The first `most` detection limits in one sentence; empty if there are none."""
    limits = '; '.join(f'{what} {limit}' for what, limit in limit_rows(document)[:most])
    return f'Detection limits (90 %): {limits}.' if limits else ''


def _correlation(document):
    """Sentence on correlated noise, if there is any."""
    entry = document.get('wander')
    if not entry:
        return []
    text = entry.get('text') or correlation_sentence(entry, kind_of(document).axes)
    return [f'{text[:1].upper()}{text[1:]}.']


def _listed(names):
    names = [readable(name) for name in names]
    if len(names) > 4:
        names = [*names[:3], f'{len(names) - 3} others']
    return names[0] if len(names) == 1 else '; '.join(names[:-1]) + '; or ' + names[-1]
