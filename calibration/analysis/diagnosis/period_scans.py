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

"""Search for periodic errors of unknown period, and findings on the periods and gears."""

import numpy as np

from calibration.estimation.equal_causes import SET_WIDTH
from calibration.estimation.periodogram import SHAPES, PeriodBank, WaveScan, rate_error
from msg_tools.units import ARCSEC
from pointing_model.effects import effect
from pointing_model.effects.base import AXES, for_mount, on_axis
from pointing_model.effects.gears_and_worms import (
    TAPE_MARGIN,
    driver_angle,
    peak_to_peak,
    strain_wave,
)
from pointing_model.sky.places import SIDEREAL

from ..finding import Finding

#: cycles per turn searched: worm wheels have 50 to 720 teeth, the motor's gears more cycles
FEWEST, MOST = 10.0, 1000.0
#: fewest rows for a search: with fewer some period fits by chance
_FEWEST_ROWS = 20
#: a rate is rounded to whole teeth if within this many standard errors of a whole number, and if
#: its standard error is below this
_WHOLE, _SURE = 2.0, 0.2
#: an angle is linear in time if its deviation is below this share of the travel
_TOGETHER = 1e-3
#: kinds of findings on gears
FAST, NOTHING, ABSENT = 'fast wave as well', 'nothing at the teeth', 'fundamental absent'
#: a fundamental is absent if smaller than this many standard errors
_SIGMAS = 3.0


def period_bank(context):
    """Waves of both axes: functions of the encoder reading (or angle), and of time in a night.

    Parameters
    ----------
    context : Context

    Returns
    -------
    PeriodBank
        Empty if there are too few rows.
    """
    if len(context) < _FEWEST_ROWS:
        return PeriodBank([])
    scans = []
    for axis in AXES:
        factor = np.concatenate([np.broadcast_to(v, len(context)) for v in on_axis(
            axis, np.ones(len(context)), context.trig.cos_el)])
        of = 'reading' if context.get(f'reading_{axis}') is not None else 'angle'
        angle = driver_angle(context, axis, of)
        scans.append(WaveScan.over(angle, factor, FEWEST, MOST, _maker(context, axis, of)))
        lines = context.graduation.get(axis, {}).get('tape')
        if lines and of == 'reading':
            scans.append(WaveScan.over(angle, factor, (1.0 - TAPE_MARGIN) * lines,
                                       (1.0 + TAPE_MARGIN) * lines,
                                       _maker(context, axis, of, tape=lines)))
        time = context.get('time')
        if time is None or not np.isfinite(time).all() or SIDEREAL * np.ptp(time) > np.pi:
            continue
        origin = float(time.min())
        turned = driver_angle(context, axis, 'time', origin)
        if not _together(turned, angle):
            scans.append(WaveScan.over(turned, factor, FEWEST, MOST,
                                       _maker(context, axis, 'time', origin=origin)))
    return PeriodBank([one for one in scans if one is not None])


def _maker(context, axis, of, **given):
    def make(rate, orders):
        return for_mount([effect('periodic', axis=axis, turns=rate, orders=orders, of=of, **given)],
                         context.mount)[0]
    return make


def _together(time, angle):
    """Whether an axis turns linearly in time: then waves of both are the same."""
    keep = np.isfinite(angle)
    design = np.stack((np.ones(keep.sum()), time[keep]))
    left = angle[keep] - np.linalg.lstsq(design.T, angle[keep], rcond=None)[0] @ design
    return left.std() < _TOGETHER * max(np.ptp(angle[keep]), 1e-9)


def settle_periods(problem, choice):
    """Tune the found periods with all else in the model; round them to whole teeth if consistent.

    Returns
    -------
    dict of int to (float, float, bool)
        Index in the choice -> best rate, its standard error, whether it is a whole number.
    """
    return {i: _settled(problem, problem.plain.fit(choice.chosen, without=i), one.group)
            for i, one in enumerate(choice.chosen) if one.period}


