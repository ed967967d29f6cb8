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

"""Side of the pier: effects of different size on the two sides of a direction.

Only for mounts that go through the pole. Errors of an axis have one formula on both sides; their
signs on the sky follow from the geometry. Here are errors that turn over with the tube, or depend
on the side where the counterweight hangs.
"""

import numpy as np

from msg_tools.units import DEG
from pointing_model.mount_kinds import KINDS

from .base import (
    DIRECTION,
    FEWEST_ON_A_SIDE,
    Effect,
    Offer,
    arcsec,
    effect,
    effect_from_document,
    form,
    readable,
    single_rows,
    to_document,
)

_DEGREES = (1, 2)
#: clock and site are the same on both sides; a difference there is a zero or a tilt of the axes
_SAME_ON_BOTH = ('clock', 'latitude')


@form
def _by_side(of):
    """An effect (its document), with the opposite sign through the pole."""
    whole = effect_from_document(of)
    tpoint = whole.tpoint

    def columns(c):
        return whole.columns(c) * c.get('pier_side')

    def wording(_):
        text = f'{readable(whole.name)}, another amount on each side of the pier'
        return text[:1].upper() + text[1:]

    return Effect(f'{whole.name}_by_side', f'{whole.cause}; it differs by the side of the pier',
                  f'({whole.formula}) x side', whole.driver, whole.axes, whole.coefficient_names,
                  columns, wording,
                  f'{whole.look_at}; and what shifts when the tube goes over: mirror cell, '
                  'focuser, counterweight',
                  f'{whole.shape}, another on each side of the pier' if whole.shape else '',
                  f'{whole.cause_summary}; another amount on each side of the pier',
                  whole.unit, tpoint=tpoint and ' '.join(f'{name} by side'
                                                         for name in tpoint.split()),
                  requires=(*whole.requires, 'pier_side'), effort=whole.effort)


def by_side(effects, context):
    """Effects of the direction, and the geometric terms, in a version that differs by side.

    Parameters
    ----------
    effects : list of Effect
        Effects of the dictionary of this mount.
    context : Context

    Returns
    -------
    effects : list of Effect
    reason : (str, str) or None
        What cannot be tested, and why.
    """
    mount = context.mount
    index, sight, skew = mount.names.physical[1:4]
    against = context.span('pier_side')[1]
    if against:
        return [], ('what differs by the side of the pier',
                    f'all rows are on one side of the pier: what is constant there is {index}, '
                    f'{sight} and {skew}; their sign changes on the other')
    against = single_rows(context, 'pier_side', -1.0, 1.0)
    if against:
        return [], ('what differs by the side of the pier', against)
    terms = [effect('term', name=name, mount=mount.kind) for name in mount.names.physical]
    known = {e.name for e in terms}
    others = [e for e in effects if direct(e) and e.size is None and e.name not in known
              and e.form not in _SAME_ON_BOTH]
    return [effect('by_side', of=to_document(e)) for e in terms + others], None


@form
def _by_counterweight(of, play):
    """Tilt of the first axis (a term, as a document) with the pull of the counterweight.

    Bearings with play let the axis lie on one side or the other (``play``); otherwise it flexes.
    Near the meridian this looks like the side of the pier; below the pole the pull is reversed.
    """
    whole = effect_from_document(of)
    how = 'by' if play else 'with'

    def columns(c):
        pull = c.get('counterweight')
        return whole.columns(c) * (np.sign(pull) if play else pull)

    def wording(_):
        moves = 'has play, and lies over' if play else 'bends'
        return f'The first axis {moves} to where the counterweight hangs'

    return Effect(f'{whole.name}_{how}_counterweight',
                  f'{whole.cause}; it changes with the pull of the counterweight'
                  + (', from one end of a play to the other' if play else ''),
                  f'({whole.formula}) x {"sign cos" if play else "cos"}(first angle)',
                  'counterweight', whole.axes, whole.coefficient_names, columns, wording,
                  'the bearings and the housing of the first axis, the balance about the second',
                  'a tilt of the first axis as the counterweight pulls', '',
                  whole.unit, requires=('counterweight',))


def direct(effect):
    """Whether an effect depends only on the direction and the side of the pier."""
    return effect.kind == 'effect' and effect.driver in DIRECTION and effect.scan is None


