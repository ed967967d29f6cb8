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

"""Which power-on of an instrument a reading belongs to: its counts restart at every power-on.

Each encoder publishes it once per power-on, latched, on ``incremental/power_on`` or
``absolute/power_on``; `msg_tools.homing` contains it too. A restarted driver may count from 1
again: so number and start together identify a power-on, and are only compared for equality. In
older logs and drivers each reading contains it: `msg_tools.older_frames`.
"""

from typing import NamedTuple

from .convert import from_stamp, values_message, values_of
from .older_frames import power_on_in

VERSION = 1


class PowerOn(NamedTuple):
    """A power-on of an instrument.

    Attributes
    ----------
    number : int
        Number, as counted by the instrument.
    started : float
        Start, UTC s, to the millisecond: see `since`.
    """

    number: int
    started: float

    def __str__(self):
        return f'power-on {self.number} of {self.started:.3f} s'


def since(ns):
    """A stamp (ns) as `PowerOn.started`: a number that JSON, text and float64 preserve."""
    return round(ns * 1e-9, 3)


def power_on_message(power_on, ns):
    """The DiagnosticArray of a `PowerOn`, stamped with its first reading (ns)."""
    return values_message(ns, {'power_on': {
        'version': VERSION, 'number': power_on.number, 'started_s': f'{power_on.started:.3f}'}})


def read_power_on(message):
    """The inverse of `power_on_message`.

    Raises
    ------
    ValueError
        Not a power-on, or of another version.
    """
    values = values_of(message, 'power_on', VERSION)
    try:
        return PowerOn(int(values['number']), round(float(values['started_s']), 3))
    except (KeyError, ValueError, OverflowError):
        raise ValueError('a power-on needs number and started_s, UTC s') from None


class PowerOns:
    """Determines the power-on of each reading of one instrument."""

    def __init__(self):
        self._known = []

    def take(self, message):
        """Take a message; ValueError if it contains no power-on."""
        new = read_power_on(message)
        # a reading of the previous power-on may still arrive
        self._known = [old for old in self._known if old.started < new.started][-1:] + [new]

    def of(self, header):
        """The `PowerOn` of a reading with that header; None if unknown."""
        older = power_on_in(header.frame_id)
        if older is not None:
            return PowerOn(*older)
        at = since(from_stamp(header.stamp))
        return next((one for one in reversed(self._known) if one.started <= at), None)
