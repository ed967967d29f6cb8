"""Candidate effects for a run: the dictionary, steps at unknown times, curves for the unknown.

The effects themselves are in `effect_families`. Each comes with its physical cause, its columns on
both axes, the driver that shows it, and its name in TPOINT where it has one.
"""

import numpy as np

from .context import Context
from .curves import smooths
from .effect_families import AXES, PERIODS, Effect, effect, of_document

_HOUR = 3600.0
#: what may drift with time or temperature
_DRIFTING = ('IA', 'IE', 'CA', 'TF', 'tilt')
_MEMORIES = (3.0, 10.0, 30.0)  # degrees
_TERMS = ('refraction', 'refraction_cube', 'second_flexure')


def _directional():
    """Effects of the direction alone."""
    for name in _TERMS:
        yield effect('terms', name=name)
    for axis, highest in (('el', 3), ('az', 6)):
        for order in range(1, highest + 1):
            yield effect('encoder', axis=axis, order=order)
    for name, highest in (('bearing_wobble', 3), ('nod', 6), ('elevation_axis_wobble', 2)):
        for order in range(1, highest + 1):
            yield effect(name, order=order)
    for name in ('fork_cross_term', 'diurnal_aberration', 'latitude'):
        yield effect(name)


def _drifts(driver, scale, values):
    """Terms that follow a driver."""
    low, high = float(np.min(values)), float(np.max(values))
    # a drift goes on for a while after the run, but not for ever
    reach = 0.5 * (high - low)
    about = {'driver': driver, 'origin': float(np.mean(values)), 'scale': scale,
             'within': [low - reach, high + reach]}
    for of in _DRIFTING:
        yield effect('drift', of=of, **about)
    if driver != 'temperature':
        for of in ('IA', 'IE'):
            yield effect('drift', of=of, power=2, **about)


def _of_axis(axis, place):
    """(driver, what, effects) of one axis, whose stars stand at `place`."""
    yield f'approach_{axis}', f'{AXES[axis]} hysteresis', lambda _: [
        effect('hysteresis', axis=axis, shape=shape) for shape in ('1', 'cosE')]
    yield f'before_{axis}', f'{AXES[axis]} hysteresis with memory', lambda _: [
        effect('hysteresis', axis=axis, shape=shape, memory_deg=memory)
        for shape in ('1', 'cosE') for memory in _MEMORIES]
    yield f'reading_{axis}', f'{AXES[axis]} encoder subdivision', lambda _: [
        effect('subdivision', axis=axis, graduation=graduation, order=order)
        for graduation, period in PERIODS.items() if _spread(place, period) for order in (1, 2)]


def _spread(place, period):
    """Whether the stars lie all over the period: where they do not, the reading moves through it
    by its own error alone, which would then be taken for its cause."""
    return abs(np.mean(np.exp(2j * np.pi / period * np.mod(place, period)))) < 0.8


def _of_columns(context):
    """(driver, what, effects) of the columns that a run may have."""
    clock, unit = ('time', _HOUR) if context.get('time') is not None else ('order', 1.0)
    yield clock, 'drift in time', lambda v: _drifts(clock, unit, v)
    yield 'temperature', 'drift with temperature', lambda v: _drifts('temperature', 1.0, v)
    for axis in AXES:
        yield from _of_axis(axis, context.az if axis == 'az' else context.el)
    yield 'pm_x', 'proper motion', lambda _: [effect('proper_motion')]
    yield 'az_rate', 'latency', lambda _: [effect('latency')]
    yield 'miss_x', 'camera rotation and scale', lambda _: [
        effect('camera', of=of) for of in ('rotation', 'scale')]
    for driver in ('magnitude', 'pier_side'):
        yield driver, driver, lambda v, driver=driver: [
            effect('proportional', axis=axis, driver=driver, origin=float(np.mean(v)))
            for axis in AXES]
    for driver in context.extra():
        yield driver, driver, lambda v, driver=driver: [
            effect('proportional', axis=axis, driver=driver, origin=float(np.mean(v)),
                   scale=float(np.std(v)), pattern=pattern)
            for axis, pattern in (('az', 'sky'), ('az', 'angle'), ('el', 'sky'))]


def _of_site(context):
    """Effects of the site, and why some cannot be tested."""
    effects, untestable = [], []
    if context.latitude is None:
        untestable.append(('clock_or_longitude', 'the latitude of the site is not known'))
    else:
        effects.append(effect('clock', latitude=float(context.latitude)))
    if context.equatorial() is None:
        untestable.append(('annual_aberration, precession_or_epoch_error',
                           'the sidereal time or the latitude is not known'))
    else:
        effects += [effect('annual_aberration'), effect('epoch_error')]
    return effects, untestable


def dictionary(context):
    """All effects that this project knows, with parameters from the run (origins, scales).

    Parameters
    ----------
    context : Context
        Of the run.

    Returns
    -------
    effects : list of Effect
        What can be tested.
    untestable : list of (str, str)
        Effect (or its driver) and the reason why it cannot be tested in this run.
    """
    effects, untestable = _of_site(context)
    effects = [*_directional(), *effects]
    for driver, what, build in _of_columns(context):
        values, reason = context.span(driver)
        if reason:
            untestable.append((what, reason))
        else:
            effects += build(values)
    runs = context.get('run')
    if runs is not None and len(np.unique(runs)) > 1:
        effects += [effect('run_zero', axis=axis, runs=np.unique(runs).tolist()) for axis in AXES]
    return effects, untestable


def steps(context, limit=32):
    """Steps of either zero at every time between two rows (at most `limit` of them).

    Parameters
    ----------
    context : Context
    limit : int

    Returns
    -------
    list of Effect
        The members of two scans; at least three rows on each side. None for several runs
        without times: a place in the order of one run is none in another.
    """
    driver = 'time' if context.get('time') is not None else 'order'
    values, reason = context.span(driver)
    run = context.get('run')
    if reason or (driver == 'order' and run is not None and len(np.unique(run)) > 1):
        return []
    distinct = np.unique(values)
    between = 0.5 * (distinct[1:] + distinct[:-1])[2:-2]
    if len(between) > limit:
        between = between[np.linspace(0, len(between) - 1, limit).round().astype(int)]
    return [effect('step', axis=axis, at=float(t), driver=driver) for axis in AXES for t in between]


__all__ = ['Context', 'Effect', 'PERIODS', 'dictionary', 'effect', 'of_document', 'smooths',
           'steps']
