"""Cross-check of the encoders of an axis with each other and with the sky.

The sky is Polaris, or stars that were exposed for a zero (`encoder_zeros`). A change of one of the
three shows in two of the three differences between them:

- incremental - sky at Polaris:  I + S
- absolute - sky at Polaris:     B + S
- incremental - absolute:        I - B, at every star, free of the star's noise

with I and B what the encoders read too much and S what the mount (or the star) is off. The
incremental encoder is expected to move at a power-on: its zero on Polaris takes care of that.
Anything else is an alarm. Two equations do not give three unknowns: which of two moved is a
posterior probability, from what is usual for each (all suspects equally likely before) and from
how the stars of the whole sky moved. Inside a power-on: `encoder_jumps`, `count_drift`.
"""

from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.zero import BY_POLARIS, BY_STARS

from .count_drift import SURE, movements
from .cross_check_rows import (
    ABSOLUTE,
    ALIKE,
    AXES,
    BOTH,
    INCREMENTAL,
    MOUNT,
    SHORT,
    USUAL,
    CrossCheckNight,
)
from .encoder_zeros import (
    EncoderZeros,
    StarOffsets,
    comparable,
    difference_at,
    power_on_zeros,
    zero_shift,
)

UNJUDGED = ('the reference marks of the incremental encoder could not be judged: it tells nothing '
            'of them on incremental/homing')
#: counts by which the mark may be off at a later passage
MARK_TOLERANCE = 10
#: from where the marks are to be met
HOME_SIDE = 'below'
_HOUR = 3600.0
_DRIFT_CAUSES = ('electromagnetic interference, a loose connector, dirt on the grating, or a zero '
                 'that moves as it warms')


class Homing(NamedTuple):
    """What the incremental encoder of an axis says of itself and its mark."""

    run: int
    axis: str
    homed: bool
    side: str = ''
    missed_marks: int = 0
    mark_error: float = np.nan  # counts
    count: float = np.nan  # rad
    pulse_width: float = np.nan  # of the data sheet, rad
    supply: float = np.nan  # when the mark was met, V
    temperature: float = np.nan  # likewise, degC
    started: float = np.nan  # when this power-on began, UTC s


def axis_homings(axes, run):
    """`Homing` of each axis.

    Parameters
    ----------
    axes : dict of str to msg_tools.homing.AxisHoming
        By axis, from the last message.
    run : int
        Number of the power-on in the observations.

    Returns
    -------
    list of Homing
    """
    return [Homing(run, axis, *(getattr(one, name) for name in Homing._fields[2:]))
            for axis, one in axes.items()]


def encoder_diagnostics(message, within='/'):
    """Rows of the statuses in a DiagnosticArray that speak of marks, as a list of dict.

    For `diagnostic_homings`. Nodes of another namespace than `within` are of another mount.
    """
    statuses = [{row.key: row.value for row in status.values} for status in message.status
                if status.name.startswith(within)]
    return [values for values in statuses if f'{AXES[0]} homed' in values]


def diagnostic_homings(values, run):
    """`Homing` of both axes from the diagnostics of the encoder's node.

    Logs before `incremental/homing` have nothing else. The rows are for people; nobody may read
    them but for such logs.

    Parameters
    ----------
    values : dict of str to str
        Key and value of the status' rows.
    run : int
        Number of the power-on in the observations.

    Returns
    -------
    list of Homing
        Of the axes that the diagnostics speak of.
    """
    def number(key):
        try:
            return float(values.get(key, 'nan'))
        except ValueError:
            return np.nan
    count = number('resolution [arcsec]') * ARCSEC
    return [
        Homing(run, axis, values[f'{axis} homed'] == 'True',
               values.get(f'{axis} mark met from', ''),
               int(np.nan_to_num(number(f'{axis} missed marks'))),
               number(f'{axis} mark error [counts]'), count,
               number(f'{axis} mark width [arcsec]') * ARCSEC)
        for axis in AXES if f'{axis} homed' in values]


@dataclass
class CrossCheckReport:
    """What the cross-check found.

    Attributes
    ----------
    alarms : list of str
        One line each: axis, who moved, by how much, with what confidence.
    shifts : list of ZeroShift
        From power-on to power-on.
    events : list of EncoderEvent
        Inside power-ons.
    notes : list of str
        What could not be judged.
    latest : EncoderZeros, StarOffsets or None
        Of the newest power-on with a zero: the reference of the next night.
    """

    alarms: list = field(default_factory=list)
    shifts: list = field(default_factory=list)
    events: list = field(default_factory=list)
    notes: list = field(default_factory=list)
    latest: EncoderZeros | StarOffsets | None = None


