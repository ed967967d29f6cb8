"""What a diagnosis found, in sentences that need no formula."""

import re

import numpy as np

from pointing_model.effects.base import DRIVER_WORDS

AXIS = {'az': 'azimuth', 'el': 'elevation'}
_ZERO = {'IA': 'The zero of the azimuth axis', 'IE': 'The zero of the elevation axis',
         'CA': 'The collimation', 'TF': 'The bending of the tube',
         'tilt': 'The tilt of the azimuth axis'}
_TIMES = {1: 'once', 2: 'twice'}
_STARS = {
    'annual_aberration': 'the annual aberration (20.5″)',
    'diurnal_aberration': 'the diurnal aberration (0.3″)',
    'epoch_error': 'the right equinox: precession is left out or applied twice',
    'proper_motion': 'the proper motion of the stars'}
_TERMS = {
    'refraction': 'Stars near the horizon are off as refraction would be: the refraction that was '
                  'applied is wrong, or the tube bends that way',
    'refraction_cube': 'Stars very near the horizon are off: the refraction that was applied is '
                       'wrong there',
    'second_flexure': 'The tube bends with the sine of the elevation, or the disc of the elevation '
                      'encoder is off its centre'}


def arcsec(value, sign=False):
    """A value for a sentence, e.g. ``2.70″``."""
    if value is None or not np.isfinite(value):
        return '?'
    digits = 0 if abs(value) >= 99.95 else 1 if abs(value) >= 9.995 else 2
    return f'{value:{"+" if sign else ""}.{digits}f}″'.replace('-', '−')


def _times(order):
    return f'{_TIMES.get(order, f"{order} times")} per turn'


def effect_sentence(effect, values, rms=None, span=None, clock=None):
    """One effect in plain words.

    Parameters
    ----------
    effect : pointing_model.effects.Effect
    values : sequence of float
        Its coefficients, in the effect's unit (arcsec, s, ...).
    rms : float, optional
        Of what it leaves on the stars of the run if it is not in the model, arcsec.
    span : tuple of float, optional
        Lowest and highest value of its driver in the run.
    clock : callable, optional
        A time (s) as text.

    Returns
    -------
    str
    """
    build = _BUILDERS.get(effect.family)
    text = build(effect, np.asarray(values, float), span, clock, rms) if build else None
    if text is None:
        text = effect.cause[:1].upper() + effect.cause[1:]
    tail = f' ({arcsec(rms)} rms of the residual).' if rms is not None and np.isfinite(rms) else '.'
    return text + tail


def _hysteresis(e, v, _span, _clock, _rms):
    axis = e.parameters['axis']
    sides = ('clockwise', 'anticlockwise') if axis == 'az' else ('upward', 'downward')
    more, less = sides if v[0] > 0 else sides[::-1]
    where = {('az', '1'): ' across the line of sight', ('el', 'cosE'): ' at the horizon'}.get(
        (axis, e.parameters.get('shape', '1')), '')
    return (f'The {AXIS[axis]} axis reads {arcsec(2 * abs(v[0]))} more{where} when the last motion '
            f'was {more} than when it was {less}: backlash or hysteresis')


def _drift(e, v, span, _clock, _rms):
    p = e.parameters
    size = float(np.hypot.reduce(v))
    what = _ZERO[p['of']]
    unit = {'time': 'an hour', 'run_hours': 'an hour in each run', 'temperature': 'a degree',
            'order': 'over the run'}.get(
        p['driver'], f'over a typical change of {p["driver"]}')
    if p.get('power') == 2:
        word = DRIVER_WORDS.get(p['driver'], p['driver'])
        text = f'{what} moves with {word} along a curve'
        if span is not None:
            half = 0.5 * (span[1] - span[0]) / p.get('scale', 1.0)
            text += f', {arcsec(size * half**2)} between its middle and its ends'
        return text
    each = size
    if p['driver'] == 'time' and span is not None and span[1] - span[0] > 96 * 3600.0:
        each, unit = size * 86400.0 / p.get('scale', 1.0), 'a day'
    text = f'{what} moves {arcsec(each)} {unit}'
    if p['driver'] in ('time', 'temperature') and span is not None:
        total = size * (span[1] - span[0]) / p.get('scale', 1.0)
        whole = 'in the whole run' if p['driver'] == 'time' else \
            f'for the {span[1] - span[0]:.1f} °C of this run'
        text += f', {arcsec(total)} {whole}'
    return text


