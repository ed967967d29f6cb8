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

"""Words for the residuals: correlated noise, and scatter by elevation and axis."""

from pathlib import PurePath

from calibration.analysis.diagnosis.residual_correlation import FEWEST
from pointing_model.effects.base import arcsec, readable, the
from pointing_model.mount_kinds import kind_of

#: scatter ratio of the axes from which it is the headline
_HEADLINE = 3.0
_NAMED = 2  # largest number of causes in a sentence
#: smallest share of the variance of an axis of a reported linear drift
_MOSTLY = 0.5


def correlation_sentence(entry, axes):
    """Sentences on correlated noise.

    Parameters
    ----------
    entry : dict
        ``wander`` of a document.
    axes : sequence of str
        Names of the angles.
    """
    if not entry['slow']:
        return 'errors of rows close in time are correlated: they count as fewer rows'
    step, drifts = entry['along_the_sky'], drift_words(entry, axes)
    explained = explanation(entry.get('explained_by', ()))
    return '. '.join(filter(None, [
        _lead(step, explained), difference_sentence(entry, axes),
        direction_sentence(entry, axes) if step else '',
        f'Mostly a steady drift: {drifts}, as if something slips or settles '
        '(clutch, clamp, saddle, tripod or pier, mirror)' if drifts else '',
        'To distinguish them return to the first stars now and then, or observe in an '
        'order that mixes the sky' if step else '' if explained else 'Its cause is unknown']))


def _lead(step, explained):
    """What it may be, and what the data cannot distinguish."""
    if not step:
        return f'correlated noise: the zero drifts. {explained} explains these rows as well' \
            if explained else 'the zero drifts'
    more = f'. It could be {explained}' if explained else ''
    return (f'correlated noise: the zero drifts, or the model lacks an effect of direction'
            f'{more}. The data cannot distinguish them: consecutive rows are '
            f'{step["step_deg"]:.0f}\u00b0 apart, any two {step["any_deg"]:.0f}\u00b0')


def drift_words(entry, axes):
    """The axes with mostly linear drift, and its rate; '' if there is none."""
    drifts = []
    for name, axis in zip(('az', 'el'), axes):
        drift = (entry.get('axes') or {}).get(name, {}).get('trend')
        if drift and drift['share'] > _MOSTLY:
            rate = drift['rate_arcsec_per_hour']
            drifts.append(f'the {axis} error {"falls" if rate < 0.0 else "grows"} by '
                          f'{arcsec(abs(rate))} an hour')
    return ' and '.join(drifts)


def explanation(effects):
    """What explains it as well: names of causes, or drivers of curves without a cause.

    Parameters
    ----------
    effects : sequence of dict
        ``explained_by`` of the entry, most likely first.
    """
    causes = list(dict.fromkeys(one['cause'] for one in effects if not one['curve']))
    if len(causes) == 1:
        return f'"{causes[0]}"'
    if causes:
        more = len(causes) - _NAMED
        short = [f'"{cause.split(":")[0]}"' for cause in causes[:_NAMED]]
        last = ['one more of the ranking' if more == 1 else f'one of {more} more of the ranking']
        return ' or '.join([*short, *last * (more > 0)])
    drivers = list(dict.fromkeys(the(one['driver']) for one in effects))
    return f'something that changes with {" or ".join(drivers)}' if drivers else ''


def cause_words(entry):
    """Words after "correlated noise": a drift, or what explains it as well."""
    explained = explanation(entry.get('explained_by', ()))
    return f': a drift, or {explained}' if explained else '; its cause is unknown'


def noise_caution(entry):
    """Caution on remaining correlated noise: a list, empty if it is not slow."""
    if not entry.get('slow'):
        return []
    size = entry.get('removes_rms_arcsec')
    return ['Correlated noise' + (f', {arcsec(size)} RMS' if size else '')
            + f', remains{cause_words(entry)}.']


def _distance(axis):
    """Separation of the rows whose differences are reported, in words."""
    if axis['unit'] == 'rows':
        return {10.0: 'ten', 3.0: 'three'}[axis['apart']]
    return {60: 'an hour', 10: 'ten minutes', 1: 'a minute'}[round(60.0 * axis['apart'])]


def difference_sentence(entry, words):
    """How much more rows differ when they are farther apart; '' if unknown."""
    figures = _figures(entry, words, 'moves_arcsec')
    if not figures:
        return ''
    near, far = (_each(figures, key) for key in ('next_arcsec', 'apart_arcsec'))
    text = (f'Residuals of consecutive rows differ by {near} RMS; those of '
            f'rows about {_distance(figures[0][1])} apart by {far}')
    if not any(one['moves_arcsec'] for _, one in figures):
        text += '. So only consecutive rows can be correlated'
    return text


