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
from .field_kinds import both_axes, choice, number, of_pier, optional, section, sections, term, text
from .scenario_encoders import Absolute, Incremental

#: travel of both axes (deg) that a mount has if its scenario does not say, by kind: the second
#: axis of a German mount goes through the pole, the first to 10 deg past the meridian
TRAVEL = {'equatorial': ((-180.0, 180.0), (-100.0, 100.0)),
          'german': ((-10.0, 190.0), (-90.0, 270.0)),
          'free': ((-180.0, 180.0), (-100.0, 100.0))}


# --- what drives, bearings, wind and air do to a mount that stands right --------------------------
# all of it is off by default; docs/mount_effects.md has the sizes of good and bad instruments


@dataclass(frozen=True)
class Drive:
    """The servo and the friction of one axis.

    A position loop of finite gain lags behind a demand that moves: by rate / gain (velocity error
    of a type-1 servo; W. Gawronski, IPN Progress Report 42-159, 2004, for antennas and telescopes).
    Where static friction exceeds the sliding one, the axis sticks until the drive has wound up, and
    slips: the slip and the rate below which that happens as of B. Armstrong-Helouvry 1990, Proc.
    IEEE ICRA, 1377 (Stribeck friction); a telescope so measured: that of ARIES, 50/80 cm, LuGre.

    Attributes
    ----------
    gain : float
        Velocity constant of the position loop, rad/s a rad; 0: ideal. About 2 pi times the
        bandwidth, which is 1 to 3 Hz (L. Zago 1995, thesis EPFL 1394, for ESO's telescopes).
    feed_forward : float
        Part of the demanded rate that is fed forward, so that only the rest makes a lag.
    stick : float
        How far the axis slips at once, rad.
    stick_rate : float
        It slides smoothly at rates well above this (Stribeck), rad/s.
    """

    gain: float = number(0.0, 'per_s', 0.0, 1000.0)
    feed_forward: float = number(0.0, 'percent', 0.0, 100.0)
    stick: float = number(0.0, 'arcsec', 0.0, 600.0)
    stick_rate: float = number(20.0, 'arcsec_per_s', 1e-3, 36000.0)


@dataclass(frozen=True)
class Coupling:
    """The shaft coupling between an axis and its incremental encoder.

    Friction in the encoder's bearing and seal twists it against the motion. After a reversal the
    twist goes over to the other side along the way (P. R. Dahl 1968, Aerospace Corp. TOR-158).

    Attributes
    ----------
    wind_up : float
        Twist when the axis has moved far: friction torque over torsional rigidity, rad. 0.01 Nm
        over 500 Nm/rad is 4".
    distance : float
        Way over which all but 1/e of a change has been made, rad.
    """

    wind_up: float = number(0.0, 'arcsec', 0.0, 3600.0)
    distance: float = number(0.5, 'deg', 1e-3, 90.0)


@dataclass(frozen=True)
class Runout:
    """Non-repetitive run-out of the azimuth bearing: a lean that no turn of the axis repeats.

    Balls that are not alike go round with their cage, (1 - d / D cos a) / 2 times a turn of the
    axis for balls of diameter d on a circle D at contact angle a (T. A. Harris, Rolling Bearing
    Analysis, ch. 25), and slip. ISO 230-7 and ASME B89.3.4 call it asynchronous error motion.

    Attributes
    ----------
    per_turn : float
        Periods in a turn of the axis: 0.4 to 0.45 for the cage, that times the number of balls
        for their passing.
    lean : {'forward', 'left'}
        As for `Wobble`.
    amplitude, phase : float
        rad.
    slip : float
        1-sigma by which the balls are ahead or behind in phase, rad,
    slip_time : float
        and the time after which they have forgotten it, s.
    """

    per_turn: float = number(0.43, '', 0.01, 1000.0)
    lean: str = choice('forward', 'forward', 'left')
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    phase: float = number(0.0, 'deg', -360.0, 360.0)
    slip: float = number(0.0, 'deg', 0.0, 3600.0)
    slip_time: float = number(0.5, 'h', 1e-3, 1000.0)


