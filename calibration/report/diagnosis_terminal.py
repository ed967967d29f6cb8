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

"""Terminal output for a diagnosis."""

from rich.padding import Padding
from rich.text import Text

from pointing_model.effects.base import driver_word
from pointing_model.mount_kinds import kind_of

from . import observation_wording
from .error_ranking import MOST_ERRORS
from .figure_wording import choice_sentence
from .row_wording import expected_sentence
from .terminal_layout import height_of
from .terminal_tables import decimals, new_table

#: largest number of cautions; lines of the summary, without first answer and name of the page
_MOST_CAUTIONS, _LINES = 4, 21


def summary_lines(view):
    """Summary: at most 24 lines of 80 columns, including the line with the name of the page.

    Parameters
    ----------
    view : DiagnosisView

    Returns
    -------
    list
        See `diagnosis_tables`.
    """
    summary = view.summary
    first = [summary.headline]
    if summary.numbers:
        first.append('RMS: ' + ', '.join(f'{value} {word}' for value, word in summary.numbers)
                     + f' ({summary.validation})')
    smaller = len(summary.effects) - MOST_ERRORS
    last = [f'{smaller} smaller effect{"s" * (smaller > 1)}'] if smaller > 0 else []
    last += [f'caution: {text}' for text in summary.cautions[:_MOST_CAUTIONS]]
    last += [summary.todo, f'{view.used.partition(";")[0]}; all details: --verbose']
    effects = []
    for i, one in enumerate(summary.effects[:MOST_ERRORS], 1):
        effects.append([f'{i}. {one.name}: {one.size}', *(
            f'   {word}: {text}' for word, text in (
                ('cause', one.named_causes(1 + (i == 1))), ('check', one.check)) if text)])
    # omit details of smaller effects if there is no room
    room = _LINES - sum(map(height_of, [*first, *filter(None, last)]))
    while effects and sum(height_of(text) for each in effects for text in each) > room and any(
            len(each) > 1 for each in effects):
        next(each for each in reversed(effects) if len(each) > 1).pop()
    out = [Text(first[0], 'bold'), *first[1:]]
    for head, *more in effects:
        out += [head, *(Padding(text.strip(), (0, 0, 0, 3), expand=False) for text in more)]
    return [part for part in [*out, *last] if part]


def diagnosis_tables(view):
    """The full output: verdict, error before and after, effects, excluded rows.

    Parameters
    ----------
    view : DiagnosisView

    Returns
    -------
    list
        Tables and lines of text for `rich.console.Console.print`.
    """
    document = view.document
    out = [view.used, *(f'  {sentence}' for sentence in view.sentences), '', _errors(view)]
    spread = document['after']['cv_spread']
    if spread and spread['partitions'] > 1:
        out.append(f'mean of {spread["partitions"]} partitions; after: '
                   f'{decimals(spread["min_arcsec"])} to {decimals(spread["max_arcsec"])} arcsec')
    out += filter(None, [choice_sentence(document), expected_sentence(document)])
    out.append(f'{view.floor}: {decimals(document["noise_floor_arcsec"])} arcsec radial '
               '(corrected for degrees of freedom)\n')
    if view.effects:
        out.append(_effects(view))
    # for the largest effect it is in the verdict
    no_star = [text for name, text in observation_wording.no_star_sentences(document).items()
               if name != document['effects'][0]['name']]
    return [*out, *view.left_out, *(f'note: {note}' for note in (*view.notes, *view.signs)),
            *observation_wording.proposal_lines(document),
            *filter(None, [observation_wording.serves_sentence(document)]), *no_star]


def _errors(view):
    """The table of errors before and after."""
    document, axes = view.document, kind_of(view.document).columns
    head = [f'before: {axes[0]}', axes[1], 'radial', f'after: {axes[0]}', axes[1], 'radial']
    errors = new_table(f'RMS on the sky, arcsec, {document["observations"]} observations',
                       'rows', *head)
    parts, stretches = (document['before'], document['after']), document['cv_contiguous']
    for label, *values in (
            ('fit residuals', *(part[f'rms_{axis}arcsec'] for part in parts
                                  for axis in ('x_', 'y_', ''))),
            ('cross-validated, effects re-selected per fold', *(
                part[f'cv_rms_{axis}arcsec'] for part in parts for axis in ('x_', 'y_', ''))),
            ('cross-validated in blocks of time', *(
                stretches.get(f'{when}{axis}') for when in ('before', 'after')
                for axis in ('_x', '_y', ''))),
            ('held-out runs', *(value for part in parts for value in (
                None, None, part['holdout_rms_arcsec'])))):
        if values[2] is not None:
            errors.add_row(label, *('' if v is None else decimals(v) for v in values))
    return errors


def _effects(view):
    """The table of effects."""
    out = new_table('Effects, by RMS removed on the sky', 'effect',
                    'on', 'driver', 'p', 'ΔBIC', 'RMS removed, arcsec', 'CV gain, arcsec')
    columns = kind_of(view.document).columns
    for one, effect in zip(view.effects, view.document['effects']):
        acts = dict(zip(('az', 'el'), columns)).get(effect['axes'], effect['axes'])
        out.add_row(one.title, acts,
                    driver_word(effect['driver']).replace('_', ' '),
                    decimals(effect['p_family'], 4), decimals(effect['delta_bic'], 1),
                    decimals(effect['removes_rms_arcsec']), decimals(effect['cv_gain_arcsec']))
    return out
