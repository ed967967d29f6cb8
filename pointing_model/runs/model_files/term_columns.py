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

"""Columns: a notation for terms that is the same for all programs, to compare them.

A column is a tuple ``(result, factors)``: the direction it acts on (`effects.product.RESULTS`) and
the factors of a product of functions, each (function, ``'A'`` or ``'E'``, number), A from north
through east. ``('AN', ())`` and ``('AW', ())`` are the two tilts, which act on both axes. For
mounts other than alt-azimuth ones a column is one of their terms, such as ``('MA', ())``. Values
are encoder - catalogue.
"""

from functools import lru_cache

import numpy as np

from pointing_model.context import Context
from pointing_model.effects.product import RESULTS, value_of
from pointing_model.mounts import ALTAZ, through_pole
from pointing_model.pointing_terms import TERMS, Trig, terms_of


def column(result, *factors):
    """The column of these factors, in any order."""
    return result, tuple(sorted(factors, key=lambda f: (f[1], f[0], f[2])))


def _terms():
    sin, cos = (lambda a, k=1: ('sin', a, k)), (lambda a, k=1: ('cos', a, k))
    return {
        'IA': column('az'), 'IE': column('el'), 'CA': column('lr'), 'NPAE': column('np'),
        'AN': ('AN', ()), 'AW': ('AW', ()), 'TF': column('el', cos('E')),
        'TX': column('el', ('cot', 'E', 1)), 'TX3': column('el', ('cot_power', 'E', 3)),
        'ECES': column('el', sin('E')), 'HECE2': column('el', cos('E', 2)),
        'HESE2': column('el', sin('E', 2)), 'ACEC': column('az', cos('A')),
        'ACES': column('az', sin('A')), 'HACA2': column('az', cos('A', 2)),
        'HASA2': column('az', sin('A', 2)), 'HECA': column('el', cos('A')),
        'HESA': column('el', sin('A')), 'HECA2': column('el', cos('A', 2)),
        'HESA2': column('el', sin('A', 2)), 'HVCA2': column('np', cos('A', 2)),
        'HVSA2': column('np', sin('A', 2)),
    }


#: our term -> its column
TERM_KEYS = _terms()
#: column -> our term
KEY_TERMS = {key: name for name, key in TERM_KEYS.items()}


def on_sky(key, az, el, mount=ALTAZ):
    """Pointing offset on the sky caused by a unit of a column.

    Parameters
    ----------
    key : tuple
        A column.
    az, el : ndarray, shape (n,)
        Catalogue place as axis angles of the mount, radians.
    mount : Mount, optional

    Returns
    -------
    ndarray, shape (2, n)
        x = delta-A cos E and y = delta-E.
    """
    trig = Trig(az, el, mount)
    out = np.zeros((2, len(az)))
    if not mount.vertical:
        out[0], out[1] = trig.columns(terms_of(mount)[key[0]])
    elif key in KEY_TERMS:
        out[0], out[1] = TERMS[KEY_TERMS[key]].of(trig)
    else:
        result, factors = key
        out[0], out[1] = RESULTS[result][0](trig, value_of(factors, az, el))
    return out


def summed(values, az, el, mount=ALTAZ):
    """Sum of columns, shape (2, n), of a dict column -> value."""
    out = np.zeros((2, len(az)))
    for key, value in values.items():
        out += value * on_sky(key, az, el, mount)
    return out


# ---------------------------------------------------------------------------- a model in columns

#: effects that are a cosine and a sine of an order: what they move, and of which angle
_WAVES = {'bearing_wobble': (('el', 'A'), ('np', 'A')), 'nod': (('el', 'A'),),
          'line_of_sight': (('lr', 'A'),), 'elevation_axis_wobble': (('np', 'E'),)}
_ENCODERS = {'az': (('az', 'A'),), 'el': (('el', 'E'),)}


def _effect_columns(effect):
    """List of (column, factor) for each coefficient; None if the effect is no sum of columns."""
    p = effect.parameters
    waves = _ENCODERS.get(p['axis']) if effect.form == 'encoder' else _WAVES.get(effect.form)
    if waves:
        return [[(column(result, (f, angle, int(p['order']))), 1.0)]
                for result, angle in waves for f in ('cos', 'sin')]
    if effect.form == 'fork_cross_term':
        return [[(column('el', ('sin', 'E', 1), (f, 'A', 1)), 1.0)] for f in ('cos', 'sin')]
    if effect.form in ('term', 'terms') and effect.coefficient_names[0] in TERM_KEYS:
        return [[(TERM_KEYS[effect.coefficient_names[0]], 1.0)]]
    if effect.form == 'latitude':
        return [[(TERM_KEYS['AN'], 1.0)]]
    if effect.form == 'diurnal_aberration':
        return [[(column('lr', ('cos', 'A', 1)), 1.0),
                 (column('el', ('sin', 'E', 1), ('sin', 'A', 1)), -1.0)]]
    if effect.form == 'product':
        return [[(column(p['result'], *map(tuple, p['factors'])), 1.0)]]
    return None


