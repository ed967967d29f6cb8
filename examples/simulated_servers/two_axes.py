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

"""A telescope of two axes with errors of its parts, for trials and tests.

Its driver does not know the errors: it goes to a place as if the mount were perfect and reports
its axis readings, while the tube points elsewhere. The parts are rotated one after the other; no
formula of the pointing model is used.
"""

import threading
import time

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.sky.places import sidereal_time
from telescope_mount.bridges.axes_and_places import axes_at, place_of_date

#: slewing speed of the axes, both at once, rad/s
SPEED = 6.0 * DEG
#: terms of mounts with vertical first axis, or not: zeros, collimation, non-perpendicularity, tilt
TERMS = {True: ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW'),
         False: ('IH', 'ID', 'CH', 'NP', 'ME', 'MA')}


def draw_errors(seed, names):
    """Random errors of a mount, encoder - catalogue, named as in the pointing model.

    Parameters
    ----------
    seed : int
    names : collection of str
        Names of the terms.

    Returns
    -------
    dict of str to float
        rad, 0.02 to 0.1 deg each.
    """
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.02, 0.1, len(names)) * rng.choice((-1.0, 1.0), len(names))
    # INDI's simulator accepts this number of digits
    return {name: round(float(value), 5) * DEG for name, value in zip(names, values)}


class TwoAxes:
    """The telescope; each query moves it to the present time. Thread-safe.

    Parameters
    ----------
    mount : Mount
    site : Site
    errors : dict of str to float
        See `draw_errors`; omitted ones are 0.
    clock : callable
        UTC, s since 1970.

    Attributes
    ----------
    slewing, tracking : bool
    """

    def __init__(self, mount, site, errors=None, clock=time.time):
        self.mount, self.site, self._clock = mount, site, clock
        errors = errors or {}
        names = TERMS[mount.vertical]
        unknown = set(errors) - set(names)
        if unknown:
            raise ValueError(f'{", ".join(sorted(unknown))}: a mount that is {mount.kind} has '
                             f'{", ".join(names)} here')
        values = [errors.get(name, 0.0) for name in names]
        self._zeros, (self._cone, self._skew) = np.array(values[:2]), values[2:4]
        # AN and AW of an alt-azimuth mount; MA has the opposite sign
        self._lean = values[4], values[5] if mount.vertical else -values[5]
        self.slewing = self.tracking = False
        self._axes, self._place, self._beyond = np.array([0.0, 80.0 * DEG]), None, False
        self._at, self._lock = clock(), threading.Lock()

    # --- orders -------------------------------------------------------------------------------

    def goto(self, ra, dec):
        """Slew to a place of date, rad, and track it."""
        with self._lock:
            self._go_on()
            hour_angle = sidereal_time(self._at, self.site) - ra
            self._beyond = bool(self.mount.side_for(hour_angle, dec, 0.0, False))
            self._place, self.slewing, self.tracking = (ra, dec), True, True

    def track(self, on):
        """Track the sky from the current position, or stand still."""
        with self._lock:
            self._go_on()
            if self.slewing:
                return
            if on and not self.tracking:
                self._place = place_of_date(self.mount, self._axes, self._at, self.site)
                self._beyond = bool(np.cos(self._axes[1]) < 0.0)
            self.tracking = on

    def abort(self):
        """Stop immediately, without tracking."""
        with self._lock:
            self._go_on()
            self.slewing = self.tracking = False

    # --- what it tells ------------------------------------------------------------------------

    def look(self):
        """Current position.

        Returns
        -------
        axes : ndarray, shape (2,)
            Readings within the travel, rad; azimuth from 0 to 2 pi.
        believed, true : tuple of float
            Right ascension and declination of date, by its driver and of the tube, rad.
        """
        with self._lock:
            self._go_on()
            axes, now = self._axes.copy(), self._at
        if self.mount.vertical:
            axes[0] = np.mod(axes[0], 2.0 * np.pi)
        true = self.mount.axes_of(*_azimuth_and_elevation(self._direction(axes)))
        return (axes, place_of_date(self.mount, axes, now, self.site),
                place_of_date(self.mount, true, now, self.site))

    @property
    def beyond(self):
        """Whether it points through the pole."""
        return bool(np.cos(self._axes[1]) < 0.0)

    def _go_on(self):
        now = self._clock()
        passed, self._at = now - self._at, now
        if not self.tracking:
            return
        there = np.array(axes_at(self.mount, *self._place, now, self.site, self._beyond))
        ahead = there - self._axes
        if self.mount.vertical:
            ahead[0] = wrap(ahead[0])
        most = SPEED * max(passed, 0.0) if self.slewing else np.inf
        self._axes = self._axes + np.clip(ahead, -most, most)
        self.slewing = self.slewing and bool(np.abs(ahead).max() > most)

    def _direction(self, axes):
        """East, north, up of the tube: its parts rotated one after the other."""
        first, second = np.asarray(axes) - self._zeros
        # collimation, second axis, non-perpendicularity, first axis
        tube = _turn((0.0, 1.0, 0.0), 0, 1, -self._cone)
        tube = _turn(_turn(tube, 2, 1, second), 0, 2, -self._skew)
        tube = _turn(tube, 0, 1, first)
        # tilt of the pole to the meridian, and to the left
        tube = _turn(_turn(tube, 1, 2, self._lean[0]), 0, 2, -self._lean[1])
        return np.array(self.mount.frame).T @ tube


def _turn(vector, to, of, angle):
    """Rotate a vector from the coordinate axis `of` toward the axis `to`."""
    out = np.array(vector, float)
    s, c = np.sin(angle), np.cos(angle)
    out[to], out[of] = c * vector[to] + s * vector[of], c * vector[of] - s * vector[to]
    return out


def _azimuth_and_elevation(direction):
    east, north, up = direction
    return np.arctan2(east, north), np.arctan2(up, np.hypot(east, north))
