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

"""Encoders and bearings: errors that repeat a whole number of times per turn of an axis."""

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL

from .base import Effect, Offer, arcsec, effect, form, on_axis, times


def _tpoint(names, text):
    """Replace 1, 2, v and s in names of generic terms by the letters in `MountKind.tpoint`."""
    if not names.tpoint:
        return None
    return text.translate(str.maketrans('12vs', ''.join(names.tpoint)))


#: for axes without an encoder, see `MountKind.geared`
_GEARS = {
    1: ('encoder disc or worm wheel off its centre', 'its worm wheel or encoder disc off centre',
        'disc or worm wheel off its centre',
        'how true the worm wheel runs, or the disc of an encoder on the axis'),
    2: ('encoder disc or worm wheel oval or tilted', 'its worm wheel or encoder disc oval or '
        'tilted', 'disc or worm wheel oval or tilted',
        'the tilt and the roundness of the worm wheel, or of the disc of an encoder on the axis'),
    **dict.fromkeys(range(3, 7), (
        'encoder, gear or coupling uneven', 'its gear, encoder or coupling uneven',
        ', gear or coupling uneven',
        'worm and wheel for dirt and wear, the coupling between axis and encoder'))}
#: twice per turn of a polar axis on a large ring, which its own weight deforms to an oval
_RING = ('encoder disc, worm wheel or horseshoe ring oval or tilted',
         'its worm wheel, encoder disc or horseshoe ring oval or tilted',
         'disc, worm wheel or horseshoe ring oval or tilted',
         'tilt and roundness of the worm wheel, the horseshoe ring (oval under its weight) or the '
         'encoder disc')


@form
def _encoder(axis, order, mount=USUAL):
    """Harmonic of an encoder, `order` periods per turn."""
    k, names = int(order), KINDS[mount]
    az = axis == 'az'
    letter = names.letter(axis)

    def of(c):
        angle = k * (c.az if az else c.el)
        return [on_axis(axis, f(angle), c.trig.cos_el) for f in (np.cos, np.sin)]

    ring = names.ring and (axis, k) == ('az', 2)
    cause, short, summary, look_at = _RING if ring else (
        _GEARS if names.geared else {}).get(k) or {
        1: ('encoder disc off its centre', 'the disc of its encoder off centre',
            'disc off its centre',
            'the centring of the disc; the mean of two heads opposite each other'),
        2: ('encoder disc oval or tilted, or two heads uneven',
            'the disc of its encoder oval or tilted', 'disc oval or tilted',
            'the tilt of the disc on its hub; the distance of both heads'),
    }.get(k, ('encoder or its coupling uneven', 'its encoder or the coupling uneven',
              'or its coupling uneven',
              'the coupling between axis and encoder, and the disc for dirt'))

    # source: geometry of an eccentric or tilted disc; not in either paper
    number = '1' if az else '2'
    return Effect(f'{names.key(axis)}_encoder_{k}', f'{names.word(axis)} {cause}: {k} a turn',
                  f'cos {k}{letter}, sin {k}{letter} on the '
                  f'{names.word(axis).removesuffix(" angle")} angle'
                  + (f' (on the sky x cos {names.letter("el")})' if az else ''),
                  names.key(axis), axis, ('cos', 'sin'), of,
                  # only the wave is observed: flexure or run-out of the same order looks the same
                  lambda _: f'The {names.word(axis)} is read wrong {times(order)}; one cause: '
                  f'{short}',
                  look_at,
                  f'a wave of the {names.word(axis)}, {times(order)}',
                  f'{names.word(axis)} encoder {summary} ({times(order)})'.replace(' ,', ','),
                  effort=2, tpoint=_tpoint(names, f'{number}CEC {number}CES') if k == 1 else
                  _tpoint_order(names, f'H{number}C{number}# H{number}S{number}#', k),
                  only_shape=True)


def _tpoint_order(names, text, k):
    """`_tpoint` for generic terms with an order, which is not written if it is 1."""
    found = _tpoint(names, text)
    return found and found.replace('#', '' if k == 1 else str(k))


