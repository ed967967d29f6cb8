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

"""Smooth curves of one driver, for errors without a physical explanation."""

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL

from .base import DIRECTION, Effect, driver_word, effect, for_mount, form, the
from .drifts import clock, several_runs

_TURN = 2.0 * np.pi
_LONG_WAVE = np.pi / 4.0  # rad, longer waves are reported as curves
#: drivers with waves and bumps; weather, stars and columns of the file get splines only
_WAVY = (*DIRECTION, 'time', 'order')
_SECOND = {names.keys[1] for names in KINDS.values()}


@form
def _smooth(axis, driver, shape, factor='1', within=None, mount=USUAL, **numbers):
    """A curve of one driver, for errors without a physical explanation.

    ``shape``: 'fourier' (``orders``, ``period``), 'spline' (``knots``: natural cubic),
    'bump' (``centre``, ``width``, and ``period`` if cyclic), 'sawtooth' (``start``,
    ``period``; from -1/2 to 1/2). Beyond ``within`` the curve is constant.
    """
    curve = {'fourier': _fourier, 'spline': _natural_spline, 'bump': _bump,
             'sawtooth': _sawtooth}[shape]
    count = {'fourier': lambda: 2 * len(numbers['orders']),
             'spline': lambda: len(numbers['knots']) - 1, 'bump': lambda: 1,
             'sawtooth': lambda: 1}[shape]()

    def of(c):
        u = np.asarray(c.get(driver), float)
        values = curve(u if within is None else np.clip(u, *within), **numbers)
        if axis == 'az' and factor == 'cosE':
            return [(v * c.trig.cos_el, 0.0) for v in values]
        return [(v, 0.0) if axis == 'az' else (0.0, v) for v in values]

    series = shape == 'fourier' and list(numbers['orders']) == list(
        range(1, len(numbers['orders']) + 1))
    wave = shape == 'fourier' and (not series or len(numbers['orders']) == 1)
    if wave:
        tail = f'wave_{numbers["orders"][0]:g}'
        tail += f'_overtones_{len(numbers["orders"])}' if len(numbers['orders']) > 1 else ''
    else:
        tail = f'{shape}_{count // 2 if series else count}' if count > 1 else shape
    word = KINDS[mount].word(axis)
    shape_wording = _shape_wording(driver, shape, numbers)
    scan = shape if shape in ('bump', 'sawtooth') else 'wave' if wave else None
    own = axis if KINDS[mount].vertical else KINDS[mount].key(axis)
    return Effect(f'smooth_of_{driver}_{own}_{tail}' + ('_cosE' if factor == 'cosE' else ''),
                  f'unknown cause: the {word} error follows the {driver_word(driver)} '
                  f'({shape})', f'{shape} of {driver}' + (' x cos E' if factor == 'cosE' else ''),
                  driver, axis, tuple(f'{shape[0]}{i + 1}' for i in range(count)), of,
                  lambda _: f'The {word} error has {shape_wording}, which no known effect explains',
                  f'what else changes with {the(driver)}' + (
                      f', and what repeats each {_size(driver, numbers["period"])} of it: teeth '
                      'of a gear, rollers, joints of a tape' if shape == 'sawtooth' else ''),
                  shape_wording, f'something that changes with {the(driver)} little by little',
                  requires=() if driver in DIRECTION else (driver,), kind='smooth',
                  # a bump and a sawtooth have two scanned parameters, place and width
                  scan=scan, scanned=1 if wave else 2, share='curves')


def _size(driver, value):
    """An interval of a driver, with its unit."""
    if driver in DIRECTION:
        return f'{np.degrees(value):.1f}°'
    if driver == 'order':
        return f'{100.0 * value:.0f} % of the run'
    return f'{value / 3600.0:.2f} h' if driver == 'time' else f'{value:.3g}'


def _shape_wording(driver, shape, numbers):
    """Description of a curve."""
    if shape == 'sawtooth':
        return f'a sawtooth of {the(driver)} with a period of {_size(driver, numbers["period"])}'
    if shape == 'bump':
        return (f'a bump at {driver_word(driver)} {_size(driver, numbers["centre"])}, '
                f'{_size(driver, 2.0 * numbers["width"])} wide' if driver in DIRECTION
                else f'a bump of {the(driver)}')
    if shape == 'fourier' and len(numbers['orders']) in (1, 3) and numbers['orders'][0] != 1:
        period = numbers['period'] / numbers['orders'][0]
        # the period is on a grid of trials; for a long one the rows do not show a second wave
        if driver not in DIRECTION or period <= _LONG_WAVE:
            return f'a wave of {the(driver)} with a period of about {_size(driver, period)}'
    return f'a smooth curve of {the(driver)}'


