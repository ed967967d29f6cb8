"""What is wrong with the simulated mount: the parameters of every part, in SI.

The dataclasses here hold what a scenario file says (`scenario_file`), whose keys carry the unit of
a data sheet (``an_arcsec``), without that suffix (``an``). The defaults are the ideal: no error, no
noise. So each effect is switched by its own number.
"""

from dataclasses import dataclass, fields

import numpy as np

from encoder_reading.design import Design

from .scenario_fields import choice, drawn, number, numbers, optional, section, sections


@dataclass(frozen=True)
class AxisLimits:
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
class Axes:
    """The two axes."""

    azimuth: AxisLimits = section(AxisLimits)
    elevation: AxisLimits = section(AxisLimits)


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
class Mount:
    """Geometry of the mount, in the signs of the field: encoder - catalogue.

    Attributes
    ----------
    ia, ie : float
        Zero of the axes, rad: the axis angle is larger than the true angle by this.
    ca : float
        Collimation: the boresight lies to the left of the tube's axis where it is positive, rad.
    npae : float
        Non-perpendicular axes: the right end of the elevation axis is high where positive, rad.
    an, aw : float
        Lean of the azimuth axis towards north and west, rad.
    tf : float
        Sag of the horizontal tube, rad.
    wobble : tuple of Wobble
        Azimuth bearing.
    bumps : tuple of Bump
        Azimuth track.
    creep, creep_period : float
        The tube creeps back against the elevation drive by up to `creep` (rad) as the axis turns
        through `creep_period` (rad), and then snaps back: a sawtooth.
    backlash_azimuth, backlash_elevation : float
        Play between an axis (with its encoders) and the tube, rad, full width.
    ca_rate, an_rate, aw_rate, tf_rate : float
        Drift with time, rad/s.
    ca_slope, an_slope, aw_slope, tf_slope : float
        Drift with temperature, rad/degC from `reference_temperature`.
    """

    ia: float = number(0.0, 'arcsec', -36000.0, 36000.0)
    ie: float = number(0.0, 'arcsec', -36000.0, 36000.0)
    ca: float = number(0.0, 'arcsec', -36000.0, 36000.0)
    npae: float = number(0.0, 'arcsec', -36000.0, 36000.0)
    an: float = number(0.0, 'arcsec', -36000.0, 36000.0)
    aw: float = number(0.0, 'arcsec', -36000.0, 36000.0)
    tf: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    wobble: tuple = sections(Wobble)
    bumps: tuple = sections(Bump)
    creep: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    creep_period: float = number(15.0, 'deg', 0.1, 360.0)
    backlash_azimuth: float = number(0.0, 'arcsec', 0.0, 3600.0)
    backlash_elevation: float = number(0.0, 'arcsec', 0.0, 3600.0)
    ca_rate: float = number(0.0, 'arcsec_per_hour', -600.0, 600.0)
    an_rate: float = number(0.0, 'arcsec_per_hour', -600.0, 600.0)
    aw_rate: float = number(0.0, 'arcsec_per_hour', -600.0, 600.0)
    tf_rate: float = number(0.0, 'arcsec_per_hour', -600.0, 600.0)
    ca_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    an_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    aw_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    tf_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    reference_temperature: float = number(10.0, 'c', -60.0, 60.0)


