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

"""Track and bearing of the first axis, which tilt it as it turns: harmonics, bumps, run-out."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import wrap

from .field_kinds import choice, number
from .seeing import ar_noise


@dataclass(frozen=True)
class Wobble:
    """One harmonic of the azimuth bearing: the axis tilts by amplitude * cos(k A - phase).

    ``lean`` is the direction of the tilt, as seen from the tube: ``forward``, where the tube
    points, or ``left`` of it.
    """

    per_turn: int = number(1, '', 1, 100, kind=int)
    lean: str = choice('forward', 'forward', 'left')
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    phase: float = number(0.0, 'deg', -360.0, 360.0)

    def lean_at(self, turned):
        """Tilt, rad, at the axis angle `turned`."""
        return self.amplitude * np.cos(self.per_turn * turned - self.phase)


@dataclass(frozen=True)
class Bump:
    """A bump of the azimuth track: the axis tilts by `amplitude` when the tube points over it.

    The tilt falls off as a Gaussian of 1-sigma `width`; ``lean`` as in `Wobble`. There are `count`
    equal bumps, evenly spaced around the track, one of them `at`.
    """

    at: float = number(0.0, 'deg', -360.0, 360.0)
    width: float = number(10.0, 'deg', 0.1, 180.0)
    count: int = number(1, '', 1, 100, kind=int)
    lean: str = choice('forward', 'forward', 'left')
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)

    def lean_at(self, turned):
        """Tilt, rad, at the axis angle `turned`."""
        away = wrap(self.count * (turned - self.at)) / self.count
        return self.amplitude * np.exp(-0.5 * (away / self.width) ** 2)


@dataclass(frozen=True)
class Runout:
    """Non-repetitive run-out of the azimuth bearing: a tilt that differs from turn to turn.

    Unequal balls move with their cage, (1 - d / D cos a) / 2 times a turn of the axis for balls of
    diameter d on a circle D at contact angle a (T. A. Harris, Rolling Bearing Analysis, ch. 25),
    and slip. ISO 230-7 and ASME B89.3.4 call it asynchronous error motion.

    Attributes
    ----------
    per_turn : float
        Periods per turn of the axis: 0.4 to 0.45 for the cage, and that times the number of balls
        for their passing.
    lean : {'forward', 'left'}
        See `Wobble`.
    amplitude, phase : float
        rad.
    slip : float
        1-sigma of the phase error of the balls, rad.
    slip_time : float
        Correlation time of the slip, s.
    """

    per_turn: float = number(0.43, '', 0.01, 1000.0)
    lean: str = choice('forward', 'forward', 'left')
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    phase: float = number(0.0, 'deg', -360.0, 360.0)
    slip: float = number(0.0, 'deg', 0.0, 3600.0)
    slip_time: float = number(0.5, 'h', 1e-3, 1000.0)

    def lean_at(self, turned, slipped=0.0):
        """Tilt, rad, at the axis angle `turned`; `slipped` in sigmas."""
        return self.amplitude * np.cos(self.per_turn * turned - self.phase + self.slip * slipped)


class AzimuthTrack:
    """Track and bearing of the first axis.

    Parameters
    ----------
    wobble : tuple of Wobble
    bumps : tuple of Bump
    runouts : tuple of Runout
    seed : int
        Seed of the slip.
    """

    def __init__(self, wobble, bumps, runouts, seed=0):
        self._fixed = (*wobble, *bumps)
        self._runouts = runouts
        self._slips = [
            ar_noise(part.slip_time, seed, 'bearing', f'slip {i}') if part.slip > 0.0 else None
            for i, part in enumerate(runouts)]

    @property
    def perfect(self):
        """Whether nothing tilts the axis."""
        return not (self._fixed or self._runouts)

    def leans(self, turned, since=None):
        """Tilts of the axis to the left of the tube, and forward.

        Parameters
        ----------
        turned : ndarray, shape (n,)
            Axis angle with its turns, rad.
        since : float or ndarray, optional
            Time since the start of the night, s; without it there is no slip.

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