def _step(e, v, _span, clock, _rms):
    p = e.parameters
    at = f' at {clock(p["at"])}' if clock and p.get('driver', 'time') == 'time' else ''
    return f'The zero of the {AXIS[p["axis"]]} axis jumped by {arcsec(v[0], True)}{at}'


def _run_zero(e, v, _span, _clock, _rms):
    values = np.append(v, 0.0)
    return (f'The zero of the {AXIS[e.parameters["axis"]]} axis differs from run to run, by up to '
            f'{arcsec(np.ptp(values))}')


def _encoder(e, v, _span, _clock, rms):
    p = e.parameters
    cause = {1: 'its disc is off centre', 2: 'its disc is oval or tilted'}.get(
        p['order'], 'it or its coupling is uneven')
    size = np.hypot(*v)
    if rms is not None and rms < 0.2 * size:  # most of it other terms would take up
        return f'The {AXIS[p["axis"]]} encoder is wrong {_times(p["order"])}: {cause}'
    return (f'The {AXIS[p["axis"]]} encoder is wrong by up to {arcsec(size)}, '
            f'{_times(p["order"])}: {cause}')


def _wobble(e, v, _span, _clock, _rms):
    return (f'The azimuth axis wobbles by up to {arcsec(np.hypot.reduce(v))}, '
            f'{_times(e.parameters["order"])}: a bearing or track that is not flat')


def _nod(e, v, _span, _clock, _rms):
    return (f'The mount nods by {arcsec(np.hypot(*v))} in elevation, '
            f'{_times(e.parameters["order"])} of the azimuth axis')


def _terms(e, _v, _span, _clock, _rms):
    return _TERMS.get(e.parameters['name'])


def _stars(e, _v, _span, _clock, _rms):
    return f'The star places lack {_STARS[e.family]}'


def _latency(_e, v, _span, _clock, _rms):
    word = 'late' if v[0] > 0 else 'early'
    return f'Angles are read or stamped {abs(v[0]):.3f} s too {word}'


def _camera(e, v, _span, _clock, _rms):
    if e.parameters['of'] == 'rotation':
        return f'The camera is turned by {abs(np.degrees(v[0])):.2f}°'
    return f'The plate scale of the camera is wrong by {100 * v[0]:+.1f} %'.replace('-', '−')


def _proportional(e, v, span, _clock, _rms):
    p = e.parameters
    if p['driver'] == 'magnitude':
        return (f'Faint stars are centred {arcsec(v[0], True)} a magnitude beside bright ones in '
                f'{AXIS[p["axis"]]}')
    if p['driver'] == 'pier_side':
        return (f'The {AXIS[p["axis"]]} axis is off by another amount on the other side of the '
                'pier')
    total = v[0] if span is None else v[0] * (span[1] - span[0]) / p.get('scale', 1.0)
    return (f'The {AXIS[p["axis"]]} error follows the column {p["driver"]} of the file: '
            f'{arcsec(total, True)} from its lowest to its highest value')


def _subdivision(e, v, _span, _clock, _rms):
    p = e.parameters
    unit = {'grating': 'each line of its grating', 'bars': 'each bar of its disc'}.get(
        p['graduation'], 'each line')
    return (f'The {AXIS[p["axis"]]} encoder divides {unit} unevenly, by up to '
            f'{arcsec(np.hypot(*v))}')


def _decode_slip(e, _v, _span, _clock, _rms):
    p = e.parameters
    return (f'The {AXIS[p["axis"]]} encoder was read whole {p["graduation"]} beside the true place '
            f'in {len(p["rows"])} rows')


def _smooth(e, _v, _span, _clock, _rms):
    p = e.parameters
    return (f'The {AXIS[p["axis"]]} error follows the '
            f'{DRIVER_WORDS.get(p["driver"], p["driver"])} in a way that no known effect '
            'explains; a curve is added in its place')


