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

"""Fields of a scenario: unit of the value in the file, and its allowed range."""

from dataclasses import field, make_dataclass

from msg_tools.units import ARCSEC, DEG

_UNITS = {
    '': 1.0, 'percent': 0.01, 'px': 1.0, 'ke': 1e3,
    'deg': DEG, 'arcmin': 60.0 * ARCSEC, 'arcsec': ARCSEC, 'deg_s': DEG, 'deg_s2': DEG,
    's': 1.0, 'ms': 1e-3, 'us': 1e-6, 'min': 60.0, 'h': 3600.0, 'hour': 3600.0,
    'hz': 1.0, 'mhz': 1e6,
    'm': 1.0, 'mm': 1e-3, 'um': 1e-6, 'm_s': 1.0, 'per_s': 1.0,
    'c': 1.0, 'degc': 1.0, 'hpa': 1.0, 'v': 1.0,
}


def in_si(unit):
    """SI value of the unit at the end of a key, such as ``um`` or ``arcsec_per_hour``."""
    unit, _, divisor = unit.partition('_per_')
    return _UNITS[unit] / _UNITS[divisor]


def number(default, unit, low, high, *, kind=float):
    """A field with its unit in the file, and its allowed range in that unit.

    The default is also in the unit of the file.
    """
    return field(default=kind(default * in_si(unit)),
                 metadata={'unit': unit, 'range': (low, high), 'kind': kind})


def term(canonical, unit, low, high):
    """A field for a geometry term, 0 by default, with its name for alt-azimuth mounts.

    The file uses the name and sign of the scenario's mount.
    """
    return _marked(number(0.0, unit, low, high), term=canonical)


def pier_only(item):
    """A field that exists only for equatorial mounts."""
    return _marked(item, pier_only=True)


def _marked(item, **marks):
    return field(default=item.default, metadata={**item.metadata, **marks})


def numbers(unit, low, high):
    """A field for a list of numbers, empty by default."""
    return field(default=(), metadata={'unit': unit, 'range': (low, high), 'kind': list})


def drawn(cls, name):
    """The field `name` of the design class `cls`, with its default and range."""
    item = cls.__dataclass_fields__[name]
    return field(default=item.default, metadata=item.metadata)


def text(default, parse):
    """A field for a text; `parse` raises ValueError for an invalid one."""
    return field(default=default, metadata={'text': parse})


def choice(default, *names):
    """A field for one of `names`."""
    return field(default=default, metadata={'choice': names})


def section(cls):
    """A field for an instance of `cls`, which is a section of the file."""
    return field(default_factory=cls, metadata={'section': cls})


def both_axes(cls):
    """A section with an instance of `cls` for each axis.

    In memory they are `azimuth` and `elevation`; the file uses the axis names of the mount.
    """
    axes = [(axis, cls, section(cls)) for axis in ('azimuth', 'elevation')]
    return section(make_dataclass(f'{cls.__name__}Pair', axes, frozen=True))


def sections(cls):
    """A field for a list of sections, empty by default."""
    return field(default=(), metadata={'sections': cls})


def optional(cls):
    """A field for a section, or None."""
    return field(default=None, metadata={'section': cls})
