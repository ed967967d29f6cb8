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

"""Backlash and hysteresis: the reading of an axis depends on the direction of approach."""

import numpy as np

from msg_tools.units import DEG
from pointing_model.mount_kinds import KINDS, USUAL

from .base import AXES, Effect, arcsec, effect, form, offer, single_rows

#: travel after which a reversal is complete, values tried, degrees
MEMORIES = (3.0, 10.0, 30.0)


@form
def _hysteresis(axis, shape='1', memory_deg=0.0, mount=USUAL):
    """Offset by the direction of approach, times 1 or cos E, complete after some degrees."""
    names = KINDS[mount]
    length = memory_deg * DEG
    requires = (f'approach_{axis}',)
    if length:
        requires += (f'travel_{axis}', f'before_{axis}')

    def of(c):
        sign = c.get(f'approach_{axis}')
        if length:
            # a short move leaves part of the old offset; if unknown, the reversal is complete
            before = np.where(np.isnan(c.get(f'before_{axis}')), sign, c.get(f'before_{axis}'))
            travel = np.where(np.isnan(c.get(f'travel_{axis}')), np.inf, c.get(f'travel_{axis}'))
            sign = sign + (before - sign) * np.exp(-travel / length)
        value = sign * c.trig.cos_el if shape == 'cosE' else sign
        # azimuth: an error of the encoder angle (x cos E on the sky), or of the line of sight
        return [(value, 0.0) if axis == 'az' else (0.0, value)]

    def wording(amount):
        value = amount.values[0]
        falling, rising = names.sides[axis != 'az']
        more, less = (rising, falling) if value > 0 else (falling, rising)
        at_end = ' at the horizon' if KINDS[mount].vertical else f' at {names.word("el")} 0'
        where = {('az', '1'): ' across the line of sight', ('el', 'cosE'): at_end}.get(
            (axis, shape), '')
        return (f'The {names.shaft(axis)} reads {arcsec(2 * abs(value))} more{where} when the last '
                f'motion was {more} than when it was {less}: backlash or hysteresis')

    shaft = names.shaft(axis)
    summary = {('az', 'cosE'): f'backlash or hysteresis of the {shaft} or of its encoder',
            ('el', '1'): f'backlash or hysteresis of the {shaft} or of its encoder',
            ('az', '1'): f'something that tips to the side when the {shaft} reverses: a mirror, '
            'the camera, the tube',
            ('el', 'cosE'): f'play of the {shaft} that the weight of the tube opens or closes'
            if KINDS[mount].vertical else f'hysteresis of the {shaft} that fades toward the pole',
            }[axis, shape]
    seen = 'a difference by the direction of the last motion' + (
        f', as cos {names.letter("el")}' if shape == 'cosE' else '') + (
        f', with a memory of {memory_deg:g}°' if length else '')
    tail = '_cosE' if shape == 'cosE' else ''
    place = {('az', '1'): ' across the line of sight', ('az', 'cosE'): '',
             ('el', '1'): '', ('el', 'cosE'): ', as the weight of the tube acts'
             if names.vertical else f', with the cosine of the {names.word("el")}'}[axis, shape]
    return Effect(f'{names.key(axis)}_hysteresis{tail}'
                  + (f'_memory_{memory_deg:g}deg' if length else ''),
                  f'{names.word(axis)} reads differently by the side of approach (backlash){place}'
                  + (f', reached within {memory_deg:g} degrees' if length else ''),
                  f'sign(approach{", fading over some degrees" if length else ""})'
                  + (' x cos E' if shape == 'cosE' else ''),
                  f'approach_{axis}', axis, ('half_difference',), of, wording,
                  f'preload of the {names.word(axis)} drive, its gear, and the coupling of the '
                  'encoder' + ', play of mirror cell and focuser' * ((axis, shape) == ('az', '1'))
                  + '; until then approach stars from one side', seen, summary,
                  requires=requires,
                  # the memory length does not make it another cause
                  mechanism=f'hysteresis of {axis}, {shape}',
                  scan=f'memory_{axis}{tail}' if length else None)


def propose(context, lacking, own):
    """If both directions of approach occur in some rows; with memory, the previous one, too."""
    for axis in AXES:
        against = single_rows(context, f'approach_{axis}', -1.0, 1.0)
        for driver, what, memories in (('approach', '', (0.0,)),
                                       ('before', ' with memory', MEMORIES)):
            yield offer('hysteresis', f'{AXES[axis]} hysteresis{what}', context,
                        f'{driver}_{axis}', lambda _, axis=axis, memories=memories: [
                            effect('hysteresis', axis=axis, shape=shape, memory_deg=memory)
                            for shape in ('1', 'cosE') for memory in memories], against, axis)
