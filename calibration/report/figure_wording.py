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

"""Words for error figures: before and after, on which rows, and how reliable they are."""

from pointing_model.effects.base import arcsec
from pointing_model.mount_kinds import USUAL, kind_of

from .cause_wording import counted, plain_name

_MOST_OTHERS = 3  # largest number of other selected effects that are named
#: verdicts that leave the model unchanged
STAYS = ('none', 'wanders', 'undecided', 'refused', 'withheld', 'taken_back')
#: rows that an RMS refers to
HELD, LEFT_OUT, FITTED = 'on held-out runs', 'cross-validated', 'on the fitted rows'
STRETCHES = 'cross-validated in blocks of time'


def model_words(document, whose=True):
    """The declared terms: "the seven terms of an alt-azimuth mount".

    Parameters
    ----------
    document : dict
    whose : bool
        Whether to add the kind of mount.
    """
    terms = list(document.get('base_terms') or ())
    kind = kind_of(document)
    of = f' of {kind.words}' if whose else ''
    if not terms:
        return 'no terms'
    if terms == list(kind.index):
        return f'the zeros{of}'
    usual = 'the usual ' if terms == list(kind.standard6) else 'the '
    if usual == 'the ' and terms != list(kind.physical):
        return f'the {counted(len(terms), "declared term")}'
    return f'{usual}{counted(len(terms), "term")}{of}'


def beyond(document, whose=True):
    """Clause "beyond the ... terms", with a leading space; '' if there are no terms."""
    return f' beyond {model_words(document, whose)}' * bool(document.get('base_terms'))


def way(document):
    """Raw, with the terms, with the effects: RMS on the sky.

    Parameters
    ----------
    document : dict
        `Diagnosis.to_dict()`.

    Returns
    -------
    str
        '' if the raw error is unknown.
    """
    read = document.get('as_read_rms_arcsec')
    if read is None or document['verdict'] == 'refused':
        return ''
    label, before, after = best_pair(document, held=False)
    if before is None:
        return ''
    effects = len(document['effects'])
    text = (f'RMS on the sky: {way_size(read)} raw, {way_size(before)} with '
            f'{model_words(document)}')
    if effects and document['verdict'] not in STAYS:
        text += f', {way_size(after)} with {counted(effects, "effect")} more'
    return f'{text}; {label}.'


def best_pair(document, held=True):
    """The most reliable pair of errors: held-out runs, else cross-validated, else fitted.

    Folds contiguous in time are preferred to random ones: with random folds the neighbours in time
    of a held-out row stay in the fit, unlike those of a star observed in the next hour.

    Parameters
    ----------
    document : dict
    held : bool
        Whether held-out runs may be used.

    Returns
    -------
    label : str
    before, after : float or None
        Radial RMS on the sky, arcsec.
    """
    blocks = document.get('cv_contiguous') or {}
    for key, label in (('holdout_rms_arcsec', HELD),
                       ('cv_rms_arcsec', LEFT_OUT),
                       ('rms_arcsec', FITTED)):
        pair = document['before'].get(key), document['after'].get(key)
        if None in pair or (label == HELD and not held):
            continue
        if label == LEFT_OUT and blocks:
            return STRETCHES, blocks['before'], blocks['after']
        return label, *pair
    return FITTED, None, None


def way_size(value):
    """An RMS as `way` writes it."""
    return f'{value:.{0 if value >= 999.5 else 1}f}″' if value >= 9.995 else arcsec(value)


def repeat_sentence(document):
    """In how many cross-validation folds exactly these effects were selected.

    Returns
    -------
    str
        '' if unknown.
    """
    spread = document['after'].get('cv_spread') or {}
    folds, count = spread.get('folds'), len(document['effects'])
    if not folds or document['verdict'] in STAYS or not count or 'same_choice' not in spread:
        return ''
    what = 'this effect' if count == 1 else f'these {counted(count, "effect")}'
    same, chosen = spread['same_choice'], spread.get('chosen') or {}
    any_ = spread.get('chosen_set') or chosen
    if spread.get('same_set', same) > same or sum(any_.values()) > sum(chosen.values()):
        same, chosen = spread['same_set'], any_
    text = f'Stability: exactly {what} in {same} of {folds} resamples'
    if count > 1 and chosen:
        largest = max(document['effects'], key=lambda row: row.get('removes_rms_arcsec') or 0.0)
        if largest['name'] in chosen:
            text += f'; the largest in {chosen[largest["name"]]}'
    return f'{text}.' + _in_runs(document, spread)


