"""What is wrong with the simulated mount: the parameters of every part, in SI.

The dataclasses here hold what a scenario file says (`scenario_file`), whose keys carry the unit of
a data sheet (``an_arcsec``), without that suffix (``an``). The defaults are the ideal: no error, no
noise. So each effect is switched by its own number.
"""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import DEG
from pointing_model.mounts import parse_mount

from . import keyed_noise
from .scenario_disturbances import AirLayers, Coupling, Drive, Runout, Seeing, Wind
from .scenario_encoders import Absolute, Incremental
from .scenario_fields import (
    both_axes,
    choice,
    number,
    of_pier,
    optional,
    section,
    sections,
    term,
    text,
)

#: travel of both axes (deg) that a mount has if its scenario does not say, by kind: the second
#: axis of a German mount goes through the pole, the first to 10 deg past the meridian
TRAVEL = {'equatorial': ((-180.0, 180.0), (-100.0, 100.0)),
          'german': ((-10.0, 190.0), (-90.0, 270.0)),
          'free': ((-180.0, 180.0), (-100.0, 100.0))}


@dataclass(frozen=True)
class AxisDynamics:
    """How an axis moves.

    Attributes
    ----------
    max_rate, max_acceleration : float
        rad/s and rad/s^2 of the axis.
    settling_time : float
        Seconds from the end of a slew until the ringing has died out.
    settling_amplitude : float
        Ringing just after a slew at full rate, rad.
    travel_min, travel_max : float
        Ends of the travel, rad.
    """

    max_rate: float = number(6.0, 'deg_s', 1e-3, 360.0)
    max_acceleration: float = number(3.0, 'deg_s2', 1e-3, 3600.0)
    settling_time: float = number(1.0, 's', 0.0, 60.0)
    settling_amplitude: float = number(0.0, 'arcsec', 0.0, 600.0)
    travel_min: float = number(-36000.0, 'deg', -36000.0, 36000.0)
    travel_max: float = number(36000.0, 'deg', -36000.0, 36000.0)


@dataclass(frozen=True)
class Wobble:
    """One harmonic of the azimuth bearing: the axis leans by amplitude * cos(k A - phase).

    ``lean`` is the side towards which it leans, as seen by the tube: ``forward``, where the tube
    points, or ``left`` of it.
    """

    per_turn: int = number(1, '', 1, 100, kind=int)
    lean: str = choice('forward', 'forward', 'left')
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    phase: float = number(0.0, 'deg', -360.0, 360.0)


@dataclass(frozen=True)
class Bump:
    """A bump of the azimuth track: where the tube points over it, the axis leans by `amplitude`.

    It falls off on both sides as a Gaussian of 1-sigma `width`; ``lean`` as for `Wobble`.
    """

    at: float = number(0.0, 'deg', -360.0, 360.0)
    width: float = number(10.0, 'deg', 0.1, 180.0)
    lean: str = choice('forward', 'forward', 'left')
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)


