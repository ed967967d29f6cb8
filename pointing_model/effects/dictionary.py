"""Candidate effects for a run: the dictionary, steps at unknown times, curves for the unknown.

The effects themselves are in `effect_families`. Each comes with its physical cause, its columns on
both axes, the driver that shows it, and its name in TPOINT where it has one.
"""

import numpy as np

from .base import AXES, PERIODS, effect

_HOUR = 3600.0
#: what may drift with time or temperature
_DRIFTING = ('IA', 'IE', 'CA', 'TF', 'tilt')
_MEMORIES = (3.0, 10.0, 30.0)  # degrees
_TERMS = ('refraction', 'refraction_cube', 'second_flexure')
#: terms of which the dictionary has the same columns under another name
_NAMED = ('TX', 'TX3', 'ECES')
_GRADUATIONS = {'grating': 'lines of the grating', 'bars': 'bars of the disc'}
_SIDE = 3  # rows


def _directional(lacking):
    """Effects of the direction alone."""
    for name in lacking:
        if name not in _NAMED:
            yield effect('term', name=name)
    for name in _TERMS:
        yield effect('terms', name=name)
    for axis, highest in (('el', 3), ('az', 6)):
        for order in range(1, highest + 1):
            yield effect('encoder', axis=axis, order=order)
    for name, highest in (('bearing_wobble', 3), ('nod', 6), ('elevation_axis_wobble', 2)):
        if name == 'elevation_axis_wobble' and _instead_of_wobble(lacking):
            continue
        for order in range(1, highest + 1):
            yield effect(name, order=order)
    for name in ('fork_cross_term', 'diurnal_aberration'):
        yield effect(name)
    if 'AN' not in lacking:  # the same columns
        yield effect('latitude')


def _instead_of_wobble(lacking):
    """Constant parts of a wobble of the elevation axis: over a sky of less than a quarter turn
    it would pass for them."""
    return [name for name in ('CA', 'NPAE') if name in lacking]


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


def _of_axis(context, axis):
    """(driver, what, effects, reason against) of one axis."""
    one_sided = _one_sided(context, f'approach_{axis}', -1.0, 1.0)
    yield f'approach_{axis}', f'{AXES[axis]} hysteresis', lambda _: [
        effect('hysteresis', axis=axis, shape=shape) for shape in ('1', 'cosE')], one_sided
    yield f'before_{axis}', f'{AXES[axis]} hysteresis with memory', lambda _: [
        effect('hysteresis', axis=axis, shape=shape, memory_deg=memory)
        for shape in ('1', 'cosE') for memory in _MEMORIES], one_sided
    reading, what = f'reading_{axis}', f'{AXES[axis]} encoder subdivision'
    values, reason = context.span(reading)
    if reason:
        yield reading, what, None, reason
        return
    place = context.az if axis == 'az' else context.el
    for graduation in PERIODS:
        yield reading, f'{what} ({graduation})', lambda _, graduation=graduation: [
            effect('subdivision', axis=axis, graduation=graduation, order=order)
            for order in (1, 2)], _not_spread(axis, graduation, place, values)


def _one_sided(context, driver, low, high):
    """Why a driver of two levels can show nothing: single rows would carry the effect."""
    values = context.get(driver)
    if values is None:
        return None
    for side in (low, high):
        count = int(np.sum(values == side))
        if count < _SIDE:
            return f'{driver} is {side:+g} in only {count} of {len(values)} rows'
    return None


def _not_spread(axis, graduation, place, reading):
    """Why a subdivision cannot be seen: where the reading moves through the period by its own
    error alone, that would be taken for its cause."""
    period, words = PERIODS[graduation], _GRADUATIONS[graduation]
    if abs(np.mean(np.exp(2j * np.pi / period * np.mod(place, period)))) >= 0.8:
        return f'the stars stand at nearly the same place between two {words}'
    # of places spread evenly, half are then within 3 periods; some fixed places are told too
    count = max(len(reading) // 4, 2)
    turn = np.sort(np.mod(reading, 2.0 * np.pi))
    last = np.append(turn, turn + 2.0 * np.pi)[count - 1:][:len(turn)]
    if np.min(last - turn) <= 1.5 * period:
        return (f'{count} of {len(reading)} readings of {AXES[axis]} lie within 1.5 {words}, '
                'where their noise alone moves them')
    return None


def _of_columns(context):
    """(driver, what, effects, reason against) of the columns that a run may have."""
    for driver, what, build, *against in _columns(context):
        values, reason = context.span(driver)
        yield values, what, build, reason or next(iter(against), None)


def _columns(context):
    clock, unit = ('time', _HOUR) if context.get('time') is not None else ('order', 1.0)
    yield clock, 'drift in time', lambda v: _drifts(clock, unit, v)
    if context.several_nights():
        yield 'run_hours', 'drift since the start of each run', lambda v: _drifts(
            'run_hours', 1.0, v)
    yield 'temperature', 'drift with temperature', lambda v: _drifts('temperature', 1.0, v)
    for axis in AXES:
        yield from _of_axis(context, axis)
    yield 'pm_x', 'proper motion', lambda _: [effect('proper_motion')]
    yield 'az_rate', 'latency', lambda _: [effect('latency')]
    yield 'miss_x', 'camera rotation and scale', lambda _: [
        effect('camera', of=of) for of in ('rotation', 'scale')]
    for driver in ('magnitude', 'pier_side'):
        yield driver, driver, lambda v, driver=driver: [
            effect('proportional', axis=axis, driver=driver, origin=float(np.mean(v)))
            for axis in AXES], _one_sided_pier(context) if driver == 'pier_side' else None
    for driver in context.extra():
        yield driver, driver, lambda v, driver=driver: [
            effect('proportional', axis=axis, driver=driver, origin=float(np.mean(v)),
                   scale=float(np.std(v)), pattern=pattern)
            for axis, pattern in (('az', 'sky'), ('az', 'angle'), ('el', 'sky'))]


def _one_sided_pier(context):
    values, reason = context.span('pier_side')
    levels = () if reason else np.unique(values)
    # the middle one of three is unknown
    return _one_sided(context, 'pier_side', levels[0], levels[-1]) if 2 <= len(levels) <= 3 \
        else None


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


def dictionary(context, lacking=(), own=()):
    """All effects that this project knows, with parameters from the run (origins, scales).

    Parameters
    ----------
    context : Context
        Of the run.
    lacking : sequence of str, optional
        Names in `terms.TERMS` of terms that the declared model does not have: candidates too.
    own : sequence of str, optional
        Terms that each run fits for itself. Of several nights, their linear drifts in time are
        the same as those in the time since the start of each run: only the latter, which tell
        another night, are offered.

    Returns
    -------
    effects : list of Effect
        What can be tested.
    untestable : list of (str, str)
        Effect (or its driver) and the reason why it cannot be tested in this run.
    """
    effects, untestable = _of_site(context)
    effects = [*_directional(tuple(lacking)), *effects]
    missing = _instead_of_wobble(lacking)
    if missing:
        untestable.append(('elevation axis wobble', 'it looks like terms that the model lacks: '
                           + ', '.join(missing)))
    for values, what, build, reason in _of_columns(context):
        if reason:
            untestable.append((what, reason))
        else:
            effects += build(values)
    if context.several_nights():
        effects = [e for e in effects if not (
            e.family == 'drift' and e.driver == 'time' and e.parameters['power'] == 1
            and e.parameters['of'] in own)]
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


