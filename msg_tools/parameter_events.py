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

"""A node with declared parameters: range and unit, validated without side effects, then applied."""

import sys
from difflib import get_close_matches

from rcl_interfaces.msg import ParameterDescriptor, ParameterType, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from .parameter_sections import check_files
from .params import SITE_PARAMETERS, BadInput

#: rclpy declares it for every node, without a description
USE_SIM_TIME = ParameterDescriptor(
    name='use_sim_time', type=ParameterType.PARAMETER_BOOL, read_only=True,
    description='time is that of /clock (a simulated or replayed night), not of this machine; the '
    'same for all nodes of a graph')


class ParameterNode(Node):
    """A node whose parameters are `Param`, and no others.

    Parameters
    ----------
    name : str
        Default node name.
    params : iterable of Param
        Overrides of unknown ones are refused.
    context, overrides, namespace
        See `MountNode`.

    Raises
    ------
    BadInput
        A parameter is unknown, of the wrong type or out of range.
    """

    def __init__(self, name, params, *, context, overrides, namespace):
        given = [Parameter(key, value=value) for key, value in (overrides or {}).items()]
        super().__init__(name, context=context, namespace=namespace, parameter_overrides=given,
                         start_parameter_services=True, enable_rosout=True)
        check_files(self.get_fully_qualified_name(), sys.argv)
        if self.has_parameter(USE_SIM_TIME.name):
            self.set_descriptor(USE_SIM_TIME.name, USE_SIM_TIME)
        self._params = {}
        self.declare(params)
        unknown = [key for key in self._parameter_overrides
                   if not self.has_parameter(key) and not key.startswith('qos_overrides.')
                   and key not in SITE_PARAMETERS]
        if unknown:
            raise BadInput(f'{name}: {self._unknown(unknown[0])}')
        try:
            self.check_together({key: self.value(key) for key in self._params})
        except ValueError as err:
            raise BadInput(f'{name}: {err}') from None
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._apply)

    def declare(self, params):
        """Declare `params`; BadInput if a start-up value is refused."""
        for param in params:
            try:
                value = self.declare_parameter(
                    param.name, param.default, param.descriptor()).value
            except InvalidParameterValueException:
                given = self._parameter_overrides[param.name].value
                raise BadInput(f'{self.get_name()}: {param.name} = {given}: '
                               f'must be {param.low} to {param.high}') from None
            except InvalidParameterTypeException:
                given = self._parameter_overrides[param.name].value
                kind = type(param.default).__name__
                if kind == 'float' and isinstance(given, int):
                    kind += f', write {given}.0'
                raise BadInput(
                    f'{self.get_name()}: {param.name} = {given!r}: must be a {kind}') from None
            reason = param.refuse(value)
            if reason:
                raise BadInput(f'{self.get_name()}: {reason}')
            self._params[param.name] = param

    def check_overrides(self):
        """BadInput if a QoS override matches no endpoint; call it after creating all endpoints."""
        for key in self._parameter_overrides:
            if not self.has_parameter(key) and key not in SITE_PARAMETERS:
                raise BadInput(f'{self.get_name()}: {key} fits no topic and policy of this node; '
                               f'see ros2 param list {self.get_fully_qualified_name()}')

    def set_parameters_atomically(self, parameter_list):
        """As rclpy's; the error for an unknown parameter suggests the closest name."""
        for parameter in parameter_list:
            if not self.has_parameter(parameter.name):
                return SetParametersResult(successful=False, reason=self._unknown(parameter.name))
        return super().set_parameters_atomically(parameter_list)

    def _unknown(self, name):
        close = get_close_matches(name, list(self._params), 1)
        hint = f'did you mean {close[0]}?' if close else f'it has {", ".join(self._params)}'
        return f'unknown parameter {name}; {hint}'

    def value(self, name):
        """Value of parameter `name`."""
        return self.get_parameter(name).value

    def _validate(self, parameters):
        for parameter in parameters:
            known = self._params.get(parameter.name)
            reason = known.refuse(parameter.value) if known else None
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        try:
            self.check_together({name: self.value(name) for name in self._params}
                                | {p.name: p.value for p in parameters})
        except ValueError as err:
            return SetParametersResult(successful=False, reason=str(err))
        return SetParametersResult(successful=True)

    def check_together(self, values):
        """Raise ValueError for inconsistent parameter values; for subclasses."""

    def _apply(self, parameters):
        names = {p.name for p in parameters} & set(self._params)
        if names:
            self.parameters_changed(names)

    def parameters_changed(self, names):
        """Called after the parameters `names` have received new, valid values."""
