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

"""Words for the cross-check of the encoders: what moved, how far, and how sure that is."""

from datetime import datetime, timezone

import numpy as np

from calibration.analysis.encoders.cross_check import HOME_SIDE
from calibration.analysis.encoders.cross_check_rows import (
    ABSOLUTE,
    ALIKE,
    BOTH,
    FEWEST_STARS,
    INCREMENTAL,
    MOUNT,
)
from calibration.analysis.encoders.zero_following import SURE
from msg_tools.units import ARCSEC

MARKS_UNKNOWN = ('reference marks of the incremental encoder unknown: nothing on '
                 'incremental/homing')
_HOUR = 3600.0
_DRIFT_CAUSES = ('electromagnetic interference, a loose connector, dirt on the grating, or a zero '
                 'that moves as it warms')
_BY_ITSELF = '(confidence 1.00, by its own report)'


def _place(homing):
    return f'{homing.axis}: {INCREMENTAL}, power-on {homing.run}'


def _mark_not_met(found):
    homing = found['homing']
    missed = f', missed {homing.missed_marks} times (pulse too short)'
    return (f'{_place(homing)}: reference mark not met{missed * bool(homing.missed_marks)}: it has '
            f'no zero {_BY_ITSELF}')


def _other_side(found):
    homing = found['homing']
    width = -homing.pulse_width / ARCSEC
    amount = f' {width:+.2f} arcsec,' if np.isfinite(width) else ''
    return (f'{_place(homing)}: homed from {homing.side}, not from {HOME_SIDE}: its zero differs '
            f'by{amount} the width of the index pulse {_BY_ITSELF}')


def _counts_lost(found):
    homing = found['homing']
    amount = homing.mark_error * homing.count / ARCSEC
    return (f'{_place(homing)}: off by {homing.mark_error:+.0f} counts ({amount:+.2f} arcsec) at '
            f'the reference mark: counts lost, or the mark moved {_BY_ITSELF}')


def _no_angle(found):
    why = ': reference mark not met' if found['encoder'] == INCREMENTAL else ''
    return (f'{found["axis"]}: {found["encoder"]} gave no angle in {found.size} of '
            f'{found["rows"]} observations{why} (confidence 1.00)')


def _utc(time):
    return datetime.fromtimestamp(time, timezone.utc).strftime('%H:%M:%S UTC')


def _interval_name(run):
    if run < 0:
        return 'the reference night'
    later = round(run % 1 * 100)
    return f'power-on {run // 1:.0f}' + (
        f', {later} of the {ABSOLUTE} later' if later else '')


def _encoder_moved(found):
    event = found['event']
    rate = event.kind == 'drift'
    scale = _HOUR / ARCSEC if rate else 1.0 / ARCSEC
    unit = 'arcsec an hour' if rate else 'arcsec'
    verb = 'drifts' if rate else f'moved at {_utc(event.time)}'
    second = (f' (the incremental one), {event.second * scale:+.2f} +- '
              f'{event.second_sigma * scale:.2f} {unit} (the absolute one)'
              if event.moved == BOTH else '')
    return (f'{event.axis}: {event.moved} {verb} inside power-on {event.run:.0f} by '
            f'{event.amount * scale:+.2f} +- {event.sigma * scale:.2f} {unit}{second} '
            f'(confidence {event.confidence:.2f}, {_beside_slow(event)})')


def _beside_slow(event):
    """Likelihood ratio of an event to a slow change: its p-value is for noise alone."""
    slow = 'a disc that turns or shifts' if event.kind == 'drift' else 'a slow change'
    if event.lead >= 2.0 * np.log(_VERY):
        return f'likelihood ratio to {slow} above {_VERY:.0f}'
    return f'likelihood ratio to {slow} {float(f"{np.exp(0.5 * event.lead):.1g}"):.0f}'


