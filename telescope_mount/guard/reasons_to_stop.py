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

"""Stops axes without readings, without a repeated request, or off their course.

`GuardSettings` has the limits for this, and the way to send commands.
"""

import math
from typing import NamedTuple

from msg_tools.units import DEG

OK, WARN, ERROR = 0, 1, 2
#: why nothing is sent
UNKNOWN = 'where the axes stand is not known: home the mount, or wait for its encoder'
LATE = ('this machine was too slow to send in time: the mount has stopped, and resumes after the '
        'next check')
#: number of usual periods after which an instrument counts as silent
PERIODS = 5.0
#: a moving axis may lag by its motion in this time, s
LAG = 0.5


class GuardSettings(NamedTuple):
    """How a `supervisor.Supervisor` sends commands.

    Attributes
    ----------
    whole : bool
        The checked track is sent at once; nothing is repeated, and silence is ignored.
    ahead : float
        Time from now to the last moving knot of a piece, s.
    silence, commander : float
        Seconds without a reading, or without a repeated request, after which the axes are stopped.
    behind : float
        Largest distance of an axis from its course, rad.
    turn_known : bool
        Whether the first axis reads the turn that it is on.
    asleep : bool
        Time waits for events: a mount that need not move sends no readings.
    """

    whole: bool = True
    ahead: float = 1.5
    silence: float = 0.5
    commander: float = 0.45
    behind: float = 2.0 * DEG
    turn_known: bool = True
    asleep: bool = False


def why_stop(readings, least_silence, requested, astray):
    """Why a moving mount must be stopped now.

    Parameters
    ----------
    readings : AxisReadings
    least_silence : float
        s.
    requested : bool
        Whether the request is still repeated.
    astray : callable
        Returns the result of `off_course` or `off_way`.

    Returns
    -------
    (str, int, str) or None
        New state, severity, and the reason in a sentence.
    """
    quiet = silence(readings, least_silence)
    if quiet:
        return 'stopped', ERROR, (f'no reading of the encoders for {quiet:.1f} s: stopped; '
                                  'look at their driver')
    if not requested:
        return 'stopped', WARN, 'the request is no longer renewed: stopped'
    reason = astray()
    return ('aborted', ERROR, reason) if reason else None


def silence(readings, least):
    """Time without readings, s, if that is too long; else 0."""
    return readings.since if readings.since > max(least, PERIODS * readings.period) else 0.0


def off_course(readings, course, behind, words):
    """Which axis does not go where it was sent, in a sentence; '' for none.

    Parameters
    ----------
    readings : AxisReadings
    course : Course
    behind : float
        Largest distance, rad; a moving axis may lag by more.
    words : sequence of str
        Names of the axes.
    """
    if readings.stamp <= course.start:
        return ''
    for i, word in enumerate(words):
        angle, rate = course.moment(course.seconds(readings.stamp), i)  # at the time of the reading
        off = abs(readings.here[i] - angle)
        if off > behind + LAG * abs(rate):
            return (f'the {word} is {off / DEG:.1f} deg from where it was sent: stopped; '
                    'unless somebody homed it, look at its drive and encoder; then call resume')
    return ''


def off_way(here, ends, behind, axes, words):
    """Which axis is outside the checked way, in a sentence; '' for none.

    Parameters
    ----------
    here : ndarray, shape (2,)
        Present axis angles, rad.
    ends : (ndarray, ndarray), shape (2,)
        Lowest and highest angles of the way, rad.
    behind : float
        Largest distance, rad.
    axes : sequence of limits.Axis
    words : sequence of str
        Names of the axes.
    """
    # near the pole the first axis turns far while the tube hardly moves
    wider = behind / max(abs(math.cos(float(here[1]))), 1e-9), behind
    for angle, least, most, beside, axis, word in zip(
            map(float, here), *ends, wider, axes, words):
        low = max(least - beside, min(least, axis.low) - behind)
        high = min(most + beside, max(most, axis.high) + behind)
        if not low <= angle <= high:
            off = max(least - angle, angle - most)
            return (f'the {word} is at {angle / DEG:.1f} deg, {off / DEG:.1f} deg outside '
                    'the checked path: stopped. Its driver takes another path or the '
                    'other side: check it, then call resume')
    return ''
