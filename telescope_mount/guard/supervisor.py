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

"""The link between commanders and the mount: checks requests, and sends allowed tracks.

There are two ways to send. Whole: the unchanged track, for a simulated mount whose time depends on
events. In pieces: the motion of the next moments, slew or track, followed by rest. Pieces are
repeated while request and readings are alive, so a mount that receives nothing more stops by
itself.

Each step depends on the request, the readings and what was sent (`sent_course`).
"""

import math
from contextlib import suppress
from dataclasses import replace

from msg_tools.units import DEG

from .axis_readings import AxisReadings
from .axis_track import ended, resting
from .detour import around, lead
from .limits import SLEW_SHARE
from .motion import AxisState
from .reasons_to_stop import ERROR, LATE, OK, UNKNOWN, WARN, off_course, silence, why_stop
from .sent_course import Course, moves_onto, stop_track
from .sky_limits import SkyCircles
from .track_check import Allowed, Refused, TrackCheck

#: closer to a via point than this, and slower, counts as reached; rad, rad/s
REACHED, STILL = 0.1 * DEG, 0.02 * DEG
#: a track that begins later than this must wait, s
LATER = 1.0
#: a request that begins later than this is refused, and a clock that steps back by more invalidates
#: all knowledge of the future, s
FAR = 60.0


