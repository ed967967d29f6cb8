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

"""Terms that change: with time or temperature, in a step, or from run to run."""

import numpy as np

from msg_tools.units import even_sample
from pointing_model.mount_kinds import KINDS, USUAL
from pointing_model.pointing_terms import terms_of

from .base import (
    AXES,
    Effect,
    Offer,
    arcsec,
    driver_word,
    effect,
    for_mount,
    form,
    offer,
    on_axis,
    the,
)

_HOUR = 3600.0
_ZERO_TERM = {'az': 'IA', 'el': 'IE'}
#: terms that may drift
MOVING = ('IA', 'IE', 'CA', 'TF', 'tilt')


def moving(of, names):
    """What drifts: short name, axes in which it acts, start of a sentence."""
    first, second = names.shafts
    return {
        'IA': (f'{names.word("az")} zero', 'az', f'The zero of the {first}'),
        'IE': (f'{names.word("el")} zero', 'el', f'The zero of the {second}'),
        'CA': ('collimation', 'az', 'The collimation'),
        'TF': ('flexure', 'el' if names.vertical else 'both', 'The bending of the tube'),
        'tilt': (f'tilt of the {first}', 'both', f'The tilt of the {first}'),
    }[of]


def _short(what):
    """Beginning of the name of an effect on what `moving` names."""
    return what.partition(' of the ')[0].replace(' ', '_')


def _terms(of, mount):
    """Names of the terms that move on a mount, and their columns times a factor."""
    names = tuple(map(KINDS[mount].named, ('AN', 'AW') if of == 'tilt' else (of,)))
    terms = [terms_of(mount)[name] for name in names]
    return names, lambda c, u: [(x * u, y * u) for x, y in (one.of(c.trig) for one in terms)]


SYMBOLS = {'time': 't', 'temperature': 'T', 'order': 'n', 'run_hours': '(t - start of the run)'}
UNITS = {'time': '/h', 'run_hours': '/h', 'temperature': '/K', 'order': '/run'}
_EACH = {'time': 'an hour', 'run_hours': 'an hour in each run', 'temperature': 'a degree',
         'order': 'over the run'}
_LONG = 96.0 * _HOUR  # longer runs give a drift per day


@form
def _drift(of, driver, power=1, origin=0.0, scale=1.0, within=None, mount=USUAL):
    """A term x ((driver - origin) / scale)^power; the driver is clipped to `within`.

    `of`: name of the term on an alt-azimuth mount.
    """
    what, axes, words = moving(of, KINDS[mount])
    names, factors = _terms(of, mount)
    square = power == 2

    def columns(c):
        return factors(c, progress(c, driver, origin, scale, within) ** power)

    def wording(amount):
        range_ = None if amount.span is None else amount.span[1] - amount.span[0]
        if square:
            text = f'{words} moves with {driver_word(driver)} along a curve'
            if range_ is not None:
                half = 0.5 * range_ / scale
                text += f', {arcsec(amount.size * half**2)} between its middle and its ends'
            return text
        each = amount.size, _EACH.get(driver, f'over a typical change of {driver}')
        if driver == 'time' and range_ is not None and range_ > _LONG:
            each = amount.size * 86400.0 / scale, 'a day'
        text = f'{words} moves {arcsec(each[0])} {each[1]}'
        if driver in ('time', 'temperature') and range_ is not None:
            whole = 'in the whole run' if driver == 'time' else \
                f'for the {range_:.1f} °C of this run'
            text += f', {arcsec(amount.size * range_ / scale)} {whole}'
        return text

    # source: paper 000, drift of the zero
    return Effect(f'{_short(what)}_with_{driver}' + ('_squared' if square else ''),
                  f'{what} moves with {driver_word(driver)}'
                  + (', quadratically' if square else ''),
                  f'{", ".join(names)} x {SYMBOLS.get(driver, driver)}' + ('^2' if square else ''),
                  driver, axes, names, columns, wording,
                  'warming or settling of encoder, bracket, pier and tube',
                  f'a slow change with {the(driver)}' + (', along a curve' if square else ''), '',
                  f'arcsec{UNITS.get(driver, f"/({scale:.4g})")}' + ('^2' if square else ''),
                  requires=(driver,))


#: term, or axis of a zero, that may step: why it does, what to look at
_STEPS = {
    **dict.fromkeys(AXES, (
        'lost counts, a slip, a reference mark found anew',
        'what happened then: a power-on, a slew at full speed, a bump; the coupling of the '
        'encoder, and its reference mark')),
    'CA': ('mirror, camera or focuser moved',
           'what happened then: a change of camera or focus, a blow; mirror cell, focuser'),
    'tilt': ('the pier, tripod or base moved',
             'what happened then: someone at the pier or tripod, a foot that sank, bolts')}
STEPPING = tuple(_STEPS)
#: largest number of places tried, of a zero and of another term
_MOST_STEPS = 32, 12


