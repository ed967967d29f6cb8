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

"""Periodic errors of worms, gears and strain-wave drives, and errors periodic in time.

The number of periods per turn is searched (`calibration.estimation.periodogram`) or declared.
"""

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL
from pointing_model.sky.places import SIDEREAL

from .base import AXES, Effect, Offer, arcsec, driver_word, effect, form, on_axis
from .drifts import several_runs
from .graduation import declared_axis, declared_pairs, is_gear, number_of

_TURN = 2.0 * np.pi
#: reductions of strain-wave drives (ratios listed by their makers). Their error has two periods
#: per turn of the wave generator, which has two lobes, and one if it is eccentric
STRAIN_WAVE = (50, 80, 100, 120, 160)
#: parts of a drive by their largest number of periods per turn
_WHEELS = (36.0, 'rollers, poles of a motor or a gear'), (np.inf, 'worm or gear')
_LOOK_AT = {
    _WHEELS[0][1]: 'rollers of the bearing, poles and torque ripple of a motor on the axis, gears',
    _WHEELS[1][1]: 'mesh, bearings and end play of the worm, the gears before it; measure it while '
                   'tracking and record a correction (PEC)'}
_SIGNALS = '; of an encoder with so many lines the offset, amplitude and phase of its signals'
#: relative difference allowed between declared and actual lines of a tape on a drum
TAPE_MARGIN = 0.01


def declared_worms(given, names=None):
    """Parse declared numbers of teeth of worm wheels.

    Parameters
    ----------
    given : str or dict
        ``ha=180``: periods per turn of that axis; ``ha=180, dec=144``; or an earlier result.
    names : mount_kinds.MountKind, optional
        See `graduation.declared_axis`.

    Returns
    -------
    dict of str to float
        Axis (az, el) -> periods per turn.

    Raises
    ------
    ValueError
        Unknown axis, or invalid number of periods.
    """
    out = {}
    for name, value in declared_pairs(given).items():
        axis, number = declared_axis(name, f'worm {name}={value}', names), number_of(value)
        if axis not in AXES or not 1.0 <= number <= 1e5:
            raise ValueError(f'worm {name}={value}: give an axis and the periods in a turn of it '
                             '(teeth of the worm wheel), such as ha=180')
        out[axis] = number
    return out


def strain_wave(turns, margin=0.25):
    """Reductions of strain-wave drives that match a number of periods per turn.

    Parameters
    ----------
    turns, margin : float

    Returns
    -------
    list of (int, int)
        Reduction, and error periods per turn of its wave generator (1 or 2).
    """
    return [(ratio, order) for order in (2, 1) for ratio in STRAIN_WAVE
            if abs(turns - order * ratio) <= margin]


def peak_to_peak(coefficients, orders):
    """Peak-to-peak size of a periodic error with some harmonics.

    Parameters
    ----------
    coefficients : sequence of float
        cos and sin for each order.
    orders : sequence of int

    Returns
    -------
    float
    """
    phase = np.linspace(0.0, _TURN, 721)
    return float(np.ptp(sum(c * np.cos(k * phase) + s * np.sin(k * phase) for k, c, s in zip(
        orders, coefficients[::2], coefficients[1::2]))))


def period_words(turns, names, axis, clock=False):
    """A period for people: ``180 per turn (2.0000°, 478.7 s at sidereal rate)``."""
    seconds = _TURN / SIDEREAL / turns
    if clock:
        return f'each {seconds:.1f} s'
    sidereal = f', {seconds:.1f} s at sidereal rate' if names.celestial and axis == 'az' else ''
    return f'{turns:.6g} per turn ({360.0 / turns:.5g}°{sidereal})'


