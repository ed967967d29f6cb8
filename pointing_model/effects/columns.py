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

"""Errors that depend on a column of the file: magnitude, side of the pier, user columns."""

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL

from .base import AXES, Effect, arcsec, effect, form, offer, on_axis, single_rows, the
from .drifts import about, progress
from .rotator import is_rotator

_CAUSES = {
    'magnitude': ('bright and faint stars are centred differently',
                  'threshold and saturation of the centring; refraction of blue and red stars'),
    'pier_side': ('another offset on the other side of the pier, or past the zenith',
                  'what shifts when the tube goes over: mirror cell, focuser, counterweight'),
}


@form
def _proportional(axis, driver, origin=0.0, scale=1.0, pattern='sky', within=None,
                  mount=USUAL):
    """Offset proportional to a driver (clipped to `within`), on the sky or in an axis angle."""
    names = KINDS[mount]
    sky = pattern == 'sky'

    def of(c):
        u = progress(c, driver, origin, scale, within)
        return [(u, 0.0) if axis == 'az' and sky else on_axis(axis, u, c.trig.cos_el)]

    def wording(amount):
        value = amount.values[0]
        if driver == 'magnitude':
            return (f'Faint stars are centred {arcsec(value, True)} a magnitude beside bright ones '
                    f'in {names.word(axis)}')
        if driver == 'pier_side':
            return (f'The {names.shaft(axis)} is off by another amount on the other side of the '
                    'pier')
        if amount.span is not None:
            value = value * (amount.span[1] - amount.span[0]) / scale
        return (f'The {names.word(axis)} error follows the column {driver} of the file: '
                f'{arcsec(value, True)} from its lowest to its highest value')

    cause, look_at = _CAUSES.get(driver, (f'follows the column {driver} of the file',
                                          'what this column measures'))
    name = 'magnitude_equation' if driver == 'magnitude' else driver
    return Effect(f'{name}_{axis}' + ('' if sky or axis == 'el' else '_angle'),
                  f'{cause} ({names.word(axis)})',
                  ('' if sky or axis == 'el' else f'cos {names.letter("el")} x ') + driver, driver,
                  axis, ('slope',), of, wording, look_at,
                  f'a part in proportion to {the(driver)}', '',
                  f'arcsec/({scale:.4g} {driver})' if scale != 1.0 else f'arcsec/{driver}',
                  requires=(driver,), effort=1 if driver == 'pier_side' else 0)


def propose(context, lacking, own):
    """If the column is known and varies; the side of the pier in more than single rows."""
    for driver in _CAUSES:
        if driver == 'pier_side' and not context.mount.vertical:
            continue  # see `pier`
        yield offer('proportional', driver, context, driver, lambda v, driver=driver: [
            effect('proportional', axis=axis, **about(driver, 1.0, v)) for axis in AXES
        ], _single_side(context) if driver == 'pier_side' else None)
    for driver in context.extra():
        if is_rotator(driver):
            continue  # an angle, see `rotator`
        yield offer('proportional', driver, context, driver, lambda v, driver=driver: [
            effect('proportional', axis=axis, pattern=pattern, **about(driver, float(np.std(v)), v))
            for axis, pattern in (('az', 'sky'), ('az', 'angle'), ('el', 'sky'))])


def _single_side(context):
    values, reason = context.span('pier_side')
    levels = () if reason else np.unique(values)
    # with three levels the middle one means unknown
    return single_rows(context, 'pier_side', levels[0], levels[-1]) if 2 <= len(levels) <= 3 \
        else None
