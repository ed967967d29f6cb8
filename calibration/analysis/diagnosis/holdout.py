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


"""Held-out runs: residuals of the model of a diagnosis on nights it was not fitted to."""

from dataclasses import replace
from pathlib import PurePath

import numpy as np

from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.linear_model import weighted_fit
from msg_tools.units import ARCSEC
from pointing_model.fitted_effects import total
from pointing_model.pointing_terms import stacked_design
from pointing_model.rms import radial_arcsec, rms, sigma_of
from pointing_model.runs.run import column_name

from ..finding import Finding
from .observations import observations, run_name
from .reading_fits import MOST_LEFT_OUT

#: ratio to the scatter of the other nights above which a held-out night is bad: of 67 nights of
#: one telescope in six years, seven terms fitted to each, 61 have a scatter below 1.5 times the
#: median and 64 below 2 times
BAD_NIGHT = 2.0
#: a night contradicts the effects if its mean square grows with them by more than this many
#: standard errors: of a true effect it falls
_CONTRADICTS = 2.0
#: driver that never repeats: its effect in one night predicts nothing for another
_CLOCK = 'time'
#: parameters that mark such an effect: a drift or a jump, not a wave
_OF_THEN = {'within', 'at'}


def hold_out(runs, result, own_terms, encoder='enc'):
    """Store the radial RMS on held-out runs, without and with the effects, in a result.

    The model is unchanged except for `own_terms`, which are refitted robustly to each run, as an
    observer does on a new night.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
    result : Diagnosis
    own_terms : sequence of str
    encoder : {'enc', 'abs'}
    """
    every = observations(runs, encoder)
    rows, partly, blind = _judged(every, result)
    result.notes += [Finding('runs held out', len(every), unit='rows', evidence={
        'runs': len(every.runs), 'refitted': list(own_terms)}),
        *(Finding('held out', evidence={'of': one}) for one in _left_out(every))]
    if not rows.any():
        result.cautions = [*blind, *result.cautions]
        return
    obs = every.select(rows)
    left, kept = [], np.ones(len(obs), bool)
    for model in (result.base_model, result.model):
        fit = _refit(obs, model, own_terms)
        left.append(fit.raw.reshape(2, -1))
        kept &= fit.weights > 0.0
    for entry, residual in zip((result.before, result.after), left):
        entry['holdout_rms_arcsec'] = radial_arcsec(residual, kept)
    result.held_out = nights_held_out(obs, left, kept, result, partly)
    result.cautions = [*blind, *result.cautions, *(
        Finding('held-out night contradicts', before=one['before']['rms_arcsec'],
                after=one['after']['rms_arcsec'], evidence={'run': one['run']})
        for one in result.held_out if one['contradicts'])]
    if not rows.all():
        result.notes.append(Finding('rows held out judge nothing', int(np.sum(~rows)), unit='rows'))
    if not kept.all():
        result.notes.append(Finding('outliers held out', int(np.sum(~kept)), unit='rows'))


def _judged(obs, result):
    """Select the rows that can test the effects: an effect is zero where its driver is unknown.

    Returns
    -------
    rows : ndarray of bool, shape (n,)
    partly : set of int
        Indices of the runs that cannot test some effect; they test the other effects.
    blind : list of Finding
        The untested effects, and why.
    """
    rows, partly, blind = np.ones(len(obs), bool), set(), {}
    effects, fitted = result.model.effects, result.observations.context.get(_CLOCK)
    for label in np.unique(obs.label):
        own, seen = obs.label == label, 0
        for found in effects:
            lost = _lost(found, obs.context, fitted)
            if np.mean(lost[own]) > MOST_LEFT_OUT:
                partly.add(int(label))
                blind.setdefault(_why(found, obs.context, own), []).append(run_name(obs, own))
            else:
                rows[own & lost] = False
                seen += 1
        if effects and not seen:
            rows[own] = False
    return rows, partly, [Finding('held-out night cannot judge', evidence={
        'runs': runs, 'effect': effect, 'driver': driver, 'column': column})
        for (effect, driver, column), runs in blind.items()]


def _lost(found, context, fitted):
    """Rows in which an effect is unknown, or held constant outside the time it was fitted to."""
    lost, time = found.unknown(context), context.get(_CLOCK)
    if _CLOCK in found.effect.requires and time is not None and not _OF_THEN.isdisjoint(
            found.effect.parameters):
        reach = 0.5 * np.ptp(fitted)  # as in `drifts.about`
        lost = lost | (time < fitted.min() - reach) | (time > fitted.max() + reach)
    return lost


