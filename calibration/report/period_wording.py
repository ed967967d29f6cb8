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

"""Words for periodic errors: which gear has this period, and how long the phase is valid."""

from calibration.analysis.diagnosis.period_scans import FEWEST, MOST
from pointing_model.effects.base import arcsec
from pointing_model.effects.gears_and_worms import strain_wave

_MOST_ALIASES, _MOST_TEETH = 4, 6  # largest numbers that are named
#: how long the phase in a model is valid
PHASE = ('The phase of the periodic error lasts only with a home position, an index or an absolute '
         'encoder. Otherwise each power-on has its own: measure it anew.')


def period_sentences(effect):
    """Sentences on a periodic error besides its size; [] for any other effect.

    Parameters
    ----------
    effect : Effect

    Returns
    -------
    list of str
    """
    p = effect.parameters
    if effect.form != 'periodic':
        return []
    out = []
    if len(p['orders']) > 1:
        out.append(f'It is no pure sine: waves {listed(p["orders"])} times a period are in it.')
    if p['of'] == 'time':
        return [*out, 'It is periodic in time, not in the axis angle. Its phase is that of this '
                'night.']
    if p['tape']:
        return [*out, f'Declared were {p["tape"]} lines a turn.']
    out.append(_gear(p['turns']))
    return [*out, PHASE]


def _gear(turns):
    drives = strain_wave(turns)
    worm = f'a worm wheel of {turns:.0f} teeth' if abs(turns - round(turns)) < 1e-6 else ''
    if drives:
        ratio, order = drives[0]
        drive = (f'a strain-wave drive of {ratio}:1 ({"twice" if order == 2 else "once"} a turn '
                 'of its wave generator)')
        text = ' or '.join(filter(None, [worm, drive]))
    else:
        text = worm or 'a gear or belt before the worm, for these are no whole teeth,'
    return f'{text[:1].upper()}{text[1:]} may have this period.'


def listed(numbers):
    """Numbers as a list in words: 1, 2 and 3."""
    *first, last = (f'{n:.6g}' for n in numbers)
    return f'{", ".join(first)} and {last}' if first else last


def _period(found):
    if found['tape']:
        return (f'lines of the tape, searched within 1 % of {found["tape"]} a turn: '
                f'{found["searched"]:.7g} ± {found.sigma:.2g}{_aliases(found)}')
    clock = ' (a turn of the sky)' if found['of'] == 'time' else ''
    whole = f', so {found.size:.0f}' if found['whole'] else ''
    return (f'period searched from {FEWEST:.0f} to {MOST:.0f} per turn{clock}: '
            f'{found["searched"]:.6g} ± {found.sigma:.2g}{whole}{_aliases(found)}')


def _aliases(found):
    others = found['aliases']
    if not others:
        return ''
    return (f'. Equally good: {listed(others[:_MOST_ALIASES])}'
            + ' and others' * (len(others) > _MOST_ALIASES)
            + ': the rows are nearly evenly spaced. Rows at uneven steps would decide')


def _fast(found):
    teeth = listed(sorted(found['teeth'])[:_MOST_TEETH]).replace(' and ', ' or ')
    others = ', among others,' * (len(found['teeth']) > _MOST_TEETH)
    steps = f'even steps of {found.size:.3g}°' if found.size else 'nearly even steps'
    sizes = found.evidence.get('sizes')
    hangs = '; the size depends on the number, ' + ' to '.join(map(arcsec, sizes)) if sizes else ''
    return (f'A worm or gear of the {found["axis"]} with about {teeth} teeth{others} fits as well'
            f'{hangs}: the stars stand at {steps}. Observe at uneven steps')


def _nothing(found):
    return (f'Nothing was found at the declared {found.size:.6g} per turn of {found["axis"]}, '
            f'but at {listed(found["turns"])}')


def _absent(found):
    return (f'At {found["teeth"]:.6g} per turn of {found["axis"]} the fundamental is absent '
            f'({found.size:.2f} ± {found.sigma:.2f}″). {2 * found["teeth"]:.6g} teeth are more '
            'likely')


#: kind of a `Finding` -> its sentence
KINDS = {'period': _period, 'fast wave as well': _fast, 'nothing at the teeth': _nothing,
         'fundamental absent': _absent}
