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

"""Errors that depend on the number of turns of the first axis: bearing cages, cables.

The angle is the catalogue angle with the whole turns that the encoder reads (`Context.get`,
``unwrapped_az``).
"""

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL

from .base import AXES, Effect, Offer, arcsec, effect, form, on_axis

_TURN = 2.0 * np.pi
#: turns of the cage per turn of the axis: 0.5 (1 +- d / D cos alpha) for balls of diameter d on a
#: circle D (T. A. Harris, Rolling Bearing Analysis, ch. 25)
_CAGE = (0.35, 0.6)
#: least travel, in turns, to distinguish a cage from errors that repeat each turn, and to detect
#: the pull of a cable
_TRAVEL, _WOUND = 1.2, 0.75
#: least excess of readings beyond one turn, from 0 or around 0; errors alone exceed it by less
_BEYOND = np.radians(1.0)
#: in one axis, or as a tilt of the axis
_WAYS = ('el', 0), ('az', 0), ('lean', 1), ('lean', -1), ('lean', 0)
#: step between trial ratios: phase at the ends of the travel, turns
_SPACING = 0.08
_ANGLE = 'unwrapped_az'


@form
def _bearing_cage(ratio, how, turn=0, mount=USUAL):
    """`how`: 'el' or 'az', the axis in which it shows, or 'lean', a rotating tilt of the axis.

    The tilt is circular, with the cage or against it (`turn` 1, -1), or an ellipse.
    """
    names = KINDS[mount]
    shaft, a, e = names.shaft('az'), *names.letters

    def of(c):
        way = ratio * c.get(_ANGLE)
        waves = np.cos(way), np.sin(way)
        if how != 'lean':
            return [on_axis(how, one, c.trig.cos_el) for one in waves]
        up, across = waves, [one * c.trig.sin_el for one in waves]
        if turn:
            return [(turn * across[1], up[0]), (-turn * across[0], up[1])]
        return [*((0.0, one) for one in up), *((one, 0.0) for one in across)]

    names_of = ('el_cos', 'el_sin', 'az_cos', 'az_sin') if how == 'lean' and not turn else (
        'cos', 'sin')
    return Effect(f'bearing_cage_{how}', f'the bearing of the {shaft} has a wave that turns with '
                  'its cage, not with the axis',
                  f'cos, sin of {ratio:.3f} {a}, {a} counted in turns'
                  + (f' (x 1 in {e}, x sin {e} across)' if how == 'lean' else ''),
                  _ANGLE, {'lean': 'both'}.get(how, how), names_of, of,
                  lambda amount: f'The bearing of the {shaft} moves it by {arcsec(amount.size)} '
                  f'with {ratio:.2f} of its turns, as the cage of its balls or rollers does',
                  f'balls, rollers and cage of the bearing of the {shaft}; its phase may slip, so '
                  'that no model of another night corrects it',
                  f'a wave of the {names.word("az")}, {ratio:.2f} per turn',
                  f'balls or rollers of the bearing of the {shaft}, which go round with their cage',
                  requires=(_ANGLE,), scan='cage', share='scans', searched=('ratio',),
                  effort=2)


@form
def _cable_drag(axis, middle, half, slack=False, mount=USUAL):
    """A linear and a cubic function of the unwrapped angle over the travel, constant beyond it.

    `slack`: with a quadratic part, so cables may pull least anywhere; in stored models without it
    they pull least in the middle of the travel.
    """
    names = KINDS[mount]
    shaft, turns = names.shaft('az'), half * 2.0 / _TURN

    def curves(u):
        line, square, cube = u, u**2 - 1.0 / 3.0, u**3 - 0.6 * u
        return [line, square, cube] if slack else [line, cube]

    def of(c):
        u = np.clip((c.get(_ANGLE) - middle) / half, -1.0, 1.0)
        return [on_axis(axis, one, c.trig.cos_el) for one in curves(u)]

    def travel(amount):
        return float(np.ptp(amount.values @ np.array(curves(np.linspace(-1.0, 1.0, 201)))))

    return Effect(f'cable_drag_{names.key(axis)}',
                  f'cables drag: the {names.word(axis)} error grows as the {shaft} winds them up',
                  f'{names.letter("az")} counted in turns: a line, ' + 'its square ' * slack
                  + 'and its cube',
                  # a stiffening spring; a wave over the range would be that of an eccentric disc
                  _ANGLE, axis, ('line', 'square', 'cube') if slack else ('line', 'cube'), of,
                  lambda amount: f'The {names.word(axis)} error follows how far the {shaft} has '
                  f'wound up its cables, {arcsec(travel(amount))} over the '
                  f'{turns:.1f} turns of this run',
                  f'cables and hoses of the {shaft} at both ends of its travel: their wrap, slack '
                  'and weight',
                  f'a slow curve of the {names.word("az")} counted in turns',
                  f'cables of the {shaft} that drag', requires=(_ANGLE,), effort=1)


def _within_one_turn(angle):
    """Whether angles, radians, stay within 0 to 360 deg, or within 180 deg of 0."""
    return any(np.abs(angle - middle).max() < 0.5 * _TURN + _BEYOND
               for middle in (0.0, 0.5 * _TURN))


def propose(context, lacking, own):
    """A cage from 1.2 turns on; cables if the readings nearly go round and exceed one turn."""
    values, reason = context.span(_ANGLE)
    turns = 0.0 if reason else float(np.ptp(values)) / _TURN
    cage = reason or (None if turns >= _TRAVEL else (
        f'the {context.mount.names.word("az")} readings go over {turns:.1f} turns; from '
        f'{_TRAVEL:g} on a cage is separable from what repeats each turn'))
    ratios = np.linspace(*_CAGE, int(np.ceil((_CAGE[1] - _CAGE[0]) * turns / _SPACING)) + 1)
    yield Offer('bearing_cage', [] if cage else [
        effect('bearing_cage', ratio=float(ratio), how=how, turn=turn)
        for how, turn in _WAYS for ratio in ratios], 'cage of the bearing', cage)
    word = context.mount.names.word('az')
    drag = reason or (
        f'the {word} readings go over {360.0 * turns:.0f}° only' if turns < _WOUND
        else f'the {word} readings stay within one turn: they may begin anew at its end, and do '
             'not tell how far the cables are wound up' if _within_one_turn(values) else None)
    middle, half = (0.0, 1.0) if drag else (
        float(0.5 * (values.min() + values.max())), float(0.5 * np.ptp(values)))
    yield Offer('cable_drag', [] if drag else [
        effect('cable_drag', axis=axis, middle=middle, half=half, slack=True) for axis in AXES],
        'cable drag', drag)
