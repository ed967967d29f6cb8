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

"""Errors at an unknown place: a mirror that flops, a joint of the track or of an encoder tape.

The place, and for a joint its width, is scanned. A flop depends on gravity and is fixed in the
frame of the tube: on the elevation, or sideways as a tilted first axis carries the tube over its
highest place (a fork: the meridian). Joints under a wheel depend on the first axis, those of an
encoder tape on its own.
"""

import numpy as np

from msg_tools.units import DEG, even_sample, wrap
from pointing_model.mount_kinds import KINDS, USUAL

from .base import Effect, Offer, arcsec, effect, form, single_rows

_TURN = 2.0 * np.pi
#: largest number of places tried of a flop (half as many find 95, not 97, of 100 flops of lambda 7
#: in 120 rows), of a jump, and of a flop with play; values of play between both directions, rad
_FLOPS, _JUMPS, _FLOPS_WITH_PLAY, _PLAYS = 96, 96, 48, (5.0 * DEG, 10.0 * DEG, 15.0 * DEG)
#: least number of rows on either side of a step, and within a bump
_FEWEST_BEYOND, _FEWEST_WITHIN = 4, 3
#: gap of the first angle from which the axis is taken not to go beyond it, rad
_GAP = 40.0 * DEG
#: 1-sigma widths of a bump that are tried, rad; numbers of equal joints per turn
_WIDTHS, _JOINTS = (2.0 * DEG, 4.0 * DEG, 8.0 * DEG, 16.0 * DEG), (3, 4, 6, 8, 12)
#: in widths: distance between trial places, and distance within which a row is in the bump
_SPACING, _WITHIN = 1.0, 1.5
_LOOK_AT_MIRROR = 'supports and lock of the mirror, supports of the secondary, the focuser'


def _flopped(c, at, play):
    """1 in the low position, 0 in the high one."""
    el = c.get('elevation')
    if play:
        return np.where(np.isnan(c.get('approach_el')), np.nan,
                        1.0 * (el < at + 0.5 * play * c.get('approach_el')))
    return 1.0 * (el < at)


def _flops_by(amount, axis='both'):
    text = f'Mirror, camera or tube flops by {arcsec(amount.size)}'
    if axis == 'both':
        across, up = np.abs(amount.values)
        text += f' ({arcsec(across)} left or right, {arcsec(up)} up or down)'
    return text


@form
def _flop(at, axis='both', play=0.0, mount=USUAL):
    """A step of the line of sight at an elevation; with `play` it is higher on the way up.

    `axis`: 'both'; stored models may have a step in one only: 'az', sideways, or 'el', up or down.
    """
    def of(c):
        value = _flopped(c, at, play)
        both = (value, 0.0), (0.0, value)
        return list(both) if axis == 'both' else [both[axis == 'el']]

    def wording(amount):
        text = f'{_flops_by(amount, axis)} at elevation {at / DEG:.0f}°'
        return text + (f', {play / DEG:.0f}° later in the direction of motion' if play else '')

    return Effect('flop' + '_with_play' * bool(play),
                  'mirror, camera or tube flops as the tube goes higher'
                  + ', and back at another height on the way down' * bool(play),
                  f'H(elevation < {at / DEG:.1f} deg)', 'elevation', axis,
                  ('across', 'up') if axis == 'both' else ('step',), of, wording,
                  _LOOK_AT_MIRROR, 'a step at one elevation',
                  'something flops at an elevation: mirror, secondary, camera, focuser',
                  requires=('approach_el',) if play else (),
                  scan='flop' + '_with_play' * bool(play), share='scans',
                  searched=('at', 'play') if play else ('at',), scanned=2 if play else 1)


@form
def _track_bump(centre, width, count=1, mount=USUAL):
    """A dip of the first axis over a joint of its track, or over `count` equally spaced joints."""
    names = KINDS[mount]
    word = names.word('az')

    def of(c):
        away = wrap(count * (c.az - centre)) / count
        return [(0.0, np.exp(-0.5 * np.square(away / width)))]

    def wording(amount):
        where = f'{np.degrees(centre) % (360.0 / count):.0f}°'
        where += f' and each {360.0 / count:.0f}° from there' if count > 1 else ''
        # positive: the encoder reads too high, so the tube is too low
        moves = (f'{"dips" if amount.values[0] > 0.0 else "rises"} by {arcsec(amount.size)}'
                 if names.vertical else f'moves by {arcsec(amount.values[0], True)}')
        within = 'within' if width < 0.99 * _WIDTHS[-1] else 'over at least'
        return f'The mount {moves} at {word} {where}, {within} ±{width / DEG:.1f}°'

    joints = 'a joint or bump of the track' if names.vertical else 'a bad place of the bearing'
    return Effect('track_bump' + (f's_{count}' if count > 1 else ''),
                  f'{joints} of the {names.shaft("az")}'
                  + (f': {count} alike in a turn' if count > 1 else ''),
                  f'(0, exp(-({names.letter("az")} - {centre / DEG:.1f} deg)^2 / 2 width^2))',
                  names.key('az'), 'el', ('height',), of, wording,
                  'the rail there: joints, grout, bolts, dirt; wheels and pads'
                  if names.vertical else
                  f'rollers, balls or ring of the {names.shaft("az")} there, and dirt on it',
                  f'a bump at one {word}' if count == 1 else
                  f'bumps at equal distances of the {word}',
                  f'{joints} of the {names.shaft("az")}',
                  scan=f'track_bumps_{count}', share='scans', searched=('centre', 'width'),
                  scanned=2)


