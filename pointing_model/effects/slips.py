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

"""Slipping slews: a zero that moves with each slew longer than some limit.

A clutch, a friction wheel or a belt slips in long (fast) slews: by the same amount each time,
in the direction of motion, or always to one side, as for an unbalanced tube. A single slip is a
step (`drifts`).
"""

import numpy as np

from msg_tools.units import DEG
from pointing_model.mount_kinds import KINDS, USUAL

from .base import AXES, Effect, Offer, arcsec, effect, form, on_axis
from .drifts import clock, several_runs

#: least number of slips (fewer are steps); largest fraction of the slews; number of lengths tried
_FEWEST, _MOST, _TRIED = 3, 0.7, 40
#: least length of a slew: shorter moves may be due to the pointing error itself
_SLEW = 1.0 * DEG
#: least gap in length between long and short slews: on a grid of equal steps the error itself
#: would decide which are long, and "slips" would follow it
_LONGER = 0.1 * DEG


@form
def _slips(axis, least, at, signs, driver='time', mount=USUAL):
    """A zero that moves at each of the times `at`, by one amount with the given `signs`."""
    names = KINDS[mount]
    moments, level = np.asarray(at, float), np.concatenate([[0.0], np.cumsum(signs)])
    level = level - level[-1] / 2.0
    both = len(set(signs)) > 1

    def of(c):
        when = np.asarray(c.get(driver), float)
        value = level[np.searchsorted(moments, when, side='right')]
        return [on_axis(axis, np.where(np.isnan(when), np.nan, value), c.trig.cos_el)]

    shaft = names.shaft(axis)

    def wording(amount):
        way = 'ahead or behind with its direction' if both else 'always to the same side'
        return (f'The {shaft} slips by {arcsec(abs(amount.values[0]))} in each slew of more than '
                f'{least / DEG:.0f}° ({len(moments)} slews), {way}')

    return Effect(f'{names.key(axis)}_slip_of_slews' + ('' if both else '_one_way'),
                  f'{names.word(axis)} zero moves with each long slew: something slips',
                  f'{names.named({"az": "IA", "el": "IE"}[axis])} x number of long slews'
                  + (', signed' if both else ''), driver, axis, ('slip',), of, wording,
                  f'clutch, friction wheel, belt and worm mesh of the {shaft}, the coupling of its '
                  'encoder, its balance; slew slower and compare',
                  'a zero that moves with long slews',
                  f'{names.word(axis)} slips in long slews',
                  requires=(driver,), scan=f'slips_{axis}' + ('' if both else '_one_way'),
                  share='scans')


def propose(context, lacking, own):
    """If the slews of an axis differ in length; several thresholds are offered."""
    driver, _ = clock(context)
    when = context.get(driver)
    for axis, word in AXES.items():
        way = context.get(f'slew_{axis}')
        reason = None
        if way is None or when is None:
            reason = 'the slews are not known'
        elif driver == 'order' and several_runs(context):
            reason = 'the order of several runs is none'
        yield Offer('slips', [] if reason else _of_lengths(axis, way, when, driver),
                    f'slips of slews in {word}', reason, axis)


def _of_lengths(axis, way, when, driver):
    """Slips of all slews longer than a limit; each set of slews once."""
    known = np.isfinite(way) & np.isfinite(when)
    order, out = np.argsort(when[known]), []
    way, when = way[known][order], when[known][order]
    length, most = np.abs(way), int(_MOST * len(way))
    if most < _FEWEST:
        return out
    longest = np.sort(length)[::-1]
    for count in np.unique(np.geomspace(_FEWEST, most, _TRIED).astype(int)):
        least = 0.5 * float(longest[count - 1] + longest[count])
        if least < _SLEW:
            break
        if longest[count - 1] - longest[count] < _LONGER:
            continue
        slipped = length > least
        signs = np.sign(way[slipped])
        # before the row at the end of the slew
        at = (when[slipped] - 1e-6 * np.ptp(when)).tolist()
        given = {'axis': axis, 'least': least, 'at': at, 'driver': driver}
        if np.ptp(signs) > 0.0:
            out.append(effect('slips', signs=signs.tolist(), **given))
        out.append(effect('slips', signs=np.ones(len(at)).tolist(), **given))
    return out