@dataclass(frozen=True)
class Wind:
    """Wind on the tube: it bends the structure, which no encoder sees, and turns the axes.

    The force goes with the dynamic pressure, so with speed^2, and with how far across the tube the
    wind blows; its fluctuation is 2 `intensity` of it with von Karman's spectrum, low-passed by the
    size of the structure (L. Zago 1995, thesis EPFL 1394, ch. 2 and 4; D. G. MacMynowski and
    T. Andersen 2010, Appl. Opt. 49, 625). The servo takes up what is slower than itself.

    Attributes
    ----------
    speed : float
        Mean speed, m/s.
    origin : float
        Azimuth from which it blows, rad.
    intensity : float
        Turbulence intensity: 1-sigma of the speed over its mean.
    length : float
        Of the largest eddies, m.
    size : float
        Of what the wind blows at, m; smaller eddies cancel on it.
    shelter : float
        Part of the pressure that the building takes away where the tube looks down the wind;
        against the wind nothing, across half of it.
    bending : float
        Of the tube by a steady 10 m/s across it, rad.
    shake : float
        By how much such a wind turns an axis before the servo has answered, rad.
    bandwidth : float
        Of the servo, Hz.
    """

    speed: float = number(0.0, 'm_s', 0.0, 60.0)
    origin: float = number(0.0, 'deg', -360.0, 360.0)
    intensity: float = number(15.0, 'percent', 0.0, 100.0)
    length: float = number(80.0, 'm', 0.1, 2000.0)
    size: float = number(1.0, 'm', 0.01, 100.0)
    shelter: float = number(50.0, 'percent', 0.0, 100.0)
    bending: float = number(0.0, 'arcsec', 0.0, 600.0)
    shake: float = number(0.0, 'arcsec', 0.0, 600.0)
    bandwidth: float = number(2.0, 'hz', 1e-3, 1000.0)


@dataclass(frozen=True)
class Seeing:
    """What turbulence and light leave of a star's place, beside `Camera.star_noise`.

    Image motion of one axis, (0.182 (D/r0)^(5/3))^(1/2) lambda/D for an instant (Noll 1976, J.
    Opt. Soc. Am. 66, 207; as a measure of seeing: H. M. Martin 1987, PASP 99, 1360), goes down
    with the root of the exposure beyond `motion_time`. Photons: the width of the image over the
    root of their number, and the background's (K. A. Winick 1986, J. Opt. Soc. Am. A 3, 1809).

    Attributes
    ----------
    fwhm : float
        Of the seeing at the zenith, rad; it goes with airmass^0.6.
    aperture : float
        Of the telescope, m.
    motion_time : float
        After this the image has moved elsewhere, s: size of the largest eddies over the wind.
    star_rate : float
        Electrons a second of a star of magnitude 0 above the air; 0: no photon noise.
    extinction : float
        Magnitudes an airmass.
    sky : float
        Magnitude of a square arcsecond of the sky.
    """

    fwhm: float = number(0.0, 'arcsec', 0.0, 60.0)
    aperture: float = number(0.2, 'm', 0.01, 50.0)
    motion_time: float = number(1.0, 's', 1e-3, 100.0)
    star_rate: float = number(0.0, 'ke_per_s', 0.0, 1e9)
    extinction: float = number(0.2, '', 0.0, 5.0)
    sky: float = number(20.0, '', 0.0, 25.0)


@dataclass(frozen=True)
class AirLayers:
    """Layers of the air that are not level, and not for long: refraction wanders.

    They lean by a vector of two components that follow an AR(1) process in time; refraction is
    about their normal. So a star is displaced by R0 lean / sin^2 E in elevation and by
    R0 lean / sin E across, R0 being 55" (C. Hirt 2006, Astron. Astrophys. 459, 283, finds
    zenith refraction of 0.05-0.2"; M. S. Taylor et al. 2013, Astron. J. 145, 82: some tenths of
    an arcsecond over ten minutes, from structures below 60 m).

    Attributes
    ----------
    lean : float
        1-sigma of each component, rad; 1 deg displaces a star in the zenith by 1".
    correlation_time : float
        s.
    """

    lean: float = number(0.0, 'deg', 0.0, 10.0)
    correlation_time: float = number(10.0, 'min', 0.01, 10000.0)


# --- the mount ------------------------------------------------------------------------------------

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
