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

"""A mount, an encoder and a camera in real time, in the process of a benchmark.

These are drivers as a user writes them (docs/real_mount.md), each of which may fail at a given
moment, and an independent check of the commands to the mount. The site is where it is midnight, so
results do not depend on the time of day.
"""

import time
from dataclasses import replace
from pathlib import Path

import erfa
import numpy as np
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.status_rows import Progress
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.processes import domain
from telescope_mount.processes.node_processes import Processes
from telescope_mount.running_graph.watcher import Watcher

#: s between readings, and between exposures
READINGS, IMAGES = 0.05, 0.25
FIELD = 0.3 * DEG
#: by which the mount points beside, rad
BESIDE = np.array([180.0, -90.0]) * ARCSEC
#: of mount_guard in these nights: fast, so that a pointing takes seconds
GUARD = {'first_rate_deg_s': 20.0, 'second_rate_deg_s': 20.0, 'first_acceleration_deg_s2': 15.0,
         'second_acceleration_deg_s2': 15.0}
TRAVEL = ((-270.0, 270.0), (-5.0, 95.0))
LEAST_ELEVATION, SUN = 10.0, 20.0


def hermite(start, times, angles, rates, stamp):
    """Angles (2,) of a trajectory at `stamp` (ns); at its ends it rests."""
    t = (stamp - start) * 1e-9
    if t <= times[0] or len(times) == 1:
        return angles[0]
    if t >= times[-1]:
        return angles[-1]
    i = int(np.searchsorted(times, t, side='right')) - 1
    h = times[i + 1] - times[i]
    s = (t - times[i]) / h
    a, b, va, vb = angles[i], angles[i + 1], rates[i] * h, rates[i + 1] * h
    return a + s * (va + s * (3 * (b - a) - 2 * va - vb + s * (va + vb - 2 * (b - a))))


def sun_of_greenwich(when):
    """Hour angle at Greenwich and declination of the Sun at a UTC time, s, rad; to arcminutes."""
    days = when / 86400.0
    earth = erfa.epv00(2440587.5, days)[0][0]
    x, y, z = -np.asarray(earth)
    angle = erfa.gst06a(2440587.5, days, 2440587.5, days)
    return angle - np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))


def midnight_site(when):
    """A site at which it is midnight at a UTC time, s."""
    longitude = float(wrap(np.pi - sun_of_greenwich(when)[0]))
    return replace(DEFAULT_SITE, longitude=longitude)


def sun_place(when, site):
    """Azimuth and elevation of the Sun, rad."""
    hour, dec = sun_of_greenwich(when)
    return erfa.hd2ae(hour + site.longitude, dec, site.latitude)


def apart(one, other):
    """Angle between two places (az, el), rad."""
    return erfa.seps(one[0], one[1], other[0], other[1])


