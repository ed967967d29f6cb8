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

"""Graduation of an encoder: interpolation errors in a line or bar, and slips by whole ones."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.mount_kinds import KINDS, USUAL

from .base import AXES, Effect, Offer, effect, form, on_axis

_TURN = 2.0 * np.pi
#: lines or bars per turn of the encoders of both papers (000: lines; 001: bars)
_LINES = {'grating': 47200, 'bars': 1080}
#: may be declared; the exact lines of a tape on a drum are searched (`gears_and_worms`)
_KINDS = (*_LINES, 'tape')
#: periods of these, radians
PERIODS = {name: _TURN / lines for name, lines in _LINES.items()}
#: axes by the prefixes of their columns in files
BY_COLUMN = {column: axis for names in KINDS.values() for axis, column in zip(AXES, names.columns)}
_FEWEST, _MOST = 16, 10**7  # allowed number of lines per turn
#: up to this many lines per turn they may be teeth
FEW_LINES = 1000
_ONE = {'grating': 'a line of the grating', 'bars': 'a bar of the disc'}
_EACH = {'grating': 'each line of its grating', 'bars': 'each bar of its disc'}
_ALL = {'grating': 'lines of the grating', 'bars': 'bars of the disc'}


def declared_axis(name, what, names=None):
    """``az`` or ``el`` for the column name of an axis; other words are returned unchanged.

    Parameters
    ----------
    name, what : str
        The word; and the declaration that it is in, for the message.
    names : mount_kinds.MountKind, optional
        Names of the mount: only these are accepted.

    Raises
    ------
    ValueError
        An axis of another mount.
    """
    if names is not None and name in BY_COLUMN and name not in names.columns:
        (first, second), words = names.columns, names.axes
        raise ValueError(f'{what}: {names.words} has no axis {name}; its axes are {first} '
                         f'({words[0]}) and {second} ({words[1]})')
    return BY_COLUMN.get(name, name)


def declared_pairs(given):
    """Name -> value of a text ``name=value, name=value``; a dict is returned unchanged."""
    if not isinstance(given, str):
        return given
    parts = (part.partition('=') for part in given.split(',') if part.strip())
    return {name.strip(): value.strip() for name, _, value in parts}


def number_of(value):
    """A declared number; NaN if it is none."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return np.nan


def declared_graduation(given, names=None):
    """Parse the declared graduation of the encoders.

    Parameters
    ----------
    given : str or dict
        ``grating=47200``: lines per turn, on both axes; ``az.grating=47200, el.bars=1080``: per
        axis. Or a dict of the same names, or an earlier result of this function.
    names : mount_kinds.MountKind, optional
        See `declared_axis`.

    Returns
    -------
    dict of str to dict
        Axis -> name of the graduation -> lines per turn.

    Raises
    ------
    ValueError
        Unknown graduation, unknown axis, or invalid number of lines.
    """
    out = {axis: {} for axis in AXES}
    for name, value in declared_pairs(given).items():
        if name in AXES and isinstance(value, dict):
            value = [(name, kind, lines) for kind, lines in value.items()]
        else:
            axis, _, kind = name.rpartition('.')
            axis = declared_axis(axis, f'graduation {name}={value}', names)
            value = [(one, kind, value) for one in ([axis] if axis else AXES)]
        for axis, kind, lines in value:
            if axis not in AXES or kind not in _KINDS:
                raise ValueError(f'graduation {name!r} is none of {", ".join(_KINDS)} (or '
                                 f'az.{kind}, el.{kind} for one axis), such as grating=47200')
            number = number_of(lines)
            if not (number == np.floor(number) and _FEWEST <= number <= _MOST):
                raise ValueError(f'graduation {name}={lines}: give the whole number of lines or '
                                 f'bars in a turn, {_FEWEST} to {_MOST}, such as grating=47200 '
                                 '(27.4576" each)')
            out[axis][kind] = int(number)
    return out


def period_of(graduation, lines=None):
    """Period of a graduation, radians."""
    return PERIODS[graduation] if lines is None else _TURN / int(lines)


def is_gear(graduation, lines):
    """Whether there are so few lines that gear teeth are a more likely cause."""
    return graduation == 'grating' and lines is not None and lines <= FEW_LINES


