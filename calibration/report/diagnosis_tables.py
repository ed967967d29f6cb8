"""What people see of a diagnosis on the terminal."""

from itertools import groupby

from rich.text import Text

from pointing_model.effects.base import driver_word, readable
from pointing_model.mount_kinds import USUAL

from ..analysis.diagnosis.row_counts import row_word
from . import observation_wording as observations
from . import row_wording
from .effect_wording import effect_summaries, effect_title
from .figure_wording import choice_sentence, floor_words
from .tables import decimals, new_table
from .verdict_wording import verdict_sentences
from .wording import paragraph, wording

_MOST_PLACES = 6  # that are proposed


def diagnosis_tables(found, document):
    """All that the command says: verdict, error before and after, effects, what was left out.

    Parameters
    ----------
    found : calibration.analysis.diagnosis.Diagnosis
    document : dict
        Of `documents.diagnosis_document`.

    Returns
    -------
    list
        What `rich.console.Console.print` takes: tables and lines of text.
    """
    names, run = found.observations.run.mount.names, found.observations.run
    headline, sentences = verdict_sentences(document, effect_summaries(found), limit=20,
                                            caution=paragraph(found.cautions))
    out = [row_wording.used_sentence(document), Text(headline, 'bold'),
           *(f'  {sentence}' for sentence in sentences), '',
           _errors(found, document, names.columns)]
    spread = document['after']['cv_spread']
    if spread and spread['partitions'] > 1:
        out.append(f'mean of {spread["partitions"]} ways to leave rows out; after goes from '
                   f'{decimals(spread["min_arcsec"])} to {decimals(spread["max_arcsec"])} arcsec')
    out += filter(None, [choice_sentence(document), row_wording.expected_sentence(document)])
    out.append(f'{floor_words(document)}: {decimals(document["noise_floor_arcsec"])} arcsec radial '
               '(what is left, corrected for the number of coefficients)\n')
    if found.effects:
        out.append(_effects(found, document, names))
    out += row_wording.left_out_lines(found.excluded, len(found.observations.runs) > 1,
                                      row_word(run))
    notes = [*dict.fromkeys(map(wording, found.notes)), *row_wording.signs_sentences(
        found.columns_alike, names, run.meta.get('format'))]
    largest = document['effects'][0]['name'] if document['effects'] else None
    return [*out, *(f'note: {note}' for note in notes), *_proposals(document),
            *filter(None, [observations.serves_sentence(document)]),
            *observations.no_star_sentences(document, largest)]


def _errors(found, document, axes):
    """The table of errors before and after."""
    head = [f'before: {axes[0]}', axes[1], 'radial', f'after: {axes[0]}', axes[1], 'radial']
    errors = new_table(f'RMS on the sky, arcsec, {document["observations"]} observations',
                       'judged on', *head)
    parts, stretches = (document['before'], document['after']), found.cv_contiguous
    for label, *values in (
            ('the rows fitted', *(part[f'rms_{axis}arcsec'] for part in parts
                                  for axis in ('x_', 'y_', ''))),
            ('rows left out (the choice repeated)', *(
                part[f'cv_rms_{axis}arcsec'] for part in parts for axis in ('x_', 'y_', ''))),
            ('stretches of time left out', *(
                stretches.get(f'{when}{axis}') for when in ('before', 'after')
                for axis in ('_x', '_y', ''))),
            ('runs held out', *(value for part in parts for value in (
                None, None, part['holdout_rms_arcsec'])))):
        if values[2] is not None:
            errors.add_row(label, *('' if v is None else decimals(v) for v in values))
    return errors


def _effects(found, document, names):
    """The table of effects."""
    out = new_table('Effects, in the order of the RMS on the sky that they take off', 'effect',
                    'on', 'driver', 'p', 'ΔBIC', 'takes off, arcsec', 'gain, arcsec')
    for one, effect in zip(found.effects, document['effects']):
        acts = dict(zip(('az', 'el'), names.columns)).get(effect['axes'], effect['axes'])
        out.add_row(effect_title(one, names.axes), acts,
                    driver_word(effect['driver']).replace('_', ' '),
                    decimals(effect['p_family'], 4), decimals(effect['delta_bic'], 1),
                    decimals(effect['removes_rms_arcsec']), decimals(effect['cv_gain_arcsec']))
    return out


def _proposals(document):
    """A line for each pair of causes: the places that tell them apart, one after the other."""
    causes, kind = observations.causes_of(document), document.get('mount') or USUAL
    for separates, group in groupby(observations.proposals(document)[:_MOST_PLACES],
                                    key=lambda item: item['separates']):
        group = list(group)
        names = ' from '.join(causes.get(name) or readable(name) for name in separates)
        yield (f'next, to tell {names} ({observations.enough(group)}): observe '
               + '; '.join(observations.place_words(item, kind) for item in group))
