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

"""Stands between who commands and the mount: checks requests, and sends what was allowed.

Two ways to send. Whole: the track as it is, for a simulated mount whose time passes as
events need it. In pieces: what the axes shall do within the next moments, slew and track alike, and
then rest; renewed as long as request and readings are alive, so that a mount that hears nothing
more stops by itself.

Request, readings and what was sent (`sent_course`) decide together at each step.
"""

import math
from contextlib import suppress

from msg_tools.units import DEG

from .axis_readings import AxisReadings
from .axis_track import ended, resting
from .detour import around, lead
from .limits import SLEW_SHARE
from .motion import AxisState
from .sent_course import Course, moves_onto, stop_track
from .sky_limits import SkyCircles
from .track_check import Allowed, Refused, TrackCheck
from .watchdog import ERROR, LATE, OK, UNKNOWN, WARN, off_course, silence, why_stop

#: so near to a point of a way around, and slower, it is reached; rad, rad/s
REACHED, STILL = 0.1 * DEG, 0.02 * DEG
#: a track that begins later than this has to wait for its time, s
LATER = 1.0
#: a request that begins so much later is none of now, and a clock that steps back by more makes
#: all that was known of the future false, s
FAR = 60.0


class Supervisor:
    """What is requested, where the axes are, and what is sent.

    Parameters
    ----------
    limits : limits.Limits
    site : Site
    settings : GuardSettings
    wall : callable
        Seconds of a clock that goes on while simulated time stands still.

    Attributes
    ----------
    state, level, reason : str, int, str
        ``idle``, ``following``, ``around``, ``stopping``, ``waiting``, ``stopped``, ``paused``,
        ``aborted``, ``parking``, ``parked``; how bad that is, and why, in a sentence.
    refused : (int, str)
        Stamp of the last request that was refused, ns, and why.
    limits : limits.Limits
        That tracks keep: where a slew goes in pieces, some of the speed is left to catch up with.
    """

    def __init__(self, limits, site, settings, wall):
        if not settings.whole:
            limits = limits.in_pieces()
        self.limits, self._check = limits, TrackCheck(limits)
        self._circles = SkyCircles(limits.keep_out, site)
        self._settings, self._wall = settings, wall
        self.readings = AxisReadings(limits, wall)
        self.state, self.level, self.reason = 'idle', OK, 'no request'
        self.refused = (0, '')
        self._goal = self._course = None
        self._vias, self._renewed, self._owner, self._last = [], 0.0, '', 0
        self._sent = 0  # when something was sent last, ns
        self._unread = None  # stamp of the newest reading as a whole track was sent
        self._turns = None  # of the first axis, where a way led to the goal on another turn
        self._out, self._halt, self._back = [], False, -math.inf

    # --- what comes in ------------------------------------------------------------------------

    @property
    def locked(self):
        """Why no request is taken now; '' if one is."""
        locked = self.state in ('aborted', 'parking', 'parked')
        return f'{self.state}: call resume' if locked else ''

    def take_reading(self, stamp, angles, rates):
        """A reading of the encoders, rad and rad/s; ValueError for one that cannot be."""
        known = self.readings.here is not None
        jumped = self.readings.take(stamp, angles, rates)
        if jumped and self._course is not None and not self._settings.whole:
            self._goal = self._course = None  # where it was sent is of a place where it is not
            self._brake(stamp)
            self._set_state('aborted', ERROR, 'the readings jumped to another place and stay '
                            'there: stopped; somebody homed it, or look at its encoder; then call '
                            'resume')
        if self.readings.here is None:
            self._check = TrackCheck(self.limits)
            if known and (self._goal is not None or self.state == 'parking'):
                self._drop(stamp)  # another power-on: what was requested was of this one
                self._set_state('stopped', OK if self._settings.whole else WARN,
                                'the encoders give no number any more: home the mount')
        elif (jumped or not known) and not self._settings.turn_known:
            self._check = TrackCheck(self.limits.on_turn_of(self.readings.here[0]))

    def take_request(self, track, now, owner=''):
        """A track that is requested, or the one before once more: it is still wanted.

        Parameters
        ----------
        track : Track
        now : int
            ns.
        owner : str
            Who asks.

        Raises
        ------
        ValueError
            It is refused; one line says why.
        """
        if owner and self._owner and owner != self._owner and self._alive:
            raise ValueError(f'{owner} asks while {self._owner} commands: end one of them')
        if track.start == self.refused[0]:
            return
        self._forget_future(now)
        ahead = (track.start - now) * 1e-9
        if ahead > FAR and not self._settings.whole:
            # whoever asks may hear of a clock that was set back a moment later
            raise self._refuse(track, f'a request for {ahead:.0f} s from now: send one of now',
                               self._wall() > self._back)
        again = self._goal is not None and track.start == self._goal.start
        if not again and track.start == self._last:
            return  # it is over
        if self.locked:
            raise self._refuse(track, self.locked)
        self._renewed, self._owner = self._wall(), owner
        if again:
            # where nothing was read since it was sent it may have been lost
            if (self.state == 'stopped' and not silence(self.readings, self._settings.silence)) or (
                    self.state in ('following', 'around') and self._unread == self.readings.stamp):
                self._begin(now)
            elif self._settings.asleep and self.readings.here is None:
                self._begin(now, True)  # a guard that was started again: nothing would ever be read
            return
        if track.start < self._last:
            raise self._refuse(track, 'a request older than the one before: check its stamp',
                               self._last - track.start <= FAR * 1e9)  # else ours will be set back
        self._last, self._vias, self._turns = track.start, [], None
        # no sharper than a track may be, where the mount is slow
        share = self.limits.timing or SLEW_SHARE
        self._goal = track if self._settings.whole else ended(
            track, [share * axis.acceleration for axis in self.limits.axes])
        if self.state != 'paused':
            self._begin(now)

    def _forget_future(self, now):
        """After the clock has been set back, or began anew: whether what was requested is over."""
        far = now + round(FAR * 1e9)
        if self._settings.whole or max(self._last, self._sent) <= far:
            return False
        self._last = self._sent = 0
        self._halt, self._back = True, self._wall() + FAR
        if self._goal is None and self._course is None:
            return False
        self._goal, self._course, self._vias, self._out = None, None, [], []
        if not self.locked:
            self._set_state('stopped', WARN, 'the clock was set back: ask anew')
        return True

    def _halted(self, now):
        """After that: a stop from the first reading of the new time, as nobody knows the way."""
        if self._halt and self.readings.stamp <= now + round(0.5 * FAR * 1e9):
            self._halt = False
            if self._course is None and not self.readings.at_rest(STILL):
                self._brake(now)

    def withdraw(self, now):
        """Nobody asks for anything any more: stop."""
        if self._goal is not None and not self.locked:
            self._drop(now)
            self._set_state('idle', OK, 'the request was withdrawn')

    def _drop(self, now):
        """Nothing is requested any more, and nothing more is sent but a stop."""
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
        """Check what is requested from where the axes are, and set out.

        `unread`: from where it begins, where nothing was read yet.
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
                    return self._set_state('waiting', OK, 'a way is found')
                return (self._to_via(now) if self._vias
                        else self._set_out(cubic, state, now, 'following'))
        self._goal = None
        if self._course is not None:
            self._brake(now)
        self._set_state('stopped', WARN, f'refused: {found.reason}')
        raise self._refuse(goal, found.reason)

    @property
    def _blind(self):
        """Whether it is not known where the axes are."""
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
        """Of the axes now: where they were sent, while they follow, else their reading."""
        if self._course is not None and self._course.moves and not self._hung(now):
            return self._course.state(now)
        return self.readings.state

    def _hung(self, now):
        """Whether nothing was sent in time, and the mount has braked; or has not begun at all."""
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
                name, f'{len(self._vias)} points to pass'))

    def _send_piece(self, now):
        self._out.append(self._course.piece(now, self._settings.ahead, self.limits.axes))

    def _brake(self, now):
        """Stop now; where nobody knows from where, what was sent ends at rest by itself."""
        if self.readings.here is not None or not (
                self._course is None or self._settings.whole or self._hung(now)):
            self._out.append(stop_track(now, self._here(now), self.limits.axes))
        self._course = None

    # --- as time goes on ----------------------------------------------------------------------

    def is_request(self, track):
        """Whether a track to send is what was requested, unchanged."""
        return (self._settings.whole and self._goal is not None
                and track.angles is self._goal.angles)

    def step(self, now, due=True):
        """Look after all of it.

        Parameters
        ----------
        now : int
            ns.
        due : bool
            It is time to renew what was sent last.

        Returns
        -------
        list of Track
            What to send to the mount.
        """
        with suppress(ValueError):  # a refusal, which `state` gives
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
            parks = self.state == 'parking'  # one that parks has nobody to ask for it again
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
        """Whether the axes rest at the first of the points to pass."""
        return self._course is not None and self._course.is_on_track(now) and (
            self.readings.rest_at(self._vias[0], REACHED, STILL))

    # --- services -----------------------------------------------------------------------------

    def abort(self, now):
        """Stop, forget the request, and take none until `resume`."""
        self._brake(now)
        self._goal, self._vias = None, []
        self._set_state('aborted', WARN, 'aborted: call resume')

    def pause(self, now):
        """Stop, and go on with the request at `resume`; ValueError where that is no matter."""
        if self.locked:
            raise ValueError(self.locked)
        if self._course is not None:
            self._brake(now)
        self._set_state('paused', WARN, 'paused: call resume')

    def resume(self, now):
        """Go on; ValueError where nothing holds the mount up.

        Returns
        -------
        str
            What becomes of the request of before.
        """
        if self.state not in ('paused', 'aborted', 'parked', 'parking', 'stopped'):
            raise ValueError('nothing is paused')
        text, goal = 'resumed', self._goal
        if not (goal is None or self._settings.whole) and now - goal.start > 1e9 * goal.times[-1]:
            self._goal = None
            text = 'resumed: the track of before is over, and the next request is followed'
        self._set_state('idle', OK, text)
        try:
            if self._alive:
                self._begin(now)
        except ValueError as err:
            text = (f'resumed, but the track of before is refused: {err}. The next request is '
                    'followed, if it may')
        return text

    def park(self, now, place):
        """Go to a pair of angles, rad, and take no request until `resume`.

        Raises
        ------
        ValueError
            It cannot go there: one line.
        """
        if self.readings.here is None:
            raise ValueError(UNKNOWN)
        state = self._here(now)
        if max(map(abs, state.rates)) > 2.0 * STILL:
            self._brake(now)  # it is its own way from there
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