class Supervisor:
    """Keeps the request, the position of the axes, and what is sent.

    Parameters
    ----------
    limits : limits.Limits
    site : Site
    settings : GuardSettings
    wall : callable
        Seconds of a monotonic clock that runs while simulated time stands still.

    Attributes
    ----------
    state, level, reason : str, int, str
        ``idle``, ``following``, ``around``, ``stopping``, ``waiting``, ``stopped``, ``paused``,
        ``aborted``, ``parking``, ``parked``; the severity, and the reason in a sentence.
    refused : (int, str)
        Stamp of the last refused request, ns, and the reason.
    limits : limits.Limits
        Limits for tracks: if slews go in pieces, some speed is reserved for catching up.
    """

    def __init__(self, limits, site, settings, wall):
        if not settings.whole:  # tracks, too, leave a reserve for catching up
            limits = replace(limits, timing=min(limits.timing, SLEW_SHARE))
        self.limits, self._check = limits, TrackCheck(limits)
        self._circles = SkyCircles(limits.keep_out, site)
        self._settings, self._wall = settings, wall
        self.readings = AxisReadings(limits, wall)
        self.state, self.level, self.reason = 'idle', OK, 'no request'
        self.refused = (0, '')
        self._goal = self._course = None
        self._vias, self._renewed, self._owner, self._last = [], 0.0, '', 0
        self._sent = 0  # time of the last sent track, ns
        self._unread = None  # stamp of the newest reading when a whole track was sent
        self._turns = None  # of the first axis, if a detour leads to the goal on another turn
        self._out, self._halt, self._back = [], False, -math.inf

    # --- what comes in ------------------------------------------------------------------------

    @property
    def locked(self):
        """Why no request is accepted now; '' if one is."""
        locked = self.state in ('aborted', 'parking', 'parked')
        return f'{self.state}: call resume' if locked else ''

    def take_reading(self, stamp, angles, rates):
        """Add an encoder reading, rad and rad/s; ValueError for an impossible one."""
        known = self.readings.here is not None
        jumped = self.readings.take(stamp, angles, rates)
        if jumped and self._course is not None and not self._settings.whole:
            self._goal = self._course = None  # its course is for another place
            self._brake(stamp)
            self._set_state('aborted', ERROR, 'the readings jumped to another position and stay '
                            'there: stopped; unless it was homed, look at its encoder; then call '
                            'resume')
        if self.readings.here is None:
            self._check = TrackCheck(self.limits)
            if known and (self._goal is not None or self.state == 'parking'):
                self._drop(stamp)  # a new power-on invalidates the request
                self._set_state('stopped', OK if self._settings.whole else WARN,
                                'the encoders give no angle any more: home the mount')
        elif (jumped or not known) and not self._settings.turn_known:
            self._check = TrackCheck(self.limits.on_turn_of(self.readings.here[0]))

    def take_request(self, track, now, owner=''):
        """Take a requested track, or a repetition of the previous request.

        Parameters
        ----------
        track : Track
        now : int
            ns.
        owner : str
            Requesting node.

        Raises
        ------
        ValueError
            The track is refused; one line says why.
        """
        if owner and self._owner and owner != self._owner and self._alive:
            raise ValueError(f'{owner} sends requests while {self._owner} commands: end one')
        if track.start == self.refused[0]:
            return
        self._forget_future(now)
        ahead = (track.start - now) * 1e-9
        if ahead > FAR and not self._settings.whole:
            # the requester may learn a moment later that the clock was set back
            raise self._refuse(track, f'a request for {ahead:.0f} s from now: send one for now',
                               self._wall() > self._back)
        again = self._goal is not None and track.start == self._goal.start
        if not again and track.start == self._last:
            return  # it is over
        if self.locked:
            raise self._refuse(track, self.locked)
        self._renewed, self._owner = self._wall(), owner
        if again:
            # if there was no reading since it was sent, the command may have been lost
            if (self.state == 'stopped' and not silence(self.readings, self._settings.silence)) or (
                    self.state in ('following', 'around') and self._unread == self.readings.stamp):
                self._begin(now)
            elif self._settings.asleep and self.readings.here is None:
                self._begin(now, True)  # a restarted guard would never get a reading
            return
        if track.start < self._last:
            raise self._refuse(track, 'the request is older than the one before: check its stamp',
                               self._last - track.start <= FAR * 1e9)  # else our clock is set back
        self._last, self._vias, self._turns = track.start, [], None
        # not sharper than a track may be, for a slow mount
        share = self.limits.timing or SLEW_SHARE
        self._goal = track if self._settings.whole else ended(
            track, [share * axis.acceleration for axis in self.limits.axes])
        if self.state != 'paused':
            self._begin(now)

    def _forget_future(self, now):
        """Discard requests after the clock was set back or restarted; whether any was discarded."""
        far = now + round(FAR * 1e9)
        if self._settings.whole or max(self._last, self._sent) <= far:
            return False
        self._last = self._sent = 0
        self._halt, self._back = True, self._wall() + FAR
        if self._goal is None and self._course is None:
            return False
        self._goal, self._course, self._vias, self._out = None, None, [], []
        if not self.locked:
            self._set_state('stopped', WARN, 'the clock was set back: send the request again')
        return True

    def _halted(self, now):
        """After that: stop at the first reading of the new time, since the way is unknown."""
        if self._halt and self.readings.stamp <= now + round(0.5 * FAR * 1e9):
            self._halt = False
            if self._course is None and not self.readings.at_rest(STILL):
                self._brake(now)

    def withdraw(self, now):
        """Stop: nothing is requested any more."""
        if self._goal is not None and not self.locked:
            self._drop(now)
            self._set_state('idle', OK, 'the request was withdrawn')

    def _drop(self, now):
        """Drop the request, and send nothing more than a stop."""
        if self._course is not None and not self._settings.whole:
            self._brake(now)
        self._goal = self._course = None

    @property
    def _alive(self):
        return self._goal is not None and (
            self._settings.whole or self._wall() - self._renewed <= self._settings.commander)

    def _refuse(self, track, reason, for_good=True):
        if for_good:
            self.refused = track.start, reason
        return ValueError(reason)

    # --- a request ----------------------------------------------------------------------------

    def _begin(self, now, unread=False):
        """Check the request from the present position, and start.

        `unread`: start from where the request begins, since there is no reading yet.
        """
        goal, late, self._vias = self._goal, 0.0, []
        if self._blind and not (unread and self.readings.here is None):
            return self._set_state('waiting', WARN, UNKNOWN)
        if not self._settings.whole:
            late = (now - goal.start) * 1e-9
            if late < -LATER:
                return self._set_state('waiting', OK, 'the track begins later')
        state = (self._here(now) if self.readings.here is not None
                 else AxisState(tuple(map(float, goal.angles[0]))))
        circles = self._circles_at(max(now, goal.start))
        found = self._check.check(goal.times - late, goal.angles, goal.rates, state, circles,
                                  self._turns)
        if isinstance(found, Allowed):
            if self._set_out(found.cubic, state, now, 'following'):
                return
            found = Refused('the track is too fast for the mount: ask for a slower one')
        if found.cubic is not None:
            if max(map(abs, state.rates)) > 2.0 * STILL:
                self._brake(now)
                return self._set_state('stopping', OK, f'{found.reason.partition(":")[0]}: '
                                  'stopping, to go around')
            led = lead(self._check, found.cubic, AxisState(state.angles), circles)
            if led is not None:
                self._vias, cubic = list(led[0]), led[1]
                self._turns = round(float(cubic.angles[0, 0] - goal.angles[0, 0]) / (2.0 * math.pi))
                if not self._settings.whole:  # the search took its time: the next step sets out
                    return self._set_state('waiting', OK, 'a path is found')
                return (self._to_via(now) if self._vias
                        else self._set_out(cubic, state, now, 'following'))
        self._goal = None
        if self._course is not None:
            self._brake(now)
        self._set_state('stopped', WARN, f'refused: {found.reason}')
        raise self._refuse(goal, found.reason)

    @property
    def _blind(self):
        """Whether the position of the axes is unknown."""
        return self.readings.here is None or not self._settings.whole and bool(
            self._halt or self.readings.doubtful
            or silence(self.readings, self._settings.silence))

    def _to_via(self, now, name='around'):
        here, there = self._here(now), self._vias[0]
        found = self._check.way(here.angles, there, self._circles_at(now))
        if not isinstance(found, Allowed):  # a circle has come into the way since
            self._vias = []
            return self._set_state('waiting', WARN, found.reason)
        self._set_out(resting(there), here, now, name)

    def _circles_at(self, now):
        return self._circles.at(now * 1e-9)

    def _here(self, now):
        """Present axis state: from the course while the axes follow it, else from readings."""
        if self._course is not None and self._course.moves and not self._hung(now):
            return self._course.state(now)
        return self.readings.state

    def _hung(self, now):
        """Whether nothing was sent in time, so the mount has braked, or has not started at all."""
        ahead = round(self._settings.ahead * 1e9)
        return now > max(self._sent, self._course.start) + ahead or (
            bool(self._out) and now > self._out[-1].start + ahead // 5)

    def _set_out(self, cubic, state, now, name):
        if self._settings.whole:
            start = self._goal.start if name == 'following' else now
            self._course, self._unread = Course(start, cubic), self.readings.stamp
            self._out.append(self._course.track)
        else:
            moves = moves_onto(cubic, state, self.limits.axes)
            if None in moves:
                return False
            self._course = Course(now, cubic, moves)
            self._send_piece(now)
        self._announce(name)
        return True

    def _announce(self, name):
        self._set_state(name, OK, {
            'following': 'as requested', 'parking': 'on the way to the park position'}.get(
                name, f'{len(self._vias)} waypoints left'))

    def _send_piece(self, now):
        self._out.append(self._course.piece(now, self._settings.ahead, self.limits.axes))

    def _brake(self, now):
        """Stop now; from an unknown position what was sent ends at rest by itself."""
        if self.readings.here is not None or not (
                self._course is None or self._settings.whole or self._hung(now)):
            self._out.append(stop_track(now, self._here(now), self.limits.axes))
        self._course = None

    # --- as time goes on ----------------------------------------------------------------------

    def is_request(self, track):
        """Whether a track to send is the unchanged request."""
        return (self._settings.whole and self._goal is not None
                and track.angles is self._goal.angles)

    def step(self, now, due=True):
        """Do everything that is due.

        Parameters
        ----------
        now : int
            ns.
        due : bool
            Whether it is time to repeat the last command.

        Returns
        -------
        list of Track
            Tracks to send to the mount.
        """
        with suppress(ValueError):  # a refusal, reported by `state`
            self._step(now, due)
        out, self._out = self._out, []
        if out:
            self._sent = out[-1].start
        return out

    def _step(self, now, due):
        if self._forget_future(now):
            return
        self._halted(now)
        if self._alive and self.readings.here is not None and (self.state == 'waiting' or (
                self.state == 'stopping' and self.readings.at_rest(STILL))):
            if self.state == 'waiting' and self._vias and not self._blind:
                self._to_via(now)
            else:
                self._begin(now)
        if not self._settings.whole and self._course is not None:
            if self._hung(now):
                self._course, self._out = None, []
                state = 'aborted' if self.state == 'parking' else 'stopping'
                return self._set_state(state, WARN, LATE)
            parks = self.state == 'parking'  # parking has no repeated request
            stop = why_stop(self.readings, self._settings.silence, parks or self._alive,
                            self._astray)
            if stop:
                self._brake(now)
                return self._set_state('aborted' if parks else stop[0], *stop[1:])
            if due and not self._out:
                self._send_piece(now)
        if self.state in ('around', 'parking') and self._vias and self._has_come(now):
            self._vias.pop(0)
            if self._vias:
                self._to_via(now, self.state)
            elif self.state == 'parking':
                self._course = None
                self._set_state('parked', OK, 'parked: call resume')
            else:
                self._begin(now)
        if self.state == 'following' and not self._settings.whole and self._course is not None and (
                self._course.seconds(now) > self._course.cubic.times[-1] + self._settings.ahead):
            self._course = self._goal = None
            self._set_state('idle', OK, 'the track has ended')

    def _astray(self):
        """Which axis does not go where it was sent, in a sentence; '' for none."""
        return off_course(self.readings, self._course, self._settings.behind,
                          self.limits.mount.names.axes)

    def _has_come(self, now):
        """Whether the axes are at rest at the first via point."""
        return self._course is not None and self._course.is_on_track(now) and (
            self.readings.rest_at(self._vias[0], REACHED, STILL))

    # --- services -----------------------------------------------------------------------------

    def abort(self, now):
        """Stop, drop the request, and accept none until `resume`."""
        self._brake(now)
        self._goal, self._vias = None, []
        self._set_state('aborted', WARN, 'aborted: call resume')

    def pause(self, now):
        """Stop, and continue with the request at `resume`; ValueError if locked."""
        if self.locked:
            raise ValueError(self.locked)
        if self._course is not None:
            self._brake(now)
        self._set_state('paused', WARN, 'paused: call resume')

    def resume(self, now):
        """Continue; ValueError if nothing holds the mount up.

        Returns
        -------
        str
            What happens to the previous request.
        """
        if self.state not in ('paused', 'aborted', 'parked', 'parking', 'stopped'):
            raise ValueError('nothing is paused')
        text, goal = 'resumed', self._goal
        if not (goal is None or self._settings.whole) and now - goal.start > 1e9 * goal.times[-1]:
            self._goal = None
            text = 'resumed: the old track has ended, and the next request is followed'
        self._set_state('idle', OK, text)
        try:
            if self._alive:
                self._begin(now)
        except ValueError as err:
            text = (f'resumed, but the old track is refused: {err}. The next request is '
                    'followed if allowed')
        return text

    def park(self, now, place):
        """Go to a pair of angles, rad, and accept no request until `resume`.

        Raises
        ------
        ValueError
            It cannot go there: one line says why.
        """
        if self.readings.here is None:
            raise ValueError(UNKNOWN)
        state = self._here(now)
        if max(map(abs, state.rates)) > 2.0 * STILL:
            self._brake(now)  # parking starts from rest
            state = AxisState(tuple(self._out[-1].angles[-1].tolist()))
        there = self._check.limits.nearest_turn(place, state.angles[0])
        circles = self._circles_at(now)
        found, vias = self._check.way(state.angles, there, circles), []
        if not isinstance(found, Allowed):
            vias = found.cubic is not None and around(
                self._check, found.cubic, AxisState(state.angles), circles)
            if not vias:
                raise ValueError(f'park: {found.reason}')
        self._goal, self._vias = None, [*vias, tuple(there.tolist())]
        self._to_via(now, 'parking')

    def _set_state(self, state, level, reason):
        self.state, self.level, self.reason = state, level, reason
