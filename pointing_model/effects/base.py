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

"""Definition of an effect, and the registry of forms of effects.

An effect is a group of first-order columns (x, y), encoder - catalogue on the sky, that belong
together physically, and the driver that reveals it. The same object evaluates them for a run (to
detect it) and for a pointing (to correct it). Rows with an unknown driver (NaN, or a missing
column) get zero: drivers are centred, so this is the effect in the middle of the run where it was
found.

A new effect needs a function with `form` that builds it, and a line in its module's
``propose(context, lacking, own)``, which yields an `Offer` that says when it may be tested.
Nothing outside that module changes.

Errors of an axis have the same columns on every mount, in its axis angles. Effects of gravity, air
and stars are converted to them by `Trig.lifted` and `Context.tangent`. A form with the
parameter ``mount`` (a key of `mounts.KINDS`) uses the names of that mount's axes; `dictionary`
fills it in.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from inspect import Parameter, signature

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL

AXES = {'az': 'azimuth', 'el': 'elevation'}
#: effort to check a cause, the cheapest first
EFFORTS = ('settings and files only', 'visual inspection, no disassembly', 'a part must be opened')
#: with fewer rows on a side, a driver of two levels depends on single rows
FEWEST_ON_A_SIDE = 3


@dataclass(frozen=True)
class Amount:
    """Size of an effect in a run, for its sentence.

    Attributes
    ----------
    values : ndarray, shape (k,)
        Coefficients in the effect's unit (arcsec, s, ...).
    rms : float or None
        RMS error on the stars of the run if it is left out of the model, arcsec.
    span : tuple of float or None
        Lowest and highest value of its driver in the run.
    clock : callable or None
        Formats a time (s) as text.
    """

    values: np.ndarray
    rms: float | None = None
    span: tuple | None = None
    clock: Callable | None = None

    @property
    def size(self):
        """Length of the coefficients."""
        return float(np.hypot.reduce(self.values))


@dataclass(frozen=True)
class Effect:
    """One candidate effect.

    Attributes
    ----------
    name : str
        Unique name.
    cause, formula : str
        Cause in plain words; columns (x, y) for each coefficient.
    driver : str
        Driver name in `Context.get`.
    axes : {'az', 'el', 'both'}
        Axes in which it acts.
    coefficient_names : tuple of str, length k
    of : callable
        `Context` -> list of k pairs (x, y); 0.0 is zero everywhere.
    wording : callable, optional
        `Amount` -> sentence that says what goes wrong, without formulas and full stop; by default
        the cause.
    shape : str
        Observed form of the error, whatever its cause, e.g. "a wave of the azimuth, twice per
        turn". By default: a dependence on its driver.
    only_shape : bool
        Whether the shape is the only evidence for the cause, and things outside the dictionary
        make it, too: then it is reported as one possibility only.
    summary : str
        Short cause for lists of alternatives, the same for effects of one cause; by default
        `cause`.
    look_at : str
        What to check on the mount.
    unit : str
        Unit of a coefficient; ``'s'`` and ``'yr'`` are written as that many "arcsec".
    tpoint : str or None
        Names of the same terms in TPOINT.
    requires : tuple of str
        Drivers needed to test it.
    alias : str or None
        Terms that it is identical to, in words.
    mechanism : str or None
        Effects with the same mechanism are one cause, not competitors.
    scan : str or None
        Common name of the members of one scan (unknown time of a step, ...), of which at most
        one is real.
    scanned : float
        Number of scanned parameters: each costs an extra ln n; a choice among few costs less.
    searched : tuple of str
        Names of these parameters: the best member is refined between its neighbours.
    share : str
        A key of `false_alarms.SHARES`, its part of the false-alarm budget: 'dictionary', or
        'scans' for effects tried at many places, widths, periods or lags.
    kind : {'effect', 'smooth', 'known'}
        'smooth': a curve without a cause; 'known': a fixed amount that is not fitted.
    size : tuple of float, optional
        Least and greatest length of the coefficients that physics allows, in its unit: if the
        data need another size, the effect is not offered.
    effort : int
        Effort to check the cause, see `EFFORTS`.
    figure : callable, optional
        `Context` -> (label, values or None) for the abscissa of its plot, if not the driver.
    form : str
        Form that rebuilds it: ``effect(form, **parameters)``. Set by the registry.
    parameters : dict
        JSON values. Set by the registry.
    """

    name: str
    cause: str
    formula: str
    driver: str
    axes: str
    coefficient_names: tuple
    of: Callable = field(compare=False, repr=False)
    wording: Callable | None = field(default=None, compare=False, repr=False)
    look_at: str = ''
    shape: str = ''
    summary: str = ''
    unit: str = 'arcsec'
    tpoint: str | None = None
    requires: tuple = ()
    alias: str | None = None
    mechanism: str | None = None
    scan: str | None = None
    scanned: float = 1
    searched: tuple = ()
    share: str = 'dictionary'
    kind: str = 'effect'
    size: tuple | None = None
    effort: int = 1
    figure: Callable | None = field(default=None, compare=False, repr=False)
    only_shape: bool = False
    form: str = ''
    parameters: dict = field(default_factory=dict)

    def columns(self, context):
        """Design columns.

        Parameters
        ----------
        context : Context
            n rows.

        Returns
        -------
        ndarray, shape (k, 2, n)
            On-sky offset (x, y), encoder - catalogue, for unit coefficients; zero in rows with an
            unknown driver.
        """
        out = np.zeros((len(self.coefficient_names), 2, len(context)))
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            self.fill(out, context)
        return known(out)

    def fill(self, out, context):
        """Write the columns into an array of zeros, without `known`."""
        if all(context.get(name) is not None for name in self.requires):
            for row, (x, y) in zip(out, self.of(context)):
                row[0], row[1] = x, y

    def clause(self, amount):
        """Sentence for a night assistant from an `Amount`, without a full stop."""
        return self.wording(amount) if self.wording else self.cause[:1].upper() + self.cause[1:]

    @property
    def cause_summary(self):
        """`summary`, or the cause."""
        return self.summary or self.cause

    @property
    def is_bump(self):
        """Whether it is local: a scan searches its centre and width."""
        return 'centre' in self.searched

    @property
    def line(self):
        """Its line in a ranking: all members of a scan share one."""
        if self.scan is None:
            return self.name
        p = self.parameters
        return f'{self.form} {self.scan} {p.get("driver")} {p.get("axis")} {p.get("factor")}'


def known(columns):
    """Set columns to zero, in place, for unknown drivers and for cot E on the horizon."""
    return np.nan_to_num(columns, copy=False, nan=0.0, posinf=0.0, neginf=0.0)


# ---------------------------------------------------------------------------------- the registry

_FORMS = {}
_MOUNT = 'mount'


def form(build):
    """Register a function that builds an `Effect` from parameters, under its name."""
    name = build.__name__.lstrip('_')
    named = [(p.name, p.default) for p in signature(build).parameters.values()
             if p.kind is not Parameter.VAR_KEYWORD and p.name != _MOUNT]
    by_mount = _MOUNT in signature(build).parameters

    def made(**parameters):
        if not by_mount or parameters.get(_MOUNT) == USUAL:
            parameters.pop(_MOUNT, None)
        out = build(**parameters)
        # set in place: `replace` would build it twice, and a run has hundreds
        object.__setattr__(out, 'form', name)
        object.__setattr__(out, 'parameters', {
            **{n: parameters.get(n, default) for n, default in named}, **parameters})
        return out
    _FORMS[name] = made
    return build


def effect(form, **parameters):
    """Build an effect from its form and parameters.

    Parameters
    ----------
    form : str
    parameters
        Parameters of the form.

    Returns
    -------
    Effect

    Raises
    ------
    ValueError
        Unknown form, or parameters that do not fit it.
    """
    build = _FORMS.get(form)
    if build is None:
        raise ValueError(f'unknown effect {form!r}; known are {", ".join(sorted(_FORMS))}')
    try:
        return build(**parameters)
    except (TypeError, KeyError, IndexError) as error:
        raise ValueError(f'effect {form} with wrong parameters {parameters}: {error}') from None


def for_mount(effects, mount):
    """The effects with the names of the axes of a mount.

    Parameters
    ----------
    effects : list of Effect
    mount : Mount

    Returns
    -------
    list of Effect
    """
    if mount.vertical:
        return effects
    return [effect(e.form, **{**e.parameters, _MOUNT: mount.kind}) for e in effects]


def to_document(effect):
    """The input of `effect_from_document`: ``family`` (the form) and ``parameters``."""
    return {'family': effect.form, 'parameters': effect.parameters}


def effect_from_document(row):
    """The effect of a JSON entry with ``family`` and ``parameters``."""
    return effect(row['family'], **row['parameters'])


# ------------------------------------------------------------------------- when it may be tried

@dataclass(frozen=True)
class Offer:
    """Effects of one form for a run, or why they cannot be tested in it.

    Attributes
    ----------
    form : str
    effects : list of Effect
    what : str
        Name in words, for the reason.
    reason : str or None
        Why it cannot be tested.
    axis : str
        Axis, if offered per axis.
    """

    form: str
    effects: list
    what: str = ''
    reason: str | None = None
    axis: str = ''


def offer(form, what, context, driver, build, against=None, axis=''):
    """Offer ``build(known values of the driver)``, unless the driver is unusable.

    Parameters
    ----------
    form, what : str
    context : Context
    driver : str
    build : callable
    against : str, optional
        A further reason against it.
    axis : str

    Returns
    -------
    Offer
    """
    values, reason = context.span(driver)
    reason = reason or against
    return Offer(form, [] if reason else build(values), what, reason, axis)


def single_rows(context, driver, low, high):
    """Reason why a driver of two levels is unusable: only single rows have one of them.

    Returns
    -------
    str or None
    """
    values = context.get(driver)
    if values is None:
        return None
    for side in (low, high):
        count = int(np.sum(values == side))
        if count < FEWEST_ON_A_SIDE:
            return f'{context.wording(driver)} is {side:+g} in only {count} of {len(values)} rows'
    return None


def on_axis(axis, value, cos_el):
    """Columns (x, y) for an error of an axis angle: azimuth is multiplied by cos E on the sky."""
    return (value * cos_el, 0.0) if axis == 'az' else (0.0, value)


# ------------------------------------------------------------- words that the sentences share

#: words for drivers whose name is not a word
_DRIVER_WORDS = {'order': 'order of the rows', 'run_hours': 'time since the start of the run',
                 'lst': 'sidereal time', 'pier_side': 'side of the pier', 'run': 'power-on',
                 **{name: words for names, words in (
                     (('approach_az', 'approach_el'), 'direction of approach'),
                     (('travel_az', 'travel_el'), 'way travelled to the star'),
                     (('unwrapped_az', 'unwrapped_el'), 'angle counted in turns'),
                     (('before_az', 'before_el'), 'approach before that'),
                     (('reading_az', 'reading_el'), 'encoder reading'),
                     (('miss_x', 'miss_y'), 'miss distance'), (('az_rate', 'el_rate'), 'rate'),
                     (('pm_x', 'pm_y'), 'proper motion')) for name in names}}
#: words for the last motion of an axis
SIDES = {f'approach_{axis}': dict(zip((-1, 1), words))
         for axis, words in zip(AXES, KINDS[USUAL].sides)}
#: names of the axis angles on any mount: always known
DIRECTION = {key for names in KINDS.values() for key in names.keys}
#: letter of the second angle, by the name of either axis
_LETTERS = {key: names.letters[1] for names in KINDS.values() for key in names.keys}
_TIMES = {1: 'once', 2: 'twice'}


def arcsec(value, sign=False):
    """A value for a sentence, e.g. ``2.70″``."""
    if value is None or not np.isfinite(value):
        return '?'
    digits = 0 if abs(value) >= 99.95 else 1 if abs(value) >= 9.995 else 2
    return f'{value:{"+" if sign else ""}.{digits}f}″'.replace('-', '−')


def times(order):
    """Number of periods per turn in words, e.g. ``twice per turn``."""
    return f'{_TIMES.get(order, f"{order} times")} per turn'


def the(name):
    """A driver in words, with its article: "the elevation", but "time"."""
    word = driver_word(name)
    return word if word in ('time', 'sidereal time') else f'the {word}'


def driver_word(name):
    """A driver in words."""
    return _DRIVER_WORDS.get(name, name.replace('_', ' ') if name in DIRECTION else name)


def readable(name):
    """Name of an effect for people: ``azimuth_encoder_2`` is "azimuth encoder, 2 per turn"."""
    name = re.sub(r'(encoder|wobble|nod|sight)_(\d+)(?=$|_)', r'\1, \2 per turn', str(name))
    curve = re.fullmatch(rf'smooth_of_(.+?)_(az|el|{"|".join(_LETTERS)})_(.+)', name)
    if curve:
        driver, axis, shape = curve.groups()
        axis = {'az': 'azimuth', 'el': 'elevation'}.get(axis, axis)
        name = f'{axis} by a curve of {driver_word(driver)}, {shape}'
        name = name.replace('_cosE', f', × cos {_LETTERS[axis]}')
    elif '_cosE' in name:
        axis = next((key for key in _LETTERS if name.startswith(key)), 'azimuth')
        name = name.replace('_cosE', f', × cos {_LETTERS[axis]}')
    name = re.sub(r'subdivision_(grating|bars)_(\d+)', lambda found: f'subdivision, {found[2]} per '
                  f'{"line" if found[1] == "grating" else "bar"}', name)
    name = re.sub(r'(periodic_error|tape)_([\d.]+)(_time)?(_orders_\d)?(_per_run)?', lambda found: (
        found[1] + (f' in time, {found[2]} per sidereal day' if found[3] else
                    f', {found[2]} {"lines " * (found[1] == "tape")}per turn')
        + (', with harmonics' if found[4] else '')
        + (', another phase in each run' if found[5] else '')), name)
    column = re.fullmatch(r'(.+)_(az|el)(_angle)?', name)
    if column and not curve:  # depends on a column of the file
        driver, axis, angle = column.groups()
        axis = {'az': 'first axis', 'el': 'second axis'}[axis] + (
            ', on the sky,' if axis == 'az' and not angle else '')
        name = f'{axis} following {driver.replace("_equation", "")}'
    name = name.replace('_by_side', ', by side of the pier').replace(
        '_changing_with', ', changing with')
    return re.sub(r'_memory_([\d.]+)deg', r', memory \1°', name).replace('_', ' ')


#: words for names of coefficients that are not words
_COEFFICIENTS = {'half_difference': 'half the difference',
                 'hour_angle': 'hour angle', 'el_cos': 'up and down, cos',
                 'el_sin': 'up and down, sin', 'az_cos': 'left and right, cos',
                 'az_sin': 'left and right, sin'}


def coefficient_word(effect, name):
    """Name of a coefficient of an effect for people."""
    if effect.kind != 'smooth':
        return _COEFFICIENTS.get(name, name)
    if name in ('cos', 'sin'):
        return name
    shape, number = effect.parameters.get('shape'), int(name[1:])
    if shape != 'fourier':
        return {'sawtooth': 'height of a tooth', 'bump': 'height'}.get(shape, f'part {number}')
    order = effect.parameters['orders'][(number - 1) // 2]
    return f'{("sin", "cos")[number % 2]}, {order:g} per period'


def common_shape(shapes, drivers):
    """Common beginning of several shapes; else "a curve" of their drivers.

    Parameters
    ----------
    shapes : sequence of str
    drivers : sequence of str
        Driver of each, the best first.

    Returns
    -------
    str
    """
    parts = []
    for same in zip(*(shape.split(', ') for shape in shapes)):
        if len(set(same)) > 1:
            break
        parts.append(same[0])
    followed = [f'of {the(driver)}' for driver in dict.fromkeys(drivers)]
    return ', '.join(filter(None, parts)) or 'a curve ' + ', '.join(
        [', '.join(followed[:-1])] * (len(followed) > 1)) + ' or ' * (
            len(followed) > 1) + followed[-1]