@dataclass(frozen=True)
class EncoderScale:
    """What every encoder has: a disc off its centre, and a zero that moves.

    Attributes
    ----------
    diameter : float
        Of the graduated circle, m.
    eccentricity, eccentricity_phase : float
        Distance of the disc's centre from the axis (m), and the axis angle at which it lies away
        from the head (rad).
    zero_offset : float
        Of the mounting, in the reading, rad.
    zero_drift : float
        1-sigma change of the zero from one power-on to the next, in the reading, rad.
    zero_drifts : tuple of float
        The change at each power-on instead, in order; the last one stays.
    zero_rate, zero_slope : float
        Drift of the reading with time (rad/s) and temperature (rad/degC from
        `reference_temperature`).
    latency : float
        The reading is that old when it gets its stamp, s.
    """

    diameter: float = number(300.0, 'mm', 1.0, 10000.0)
    eccentricity: float = number(0.0, 'um', 0.0, 1000.0)
    eccentricity_phase: float = number(0.0, 'deg', -360.0, 360.0)
    zero_offset: float = number(0.0, 'arcsec', -36000.0, 36000.0)
    zero_drift: float = number(0.0, 'arcsec', 0.0, 3600.0)
    zero_drifts: tuple = numbers('arcsec', -3600.0, 3600.0)
    zero_rate: float = number(0.0, 'arcsec_per_hour', -600.0, 600.0)
    zero_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    reference_temperature: float = number(10.0, 'c', -60.0, 60.0)
    latency: float = number(0.0, 'ms', -1000.0, 1000.0)


@dataclass(frozen=True)
class CountLoss:
    """A fault: at once the counter is `counts` too low, `at` seconds after the start."""

    at: float = number(0.0, 's', 0.0, 1e6)
    counts: int = number(0, '', -10**9, 10**9, kind=int)


@dataclass(frozen=True)
class Incremental(EncoderScale):
    """The incremental encoder of paper 000 on one axis.

    The reference mark gives a triangular signal (a slit seen through a slit) that a comparator
    turns into the index pulse. At the reference temperature and the nominal supply its peak is 1.

    Attributes
    ----------
    lines, interpolation : int
        Lines of the grating, and counts (edges in quadrature) a line.
    tilt, tilt_phase : float
        Of the disc against the plane across the axis (rad), and the axis angle at which the line
        of both planes lies at the head (rad).
    heads : int
        One reading head, or the mean of two opposite ones.
    subdivision_1, subdivision_2, subdivision_phase : float
        Error of the interpolation, once and twice a line (rad), and its phase (rad).
    mark_angle : float
        Nominal axis angle of the reference mark, rad.
    pulse_width : float
        Width of the mark's signal at half its peak, rad. The counter is cleared at the near edge
        of the pulse, so from above that much further up than from below.
    threshold : float
        Of the comparator: it decides how wide the pulse is, and a mark with a weaker signal gives
        none.
    signal_slope, signal_supply : float
        Relative change of the signal by a degC and by a volt.
    pulse_time : float
        The shortest pulse that is noticed, s.
    mark_from : {'any', 'below', 'above'}
        The direction from which the mark clears the counter.
    mark_slope, mark_supply : float
        How the place of the mark on the grating moves, in the reading: rad/degC, rad/V. It counts
        when the mark is met.
    zero_supply : float
        Drift of the reading with the supply at any time, rad/V.
    supply, supply_nominal, supply_rate : float
        Supply at the start (V), that of the data sheet (V), and its change (V/s).
    supply_ripple, ripple_frequency : float
        Amplitude (V) and frequency (Hz) of what the mains leave on it.
    max_count_rate : float
        Edges a second that the counter can follow; the others are lost. 0: all.
    miscounts : float
        Wrong counts by noise, up or down, in a million counts passed.
    jitter : float
        1-sigma noise of one reading, in counts.
    power_cycles : tuple of float
        A fault: the power fails for a moment so many seconds after the start.
    losses : tuple of CountLoss
        A fault: counts lost by a disturbance.
    home_side : {'below', 'above'}
        From where homing comes to the mark.
    home_rate : float
        At which homing passes it, rad/s.
    """

    lines: int = number(47200, '', 1, 1_000_000, kind=int)
    interpolation: int = number(400, '', 1, 100_000, kind=int)
    tilt: float = number(0.0, 'deg', 0.0, 30.0)
    tilt_phase: float = number(0.0, 'deg', -360.0, 360.0)
    heads: int = number(1, '', 1, 2, kind=int)
    subdivision_1: float = number(0.0, 'arcsec', 0.0, 60.0)
    subdivision_2: float = number(0.0, 'arcsec', 0.0, 60.0)
    subdivision_phase: float = number(0.0, 'deg', -360.0, 360.0)
    mark_angle: float = number(180.0, 'deg', -360.0, 360.0)
    pulse_width: float = number(0.0, 'arcsec', 0.0, 3600.0)
    threshold: float = number(50.0, 'percent', 1.0, 1000.0)
    signal_slope: float = number(0.0, 'percent_per_degc', -100.0, 100.0)
    signal_supply: float = number(0.0, 'percent_per_v', -1000.0, 1000.0)
    pulse_time: float = number(0.0, 'ms', 0.0, 1000.0)
    mark_from: str = choice('any', 'any', 'below', 'above')
    mark_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    mark_supply: float = number(0.0, 'arcsec_per_v', -3600.0, 3600.0)
    zero_supply: float = number(0.0, 'arcsec_per_v', -3600.0, 3600.0)
    supply: float = number(5.0, 'v', 0.0, 100.0)
    supply_nominal: float = number(5.0, 'v', 0.1, 100.0)
    supply_rate: float = number(0.0, 'v_per_hour', -10.0, 10.0)
    supply_ripple: float = number(0.0, 'v', 0.0, 10.0)
    ripple_frequency: float = number(100.0, 'hz', 0.01, 1e6)
    max_count_rate: float = number(0.0, 'mhz', 0.0, 1000.0)
    miscounts: float = number(0.0, '', 0.0, 1e5)
    jitter: float = number(0.0, '', 0.0, 1000.0)
    power_cycles: tuple = numbers('s', 0.0, 1e6)
    losses: tuple = sections(CountLoss)
    home_side: str = choice('below', 'below', 'above')
    home_rate: float = number(0.25, 'deg_s', 1e-4, 90.0)


