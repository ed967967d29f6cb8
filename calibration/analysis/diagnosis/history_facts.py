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

"""Further facts from the history of a run: a thermal lag, the slew that slipped, a column."""

import numpy as np

from calibration.estimation.equal_causes import SET_WIDTH
from pointing_model.effects import effect, for_mount
from pointing_model.effects.drifts import MOVING, about
from pointing_model.effects.thermal import BEFORE

from ..finding import Finding
from .offered_effects import effect_bank

#: grid of lags, relative to the length of the run; drop in BIC gain of a 1-sigma interval
_LAGS, _ONE_SIGMA = np.geomspace(0.05, 4.0, 120), 1.0
#: an interval that ends within this many grid points of either end of the grid is open
_ENDS = 2
#: drivers that are proxies for anything that changes through the night
_CLOCKS = ('time', 'order', 'run_hours')
#: largest number of columns tested as causes
_MOST_COLUMNS = 20


def history_findings(run, choice):
    """Findings on the effects of a choice.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice

    Returns
    -------
    list of Finding
    """
    out = []
    for i, one in enumerate(choice.chosen):
        found = one.effect(run.problem)
        if found.form == 'lagged':
            out.append(_lag(run, choice, i, found))
        elif found.form == 'step':
            out.append(_slew(run.obs, found))
        elif found.driver in _CLOCKS and found.form == 'drift':
            out.append(_column(run, choice, i, found))
    return [one for one in out if one is not None]


def _scores(run, choice, i, effects):
    """BIC gains of effects in place of effect `i` of a choice."""
    problem = run.problem
    memory = problem.fit(choice.chosen).memory
    fit = problem.fit(choice.chosen, without=i, memory=memory) if memory else problem.plain.fit(
        choice.chosen, without=i)
    return effect_bank(effects, run.obs.context).score(fit).delta_bic


def _lag(run, choice, i, found):
    """Lag of the response to a temperature, with its interval, or why that is unknown."""
    context, p = run.obs.context, found.parameters
    log, _ = context.log_of(p['driver'])
    time = context.get('time')
    first, span = np.nanmin(time), np.ptp(time[np.isfinite(time)])
    lags = _LAGS * span
    gains = _scores(run, choice, i, [effect('lagged', **{**p, 'tau': float(tau)}) for tau in lags])
    near = np.flatnonzero(gains > gains.max() - _ONE_SIGMA)
    best, low, high = lags[int(np.argmax(gains))], lags[near[0]], lags[near[-1]]
    why = ''
    if first - log[0] < BEFORE * best:
        why = 'start'
    elif near[0] < _ENDS or near[-1] >= len(lags) - _ENDS:
        why = 'straight'
    return Finding('lag of temperature', best / 60.0, unit='min', causes=(found.name,), evidence={
        'low': low / 60.0, 'high': high / 60.0, 'why': why,
        'before': BEFORE * best / 60.0, 'driver': p['driver']})


def _slew(obs, found):
    """The slew at which a zero jumped."""
    context, axis = obs.context, found.parameters['axis']
    driver = context.get(found.driver)
    after = np.flatnonzero(driver >= found.parameters['at'])
    way = context.get(f'slew_{axis}')
    if way is None or not len(after):
        return None
    row = after[int(np.argmin(driver[after]))]
    length = np.abs(way)
    if not np.isfinite(length[row]):
        return None
    return Finding('slip of a slew', float(np.degrees(length[row])), unit='deg',
                   causes=(found.name,), evidence={
                       'line': obs.places[row], 'longer': int(np.sum(length > length[row])) + 1,
                       'slews': int(np.isfinite(length).sum()),
                       'axis': context.mount.names.word(axis)})


def _column(run, choice, i, found):
    """A column of the file, not used as a driver, that explains a drift with time better."""
    context = run.obs.context
    own = _scores(run, choice, i, [found])[0]
    best = None
    for name in context.left_out()[:_MOST_COLUMNS]:
        values, reason = context.span(name)
        if reason:
            continue
        effects = for_mount([effect('drift', of=of, **about(name, float(np.std(values)), values))
                             for of in MOVING], context.mount)
        gains = _scores(run, choice, i, effects)
        k = int(np.argmax(gains))
        if best is None or gains[k] > best[0]:
            best = gains[k], name, effects[k].cause
    if best is None or best[0] < own + SET_WIDTH:
        return None
    return Finding('column explains better', float(best[0] - own), unit='BIC', causes=(found.name,),
                   evidence={'column': best[1], 'cause': best[2], 'driver': found.driver})
