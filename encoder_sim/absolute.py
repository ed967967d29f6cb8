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

"""The absolute encoder of paper 001 on an axis: disc, linear CCD and reader."""

from dataclasses import dataclass, fields

import numpy as np

from encoder_reading.axis_reader import AxisReader, read_frames
from encoder_reading.design import Design
from encoder_reading.disc import RECURRENCES
from encoder_reading.frame_readings import FrameReadings

from .ccd import LinearCCD
from .encoder_scale import EncoderScale, ZeroDrift, stamp_delays
from .field_kinds import choice, drawn, number
from .graduated_disc import disc_angle, tilted_angle


@dataclass(frozen=True)
class Absolute(EncoderScale):
    """The absolute encoder of paper 001 on one axis.

    Grey levels are in 8 bits. Flaws of disc and CCD are drawn from the seed of the night and stay
    constant. Parameters that are not flaws are explained in `Design`.

    Attributes
    ----------
    code : {'table', 'equation2'}
        The disc of the paper's table 1, or of its eq. 2.
    bar_position_error : float
        1-sigma error of the position of a bar on the circle, m.
    missing_bars, shifted_bars : float
        Fractions of the bars that are absent, or displaced.
    bar_shift : float
        Displacement of a shifted bar, to either side, in bar periods.
    mounting : {'forward', 'reversed'}
        Whether the pixels run along the disc or against it; the reader is not told.
    scale_error : float
        Relative error of the image scale; positive: the image is larger.
    tilt, tilt_phase : float
        Angle between the disc and the plane normal to the axis (rad), and the axis angle at
        which their line of intersection is at the head (rad). The reading gets an error of
        tilt^2 / 4 twice a turn, and the track leaves the focus once a turn by
        radius * sin(tilt): 0.1 deg gives 0.16" and 69 um.
    runout, runout_phase : float
        Axial run-out of the track, to either side (m), and the disc angle at which it is nearest
        to the optics (rad). ESO's encoders at La Silla are mounted to 20 um of axial stroke, with
        0.20 +- 0.07 mm between head and disc (encoder manual, 3.1 to 3.2.1).
    focus_error : float
        Mean distance of the track from the focus over a turn, m.
    defocus_slope : float
        1-sigma blur per distance from the focus, added in quadrature, pixels/m. The default is
        a numerical aperture of 0.2 with 4.8 um of the disc per pixel.
    lean : float
        Tilt of the light along the track against the axis, rad: the image moves with the distance
        by its tangent, 91" for 1 mm at 1 deg.
    image_growth : float
        Relative growth of the image with the distance, 1/m: 1 / (distance of the lens), 0 for a
        telecentric lens.
    lamp_left : float
        Light of the lamp at the start of the night, relative to a new one. The infrared LED of an
        encoder keeps more than 90 % for 30 years at 80 degC (Avago, AV02-4387EN, fig. 14); a
        bare one lost 25 % in 1400 h, mostly at 130 and 180 degC (SciTec, lifetime tests).
    lamp_halving : float
        A fault: time in which a failing lamp loses half of its light, s; 0: it does not fail.
    exposure : float
        Exposure time, in which the image of a moving disc smears, s; the stamp is its middle.
    base, contrast : float
        Grey level between the bars, and height of a bar, in the inverted image (paper 001, eq. 4).
    shading_tilt, shading_falloff : float
        Illumination at the ends of the row, relative to its middle: `shading_tilt` is added at the
        last pixel and subtracted at the first, `shading_falloff` is subtracted at both.
    pixel_nonuniformity : float
        1-sigma of the relative sensitivity of the pixels.
    disc_dust, ccd_dust : int
        Number of opaque particles on the track, at random positions, and in front of the CCD.
    dust_size : float
        Width of the particles, pixels.
    noise : float
        1-sigma read-out noise of a pixel, grey levels.
    full_well : float
        Electrons at grey level 255, which determine the shot noise; 0: none.
    """

    diameter: float = drawn(Design, 'diameter')
    code: str = choice('table', *RECURRENCES)
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
        """The design, which is all that a reader is told; it determines the mounting itself."""
        return Design(**{item.name: getattr(self, item.name) for item in fields(Design)
                         if item.name not in ('mounting', 'sense')})


