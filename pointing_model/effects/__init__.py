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

"""Candidate effects: errors of a mount beyond its declared terms, and their signatures.

One module per cause. It has the columns of each effect, its driver, its name in TPOINT, when it
may be tested, a sentence for people and what to check on the mount. All modules of this package
are imported automatically; effects that are not in `ORDER` come last, by module name.

Sources: TPOINT (P. T. Wallace, names of terms), paper 000 (circular gratings, drift of the zero),
paper 001 (bars of a coded disc, decoding), the Explanatory Supplement (aberration, equinox),
Hipparcos-2 (proper motion); first-order geometry otherwise.
"""

from importlib import import_module
from pkgutil import iter_modules

from .base import Amount, Effect, effect, effect_from_document, for_mount, to_document
from .curves import smooths
from .drifts import steps
from .gears_and_worms import declared_worms
from .graduation import PERIODS, declared_graduation, period_of
from .modulation import changes
from .pier import by_side, direct

__all__ = ['PERIODS', 'Amount', 'Effect', 'changes', 'declared_graduation', 'declared_worms',
           'dictionary', 'direct', 'effect',
           'effect_from_document', 'period_of', 'smooths', 'steps', 'to_document']

_MODULES = [import_module(f'.{name}', __name__)
            for name in sorted(module.name for module in iter_modules(__path__))]

#: Order of the dictionary, by form (and axis, if offered per axis); others follow. The first of
#: equal scores wins, so the order affects results.
ORDER = ('term', 'terms', 'encoder', 'bearing_wobble', 'nod', 'line_of_sight',
         'elevation_axis_wobble', 'fork_cross_term', 'diurnal_aberration', 'bent_to_one_side',
         'latitude', 'clock', 'annual_aberration', 'epoch_error', 'drift', 'hysteresis az',
         'subdivision az', 'hysteresis el', 'subdivision el', 'proper_motion', 'latency', 'camera',
         'proportional', 'run_zero')


def dictionary(context, lacking=(), own=()):
    """All effects that this project knows, with parameters from the run (origins, scales).

    Parameters
    ----------
    context : Context
        Context of the run.
    lacking : sequence of str, optional
        Terms of the mount that the declared model lacks: these are candidates, too.
    own : sequence of str, optional
        Terms fitted separately for each run.

    Returns
    -------
    effects : list of Effect
        Effects that can be tested.
    untestable : list of (str, str)
        Effect (or its driver), and the reason why it cannot be tested in this run.
    """
    offers = [o for module in _MODULES if hasattr(module, 'propose')
              for o in module.propose(context, tuple(lacking), tuple(own))]
    offers.sort(key=_place)
    untestable = [(o.what, o.reason) for o in offers if o.reason]
    effects = for_mount([e for o in offers for e in o.effects], context.mount)
    if context.mount.vertical:
        return effects, untestable
    sided, reason = by_side(effects, context)
    return effects + sided, untestable + ([reason] if reason else [])


def _place(offer):
    key = f'{offer.form} {offer.axis}'.strip()
    return ORDER.index(key) if key in ORDER else len(ORDER)