@form
def _bearing_wobble(order, mount=USUAL):
    k, names = int(order), KINDS[mount]
    a, e = names.letters

    def of(c):
        ca, sa, se = np.cos(k * c.az), np.sin(k * c.az), c.trig.sin_el
        return [(0.0, ca), (0.0, sa), (se * ca, 0.0), (se * sa, 0.0)]

    shaft = names.shaft('az')
    return Effect(f'{names.key("az")}_bearing_wobble_{k}',
                  f'{shaft} wobbles {k} a turn: bearing or track not flat',
                  f'(0, cos {k}{a}), (0, sin {k}{a}), (sin {e} cos {k}{a}, 0), '
                  f'(sin {e} sin {k}{a}, 0)',
                  names.key('az'), 'both', ('el_cos', 'el_sin', 'az_cos', 'az_sin'), of,
                  lambda _: f'The {shaft} wobbles {times(order)}: a bearing or track that is not '
                  'flat',
                  'flatness of the azimuth bearing or track, with a level on the fork'
                  if names.vertical else f'both bearings of the {shaft}',
                  f'a wave of the {names.word("az")}, {times(order)}, in both axes',
                  f'bearing or track of the {shaft} not flat ({times(order)})',
                  tpoint=_tpoint_order(names, 'H2C1# H2S1# HvC1# HvS1#', k),
                  effort=1 if names.vertical else 2)


@form
def _nod(order, mount=USUAL):
    k, names = int(order), KINDS[mount]
    a = names.letter('az')
    return Effect(f'{names.key("el")}_nod_{k}', f'mount wobble, {k} per turn of {names.word("az")}',
                  f'(0, cos {k}{a}), (0, sin {k}{a})', names.key('az'), 'el', ('cos', 'sin'),
                  lambda c: [(0.0, np.cos(k * c.az)), (0.0, np.sin(k * c.az))],
                  lambda _: f'The mount wobbles in {names.word("el")}, {times(order)} of the '
                  f'{names.shaft("az")}',
                  'wheels or pads under the azimuth axis, and the base under the fork'
                  if names.vertical else f'bearings of the {names.shaft("az")}, and what it '
                  f'carries: {names.carriers}'
                  f'{" and counterweight" * names.two_sided}',
                  f'a wave of the {names.word("az")}, {times(order)}',
                  f'mount wobble{" on its wheels, pads or base" * names.vertical} '
                  f'({times(order)} of {names.word("az")})',
                  tpoint=_tpoint_order(names, 'H2C1# H2S1#', k))


@form
def _line_of_sight(order, mount=USUAL):
    """Collimation that varies with azimuth: TPOINT's harmonics of the left-right error."""
    k, names = int(order), KINDS[mount]
    a, word, shaft = names.letter('az'), names.word('az'), names.shaft('az')
    return Effect(f'line_of_sight_{k}', f'the line of sight swings left and right {k} a turn of '
                  f'{word}', f'(cos {k}{a}, 0), (sin {k}{a}, 0)', names.key('az'), 'az',
                  ('cos', 'sin'),
                  lambda c: [(np.cos(k * c.az), 0.0), (np.sin(k * c.az), 0.0)],
                  lambda _: f'The line of sight swings left and right, {times(order)} of the '
                  f'{shaft}, at any {names.word("el")}',
                  f'what turns with the {word} and holds the beam: a Nasmyth mirror or the cabin, '
                  'the fork that twists on an uneven track, cables' if names.vertical else
                  f'flexure of what turns with the {shaft}: '
                  f'{names.carriers}, cables',
                  f'a wave of the {word}, {times(order)}, the same at any {names.word("el")}',
                  f'line of sight swings ({times(order)} of the {shaft})',
                  tpoint=_tpoint_order(names, 'HsC1# HsS1#', k))