def _fourier(u, orders, period):
    phase = _TURN / period * u
    return [f(k * phase) for k in orders for f in (np.cos, np.sin)]


def _bump(u, centre, width, period=None):
    d = u - centre
    if period:
        d = np.mod(d + period / 2, period) - period / 2
    return [np.exp(-0.5 * np.square(d / width))]


def _sawtooth(u, start, period):
    return [np.mod((u - start) / period, 1.0) - 0.5]


def _natural_spline(u, knots):
    knots = np.asarray(knots, float)
    span = knots[-1] - knots[0]
    v = (u - knots[0]) / span
    t = (knots - knots[0]) / span
    # constant beyond the data: no extrapolation
    v = np.clip(v, 0.0, 1.0)
    last = np.maximum(v - t[-1], 0.0) ** 3

    def d(k):
        return (np.maximum(v - t[k], 0.0) ** 3 - last) / (t[-1] - t[k])

    end = d(len(t) - 2)
    return [v, *(d(k) - end for k in range(len(t) - 2))]


def smooths(context):
    """Smooth curves of each driver and axis, for what the dictionary does not explain.

    The drivers are the axis angles, elevation, time or order, for several nights the hours since
    the start of each run, temperature, magnitude and user columns. The curves are Fourier
    series (of the first axis, one turn), natural splines, and single waves and bumps scanned in
    place and width.

    Parameters
    ----------
    context : Context

    Returns
    -------
    list of Effect
        The order of the rows is not used with several runs: it means something else in each.
    """
    first, second = context.mount.names.keys
    # gravity depends on the elevation, whatever the axes are
    above = () if context.mount.vertical else ('elevation',)
    drivers = [first, second, *above, clock(context)[0],
               *(['run_hours'] if context.several_nights() else []),
               'temperature', 'magnitude', *context.extra()]
    out = []
    for driver in drivers:
        values, reason = context.span(driver)
        if reason or len(np.unique(values)) < 12 or (
                driver == 'order' and several_runs(context)):
            continue
        for axis, factor in (('az', 'cosE'), ('az', '1'), ('el', '1')):
            out += _driver_smooths(axis, driver, factor, values, driver == first)
    return for_mount(out, context.mount)


def _driver_smooths(axis, driver, factor, values, closed):
    low, high = float(values.min()), float(values.max())
    period = _TURN if closed else high - low
    out = []

    def add(shape, **numbers):
        out.append(effect('smooth', axis=axis, driver=driver, shape=shape, factor=factor,
                          within=None if closed else [low, high], **numbers))

    if closed:
        for top in (3, 6):
            add('fourier', orders=list(range(1, top + 1)), period=period)
        for order in range(4, 16):
            add('fourier', orders=[order], period=period)
            if order <= 10:
                add('fourier', orders=[order, 2 * order, 3 * order], period=period)
    else:
        for count in (4, 6, 9):
            knots = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count)))
            if len(knots) == count:
                add('spline', knots=knots.tolist())
        if driver not in _WAVY:
            return out
        if driver in _SECOND and (axis == 'el' or factor == 'cosE'):
            for order in np.arange(1.5, 6.1, 0.25):
                for start in np.arange(8.0) / 8.0 * period / order:
                    add('sawtooth', start=float(low + start), period=float(period / order))
        for order in np.arange(1.0, 8.5, 0.5):
            add('fourier', orders=[float(order)], period=period)
            if 1.5 <= order <= 6.0:  # sharp edges, like those of a sawtooth, have harmonics
                add('fourier', orders=[float(k * order) for k in (1, 2, 3)], period=period)
    for width in (1 / 36, 1 / 18, 1 / 9):
        width = width * (period if closed else 1.5 * period)
        count = int(period / width)
        start = 0.0 if closed else low
        for centre in start + (np.arange(count) + 0.5) * period / count:
            add('bump', centre=float(centre), width=float(width),
                **({'period': period} if closed else {}))
    return out