def direction_sentence(entry, words):
    """Whether rows of one direction have the same error at all times; '' if unknown."""
    figures = _figures(entry, words, 'near_next_arcsec', 'near_apart_arcsec')
    if not figures or entry.get('pairs', 0) < FEWEST:
        return ''
    near, far = (_each(figures, key) for key in ('near_next_arcsec', 'near_apart_arcsec'))
    return (f'Consecutive rows within {entry["within_deg"]:.0f}° on the sky differ by {near}. '
            f'If {_distance(figures[0][1])} or more apart they differ by {far} ({entry["pairs"]} '
            'pairs). Equal figures: error depends on direction; larger second figure: drift')


def _figures(entry, words, *keys):
    """Name and figures of each axis that has all these figures."""
    return [(word, entry['axes'][name]) for name, word in zip(('az', 'el'), words)
            if name in entry['axes'] and None not in map(entry['axes'][name].get, keys)]


def _each(figures, key):
    return ' and '.join(f'{arcsec(one[key])} in {word}' for word, one in figures)


def scatter_sentence(document):
    """An `unequal_scatter` of a document in words; '' without one."""
    found = document.get('unequal_scatter')
    if not found:
        return ''
    bands = found['bands']
    word = kind_of(document).axes['xy'.index(found['axis'])]
    figures = ', '.join(f'{arcsec(band["rms_arcsec"])} from {band["from_deg"]:.0f}° to '
                        f'{band["to_deg"]:.0f}°' for band in bands)
    lowest = max(bands, key=lambda band: band['rms_arcsec']) is bands[0]
    return (f'Residuals in {word} change with elevation: {figures} (RMS). '
            + ('Seeing and refraction grow toward the horizon and can cause this.' if lowest else
               'Seeing grows toward the horizon only, so this is not sky noise: an error '
               'remains there that no effect here describes.'))


def axes_words(document):
    """Which axis scatters more than the other, as a clause; '' if they scatter alike."""
    found = document.get('unequal_axes')
    if not found:
        return ''
    axes, more = kind_of(document).axes, 'xy'.index(found['axis'])
    sizes = [arcsec(size) for size in found['sigma_arcsec']]
    return (f'the {axes[more]} scatters {found["times"]:.1f} times as much as the '
            f'{axes[1 - more]}, {sizes[more]} against {sizes[1 - more]} on the sky')


def unexplained(document):
    """Clause: no effect explains the scatter of `axes_words`, or only effects of single runs."""
    alone = document['unequal_axes'].get('runs_alone')
    if not alone:
        return 'no effect explains that'
    runs = {}
    for one in alone:
        runs.setdefault(one['effect'], []).append(PurePath(str(one['run'])).name)
    return 'no effect common to all runs explains that, but alone ' + '; '.join(
        f'{", ".join(names)} show{"s" * (len(names) == 1)} {readable(effect)}'
        for effect, names in runs.items())


def is_headline(document):
    """Whether the axes are so unequal that this is the headline."""
    found = document.get('unequal_axes')
    return bool(found) and found['times'] >= _HEADLINE


def axes_sentence(document):
    """`axes_words` as a sentence, with possible reasons."""
    found, text = document.get('unequal_axes'), axes_words(document)
    if not found:
        return ''
    kind = kind_of(document)
    chance = 'p < 0.001' if found['p'] < 0.0005 else f'p = {found["p"]:.2g}'
    out = [f'{text[:1].upper()}{text[1:]} (robust σ, {chance}).',
           'Seeing and the camera affect both axes alike, so this is not sky noise.']
    letter = kind.letters[1]
    if found['axis'] == 'y':
        out.append(f'Look at drive, encoder, clutch and balance of the {kind.shafts[1]}.')
    elif found['law'] == 'cosine':
        out.append(f'It scatters as cos {letter}, like an error in the angle of the '
                   f'{kind.shafts[0]}. Look at its drive, encoder and clutch, and at the clock.')
    elif found['law'] == 'even':
        out.append(f'It scatters evenly, not as cos {letter}: not an error in the angle of the '
                   f'{kind.shafts[0]}. Look at optics, mirror and camera (rows, tilt, wind).')
    else:
        out.append(f'The data do not determine whether it scatters as cos {letter} (drive, '
                   'encoder, clock) or evenly (optics, camera).')
    return ' '.join(out)


def _consecutive(found):
    terms = ' and '.join(found['terms'])
    return (f'Errors of consecutive rows are correlated in {" and ".join(found["axes"])} (r = '
            f'{min(found.size, 0.99):.1f}): the true error of {terms or "the terms"} is larger '
            'than printed. telescope-mount diagnose allows for it')


#: kind of a `Finding` -> its sentence
KINDS = {
    'consecutive rows alike': _consecutive,
    'noisier run': lambda found: (
        f'{found["run"]} scatters {found.size / found["others"]:.1f} times as much as the other '
        f'runs, {arcsec(found.size)} against {arcsec(found["others"])} per axis: '
        + ('noise, or an error of that run alone. Its rows are weighted by its own noise'
           if found['weighed'] else 'not in both axes, so an error of that run alone is likely. '
           'Diagnose it separately'))}
