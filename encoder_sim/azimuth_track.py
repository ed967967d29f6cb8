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

"""Track and bearing of the first axis, which leans as it turns: harmonics, bumps, run-out."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import wrap

from .field_kinds import choice, number
from .seeing import ar_noise


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

    def lean_at(self, turned):
        """Lean, rad, where the axis has turned so far."""
        return self.amplitude * np.cos(self.per_turn * turned - self.phase)


@dataclass(frozen=True)
class Bump:
    """A bump of the azimuth track: where the tube points over it, the axis leans by `amplitude`.

    It falls off on both sides as a Gaussian of 1-sigma `width`; ``lean`` as for `Wobble`. Of
    `count` equal joints in a turn one is `at`.
    """

    at: float = number(0.0, 'deg', -360.0, 360.0)
    width: float = number(10.0, 'deg', 0.1, 180.0)
    count: int = number(1, '', 1, 100, kind=int)
    lean: str = choice('forward', 'forward', 'left')
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)

    def lean_at(self, turned):
        """Lean, rad, where the axis has turned so far."""
        away = wrap(self.count * (turned - self.at)) / self.count
        return self.amplitude * np.exp(-0.5 * (away / self.width) ** 2)


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

    def lean_at(self, turned, slipped=0.0):
        """Lean, rad, where the axis has turned so far; `slipped` in sigmas."""
        return self.amplitude * np.cos(self.per_turn * turned - self.phase + self.slip * slipped)


class AzimuthTrack:
    """All that the first axis turns on.

    Parameters
    ----------
    wobble : tuple of Wobble
    bumps : tuple of Bump
    runouts : tuple of Runout
    seed : int
        Of what slips.
    """

    def __init__(self, wobble, bumps, runouts, seed=0):
        self._fixed = (*wobble, *bumps)
        self._runouts = runouts
        self._slips = [
            ar_noise(part.slip_time, seed, 'bearing', f'slip {i}') if part.slip > 0.0 else None
            for i, part in enumerate(runouts)]

    @property
    def perfect(self):
        """Whether nothing leans."""
        return not (self._fixed or self._runouts)

    def leans(self, turned, since=None):
        """Leans of the axis to the left of the tube, and to where it points.

        Parameters
        ----------
        turned : ndarray, shape (n,)
            rad; whole turns count.
        since : float or ndarray, optional
            Since the start of the night, s; without it nothing slips.

        Returns
        -------
        left, forward : ndarray, shape (n,)
            rad.
        """
        leans = {'left': np.zeros_like(turned), 'forward': np.zeros_like(turned)}
        for part in self._fixed:
            leans[part.lean] += part.lean_at(turned)
        for part, slip in zip(self._runouts, self._slips):
            slipped = 0.0 if slip is None or since is None else slip.at(since)
            leans[part.lean] += part.lean_at(turned, slipped)
        return leans['left'], leans['forward']
