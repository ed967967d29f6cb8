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

"""Stops axes when nothing is read, nobody asks, or they do not go where they were sent.

`GuardSettings` have after how long and how far off, and how commands are sent.
"""

import math
from typing import NamedTuple

from msg_tools.units import DEG

OK, WARN, ERROR = 0, 1, 2
#: why nothing is sent
UNKNOWN = 'where the axes stand is not known: home the mount, or wait for its encoder'
LATE = ('this machine is late: nothing was sent in time; the mount has stopped, and goes on as '
        'soon as it is judged anew')
#: periods of an instrument after which it is silent
PERIODS = 5.0
#: an axis that moves may be behind by the way of so long, s
LAG = 0.5


class GuardSettings(NamedTuple):
    """How a `supervisor.Supervisor` sends.

    Attributes
    ----------
    whole : bool
        The track that was checked at once; nothing is renewed, and silence is no matter.
    ahead : float
        From now to the last moving knot of a piece, s.
    silence, commander : float
        Seconds without a reading, and without a renewed request, after which the axes are stopped.
    behind : float
        Largest distance of an axis from where it was sent, rad.
    turn_known : bool
        The first axis reads the turn that it is on.
    asleep : bool
        Time waits for events: of a mount that is not asked to move nothing is read.
    """

    whole: bool = True
    ahead: float = 1.5
    silence: float = 0.5
    commander: float = 0.45
    behind: float = 2.0 * DEG
    turn_known: bool = True
    asleep: bool = False


def why_stop(readings, least_silence, requested, astray):
    """Why what moves is to be stopped now.

    Parameters
    ----------
    readings : AxisReadings
    least_silence : float
        s.
    requested : bool
        Whether somebody still asks for it.
    astray : callable
        Gives what `off_course` or `off_way` says.

    Returns
    -------
    (str, int, str) or None
        State to go to, how bad it is, and why, in a sentence.
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
    """For how long nothing was read, s, where that is too long; else 0."""
    return readings.since if readings.since > max(least, PERIODS * readings.period) else 0.0


def off_course(readings, course, behind, words):
    """Which axis does not go where it was sent, in a sentence; '' for none.

    Parameters
    ----------
    readings : AxisReadings
    course : Course
    behind : float
        Largest distance, rad; of an axis that moves more.
    words : sequence of str
        What the axes are called.
    """
    if readings.stamp <= course.start:
        return ''
    for i, word in enumerate(words):
        angle, rate = course.moment(course.seconds(readings.stamp), i)  # at the time of the reading
        off = abs(readings.here[i] - angle)
        if off > behind + LAG * abs(rate):
            return (f'the {word} is {off / DEG:.1f} deg from where it was sent: stopped; '
                    'somebody homed it, or look at its drive and encoder; then call resume')
    return ''


def off_way(here, ends, behind, axes, words):
    """Which axis is outside of a way that was checked, in a sentence; '' for none.

    Parameters
    ----------
    here : ndarray, shape (2,)
        Where the axes are, rad.
    ends : (ndarray, ndarray), shape (2,)
        Least and greatest angles of the way, rad.
    behind : float
        Largest distance, rad.
    axes : sequence of limits.Axis
    words : sequence of str
        What they are called.
    """
    # near the pole the first axis turns far while the tube hardly does
    wider = behind / max(abs(math.cos(float(here[1]))), 1e-9), behind
    for angle, least, most, beside, axis, word in zip(
            map(float, here), *ends, wider, axes, words):
        low = max(least - beside, min(least, axis.low) - behind)
        high = min(most + beside, max(most, axis.high) + behind)
        if not low <= angle <= high:
            off = max(least - angle, angle - most)
            return (f'the {word} is at {angle / DEG:.1f} deg, {off / DEG:.1f} deg outside of '
                    'the checked way: stopped. Its driver goes another way or to the '
                    'other side: look at it, and call resume')
    return ''