@lru_cache(maxsize=8)
def _terms_on_a_sky(mount):
    """Random axis angles of a mount on both sides, and the offsets by a unit of each term there.

    Returns
    -------
    context : Context
    columns : dict of str to ndarray, shape (2 n,)
    """
    rng = np.random.default_rng(1)
    second = np.arcsin(rng.uniform(-0.9, 0.9, 60))
    first, second = through_pole(rng.uniform(-np.pi, np.pi, 60), second, np.arange(60) % 2 == 1)
    context = Context(first, second, mount=mount)
    return context, {name: on_sky((name, ()), first, second, mount).ravel()
                     for name in terms_of(mount)}


def _effect_terms(effect, mount):
    """Like `_effect_columns` for other mounts: the term proportional to each coefficient."""
    if effect.requires:
        return None
    context, known = _terms_on_a_sky(mount)
    wanted = (effect.tpoint or '').split()
    names, parts = sorted(known, key=lambda name: name not in wanted), []
    for moved in effect.columns(context).reshape(len(effect.coefficient_names), -1):
        for name in names:
            share = moved @ known[name] / (known[name] @ known[name])
            if np.allclose(moved, share * known[name], rtol=0.0, atol=1e-9):
                parts.append([((name, ()), float(share))])
                break
        else:
            return None
    return parts


def _harmonic_columns(harmonics):
    """List of (column, value): the series of paper 000 as products of sines and cosines."""
    # in zenith distance the azimuth series is on the sky; as printed it has an unbounded cot E
    if harmonics.interpretation != 'zenith':
        return None
    grid = np.linspace(-np.pi, np.pi, 64, endpoint=False)
    waves = [(), *(((f, 'E', k),) for k in range(1, 6) for f in ('cos', 'sin'))]
    table = np.stack([value_of(w, grid, grid) for w in waves], axis=1)
    out = []
    for result, series in (('lr', harmonics.coef_x), ('el', harmonics.coef_y)):
        for i, value in enumerate(series):
            # 1, c, then cos A s, sin A s, c c and so on: see `harmonics.basis`
            if i == 0 or i % 3 == 1:
                turn, curve = (), np.sin(grid) ** ((i + 2) // 3)
            else:
                turn = (('cos' if i % 3 == 2 else 'sin', 'A', 1),)
                curve = np.cos(grid) * np.sin(grid) ** ((i - 2) // 3)
            for wave, share in zip(waves, np.linalg.lstsq(table, curve, rcond=None)[0]):
                if abs(share) > 1e-12:
                    out.append((column(result, *turn, *wave), share * value))
    return out


def model_columns(model):
    """A model as a sum of columns, as far as possible.

    Parameters
    ----------
    model : PointingModel

    Returns
    -------
    values : dict of tuple to float
        Column -> value, radians.
    sigma : dict of tuple to float
        Standard errors of columns that have a coefficient of their own.
    left : list of str
        Parts of the model that are no sum of columns.
    """
    values, sigma, left = {}, {}, []

    def take(key, value):
        values[key] = values.get(key, 0.0) + value
    for (name, value), error in zip(model.terms.items(), model.sigmas):
        if model.mount.vertical and name not in TERM_KEYS:
            left.append(name)
            continue
        key = TERM_KEYS[name] if model.mount.vertical else (name, ())
        take(key, value)
        if np.isfinite(error):
            sigma[key] = float(error)
    for fitted in model.effects:
        if not fitted.coefficients.any():
            continue  # zero: it only contributes to the errors
        parts = _effect_columns(fitted.effect) if model.mount.vertical else _effect_terms(
            fitted.effect, model.mount)
        if parts is None:
            needs = ', '.join(fitted.effect.requires)
            left.append(fitted.effect.name + (f' (follows {needs})' if needs else ''))
            continue
        for value, error, part in zip(fitted.coefficients, fitted.sigma, parts):
            for key, share in part:
                take(key, share * value)
                if len(part) == 1:
                    sigma.setdefault(key, float(error))
    if model.harmonics is not None:
        series = _harmonic_columns(model.harmonics) if model.mount.vertical else None
        if series is None:
            left.append(f'harmonics ({model.harmonics.interpretation})')
        else:
            for key, value in series:
                take(key, value)
    return values, sigma, left