@form
def _flop_sideways(at, mount='equatorial'):
    """A step of the line of sight as gravity begins to pull from the other side of the tube."""
    names = KINDS[mount]
    word = names.word('az')

    def of(c):
        value = 1.0 * (np.sin(c.az) > np.sin(at))
        return [(value, 0.0), (0.0, value)]

    def wording(amount):
        return (f'{_flops_by(amount)} from one side to the other at {word} '
                f'{round(at / DEG)}°').replace('-', '−')

    return Effect('flop_sideways', 'mirror, camera or tube flops from one side to the other',
                  f'H(sin {names.letter("az")} > sin {at / DEG:.1f} deg)', names.key('az'), 'both',
                  ('across', 'along'), of, wording,
                  'mirror cell, secondary and focuser: what lies on one side or on the other',
                  f'a step at one {word}',
                  f'something flops at one {word}: mirror, secondary, camera, focuser',
                  scan='flop_sideways', share='steps', searched=('at',))


@form
def _reading_jump(at, cut=0.0, axis='az', mount=USUAL):
    """A step of the readings of an axis at one place; of the first axis, back at `cut`."""
    names = KINDS[mount]
    word, shaft = names.word(axis), names.shaft(axis)

    def of(c):
        if axis == 'el':
            return [(0.0, 1.0 * (c.el > at))]
        return [((np.mod(c.az - cut, _TURN) > np.mod(at - cut, _TURN)) * c.trig.cos_el, 0.0)]

    def wording(amount):
        return (f'The {word} readings jump by {arcsec(amount.values[0], True)} at {word} '
                f'{round(at / DEG)}°').replace('-', '−')

    return Effect(f'{names.key(axis)}_jump', f'readings of the {shaft} jump at one place: the '
                  'joint of an encoder tape, a tooth, or gears that change flanks',
                  f'H({names.letter(axis)} > {at / DEG:.1f} deg)', names.key(axis), axis,
                  ('step',), of, wording,
                  f'joint and ends of the encoder tape of the {shaft}, its coupling; the balance: '
                  'where it changes sides the gears change flanks',
                  f'a step at one {word}', f'readings of the {shaft} jump at one place',
                  scan=f'{axis}_jump', share='steps', searched=('at',))


def propose(context, lacking, own):
    """Places with enough rows on either side, or within."""
    yield Offer('flop', [effect('flop', at=at)
                         for at in _between(context.get('elevation'), _FLOPS)])
    names = context.mount.names
    # through the pole the tube turns over, and gravity pulls from the same side of it as before
    if not (names.vertical or names.two_sided or names.pole == 'given'):
        yield Offer('flop_sideways', [effect('flop_sideways', at=at, mount=context.mount.kind)
                                      for at in _between(np.arcsin(np.sin(context.az)), _FLOPS)])
    for cut in _cuts(context.az):
        yield Offer('reading_jump', [
            effect('reading_jump', at=wrap(cut + at), cut=cut, mount=context.mount.kind)
            for at in _between(np.mod(context.az - cut, _TURN), _JUMPS)])
    yield Offer('reading_jump', [
        effect('reading_jump', at=at, axis='el', mount=context.mount.kind)
        for at in _between(context.el, _JUMPS)])
    against = single_rows(context, 'approach_el', -1.0, 1.0)
    if context.mount.vertical and context.get('approach_el') is not None and not against:
        yield Offer('flop', [effect('flop', at=at, play=play)
                             for play in _PLAYS
                             for at in _between(context.get('elevation'), _FLOPS_WITH_PLAY)])
    yield Offer('track_bump', [
        effect('track_bump', centre=centre, width=width, count=count)
        for count in (1, *_JOINTS) for width in _WIDTHS[:4 if count == 1 else 2]
        for centre in _places(context.az, width, count)])


def _between(angle, most):
    """At most `most` angles between rows, with some rows on either side."""
    angle = np.sort(angle)
    between = 0.5 * (angle[1:] + angle[:-1])[_FEWEST_BEYOND - 1:len(angle) - _FEWEST_BEYOND]
    between = between[np.diff(angle)[_FEWEST_BEYOND - 1:len(angle) - _FEWEST_BEYOND] > 1e-4]
    return even_sample(between, most).tolist()


def _cuts(angle):
    """Where the first axis ends its turn: the middle of the largest gap, or north and south."""
    angle = np.sort(np.mod(angle, _TURN))
    gap = np.diff(angle, append=angle[:1] + _TURN)
    k = int(np.argmax(gap))
    return [float(angle[k] + 0.5 * gap[k])] if gap[k] > _GAP else [0.0, np.pi]


def _places(angle, width, count):
    """Places of a bump with enough rows within it."""
    period = _TURN / count
    if width * 2.0 * _SPACING > period:
        return []
    steps = int(np.ceil(period / (_SPACING * width)))
    at = (np.arange(steps) + 0.5) * period / steps
    away = np.abs(np.mod(angle - at[:, None] + 0.5 * period, period) - 0.5 * period)
    return at[(away < _WITHIN * width).sum(axis=1) >= _FEWEST_WITHIN].tolist()
