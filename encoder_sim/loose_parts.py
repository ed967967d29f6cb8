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

"""Parts of a mount that rest on one stop or another, drag, sag or give way: turns of the tube.

Each is what a part does, by the pull of gravity on it or by how far it is wound up; none knows a
term. The geometry puts them where they act: `mount_geometry.MountGeometry`.
"""

from dataclasses import dataclass

import numpy as np

from .field_kinds import number, pier_only


@dataclass(frozen=True)
class Flop:
    """A mirror that lies on one of two stops, by what pulls it across the tube.

    Low down its weight presses it to the lower stop; from where the pull across the tube is less
    than at `at` it tips over. Friction holds it: on the way up it goes `play` / 2 later, on the way
    down as much later.

    Attributes
    ----------
    at, play : float
        Elevation, and width of the hysteresis, rad.
    amplitude, toward : float
        How far the line of sight turns as it lies low (rad), and to where as the tube sees it:
        0 up, 90 degrees to the right (rad).
    """

    at: float = number(50.0, 'deg', 0.0, 90.0)
    play: float = number(0.0, 'deg', 0.0, 60.0)
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    toward: float = number(0.0, 'deg', -360.0, 360.0)

    def shift(self, height, approach):
        """Right and up, rad: of the sine of the elevation, and the sign of the last move."""
        tips = np.sin(np.clip(self.at + 0.5 * self.play * np.asarray(approach), 0.0, 0.5 * np.pi))
        low = self.amplitude * (height < tips)
        return np.sin(self.toward) * low, np.cos(self.toward) * low


@dataclass(frozen=True)
class Cables:
    """A bundle of cables that the first axis winds up: a spring that stiffens.

    Attributes
    ----------
    twist, tip : float
        How far it holds the first axis back behind its encoder, and tips the tube down, where it is
        wound up by one turn; rad.
    rest : float
        Angle of the first axis, in turns of its travel, at which it hangs free, rad.
    stiffening : float
        Of its pull at one turn, the part that grows with the cube.
    """

    twist: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    tip: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    rest: float = number(0.0, 'deg', -720.0, 720.0)
    stiffening: float = number(0.0, 'percent', 0.0, 100.0)

    def pull(self, angle):
        """Of the angle of the first axis, whole turns counted; 1 at one turn."""
        wound = (np.asarray(angle) - self.rest) / (2.0 * np.pi)
        return (1.0 - self.stiffening) * wound + self.stiffening * wound**3


@dataclass(frozen=True)
class Yielding:
    """A part about the first axis that yields more in some directions, and most at half height.

    Attributes
    ----------
    per_turn : int
    amplitude, phase : float
        Of what the tube goes up, amplitude * cos(k A - phase) sin 2E; rad.
    """

    per_turn: int = number(5, '', 1, 100, kind=int)
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    phase: float = number(0.0, 'deg', -360.0, 360.0)

    def lift(self, angle, raised):
        """Of both axes, rad."""
        return self.amplitude * np.cos(self.per_turn * angle - self.phase) * np.sin(2.0 * raised)


@dataclass(frozen=True)
class Focuser:
    """What hangs on the tube and yields to its sides unlike to its top and bottom.

    Attributes
    ----------
    sideways, upright : float
        How far the line of sight sags where all the weight pulls to the right or left of the tube,
        and where it pulls across it up and down; rad.
    other_side : float
        The same beyond the pole, in parts of it: a draw tube that lies on another side of its
        thread there.
    """

    sideways: float = pier_only(number(0.0, 'arcsec', -3600.0, 3600.0))
    upright: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    other_side: float = pier_only(number(100.0, 'percent', -1000.0, 1000.0))

    def shift(self, down, beyond):
        """Right and up, rad: of gravity as the tube sees it (n, 3), and whether beyond the pole."""
        part = np.where(beyond, self.other_side, 1.0)
        return part * self.sideways * down[..., 0], part * self.upright * down[..., 2]


@dataclass(frozen=True)
class Secondary:
    """A secondary mirror in a cell that gives way more, the warmer it is.

    Attributes
    ----------
    along_slope, across_slope : float
        How far the line of sight goes up in the tube for each degree, where all the weight of the
        mirror presses along the tube into its cell, and where it hangs across it; rad/degC.
    """

    along_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    across_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)

    def shift(self, down, warmer):
        """Up, rad: of gravity as the tube sees it (n, 3), and degC above the reference."""
        return -warmer * (self.along_slope * down[..., 1] + self.across_slope * down[..., 2])
