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

"""How a mount guard sends, and after how long or how far off it stops the axes."""

from typing import NamedTuple

from msg_tools.units import DEG


class GuardSettings(NamedTuple):
    """How a `supervisor.Supervisor` sends.

    Attributes
    ----------
    whole : bool
        The track that was checked at once; nothing is renewed, and silence is no matter.
    ahead : float
        From now to the last moving knot of a piece, s.
    silence, commander : float
        Seconds without a reading, and without a renewed request, after which the axes are stopped.
    behind : float
        Largest distance of an axis from where it was sent, rad.
    turn_known : bool
        The first axis reads the turn that it is on.
    asleep : bool
        Time waits for events: of a mount that is not asked to move nothing is read.
    """

    whole: bool = True
    ahead: float = 1.5
    silence: float = 0.5
    commander: float = 0.45
    behind: float = 2.0 * DEG
    turn_known: bool = True
    asleep: bool = False
