"""Candidate effects: what a mount may do beyond its declared terms, and how it would show.

A module a cause: each effect with its columns, its driver, its name in TPOINT, when it may be
tried, its sentence for people and what to look at on the mount. All modules of this package are
found by themselves; the order of effects that are not in `dictionary.ORDER` follows their names.

Sources: TPOINT (P. T. Wallace, names of terms), paper 000 (circular gratings, drift of the zero),
paper 001 (bars of a coded disc, decoding); first-order geometry otherwise.
"""

from importlib import import_module
from pkgutil import iter_modules

from .base import Amount, Effect, effect, of_document, to_document
from .curves import smooths
from .dictionary import dictionary
from .drifts import steps
from .graduation import PERIODS

for _module in sorted(iter_modules(__path__), key=lambda m: m.name):
    import_module(f'.{_module.name}', __name__)

__all__ = ['PERIODS', 'Amount', 'Effect', 'dictionary', 'effect', 'of_document', 'smooths', 'steps',
           'to_document']