def _counts_drift(found):
    event, rows = found['event'], found['rows']
    size = f'by {abs(event.amount) / ARCSEC:.2f} arcsec within {rows} rows'
    trust = f'(confidence {event.confidence:.2f}, by chance {event.probability:.1g})'
    if event.moved != INCREMENTAL:
        whose = '' if event.confidence >= SURE else ', or that against it: undetermined'
        return f'{event.axis}: {ABSOLUTE} drifts against the incremental one{whose}, {size} {trust}'
    remedy = ('its zero follows the other' if event.confidence >= SURE else
              'the stars cannot distinguish the two: no zero is corrected')
    return (f'{event.axis}: {INCREMENTAL}: the counts of the {event.axis} encoder drift against '
            f'the absolute encoder, {size}: {_DRIFT_CAUSES}; {remedy} {trust}')


def count_drift_line(axis):
    """Why a zero is corrected by the absolute encoder, for a diagnosis; `axis` in words."""
    return (f'the counts of the {axis} encoder drift against the absolute encoder: '
            f'{_DRIFT_CAUSES}. The zero of this axis is corrected by the absolute encoder')


def _zeros_disagree(found):
    shift = found['shift']
    amount = f'{shift.absolute / ARCSEC:+.2f} +- {shift.absolute_sigma / ARCSEC:.2f} arcsec'
    when = f'between {_interval_name(shift.since)} and {_interval_name(shift.run)}'
    if shift.cause == ALIKE:
        return (f'{shift.axis}: {ALIKE} moved by {amount} {when} on both encoders, as if the mount '
                f'turned about this axis (confidence {shift.causes[ALIKE]:.2f}, by chance '
                f'{shift.probability:.1g})')
    who, other = (MOUNT, ABSOLUTE) if shift.cause == MOUNT else (ABSOLUTE, MOUNT)
    also = (f', the {INCREMENTAL} by {shift.incremental / ARCSEC:+.2f} +- '
            f'{shift.incremental_sigma / ARCSEC:.2f}' if shift.cause == BOTH else '')
    return (f'{shift.axis}: {who} moved by {amount} {when}{also}: the zeros by {shift.by} and by '
            f'the {ABSOLUTE} disagree (confidence {shift.moved[who]:.2f}, {other} '
            f'{shift.moved[other]:.2f}, by chance {shift.probability:.1g})')


def _not_compared(found):
    before, after = map(_interval_name, found['pair'])
    return f'{before} and {after} were not compared against the sky: {found["why"]}'


#: largest likelihood ratio that is given as a number
_VERY = 1000.0
_SLOW = {'disc turns': 'a disc that turns on its hub through the night',
         'disc shifts': 'a disc that moves off its axis little by little',
         'zero drifts slowly': 'a zero that moves slowly'}

KINDS = {
    'no jump': lambda found: (
        f'{found["axis"]}: nothing jumped: {_SLOW[found["slow"]]} explains the rows as well'),
    'marks unknown': lambda found: MARKS_UNKNOWN,
    'no second encoder': lambda found: 'no second encoder: nothing to compare with',
    'few stars for the sky': lambda found: (
        f'fewer than {FEWEST_STARS} stars: the sky is known by Polaris alone'),
    'sky not fitted': lambda found: f'sky not fitted: {found["why"]}',
    'power-ons not compared': _not_compared,
    'reference mark not met': _mark_not_met,
    'homed from the other side': _other_side,
    'counts lost at the mark': _counts_lost,
    'encoder without angle': _no_angle,
    'power-on without zero': lambda found: (
        f'{found["axis"]}: {INCREMENTAL} began power-on {found["run"]:.0f} at '
        f'{_utc(found["since"])} and has no zero on {found["way"]} since: moved by '
        f'{found.size:+.2f} +- {found.sigma:.2f} arcsec by the {ABSOLUTE} (confidence 1.00)'),
    'encoder moved': _encoder_moved,
    'counts drift': _counts_drift,
    'zeros disagree': _zeros_disagree,
}


def cross_check_texts(findings, names):
    """Sentences with the axes of a mount.

    Parameters
    ----------
    findings : list of Finding
        Findings of a `CrossCheckReport`.
    names : AxisNames
        Axis names of the mount.
    """
    return [names.translate(KINDS[found.kind](found)) for found in findings]
