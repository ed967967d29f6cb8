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

"""Refits of a model's terms and effects to some of the rows, to test them on the others."""

from dataclasses import replace

import numpy as np

from pointing_model.context import Context
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.pointing_terms import stacked_design

from ..estimation.comparison import CHANCE, FEWEST, compare_residuals
from ..estimation.step_scan import robust_fit

#: parts of the night held out at its end to test how far a drift can be extrapolated
_STRETCHES = (1 / 2, 1 / 3, 1 / 4)
#: p below which an extrapolation is better. Of 30 random walks of 0.3 and 0.6" per row, 10 and 17 %
#: are extrapolated, as with 0.05; of drifts of 2.4 and 4" a night with noise of 1", 60 and 73 %
#: (with 0.05 37 and 50 %), of 12" all
_BY_CHANCE = CHANCE


def refitted(model, rows, effects, seen=None):
    """Refit terms, harmonics and effects of a model, linearised about its terms.

    Parameters
    ----------
    model : PointingModel
        Effects of the kind ``known`` are not refitted.
    rows : PointingRun
        With zeros subtracted, in order.
    effects : sequence of FittedEffect
        Effects of the result.
    seen : ndarray of bool, shape (n,), optional
        Rows to fit; all by default. The other rows still serve as predecessors, for effects that
        depend on the row before.

    Returns
    -------
    model : PointingModel
        Its index terms are those of the newest run in `rows`.
    shifts : dict
        Older run -> its zero relative to the newest, beyond the subtracted zeros: azimuth and
        elevation, shape (2,), rad.

    Raises
    ------
    ValueError
        Too few rows.
    """
    known = tuple(e for e in effects if e.effect.kind == 'known')
    free = tuple(e for e in effects if e.effect.kind != 'known')
    left = np.array(replace(model, effects=known).residuals(rows))
    use = np.isfinite(left).all(axis=0)
    if seen is not None:
        use &= seen
    context = Context.from_run(rows)
    names = tuple(name for name in model.terms if name not in model.held)
    series, harmonic_columns = model.harmonics, np.empty((0, 2, len(rows)))
    if series is not None:
        harmonic_columns = series.columns(rows['az'], rows['el'])
    columns = [stacked_design(names, rows['az'], rows['el'], rows.mount).reshape(len(names), 2, -1),
               harmonic_columns, *(e.effect.columns(context) for e in free), _zero_columns(rows)]
    table = np.concatenate(columns)[:, :, use]
    fit = robust_fit(table.reshape(len(table), -1).T, left[:, use].ravel())
    k, values = len(names), fit.coefficients
    terms = model.terms | {name: model.terms[name] + change
                           for name, change in zip(names, values)}
    places = [list(terms).index(name) for name in names]
    covariance = np.zeros((len(terms), len(terms)))
    covariance[np.ix_(places, places)] = fit.covariance[:k, :k]
    sigma, out, at = np.sqrt(np.diag(fit.covariance)), [], k + len(harmonic_columns)
    if series is not None:
        series = series.moved(values[k:at], fit.covariance[k:at, k:at])
    for e in free:
        part = slice(at, at + len(e.coefficients))
        out.append(FittedEffect(e.effect, values[part], sigma[part]))
        at = part.stop
    shifts = dict(zip(_older(rows), values[at:].reshape(-1, 2)))
    return replace(model, terms=terms, covariance=covariance, harmonics=series,
                   effects=(*known, *out)), shifts


def _older(rows):
    return np.unique(rows['run'])[:-1].tolist() if 'run' in rows else []


def _zero_columns(rows):
    """Columns (k, 2, n) of the zeros of all runs but the newest."""
    older = _older(rows)
    out = np.zeros((2 * len(older), 2, len(rows)))
    for i, run in enumerate(older):
        member = rows['run'] == run
        out[2 * i, 0], out[2 * i + 1, 1] = member * np.cos(rows['el']), member
    return out


def is_drift(fitted):
    """Whether a fitted effect is a drift in time that is held constant from some time on."""
    e = fitted.effect
    return (e.form in ('drift', 'changing') and e.driver == 'time'
            and bool(e.parameters.get('within')))


def held_within(fitted, first, last):
    """A drift that varies from `first` to `last` (UTC s), and is constant before and after."""
    e = fitted.effect
    return replace(fitted, effect=effect(
        e.form, **{**e.parameters, 'within': [float(first), float(last)]}))


def going_on(model, rows):
    """How far each linear drift in time can be extrapolated.

    Stretches at the end of the night are held out in turn, terms and effects are fitted to the rows
    before, and the stretch is predicted with the drift extrapolated and with it held.

    Parameters
    ----------
    model : PointingModel
    rows : PointingRun
        See `refitted`, with `time`.

    Returns
    -------
    list of float
        For each effect of `model` the time, as a part of the night's length, 0 to 1; 0 for an
        effect that is no linear drift.
    """
    first, last = np.nanmin(rows['time']), np.nanmax(rows['time'])
    span = last - first
    out = [0.0] * len(model.effects)
    for place, fitted in enumerate(model.effects):
        if not is_drift(fitted) or fitted.effect.parameters.get('power', 1) != 1 or span <= 0.0:
            continue
        gains = []
        for share in _STRETCHES:
            try:
                gains.append(_gain(model, place, rows, first, last - share * span, last))
            except ValueError:  # too few rows on either side
                gains.append(None)
        if any(g is not None and g.after <= g.before for g in gains):
            continue  # holding was better once
        sure = [share for share, g in zip(_STRETCHES, gains)
                if g is not None and g.chance < _BY_CHANCE]
        if sure:
            out[place] = max(sure) / (1.0 - max(sure))
    return out


def _gain(model, place, rows, first, end, last):
    """`Comparison` of a drift extrapolated over the rows after `end` with the same one held."""
    seen = rows['time'] <= end
    if np.count_nonzero(seen) < FEWEST:
        raise ValueError('too few rows')
    effects = [held_within(e, first, end) if is_drift(e) else e for e in model.effects]
    held, _ = refitted(model, rows, effects, seen)
    # known effects come first in a refitted model
    order = sorted(range(len(effects)), key=lambda i: effects[i].effect.kind != 'known')
    carried = list(held.effects)
    at = order.index(place)
    carried[at] = held_within(carried[at], first, last)
    left = [np.array(m.residuals(rows))[:, ~seen]
            for m in (replace(held, effects=carried), held)]
    found = compare_residuals(*left)
    return {'az': found.az, 'el': found.el}.get(model.effects[place].effect.axes, found.radial)


def left_out(rows, end=1 / 8, share=1 / 8):
    """Choose validation rows for a night without any: its end, and a random part of the others.

    Parameters
    ----------
    rows : PointingRun
        With `time` or in order of time.
    end, share : float
        Parts of the rows: at the end, and at random.

    Returns
    -------
    ndarray of bool, shape (n,)
        All false if there would be too few.
    """
    n = len(rows)
    out = np.zeros(n, bool)
    time = rows['time'] if 'time' in rows else np.arange(n)
    order = np.argsort(time, kind='stable')
    last = order[n - round(end * n):]
    others = np.setdiff1d(order, last)
    some = np.random.default_rng(n).permutation(others)[:round(share * n)]
    if len(last) + len(some) >= FEWEST:
        out[last] = out[some] = True
    return out