@dataclass(frozen=True)
class Absolute(EncoderScale):
    """The absolute encoder of paper 001 on one axis.

    Grey levels are those of the 8 bits. Flaws of disc and CCD are drawn from the seed of the night
    and stay what they are. What is not a flaw, `Design` explains.

    Attributes
    ----------
    code : {'table', 'equation2'}
        The disc of the paper's table 1, or of its eq. 2.
    bar_position_error : float
        1-sigma of a bar's place on the circle, m.
    missing_bars, shifted_bars : float
        Fraction of the bars that are not there, or not at their place.
    bar_shift : float
        How far a shifted bar is off, to either side, in bar periods.
    mounting : {'forward', 'reversed'}
        Whether the pixels run along the disc or against it, which the reader is not told.
    scale_error : float
        The image is that much larger, relative.
    exposure : float
        Time during which a moving disc smears, s; the stamp is its middle.
    base, contrast : float
        Grey level between the bars and height of a bar in the inverted image (paper 001, eq. 4).
    shading_tilt, shading_falloff : float
        Illumination at the ends of the row, relative to its middle: more by `shading_tilt` at the
        last pixel and less at the first, and less by `shading_falloff` at both.
    pixel_nonuniformity : float
        1-sigma of the pixels' sensitivity, relative.
    disc_dust, ccd_dust : int
        Opaque blobs on the track, at random places of the turn, and before the CCD.
    dust_size : float
        Their width, pixels.
    noise : float
        1-sigma of the read-out of a pixel, grey levels.
    full_well : float
        Electrons at grey level 255, which decide the shot noise; 0: none.
    """

    diameter: float = drawn(Design, 'diameter')
    code: str = choice('table', 'table', 'equation2')
    bar_wide: float = drawn(Design, 'bar_wide')
    bar_narrow: float = drawn(Design, 'bar_narrow')
    bar_position_error: float = number(0.0, 'um', 0.0, 50.0)
    missing_bars: float = number(0.0, 'percent', 0.0, 50.0)
    shifted_bars: float = number(0.0, 'percent', 0.0, 100.0)
    bar_shift: float = number(0.15, '', 0.0, 0.5)
    heads: int = drawn(Design, 'heads')
    mounting: str = choice('forward', 'forward', 'reversed')
    geometry: str = drawn(Design, 'geometry')
    pixels: int = drawn(Design, 'pixels')
    bar_pitch: float = drawn(Design, 'bar_pitch')
    scale_error: float = number(0.0, 'percent', -0.5, 0.5)
    blur: float = drawn(Design, 'blur')
    exposure: float = number(0.0, 'us', 0.0, 100000.0)
    base: float = number(91.0, '', 0.0, 250.0)
    contrast: float = number(88.0, '', 1.0, 250.0)
    shading_tilt: float = number(0.0, 'percent', -90.0, 90.0)
    shading_falloff: float = number(0.0, 'percent', 0.0, 90.0)
    pixel_nonuniformity: float = number(0.0, 'percent', 0.0, 50.0)
    disc_dust: int = number(0, '', 0, 10000, kind=int)
    ccd_dust: int = number(0, '', 0, 100, kind=int)
    dust_size: float = number(60.0, 'px', 1.0, 1000.0)
    noise: float = number(0.0, '', 0.0, 100.0)
    full_well: float = number(0.0, 'ke', 0.0, 100000.0)
    method: str = drawn(Design, 'method')

    @property
    def design(self):
        """The drawing, and so all that a reader gets to know; how it is mounted it finds out."""
        return Design(**{item.name: getattr(self, item.name) for item in fields(Design)
                         if item.name not in ('mounting', 'sense')})


