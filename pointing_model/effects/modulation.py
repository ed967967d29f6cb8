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

"""Effects that grow or fade: another effect, multiplied by a driver.

They are not in the dictionary: the changes of an effect are tested after it was found.
"""

from .base import Effect, effect, effect_from_document, form, readable, to_document
from .drifts import SYMBOLS, UNITS, about, clock, progress

#: effects of these drivers are changes already
_CLOCKS = ('time', 'order', 'run_hours', 'temperature', 'run')
_WITH = {'run_hours': 'the time since the start of each run', 'order': 'the order of the rows'}


@form
def _changing(of, driver, origin=0.0, scale=1.0, within=None):
    """An effect (its document) x (driver - origin) / scale; the driver is clipped to `within`."""
    whole = effect_from_document(of)
    with_ = _WITH.get(driver, driver)

    def columns(c):
        return whole.columns(c) * progress(c, driver, origin, scale, within)

    def wording(_):
        text = f'{readable(whole.name)}, not the same all the time: it changes with {with_}'
        return text[:1].upper() + text[1:]

    return Effect(f'{whole.name}_changing_with_{driver}', f'{whole.cause}; it changes with {with_}',
                  f'({whole.formula}) x {SYMBOLS.get(driver, driver)}', driver, whole.axes,
                  whole.coefficient_names, columns, wording,
                  f'{whole.look_at}; and what of it warms up, loosens or settles',
                  f'{whole.shape}, which changes with {with_}' if whole.shape else '',
                  f'{whole.cause_summary}; it changes with {with_}',
                  f'{whole.unit}{UNITS.get(driver, "")}', requires=(*whole.requires, driver),
                  effort=whole.effort)


def changes(whole, context):
    """Possible changes of an effect during a run: with the clock, with the temperature.

    Parameters
    ----------
    whole : Effect
    context : Context
        Context of the run.

    Returns
    -------
    list of Effect
        Empty for effects that are changes themselves.
    """
    if whole.driver in _CLOCKS or whole.kind != 'effect':
        return []
    drivers = [clock(context), ('temperature', 1.0)]
    if context.several_nights():  # time within each night
        drivers[0] = 'run_hours', 1.0
    known = [(driver, scale, context.span(driver)[0]) for driver, scale in drivers]
    return [effect('changing', of=to_document(whole), **about(driver, scale, values))
            for driver, scale, values in known if values is not None]
