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

"""Effects with fitted coefficients, as stored in a pointing model."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC

from .context import Context
from .effects import Effect, effect_from_document, to_document
from .mounts import ALTAZ


@dataclass(frozen=True)
class FittedEffect:
    """An effect and its fitted coefficients.

    Parameters
    ----------
    effect : Effect
    coefficients : ndarray, shape (k,)
        Radians per the effect's unit.
    sigma : ndarray, shape (k,), optional
        Standard errors; zero if omitted.

    Raises
    ------
    ValueError
        A wrong number of coefficients, or a value that is not finite.
    """

    effect: Effect
    coefficients: np.ndarray
    sigma: np.ndarray = None

    def __post_init__(self):
        k = len(self.effect.coefficient_names)
        for name in ('coefficients', 'sigma'):
            value = getattr(self, name)
            value = np.zeros(k) if value is None else np.asarray(value, float)
            if value.shape != (k,) or not np.isfinite(value).all():
                raise ValueError(f'effect {self.effect.name} needs {k} finite {name}')
            # rounded as the document's decimal numbers are read back
            object.__setattr__(self, name, value / ARCSEC * ARCSEC)

    def offsets(self, context):
        """Encoder - catalogue on the sky, x and y, shape (2, n), radians."""
        return np.tensordot(self.coefficients, self.effect.columns(context), axes=1)

    def variance(self, context):
        """Variance of `offsets`, with independent coefficients."""
        return np.tensordot(self.sigma**2, self.effect.columns(context) ** 2, axes=1)

    def unknown(self, context):
        """Mask of the rows in which a driver is unknown and the effect counts as zero."""
        out = np.zeros(len(context), bool)
        for name in self.effect.requires:
            value = context.get(name)
            out |= True if value is None else ~np.isfinite(value)
        return out

    def document(self):
        """Entry of the JSON document."""
        e = self.effect
        rows = zip(e.coefficient_names, self.coefficients / ARCSEC, self.sigma / ARCSEC)
        return {
            'name': e.name, **to_document(e), 'cause': e.cause, 'formula': e.formula,
            'driver': e.driver, 'unit': e.unit,
            'coefficients': [{'name': name, 'value_arcsec': float(v), 'sigma_arcsec': float(s)}
                             for name, v, s in rows],
        }

    @classmethod
    def from_document(cls, row):
        """Read `document`'s entry.

        Raises
        ------
        KeyError, ValueError, TypeError
            It is damaged.
        """
        values = row['coefficients']
        effect = effect_from_document(row)
        names = tuple(v['name'] for v in values)
        if names != effect.coefficient_names:
            raise ValueError(f'effect {effect.name} has coefficients '
                             f'{", ".join(effect.coefficient_names)}, not {", ".join(names)}')
        return cls(effect, np.array([v['value_arcsec'] for v in values], float) * ARCSEC,
                   np.array([v['sigma_arcsec'] for v in values], float) * ARCSEC)


def as_context(context, az, el, mount=ALTAZ):
    """A `Context` at (az, el), from a Context, a dict of drivers, a PointingRun or None.

    Parameters
    ----------
    context : Context, dict, PointingRun or None
    az, el : ndarray, shape (n,)
        Radians.
    mount : Mount, optional
        Mount of the angles, unless the context gives it.
    """
    if context is None or isinstance(context, dict):
        return Context(az, el, context, mount=mount)
    if not isinstance(context, Context):
        context = Context.from_run(context)
    return context.at(az, el)


def total(effects, context):
    """Sum of the effects, x and y of shape (n,), radians."""
    out = np.zeros((2, len(context)))
    for fitted in effects:
        out += fitted.offsets(context)
    return out