@form
def _periodic(axis, turns, orders=(1,), of='reading', origin=0.0, declared=False, lines=False,
              tape=None, runs=(), mount=USUAL):
    """Periodic error of an axis with `turns` periods per turn (or sidereal day: ``of='time'``).

    ``of``: 'reading' of the encoder, 'angle' of the axis, or 'time' since `origin`, s. ``lines``:
    the declared lines of an encoder. ``tape``: declared lines of an encoder's tape. ``runs``:
    each has its own phase.
    """
    names, word, key = KINDS[mount], KINDS[mount].word(axis), KINDS[mount].key(axis)
    clock = of == 'time'
    driver = {'reading': f'reading_{axis}', 'time': 'time', 'angle': key}[of]
    orders = tuple(int(k) for k in orders)

    def columns(c):
        phase = turns * driver_angle(c, axis, of, origin)
        waves = [f(k * phase) for k in orders for f in (np.cos, np.sin)]
        parts = [1.0 * (c.get('run') == run) for run in runs] or [1.0]
        return [on_axis(axis, part * wave, c.trig.cos_el) for part in parts for wave in waves]

    period = period_words(turns, names, axis, clock) + ', with another phase in each run' * bool(
        runs)
    place, wheel = _TURN / turns, next(words for most, words in _WHEELS if turns <= most)

    def against(c):
        angle = driver_angle(c, axis, of, origin)
        return (f'place within the period of {word} [0 to 1]',
                None if angle is None else np.mod(angle, place) / place)

    def wording(amount):
        each = amount.values.reshape(max(len(runs), 1), -1)
        size = ', '.join(arcsec(peak_to_peak(own, orders)) for own in each) + ' peak to peak'
        if tape:
            return (f'The {word} encoder divides each line of its tape unevenly, {size}; '
                    f'the tape has {turns:.7g} lines a turn')
        return f'The {word} has a periodic error of {size}, {period}'

    cause = (f'each line of the tape of the {word} encoder is divided unevenly, {turns:.7g} lines '
             'per turn' if tape else f'{"periodic error" if clock else wheel} of {word}, {period}'
             + ' in time' * clock)
    # source: worms: a gear has one period per tooth; tapes: like a grating
    return Effect(f'{key}_{"tape" if tape else "periodic_error"}_{turns:.6g}' + '_time' * clock
                  + ('' if orders == (1,) else f'_orders_{len(orders)}') + '_per_run' * bool(runs),
                  cause, f'cos, sin of {turns:.6g} k {driver_word(driver)}, k = '
                  + ', '.join(map(str, orders)), driver, axis,
                  tuple(f'{f}{k}{run}' for run in [f' run {r:g}' for r in runs] or ['']
                        for k in orders for f in ('cos', 'sin')), columns, wording,
                  'height of the reading head over the tape, and its joint' if tape else
                  'what comes back so often: a drive that runs with the clock, a heater, a pump'
                  if clock else
                  _LOOK_AT[wheel] + _SIGNALS * lines,
                  f'a wave of {"time" if clock else f"the {word}"}, {period}',
                  f'tape of the {word} encoder' if tape else
                  f'something that comes back {period} in {word}' if clock else
                  f'{wheel} of {word}, {period}',
                  requires=(driver,) * (of != 'angle') + ('run',) * bool(runs), figure=against,
                  scan=None if declared else f'{"tape" if tape else "period"}_{of}_{axis}',
                  share='dictionary' if declared else 'periods')


def driver_angle(context, axis, of, origin=0.0):
    """Angle that drives the periodic error, radians, shape (n,); None if unknown."""
    if of == 'angle':
        return context.az if axis == 'az' else context.el
    if of == 'reading':
        return context.get(f'reading_{axis}')
    time = context.get('time')
    return None if time is None else (time - origin) * SIDEREAL


def propose(context, lacking, own):
    """For a worm with declared teeth, or a grating with so few lines; others are searched."""
    few = {axis: kinds['grating'] for axis, kinds in context.graduation.items()
           if is_gear('grating', kinds.get('grating'))}
    for axis, turns in {**few, **context.worms}.items():
        lines, several = axis in few, several_runs(context)
        yield Offer('periodic', [
            *worm_waves(context, axis, turns, lines=lines),
            # an encoder without an index starts to count elsewhere after each power-on
            *(worm_waves(context, axis, turns, several) if several and not lines else [])],
            axis=axis)


def worm_waves(context, axis, turns, runs=(), lines=False):
    """Periodic error of a worm with so many teeth, with and without harmonics. For `runs` and
    `lines` see `_periodic`.
    """
    of = 'reading' if context.get(f'reading_{axis}') is not None else 'angle'
    return [effect('periodic', axis=axis, turns=turns, orders=orders, of=of, declared=True,
                   lines=lines, runs=runs) for orders in ((1,), (1, 2))]
