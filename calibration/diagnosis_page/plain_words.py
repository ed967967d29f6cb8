"""What a diagnosis found, in sentences that need no formula."""

from calibration.diagnosis.facts import bad_nights, worst_sentence
from calibration.diagnosis.rows_told import outlier_sentence
from pointing_model.effects.base import arcsec, readable
from pointing_model.mounts import KINDS

from .told import next_sentence, open_causes, steps, way

#: arcsec; what is left beyond this is no noise of pointing
_ABSURD = 1800.0
HELD = 'on rows held out'
#: of the effects that would have been found, so many are told
_MOST_SAID = 8


def verdict_sentences(document, effect_texts=(), limit=5, caution='', whole=False):
    """The verdict of a diagnosis, and what it bought.

    Parameters
    ----------
    document : dict
        `Diagnosis.to_dict()`.
    effect_texts : sequence of str
        A sentence for each of its effects, in their order; the largest is told first.
    limit : int
        Effects that are told; the others are counted.
    caution : str
        Follows the gain.
    whole : bool
        With the way from what the encoders read as the headline, where it is known.

    Returns
    -------
    headline : str
    sentences : list of str
    """
    headline, sentences = _verdict(document, effect_texts, limit, caution,
                                   bool(whole and way(document)))
    if whole and way(document):
        return way(document), [f'{headline}. RMS on the sky, {steps(document)[2]}.', *sentences]
    return headline, sentences


def _verdict(document, effect_texts, limit, caution, whole):
    effects = document['effects']
    count = len(effects)
    many = 'One effect' if count == 1 else f'{count} effects'
    verdict = document['verdict']
    outliers = [text for text in (outlier_sentence(document),) if text]
    if verdict == 'refused':
        return 'Nothing is concluded from so few of the rows', [caution, *outliers]
    if verdict == 'none':
        floor = document.get('noise_floor_arcsec')
        left = document['before'].get('rms_arcsec')
        text = f'What is left, {arcsec(left)}, looks like noise'
        text += f' (noise floor {arcsec(floor)}).' if floor is not None else '.'
        if not caution and (left or 0.0) > _ABSURD:
            caution = (f'What is left, {arcsec(left)}, is far more than a mount errs by: look at '
                       'the columns, their units and signs, and where azimuth 0 is.')
        return 'The model lacks nothing that these observations can show', [
            caution or text, 'The model stays as it was.', *_detectable(document), *outliers]
    if verdict == 'undecided':
        return ('Undecided: something is beyond chance, but these observations cannot test it',
                [caution, 'The model stays as it was.', *outliers])
    if verdict == 'wanders':
        if document['wander'].get('along_the_sky'):
            return ('Neighbouring rows err alike: the zero wanders, or the direction has an error '
                    'that no effect describes', [
                        *_wander(document), 'No effect is added. Observe once more in an order '
                        'that mixes the sky.', *outliers])
        return ('The zero wanders, and what moves it is not known', [
            *_wander(document), 'No effect is added. How far the zero can be trusted is part of '
            'the model: set it anew as often as that asks for.', *outliers])
    sentences = []
    label, before, after = best_pair(document)
    gain = ''
    if before is not None and after is not None and not (whole and label != HELD):
        share = f' ({100 * (after / before - 1):+.0f} %)'.replace('-', '−') if before else ''
        gain = (f'The pointing error {label} goes from {arcsec(before)} to {arcsec(after)}'
                f'{share}.')
    sentences += [gain] if gain and not whole else []
    if caution:
        sentences.append(caution)
    # the largest first: what to mend first
    told = sorted(zip(effects, effect_texts),
                  key=lambda each: -(each[0].get('removes_rms_arcsec')
                                     or each[0].get('cv_gain_arcsec') or 0.0))
    for i, (row, text) in enumerate(told[:limit]):
        if i == 0 and whole and count > 1:
            text = f'The largest error beyond the terms: {text[:1].lower()}{text[1:]}'
        if i == 0 and row.get('causes'):
            text = f'{text} {next_sentence(document, row)}'.strip()
        if row.get('alternatives') and 'causes' not in row:
            text += (' With these observations it could as well be: '
                     f'{_listed(row["alternatives"])}.')
        sentences.append(text)
    if len(effect_texts) > limit:
        sentences.append(f'And {len(effect_texts) - limit} more.')
    sentences += [gain] if gain and whole else []
    sentences += bad_nights(document, KINDS[document.get('mount') or 'altaz'].axes)
    sentences += [text for text in (worst_sentence(document),) if text]
    sentences += [*_wander(document), *outliers]
    unclear = sum(open_causes(row) > 1 for row in effects)
    if verdict == 'unknown':
        headline = 'Something is left that no known effect explains'
    elif verdict == 'ambiguous' and (unclear or not all('causes' in row for row in effects)):
        them = 'it' if count == 1 else 'them' if unclear in (0, count) \
            else f'{"one" if unclear == 1 else unclear} of them'
        headline = f'{many} found{" beyond the terms" * whole}, and more than one cause would ' \
                   f'explain {them}'
    elif verdict in ('withheld', 'taken_back'):
        with_it = 'it' if count == 1 else 'them'
        headline = f'{many} seemed to be there, but the model with {with_it} points worse: the ' \
                   'model before stays in force'
    else:
        headline = f'{many} that the model lacked {"is" if count == 1 else "are"} found and added'
    return headline, sentences


def _detectable(document):
    """What would have been found, in one sentence, or none."""
    said = []
    for row in (document.get('detectable') or [])[:_MOST_SAID]:
        unit = {'arcsec/h': ' an hour', 'arcsec/K': ' a degree',
                'arcsec/run': ' over the run'}.get(row['unit'], '')
        said.append(f'{row["what"]} by {arcsec(row["amplitude_arcsec"])}{unit}')
    if not said:
        return []
    return ['Nine times in ten they would have shown ' + '; '.join(said) + '.']


def _wander(document):
    """Rows that resemble their neighbours, if there is such a thing."""
    entry = document.get('wander')
    return [entry['text'][:1].upper() + entry['text'][1:] + '.'] if entry else []


def best_pair(document):
    """The most honest pair of errors there is: held out, else cross-validated, else fitted.

    Returns
    -------
    label : str
    before, after : float or None
        Radial RMS on the sky, arcsec.
    """
    for key, label in (('holdout_rms_arcsec', HELD),
                       ('cv_rms_arcsec', 'in cross-validation'),
                       ('rms_arcsec', 'on the rows fitted')):
        pair = document['before'].get(key), document['after'].get(key)
        if None not in pair:
            return label, *pair
    return 'on the rows fitted', None, None


def floor_words(document):
    """What the noise floor is called: it holds what wanders too."""
    wander = document.get('wander')
    return 'noise floor, with what wanders' if wander and wander.get('slow') else 'noise floor'


def _listed(names):
    names = [readable(name) for name in names]
    if len(names) > 4:
        names = [*names[:3], f'{len(names) - 3} others']
    return names[0] if len(names) == 1 else '; '.join(names[:-1]) + '; or ' + names[-1]