def cross_check(rows, reference=None, *, model=None, homings=(), budget=USUAL):
    """Compare the encoders with each other and with the sky, through a night.

    Parameters
    ----------
    rows : PointingRun
        Of the night, with ``run``, ``star``, ``time``, ``az_abs``, ``el_abs``. Without the last
        two only what the encoders say of themselves counts.
    reference : PointingRun, EncoderZeros or StarOffsets, optional
        An earlier night, or what `CrossCheckReport.latest` was of it. Without it the first power-on
        with exposures of Polaris is the reference of the others.
    model : PointingModel, optional
        Takes out how the offset differs between two places of Polaris on its circle. Without it
        the terms of `budget` widen the errors.
    homings : iterable of Homing, or None
        What the incremental encoders say of themselves, after they were to be homed; None where
        they say nothing although they should: the report has a note then.
    budget : Budget

    Returns
    -------
    CrossCheckReport

    Raises
    ------
    ValueError
        A column is missing.
    """
    out = CrossCheckReport()
    if homings is None:
        out.notes.append(UNJUDGED)
    out.alarms += [line for homing in homings or () for line in _mark_lines(homing)]
    if 'az_abs' not in rows:
        out.notes.append('no second encoder: nothing to compare with')
    else:
        _compare(out, rows, reference, model, budget)
    for texts in (out.alarms, out.notes):
        texts[:] = map(rows.mount.names.say, texts)
    return out


def _compare(out, rows, reference, model, budget):
    for name in ('run', 'star', 'time', 'el_abs'):
        if name not in rows:
            raise ValueError(f'cross-check of the encoders: observations without column {name}')
    out.alarms += _gap_lines(rows)
    night = CrossCheckNight(rows, reference)
    found = movements(night, model, budget, out.notes)
    out.events = found.events
    out.alarms += [_walk_line(event, int(np.count_nonzero(night.run >= 0.0)))
                   if event.kind == 'walk' else _event_line(event) for event in out.events]
    noise = night.noise(found.sky, found.events)
    zeros = power_on_zeros(night, noise, model)
    if isinstance(reference, EncoderZeros | StarOffsets):
        zeros.insert(0, replace(reference, run=-1.0))
    pairs = [pair for pair in zip(zeros, zeros[1:]) if pair[1].run >= 0.0]
    for pair in pairs:
        try:
            before, now = comparable(*pair)
        except ValueError as err:
            out.notes.append(f'{_interval_name(pair[0].run)} and {_interval_name(pair[1].run)} '
                             f'were not compared against the sky: {err}')
            continue
        for axis in (0, 1):
            shift = zero_shift(night, axis, before, now, model, budget, 2 * len(pairs), found.sky)
            out.shifts.append(shift)
            if shift.alarm and not _is_known(shift, out.events):
                out.alarms.append(_shift_line(shift))
    out.alarms += _uncalibrated_lines(night, zeros, budget, noise)
    out.latest = zeros[-1] if zeros else None


def _is_known(shift, events):
    """Whether a jump inside a power-on of the incremental encoder was found as such."""
    return shift.since // 1 == shift.run // 1 and any(
        event.axis == shift.axis and event.run == shift.run // 1 for event in events)


# --- wording --------------------------------------------------------------------------------------


def _mark_lines(homing):
    where = f'{homing.axis}: {INCREMENTAL}, power-on {homing.run}'
    if not homing.homed:
        missed = f', missed {homing.missed_marks} times (pulse too short)'
        yield (f'{where}: reference mark not met{missed * bool(homing.missed_marks)}: it has no '
               'zero (confidence 1.00, by its own report)')
    elif homing.side and homing.side != HOME_SIDE:
        width = -homing.pulse_width / ARCSEC
        amount = f' {width:+.2f} arcsec,' if np.isfinite(width) else ''
        yield (f'{where}: homed from {homing.side}, not from {HOME_SIDE}: its zero differs by'
               f'{amount} the width of the index pulse (confidence 1.00, by its own report)')
    if abs(homing.mark_error) > MARK_TOLERANCE:
        amount = homing.mark_error * homing.count / ARCSEC
        yield (f'{where}: off by {homing.mark_error:+.0f} counts ({amount:+.2f} arcsec) at the '
               'reference mark: counts lost, or the mark moved (confidence 1.00, by its own '
               'report)')


def _gap_lines(rows):
    """An encoder that gave no angle."""
    for encoder, name in (('enc', INCREMENTAL), ('abs', ABSOLUTE)):
        for axis, short in zip(AXES, SHORT):
            bad = np.count_nonzero(~np.isfinite(rows[f'{short}_{encoder}']))
            if bad:
                why = ': reference mark not met' if encoder == 'enc' else ''
                yield (f'{axis}: {name} gave no angle in {bad} of {len(rows)} '
                       f'observations{why} (confidence 1.00)')


