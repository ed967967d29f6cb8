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

"""Which power-on an instrument is in, as its messages tell: what it counts from holds no longer.

The ``frame_id`` of a reading of the incremental encoder says it (``power_on_2@1768482000.500``),
and `msg_tools.homing` says the same. A driver that is started anew may count from 1 again: number
and start together name a power-on, and only equality counts.
"""

import re
from math import nan
from typing import NamedTuple

_FRAME = re.compile(r'power_on_(-?\d+)@(\d+(?:\.\d+)?)')


class PowerOn(NamedTuple):
    """A power-on of an instrument.

    Attributes
    ----------
    number : int
        As the instrument counts them.
    started : float
        When it began, UTC s, to the millisecond: see `since`.
    """

    number: int
    started: float

    @property
    def frame(self):
        """The ``frame_id`` that gives it."""
        return f'power_on_{self.number}@{self.started:.3f}'


def since(ns):
    """A stamp (ns) as `PowerOn.started`: a number that JSON, text and float64 keep."""
    return round(ns * 1e-9, 3)


def read_frame(frame):
    """The `PowerOn` that a ``frame_id`` tells; None where it tells none."""
    found = _FRAME.fullmatch(frame)
    return None if found is None else PowerOn(int(found[1]), float(found[2]))


def start_of(frame):
    """When the power-on began that a ``frame_id`` tells, UTC s; NaN where it tells none."""
    power_on = read_frame(frame)
    return nan if power_on is None else power_on.started