def _settled(problem, fit, group):
    """One entry of `settle_periods`; `fit` is without this wave."""
    bank = problem.periods
    scan, orders = bank.scans[bank.line[group]], SHAPES[group // bank.count]
    rate, _ = bank.tuned_rate(fit, group, float(bank.rate[group]))
    error = rate_error(fit, scan, rate, orders)
    p = scan.effect(rate, orders).parameters
    whole = p['of'] != 'time' and not p['tape'] and error < _SURE \
        and abs(rate - round(rate)) < _WHOLE * error
    problem.tune(group, float(round(rate)) if whole else rate)
    return rate, error, whole


def add_aliases(problem, choice):
    """Add aliased periods that fit as well (rows at even steps) to the equals of those found."""
    bank = problem.periods
    for i, (one, stand) in enumerate(zip(choice.chosen, choice.significances)):
        if not one.period:
            continue
        fit = problem.plain.fit(choice.chosen, without=i)
        orders = one.group // bank.count * bank.count
        least = bank.score(fit, [one.group]).delta_bic[one.group] - SET_WIDTH
        for rate in bank.aliases(fit, one.group, SET_WIDTH):
            group = orders + bank.nearest(bank.line[one.group], rate)
            gain = bank.tuned_rate(fit, group, rate)[1]
            if gain > least:
                _settled(problem, fit, group)
                stand.every[group] = gain
                stand.equals.append(group)


def _aliases(problem, choice, i):
    """Cycles per turn of the aliases that `add_aliases` gave to effect `i`, best first."""
    bank, line = problem.periods, problem.periods.line
    return [float(bank.rate[k]) for k in choice.significances[i].equals
            if line[k] == line[choice.chosen[i].group]]


def period_finding(problem, choice, i, rate, error, whole):
    """Finding ``period`` on wave `i` of unknown period; the others: see `settle_periods`."""
    e = choice.chosen[i].effect(problem)
    p = e.parameters
    return Finding('period', float(p['turns']), float(error), 'per turn', (e.name,), evidence={
        'axis': p['axis'], 'of': p['of'], 'orders': list(p['orders']), 'whole': bool(whole),
        'tape': p['tape'], 'searched': float(rate),
        'strain_wave': [] if p['of'] == 'time' or p['tape'] else strain_wave(p['turns']),
        'aliases': _aliases(problem, choice, i)})


def gear_findings(run, choice, effects):
    """Findings on gears: aliased periods, and declared teeth without a wave.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    effects : list of DiagnosedEffect
        The effects found.

    Returns
    -------
    list of Finding
    """
    return [*_fast_as_well(run, choice), *_other_periods(run, choice, effects),
            *_declared(run.obs.context, [one.fitted for one in effects])]


def _fast_as_well(run, choice):
    """Fast waves aliased with a slow effect, because rows are at even steps of an axis."""
    problem, names = run.problem, run.obs.context.mount.names
    bank, out = problem.periods, []
    for scan, one in enumerate(bank.scans):
        p = one.effect(float(one.rates[0]), (1,)).parameters
        step = None if p['of'] == 'time' or p['tape'] else one.even_step()
        teeth, causes = [], []
        for i, found in enumerate(choice.chosen if step else ()):
            if found.period or found.of is not None:
                continue
            fit = problem.plain.fit(choice.chosen, without=i)
            own = float(found.bank(problem).score(fit, [found.group]).delta_bic[found.group])
            e = found.effect(problem)
            # with known teeth there is no search penalty
            least = own - SET_WIDTH - np.log(problem.n)
            rates = bank.as_good(fit, scan, least, [e.parameters['turns']]
                                 if e.form == 'periodic' else ()) if own > 0.0 else ()
            if len(rates):
                causes.append(e.name)
                teeth += [round(float(rate)) for rate in rates]
        if causes:
            out.append(Finding(FAST, float(np.degrees(step)), unit='deg', causes=tuple(causes),
                               caution=True, evidence={'axis': names.word(p['axis']),
                                         'teeth': list(dict.fromkeys(teeth))}))
    return out


def _other_periods(run, choice, effects):
    """Aliased periods of each wave found, and the range of its size with them."""
    out = []
    for i, (one, found) in enumerate(zip(choice.chosen, effects)):
        p = found.fitted.effect.parameters
        teeth = _aliases(run.problem, choice, i) if one.period and p['of'] != 'time' else ()
        if not len(teeth) or p['tape']:
            continue
        step = run.problem.periods.scans[run.problem.periods.line[one.group]].even_step()
        sizes = [peak_to_peak([of['value_arcsec'] for of in cause['fitted']['coefficients']],
                              p['orders']) for cause in found.causes if cause['fitted']]
        out.append(Finding(FAST, float(np.degrees(step)) if step else None, unit='deg',
                           causes=(found.fitted.effect.name,), caution=True, evidence={
            'axis': run.obs.context.mount.names.word(p['axis']),
            'teeth': [round(rate) for rate in teeth], 'sizes': [min(sizes), max(sizes)]}))
    return out


def _declared(context, effects):
    """Declared teeth whose wave, or its fundamental, was not found."""
    out = []
    for axis, teeth in context.worms.items():
        word = context.mount.names.word(axis)
        waves = [one for one in effects if one.effect.form == 'periodic'
                 and one.effect.parameters['axis'] == axis]
        own = [one for one in waves if one.effect.parameters.get('declared')]
        if waves and not own:
            out.append(Finding(NOTHING, float(teeth), unit='per turn', caution=True, evidence={
                'axis': word, 'turns': [one.effect.parameters['turns'] for one in waves]}))
        for one in own:
            if one.effect.parameters['runs']:
                continue
            size, error = (np.hypot(*of.reshape(-1, 2).T) / ARCSEC
                           for of in (one.coefficients, one.sigma))
            if len(size) > 1 and size[0] < _SIGMAS * error[0] < size[1]:
                out.append(Finding(ABSENT, float(size[0]), float(error[0]), caution=True,
                                   evidence={'axis': word, 'teeth': float(teeth)}))
    return out