class LiveMount:
    """The drivers.

    Parameters
    ----------
    node : rclpy.node.Node
        On whose topics they are.
    seed : int
        Of the noise.
    site : Site

    Attributes
    ----------
    reading, miss : callable
        ``reading(stamp, angles)`` gives the stamp and the angles that are published, or None;
        ``miss(stamp, x, y)`` the same of the camera.
    joints : tuple of str
    deaf : bool
        Whether commands are ignored.
    images : float
        s between exposures.
    beyond : list of str
        What was commanded beyond the limits.
    """

    def __init__(self, node, seed=1, site=DEFAULT_SITE):
        self._node, self._rng, self._site = node, np.random.default_rng(seed), site
        self.position, self._path = np.array([170.0, 45.0]) * DEG, None
        self.reading = lambda stamp, angles: (stamp, angles)
        self.miss = lambda stamp, x, y: (stamp, x, y)
        self.joints, self.deaf = ('azimuth', 'elevation'), False
        self.images, self.beyond, self.commands = IMAGES, [], 0
        self.sent_far = self.last_reading = self.last_image = None
        self.images_at, self.longest = [], 0.0
        self.first_star = self.first_number = None
        self._stars = load_catalogue(mag_limit=6.5)
        self._places = None
        self._last = time.monotonic()
        self._next = [0.0, 0.0]
        self.homed = False
        self._reads = node.create_publisher(topics.INCREMENTAL.message, topics.INCREMENTAL.name,
                                            topics.INCREMENTAL.qos)
        self._sees = node.create_publisher(topics.MISS_DISTANCE.message, topics.MISS_DISTANCE.name,
                                           topics.MISS_DISTANCE.qos)
        node.create_subscription(topics.COMMAND.message, topics.COMMAND.name, self._on_command,
                                 topics.COMMAND.qos)

    def offer_home(self):
        """Offer the service."""
        self._node.create_service(Trigger, 'home', self._on_home)

    def _on_home(self, request, response):
        self.homed = True
        response.success, response.message = True, 'both axes have met their marks'
        return response

    def _on_command(self, message):
        path = convert.read_trajectory(message)
        self.commands += 1
        self._judge(path)
        end = path[2][-1]
        if self.sent_far is None and np.abs(end - self.position).max() > 0.1 * DEG:
            self.sent_far = time.time()
        if not self.deaf:
            self._path = path

    def _judge(self, path):
        """Nothing of this is the guard's."""
        start, times, angles, rates = path
        at = start + (np.arange(0.0, times[-1] + 0.05, 0.05) * 1e9).astype(np.int64)
        way = np.array([hermite(start, times, angles, rates, stamp) for stamp in at])
        for i, (low, high) in enumerate(TRAVEL):
            if (way[:, i] < low * DEG).any() or (way[:, i] > high * DEG).any():
                self.beyond.append(f'axis {i} to {way[:, i].min() / DEG:.2f} ... '
                                   f'{way[:, i].max() / DEG:.2f} deg')
        if way[:, 1].min() < LEAST_ELEVATION * DEG:
            self.beyond.append(f'elevation {way[:, 1].min() / DEG:.2f} deg')
        speed = np.abs(np.diff(way, axis=0)).max(initial=0.0) / 0.05
        if speed > 20.5 * DEG:
            self.beyond.append(f'{speed / DEG:.1f} deg/s')
        sun = sun_place(start * 1e-9, self._site)
        near = apart((way[:, 0], way[:, 1]), sun).min() / DEG
        if near < SUN - 0.2:  # of the Sun's place here
            self.beyond.append(f'{near:.2f} deg from the Sun')

    def step(self):
        """What is due by now."""
        now, stamp = time.monotonic(), time.time_ns()
        if self._path is not None and not self.deaf:
            self.position = hermite(*self._path, stamp)
        if now >= self._next[0]:
            self._next[0] = max(now, self._next[0] + READINGS)
            angles = self.position + self._rng.normal(0.0, 0.1 * ARCSEC, 2)
            if not self.homed:
                angles = np.full(2, np.nan)
            out = self.reading(stamp, angles)
            if out is not None:
                self.last_reading = time.time()
                if self.homed and self.first_number is None:
                    self.first_number = self.last_reading
                self._reads.publish(self._joints(*out))
        if now >= self._next[1]:
            self._next[1] = max(now, self._next[1] + self.images)
            out = self.miss(stamp, *self._see(stamp))
            if out is not None:
                if self.last_image is not None:
                    self.longest = max(self.longest, time.time() - self.last_image)
                self.last_image = time.time()
                self.images_at.append(self.last_image)
                if np.isfinite(out[1]) and self.first_star is None:
                    self.first_star = self.last_image
                self._sees.publish(convert.sky_vector(*out))

    def _joints(self, stamp, angles):
        message = convert.joint_state(stamp, angles)
        message.name = list(self.joints)
        return message

    def _see(self, stamp):
        """The star nearest to the boresight, NaN beyond the field."""
        if self._places is None or stamp - self._places[0] > 5e9:
            self._places = stamp, *observed_place(self._stars, stamp * 1e-9, self._site,
                                                  DEFAULT_WEATHER)
        _, az, el = self._places
        looks = self.position - BESIDE
        near = np.flatnonzero(np.hypot(wrap(az - looks[0]) * np.cos(el), el - looks[1])
                              < FIELD + 0.03 * DEG)
        if not len(near):
            return np.nan, np.nan
        az, el = observed_place(self._stars.select(near), stamp * 1e-9, self._site,
                                DEFAULT_WEATHER)
        x, y = wrap(az - looks[0]) * np.cos(el), el - looks[1]
        far = np.hypot(x, y)
        best = int(np.argmin(far))
        if far[best] > FIELD:
            return np.nan, np.nan
        noise = self._rng.normal(0.0, ARCSEC, 2)
        return x[best] + noise[0], y[best] + noise[1]


