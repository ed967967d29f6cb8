"""Three witnesses of an axis: the sky, the incremental and the absolute encoder.

The sky is Polaris, or stars that were exposed for a zero (`witness_stars`).

A change of one of them shows in two of the three differences between them:

- incremental - sky at Polaris:  I + S
- absolute - sky at Polaris:     B + S
- incremental - absolute:        I - B, at every star, free of the star's noise

with I and B what the encoders read too much and S what the mount (or the star) is off. The
incremental encoder is expected to move at a power-on: its zero on Polaris takes care of that.
Anything else is an alarm. Two equations do not give three unknowns: which of two moved is a
posterior probability, from what is usual for each (all suspects equally likely before) and from
how the stars of the whole sky moved. The causes of a jump are told apart in `witness_causes`.
"""

from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.zero_exposures import BY_POLARIS, BY_STARS

from .count_drift import moved_inside, wander_line
from .cross_check_night import AXES, SHORT, CrossCheckNight
from .cross_check_records import USUAL, Witness
from .cross_check_stars import StarsSeen, compared
from .jump_causes import ABSOLUTE, ALIKE, BOTH, INCREMENTAL, MOUNT

UNJUDGED = ('the reference marks of the incremental encoder could not be judged: it tells nothing '
            'of them on incremental/homing')
#: counts by which the mark may be off at a later passage
MARK_TOLERANCE = 10
#: from where the marks are to be met
HOME_SIDE = 'below'
_HOUR = 3600.0


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


def homings_of(axes, run):
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
    return [Homing(run, axis, told.homed, told.side, told.missed_marks, told.mark_error,
                   told.count, told.pulse_width, told.supply, told.temperature,
                   told.started)
            for axis, told in axes.items()]


def encoder_diagnostics(message, within='/'):
    """Rows of the statuses in a DiagnosticArray that speak of marks, as a list of dict.

    For `homings_from_diagnostics`. Nodes of another namespace than `within` are of another mount.
    """
    told = [{row.key: row.value for row in status.values} for status in message.status
            if status.name.startswith(within)]
    return [values for values in told if f'{AXES[0]} homed' in values]


def homings_from_diagnostics(values, run):
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
class WitnessReport:
    """What the witnesses say.

    Attributes
    ----------
    alarms : list of str
        One line each: axis, witness, by how much, with what confidence.
    changes : list of Change
    events : list of Event
    notes : list of str
        What could not be judged.
    latest : Witness, StarsSeen or None
        Of the newest power-on with a zero: the reference of the next night.
    """

    alarms: list = field(default_factory=list)
    changes: list = field(default_factory=list)
    events: list = field(default_factory=list)
    notes: list = field(default_factory=list)
    latest: Witness | None = None


def check_witnesses(rows, reference=None, *, model=None, homings=(), budget=USUAL):
    """Compare the three witnesses of a night.

    Parameters
    ----------
    rows : PointingRun
        Of the night, with ``run``, ``star``, ``time``, ``az_abs``, ``el_abs``. Without the last
        two the encoders are only heard.
    reference : PointingRun, Witness or StarsSeen, optional
        An earlier night, or what `WitnessReport.latest` said of it. Without it the first power-on
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
    WitnessReport

    Raises
    ------
    ValueError
        A column is missing.
    """
    out = WitnessReport()
    if homings is None:
        out.notes.append(UNJUDGED)
        homings = ()
    _hear_encoders(out, homings)
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
            raise ValueError(f'witnesses: observations without column {name}')
    _hear_gaps(out, rows)
    night = CrossCheckNight(rows, reference)
    found = moved_inside(night, model, budget, out.notes)
    out.events, sky = [jump.event for jump in found.jumps], found.sky
    out.alarms += [wander_line(event, int(np.count_nonzero(night.run >= 0.0)))
                   if event.kind == 'wander' else _event_line(event) for event in out.events]

    memory = night.memory(sky, found.jumps)
    witnesses = night.witnesses(memory, model)
    if isinstance(reference, Witness | StarsSeen):
        witnesses.insert(0, replace(reference, run=-1.0))
    pairs = [pair for pair in zip(witnesses, witnesses[1:]) if pair[1].run >= 0.0]
    for pair in pairs:
        try:
            before, now = compared(*pair)
        except ValueError as err:
            out.notes.append(f'{_named(pair[0].run)} and {_named(pair[1].run)} were not compared '
                             f'against the sky: {err}')
            continue
        circle = night.circle(before, now, model, budget)
        for axis in (0, 1):
            change = night.change(axis, before, now, circle, budget, 2 * len(pairs), sky)
            out.changes.append(change)
            if change.alarm and not _told(change, out.events):
                out.alarms.append(_change_line(change))
    _uncalibrated(out, night, witnesses, budget, memory)
    out.latest = witnesses[-1] if witnesses else None


# --- words ----------------------------------------------------------------------------------------