@form
def _step(axis, at, driver='time', mount=USUAL):
    """A step of the zero of an axis, or of another of `MOVING`, where the driver passes `at`."""
    what, axes, words = moving(_ZERO_TERM.get(axis, axis), KINDS[mount])
    names, factors = _terms(_ZERO_TERM.get(axis, axis), mount)
    why, look_at = _STEPS[axis]

    def columns(c):
        later = np.where(np.isnan(c.get(driver)), np.nan, 1.0 * (c.get(driver) >= at))
        return factors(c, later)

    def wording(amount):
        when = f' at {amount.clock(at)}' if amount.clock and driver == 'time' else ''
        size = arcsec(amount.size if len(names) > 1 else amount.values[0], len(names) == 1)
        return f'{words} jumped by {size}{when}'

    # source: paper 000, reference mark
    return Effect(f'{_short(what)}_step', f'{what} jumps once: {why}',
                  f'{", ".join(names)} x H({driver} - tau)',
                  driver, axes, ('step',) if len(names) == 1 else names, columns, wording,
                  look_at, 'a jump, once', f'{what} jumped at once: {why}',
                  requires=(driver,), scan=f'step_{axis}', searched=('at',), effort=0,
                  share='dictionary' if axis in AXES else 'steps')


@form
def _run_zero(axis, runs, mount=USUAL):
    names = KINDS[mount]
    # source: paper 000, Table 1
    return Effect(f'{names.key(axis)}_zero_per_run',
                  f'{names.word(axis)} zero of each run or power-on',
                  f'{names.named(_ZERO_TERM[axis])} in each run but the first', 'run', axis,
                  tuple(f'run {r:g}' for r in runs[1:]),
                  lambda c: [on_axis(axis, 1.0 * (c.get('run') == r), c.trig.cos_el)
                             for r in runs[1:]],
                  lambda amount: f'The zero of the {names.shaft(axis)} differs from run to run, by '
                  f'up to {arcsec(np.ptp(np.append(amount.values, 0.0)))}',
                  'how the reference mark is found after a power-on: speed, side, temperature',
                  'another zero in each run',
                  requires=('run',))


def progress(context, driver, origin, scale, within):
    """(driver - origin) / scale, with the driver clipped to `within`; shape (n,)."""
    u = context.get(driver) if within is None else np.clip(context.get(driver), *within)
    return (u - origin) / scale


def about(driver, scale, values):
    """Parameters of an effect that depends on a driver, from its values in a run."""
    low, high = float(np.min(values)), float(np.max(values))
    # extrapolated for a while beyond the run, but not forever
    reach = 0.5 * (high - low)
    return {'driver': driver, 'origin': float(np.mean(values)), 'scale': scale,
            'within': [low - reach, high + reach]}


def _drifts(driver, scale, values):
    """Drifts of the terms with a driver."""
    given = about(driver, scale, values)
    out = [effect('drift', of=of, **given) for of in MOVING]
    if driver != 'temperature':
        out += [effect('drift', of=of, power=2, **given) for of in ('IA', 'IE')]
    return out


def clock(context):
    """The driver that orders the rows, and its unit: time in hours, or the order."""
    return ('time', _HOUR) if context.get('time') is not None else ('order', 1.0)


def several_runs(context):
    """Run numbers if there are several; else empty."""
    runs = context.get('run')
    runs = [] if runs is None else np.unique(runs).tolist()
    return runs if len(runs) > 1 else []


def propose(context, lacking, own):
    """Drifts with the clock, with time since the start of each run, with temperature; run zeros.

    With several nights and terms fitted per run, a linear drift in time equals one since the start
    of each run. Only the latter is offered: it also predicts another night.
    """
    time, unit = clock(context)
    several = context.several_nights()
    moved = [context.mount.names.terms.get(name, (name, 1))[0] for name in own]
    yield offer('drift', 'drift in time', context, time, lambda v: [
        e for e in _drifts(time, unit, v) if not (
            several and time == 'time' and e.parameters['power'] == 1
            and e.parameters['of'] in moved)])
    if several:
        yield offer('drift', 'drift since the start of each run', context, 'run_hours',
                    lambda v: _drifts('run_hours', 1.0, v))
    yield offer('drift', 'drift with temperature', context, 'temperature',
                lambda v: _drifts('temperature', 1.0, v))
    runs = several_runs(context)
    yield Offer('run_zero', [effect('run_zero', axis=axis, runs=runs) for axis in AXES] if runs
                else [])


def steps(context, of=tuple(AXES)):
    """Steps at times between two rows.

    Parameters
    ----------
    context : Context
    of : sequence of str
        Axes of zeros, or other terms of `MOVING`.

    Returns
    -------
    list of Effect
        Members of a scan of each, with at least three rows on each side, six of terms that are no
        zeros. Empty for several runs without times: the order of the rows means something else in
        each.
    """
    driver, _ = clock(context)
    if driver == 'order' and several_runs(context):
        return []
    between = places_of_steps(context, driver)
    return for_mount([effect('step', axis=axis, at=float(t), driver=driver) for axis in of
                      for t in (even_sample(between, _MOST_STEPS[0]) if axis in AXES else
                                even_sample(between[3:-3], _MOST_STEPS[1]))], context.mount)


def places_of_steps(context, driver):
    """Driver values midway between two rows, at least three rows from either end."""
    values, reason = context.span(driver)
    if reason:
        return np.empty(0)
    distinct = np.unique(values)
    return 0.5 * (distinct[1:] + distinct[:-1])[2:-2]
