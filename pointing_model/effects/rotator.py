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

"""Errors that turn with a field rotator: a camera whose reference point is off its axis."""

import re

import numpy as np

from msg_tools.units import DEG

from .base import Effect, arcsec, effect, form, offer

_ROTATOR = re.compile(r'^(de)?rot(?!ation_rate)')
#: larger angles are in degrees, whatever the column is called
_MOST_RADIANS = 2.0 * np.pi + 1e-3
#: least scatter of cosine or sine: with less rotation the offset is degenerate with CA and IE
_TURNS = 0.1


def is_rotator(name):
    """Whether the name of a column is that of a rotator's angle."""
    return bool(_ROTATOR.match(name.lower())) and 'temp' not in name.lower()


@form
def _rotator_offset(driver, sense, unit=DEG):
    """Offset (a, b) of a point of the camera that rotates with the angle, in either sense."""
    def of(c):
        angle = sense * unit * c.get(driver)
        return [(np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))]

    return Effect(f'rotator_offset_{"left" if sense > 0 else "right"}',
                  'the camera sits beside the axis of the rotator',
                  f'(cos r, {"" if sense > 0 else "-"}sin r), '
                  f'({"-" if sense > 0 else ""}sin r, cos r)', driver, 'both', ('cos', 'sin'), of,
                  lambda amount: 'The camera turns with the rotator about a point that is '
                  f'{arcsec(amount.size)} off the place where stars are centred',
                  'the pixel taken as the centre of the rotator: turn it by 180° on one star, the '
                  'centre is halfway; then the flange of the rotator',
                  'a circle of the angle of the rotator', 'camera beside the axis of the rotator',
                  requires=(driver,), mechanism='rotator offset', effort=0)


def propose(context, lacking, own):
    """If a column is the angle of a rotator that turns."""
    for name in filter(is_rotator, context.own_columns()):
        def build(values, name=name):
            unit = 1.0 if name.lower().endswith('rad') or (
                np.abs(values).max() <= _MOST_RADIANS and not name.lower().endswith('deg')) else DEG
            return [effect('rotator_offset', driver=name, sense=sense, unit=unit)
                    for sense in (1, -1)]

        values, _ = context.span(name)
        still = values is not None and max(
            np.std(f(build(values)[0].parameters['unit'] * values)) for f in (np.cos, np.sin)
        ) < _TURNS
        yield offer('rotator_offset', 'offset of the rotator', context, name, build,
                    'the rotator hardly turns' if still else None)