def readable(name):
    """Name of an effect for people: ``azimuth_encoder_2`` is "azimuth encoder, 2 per turn"."""
    name = re.sub(r'(encoder|wobble|nod)_(\d+)$', r'\1, \2 per turn', str(name))
    return re.sub(r'_memory_([\d.]+)deg', r', memory \1°', name).replace('_', ' ')


_BUILDERS = {
    'hysteresis': _hysteresis, 'drift': _drift, 'step': _step, 'run_zero': _run_zero,
    'encoder': _encoder, 'bearing_wobble': _wobble, 'nod': _nod, 'terms': _terms,
    'annual_aberration': _stars, 'diurnal_aberration': _stars, 'epoch_error': _stars,
    'proper_motion': _stars, 'latency': _latency, 'camera': _camera,
    'proportional': _proportional, 'subdivision': _subdivision, 'decode_slip': _decode_slip,
    'smooth': _smooth,
}


#: arcsec; what is left beyond this is no noise of pointing
_ABSURD = 1800.0


def verdict_sentences(document, effect_texts=(), limit=5, caution=''):
    """The verdict of a diagnosis, and what it bought.

    Parameters
    ----------
    document : dict
        `Diagnosis.to_dict()`.
    effect_texts : sequence of str
        A sentence for each of its effects.
    limit : int
        Effects that are told; the others are counted.
    caution : str
        Follows the gain.

    Returns
    -------
    headline : str
    sentences : list of str
    """
    effects = document['effects']
    count = len(effects)
    many = 'One effect' if count == 1 else f'{count} effects'
    verdict = document['verdict']
    if verdict == 'none':
        floor = document.get('noise_floor_arcsec')
        left = document['before'].get('rms_arcsec')
        text = f'What is left, {arcsec(left)}, looks like noise'
        text += f' (noise floor {arcsec(floor)}).' if floor is not None else '.'
        if not caution and (left or 0.0) > _ABSURD:
            caution = (f'What is left, {arcsec(left)}, is far more than a mount errs by: look at '
                       'the columns, their units and signs, and where azimuth 0 is.')
        return 'The model lacks nothing that these observations can show', [
            caution or text, 'The model stays as it was.']
    sentences = []
    label, before, after = best_pair(document)
    if before is not None and after is not None:
        share = f' ({100 * (after / before - 1):+.0f} %)'.replace('-', '−') if before else ''
        sentences.append(f'The pointing error {label} goes from {arcsec(before)} to '
                         f'{arcsec(after)}{share}.')
    if caution:
        sentences.append(caution)
    for row, text in list(zip(effects, effect_texts))[:limit]:
        if row.get('alternatives'):
            text += (' With these observations it could as well be: '
                     f'{_listed(row["alternatives"])}.')
        sentences.append(text)
    if len(effect_texts) > limit:
        sentences.append(f'And {len(effect_texts) - limit} more.')
    if verdict == 'unknown':
        headline = 'Something is left that no known effect explains'
    elif verdict == 'ambiguous':
        headline = f'{many} found, and more than one cause would explain ' \
                   f'{"it" if count == 1 else "them"}'
    else:
        headline = f'{many} that the model lacked {"is" if count == 1 else "are"} found and added'
    return headline, sentences


def best_pair(document):
    """The most honest pair of errors there is: held out, else cross-validated, else fitted.

    Returns
    -------
    label : str
    before, after : float or None
        Radial RMS on the sky, arcsec.
    """
    for key, label in (('holdout_rms_arcsec', 'on rows held out'),
                       ('cv_rms_arcsec', 'in cross-validation'),
                       ('rms_arcsec', 'on the rows fitted')):
        pair = document['before'].get(key), document['after'].get(key)
        if None not in pair:
            return label, *pair
    return 'on the rows fitted', None, None


def _listed(names):
    names = [readable(name) for name in names]
    if len(names) > 4:
        names = [*names[:3], f'{len(names) - 3} others']
    return names[0] if len(names) == 1 else '; '.join(names[:-1]) + '; or ' + names[-1]