def _uncalibrated_lines(night, zeros, budget, noise):
    """Power-ons of tonight after a calibrated one that have no zero of their own."""
    known = [one for one in zeros if one.run >= 0.0]
    for run in night.tonight:
        before, rows = [one for one in known if one.run < run], night.run == run
        if not before or any(one.run // 1 == run for one in known) or np.count_nonzero(rows) < 2:
            continue
        since, last, way = _utc(night.rows['time'][rows][0]), before[-1], BY_POLARIS
        if isinstance(last, StarOffsets):
            # the difference at a place like that of Polaris
            at, way = night.interval == last.run, BY_STARS
            last = last.zeros(last.star)
            there = [difference_at(night, axis, at, (last.az, last.el)[axis], noise)
                     for axis in (0, 1)]
        else:
            there = list(zip(last.difference, last.difference_sigma))
        for axis in (0, 1):
            value, sigma = difference_at(night, axis, rows, (last.az, last.el)[axis], noise)
            moved = wrap(value - there[axis][0])
            sigma = np.sqrt(sigma**2 + there[axis][1] ** 2 + budget.absolute**2)
            yield (f'{AXES[axis]}: {INCREMENTAL} began power-on {run:.0f} at {since} '
                   f'and has no zero on {way} since: moved by {moved / ARCSEC:+.2f} +- '
                   f'{sigma / ARCSEC:.2f} arcsec by the {ABSOLUTE} (confidence 1.00)')


def _utc(time):
    return datetime.fromtimestamp(time, timezone.utc).strftime('%H:%M:%S UTC')


def _interval_name(run):
    if run < 0:
        return 'the reference night'
    later = round(run % 1 * 100)
    return f'power-on {run // 1:.0f}' + (
        f', {later} of the {ABSOLUTE} later' if later else '')


def _event_line(event):
    rate = event.kind == 'drift'
    scale = _HOUR / ARCSEC if rate else 1.0 / ARCSEC
    unit = 'arcsec an hour' if rate else 'arcsec'
    verb = 'drifts' if rate else f'moved at {_utc(event.time)}'
    second = (f' (the incremental one), {event.second * scale:+.2f} +- '
              f'{event.second_sigma * scale:.2f} {unit} (the absolute one)'
              if event.moved == BOTH else '')
    return (f'{event.axis}: {event.moved} {verb} inside power-on {event.run:.0f} by '
            f'{event.amount * scale:+.2f} +- {event.sigma * scale:.2f} {unit}{second} '
            f'(confidence {event.confidence:.2f}, by chance {event.probability:.1g})')


def _walk_line(event, rows):
    """`rows`: in how many it walked."""
    size = f'by {abs(event.amount) / ARCSEC:.2f} arcsec within {rows} rows'
    trust = f'(confidence {event.confidence:.2f}, by chance {event.probability:.1g})'
    if event.moved != INCREMENTAL:
        whose = '' if event.confidence >= SURE else ', or that against it: the stars do not tell'
        return f'{event.axis}: {ABSOLUTE} drifts against the incremental one{whose}, {size} {trust}'
    remedy = ('its zero follows the other' if event.confidence >= SURE else
              'the stars do not tell which of the two it is: nothing follows')
    return (f'{event.axis}: {INCREMENTAL}: the counts of the {event.axis} encoder drift against '
            f'the absolute encoder, {size}: {_DRIFT_CAUSES}; {remedy} {trust}')


def count_drift_line(axis):
    """Why a zero follows, for the notes of a diagnosis; `axis` in words."""
    return (f'the counts of the {axis} encoder drift against the absolute encoder: '
            f'{_DRIFT_CAUSES}; the zero of this axis follows the absolute encoder, and rows are '
            'taken so')


def _shift_line(shift):
    amount = f'{shift.absolute / ARCSEC:+.2f} +- {shift.absolute_sigma / ARCSEC:.2f} arcsec'
    when = f'between {_interval_name(shift.since)} and {_interval_name(shift.run)}'
    if shift.cause == ALIKE:
        return (f'{shift.axis}: {ALIKE} moved by {amount} {when}: both encoders show it alike, as '
                f'they would if the mount turned about this axis (confidence '
                f'{shift.causes[ALIKE]:.2f}, by chance {shift.probability:.1g})')
    who, other = (MOUNT, ABSOLUTE) if shift.cause == MOUNT else (ABSOLUTE, MOUNT)
    also = (f', the {INCREMENTAL} by {shift.incremental / ARCSEC:+.2f} +- '
            f'{shift.incremental_sigma / ARCSEC:.2f}' if shift.cause == BOTH else '')
    return (f'{shift.axis}: {who} moved by {amount} {when}{also}: the zeros by {shift.by} and by '
            f'the {ABSOLUTE} disagree (confidence {shift.moved[who]:.2f}, {other} '
            f'{shift.moved[other]:.2f}, by chance {shift.probability:.1g})')
