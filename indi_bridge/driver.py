"""A mount of an INDI server as the graph knows mounts: readings out, tracks and orders in."""

import contextlib
import threading
import time
from collections import deque

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import is_beyond

from .client import IndiClient, IndiError
from .dead_man import DeadMan
from .pointing import AxisFollower, axes_at
from .telescope import NO_AXES, SIDE, TRACK, IndiTelescope, Ticks, find_device

#: axes that stand are not told again by a driver; they are said so often here, s
STILL = 0.2
#: s after an order in which a driver says that it is under way
TAKES_IT = 0.6
#: s between two signs of life to the process that stops the mount if this one dies
HEARTBEAT = 0.2
#: s in which axes are told anew after the site was set
NEW_SITE = 1.0
#: another try to make the mount ready, s
RETRY = 3.0
#: a track that begins farther from the last is another part of the driver's model, rad
FAR = 10.0 * DEG
#: a track at rest that is over so soon is a stop, s
STOP = 0.25


class MountDriver:
    """Keeps a mount at the server ready, and its axes on the track that was commanded.

    What blocks is done by a thread of its own; `step` is called often, by one thread.

    Parameters
    ----------
    host, port : str, int
    mount : Mount
    site : Site
    device, axes : str
        As of `telescope.find_device` and `telescope.IndiTelescope`.
    tolerance : float
        Of the axes, rad.
    set_site : bool
        Whether the driver is told the site.
    period_ms : int
        Of its readings, where it can be told; 0: as it is.
    dead_man : bool
        Whether a process of its own stops the mount where this one dies.
    retry : float
        Time between two tries to make the mount ready, s.
    """

    def __init__(self, host, port, mount, site, device='', axes='', tolerance=1.5e-5,
                 set_site=True, period_ms=0, dead_man=True, retry=RETRY):
        self.mount, self.site = mount, site
        self._device, self._axes, self._set_site = device, axes, set_site
        self._period_ms, self._retry = period_ms, retry
        self._dead_man, self._wants_one, self._told_it = None, dead_man, 0.0
        self.telescope = None
        self.ready, self.why = False, f'connecting to {host}:{port}'
        self._follower = AxisFollower(mount, site, tolerance)
        self._track = self._last = self._fresh = None
        self._sent, self._told, self._beside = 0.0, 0, ''
        self._readings = deque(maxlen=10_000)
        self._lock, self._wake, self._closed = threading.Lock(), threading.Event(), False
        self._ticks = Ticks(self._take)
        self.client = IndiClient(host, port, heard=self._ticks, connection=self._connection)
        self._worker = threading.Thread(target=self._keep_ready, daemon=True)

    def start(self):
        """Begin; returns at once."""
        self.client.start()
        self._worker.start()

    def close(self):
        """Leave a mount that stands: nobody would renew what it tracks."""
        self._closed = True
        self._wake.set()
        if self.ready and not self.telescope.parked:
            with contextlib.suppress(IndiError):  # the connection is gone, too
                self.telescope.abort()
                self._track = None
        if self._dead_man is not None:
            self._dead_man.tell(self._track is not None)
            self._dead_man.close()
        self.client.close()

    # --- getting ready ------------------------------------------------------------------------

    def _connection(self, up):
        if not up:
            self.ready, self.telescope, self._ticks.telescope = False, None, None
            self._track = self._fresh = None
            self.why = (f'the connection to {self.client.host}:{self.client.port} is lost: a mount '
                        'whose driver still runs goes where it was sent last')
        self._wake.set()

    def _keep_ready(self):
        while not self._closed:
            if not self.ready:
                try:
                    self._make_ready()
                except (IndiError, ValueError, OSError) as err:
                    self.why = str(err)
            self._wake.wait(self._retry)
            self._wake.clear()

    def _make_ready(self):
        device = find_device(self.client, self._device)
        telescope = IndiTelescope(self.client, device, self._axes)
        telescope.connect()
        if telescope.kind not in ('', self.mount.kind):
            raise IndiError(f'{device} is a mount of the kind {telescope.kind}, and the parameter '
                            f'mount says {self.mount.kind}')
        there = telescope.site
        apart = there is None or np.abs(wrap(np.array(there[:2]) - (
            self.site.latitude, self.site.longitude))).max() > 1e-6
        if apart and not self._set_site:
            raise IndiError(f'{device} stands elsewhere than the parameters of the site say')
        if self._period_ms and telescope.get('POLLING_PERIOD') is not None:
            self.client.send(device, 'POLLING_PERIOD', PERIOD_MS=float(self._period_ms))
        telescope.prepare(self.site if apart else None)
        if apart and telescope.has_axes:
            # its axes may stand at another hour angle now; some say so only where they do
            told = time.time_ns()
            with contextlib.suppress(IndiError):
                self.client.wait(lambda: telescope.axes[1] > told, 'no reading', NEW_SITE)
        if self._wants_one and self._dead_man is None:
            self._dead_man = DeadMan(self.client.host, self.client.port, device)
        self.telescope = self._ticks.telescope = telescope
        self.ready, self.why = True, ''

    # --- readings -----------------------------------------------------------------------------

    def _take(self, tick):
        """In the thread of the connection."""
        with self._lock:
            if tick.stamp > self._told:
                self._told = tick.stamp
                self._readings.append((tick.stamp, np.array(self.mount.on_travel(*tick.axes))))
        if tick.tracking:
            self._fresh = tick

    def readings(self):
        """Those since the last call: list of (ns, angles (2,) in rad, on the travel)."""
        telescope = self.telescope
        if not self.ready or telescope is None:
            self._readings.clear()
            return []
        now = time.time_ns()
        with self._lock:
            if not self._readings and now - self._told > STILL * 1e9:
                self._say_again(telescope, now)
            out = list(self._readings)
            self._readings.clear()
        if out:
            self._last = out[-1]
        return out

    def _say_again(self, telescope, now):
        """Axes that stand, or that are not told at all."""
        if telescope.has_axes:
            # a mount that tracks and says nothing is no mount that stands
            tracks = telescope.get(TRACK)
            if self._told and tracks is not None and tracks.on == 'TRACK_ON':
                return
            angles = np.array(self.mount.on_travel(*telescope.axes[0]))
        else:
            place = telescope.place
            if place is None:
                return
            side = telescope.get(SIDE)
            beyond = bool(self.mount.kind == 'german' and side is not None
                          and side.on == 'PIER_WEST')
            angles = np.array(axes_at(self.mount, *place[0], now * 1e-9, self.site, beyond))
        self._told = now
        self._readings.append((now, angles))

    # --- orders -------------------------------------------------------------------------------

    def command(self, start, times, angles, rates=None):
        """Take a track: a new one, or the next piece of the one that is followed.

        A piece that goes on with the track within the tolerance sends nothing to the driver. A
        track at rest that is over within `STOP` is a stop.

        Parameters
        ----------
        start : int
            ns.
        times : ndarray, shape (n,)
            s since then.
        angles, rates : ndarray, shape (n, 2)
            Of the axes, rad and rad/s.

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
        beside = np.inf
        if self._track is not None:
            now = max(track[0][0], time.time())
            beside = np.abs(wrap(self.demand(now) - _at(track, now))).max()
        self._track = track
        if beside <= self._follower.tolerance:
            return
        if beside > FAR:
            self._follower.begin()
        self._fresh, self._sent, self._beside = None, 0.0, ''

    def demand(self, now):
        """Angles of the commanded track at a time, rad, shape (1, 2)."""
        return _at(self._track, now)

    def step(self):
        """Send the mount on where its axes are not on the track.

        Raises
        ------
        IndiError
            The driver does not take it: it is made ready again.
        """
        try:
            self._tell_dead_man()
            self._step()
        except IndiError as err:
            self.ready, self.why, self._sent = False, str(err), 0.0
            self._wake.set()
            raise

    def _tell_dead_man(self):
        now = time.monotonic()
        if self._dead_man is None or now - self._told_it < HEARTBEAT:
            return
        self._told_it = now
        # lost with the connection is not stopped: it stays armed
        if not self._dead_man.tell(self._track is not None or not self.ready):
            self._dead_man = None
            raise IndiError('the process that stops the mount if this one dies has ended: it is '
                            'started again')

    def _step(self):
        telescope, track = self.telescope, self._track
        if not self.ready or telescope is None or track is None:
            return
        now = time.time()
        if now > track[0][-1]:
            # nobody renewed it: what is not commanded is not followed
            self._track = None
            telescope.abort()
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
        else:
            return
        demand = self.demand(stamp)[0]
        self._beside = ''
        if self._follower.other_side(demand, reading):
            self._beside = ('the driver took the other side of the pier than was commanded: '
                            'nearer to the meridian it chooses by itself')
        elif self._follower.learn(demand, reading):
            self._send(telescope, now)

    def _send(self, telescope, now):
        telescope.goto(*self._follower.target(self.demand(now)[0], now))
        self._sent = now

    def abort(self):
        """Stop at once, and stand."""
        self._track = None
        self._need().abort()

    def unpark(self):
        """Be ready for commands."""
        telescope = self._need()
        if telescope.parked:
            telescope.prepare()

    def _need(self):
        if not self.ready or self.telescope is None:
            raise IndiError(self.why)
        return self.telescope

    # --- what is told -------------------------------------------------------------------------

    def state(self):
        """In words, '' for all right: (sentence, whether nothing can be done)."""
        if not self.ready:
            return self.why, True
        if self._beside:
            return self._beside, False
        telescope = self.telescope
        if telescope is not None and not telescope.has_axes:
            return NO_AXES, False
        return '', False

    def details(self):
        """Rows for people."""
        telescope = self.telescope
        side = telescope.get(SIDE) if telescope is not None else None
        last = self._last
        return [('device', telescope.device if telescope is not None else ''),
                ('ready', str(self.ready)),
                ('side of the pier', side.on if side is not None else ''),
                ('through the pole', str(bool(is_beyond(last[1][1]))) if last else ''),
                ('sent farther than demanded [deg]',
                 ', '.join(f'{v / DEG:.4f}' for v in self._follower.correction))]


def _at(track, now):
    """Angles of a track, (times, angles), at a time, rad, shape (1, 2)."""
    times, angles = track
    return np.array([[np.interp(now, times, axis) for axis in angles.T]])
