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

"""Encoder demands for a target, and the commanded track."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import wrap
from pointing_model.active_calibration import pointing_context
from pointing_model.mounts import ALTAZ, through_pole

#: seconds between the knots of a commanded track; cubic interpolation is accurate to 1e-3 arcsec
KNOT = 20.0


class Conditions(NamedTuple):
    """Conditions of a pointing.

    Attributes
    ----------
    site : site.Site
    air : refraction.Weather
        With the present temperature.
    here : ndarray, shape (2,)
        Encoder angles of the mount, rad.
    run : int
        Number of the power-on.
    row : dict or None
        The previous observation in the same power-on.
    """

    site: object
    air: object
    here: np.ndarray
    run: int
    row: dict | None


class Pointing:
    """A target while the mount is pointed at it.

    Parameters
    ----------
    target : StarTarget or SatelliteTarget
    active : ActiveCalibration
    aim : ndarray, shape (2,)
        Offset of the pointing in addition to model and zero, rad.
    mount : Mount, optional
    meridian_limit : float
        Limit of a German mount past the meridian, rad.

    Attributes
    ----------
    beyond : bool or None
        Whether the mount points there through the pole; None before the first demand.
    approach : ndarray, shape (2,), or None
        Sign of the approach of the axes to the target; None before the first command.
    knot : float
        s between the knots of its tracks.
    until : float
        End of its tracks at the latest, UTC s.
    """

    until = np.inf

    def __init__(self, target, active, aim, mount=ALTAZ, meridian_limit=0.0):
        self.target, self.aim, self.mount = target, aim, mount
        self.beyond = self.approach = None
        self.knot = KNOT
        self._active, self._limit = active, meridian_limit

    def place(self, stamps, site, air):
        """Angles (n,), (n,) at which the axes of a perfect mount point at the target, rad.

        The side of the pier is chosen at the first call. If both sides reach the target, the
        parity of its number decides, so that both sides get stars.
        """
        az, el = self.target.place(stamps * 1e-9, site, air)
        if self.mount.vertical:
            return az, el
        first, second = self.mount.axes_of(az, el)
        if self.beyond is None:
            self.beyond = bool(self.mount.side_for(
                first[0], second[0], self._limit, self.target.number % 2 == 1))
        first, second = self.mount.on_travel(*through_pole(first, second, self.beyond))
        return first[0] + wrap(first - first[0]), second

    def demand(self, stamps, conditions):
        """Encoder angles (n, 2), rad, at each stamp (n,), ns."""
        az, el = self.place(stamps, conditions.site, conditions.air)
        context = self._context(stamps, az, el, conditions)
        return self._active.encoder(az, el, context) + self.aim

    def _context(self, stamps, az, el, conditions):
        """Drivers of the model's effects; None if it has none."""
        model = self._active.model
        if model is None or not model.effects:
            return None
        known = {'temperature': conditions.air.temperature_c,
                 'pressure': conditions.air.pressure_hpa, 'magnitude': self.target.magnitude,
                 'star': np.array(self.target.number), 'run': conditions.run}
        return pointing_context(
            model, stamps, az, el, known, zero=self._active.zero_now,
            here=conditions.here, approach=self.approach, row=conditions.row,
            site=conditions.site, mount=self.mount)


class AxesAtRest:
    """The mount stays at its position.

    Parameters
    ----------
    here : ndarray, shape (2,)
        Encoder angles, rad.
    mount : Mount, optional
    """

    until = np.inf

    def __init__(self, here, mount=ALTAZ):
        self.approach, self.mount, self.knot = None, mount, KNOT
        self._here = here

    def demand(self, stamps, conditions):
        """Encoder angles (n, 2), rad, at each stamp (n,)."""
        return np.tile(self._here, (len(stamps), 1))


class Track(NamedTuple):
    """Knots of a commanded track.

    Attributes
    ----------
    start : int
        ns.
    times : ndarray, shape (n,)
        Seconds since `start`.
    angles, rates : ndarray, shape (n, 2)
        Encoder angles and rates, rad and rad/s.
    """

    start: int
    times: np.ndarray
    angles: np.ndarray
    rates: np.ndarray

    @property
    def end(self):
        """End of the track, ns."""
        return self.start + round(self.times[-1] * 1e9)

    def at(self, stamp):
        """Angles at one or several stamps, ns: shape (2,) or (n, 2); constant beyond the track."""
        seconds = (np.asarray(stamp) - self.start) * 1e-9
        return np.stack([np.interp(seconds, self.times, axis) for axis in self.angles.T], axis=-1)

    def demand(self, stamp):
        """Angles at a stamp, shape (2,); None outside the track."""
        return self.at(stamp) if self.times[0] <= (stamp - self.start) * 1e-9 <= self.times[
            -1] else None


def on_sky(reading, demand):
    """Difference of two pairs of encoder angles on the sky, rad, shape (2,)."""
    return np.array([wrap(reading[0] - demand[0]) * np.cos(demand[1]), reading[1] - demand[1]])


def track_to(pointing, start, conditions, slew_rate):
    """Track of a target from `start` on; stores the direction of approach in `pointing`.

    Parameters
    ----------
    pointing : Pointing or AxesAtRest
    start : int
        ns.
    conditions : Conditions
    slew_rate : float
        Slew rate of the mount, deg/s.

    Returns
    -------
    Track
        Long enough for half a turn, settling and exposure.
    """
    length = min(60.0 + 200.0 / slew_rate + KNOT, pointing.until - start * 1e-9)
    times = np.arange(0.0, max(length, 3.0 * pointing.knot), pointing.knot)
    angles = pointing.demand(start + (times * 1e9).astype(np.int64), conditions)
    here = conditions.here
    move = np.array([pointing.mount.way(here[0], angles[0, 0]), angles[0, 1] - here[1]])
    if pointing.approach is None:  # later moves to the same star are small
        pointing.approach = np.sign(move)
    # azimuth goes the shorter way from here; limits of the mount are handled by the driver
    angles[:, 0] = here[0] + move[0] + (np.unwrap(angles[:, 0]) - angles[0, 0])
    return Track(start, times, angles, np.gradient(angles, pointing.knot, axis=0, edge_order=2))
