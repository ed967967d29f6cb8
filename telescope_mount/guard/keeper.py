"""Stands between who commands and the mount: judges requests, and sends what was allowed.

Two ways to send. Whole: the judged track as it is, for a simulated mount whose time passes as
events need it. In pieces: what the axes shall do within the next moments, slew and track alike, and
then rest; renewed as long as request and readings are alive, so that a mount that hears nothing
more stops by itself.

One class, and longer than most: request, readings and what was sent decide together at each step.
"""

import math
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from msg_tools.units import DEG

from ..observing.axis_demand import Track
from .axis_readings import AxisReadings
from .axis_track import braked, ended, resting
from .limits import Allowed, Refused, safe_travel
from .motion import AxisState, moment, plan_move
from .sky_limits import SkyCircles
from .track_judgement import Judge
from .way import around, lead

#: of the speed and the acceleration of an axis, what a slew in pieces uses: the rest is for
#: catching up
SHARE = 0.8
#: between knots of a piece, s
KNOT = 0.25
#: so near to a point of a way around, and slower, it is reached; rad, rad/s
REACHED, STILL = 0.1 * DEG, 0.02 * DEG
#: an axis that moves may be behind by the way of so long, s
LAG = 0.5
#: a track that begins later than this has to wait for its time, s
LATER = 1.0
#: a request that begins so much later is none of now, and a clock that steps back by more makes
#: all that was known of the future false, s
FAR = 60.0
OK, WARN, ERROR = 0, 1, 2
UNKNOWN = 'where the axes stand is not known: home the mount, or wait for its encoder'
LATE = ('this machine is late: nothing was sent in time; the mount has stopped, and goes on as '
        'soon as it is judged anew')