def _why(found, context, rows):
    """Name of an effect, its missing driver and the column of that; '' where it is the time."""
    lost = [name for name in found.effect.requires if context.get(name) is None
            or np.mean(~np.isfinite(context.get(name)[rows])) > MOST_LEFT_OUT]
    driver, names = lost[0] if lost else _CLOCK, context.mount.names
    return found.effect.name, driver, column_name(driver, names) if lost else ''


def _left_out(obs):
    reasons = {}
    for e in obs.excluded:
        place = f'{PurePath(str(e.get("source") or "run")).name}:{e["row"]}'
        reasons.setdefault(e['reason'], []).append(place)
    return [*obs.notes, *(Finding('rows left out', evidence={'rows': places, 'why': reason})
                          for reason, places in reasons.items())]


def _refit(obs, model, own_terms):
    az, el = obs.context.az, obs.context.el
    # evaluate effects on the whole run: some drivers of a row come from the row before
    b = obs.observed - np.nan_to_num(np.concatenate(replace(model, effects=()).offsets(az, el))) \
        - np.concatenate(total(model.effects, obs.context))
    own = stacked_design(tuple(own_terms), az, el, obs.run.mount)
    columns = GroupColumns.of(np.tile(obs.label, 2), own)
    return weighted_fit(columns, b, obs.inverse_sigma, final=True)


def nights_held_out(obs, left, kept, result, partly=()):
    """Residuals of each held-out run, and whether it is a bad night.

    A night is bad if its robust scatter exceeds `BAD_NIGHT` times the median of the other nights
    (the fitted run included), or if more than a third of its rows are outliers. It is not bad if it
    scatters so only with the effects, contradicts them, or cannot test them all.

    Parameters
    ----------
    obs : Observations
        The held-out runs.
    left : sequence of ndarray, shape (2, n)
        Residuals without and with the effects, radians.
    kept : ndarray of bool, shape (n,)
        Rows that are not outliers.
    result : Diagnosis
    partly : set of int
        Labels of runs that cannot test all effects.

    Returns
    -------
    list of dict
        ``run``, ``rows``, ``set_aside``, ``before`` and ``after`` (``rms_arcsec``,
        ``rms_x_arcsec``, ``rms_y_arcsec`` of all its rows), ``bad`` (None, or the ratio of its
        scatter to that of the others in ``x`` and ``y``) and ``contradicts`` (whether the effects
        make it worse).
    """
    labels = np.unique(obs.label)
    typical = np.array([min((_scatter(one[:, obs.label == label]) for one in left),
                            key=lambda xy: np.hypot(*xy)) for label in labels])
    own, out = _scatter(result.residual_after[:, result.weights > 0.0]), []
    for i, label in enumerate(labels):
        rows = obs.label == label
        count, aside = int(rows.sum()), int((rows & ~kept).sum())
        others = np.median([own, *(one for k, one in enumerate(typical)
                                   if k != i and labels[k] not in partly)], axis=0)
        times = typical[i] / np.maximum(others, 1e-9)
        contradicts = _contradicts(*(one[:, rows & kept] for one in left))
        bad = not contradicts and label not in partly and (
            aside > MOST_LEFT_OUT * count or np.hypot(*typical[i]) > BAD_NIGHT * np.hypot(*others))
        before, after = (_rms(one[:, rows]) for one in left)
        out.append({'run': run_name(obs, rows), 'rows': count, 'set_aside': aside, 'before': before,
                    'after': after, 'bad': dict(zip('xy', times.tolist())) if bad else None,
                    'contradicts': contradicts})
    return out


def _contradicts(before, after):
    """Whether residuals, shape (2, n), are significantly larger with the effects."""
    more = np.square(after).sum(axis=0) - np.square(before).sum(axis=0)
    return bool(len(more) > 2 and more.mean() > _CONTRADICTS * more.std(ddof=1) / len(more)**0.5)


def _rms(residual):
    x, y = (float(rms(one)) / ARCSEC for one in residual)
    return {'rms_arcsec': float(np.hypot(x, y)), 'rms_x_arcsec': x, 'rms_y_arcsec': y}


def _scatter(residual):
    return np.array([float(sigma_of(one)) for one in residual]) / ARCSEC
