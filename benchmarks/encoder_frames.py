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

"""Random frames of the absolute encoder, errors of their readings, and a table row of them.

For `absolute_encoder.py`.
"""

import numpy as np

from encoder_reading.disc import Disc
from encoder_reading.frame_readings import CORRECTED, REJECTED
from encoder_sim.ccd import LinearCCD
from msg_tools.units import ARCSEC, wrap

TURN = 2.0 * np.pi
#: illumination in the row `total`: 5 % more at one end than in the middle, 10 % less at both
SHADING = {'shading_tilt': 0.05, 'shading_falloff': 0.10}
SHIFTED = {'shifted_bars': 0.10, 'bar_shift': 0.15}
#: as many discs, each with flaws of its own
DISCS = 4


class Source:
    """Frames of one condition at random angles.

    Parameters
    ----------
    params : absolute.Absolute
    seed : int
    blobs : int
        Of 60 pixels, at other places in each frame.
    """

    def __init__(self, params, seed, blobs=0):
        self.params, self.blobs = params, blobs
        # of its own: `foreign` changes it
        self.disc = Disc(params.code)
        self.ccd = LinearCCD(params, self.disc, seed)
        self.rng = np.random.default_rng(seed)

    def frames(self, angles):
        n, pixels = len(angles), self.params.pixels
        dust = self.rng.uniform(0, pixels, (n, self.blobs)) if self.blobs else None
        noise = self.rng.standard_normal((n, pixels), dtype=np.float32)
        return self.ccd.render(angles, noise, dust=dust)

    def random(self, n):
        """Angles and frames."""
        angles = self.rng.uniform(0.0, TURN, n)
        return angles, self.frames(angles)

    def batches(self, n, size=1024):
        for i in range(0, n, size):
            yield self.random(min(size, n - i))


class Tally:
    """Errors of many readings."""

    def __init__(self, bar_angle):
        self.n = self.rejected = self.corrected = self.gross = 0
        self.sum = self.square = self.largest = 0.0
        self._gross_from = 0.5 * bar_angle

    def add(self, readings, angles):
        error = wrap(readings.angle - angles)
        bad = readings.quality == REJECTED
        assert np.array_equal(bad, np.isnan(error)), 'a rejected frame became an angle'
        gross = ~bad & (np.abs(error) >= self._gross_from)
        usual = error[~bad & ~gross] / ARCSEC
        self.n += len(error)
        self.rejected += int(bad.sum())
        self.corrected += int((readings.quality == CORRECTED).sum())
        self.gross += int(gross.sum())
        self.sum += usual.sum()
        self.square += usual @ usual
        self.largest = max(self.largest, np.abs(usual).max(initial=0.0))

    @property
    def rms(self):
        good = self.n - self.rejected - self.gross
        return float(np.sqrt(self.square / good)) if good else float('nan')


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def row(name, value, unit, *, at_most=None, at_least=None, between=None, digits=2, note=''):
    """A line of the result."""
    if between is not None:
        at_least, at_most = between
    target, reached = '', None
    if at_most is not None or at_least is not None:
        reached = bool((at_most is None or value <= at_most)
                       and (at_least is None or value >= at_least))
        target = (f'{at_least:g} to {at_most:g}' if between is not None
                  else f'<= {at_most:g}' if at_most is not None else f'>= {at_least:g}')
    return {'name': name, 'value': float(value) if np.isfinite(value) else None,
            'unit': unit, 'digits': digits,
            'target': target, 'reached': reached, 'note': note}
