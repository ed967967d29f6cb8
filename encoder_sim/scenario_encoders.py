"""What is wrong with the simulated encoders: their part of `scenario`, in SI."""

from dataclasses import dataclass, fields

from encoder_reading.design import Design

from .field_kinds import choice, drawn, number, numbers, sections


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
    stamp_jitter, late_stamps, late_by : float
        1-sigma of the time between a reading and its stamp (s), the share of the messages that a
        busy computer stamps later still, and the mean of that exponential delay (s). Both axes
        are in one message and share them. A driver in hard real time has microseconds; a
        USB-to-serial adapter holds a reading back by up to 16 ms unless told otherwise (FTDI,
        application note AN232B-04); no measured distribution was found for a mount.
    power_cycles : tuple of float
        A fault: the power fails for a moment so many seconds after the start.
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
    stamp_jitter: float = number(0.0, 'ms', 0.0, 1000.0)
    late_stamps: float = number(0.0, 'percent', 0.0, 100.0)
    late_by: float = number(100.0, 'ms', 0.0, 10000.0)
    power_cycles: tuple = numbers('s', 0.0, 1e6)


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
    worm_teeth : int
        Of the wheel, where the encoder sits on the worm: its periodic error is then in the
        reading, so many times a turn of the axis.
    worm_1, worm_2, worm_phase : float
        Amplitude once and twice a turn of the worm (rad) and phase (rad). Amateurs measured 7 to
        10" from peak to peak of good worms and 30" of mass-produced ones (ATM list, July 1995).
    offset_cos, offset_sin : float
        Direct voltage left on either signal of the grating, relative to its amplitude at rest.
        The scope manual of Heidenhain (PWM 20, 2014) allows +-15 degrees of on-to-off ratio, 13 %,
        and an amplitude ratio of 0.8 to 1.25 and a phase of 80 to 100 degrees; for encoders that
        are interpolated finely 10 %, 0.9 to 1.1 and 85 to 95 degrees.
    amplitude_mismatch : float
        By how much the cosine is larger than the sine, relative to their mean.
    quadrature_error : float
        By how much the phase between both is more than a quarter of a line, rad.
    bandwidth : float
        At which the signals have fallen by 3 dB, Hz of lines; 0: none. The inputs of PWM 8 have
        60 to 100 kHz, which no telescope reaches: 6 deg/s of paper 000's grating are 790 Hz. A
        noise filter or a slow converter does.
    mark_angle : float
        Nominal axis angle of the reference mark, rad.
    mark_scatter : float
        1-sigma of where the mark is noticed, passage by passage, rad. One that is tied to a line
        of the grating can be good to a count; no maker's figure was found, for these (Renishaw
        calls that of its RESR rings "a repeatable home position") or for others.
    spurious_index : float
        Index pulses where there is no mark, by disturbances on its line, a second. The first one
        after power-on clears the counter as a mark would; a later one gives it the lie, which
        controllers call a broken index. No rates were found: it is a fault, not a property.
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
    supply_scatter : float
        1-sigma of the supply from one power-on to the next, the same on both axes, V.
    thermometer_noise, voltmeter_noise : float
        1-sigma of what the electronics measure of temperature (degC) and supply (V).
    voltmeter_step : float
        Resolution of the latter, V: 4 mV of a usual monitor of 12 bits (Texas Instruments,
        INA219); 0: none.
    supply_ripple, ripple_frequency : float
        Amplitude (V) and frequency (Hz) of what the mains leave on it.
    max_count_rate : float
        Edges a second that the counter can follow; the others are lost. 0: all.
    miscounts : float
        Wrong counts by noise, up or down, in a million counts passed.
    jitter : float
        1-sigma noise of one reading, in counts.
    rate_gate : float
        The rate is the counts of so long a time before the reading, over it (s): the M method of
        a counter (Ohmae et al. 1982, IEEE Trans. Ind. Electron. IE-29, 207). Two counts and
        their jitter are its noise: 0.7"/s a count in 100 ms.
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
    worm_teeth: int = number(180, '', 1, 10000, kind=int)
    worm_1: float = number(0.0, 'arcsec', 0.0, 600.0)
    worm_2: float = number(0.0, 'arcsec', 0.0, 600.0)
    worm_phase: float = number(0.0, 'deg', -360.0, 360.0)
    offset_cos: float = number(0.0, 'percent', -200.0, 200.0)
    offset_sin: float = number(0.0, 'percent', -200.0, 200.0)
    amplitude_mismatch: float = number(0.0, 'percent', -150.0, 150.0)
    quadrature_error: float = number(0.0, 'deg', -60.0, 60.0)
    bandwidth: float = number(0.0, 'hz', 0.0, 1e9)
    mark_angle: float = number(180.0, 'deg', -360.0, 360.0)
    mark_scatter: float = number(0.0, 'arcsec', 0.0, 600.0)
    spurious_index: float = number(0.0, 'hz', 0.0, 1.0)
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
    supply_scatter: float = number(0.0, 'v', 0.0, 10.0)
    thermometer_noise: float = number(0.0, 'c', 0.0, 60.0)
    voltmeter_noise: float = number(0.0, 'v', 0.0, 10.0)
    voltmeter_step: float = number(0.0, 'v', 0.0, 1.0)
    supply_ripple: float = number(0.0, 'v', 0.0, 10.0)
    ripple_frequency: float = number(100.0, 'hz', 0.01, 1e6)
    max_count_rate: float = number(0.0, 'mhz', 0.0, 1000.0)
    miscounts: float = number(0.0, '', 0.0, 1e5)
    jitter: float = number(0.0, '', 0.0, 1000.0)
    rate_gate: float = number(100.0, 'ms', 0.1, 10000.0)
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
    tilt, tilt_phase : float
        Of the disc against the plane across the axis (rad), and the axis angle at which the line
        of both planes lies at the head (rad). It reads tilt^2 / 4 twice a turn, and the track
        leaves the focus once a turn by radius * sin(tilt): 0.1 deg are 0.16" and 69 um.
    runout, runout_phase : float
        Axial run-out of the track, to either side (m), and the disc angle at which it is nearest
        to the optics (rad). ESO's encoders at La Silla are mounted to 20 um of axial stroke, with
        0.20 +- 0.07 mm between head and disc (encoder manual, 3.1 to 3.2.1).
    focus_error : float
        Distance of the track from the focus in the mean of a turn, m.
    defocus_slope : float
        Blur that a distance from the focus adds in quadrature, 1-sigma, pixels/m. The default is
        a numerical aperture of 0.2 at 4.8 um of the disc a pixel.
    lean : float
        Of the light along the track, against the axis, rad: so far out of the vertical the image
        moves with the distance, 91" for 1 mm at 1 deg.
    image_growth : float
        By how much the image gets larger with the distance, relative, 1/m: 1 / (distance of the
        lens) where it is not telecentric.
    lamp_left : float
        Light of the lamp at the start of the night, relative to a new one. The infrared LED of an
        encoder keeps more than 90 % for 30 years at 80 degC (Avago, AV02-4387EN, fig. 14), a
        bare one lost 25 % in 1400 h, most of them at 130 and 180 degC (SciTec, lifetime tests).
    lamp_halving : float
        A fault: time in which a dying lamp loses half of its light, s; 0: it does not.
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
    tilt: float = number(0.0, 'deg', 0.0, 5.0)
    tilt_phase: float = number(0.0, 'deg', -360.0, 360.0)
    runout: float = number(0.0, 'um', 0.0, 1000.0)
    runout_phase: float = number(0.0, 'deg', -360.0, 360.0)
    focus_error: float = number(0.0, 'um', -2000.0, 2000.0)
    defocus_slope: float = number(0.02, 'px_per_um', 0.0, 1.0)
    lean: float = number(0.0, 'deg', -45.0, 45.0)
    image_growth: float = number(0.0, 'percent_per_mm', -10.0, 10.0)
    lamp_left: float = number(100.0, 'percent', 0.0, 200.0)
    lamp_halving: float = number(0.0, 'h', 0.0, 1e6)
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