class Keeper:
    """What is asked for, where the axes are, and what is sent.

    Parameters
    ----------
    limits : limits.Limits
    site : Site
    settings : Settings
    wall : callable
        Seconds of a clock that goes on while simulated time stands still.

    Attributes
    ----------
    state, level, reason : str, int, str
        ``idle``, ``following``, ``around``, ``stopping``, ``waiting``, ``stopped``, ``paused``,
        ``aborted``, ``parking``, ``parked``; how bad that is, and why, in a sentence.
    refused : (int, str)
        Stamp of the last request that was refused, ns, and why.
    """

    def __init__(self, limits, site, settings, wall):
        if not settings.whole:
            limits = replace(limits, timing=min(limits.timing, SHARE))
        self._limits, self._judge = limits, Judge(limits)
        self._circles = SkyCircles(limits.keep_out, site)
        self._settings, self._wall = settings, wall
        self.readings = AxisReadings(limits, wall)
        self.state, self.level, self.reason = 'idle', OK, 'no request'
        self.refused = (0, '')
        self._goal = self._path = None
        self._vias, self._heard, self._owner, self._last = [], 0.0, '', 0
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
        if jumped and self._path is not None and not self._settings.whole:
            self._goal = self._path = None  # where it was sent is of a place where it is not
            self._brake(stamp)
            self._told('aborted', ERROR, 'the readings jumped to another place and stay there: '
                       'stopped; somebody homed it, or look at its encoder; then call resume')
        if self.readings.here is None:
            self._judge = Judge(self._limits)
            if known:  # another power-on: what was asked for was of this one
                self._lose(stamp, 'the encoders give no number any more: home the mount')
        elif (jumped or not known) and not self._settings.turn_known:
            first, second = self._limits.axes
            low, high = safe_travel(self.readings.here[0], first.low, first.high)
            self._judge = Judge(replace(
                self._limits, axes=(first._replace(low=low, high=high), second)))

    def take_request(self, track, now, owner=''):
        """A track that is asked for, or the one before once more: it is still wanted.

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
            text = f'a request for {ahead:.0f} s from now: send one of now'
            # whoever asks may hear of a clock that was set back a moment later
            raise (self._refuse(track, text) if self._wall() > self._back else ValueError(text))
        again = self._goal is not None and track.start == self._goal.start
        if not again and track.start == self._last:
            return  # it is over
        if self.locked:
            raise self._refuse(track, self.locked)
        self._heard, self._owner = self._wall(), owner
        if again:
            if self.state == 'stopped' and not self.readings.quiet(self._settings.silence):
                self._begin(now)
            elif self._unread == self.readings.stamp and self.state in ('following', 'around'):
                self._begin(now)  # nothing was read since it was sent: it may have been lost
            elif self._settings.asleep and self.readings.here is None:
                self._begin(now, True)  # a guard that was started again: nothing would ever be read
            return
        if track.start < self._last:
            text = 'a request older than the one before: check its stamp'
            raise (ValueError(text) if self._last - track.start > FAR * 1e9  # ours will be set back
                   else self._refuse(track, text))
        self._last, self._vias, self._turns = track.start, [], None
        self._goal = track if self._settings.whole else ended(track, self._limits.axes)
        if self.state != 'paused':
            self._begin(now)

    def _forget_future(self, now):
        """After the clock has been set back, or began anew: whether what was asked for is over."""
        far = now + round(FAR * 1e9)
        if self._settings.whole or max(self._last, self._sent) <= far:
            return False
        self._last = self._sent = 0
        self._halt, self._back = True, self._wall() + FAR
        if self._goal is None and self._path is None:
            return False
        self._goal, self._path, self._vias, self._out = None, None, [], []
        if not self.locked:
            self._told('stopped', WARN, 'the clock was set back: ask anew')
        return True

    def _halted(self, now):
        """After that: a stop from the first reading of the new time, as nobody knows the way."""
        if self._halt and self.readings.stamp <= now + round(0.5 * FAR * 1e9):
            self._halt = False
            if self._path is None and not self.readings.stand(STILL):
                self._brake(now)

    def withdraw(self, now):
        """Nobody asks for anything any more: stop."""
        if self._goal is not None and not self.locked:
            self._goal = None
            if self._path is not None and not self._settings.whole:
                self._brake(now)
            self._path = None
            self._told('idle', OK, 'the request was withdrawn')

    def _lose(self, now, reason):
        if self._goal is None and self.state != 'parking':
            return
        if not self._settings.whole and self._path is not None:
            self._brake(now)
        self._goal = self._path = None
        self._told('stopped', OK if self._settings.whole else WARN, reason)

    @property
    def _alive(self):
        return self._goal is not None and (
            self._settings.whole or self._wall() - self._heard <= self._settings.commander)

    def _refuse(self, track, reason):
        self.refused = track.start, reason
        return ValueError(reason)

    # --- a request ----------------------------------------------------------------------------

    def _begin(self, now, unread=False):
        """Judge what is asked for from where the axes are, and set out.

        `unread`: from where it begins, where nothing was read yet.
        """
        goal, late, self._vias = self._goal, 0.0, []
        if self._blind and not (unread and self.readings.here is None):
            return self._told('waiting', WARN, UNKNOWN)
        if not self._settings.whole:
            late = (now - goal.start) * 1e-9
            if late < -LATER:
                return self._told('waiting', OK, 'the track begins later')
        state = (self._here(now) if self.readings.here is not None
                 else AxisState(tuple(map(float, goal.angles[0]))))
        circles = self._circles_at(max(now, goal.start))
        found = self._judge.judge(goal.times - late, goal.angles, goal.rates, state, circles,
                                  self._turns)
        if isinstance(found, Allowed):
            if self._set_out(found.cubic, state, now, 'following'):
                return
            found = Refused('the track is too fast for the mount: ask for a slower one')
        if found.cubic is not None:
            if max(map(abs, state.rates)) > 2.0 * STILL:
                self._brake(now)
                return self._told('stopping', OK, f'{found.reason.partition(":")[0]}: '
                                  'stopping, to go around')
            led = lead(self._judge, found.cubic, AxisState(state.angles), circles)
            if led is not None:
                self._vias, cubic = list(led[0]), led[1]
                self._turns = round(float(cubic.angles[0, 0] - goal.angles[0, 0]) / (2.0 * math.pi))
                if not self._settings.whole:  # the search took its time: the next step sets out
                    return self._told('waiting', OK, 'a way is found')
                return (self._to_via(now) if self._vias
                        else self._set_out(cubic, state, now, 'following'))
        self._goal = None
        if self._path is not None:
            self._brake(now)
        self._told('stopped', WARN, f'refused: {found.reason}')
        raise self._refuse(goal, found.reason)

    @property
    def _blind(self):
        """Whether it is not known where the axes are."""
        return self.readings.here is None or not self._settings.whole and bool(
            self._halt or self.readings.doubtful
            or self.readings.quiet(self._settings.silence))

    def _to_via(self, now):
        here, there = self._here(now), self._vias[0]
        found = self._judge.way(here.angles, there, self._circles_at(now))
        if not isinstance(found, Allowed):  # a circle has come into the way since
            self._vias = []
            return self._told('waiting', WARN, found.reason)
        self._set_out(resting(there), here, now, 'around', f'{len(self._vias)} points to pass')

    def _circles_at(self, now):
        return self._circles.at(now * 1e-9)

    def _here(self, now):
        """Of the axes now: where they were sent, while they follow, else their reading."""
        if self._path is not None and not self._settings.whole and not self._hung(now):
            points = [self._moment(now, i) for i in (0, 1)]
            return AxisState(*zip(*points))
        return AxisState(tuple(map(float, self.readings.here)), tuple(
            float(v) if math.isfinite(v) else 0.0 for v in self.readings.rate))

    def _hung(self, now):
        """Whether nothing was sent in time, and the mount has braked; or has not begun at all."""
        ahead = round(self._settings.ahead * 1e9)
        return now > max(self._sent, self._path[0]) + ahead or (
            bool(self._out) and now > self._out[-1].start + ahead // 5)

    def _moment(self, now, axis):
        start, moves, cubic = self._path
        return moment(moves[axis], cubic, (now - start) * 1e-9, axis)

    def _set_out(self, cubic, state, now, name, text=''):
        if self._settings.whole:
            start = self._goal.start if name == 'following' else now
            self._out.append(Track(start, cubic.times, cubic.angles, cubic.rates))
            self._path, self._unread = (start, None, cubic), self.readings.stamp
        else:
            moves = [plan_move(state.angles[i], state.rates[i], cubic, i, SHARE * axis.rate,
                               SHARE * axis.acceleration, 1e-9)
                     for i, axis in enumerate(self._limits.axes)]
            if None in moves:
                return False
            self._path = now, moves, cubic
            self._piece(now)
        self._told(name, OK, text or 'as requested')
        return True

    def _piece(self, now):
        """The next moments, and rest."""
        start, moves, cubic = self._path
        count = max(1, round(self._settings.ahead / KNOT))
        t = (now - start) * 1e-9 + KNOT * np.arange(count + 1)
        points = np.array([[moment(moves[i], cubic, at, i) for i in (0, 1)] for at in t.tolist()])
        self._send_braked(now, KNOT * np.arange(count + 1), points[:, :, 0], points[:, :, 1])

    def _send_braked(self, now, times, angles, rates):
        """A track that ends at rest."""
        self._out.append(Track(now, *braked(times, angles, rates, self._limits.axes)))

    def _brake(self, now):
        """Stop now."""
        if self.readings.here is None and (
                self._path is None or self._settings.whole or self._hung(now)):
            self._path = None  # nobody knows from where, and what was sent ends at rest
            return
        state = self._here(now)
        self._send_braked(now, np.zeros(1), np.array([state.angles]), np.array([state.rates]))
        self._path = None

    # --- as time goes on ----------------------------------------------------------------------

    def is_request(self, track):
        """Whether a track to send is what was asked for, unchanged."""
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
        with suppress(ValueError):  # a refusal, which `state` tells
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
                self.state == 'stopping' and self.readings.stand(STILL))):
            if self.state == 'waiting' and self._vias and not self._blind:
                self._to_via(now)
            else:
                self._begin(now)
        if not self._settings.whole and self._path is not None:
            if self._hung(now):
                self._path, self._out = None, []
                state = 'aborted' if self.state == 'parking' else 'stopping'
                return self._told(state, WARN, LATE)
            reason = self._why_stop(now)
            if reason:
                self._brake(now)
                self._told(*reason)
                return
            if due and not self._out:
                self._piece(now)
        if self.state in ('around', 'parking') and self._vias and self._at(self._vias[0], now):
            self._vias.pop(0)
            if self._vias:
                self._next(now, self.state)
            elif self.state == 'parking':
                self._path = None
                self._told('parked', OK, 'parked: call resume')
            else:
                self._begin(now)
        if self.state == 'following' and not self._settings.whole and self._path is not None:
            start, _, cubic = self._path
            if (now - start) * 1e-9 > cubic.times[-1] + self._settings.ahead:
                self._path = self._goal = None
                self._told('idle', OK, 'the track has ended')

    def _next(self, now, state):
        self._to_via(now)
        if state == 'parking' and self.state == 'around':
            self._told(state, OK, 'on the way to the park position')

    def _why_stop(self, now):
        # one that parks has nobody to ask for it again
        stopped = 'aborted' if self.state == 'parking' else 'stopped'
        quiet = self.readings.quiet(self._settings.silence)
        if quiet:
            return stopped, ERROR, (f'no reading of the encoders for {quiet:.1f} s: stopped; '
                                    'look at their driver')
        if self.state != 'parking' and not self._alive:
            return stopped, WARN, 'the request is no longer renewed: stopped'
        astray = self._astray()
        if astray:
            return 'aborted', ERROR, astray
        return None

    def _astray(self):
        """Which axis does not go where it was sent, in a sentence; '' for none."""
        if self.readings.stamp <= self._path[0]:
            return ''
        for i, word in enumerate(self._limits.mount.names.axes):
            # where it was sent to at the time of the reading
            angle, rate = self._moment(self.readings.stamp, i)
            off = abs(self.readings.here[i] - angle)
            if off > self._settings.behind + LAG * abs(rate):
                return (f'the {word} is {off / DEG:.1f} deg from where it was sent: stopped; '
                        'somebody homed it, or look at its drive and encoder; then call resume')
        return ''

    def _at(self, place, now):
        if self._path is None:
            return False
        start, moves, _ = self._path
        over = not moves or (now - start) * 1e-9 >= max(move.end for move in moves)
        return over and self.readings.stand(STILL) and all(
            abs(a - b) < REACHED for a, b in zip(self.readings.here, place))

    # --- services -----------------------------------------------------------------------------

    def abort(self, now):
        """Stop, forget the request, and take none until `resume`."""
        self._brake(now)
        self._goal, self._vias = None, []
        self._told('aborted', WARN, 'aborted: call resume')

    def pause(self, now):
        """Stop, and go on with the request at `resume`; ValueError where that is no matter."""
        if self.locked:
            raise ValueError(self.locked)
        if self._path is not None:
            self._brake(now)
        self._told('paused', WARN, 'paused: call resume')

    def resume(self, now):
        """Go on; ValueError where nothing holds the mount up."""
        if self.state not in ('paused', 'aborted', 'parked', 'parking', 'stopped'):
            raise ValueError('nothing is paused')
        self._told('idle', OK, 'resumed')
        if self._alive:
            self._vias = []
            self._begin(now)

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
            self._brake(now)  # it is a way of its own from there
            state = AxisState(tuple(self._out[-1].angles[-1].tolist()))
        there = self._judge.limits.nearest_turn(place, state.angles[0])
        circles = self._circles_at(now)
        found, vias = self._judge.way(state.angles, there, circles), []
        if not isinstance(found, Allowed):
            vias = found.cubic is not None and around(
                self._judge, found.cubic, AxisState(state.angles), circles)
            if not vias:
                raise ValueError(f'park: {found.reason}')
        self._goal, self._vias = None, [*vias, tuple(there.tolist())]
        self._next(now, 'parking')

    def _told(self, state, level, reason):
        self.state, self.level, self.reason = state, level, reason


class GuardSettings(NamedTuple):
    """How a `Keeper` sends.

    Attributes
    ----------
    whole : bool
        The judged track at once; nothing is renewed, and silence is no matter.
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
