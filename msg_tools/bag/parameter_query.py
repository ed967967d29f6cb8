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

"""Queries the parameters of all nodes, so that a log documents how its numbers were made."""

import json

from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.node import NodeNameNonExistentError
from rclpy.parameter import parameter_value_to_python

from ..params import TRUTH_MARK

#: calls of `step` after which an unanswered request is repeated; the number doubles each time
PATIENCE = 2
#: calls of `step` without an answer after which a log may end without it, and the query is given up
WAITED_FOR, GIVEN_UP = 16, 500


class ParameterCollector:
    """Queries all nodes of the namespace without blocking; others do not belong to the mount.

    Parameters
    ----------
    node : rclpy.node.Node
        Its executor receives the answers.
    take : callable
        ``take(full node name, {parameter: JSON text}, names)``; the names, a set, are those of
        parameters known only to the simulator (`params.Param.truth`).
    """

    def __init__(self, node, take):
        self._node = node
        self._take = take
        self._known = {node.get_fully_qualified_name()}
        self._namespace = f'{node.get_namespace().rstrip("/")}/'
        self._queries = {}

    @property
    def awaited(self):
        """Nodes whose answers are still expected: a log that ends now lacks them."""
        return [name for name, query in self._queries.items()
                if not query.ended and query.steps < WAITED_FOR]

    def step(self):
        """Find new nodes and repeat unanswered requests; call it regularly."""
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
            return False  # it has just disappeared
        there = {service for service, _ in services}
        return {f'{full}/{verb}_parameters' for verb in ('list', 'describe', 'get')} <= there


class _NodeQuery:
    """Queries one node: names of its parameters, their descriptions, their values."""

    def __init__(self, node, name, take):
        self._node, self._name, self._take = node, name, take
        self._begin(ListParameters, 'list_parameters', ListParameters.Request(), self._listed)

    @property
    def ended(self):
        """Whether no more answers are expected."""
        return self._client is None

    def step(self):
        """Send a request if there is none or its answer seems lost; whether to continue."""
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
            # the first answer counts, whichever request it belongs to
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
    """Value of a parameter as JSON text."""
    if isinstance(value, bytes) or hasattr(value, 'tolist'):
        value = list(value)
    return json.dumps(value)
