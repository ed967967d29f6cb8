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

"""A mount whose driver takes places, with the interface of the graph: readings out, tracks in.

Common parts of all protocols; see `indi_driver` and `alpaca_driver`.
"""

import contextlib
import threading
import time
from collections import deque
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import is_beyond

from .axes_and_places import AxisFollower, axes_at, place_of_date
from .connection import RETRY, BridgeError, Reconnection

#: sentence for a driver without axis angles
NO_AXES = ('the driver reports no axis angles: its position is used for them, so errors that '
           'its model corrects cannot be measured')
#: axes at rest are not reported again by a driver; they are repeated here at this interval, s
STILL = 0.2
NO_RATES = ('the driver accepts no axis rates: satellites cannot be tracked; to track one, write a '
            'driver of your own (docs/real_mount.md)')
#: s after an order until the driver reports that it is moving
TAKES_IT = 0.6
#: s between two signals to the process that stops the mount if this one dies
HEARTBEAT = 0.1
#: a track that starts farther from the last one is in another part of the driver's model, rad
FAR = 10.0 * DEG
#: faster motion on the sky is not that of a star, rad/s; such a target is followed by rates of the
#: axes if they are nearer to it than `NEAR`, rad, else they are sent to its place `LEAD` s later
NO_STAR, NEAR, LEAD = 2.0 * ARCSEC, 0.5 * DEG, 1.0
#: interval at which rates are renewed, s, and time in which they correct an error of the axes, s
RENEWED, MADE_UP = 0.2, 1.0
#: a track at rest that ends within this time is a stop, s
STOP = 0.25
#: s in which a mount comes to rest after a stop order
GOES_ON = 10.0
#: s after a stop until a moving mount is stopped again; the same if it reports to track again;
#: until it certainly stands; and longest wait for that at the end
STOP_AGAIN, AT_ONCE, AT_REST, LONGEST = 0.2, 0.03, 1.5, 4.0


class Tick(NamedTuple):
    """Data sent by the driver at one moment.

    Attributes
    ----------
    stamp : int
        Time of reception, ns since 1970.
    axes : ndarray, shape (2,)
        Axis angles as counted by the driver, rad.
    place : ndarray, shape (2,), or None
        Right ascension and declination of date at which it points, rad; None if it did not come
        with the axes: a driver sends only changes.
    tracking : bool
        Whether the driver reports that it has arrived.
    """

    stamp: int
    axes: np.ndarray
    place: np.ndarray | None
    tracking: bool


