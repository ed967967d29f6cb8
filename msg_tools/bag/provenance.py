"""Asks every node for its parameters, so that a log tells with what its numbers were made."""

import json

from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.node import NodeNameNonExistentError
from rclpy.parameter import parameter_value_to_python

from ..params import OF_TRUTH

#: calls of `step` after which another node is asked before one that does not answer
PATIENCE = 20
#: times that a node is asked
TRIES = 5


class ParameterCollector:
    """Asks one node after another, without holding anybody up.

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
        self._waiting = []
        self._tries = {}
        self._client = None
        self._patience = 0

    def step(self):
        """Look for nodes that are new, and ask the next one; call it now and then."""
        for name, namespace in self._node.get_node_names_and_namespaces():
            full = f'{namespace.rstrip("/")}/{name}'
            if full not in self._known and self._answers(name, namespace, full):
                self._known.add(full)
                self._waiting.append(full)
        if self._client is not None:
            self._patience -= 1
            if self._patience < 0:
                self._drop()
                if self._tries[self._name] < TRIES:
                    self._waiting.append(self._name)
            elif self._ask is not None and self._client.service_is_ready():
                ask, self._ask = self._ask, None
                ask()
        if self._client is None and self._waiting:
            self._name = self._waiting.pop(0)
            self._tries[self._name] = self._tries.get(self._name, 0) + 1
            self._begin(ListParameters, 'list_parameters', ListParameters.Request(), self._listed)

    def _answers(self, name, namespace, full):
        try:
            services = self._node.get_service_names_and_types_by_node(name, namespace)
        except NodeNameNonExistentError:
            return False  # it has just gone
        there = {service for service, _ in services}
        return {f'{full}/{verb}_parameters' for verb in ('list', 'describe', 'get')} <= there

    def _begin(self, kind, service, request, then):
        self._client = client = self._node.create_client(kind, f'{self._name}/{service}')
        self._patience = PATIENCE

        def ask():
            client.call_async(request).add_done_callback(
                lambda future: client is self._client and then(future.result()))
        self._ask = ask
        if client.service_is_ready():
            self._ask = None
            ask()

    def _drop(self):
        client, self._client = self._client, None
        self._node.destroy_client(client)

    def _listed(self, answer):
        self._drop()
        names = sorted(n for n in answer.result.names if not n.startswith('qos_overrides.'))
        self._begin(DescribeParameters, 'describe_parameters',
                    DescribeParameters.Request(names=names),
                    lambda told: self._described(names, told))

    def _described(self, names, answer):
        self._drop()
        truth = {name for name, told in zip(names, answer.descriptors)
                 if OF_TRUTH in told.additional_constraints}
        self._begin(GetParameters, 'get_parameters', GetParameters.Request(names=names),
                    lambda values: self._got(names, truth, values))

    def _got(self, names, truth, answer):
        name = self._name
        self._drop()
        self._take(name, {key: as_text(parameter_value_to_python(value))
                          for key, value in zip(names, answer.values)}, truth)
        self.step()


def as_text(value):
    """A parameter's value as JSON text."""
    if isinstance(value, bytes) or hasattr(value, 'tolist'):
        value = list(value)
    return json.dumps(value)
