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

"""Errors of the simulated mount: the parameters of every part, in SI.

The dataclasses hold the contents of a scenario file (`scenario_file`), whose keys end in the unit
of a data sheet (``an_arcsec``), without that ending (``an``). Each is defined next to the code that
applies it, those of sky and air here. The defaults are ideal: no error, no noise. So each effect is
switched on by its own number; docs/mount_effects.md has the sizes for good and bad instruments.
"""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import DEG
from pointing_model.mount_kinds import KINDS
from pointing_model.sky.refraction import DEFAULT_WEATHER

from . import keyed_noise
from .absolute import Absolute
from .axis_motion import AxisDynamics
from .drives import Coupling, Drive
from .field_kinds import both_axes, number, optional, section
from .incremental import Incremental
from .mount_geometry import MountErrors
from .seeing import AirLayers, Seeing
from .star_camera import CameraErrors
from .wind_gusts import Wind


@dataclass(frozen=True)
class TrueWeather:
    """The weather that refracts the light, whatever the observer assumes: hPa, degC, fraction, m.

    The temperature changes by `temperature_rate` (degC/s) from the start of the night, plus a sine
    of amplitude `temperature_swing` (degC) and period `swing_period` (s); it affects mount and
    encoders. Each night (24 h, the first from the start) has an additional independent uniform
    offset within a `nightly_range` (degC); `nightly_draw` selects the series of offsets.
    """

    pressure: float = number(DEFAULT_WEATHER.pressure_hpa, 'hpa', 0.0, 1100.0)
    temperature: float = number(10.0, 'c', -60.0, 60.0)
    humidity: float = number(50.0, 'percent', 0.0, 100.0)
    wavelength: float = number(0.55, 'um', 0.3, 20.0)
    temperature_rate: float = number(0.0, 'c_per_hour', -20.0, 20.0)
    temperature_swing: float = number(0.0, 'c', -30.0, 30.0)
    swing_period: float = number(1.0, 'h', 0.01, 1000.0)
    nightly_range: float = number(0.0, 'c', 0.0, 60.0)
    nightly_draw: int = number(1, '', 0, 2**31 - 1, kind=int)

    def temperature_at(self, time, start, behind=0.0):
        """Temperature (degC) at `time`, in a night that began at `start` (UTC s).

        Or that of a body with the time constant `behind` (s), which exchanges heat with the air in
        proportion to the difference (Newton), in the steady state: the response of a first-order
        low-pass filter to a ramp and to a sine.
        """
        seconds = np.asarray(time) - start
        turn = 2.0 * np.pi / self.swing_period
        swing = np.sin(turn * seconds - np.arctan(turn * behind)) / np.hypot(1.0, turn * behind)
        seconds = seconds - behind
        night = 0.0
        if self.nightly_range > 0.0:
            # it changes by day, an hour before the next night begins
            days = np.floor((seconds + behind + 3600.0) / 86400.0).astype(np.int64)
            night = self.nightly_range * (
                keyed_noise.uniform(self.nightly_draw, 'weather', 'night', days) - 0.5)
        return (self.temperature + self.temperature_rate * seconds
                + self.temperature_swing * swing + night)


@dataclass(frozen=True)
class Housing:
    """Mount and encoders become warmer than the air by `step` degC, `at` seconds after the start.

    With a `time_constant` (s) they do so exponentially.
    """

    step: float = number(0.0, 'c', -60.0, 60.0)
    at: float = number(0.0, 's', 0.0, 1e6)
    time_constant: float = number(0.0, 's', 0.0, 1e6)

    def excess(self, seconds):
        """Temperature above the air, degC, `seconds` after the start."""
        since = np.asarray(seconds, dtype=float) - self.at
        share = np.where(since >= 0.0, 1.0, 0.0)
        if self.time_constant > 0.0:
            share = -np.expm1(-np.maximum(since, 0.0) / self.time_constant)
        return self.step * share


@dataclass(frozen=True)
class TrueSite:
    """True position of the mount, rad, rad, m."""

    latitude: float = number(34.3, 'deg', -90.0, 90.0)
    longitude: float = number(109.0, 'deg', -180.0, 360.0)
    height: float = number(500.0, 'm', -500.0, 9000.0)


@dataclass(frozen=True)
class Scenario:
    """Everything that only the simulator knows.

    Attributes
    ----------
    name : str
    clock_offset : float
        True UTC - stamp, s.
    axes, incremental, absolute
        For `azimuth`, the first axis of any mount, and `elevation`, the second.
    drives, coupling
        Likewise: the servos, and the couplings of the incremental encoders.
    site : TrueSite or None
        None: as assumed by the observer.
    weather : TrueWeather or None
        None: as assumed by the observer.
    """

    name: str = 'ideal'
    clock_offset: float = number(0.0, 'ms', -600000.0, 600000.0)
    mount: MountErrors = section(MountErrors)
    axes: object = both_axes(AxisDynamics)
    incremental: object = both_axes(Incremental)
    absolute: object = both_axes(Absolute)
    camera: CameraErrors = section(CameraErrors)
    site: TrueSite | None = optional(TrueSite)
    weather: TrueWeather | None = optional(TrueWeather)
    housing: Housing = section(Housing)
    drives: object = both_axes(Drive)
    coupling: object = both_axes(Coupling)
    wind: Wind = section(Wind)
    seeing: Seeing = section(Seeing)
    layers: AirLayers = section(AirLayers)

    def on_mount(self, kind):
        """The same instruments on a perfect mount of another kind, with the travel of that kind."""
        mount = MountErrors(kind=kind)
        names = KINDS[mount.at().kind]
        # a simulated azimuth axis has no stop
        travel = [tuple(end * DEG for end in ends) for ends in (
            ((-36000.0, 36000.0), (-1.0, 91.0)) if names.vertical else names.travel_deg)]
        axes = {axis: replace(getattr(self.axes, axis), travel_min=low, travel_max=high)
                for axis, (low, high) in zip(('azimuth', 'elevation'), travel)}
        return replace(self, mount=mount, axes=replace(self.axes, **axes))

    def temperature(self, time, start, behind=0.0):
        """Temperature (degC) of mount and encoders at `time`, in a night that began at `start`.

        Or of a part that follows the air with the time constant `behind` (s).
        """
        weather = TrueWeather() if self.weather is None else self.weather
        return weather.temperature_at(time, start, behind) + self.housing.excess(
            np.asarray(time) - start)