@dataclass(frozen=True)
class MountErrors:
    """Geometry of the mount, in the signs of the field: encoder - catalogue.

    The terms are those of an alt-azimuth mount, in the frame of the axes: of another mount they
    are the same rotations, and the file has its names for them (IH ID CH NP MA ME TF; `aw` is
    -MA). So are `azimuth` and `elevation` the first and the second axis.

    Attributes
    ----------
    kind : str
        As `mounts.parse_mount` takes it: altaz, equatorial, german, free:AZ,EL[,ROLL]. How an
        equatorial one stands the latitude decides at which it is.
    ia, ie : float
        Zero of the axes, rad: the axis angle is larger than the true angle by this.
    ca : float
        Collimation: the boresight lies to the left of the tube's axis where it is positive, rad.
    npae : float
        Non-perpendicular axes: the right end of the second axis is high where positive, rad.
    an, aw : float
        Lean of the first axis towards angle 0 of the first axis (north, the meridian) and towards
        -90 degrees (west; the east of an equatorial mount), rad.
    tf : float
        Sag of the horizontal tube, rad.
    wobble : tuple of Wobble
        Bearing of the first axis.
    bumps : tuple of Bump
        Its track.
    runouts : tuple of Runout
        Its bearing, what no turn repeats.
    creep, creep_period : float
        The tube creeps back against the drive of the second axis by up to `creep` (rad) as the
        axis turns through `creep_period` (rad), and then snaps back: a sawtooth.
    backlash_azimuth, backlash_elevation : float
        Play between an axis (with its encoders) and the tube, rad, full width.
    fork_sag : float
        Slope of the ends of the arms of a fork if they were level, rad. (Equatorial mounts only,
        as all that follows down to the counterweight.) The arms are cantilevers along the polar
        axis; across their plane the ends, and the declination bearings in them, turn about the
        declination axis by that times the pull across the polar axis, cos(latitude) cos(hour
        angle): FO is -fork_sag cos(latitude) in the north (TPOINT's catalogue: change in
        declination as cos h). In their plane they are stiff.
    declination_axis_sag : float
        Slope of the end of the declination axis that carries the tube if it were level, rad:
        F L^2 / (2 E I) of a cantilever (any textbook, such as Timoshenko's Strength of Materials).
        It turns the tube about the horizontal across the axis, by as much of its weight as
        pulls across it. The tube is on the left end as it sees it: in the east while it looks at
        the meridian from there, with the counterweight down; on the other end where negative. So
        DAF is -declination_axis_sag. (TPOINT's catalogue: the axis of German and cross-axis
        mounts bends downward; its DAB has another factor, the sine of the axis' zenith distance.)
    counterweight_west, counterweight_meridian : float
        Lean of the polar axis towards west and towards the meridian while the counterweight hangs
        on its west side, and the reverse in the east, rad: MA and ME of two signs. (Users of
        mounts tell of heads that rock in the oversize holes of their bolts: Astro-Physics' group,
        2018 and 2020. No measured lean was found.)
    counterweight_by : {'play', 'bending', 'flip'}
        How that goes over: what the mount is out of balance presses the axis to one end of the
        play in bearings and seat, and to the other where the pull turns over, with the cosine of
        the hour angle of the axis; or it bends the axis, by as much; or friction holds the axis
        where it lies until the mount goes through the pole.
    ca_rate, an_rate, aw_rate, tf_rate : float
        Drift with time, rad/s.
    ca_slope, an_slope, aw_slope, tf_slope : float
        Drift with temperature, rad/degC from `reference_temperature`.
    """

    kind: str = text('altaz', parse=lambda kind: parse_mount(kind, 0.0))
    ia: float = term('IA', 'arcsec', -36000.0, 36000.0)
    ie: float = term('IE', 'arcsec', -36000.0, 36000.0)
    ca: float = term('CA', 'arcsec', -36000.0, 36000.0)
    npae: float = term('NPAE', 'arcsec', -36000.0, 36000.0)
    an: float = term('AN', 'arcsec', -36000.0, 36000.0)
    aw: float = term('AW', 'arcsec', -36000.0, 36000.0)
    tf: float = term('TF', 'arcsec', -3600.0, 3600.0)
    wobble: tuple = sections(Wobble)
    bumps: tuple = sections(Bump)
    runouts: tuple = sections(Runout)
    creep: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    creep_period: float = number(15.0, 'deg', 0.1, 360.0)
    backlash_azimuth: float = number(0.0, 'arcsec', 0.0, 3600.0)
    backlash_elevation: float = number(0.0, 'arcsec', 0.0, 3600.0)
    fork_sag: float = of_pier(number(0.0, 'arcsec', -3600.0, 3600.0))
    declination_axis_sag: float = of_pier(number(0.0, 'arcsec', -3600.0, 3600.0))
    counterweight_west: float = of_pier(number(0.0, 'arcsec', -3600.0, 3600.0))
    counterweight_meridian: float = of_pier(number(0.0, 'arcsec', -3600.0, 3600.0))
    counterweight_by: str = of_pier(choice('play', 'play', 'bending', 'flip'))
    ca_rate: float = term('CA', 'arcsec_per_hour', -600.0, 600.0)
    an_rate: float = term('AN', 'arcsec_per_hour', -600.0, 600.0)
    aw_rate: float = term('AW', 'arcsec_per_hour', -600.0, 600.0)
    tf_rate: float = term('TF', 'arcsec_per_hour', -600.0, 600.0)
    ca_slope: float = term('CA', 'arcsec_per_degc', -600.0, 600.0)
    an_slope: float = term('AN', 'arcsec_per_degc', -600.0, 600.0)
    aw_slope: float = term('AW', 'arcsec_per_degc', -600.0, 600.0)
    tf_slope: float = term('TF', 'arcsec_per_degc', -600.0, 600.0)
    reference_temperature: float = number(10.0, 'c', -60.0, 60.0)

    def at(self, latitude=0.0):
        """The `pointing_model.mounts.Mount` of this kind at `latitude`, rad."""
        return parse_mount(self.kind, latitude)

    @property
    def names(self):
        """What its axes and terms are called: `pointing_model.mount_kinds.MountKind`."""
        return self.at().names


