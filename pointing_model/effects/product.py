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

"""Columns of other programs' models: products of functions of the two angles.

They belong to models that were read from a file (`pointing_model.runs.model_files`). A diagnosis
does not search for them, so this module proposes none.
"""

import numpy as np

from .base import Effect, form

#: action of a column: on an axis angle, across the line of sight, or across by tilt of an axis
RESULTS = {
    'az': (lambda t, v: (v * t.cos_el, 0.0), 'on the azimuth angle', 'az'),
    'lr': (lambda t, v: (v, 0.0), 'across the line of sight', 'az'),
    'np': (lambda t, v: (v * t.sin_el, 0.0), 'across the line of sight, times sin E', 'az'),
    'el': (lambda t, v: (0.0, v), 'in elevation', 'el'),
}
FUNCTIONS = {
    'sin': lambda u, k: np.sin(k * u), 'cos': lambda u, k: np.cos(k * u),
    'tan': lambda u, k: np.tan(k * u), 'cot': lambda u, k: 1.0 / np.tan(k * u),
    'cot_power': lambda u, k: np.tan(u) ** -k, 'abssin': lambda u, k: np.abs(np.sin(k * u)),
    'abscos': lambda u, k: np.abs(np.cos(k * u)), 'power': lambda u, k: u ** k,
    'sinh': lambda u, k: np.sinh(k * u), 'cosh': lambda u, k: np.cosh(k * u),
    'tanh': lambda u, k: np.tanh(k * u),
}
_WRITTEN = {'cot_power': 'cot^{k} {u}', 'power': '{u}^{k}', 'abssin': '|sin {k}{u}|',
            'abscos': '|cos {k}{u}|'}


def value_of(factors, az, el):
    """Product of the factors (function, 'A' or 'E', number) for directions in radians."""
    out = np.ones_like(np.asarray(az, float))
    for function, angle, k in factors:
        out = out * FUNCTIONS[function](az if angle == 'A' else el, k)
    return out


def written(factors):
    """The factors as a formula, e.g. ``sin 3A cos 3E``."""
    return ' '.join(_WRITTEN.get(function, function + ' {k}{u}').format(
        k=f'{k:g}' if k != 1 or 'power' in function else '', u=angle)
        for function, angle, k in factors) or '1'


@form
def _product(result, factors, name=None):
    """One column: `factors` multiplied, acting on `result`.

    ``result``: one of `RESULTS`; ``factors``: rows (function, ``'A'`` or ``'E'``, number).
    """
    act, words, axes = RESULTS[result]
    factors = [(str(function), str(angle), k) for function, angle, k in factors]
    unknown = [f for f, a, _ in factors if f not in FUNCTIONS or a not in ('A', 'E')]
    if unknown:
        raise KeyError(unknown[0])
    formula = written(factors)
    return Effect(name or f'{result} {formula}', f'{formula} {words}, of a model that was read',
                  f'{formula} {words}',
                  'azimuth' if any(a == 'A' for _, a, _ in factors) else 'elevation', axes,
                  (name or formula,),
                  lambda c: [act(c.trig, value_of(factors, c.az, c.el))],
                  look_at='the manual of the program that the model comes from', effort=0,
                  tpoint=name)
