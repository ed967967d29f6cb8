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

"""Design of an absolute encoder as known to readers: disc and optics, without flaws."""

import math
from dataclasses import dataclass, field, fields
from functools import lru_cache

from .disc import Disc

#: units of the data sheet, in SI
UNITS = {'': 1.0, 'mm': 1e-3, 'px': 1.0}


def _number(default, unit, low, high, doc, kind=float):
    return field(default=kind(default * UNITS[unit]), metadata={
        'unit': unit, 'range': (low, high), 'kind': kind, 'doc': doc})


def _choice(doc, default, *others):
    return field(default=default, metadata={'choice': (default, *others), 'doc': doc})


@dataclass(frozen=True)
class Design:
    """Design of an absolute encoder on one axis; by default that of paper 001.

    Parameters
    ----------
    code : {'table', 'equation2'} or str of 0 and 1
        The disc of the paper's table 1, that of its eq. 2, or your own bits, one per bar in
        the direction of increasing disc angle; 1 is a narrow bar.
    diameter : float
        Diameter of the circle of bars, m.
    bar_wide, bar_narrow : float
        Widths of a '0' and of a '1' on the circle, m.
    geometry : {'arc', 'tangent'}
        Row of pixels bent along the circle, or straight and tangent to it in its middle.
    pixels : int
        Number of pixels of the linear CCD.
    bar_pitch : float
        Pixels per bar period (in the middle of a straight row); the image may differ by 1 %.
    blur : float
        1-sigma of the optical blur, pixels.
    heads : int
        One reading head, or two opposite ones, whose mean is free of eccentricity.
    mounting : {'detect', 'forward', 'reversed'}
        Whether the pixels run along the disc or against it. Only the method 'template' can
        detect this; 'paper' treats 'detect' as 'forward'.
    sense : {'with', 'against'}
        Whether the disc angle increases or decreases with the angle of the axis.
    method : {'template', 'paper'}
        Method for reading an image: `template_reader`, or that of paper 001, with its faults
        and for its grey levels (`paper_reader`).

    Raises
    ------
    ValueError
        A value is out of its range or not allowed; 18 bars occur twice in a code; bars are wider
        than their period, or a '1' is wider than a '0'.
    """

    code: str = field(default='table', metadata={
        'doc': 'bars of the disc: table (paper 001, table 1), equation2, or your own bits'})
    diameter: float = _number(79.0, 'mm', 1.0, 10000.0, 'of the circle of bars')
    bar_wide: float = _number(0.149, 'mm', 0.001, 10.0, "of a '0', on the circle")
    bar_narrow: float = _number(0.075, 'mm', 0.001, 10.0, "of a '1', on the circle")
    geometry: str = _choice(
        'the row of pixels is bent along the circle, or flat and touches it', 'arc', 'tangent')
    pixels: int = _number(1800, '', 400, 16384, 'of the linear CCD', int)
    bar_pitch: float = _number(48.0, 'px', 16.0, 200.0, 'pixels a bar period, amid the row')
    blur: float = _number(6.0, 'px', 0.3, 30.0, '1-sigma of the optical blur')
    heads: int = _number(1, '', 1, 2, 'reading heads; 2: opposite ones', int)
    mounting: str = _choice(
        'whether the pixels run along the disc', 'detect', 'forward', 'reversed')
    sense: str = _choice('whether the disc angle rises with that of the axis', 'with', 'against')
    method: str = _choice('how an image becomes an angle', 'template', 'paper')

    def __post_init__(self):
        for item in fields(self):
            value, rules = getattr(self, item.name), item.metadata
            if 'choice' in rules and value not in rules['choice']:
                raise ValueError(
                    f'{item.name} {value!r} is not one of {", ".join(map(repr, rules["choice"]))}')
            if 'range' in rules:
                (low, high), unit = rules['range'], rules['unit']
                shown = f'{value / UNITS[unit]:g} {unit}'.strip()
                if not low * UNITS[unit] <= value <= high * UNITS[unit]:
                    raise ValueError(f'{item.name} {shown}: must be {low:g} to {high:g}')
                if rules['kind'] is int and value != int(value):
                    raise ValueError(f'{item.name} {shown}: must be a whole number')
        period = math.pi * self.diameter / self.disc.bars
        if not self.bar_narrow <= self.bar_wide < period:
            raise ValueError(
                f'bars of {1e3 * self.bar_wide:g} mm (0) and {1e3 * self.bar_narrow:g} mm (1) '
                f'every {1e3 * period:.4g} mm: a 0 must be the wider one, and narrower than that')

    @property
    def disc(self):
        """The disc, shared by all designs with its code."""
        return disc_of(self.code)


#: the disc of a code, see `Design`; ValueError if the code is invalid
disc_of = lru_cache(maxsize=8)(Disc)
