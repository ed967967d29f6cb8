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

"""A bench on which time goes by: the mount slews, and each instrument may fail."""

import functools

import numpy as np
from bench import SECOND, Bench

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.observing.instruments import ABSOLUTE, CAMERA, MOUNT

STEP = 0.05  # s
SPEED = 4.0 * DEG  # rad/s


@functools.cache
def catalogue():
    return load_catalogue(mag_limit=5.0)


def pairs(rng):
    """Standard normal pairs without end, drawn many at a time."""
    while True:
        yield from rng.standard_normal((1000, 2))


class Live(Bench):
    """A bench on which time goes by in steps, and the mount slews.

    Attributes
    ----------
    stamps : dict of str to callable
        What an instrument makes of the time, ns.
    every : float
        Time between exposures, s.
    """

    def __init__(self, plan, **settings):
        super().__init__(plan, homed=False, live=True, **{'magnitude_limit': 5.0, **settings})
        self.stamps = {}
        self.every = 0.6
        self.drives = lambda way: way
        self.frame = lambda miss: miss
        self.reads = self.reads_absolute = tuple
        self.noise = pairs(np.random.default_rng(1))
        self.count = 0
        self.begin = self.stamp
        self.offers('home', lambda: None)

    def send_command(self, track):
        super().send_command(track)
        self.track = track
        stars = catalogue()
        az, el = observed_place(stars, track.start * 1e-9)
        nearest = np.argmin(np.hypot(wrap(az - track.angles[0, 0]) * np.cos(el),
                                     el - track.angles[0, 1]))
        az, el = observed_place(stars.select(np.full(len(track.times), nearest)),
                                track.start * 1e-9 + track.times)
        az = track.angles[0, 0] + wrap(az - track.angles[0, 0])
        self.star = track._replace(angles=np.column_stack([az, el]) + self.off)

    track = star = None
    off = np.zeros(2)  # of the star from its place

    @staticmethod
    def _at(track, stamp):
        at = (stamp - track.start) * 1e-9
        return np.array([np.interp(at, track.times, axis) for axis in track.angles.T])

    def _slew(self):
        if self.track is None:
            return
        way = np.clip(self._at(self.track, self.stamp) - self.position, -SPEED * STEP,
                      SPEED * STEP)
        self.position = self.position + self.drives(way)

    def _try(self, take, *args):
        try:
            take(*args)
        except ValueError as err:
            self.refused.append(str(err))

    def tick(self):
        self.wall += STEP
        self.stamp += round(STEP * SECOND)
        self.count += 1
        self._slew()
        same = dict.fromkeys((MOUNT, ABSOLUTE, CAMERA), lambda stamp: stamp) | self.stamps
        if MOUNT in self.answers:
            self._try(self.instruments.take_incremental, same[MOUNT](self.stamp),
                      self.reads(self.position + 0.2 * ARCSEC * next(self.noise)),
                      (0.0, 0.0))
        if ABSOLUTE in self.answers:
            self._try(self.instruments.take_absolute, same[ABSOLUTE](self.stamp - 1),
                      self.reads_absolute(self.position + 0.2 * ARCSEC * next(self.noise)))
        if CAMERA in self.answers and self.count % round(self.every / STEP) == 0:
            self._try(self.instruments.take_frame, same[CAMERA](self.stamp - SECOND // 4),
                      *self.frame(self._see()))
        self.plan.advance()
        if self.count % 10 == 0:
            self.plan.look(self.wall)

    def _see(self):
        """The miss distance of the commanded star, NaN beyond the field."""
        if self.track is None:
            return np.full(2, np.nan)
        star = self._at(self.star, self.stamp - SECOND // 4)
        miss = np.array([wrap(star[0] - self.position[0]) * np.cos(star[1]),
                         star[1] - self.position[1]])
        seen = np.hypot(*miss) < 0.3 * DEG
        return miss + ARCSEC * next(self.noise) if seen else np.full(2, np.nan)

    def read(self, stamp, angles):
        self.wall += (stamp - self.stamp) / SECOND  # both clocks go on together
        super().read(stamp, angles)

    def lasts(self, seconds):
        for _ in range(round(seconds / STEP)):
            self.tick()
        return self

    def names(self, words, within=2.0):
        """Waits for a sentence in the status; how long that took, s."""
        since = self.wall
        while not any(words in text for _, text in self.statuses[-1:]):
            assert self.wall - since <= within + 1e-9, (self.statuses[-1:], self.plan.faults)
            self.tick()
        return self
