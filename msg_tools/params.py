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

"""Parameters of nodes: allowed values, and errors for users."""

from collections.abc import Callable
from dataclasses import dataclass

#: in the constraints of a parameter's descriptor: see `Param.truth`
TRUTH_MARK = 'what only the simulator knows: kept out of the log that a calibration reads'
#: of the site: one file sets them for all nodes (`/**`); nodes that do not use them ignore them
SITE_PARAMETERS = ('latitude_deg', 'longitude_deg', 'height_m', 'pressure_hpa', 'temperature_c',
                   'humidity', 'wavelength_um')


@dataclass(frozen=True)
class Param:
    """A parameter of a node.

    Parameters
    ----------
    name : str
        Ends with the unit if it is not SI.
    default : bool, int, float, str or list of str
        Also fixes the type.
    doc : str
        What it does, for ``ros2 param describe``.
    low, high : float, optional
        Allowed range, ends included.
    choices : tuple of str, optional
        Allowed values of a string.
    check : callable, optional
        ``check(value)`` raises ValueError with the reason for an invalid value. It must have no
        side effects.
    fixed : bool
        Can be set only when the node starts.
    truth : bool
        Known only to the simulator: logged only with the truth.
    """

    name: str
    default: object
    doc: str
    low: float | None = None
    high: float | None = None
    choices: tuple = ()
    check: Callable | None = None
    fixed: bool = False
    truth: bool = False

    def descriptor(self):
        """The ParameterDescriptor with range and unit for the user."""
        from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
        out = ParameterDescriptor(description=self.doc, read_only=self.fixed)
        if self.low is not None:
            if isinstance(self.default, float):
                out.floating_point_range = [
                    FloatingPointRange(from_value=float(self.low), to_value=float(self.high))]
            else:
                out.integer_range = [
                    IntegerRange(from_value=int(self.low), to_value=int(self.high), step=1)]
        if self.choices:
            out.additional_constraints = 'one of ' + ', '.join(self.choices)
        if self.truth:
            out.additional_constraints = TRUTH_MARK
        return out

    def refuse(self, value):
        """Reason why `value` is invalid, or None."""
        if self.choices and value not in self.choices:
            return f'{self.name} = {value!r}: use one of {", ".join(self.choices)}'
        if self.low is not None and not self.low <= value <= self.high:
            return f'{self.name} = {value}: must be {self.low} to {self.high}'
        if self.check is not None:
            try:
                self.check(value)
            except (ValueError, OSError) as err:
                return f'{self.name} = {value!r}: {err}'
        return None


class BadInput(ValueError):
    """An invalid start-up value; its text is one line for the user."""
