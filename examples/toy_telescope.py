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

"""A toy telescope behind a TCP port: the hardware that the sample drivers talk to.

Each line is a request, answered by a line; angles are degrees, as in some controllers:

- ``axes``: time (UTC, s), both readings and both rates; nan before the marks were passed
- ``move T A E VA VE``: be at A, E at time T with these rates; valid until half a second later
- ``stop``, ``home``
- ``expose S``: open the shutter; the middle of the exposure (UTC, s) and the offset of the
  brightest star of the field from the boresight, to the right and to the top of the tube, arcsec

Its pointing errors are in `TERMS`, for a fit to find. With a satellite (`--satellite 'L52
orbit.sp3'`) its camera measures that as the brightest star.
"""

import argparse
import contextlib
import socketserver
import threading
import time


class Talk(socketserver.StreamRequestHandler):
    """A connection."""

    def handle(self):
        """Answer line by line."""
        with contextlib.suppress(ConnectionError):
            for line in self.rfile:
                verb, *numbers = line.decode().split()
                answer = getattr(self.server.telescope, verb)(*map(float, numbers))
                self.wfile.write((' '.join(f'{v:.9f}' for v in answer) + '\n').encode())


class Server(socketserver.ThreadingTCPServer):
    """The port."""

    allow_reuse_address = daemon_threads = True


if __name__ == '__main__':  # first of all: drivers started at the same time find the port
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--port', type=int, default=7625)
    parser.add_argument('--satellite', default='', metavar='ID FILE', help='one more light')
    given = parser.parse_known_args()[0]  # ROS has more
    server = Server(('localhost', given.port), Talk)

import numpy as np  # noqa: E402

from pointing_model.model import PointingModel  # noqa: E402
from pointing_model.sky.places import observed_place  # noqa: E402
from pointing_model.sky.refraction import DEFAULT_WEATHER  # noqa: E402
from pointing_model.sky.site import DEFAULT_SITE  # noqa: E402
from pointing_model.sky.star_catalogue import load_catalogue, satellite_target  # noqa: E402

TERMS = {'IA': 180.0, 'IE': -90.0, 'CA': 20.0, 'NPAE': -8.0, 'AN': 12.0, 'AW': -25.0, 'TF': 15.0}
SPEED = 15.0  # deg/s
FIELD, BLURRED = np.radians(0.3), np.radians(0.02)
ARCSEC = np.radians(1.0 / 3600.0)


class Telescope:
    """Two axes that follow what they were told last, and a camera on them."""

    def __init__(self, seed=1, satellite=''):
        self._lock = threading.Lock()
        self._rng = np.random.default_rng(seed)
        self._at, self._angles, self._rates = time.time(), np.array([170.0, 45.0]), np.zeros(2)
        self._wanted = None
        self._homed = False
        self._model = PointingModel({name: value * ARCSEC for name, value in TERMS.items()})
        self._stars, self._satellite = load_catalogue(mag_limit=6.5), satellite_target(satellite)

    def _advance(self):
        now = time.time()
        elapsed, self._at = now - self._at, now
        self._rates = np.zeros(2)
        if self._wanted is None or elapsed <= 0.0:
            return now
        when, angles, rates = self._wanted
        if now > when + 0.5:  # no more commands
            self._wanted = None
            return now
        way = angles + rates * (now - when) - self._angles
        step = np.clip(way, -SPEED * elapsed, SPEED * elapsed)
        self._angles, self._rates = self._angles + step, step / elapsed
        return now

    def axes(self):
        """Time, readings, rates."""
        with self._lock:
            now = self._advance()
            if not self._homed:
                return now, *[np.nan] * 4
            return now, *(self._angles + self._rng.normal(0.0, 0.2 / 3600.0, 2)), *self._rates

    def move(self, when, *numbers):
        """Set the next set point."""
        with self._lock:
            self._advance()
            self._wanted = when, np.array(numbers[:2]), np.array(numbers[2:])
        return ()

    def stop(self):
        """Stop."""
        with self._lock:
            self._advance()
            self._wanted = None
        return ()

    def home(self):
        """Pass the marks."""
        time.sleep(1.0)  # the toy's marks take so long
        self._homed = True
        return ()

    def expose(self, seconds):
        """Middle of the exposure and the star's offset, arcsec; nan without a star."""
        times, seen = [], []
        while not times or times[-1] < times[0] + seconds:
            with self._lock:
                times.append(self._advance())
                seen.append(self._angles)
            time.sleep(seconds / 20.0)  # the shutter is open: samples of where the tube looks
        middle = 0.5 * (times[0] + times[-1])
        right, up = self._beside(np.mean(seen, axis=0), middle)
        field = np.flatnonzero(np.hypot(right, up) < FIELD)
        if not len(field):
            return middle, np.nan, np.nan
        # the brightest comes first
        ends = [np.array(self._beside(angles, at))[:, field[0]]
                for angles, at in ((seen[0], times[0]), (seen[-1], times[-1]))]
        if np.abs(np.subtract(*ends)).max() > BLURRED:
            return middle, np.nan, np.nan
        return middle, *(np.array([right[field[0]], up[field[0]]]) / ARCSEC
                         + self._rng.normal(0, 1, 2))

    def _beside(self, angles, when):
        """Offsets of all objects to the right and top of a tube whose axes read `angles`, rad."""
        az, el = self._model.encoder_to_sky(*np.radians(angles))
        sky = np.array(observed_place(self._stars, when, DEFAULT_SITE, DEFAULT_WEATHER))
        sky = sky[:, np.argsort(self._stars.mag)]
        if self._satellite is not None:
            place = self._satellite.place(np.array([when]), DEFAULT_SITE, DEFAULT_WEATHER)
            sky = np.hstack([place, sky])
        beside = sky[0] - az
        along = np.sin(el) * np.sin(sky[1]) + np.cos(el) * np.cos(sky[1]) * np.cos(beside)
        along[along <= 0.0] = np.nan  # behind it
        return (np.cos(sky[1]) * np.sin(beside) / along, (
            np.cos(el) * np.sin(sky[1]) - np.sin(el) * np.cos(sky[1]) * np.cos(beside)) / along)


if __name__ == '__main__':
    server.telescope = Telescope(satellite=given.satellite)
    with contextlib.suppress(KeyboardInterrupt), server:
        server.serve_forever()