@dataclass(frozen=True)
class IncrementalPair:
    """The incremental encoders of both axes."""

    azimuth: Incremental = section(Incremental)
    elevation: Incremental = section(Incremental)


@dataclass(frozen=True)
class AbsolutePair:
    """The absolute encoders of both axes."""

    azimuth: Absolute = section(Absolute)
    elevation: Absolute = section(Absolute)


@dataclass(frozen=True)
class Camera:
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
    feel it.
    """

    pressure: float = number(955.0, 'hpa', 0.0, 1100.0)
    temperature: float = number(10.0, 'c', -60.0, 60.0)
    humidity: float = number(50.0, 'percent', 0.0, 100.0)
    wavelength: float = number(0.55, 'um', 0.3, 20.0)
    temperature_rate: float = number(0.0, 'c_per_hour', -20.0, 20.0)
    temperature_swing: float = number(0.0, 'c', -30.0, 30.0)
    swing_period: float = number(1.0, 'h', 0.01, 1000.0)

    def temperature_at(self, time, start):
        """Temperature (degC) at `time`, of a night that began at `start` (UTC s)."""
        seconds = np.asarray(time) - start
        swing = np.sin(2.0 * np.pi * seconds / self.swing_period)
        return (self.temperature + self.temperature_rate * seconds
                + self.temperature_swing * swing)


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
    site : TrueSite or None
        None: where the observer believes to be.
    weather : TrueWeather or None
        None: what the observer believes.
    """

    name: str = 'ideal'
    clock_offset: float = number(0.0, 'ms', -600000.0, 600000.0)
    mount: Mount = section(Mount)
    axes: Axes = section(Axes)
    incremental: IncrementalPair = section(IncrementalPair)
    absolute: AbsolutePair = section(AbsolutePair)
    camera: Camera = section(Camera)
    site: TrueSite | None = optional(TrueSite)
    weather: TrueWeather | None = optional(TrueWeather)
    housing: Housing = section(Housing)

    def temperature(self, time, start):
        """Temperature (degC) of mount and encoders at `time`, of a night begun at `start`."""
        weather = TrueWeather() if self.weather is None else self.weather
        return weather.temperature_at(time, start) + self.housing.excess(np.asarray(time) - start)
