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

"""Parts of a mount that rest on different stops, drag, sag or give way, and so turn the tube.

Each part depends on the pull of gravity or on how far it is wound up, and knows no pointing
terms. `mount_geometry.MountGeometry` applies them where they act.
"""

from dataclasses import dataclass

import numpy as np

from .field_kinds import number, pier_only


@dataclass(frozen=True)
class Flop:
    """A mirror that rests on one of two stops, depending on the pull across the tube.

    At low elevations its weight presses it against the lower stop; where the pull across the tube
    is less than at elevation `at` it tips over. Friction delays this by `play` / 2, both upwards
    and downwards.

    Attributes
    ----------
    at, play : float
        Elevation, and full width of the hysteresis, rad.
    amplitude, toward : float
        Turn of the line of sight while the mirror is on the lower stop (rad), and its direction
        as seen from the tube: 0 up, 90 degrees to the right (rad).
    """

    at: float = number(50.0, 'deg', 0.0, 90.0)
    play: float = number(0.0, 'deg', 0.0, 60.0)
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    toward: float = number(0.0, 'deg', -360.0, 360.0)

    def shift(self, height, approach):
        """Right and up, rad, from the sine of the elevation and the sign of the last move."""
        tips = np.sin(np.clip(self.at + 0.5 * self.play * np.asarray(approach), 0.0, 0.5 * np.pi))
        low = self.amplitude * (height < tips)
        return np.sin(self.toward) * low, np.cos(self.toward) * low


@dataclass(frozen=True)
class Cables:
    """A bundle of cables that the first axis winds up: a spring that stiffens.

    Attributes
    ----------
    twist, tip : float
        Lag of the first axis behind its encoder, and downward tilt of the tube, when wound up by
        one turn; rad.
    rest : float
        Angle of the first axis, including turns, at which the cables hang free, rad.
    stiffening : float
        Fraction of the pull at one turn that grows with the cube.
    """

    twist: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    tip: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    rest: float = number(0.0, 'deg', -720.0, 720.0)
    stiffening: float = number(0.0, 'percent', 0.0, 100.0)

    def pull(self, angle):
        """Pull at an angle of the first axis, including turns; 1 at one turn."""
        wound = (np.asarray(angle) - self.rest) / (2.0 * np.pi)
        return (1.0 - self.stiffening) * wound + self.stiffening * wound**3


@dataclass(frozen=True)
class Yielding:
    """A part on the first axis that flexes depending on direction, and most at half height.

    Attributes
    ----------
    per_turn : int
    amplitude, phase : float
        Upward turn of the tube: amplitude * cos(k A - phase) sin 2E; rad.
    """

    per_turn: int = number(5, '', 1, 100, kind=int)
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    phase: float = number(0.0, 'deg', -360.0, 360.0)

    def lift(self, angle, raised):
        """Upward turn of the tube at angles of both axes, rad."""
        return self.amplitude * np.cos(self.per_turn * angle - self.phase) * np.sin(2.0 * raised)


@dataclass(frozen=True)
class Focuser:
    """Equipment on the tube that flexes differently sideways and up.

    Attributes
    ----------
    sideways, upright : float
        Sag of the line of sight when all the weight pulls to the right or left of the tube, and
        when it pulls across it up and down; rad.
    other_side : float
        The same beyond the pole, as a fraction: there a draw tube rests on another side of its
        thread.
    """

    sideways: float = pier_only(number(0.0, 'arcsec', -3600.0, 3600.0))
    upright: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    other_side: float = pier_only(number(100.0, 'percent', -1000.0, 1000.0))

    def shift(self, down, beyond):
        """Right and up, rad, from gravity in the tube's frame (n, 3), and if beyond the pole."""
        part = np.where(beyond, self.other_side, 1.0)
        return part * self.sideways * down[..., 0], part * self.upright * down[..., 2]


@dataclass(frozen=True)
class Secondary:
    """A secondary mirror in a cell that gives way more when it is warmer.

    Attributes
    ----------
    along_slope, across_slope : float
        Upward shift of the line of sight per degree, when all the weight of the mirror presses
        along the tube into its cell, and when it hangs across the tube; rad/degC.
    """

    along_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    across_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)

    def shift(self, down, warmer):
        """Up, rad, from gravity in the tube's frame (n, 3) and degC above the reference."""
        return -warmer * (self.along_slope * down[..., 1] + self.across_slope * down[..., 2])