@form
def _subdivision(axis, graduation, order, lines=None, mount=USUAL):
    """Interpolation error within a line of the grating or a bar of the disc."""
    names = KINDS[mount]
    k, period = int(order), period_of(graduation, lines)
    reading = f'reading_{axis}'

    def of(c):
        # the period divides the turn, so whole turns do not matter
        phase = np.mod(c.get(reading), period) * (_TURN * k / period)
        return [on_axis(axis, f(phase), c.trig.cos_el) for f in (np.cos, np.sin)]

    def place(c):
        angle = c.get(reading)
        return (f'place within {_ONE[graduation]} [0 to 1]',
                None if angle is None else np.mod(angle, period) / period)

    size = f'({period / ARCSEC:.6g}")'
    # source: paper 000, 400-fold interpolation; paper 001, eq. 12
    return Effect(f'{names.key(axis)}_subdivision_{graduation}_{k}',
                  f'{names.word(axis)} encoder divides {_ONE[graduation]} {size} unevenly, '
                  f'{k} in each',
                  f'cos, sin of 2 pi {k} reading / period', reading, axis, ('cos', 'sin'), of,
                  lambda _: f'The {names.word(axis)} encoder divides {_EACH[graduation]} unevenly',
                  'offset, amplitude and phase of its sine and cosine signals' if graduation ==
                  'grating' else 'focus and illumination of the reading head',
                  f'a wave within {_EACH[graduation]}',
                  requires=(reading,), figure=place)


@form
def _decode_slip(axis, rows, multiples, graduation, lines=None, mount=USUAL):
    """Single rows off by whole bars or lines: known amounts, nothing to predict."""
    names = KINDS[mount]
    step = period_of(graduation, lines)

    def of(c):
        row = c.get('row')
        value = np.zeros(len(c)) if row is None else sum(
            (m * step / ARCSEC) * (row == r) for r, m in zip(rows, multiples))
        return [on_axis(axis, value, c.trig.cos_el)]

    # source: paper 001, eq. 12
    return Effect(f'{names.key(axis)}_decode_slip_{graduation}',
                  f'{names.word(axis)} encoder decoded whole {graduation} beside the true place in '
                  f'{len(rows)} rows', f'multiples of {step / ARCSEC:.4f}"', 'row', axis,
                  ('part',), of,
                  lambda _: f'The {names.word(axis)} encoder was read whole {_ALL[graduation]} '
                  f'beside the true place in {len(rows)} rows',
                  'the images of these rows: dirt on the disc, exposure, blur',
                  kind='known')


def propose(context, lacking, own):
    """If the raw readings are known and spread over the period.

    Uses the declared graduation of an encoder; without one, those of both papers.
    """
    for axis in AXES:
        word = context.mount.names.word(axis)
        what = f'{word} encoder subdivision'
        values, reason = context.span(f'reading_{axis}')
        if reason:
            yield Offer('subdivision', [], what, reason, axis)
            continue
        place = context.az if axis == 'az' else context.el
        declared = context.graduation.get(axis) or dict.fromkeys(PERIODS)
        for graduation, lines in declared.items():
            if graduation not in PERIODS or is_gear(graduation, lines):
                continue  # see `gears_and_worms`: the lines of a tape are searched
            against = _not_spread(word, graduation, place, values, period_of(graduation, lines))
            yield Offer('subdivision', [] if against else [
                effect('subdivision', axis=axis, graduation=graduation, order=order, lines=lines)
                for order in (1, 2)], f'{what} ({graduation})', against, axis)


def _not_spread(word, graduation, place, reading, period):
    """Reason why an interpolation error is not detectable: if only the error itself moves the
    reading through the period, it would be taken for its own cause.
    """
    words = _ALL[graduation]
    if abs(np.mean(np.exp(2j * np.pi / period * np.mod(place, period)))) >= 0.8:
        return f'the stars stand at nearly the same place between two {words}'
    # of evenly spread places half then lie within 3 periods; this finds a few fixed places, too
    count = max(len(reading) // 4, 2)
    turn = np.sort(np.mod(reading, 2.0 * np.pi))
    last = np.append(turn, turn + 2.0 * np.pi)[count - 1:][:len(turn)]
    if np.min(last - turn) <= 1.5 * period:
        return (f'{count} of {len(reading)} readings of {word} lie within 1.5 {words}, '
                'where their noise alone moves them')
    return None
