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

"""Summary of a diagnosis: what is wrong, how large, how sure; what to check first."""

from dataclasses import dataclass

import numpy as np

from pointing_model.mount_kinds import USUAL, kind_of

from .cause_wording import open_causes, short_cause, still_open
from .error_ranking import ErrorLine
from .figure_wording import STAYS, best_pair, way_size
from .implausible_wording import implausible_caution
from .noise_wording import axes_sentence, is_headline, noise_caution, scatter_sentence
from .observation_wording import place_words, proposals
from .period_wording import PHASE
from .row_wording import bad_nights, far_text, left_out_lines
from .verdict_wording import limits_sentence, short_headline, slow_is_largest

MOST_OUTLIERS, _REASONS, _LIMITS = 3, 2, 4
#: reasons of excluded rows that are reported elsewhere
_EXPLAINED = ('outlier', 'commented out')


@dataclass
class DiagnosisSummary:
    """Summary of a diagnosis for users.

    Attributes
    ----------
    headline : str
        What is wrong, how large, how sure.
    numbers : list of (str, str)
        RMS on the sky and its label: raw, with the terms, with the effects.
    validation : str
        How the last two were validated.
    effects : list of ErrorLine
        Largest first.
    cautions : list of str
        Reasons to doubt the result.
    todo : str
        What to observe next, or that no observation helps; detection limits if nothing was found.
    """

    headline: str
    numbers: list
    validation: str
    effects: list
    cautions: list
    todo: str


def summary_of(document, names, reaches, cautions=()):
    """`DiagnosisSummary` of a document.

    Parameters
    ----------
    document : dict
    names : sequence of str
        Titles of its effects, in the same order.
    reaches : sequence of float or None
        Peak to peak of each, arcsec.
    cautions : sequence of str
        Cautions placed before those of the document.
    """
    stays = document['verdict'] in STAYS
    effects = [] if stays else sorted(
        (_line(document, *each) for each in zip(document['effects'], names, reaches)),
        key=lambda one: -(one.removes_arcsec or 0.0))
    label, before, after = best_pair(document)
    numbers = [(document.get('as_read_rms_arcsec'), 'raw'), (before, _terms(document))]
    if not stays:
        numbers.append((after, f'with {len(effects)} effect{"s" * (len(effects) > 1)}'))
    return DiagnosisSummary(
        short_headline(document, effects),
        [(way_size(value), word) for value, word in numbers if value is not None],
        label, effects, [*filter(None, cautions), *_cautions(document)],
        limits_sentence(document, _LIMITS) if stays else _todo(document))


def _terms(document):
    count = len(document.get('base_terms') or ())
    return f'with {count} term{"s" * (count != 1)}'


def _line(document, row, name, reach):
    found, folds = repeats(document, row)
    return effect_line(row, name, reach, '' if found is None else 'uncertain: ' * (
        2 * found < folds) + f'in {found} of {folds} resamples')


def repeats(document, row):
    """Number of resamples with an effect (by any of its causes), and of all resamples; or None."""
    spread = document['after'].get('cv_spread') or {}
    return ((spread.get('chosen_set') or spread.get('chosen') or {}).get(row['name']),
            spread.get('folds'))


def effect_line(row, name, reach=None, stability=''):
    """The `ErrorLine` of an effect in the document of a diagnosis."""
    causes = sorted(row.get('causes') or (),
                    key=lambda one: (bool(one.get('more_effects')), one.get('effort', 1)))
    causes = [*causes, *still_open(row)]
    check = next((one['look_at'].partition(';')[0] for one in causes if one.get('look_at')), '')
    return ErrorLine(
        name[:1].upper() + name[1:], reach, row.get('removes_rms_arcsec'),
        list(dict.fromkeys(short_cause(one['cause']).partition(':')[0] for one in causes)), check,
        stability)


def _cautions(document):
    """Cautions on the whole result, one short sentence each."""
    out = list(map(implausible_caution, document.get('unphysical') or ()))
    if not slow_is_largest(document) and document['verdict'] != 'wanders':
        out += noise_caution(document.get('wander') or {})
    each = [repeats(document, row) for row in document['effects']]
    if document['verdict'] not in STAYS and each and all(
            found is not None and 2 * found < folds for found, folds in each):
        out.append('No effect is found in half of the resamples: trust the RMS, not the causes.')
    outliers = document.get('outliers') or []
    if outliers:
        word = document.get('rows_are') or 'row'
        far = sorted(((np.hypot(row['x_arcsec'], row['y_arcsec']), row) for row in outliers),
                     key=lambda one: -one[0])
        more = len(far) - MOST_OUTLIERS
        out.append(f'{len(far)} outlier{"s" * (len(far) > 1)} excluded: ' + ', '.join(
            (f'{row["source"]} ' if 'source' in row else '')
            + f'{word} {row["row"]} ({far_text(size)} off)' for size, row in far[:MOST_OUTLIERS])
            + f', {more} more' * (more > 0) + '.')
    bad = [row for row in document.get('excluded') or ()
           if not row['reason'].startswith(_EXPLAINED)]
    out += left_out_lines(bad, document['runs'] > 1, document.get('rows_are') or 'row')[:_REASONS]
    told = [axes_sentence(document)] * (document['verdict'] != 'none' or not is_headline(document))
    scatter = [text.partition('. ')[0].removesuffix('.') + '.'
               for text in (*told, scatter_sentence(document)) if text]
    phase = [PHASE] * any('periodic_error' in row['name'] and '_time' not in row['name']
                          for row in document['effects'])
    return [*out, *phase, *scatter, *bad_nights(document, kind_of(document).axes)]


def _todo(document):
    """What to observe to distinguish the causes of the largest effect with several causes."""
    rows = sorted((row for row in document['effects'] if open_causes(row) > 1
                   and all(one['effects'] for one in row.get('causes') or ())),
                  key=lambda row: -(row.get('removes_rms_arcsec') or 0.0))
    if not rows:
        return ''
    items = proposals(document)
    for row in rows:
        mine = [one for one in items if one['separates'][0] == row['name']]
        if mine:
            more = f', and {len(mine) - 1} more places' * (len(mine) > 1)
            return ('To distinguish the causes observe '
                    f'{place_words(mine[0], document.get("mount") or USUAL)}{more}.')
    return 'No star distinguishes the causes: look at the mount.'
