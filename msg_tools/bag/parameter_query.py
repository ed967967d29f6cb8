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

"""Asks every node for its parameters, so that a log tells with what its numbers were made."""

import json

from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.node import NodeNameNonExistentError
from rclpy.parameter import parameter_value_to_python

from ..params import TRUTH_MARK

#: calls of `step` after which an answer counts as lost and is requested again, then twice as many
PATIENCE = 2
#: calls of `step` without an answer after which a log may end without it, and none is requested
WAITED_FOR, GIVEN_UP = 16, 500


class ParameterCollector:
    """Asks all nodes of the namespace, without holding anybody up: others are no part of the mount.

    Parameters
    ----------
    node : rclpy.node.Node
        Of whose executor the answers come.
    take : callable
        ``take(full node name, {parameter: JSON text}, names)``, with the names of those that say
        what only the simulator knows (`params.Param.truth`), a set.
    """

    def __init__(self, node, take):
        self._node = node
        self._take = take
        self._known = {node.get_fully_qualified_name()}
        self._namespace = f'{node.get_namespace().rstrip("/")}/'
        self._queries = {}

    @property
    def awaited(self):
        """Names of the nodes whose answers are to come: a log that ends now has them not."""
        return [name for name, query in self._queries.items()
                if not query.ended and query.steps < WAITED_FOR]

    def step(self):
        """Look for nodes that are new, and ask again where no answer came; call it now and then."""
        for name, namespace in self._node.get_node_names_and_namespaces():
            full = f'{namespace.rstrip("/")}/{name}'
            if full not in self._known and full.startswith(
                    self._namespace) and self._answers(name, namespace, full):
                self._known.add(full)
                self._queries[full] = _NodeQuery(self._node, full, self._take)
        for full, query in list(self._queries.items()):
            if not query.step():
                del self._queries[full]

    def _answers(self, name, namespace, full):
        try:
            services = self._node.get_service_names_and_types_by_node(name, namespace)
        except NodeNameNonExistentError:
            return False  # it has just gone
        there = {service for service, _ in services}
        return {f'{full}/{verb}_parameters' for verb in ('list', 'describe', 'get')} <= there


class _NodeQuery:
    """One node: what its parameters are called, what is reported of them, what they are."""

    def __init__(self, node, name, take):
        self._node, self._name, self._take = node, name, take
        self._begin(ListParameters, 'list_parameters', ListParameters.Request(), self._listed)

    @property
    def ended(self):
        """Whether nothing more comes of it."""
        return self._client is None

    def step(self):
        """Ask where nobody has yet or the answer must be lost; whether there is more to come."""
        if self.ended:
            return False
        self.steps += 1
        if self.steps >= GIVEN_UP:
            self._drop()
            return False
        self._ask()
        return True

    def _begin(self, kind, service, request, then):
        self._client = client = self._node.create_client(kind, f'{self._name}/{service}')
        self.steps, self._next, self._patience = 0, 0, PATIENCE

        def send():
            # the first answer counts, to whichever question
            client.call_async(request).add_done_callback(
                lambda future: client is self._client and self._node.executor.create_task(
                    then, future.result()))
        self._send = send
        self._ask()

    def _ask(self):
        if self.steps >= self._next and self._client.service_is_ready():
            self._next, self._patience = self.steps + self._patience, 2 * self._patience
            self._send()

    def _drop(self):
        client, self._client = self._client, None
        self._node.destroy_client(client)

    def _listed(self, answer):
        self._drop()
        names = sorted(n for n in answer.result.names if not n.startswith('qos_overrides.'))
        self._begin(DescribeParameters, 'describe_parameters',
                    DescribeParameters.Request(names=names),
                    lambda answer: self._described(names, answer))

    def _described(self, names, answer):
        self._drop()
        truth = {name for name, described in zip(names, answer.descriptors)
                 if TRUTH_MARK in described.additional_constraints}
        self._begin(GetParameters, 'get_parameters', GetParameters.Request(names=names),
                    lambda values: self._got(names, truth, values))

    def _got(self, names, truth, answer):
        self._drop()
        self._take(self._name, {key: as_text(parameter_value_to_python(value))
                                for key, value in zip(names, answer.values)}, truth)


def as_text(value):
    """A parameter's value as JSON text."""
    if isinstance(value, bytes) or hasattr(value, 'tolist'):
        value = list(value)
    return json.dumps(value)
