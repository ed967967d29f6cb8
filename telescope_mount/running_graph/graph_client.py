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

"""A client of a running graph: its services, states and latched messages."""

import os
import time
from contextlib import ExitStack, contextmanager

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from msg_tools.executor import NodeExecutor
from msg_tools.steps import ServiceCall

from ..dds import dds_environment
from ..processes.interrupt import noted, raise_noted

#: s allowed to find the nodes of a graph, and to get an answer
FOUND, ANSWERED = 3.0, 30.0


def leads_to(transition):
    """The state of a managed node after a transition."""
    return {'configure': 'inactive', 'activate': 'active', 'deactivate': 'inactive',
            'cleanup': 'unconfigured'}.get(transition, 'finalized')


@contextmanager
def _environment_of(environment):
    """Within, ROS and DDS see `environment`; afterwards it is restored."""
    before = dict(os.environ)
    os.environ.update(environment)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


class GraphClient:
    """A node that queries the nodes of a namespace.

    Parameters
    ----------
    domain : int
    namespace : str
    name : str
        Name of the node.
    args : list of str, optional
        See `rclpy.init`.
    environment : dict of str to str, optional
        Environment of the graph, from which DDS takes its settings.

    Attributes
    ----------
    node : rclpy.node.Node
    executor : NodeExecutor
    """

    def __init__(self, domain, namespace, name, args=None, environment=None):
        self._until_closed = ExitStack()
        self._until_closed.enter_context(noted())
        self._context = Context()
        # Ctrl-C is handled by the command line, which ends everything in order
        with _environment_of(environment or dds_environment()):
            rclpy.init(context=self._context, domain_id=domain, args=args,
                       signal_handler_options=SignalHandlerOptions.NO)
            self.node = Node(name, context=self._context, namespace=namespace,
                             start_parameter_services=False, enable_rosout=False)
        self.executor = NodeExecutor(context=self._context)
        self.executor.add_node(self.node)
        self._within = self.node.get_namespace().rstrip('/') + '/'

    def spin(self, seconds):
        """Process events for at most `seconds`; returns early after one.

        Raises
        ------
        KeyboardInterrupt
            A signal arrived since the last call; its number is the argument.
        """
        self.executor.spin_once(timeout_sec=seconds)
        raise_noted()

    def check(self):
        """Called while waiting; it may raise."""

    def spin_until(self, condition, timeout):
        """Spin until `condition()`; False after `timeout` seconds."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            self.spin(0.05)
            self.check()
        return True

    def spin_for(self, seconds):
        """Spin for `seconds`."""
        self.spin_until(lambda: False, seconds)

    def ask(self, kind, name, request, found=FOUND, answered=ANSWERED):
        """Call a service, and repeat the call if no answer comes.

        `found` and `answered` are the seconds allowed to find its server and to get the answer.

        Returns
        -------
        response
        times : int
            Number of calls.

        Raises
        ------
        ValueError
            No node offers it, or none answers.
        """
        client = self.node.create_client(kind, name)
        if not self.spin_until(client.service_is_ready, found):
            raise ValueError(f'no node offers {self._within}{name}{self.where_else()}')
        question = ServiceCall(client, request=request)
        if not self.spin_until(question.over, answered):
            raise ValueError(f'{self._within}{name} did not answer within {answered:g} s')
        self.node.destroy_client(client)
        return question.answer, question.times

    def trigger(self, name):
        """Call a Trigger service: success and message; ValueError see `ask`."""
        answer, _ = self.ask(Trigger, name, Trigger.Request())
        return answer.success, answer.message

    def last(self, topic):
        """The last message of a latched topic, or None."""
        got = []
        subscription = self.node.create_subscription(
            topic.message, topic.name, got.append, topic.qos)
        self.spin_until(lambda: got, FOUND)
        self.node.destroy_subscription(subscription)
        return got[-1] if got else None

    def where_else(self):
        """Hint where to look for a graph, '; ...' to append to a message; '' if one is here."""
        domain = self._context.get_domain_id()
        own = self.node.get_name(), self.node.get_namespace()
        spaces = {space for name, space in self.node.get_node_names_and_namespaces()
                  if (name, space) != own}
        return elsewhere(domain, self.node.get_namespace(), spaces)

    # --- managed nodes ------------------------------------------------------------------------

    def managed(self):
        """Sorted names of the managed nodes; ValueError if there are none."""
        self.spin_for(FOUND)
        found = sorted(
            name.removeprefix(self._within).removesuffix('/change_state')
            for name, _ in self.node.get_service_names_and_types()
            if name.startswith(self._within) and name.endswith('/change_state'))
        if not found:
            raise ValueError(f'no managed node in {self._within} of domain '
                             f'{self._context.get_domain_id()}{self.where_else()}')
        return found

    def state(self, name):
        """State of a managed node; ValueError if it does not answer."""
        from lifecycle_msgs.srv import GetState
        answer, _ = self.ask(GetState, f'{name}/get_state', GetState.Request())
        return answer.current_state.label

    def change(self, name, transition):
        """Request a transition of a node; whether it succeeded. ValueError if it does not answer.

        `shutdown` is one of three transitions, depending on the present state.
        """
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState
        if transition == 'shutdown':
            transition = f'{self.state(name)}_shutdown'
        number = getattr(Transition, f'TRANSITION_{transition.upper()}', None)
        if number is None:
            return False
        answer, times = self.ask(ChangeState, f'{name}/change_state',
                                 ChangeState.Request(transition=Transition(id=number)))
        # if the first request succeeded, its repetition is refused
        return answer.success or (times > 1 and self.state(name) == leads_to(transition))

    def close(self):
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()
        self._until_closed.close()


def elsewhere(domain, namespace, spaces, what='node at all', option='--namespace, '):
    """What to do if no graph is found.

    Parameters
    ----------
    domain : int
    namespace : str
        Namespace that was searched.
    spaces : set of str
        Namespaces in which nodes were found.
    what : str
        What is missing.
    option : str
        Option that selects another namespace.

    Returns
    -------
    str
        To append to a message; '' if there are nodes in the namespace.
    """
    if namespace in spaces:
        return ''
    if not spaces:
        return (f'; there is no {what} in domain {domain}: give the ROS domain of the graph '
                'with --domain or ROS_DOMAIN_ID; on another computer set '
                'ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET on both')
    return (f'; domain {domain} has nodes in {", ".join(sorted(spaces))} and none in {namespace}: '
            f'they must be in one namespace ({option}-r __ns:=/mount)')