def _in_runs(document, spread):
    """In how many runs, each taken alone, the largest effect (by any of its causes) is found."""
    largest = max(document['effects'], key=lambda row: row.get('removes_rms_arcsec') or 0.0)
    count = (spread.get('runs_set') or {}).get(largest['name'])
    if count is None:
        return ''
    what = 'it' if len(document['effects']) == 1 else 'the largest'
    return f' Of {spread["runs"]} runs or sessions, each alone, {count} show {what}.'


def choice_sentence(document):
    """How often each effect was selected in the cross-validation folds; '' if unknown.

    Parameters
    ----------
    document : dict

    Returns
    -------
    str
    """
    spread = document['after'].get('cv_spread') or {}
    folds = spread.get('folds')
    if not folds or document['verdict'] in STAYS or not document['effects']:
        return ''
    kind = document.get('mount') or USUAL
    # count an effect by any of its causes: which of them a fold prefers is chance
    same, others = spread.get('chosen', {}), spread.get('others_set', spread.get('others', {}))
    own = [f'{count} {plain_name(name, kind)}'
           + (f' ({count - same[name]} by an equal cause)' if same.get(name, count) < count else '')
           for name, count in _by_count({**same, **(spread.get('chosen_set') or {})})]
    others = [f'{count} {plain_name(name, kind)}' for name, count in _by_count(others)]
    lines = [f'found in {folds} resamples:', *own]
    if len(own) > 1:
        lines.append(f'{spread.get("same_set", spread["same_choice"])} exactly these')
    if others:
        lines.append('others: ' + ', '.join(others[:_MOST_OTHERS])
                     + f', {len(others) - _MOST_OTHERS} more' * (len(others) > _MOST_OTHERS))
    if spread.get('no_choice'):
        lines.append(f'{spread["no_choice"]} no effect')
    return '\n  '.join(lines)


def _by_count(counts):
    return sorted(counts.items(), key=lambda one: -one[1])


def figures_sentence(document):
    """Which figure to quote, and why the others differ; '' without any.

    Parameters
    ----------
    document : dict

    Returns
    -------
    str
    """
    label, before, after = best_pair(document)
    quoted = before if document['verdict'] in STAYS else after
    floor, expected = document.get('noise_floor_arcsec'), document.get('expected')
    if quoted is None or document['verdict'] == 'refused':
        return ''
    if label == FITTED:
        out = [f'{arcsec(quoted)} is the RMS of the fitted rows only: expect more on other stars']
    else:
        out = [f'Use {arcsec(quoted)} RMS ({label})']
        own = document['before' if document['verdict'] in STAYS else 'after'].get('cv_rms_arcsec')
        if label == STRETCHES and own is not None and own < quoted and (
                document.get('wander') or {}).get('slow'):
            out.append(f'{arcsec(own)}, cross-validated in random folds, is too low: neighbouring '
                       'rows err alike')
        if label == HELD and own is not None:
            out.append(f'Cross-validated within the fitted runs it is {arcsec(own)}: such rows '
                       'share the peculiarities of their run')
    slow = bool((document.get('wander') or {}).get('slow'))
    if floor is not None:
        out.append(f'Fit RMS corrected for degrees of freedom: {arcsec(floor)}'
                   + ('. It includes the drift of the zero, so it is no noise floor' if slow else
                      ' (noise floor)'))
    if expected:
        low, high = expected['low_arcsec'], expected['high_arcsec']
        out.append(f'Expected on new stars in the {expected.get("within", "half hour")} after the '
                   f'last row: {arcsec(expected["rms_arcsec"])} ({arcsec(low)} to {arcsec(high)}, '
                   '90 %)')
        if floor is not None and expected['rms_arcsec'] < floor:
            within = low <= floor <= high
            out.append(f'It can be below {arcsec(floor) if slow else "the floor"}: '
                       + ('the zero drifts less by then than over the whole run'
                          if slow else 'late rows may scatter less than the others')
                        + (', and the difference is within its uncertainty' if within else ''))
    return '. '.join(out) + '.'


def floor_words(document):
    """Label of the noise floor, which may include drift."""
    correlation = document.get('wander')
    return 'fit residuals, noise and drift' if correlation and correlation.get('slow') \
        else 'noise floor'