class AbsoluteEncoder:
    """The encoder of one axis. It reads immediately after power-on; the scenario sets its zero.

    Parameters
    ----------
    params : Absolute
    seed : int
    axis : str
        Name of the axis.
    start : float
        Start of the night, UTC s, the origin of drifts with time.
    lowest : float, optional
        Reading at which a turn begins, see `axis_reader.AxisReader`.

    Attributes
    ----------
    power_on : int
        Number of this power-on, 1 for the first, without those of `params.power_cycles`.
    """

    def __init__(self, params, seed, axis, start=0.0, lowest=None):
        self.params, self.start, self._seed = params, start, seed
        device = f'absolute/{axis}'
        self._zero = ZeroDrift(params, seed, device)
        self.power_on, self._cycles = 1, np.sort(params.power_cycles)
        self.reader = AxisReader(params.design, axis, lowest)
        ccd = LinearCCD(params, self.reader.design.disc, seed, device)
        self.heads = [ccd, *(ccd.other_head(k) for k in range(1, params.heads))]

    def power_cycle(self):
        """Switch off and on: the zero of later readings may differ."""
        self.power_on += 1

    def power_ons(self, stamps):
        """Numbers of the power-ons at `stamps` (ns), including those of the scenario, int."""
        return self.power_on + np.searchsorted(
            self._cycles, np.asarray(stamps) * 1e-9 - self.start, side='right')

    def zeros(self, stamps):
        """Shift of the reading by the power-on at `stamps` (ns, shape (n,)), rad."""
        return np.array([self._zero.at_power_on(n) for n in self.power_ons(stamps).tolist()])

    def _shown(self, stamps, angles, rates, temperature, head):
        """Disc angle at the middle of a head's row."""
        p = self.params
        temperature = p.reference_temperature if temperature is None else temperature
        past = angles - rates * (
            p.latency + stamp_delays(p, self._seed, 'absolute', stamps))
        opposite = np.pi * head
        toward = p.eccentricity_phase + p.eccentricity_rate * (stamps * 1e-9 - self.start)
        shown = disc_angle(past, p.eccentricity, toward + opposite, 0.5 * p.diameter)
        shown = tilted_angle(shown, p.tilt, p.tilt_phase)
        drift = self._zero.later(stamps * 1e-9 - self.start, temperature)
        return shown + opposite + p.zero_offset + self.zeros(stamps) + drift

    def lamp(self, stamps):
        """Light of the lamp at `stamps` (ns, shape (n,)), relative to a new one; None: always 1."""
        p = self.params
        if p.lamp_left == 1.0 and p.lamp_halving == 0.0:
            return None
        fading = 1.0 / p.lamp_halving if p.lamp_halving else 0.0
        return p.lamp_left * np.exp2(-fading * (stamps * 1e-9 - self.start))

    def frames(self, stamps, angles, rates=0.0, temperature=None):
        """Frames of the CCDs.

        Parameters
        ----------
        stamps : int or ndarray of int, shape (n,)
            ns.
        angles : float or ndarray, shape (n,)
            True angle of the axis, rad.
        rates : float or ndarray, shape (n,)
            rad/s; determine the axis angle before the latency, and the smear during the exposure.
        temperature : float or ndarray, optional
            degC.

        Returns
        -------
        ndarray of uint8, shape (heads, n, pixels)
        """
        stamps = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        rates, lamp = np.asarray(rates, dtype=float), self.lamp(stamps)
        return np.array([
            ccd.frames(stamps, self._shown(stamps, angles, rates, temperature, head), rates, lamp)
            for head, ccd in enumerate(self.heads)])

    def read(self, stamps, angles, rates=0.0, temperature=None):
        """Read the axis; parameters as in `frames`.

        Returns
        -------
        FrameReadings
            Angles in rad; NaN if rejected.
        """
        part = read_frames([self.reader], [self.frames(stamps, angles, rates, temperature)])
        return FrameReadings(part.angle[:, 0], part.quality[:, 0], part.sigma[:, 0])
