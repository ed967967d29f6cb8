"""Fields of a scenario: the unit that a value has in the file, and its allowed range."""

from dataclasses import field

from msg_tools.units import ARCSEC, DEG

_MM, _UM, _MS, _US, _HPA = 1e-3, 1e-6, 1e-3, 1e-6, 1.0
_HOUR = 3600.0
#: what a key of the file ends in -> its unit in SI
UNITS = {
    '': 1.0,
    'arcsec': ARCSEC,
    'arcmin': 60.0 * ARCSEC,
    'deg': DEG,
    'deg_s': DEG,
    'deg_s2': DEG,
    'arcsec_per_hour': ARCSEC / _HOUR,
    'arcsec_per_degc': ARCSEC,
    's': 1.0,
    'h': _HOUR,
    'ms': _MS,
    'us': _US,
    'm': 1.0,
    'mm': _MM,
    'um': _UM,
    'px': 1.0,
    'ke': 1e3,
    'c': 1.0,
    'c_per_hour': 1.0 / _HOUR,
    'hpa': _HPA,
    'mhz': 1e6,
    'hz': 1.0,
    'percent': 0.01,
    'percent_per_degc': 0.01,
    'percent_per_v': 0.01,
    'arcsec_per_v': ARCSEC,
    'v': 1.0,
    'v_per_hour': 1.0 / _HOUR,
}


def number(default, unit, low, high, *, kind=float):
    """A field with its unit in the file, and its allowed range in that unit.

    The default is in the unit of the file as well.
    """
    value = kind(default) if kind is int else default * UNITS[unit]
    return field(default=value, metadata={'unit': unit, 'range': (low, high), 'kind': kind})


def numbers(unit, low, high):
    """A field with a list of numbers, empty by default."""
    return field(default=(), metadata={'unit': unit, 'range': (low, high), 'kind': list})


def drawn(cls, name):
    """The field `name` of the drawing `cls`, with its default and range."""
    item = cls.__dataclass_fields__[name]
    return field(default=item.default, metadata=item.metadata)


def choice(default, *names):
    """A field with one of `names`."""
    return field(default=default, metadata={'choice': names})


def section(cls):
    """A field with an instance of `cls`, a section of its own in the file."""
    return field(default_factory=cls, metadata={'section': cls})


def sections(cls):
    """A field with a list of such sections, empty by default."""
    return field(default=(), metadata={'sections': cls})


def optional(cls):
    """A field with such a section, or None."""
    return field(default=None, metadata={'section': cls})
