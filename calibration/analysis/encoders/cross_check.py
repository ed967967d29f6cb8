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

"""Cross-check of the encoders of an axis with each other and with the sky.

The sky is Polaris, or stars that were exposed for a zero (`encoder_zeros`). A change of one of the
three shows in two of the three differences between them:

- incremental - sky at Polaris:  I + S
- absolute - sky at Polaris:     B + S
- incremental - absolute:        I - B, at every star, free of the star's noise

with I and B the reading errors of the encoders and S the error of the mount (or the star). The
incremental encoder is expected to move at a power-on: its zero on Polaris takes care of that.
Anything else is an alarm. Two equations do not determine three unknowns: which of two moved is a
posterior probability (with equal priors), from the usual changes of each and from the stars of the
whole sky. Inside a power-on: `encoder_jumps`, `count_drift`.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.zero import BY_POLARIS, BY_STARS

from ..finding import Finding
from .count_drift import movements
from .cross_check_rows import (
    ABSOLUTE,
    AXES,
    INCREMENTAL,
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

#: largest error of the mark at a later passage, counts
MARK_TOLERANCE = 10
#: side from which the marks should be met
HOME_SIDE = 'below'


class Homing(NamedTuple):
    """Report of the incremental encoder of an axis on itself and its mark."""

    run: int
    axis: str
    homed: bool
    side: str = ''
    missed_marks: int = 0
    mark_error: float = np.nan  # counts
    count: float = np.nan  # rad
    pulse_width: float = np.nan  # from the data sheet, rad
    supply: float = np.nan  # when the mark was met, V
    temperature: float = np.nan  # likewise, degC
    started: float = np.nan  # when this power-on began, UTC s


def axis_homings(axes, run):
    """`Homing` of each axis.

    Parameters
    ----------
    axes : dict of str to msg_tools.homing.AxisHoming
        From the last message, by axis.
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
    """Result of the cross-check.

    Attributes
    ----------
    alarms : list of Finding
        Axis, what moved, how far, with what confidence.
    shifts : list of ZeroShift
        Changes between power-ons.
    events : list of EncoderEvent
        Motions inside power-ons.
    notes : list of Finding
        Comparisons that were not possible.
    latest : EncoderZeros, StarOffsets or None
        Zeros of the newest power-on with any: the reference of the next night.
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
        Rows of the night, with ``run``, ``star``, ``time``, ``az_abs``, ``el_abs``. Without the
        last two only the encoders' own reports are checked.
    reference : PointingRun, EncoderZeros or StarOffsets, optional
        An earlier night, or its `CrossCheckReport.latest`. Without it the first power-on with
        exposures of Polaris is the reference of the others.
    model : PointingModel, optional
        Corrects for different positions of Polaris on its circle. Without it the terms of `budget`
        widen the errors.
    homings : iterable of Homing, or None
        Reports of the incremental encoders after homing; None if they are missing although
        expected, which adds a note.
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
        out.notes.append(Finding('marks unknown'))
    out.alarms += [found for homing in homings or () for found in _mark_findings(homing)]
    if 'az_abs' not in rows:
        out.notes.append(Finding('no second encoder'))
    else:
        _compare(out, rows, reference, model, budget)
    return out


def _compare(out, rows, reference, model, budget):
    for name in ('run', 'star', 'time', 'el_abs'):
        if name not in rows:
            raise ValueError(f'cross-check of the encoders: observations without column {name}')
    out.alarms += _gap_findings(rows)
    night = CrossCheckNight(rows, reference)
    found = movements(night, model, budget, out.notes)
    out.events = found.events
    rows_of_night = int(np.count_nonzero(night.run >= 0.0))
    out.alarms += [Finding('counts drift' if event.kind == 'walk' else 'encoder moved', evidence={
        'event': event, 'rows': rows_of_night}) for event in out.events]
    noise = night.noise(found.sky, found.events)
    zeros = power_on_zeros(night, noise, model)
    if isinstance(reference, EncoderZeros | StarOffsets):
        zeros.insert(0, replace(reference, run=-1.0))
    pairs = [pair for pair in zip(zeros, zeros[1:]) if pair[1].run >= 0.0]
    for pair in pairs:
        try:
            before, now = comparable(*pair)
        except ValueError as err:
            out.notes.append(Finding('power-ons not compared', evidence={
                'pair': [one.run for one in pair], 'why': str(err)}))
            continue
        for axis in (0, 1):
            shift = zero_shift(night, axis, before, now, model, budget, 2 * len(pairs), found.sky)
            out.shifts.append(shift)
            if shift.alarm and not _is_known(shift, out.events):
                out.alarms.append(Finding('zeros disagree', evidence={'shift': shift}))
    out.alarms += _power_ons_without_zero(night, zeros, budget, noise)
    out.latest = zeros[-1] if zeros else None


def _is_known(shift, events):
    """Whether a shift within one power-on of the incremental encoder was found as an event."""
    return shift.since // 1 == shift.run // 1 and any(
        event.axis == shift.axis and event.run == shift.run // 1 for event in events)


def _mark_findings(homing):
    """Findings on the mark of an incremental encoder."""
    if not homing.homed:
        yield Finding('reference mark not met', evidence={'homing': homing})
    elif homing.side and homing.side != HOME_SIDE:
        yield Finding('homed from the other side', evidence={'homing': homing})
    if abs(homing.mark_error) > MARK_TOLERANCE:
        yield Finding('counts lost at the mark', homing.mark_error, unit='counts',
                      evidence={'homing': homing})


def _gap_findings(rows):
    """Findings on encoders without an angle in some rows."""
    for encoder, name in (('enc', INCREMENTAL), ('abs', ABSOLUTE)):
        for axis, short in zip(AXES, SHORT):
            bad = np.count_nonzero(~np.isfinite(rows[f'{short}_{encoder}']))
            if bad:
                yield Finding('encoder without angle', bad, unit='rows', evidence={
                    'axis': axis, 'encoder': name, 'rows': len(rows)})


def _power_ons_without_zero(night, zeros, budget, noise):
    """Findings on power-ons of tonight without a zero, after one with a zero."""
    known = [one for one in zeros if one.run >= 0.0]
    for run in night.tonight:
        before, rows = [one for one in known if one.run < run], night.run == run
        if not before or any(one.run // 1 == run for one in known) or np.count_nonzero(rows) < 2:
            continue
        since, last, way = night.rows['time'][rows][0], before[-1], BY_POLARIS
        if isinstance(last, StarOffsets):
            # the difference at the mean position of the stars, as for Polaris
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
            yield Finding('power-on without zero', moved / ARCSEC, sigma / ARCSEC, evidence={
                'axis': AXES[axis], 'run': run, 'since': since, 'way': way})