class Night:
    """Nodes as processes beside a `LiveMount`; a context manager.

    Parameters
    ----------
    folder : Path
    specs : list of graph.NodeSpec
    seed : int
    """

    def __init__(self, folder, specs, seed=1):
        self.folder, self.specs = Path(folder), {spec.name: spec for spec in specs}
        self._lock = domain.claim(None)
        self.nodes = Processes(self.folder / 'nodes', self._lock.number)
        self.watcher = Watcher('drivers', self._lock.number, self.nodes.environment, lambda: None)
        self.watcher.keep_results()
        site = midnight_site(time.time())
        for spec in specs:
            if spec.name in ('mount_guard', 'star_observer'):
                spec.parameters.update(latitude_deg=site.latitude / DEG,
                                       longitude_deg=site.longitude / DEG)
        self.mount = LiveMount(self.watcher.node, seed, site)
        self.heard = []  # (time, where, text)
        for topic, name in ((topics.OBSERVER_STATUS, 'observer'), (topics.GUARD_STATUS, 'guard')):
            self.watcher.node.create_subscription(
                topic.message, topic.name, lambda message, name=name: self._say(
                    'status', f'{name}: {message.message}'), topic.qos)
        self.watcher.node.create_subscription(
            topics.DIAGNOSTICS.message, topics.DIAGNOSTICS.name, self._on_diagnostics,
            topics.DIAGNOSTICS.qos)

    def _say(self, where, text):
        self.heard.append((time.time(), where, text))

    def _on_diagnostics(self, message):
        for status in message.status:
            # level is bytes in rclpy
            if status.level not in (b'\0', 0):
                self._say('diagnostics', f'{status.name.rsplit("/", 1)[-1]}: {status.message}')

    def start(self, *names):
        """Start nodes, all of them by default."""
        for name in names or self.specs:
            self.nodes.start(self.specs[name])

    def progress(self):
        """Progress of the observer."""
        return Progress.read(self.watcher.latest.get(topics.OBSERVER_STATUS.name))

    def text(self):
        """Text of the observer's status."""
        status = self.watcher.latest.get(topics.OBSERVER_STATUS.name)
        return '' if status is None else status.message

    def until(self, condition, timeout):
        """Continue until `condition()`; return whether it became true."""
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                return False
            self.watcher.spin(0.005)
            self.mount.step()
        return True

    def lasts(self, seconds):
        """Continue for a time."""
        self.until(lambda: False, seconds)

    def log(self, name):
        """Lines of a node's log: time and text."""
        path = self.folder / 'nodes' / f'{name}.log'
        out = []
        for line in path.read_text(errors='replace').splitlines() if path.exists() else ():
            parts = line.split('] ', 2)
            if line.startswith('[') and len(parts) == 3:
                out.append((float(parts[1].strip('[]')), f'{parts[0]}] {parts[2]}'))
        return out

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.watcher.close()
        self.nodes.stop()
        self._lock.release()