@dataclass(frozen=True)
class CameraErrors:
    """The star camera.

    Attributes
    ----------
    field_of_view : float
        Full width of the square field, rad.
    mag_limit : float
        The faintest star that it sees.
    star_noise : float
        1-sigma of one measured star, per axis, rad.
    scale_error : float
        Relative error of the plate scale: distances come out too large by it.
    rotation : float
        Measured miss distances are turned by this from +x towards +y, rad.
    trail : float
        Charge that the read-out leaves behind draws the image of a star of magnitude 4 towards
        +x by this, rad; less of a bright one (its flux to the power -0.1).
    """

    field_of_view: float = number(40.0, 'arcmin', 0.1, 600.0)
    mag_limit: float = number(7.0, '', -2.0, 13.0)
    star_noise: float = number(0.0, 'arcsec', 0.0, 600.0)
    scale_error: float = number(0.0, 'percent', -50.0, 50.0)
    rotation: float = number(0.0, 'deg', -180.0, 180.0)
    trail: float = number(0.0, 'arcsec', -600.0, 600.0)


@dataclass(frozen=True)
class TrueWeather:
    """The weather that bends the light, whatever the observer believes: hPa, degC, fraction, m.

    The temperature changes by `temperature_rate` (degC/s) from the start of the night on, and
    swings by `temperature_swing` (degC) about that once in `swing_period` (s); mount and encoders
    feel it. From night to night (24 h, the first from the start on) it is anywhere within a
    `nightly_range` (degC) about that, independently; `nightly_draw` numbers such seasons.
    """

    pressure: float = number(955.0, 'hpa', 0.0, 1100.0)
    temperature: float = number(10.0, 'c', -60.0, 60.0)
    humidity: float = number(50.0, 'percent', 0.0, 100.0)
    wavelength: float = number(0.55, 'um', 0.3, 20.0)
    temperature_rate: float = number(0.0, 'c_per_hour', -20.0, 20.0)
    temperature_swing: float = number(0.0, 'c', -30.0, 30.0)
    swing_period: float = number(1.0, 'h', 0.01, 1000.0)
    nightly_range: float = number(0.0, 'c', 0.0, 60.0)
    nightly_draw: int = number(1, '', 0, 2**31 - 1, kind=int)

    def temperature_at(self, time, start):
        """Temperature (degC) at `time`, of a night that began at `start` (UTC s)."""
        seconds = np.asarray(time) - start
        swing = np.sin(2.0 * np.pi * seconds / self.swing_period)
        night = 0.0
        if self.nightly_range > 0.0:
            # it changes by day, an hour before the next night begins
            days = np.floor((seconds + 3600.0) / 86400.0).astype(np.int64)
            night = self.nightly_range * (
                keyed_noise.uniform(self.nightly_draw, 'weather', 'night', days) - 0.5)
        return (self.temperature + self.temperature_rate * seconds
                + self.temperature_swing * swing + night)


@dataclass(frozen=True)
class Housing:
    """Mount and encoders get warmer than the air by `step` degC, `at` seconds after the start.

    With a `time_constant` (s) they approach it gradually.
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
    """Where the mount really stands, rad, rad, m."""

    latitude: float = number(34.3, 'deg', -90.0, 90.0)
    longitude: float = number(109.0, 'deg', -180.0, 360.0)
    height: float = number(500.0, 'm', -500.0, 9000.0)


@dataclass(frozen=True)
class Scenario:
    """All that the simulator knows and nobody else does.

    Attributes
    ----------
    name : str
    clock_offset : float
        True UTC - stamp, s.
    axes, incremental, absolute
        With an `azimuth`, the first axis of any mount, and an `elevation`, the second.
    drives, coupling
        The same: the servos, and the couplings of the incremental encoders.
    site : TrueSite or None
        None: where the observer believes to be.
    weather : TrueWeather or None
        None: what the observer believes.
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
        """The same instruments on a perfect mount of another kind, with the travel of such one."""
        mount = MountErrors(kind=kind)
        travel = [tuple(end * DEG for end in ends) for ends in TRAVEL.get(
            mount.at().kind, ((-36000.0, 36000.0), (-1.0, 91.0)))]
        axes = {axis: replace(getattr(self.axes, axis), travel_min=low, travel_max=high)
                for axis, (low, high) in zip(('azimuth', 'elevation'), travel)}
        return replace(self, mount=mount, axes=replace(self.axes, **axes))

    def temperature(self, time, start):
        """Temperature (degC) of mount and encoders at `time`, of a night begun at `start`."""
        weather = TrueWeather() if self.weather is None else self.weather
        return weather.temperature_at(time, start) + self.housing.excess(np.asarray(time) - start)
