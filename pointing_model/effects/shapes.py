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

"""Harmonics of either angle in either axis, which have a name in TPOINT but no known cause.

Orders below 3 are left to effects with a cause: over less than a quarter turn zeros, collimation
and non-perpendicularity absorb nearly all of such a wave.
"""

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL

from .base import Effect, Offer, effect, form, times

ORDERS = range(3, 9)
#: dependence of a wave of the first angle on the second, other than a nod, wobble or line of sight
_PARTNERS = {'sin 2{e}': lambda t: 2.0 * t.sin_el * t.cos_el, 'cos {e}': lambda t: t.cos_el,
             'sin {e}': lambda t: t.sin_el}
#: price of a choice of one in three, 2 ln 3, in units of ln n for some 60 rows; a choice of order
#: is free, as for a nod
_CHOICE = 0.5
#: index of TPOINT's letter for a result in `MountKind.tpoint`
_RESULTS = {'az': 0, 'el': 1, 'sky': 3}


@form
def _harmonic(result, of, order, mount=USUAL):
    """`order` waves per turn of an angle, in the reading of an axis or left-right ('sky')."""
    k, names = int(order), KINDS[mount]
    word, letter = names.word(of), names.letter(of)
    what = 'left-right' if result == 'sky' else names.word(result)

    def columns(c):
        angle = k * (c.az if of == 'az' else c.el)
        waves = np.cos(angle), np.sin(angle)
        return [(one * c.trig.cos_el, 0.0) if result == 'az' else (one, 0.0) if result == 'sky'
                else (0.0, one) for one in waves]

    tpoint = names.tpoint and ' '.join(
        f'H{names.tpoint[_RESULTS[result]]}{f}{names.tpoint[of == "el"]}{k}' for f in 'CS')
    own = 'left_right' if result == 'sky' else names.key(result)
    return Effect(f'harmonic_{k}_of_{names.key(of)}_in_{own}',
                  f'unknown cause: the {what} error has {k} waves in a turn of the {word}',
                  f'cos {k}{letter}, sin {k}{letter}', names.key(of),
                  'el' if result == 'el' else 'az', ('cos', 'sin'), columns,
                  lambda _: f'The {what} error has a wave of the {word}, {times(k)}, without a '
                  'known cause',
                  f'what else turns with the {word}, or repeats each {360.0 / k:.0f}° of it',
                  f'a wave of the {word}, {times(k)}, in the {what} error', kind='smooth',
                  tpoint=tpoint or None, scan=f'harmonic of {of} in {result}', share='scans')


@form
def _nod_unlike(order, partner, mount=USUAL):
    """A wave of the first angle in the second axis, whose size depends on the second angle."""
    k, names = int(order), KINDS[mount]
    a, e = names.letters
    how = partner.format(e=e)
    size = _PARTNERS[partner]

    def columns(c):
        return [(0.0, f(k * c.az) * size(c.trig)) for f in (np.cos, np.sin)]

    return Effect(f'nod_unlike_{k}_{how.replace(" ", "_")}',
                  f'the {names.word("el")} error has a wave of the {names.word("az")} '
                  f'times {how}: no nod',
                  f'(0, cos {k}{a} {how}), (0, sin {k}{a} {how})', names.key('az'), 'el',
                  ('cos', 'sin'), columns,
                  lambda _: f'The {names.word("el")} error has a wave of the {names.word("az")}, '
                  f'{times(k)}, times {how}: a nod would be the same at any '
                  f'{names.word("el")}',
                  f'parts that turn with the {names.word("az")} and yield more at some '
                  f'{names.word("el")}s',
                  f'a wave of the {names.word("az")}, {times(k)}, times {how}',
                  f'something that turns with the {names.word("az")} and is no nod '
                  f'({times(k)}, as {how})', only_shape=True,
                  scan=f'nod unlike {partner}', scanned=_CHOICE, share='scans')


def propose(context, lacking, own):
    """Orders from 3 on that no effect with a cause has."""
    yield Offer('harmonic', [
        effect('harmonic', result=result, of=of, order=order)
        for result, of, lowest in (('sky', 'el', 3), ('el', 'el', 4), ('az', 'el', 3),
                                   ('sky', 'az', 5), ('el', 'az', 7), ('az', 'az', 7))
        for order in ORDERS if order >= lowest])
    yield Offer('nod_unlike', [
        effect('nod_unlike', order=order, partner=partner)
        for partner in _PARTNERS for order in ORDERS])