@form
def _sideways_sag(each=False, mount='equatorial'):
    """Sag of parts on the tube that is larger sideways than up and down.

    TF is the same sag for any rotation of the tube about its length. ``each``: a separate amount
    for each side of the pier, which TF has as `by_side`.
    """
    def of(c):
        x, _ = c.trig.lifted(c.trig.zenith.cos_el)
        if not each:
            return [(x, 0.0)]
        side = c.get('pier_side')
        return [(x * (side == one), 0.0) for one in (1.0, -1.0)]

    def wording(amount):
        if not each:
            less = amount.values[0] < 0.0
            return (f'Focuser or mirror sags {arcsec(abs(amount.values[0]))} '
                    f'{"less" if less else "more"} when gravity pulls from the side of the tube '
                    'than from below it')
        one, other = (arcsec(value, True) for value in amount.values)
        return (f'Focuser or mirror sags when gravity pulls from the side of the tube, {one} on '
                f'one side of the pier and {other} through the pole')

    what = 'focuser or mirror sags more sideways than up and down (or less)'
    return Effect('focuser_sag_sideways' + '_on_each_side' * each,
                  what + ', another amount on each side of the pier' * each,
                  'the part of TF across the tube, sideways' + ', of either side' * each,
                  'pier_side' if each else 'hour_angle', 'az',
                  ('before', 'through_the_pole') if each else ('sag',), of, wording,
                  'the focuser, its draw tube and lock, the mirror cell, the dovetail: what yields '
                  'to one side', 'a shift to one side that turns over with the tube',
                  'focuser or mirror that sags sideways'
                  + ', unlike on either side of the pier' * each,
                  requires=('pier_side',) if each else ())


@form
def _polynomial(result, of, power, mount='equatorial'):
    """TPOINT's polynomials: named P, the result (H, D, or X: left-right on the sky), the angle."""
    names = KINDS[mount]
    k = int(power)
    word, angle = ('az' if result != 'el' else 'el'), of
    letter = names.tpoint and {'az': names.tpoint[0], 'el': names.tpoint[1],
                               'sky': names.tpoint[3]}[result]
    name = f'P{letter}{names.tpoint[of == "el"]}{k if k > 1 else ""}' if letter else None

    def columns(c):
        u = (c.az if angle == 'az' else c.el) ** k
        return [(u * c.trig.cos_el, 0.0) if result == 'az' else (u, 0.0) if result == 'sky'
                else (0.0, u)]

    where = f'{names.word(word)}{" on the sky" if result == "sky" else ""}'

    def wording(amount):
        slope = float(amount.values[0])
        moves = 'falls' if slope < 0.0 else 'grows'
        if k == 2:
            return (f'The {where} error {moves} with the square of the {names.word(of)}, by '
                    f'{arcsec(abs(slope))} per square radian')
        return (f'The {where} error {moves} with the {names.word(of)}, by {arcsec(abs(slope))} per '
                f'radian, {arcsec(abs(slope) * DEG)} a degree')

    return Effect(f'{names.key(word)}{"_on_sky" if result == "sky" else ""}_grows_with_'
                  f'{names.key(of)}' + ('_squared' if k == 2 else ''),
                  f'{where} error proportional to the {"square of the " if k == 2 else ""}'
                  f'{names.word(of)}',
                  f'{names.letter(of)}{"^2" if k == 2 else ""} in {where}', names.key(of),
                  word, ('slope',), columns,
                  wording,
                  f'the steps or lines in a turn of the {names.shaft(word)} that are set, and '
                  f'flexure as the {names.shaft(of)} turns',
                  f'a {"parabola" if k == 2 else "straight line"} of the {names.word(of)}', '',
                  'arcsec/rad' + ('^2' if k == 2 else ''),
                  tpoint=name)


def propose(context, lacking, own):
    """Polynomials and effects of a counterweight, for mounts other than alt-azimuth ones."""
    mount = context.mount
    if mount.vertical:
        return
    both = not (context.span('pier_side')[1] or single_rows(context, 'pier_side', -1.0, 1.0))
    yield Offer('sideways_sag', [effect('sideways_sag', each=each, mount=mount.kind)
                                 for each in (False, True)[:1 + both]])
    pull = context.get('counterweight')
    if pull is not None:
        few = min(np.sum(pull > 0.0), np.sum(pull < 0.0)) < FEWEST_ON_A_SIDE
        yield Offer('by_counterweight', [] if few else [
            effect('by_counterweight', of=to_document(effect('term', name=name, mount=mount.kind)),
                   play=play) for name in ('MA', 'ME') for play in (True, False)],
            'what changes with the counterweight',
            'it hangs on one side in nearly all rows' if few else None)
    yield Offer('polynomial', [
        effect('polynomial', result=result, of=of, power=power, mount=context.mount.kind)
        for result in ('az', 'sky', 'el') for of in ('az', 'el') for power in _DEGREES])