class GotoMount:
    """Keeps a mount at a server ready, and its axes on the commanded track.

    Blocking work is done in its own thread; `step` is called often, by one thread. A protocol
    implements `open`, which returns at once, `shut`, and `find`, which may block and returns a
    telescope ready to be pointed, or raises BridgeError. That has ``device``, ``has_axes``,
    ``believed``, ``doubt``, ``axes``, ``place``, ``tracks``, ``taken_up``, ``beyond``, ``side``,
    ``slewing``, ``parked``, ``takes_rates``, ``turn``, ``goto``, ``abort`` and ``prepare``, see
    `indi_telescope.IndiTelescope`.

    Parameters
    ----------
    where : str
        Host and port, for people.
    mount : Mount
    site : Site
    tolerance : float
        Tolerance of the axes, rad.
    retry : float
        Time between two attempts to make the mount ready, s.
    """

    def __init__(self, where, mount, site, tolerance=1.5e-5, retry=RETRY):
        self.where, self.mount, self.site = where, mount, site
        self.telescope = None
        self.ready, self.why = False, f'connecting to {where}'
        self.stopper, self._signalled = None, 0.0
        self._follower = AxisFollower(mount, site, tolerance)
        self._track = self._last = self._fresh = None
        self._sent, self._newest, self._beside = 0.0, 0, ''
        self._there = np.full(2, np.nan)  # axes to which it was sent last
        self._turned = 0.0  # when rates were sent last, s; 0: a place was sent since
        self._stopping, self._stopped, self._stop_sent = None, 0.0, 0  # since; last; ns
        self._readings = deque(maxlen=10_000)
        self._lock, self._is_ready = threading.Lock(), threading.Event()
        self._reconnection = Reconnection(self._make_ready, self._not_ready, retry)

    def start(self):
        """Begin; returns at once."""
        self.open()
        self._reconnection.start()

    def close(self, patience=LONGEST):
        """Stop the mount, since nobody would renew its track.

        Parameters
        ----------
        patience : float
            Longest wait until a moving mount has stopped, s.
        """
        self._reconnection.close()
        telescope = self.telescope
        if self.ready and telescope is not None and not telescope.parked:
            moves = self._stopping or telescope.slewing or telescope.tracks
            with contextlib.suppress(BridgeError):  # the connection is gone, too
                self.abort()
                end = time.monotonic() + patience
                while moves and self._stopping and self.ready and time.monotonic() < end:
                    self._stop_again(telescope)
                    time.sleep(0.02)  # polling: the thread of the connection receives the state
        if self.stopper is not None:
            self.stopper.signal(self._track is not None or not self.ready)
            self.stopper.close()
        self.shut()

    # --- getting ready ------------------------------------------------------------------------

    def lost(self):
        """Called when the connection is lost."""
        self.ready, self.telescope = False, None
        self._is_ready.clear()
        self._track = self._fresh = None
        self.why = (f'the connection to {self.where} is lost: a mount whose driver still runs '
                    'goes where it was sent last')
        self.wake()

    def wake(self):
        """Try at once to make the mount ready."""
        self._reconnection.wake()

    def wait_ready(self, seconds):
        """Wait until the mount is ready, at most so long (s)."""
        self._is_ready.wait(0.0 if self.ready else seconds)

    def _make_ready(self):
        if self.ready:
            return
        self.telescope = self.find()
        # it may have been found moving, and was stopped
        self._stopping = self._stopped = time.monotonic()
        self.ready, self.why = True, ''
        self._is_ready.set()

    def _not_ready(self, why):
        self.why = why

    def check(self, telescope, may_move):
        """BridgeError if the mount is of another kind; return whether its site is another one.

        Another site is an error too, unless the mount may be sent the site (`may_move`).
        """
        if telescope.kind not in ('', self.mount.kind):
            raise BridgeError(f'{telescope.device} is a mount of the kind {telescope.kind}, and '
                              f'the parameter mount says {self.mount.kind}')
        there = telescope.site
        elsewhere = there is None or bool(np.abs(wrap(np.array(there[:2]) - (
            self.site.latitude, self.site.longitude))).max() > 1e-6)
        if elsewhere and not may_move:
            raise BridgeError(f'{telescope.device} has another site than the parameters '
                              'latitude_deg and longitude_deg')
        return elsewhere

    # --- readings -----------------------------------------------------------------------------

    def take(self, tick):
        """Take a `Tick`, in the thread of the connection."""
        with self._lock:
            if tick.stamp > self._newest:
                self._newest = tick.stamp
                self._readings.append((tick.stamp, np.array(self.mount.on_travel(*tick.axes))))
        if tick.tracking:
            self._fresh = tick

    def readings(self):
        """Readings since the last call: list of (ns, angles (2,) in rad, within the travel)."""
        telescope = self.telescope
        if not self.ready or telescope is None:
            self._readings.clear()
            return []
        now = time.time_ns()
        with self._lock:
            if not self._readings and now - self._newest > STILL * 1e9:
                self._repeat_reading(telescope, now)
            out = list(self._readings)
            self._readings.clear()
        if out:
            self._last = out[-1]
        return out

    def _repeat_reading(self, telescope, now):
        """Repeat the reading of axes at rest, or compute it for a driver without axes."""
        if telescope.has_axes:
            # a mount that tracks without reporting its axes is not at rest
            if self._newest and telescope.tracks:
                return
            angles = np.array(self.mount.on_travel(*telescope.axes[0]))
        else:
            place = telescope.place
            if place is None:
                return
            beyond = self.mount.two_sided and bool(telescope.beyond)
            angles = np.array(axes_at(self.mount, *place[0], now * 1e-9, self.site, beyond))
        self._newest = now
        self._readings.append((now, angles))

    # --- orders -------------------------------------------------------------------------------

    def command(self, start, times, angles, rates=None):
        """Take a track: a new one, or the next piece of the current one.

        A piece that continues the track within the tolerance, or by rates of the axes, sends
        nothing to the driver. A track at rest that ends within `STOP` is a stop.

        Parameters
        ----------
        start : int
            ns.
        times : ndarray, shape (n,)
            Time since then, s.
        angles, rates : ndarray, shape (n, 2)
            Axis angles and rates, rad and rad/s.

        Raises
        ------
        ValueError
            The mount is not ready.
        """
        if not self.ready:
            raise ValueError(f'no mount to command: {self.why}')
        if times[-1] <= STOP and not np.any(rates):
            if self._track is not None:
                self.abort()
            return
        track = start * 1e-9 + np.asarray(times, float), np.asarray(angles, float)
        beside, now = np.inf, max(track[0][0], time.time())
        if self._track is not None:
            beside = np.abs(wrap(self.demand(now) - _at(track, now))).max()
        self._track, self._stopping = track, None
        if beside <= (NEAR if self._turned else self._follower.tolerance):
            return
        # keep the correction even after a stop: without it the mount would go astray and back
        if np.abs(wrap(self.demand(now) - self._there)).max() > FAR:
            self._follower.begin()
        self._fresh, self._sent, self._beside = None, 0.0, ''

    def demand(self, now):
        """Angles of the commanded track at a time, rad, shape (1, 2)."""
        return _at(self._track, now)

    def _rates(self, now):
        """Axis rates on the track, rad/s, shape (2,), and whether they are too fast for a star."""
        ends = now - 0.5 * RENEWED, now + 0.5 * RENEWED
        angles = [self.demand(at)[0] for at in ends]
        (ra, dec), (later, up) = (place_of_date(self.mount, *of, self.site)
                                  for of in zip(angles, ends))
        over = np.hypot(wrap(later - ra) * np.cos(dec), up - dec)
        return (angles[1] - angles[0]) / RENEWED, over > NO_STAR * RENEWED

    def step(self):
        """Send the mount on if its axes are not on the track.

        Raises
        ------
        BridgeError
            The driver refuses; the mount is then made ready again.
        """
        try:
            self._signal_stopper()
            self._step()
        except BridgeError as err:
            self.ready, self.why, self._sent = False, str(err), 0.0
            self._is_ready.clear()
            self.wake()
            raise

    def _signal_stopper(self):
        now = time.monotonic()
        if self.stopper is None or now - self._signalled < HEARTBEAT:
            return
        self._signalled = now
        # a mount lost with its connection has not been stopped: stay armed
        if not self.stopper.signal(self._track is not None or not self.ready):
            self.stopper = None
            raise BridgeError('the process that stops the mount if this one dies has ended: it is '
                            'started again')

    def _step(self):
        telescope, track = self.telescope, self._track
        if not self.ready or telescope is None:
            return
        if track is None:
            self._stop_again(telescope)
            return
        now = time.time()
        if now > track[0][-1]:
            # the track was not renewed, so it is no longer commanded
            self.abort()
            return
        if not self._sent:
            self._send(telescope, now)
            return
        if telescope.slewing or now - self._sent < TAKES_IT:
            self._fresh = None
            return
        if telescope.has_axes:
            fresh, self._fresh = self._fresh, None
            if fresh is None or fresh.stamp * 1e-9 < self._sent + TAKES_IT:
                return
            stamp, reading = fresh.stamp * 1e-9, np.array(self.mount.on_travel(*fresh.axes))
        elif self._last is not None:
            stamp, reading = self._last[0] * 1e-9, self._last[1]
            if stamp < self._sent + TAKES_IT:
                return
        else:
            return
        demand = self.demand(stamp)[0]
        self._beside = ''
        if self._follower.other_side(demand, reading):
            self._beside = ('the driver took the side of the pier that was not commanded: '
                            'near the meridian it chooses by itself')
            return
        rates, moves = self._rates(now)
        if moves and np.abs(rates).max() > NO_STAR:  # and not at rest
            # protocols only have rates of hour angle and declination
            if telescope.takes_rates and not self.mount.vertical:
                self._lead(telescope, rates, demand, reading, now)
                return
            self._beside = NO_RATES
        if self._follower.learn(demand, reading):
            self._send(telescope, now)

    def _lead(self, telescope, rates, demand, reading, now):
        """Follow a fast target by rates; axes that are too far off are sent to a place again."""
        off = self._follower.off(demand, reading)
        far = np.abs(off).max()
        if far > NEAR:
            if far < self._follower.LARGEST:  # larger errors come from the duration of the slew
                self._follower.learn(demand, reading)
            self._send(telescope, now)
        elif now - self._turned >= RENEWED:
            telescope.turn(rates + off / MADE_UP)
            self._turned = now

    def _send(self, telescope, now):
        then = now + LEAD * self._rates(now)[1]
        self._there = self.demand(then)[0]
        telescope.goto(*self._follower.target(self._there, then))
        self._sent, self._turned = now, 0.0

    def abort(self):
        """Stop immediately, without tracking."""
        self._track, self._turned = None, 0.0
        telescope = self._need()
        self._stopped = time.monotonic()
        self._stopping = self._stopping or self._stopped
        self._stop_sent = time.time_ns()
        telescope.abort()

    def _stop_again(self, telescope):
        """Repeat the stop order, since an aborted slew may still end in tracking."""
        if not self._stopping:
            return
        passed = time.monotonic() - self._stopped
        if telescope.slewing or telescope.tracks:
            if passed > (AT_ONCE if telescope.taken_up > self._stop_sent else STOP_AGAIN):
                self.abort()
        elif passed > AT_REST:
            self._stopping = None

    def unpark(self):
        """Make the mount ready for commands."""
        telescope = self._need()
        if telescope.parked:
            telescope.prepare()

    def _need(self):
        if not self.ready or self.telescope is None:
            raise BridgeError(self.why)
        return self.telescope

    # --- what is told -------------------------------------------------------------------------

    def state(self):
        """Problem in words, '' for none, and whether nothing can be done: (sentence, bool)."""
        if not self.ready:
            return self.why, True
        if self._stopping and time.monotonic() - self._stopping > GOES_ON:
            return (f'the mount moves or tracks {GOES_ON:g} s after the stop command: stop it '
                    'by its own controls, and check its driver'), True
        if self._beside:
            return self._beside, False
        telescope = self.telescope
        if telescope is not None and telescope.believed:
            return '. '.join(filter(None, (telescope.doubt, NO_AXES))), False
        return '', False

    def details(self):
        """Rows for people."""
        telescope = self.telescope
        last = self._last
        return [('device', telescope.device if telescope is not None else ''),
                ('ready', str(self.ready)),
                ('side of the pier', telescope.side if telescope is not None else ''),
                ('through the pole', str(bool(is_beyond(last[1][1]))) if last else ''),
                ('sent farther than demanded [deg]',
                 ', '.join(f'{v / DEG:.4f}' for v in self._follower.correction))]


def _at(track, now):
    """Angles of a track, (times, angles), at a time, rad, shape (1, 2).

    Extrapolated before its beginning: a reading may be older than the last piece.
    """
    times, angles = track
    before = min(now - times[0], 0.0)
    rate = (angles[1] - angles[0]) / (times[1] - times[0]) if before and len(times) > 1 else 0.0
    return np.array([[np.interp(now, times, axis) for axis in angles.T]]) + before * rate