@form
def _elevation_axis_wobble(order, mount=USUAL):
    k, names = int(order), KINDS[mount]
    e, shaft = names.letter('el'), names.shaft('el')
    return Effect(f'{shaft.replace(" ", "_")}_wobble_{k}', f'{shaft} wobbles {k} a turn',
                  f'(sin {e} cos {k}{e}, 0), (sin {e} sin {k}{e}, 0)', names.key('el'), 'az',
                  ('cos', 'sin'),
                  lambda c: [(c.trig.sin_el * np.cos(k * c.el), 0.0),
                             (c.trig.sin_el * np.sin(k * c.el), 0.0)],
                  look_at=f'run-out of both {names.word("el")} bearings',
                  shape=f'a wave of the {names.word("el")}, {times(order)}, larger high up',
                  summary=f'{shaft} wobbles ({times(order)})')


@form
def _turning_disc(axis, turns, span, start=0.0, mount=USUAL):
    """An eccentric disc whose direction of eccentricity rotates `turns` times in `span` s."""
    names = KINDS[mount]
    rate = 2.0 * np.pi * turns / span
    hours = span / 3600.0 / max(abs(turns), 1e-9)

    def of(c):
        angle = (c.az if axis == 'az' else c.el) + rate * (c.get('time') - start)
        return [on_axis(axis, f(angle), c.trig.cos_el) for f in (np.cos, np.sin)]

    word = names.word(axis)
    return Effect(f'turning_disc_{names.key(axis)}',
                  f'the centre of the {word} disc goes round while the night goes on',
                  f'cos, sin of ({names.letter(axis)} {"+" if turns > 0.0 else "-"} 360 deg t / '
                  f'{hours:.2f} h)', 'time', axis, ('cos', 'sin'), of,
                  lambda amount: f'The {word} disc is off its centre by {arcsec(amount.size)} of '
                  f'angle, toward a side that goes round in {hours:.1f} h: nothing has jumped',
                  'what turns between the axis and its disc: a bearing whose inner ring creeps, a '
                  'loose hub, a coupling that slips',
                  f'a wave of the {word}, once per turn, whose phase goes on with time',
                  f'{word} disc off its centre toward a side that turns', requires=('time',),
                  scan='turning', share='scans', searched=('turns',), effort=2)


#: least duration of a run, h; turns of the eccentricity during the run that are tried
_HOURS, _TURNS = 2.0, np.arange(1, 13) / 4.0


def _turning(context):
    time, reason = context.span('time')
    span = 0.0 if reason else float(np.ptp(time))
    against = reason or (None if span >= 3600.0 * _HOURS else (
        f'the run lasts {span / 3600.0:.1f} h; it takes {_HOURS:g}'))
    if context.several_nights():
        against = against or 'of several nights'
    return Offer('turning_disc', [] if against else [
        effect('turning_disc', axis=axis, turns=float(sense * turns), span=span,
               start=float(time.min()))
        for axis in ('az', 'el') for sense in (-1.0, 1.0) for turns in _TURNS],
        'a disc whose centre goes round', against)


def propose(context, lacking, own):
    """Orders that parts of a mount cause; they depend on directions only, so always testable."""
    for axis, highest in (('el', 3), ('az', 6)):
        yield Offer('encoder', [effect('encoder', axis=axis, order=order)
                                for order in range(1, highest + 1)])
    # a wobble of the elevation axis has constant parts: over less than a quarter turn of sky they
    # would be mistaken for CA and NPAE
    alike = [name for name in map(context.mount.names.named, ('CA', 'NPAE')) if name in lacking]
    against = {'elevation_axis_wobble': 'it looks like terms that the model lacks: '
               + ', '.join(alike)} if alike else {}
    # order 1 of (cos A, 0) is nearly degenerate with an eccentric disc plus a wobble of the azimuth
    # axis (alt-azimuth mounts only; elsewhere gravity rotates relative to the axis)
    for name, lowest, highest in (('bearing_wobble', 1, 3), ('nod', 1, 6),
                                  ('line_of_sight', 2 if context.mount.vertical else 1, 4),
                                  ('elevation_axis_wobble', 1, 2)):
        yield Offer(name, [] if name in against else [
            effect(name, order=order) for order in range(lowest, highest + 1)],
            f'{context.mount.names.shaft("el")} wobble' if name in against
            else name.replace('_', ' '), against.get(name))
    yield _turning(context)