def _hear_encoders(out, homings):
    for h in homings:
        where = f'{h.axis}: {INCREMENTAL}, power-on {h.run}'
        if not h.homed:
            missed = f', missed {h.missed_marks} times (pulse too short)' * bool(h.missed_marks)
            out.alarms.append(f'{where}: reference mark not met{missed}: it has no zero '
                              '(confidence 1.00, by its own report)')
        elif h.side and h.side != HOME_SIDE:
            width = -h.pulse_width / ARCSEC
            amount = f' {width:+.2f} arcsec,' if np.isfinite(width) else ''
            out.alarms.append(
                f'{where}: homed from {h.side}, not from {HOME_SIDE}: its zero differs by{amount} '
                'the width of the index pulse (confidence 1.00, by its own report)')
        if abs(h.mark_error) > MARK_TOLERANCE:
            amount = h.mark_error * h.count / ARCSEC
            out.alarms.append(
                f'{where}: off by {h.mark_error:+.0f} counts ({amount:+.2f} arcsec) at the '
                'reference mark: counts lost, or the mark moved (confidence 1.00, by its own '
                'report)')


def _hear_gaps(out, rows):
    """An encoder that gave no angle."""
    for encoder, name in (('enc', INCREMENTAL), ('abs', ABSOLUTE)):
        for axis, short in zip(AXES, SHORT):
            bad = np.count_nonzero(~np.isfinite(rows[f'{short}_{encoder}']))
            if bad:
                why = ': reference mark not met' if encoder == 'enc' else ''
                out.alarms.append(f'{axis}: {name} gave no angle in {bad} of {len(rows)} '
                                  f'observations{why} (confidence 1.00)')


def _uncalibrated(out, night, witnesses, budget, memory):
    """Power-ons of tonight after a calibrated one that have no zero of their own."""
    known = [w for w in witnesses if w.run >= 0.0]
    for run in night.tonight:
        before = [w for w in known if w.run < run]
        rows = night.run == run
        if not before or any(w.run // 1 == run for w in known) or np.count_nonzero(rows) < 2:
            continue
        since = _utc(night.rows['time'][rows][0])
        last, way = before[-1], BY_POLARIS
        if isinstance(last, StarsSeen):
            last, way = _anywhere(night, last, memory), BY_STARS
        for axis in (0, 1):
            value, sigma = night.apart_at(axis, rows, (last.az, last.el)[axis],
                                          memory.apart[axis])
            moved = wrap(value - last.apart[axis])
            sigma = np.sqrt(sigma**2 + last.apart_sigma[axis] ** 2 + budget.absolute**2)
            out.alarms.append(
                f'{AXES[axis]}: {INCREMENTAL} began power-on {run:.0f} at {since} '
                f'and has no zero on {way} since: moved by {moved / ARCSEC:+.2f} +- '
                f'{sigma / ARCSEC:.2f} arcsec by the {ABSOLUTE} (confidence 1.00)')


def _anywhere(night, seen, memory):
    """The witness of stars, with the encoders' difference at a place like that of Polaris."""
    out = seen.witness(seen.star)
    apart = [night.apart_at(axis, night.stretch == seen.run, (out.az, out.el)[axis],
                            memory.apart[axis]) for axis in (0, 1)]
    return replace(out, apart=np.array([value for value, _ in apart]),
                   apart_sigma=np.array([sigma for _, sigma in apart]))


def _utc(time):
    return datetime.fromtimestamp(time, timezone.utc).strftime('%H:%M:%S UTC')


def _told(change, events):
    """Whether a jump inside a power-on of the incremental encoder was found as such."""
    return change.since // 1 == change.run // 1 and any(
        event.axis == change.axis and event.run == change.run // 1 for event in events)


def _named(run):
    """A power-on by `Witness.run`, in words."""
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


def _change_line(change):
    amount = f'{change.absolute / ARCSEC:+.2f} +- {change.absolute_sigma / ARCSEC:.2f} arcsec'
    when = f'between {_named(change.since)} and {_named(change.run)}'
    if change.cause == ALIKE:
        return (f'{change.axis}: {ALIKE} moved by {amount} {when}: both encoders show it alike, as '
                f'they would if the mount turned about this axis (confidence '
                f'{change.causes[ALIKE]:.2f}, by chance {change.probability:.1g})')
    who, other = (MOUNT, ABSOLUTE) if change.cause == MOUNT else (ABSOLUTE, MOUNT)
    also = (f', the {INCREMENTAL} by {change.incremental / ARCSEC:+.2f} +- '
            f'{change.incremental_sigma / ARCSEC:.2f}' if change.cause == BOTH else '')
    return (f'{change.axis}: {who} moved by {amount} {when}{also}: the zeros by {change.by} and by '
            f'the {ABSOLUTE} disagree (confidence {change.moved[who]:.2f}, {other} '
            f'{change.moved[other]:.2f}, by chance {change.probability:.1g})')
