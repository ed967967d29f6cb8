"""Managed nodes of a running graph, from outside: their states, and transitions."""

import os
import time

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from msg_tools.executor import NodeExecutor

#: s in which nodes of a graph are found, and answer
FOUND, ANSWERED = 3.0, 30.0


class ManagedNodes:
    """The nodes of a namespace that have states.

    Parameters
    ----------
    domain : int
    namespace : str
    """

    def __init__(self, domain, namespace):
        os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain,
                   signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node('lifecycle', context=self._context, namespace=namespace,
                          start_parameter_services=False, enable_rosout=False)
        self._executor = NodeExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._within = self._node.get_namespace().rstrip('/') + '/'

    def names(self):
        """Of the nodes, in order; ValueError where there is none."""
        self._spin(lambda: False, FOUND)
        found = sorted(
            name.removeprefix(self._within).removesuffix('/change_state')
            for name, _ in self._node.get_service_names_and_types()
            if name.startswith(self._within) and name.endswith('/change_state'))
        if not found:
            raise ValueError(f'no managed node in {self._within} of domain '
                             f'{self._context.get_domain_id()}')
        return found

    def state(self, name):
        """Of a node; ValueError where it does not answer."""
        return self._ask(GetState, f'{name}/get_state', GetState.Request()).current_state.label

    def change(self, name, transition):
        """Have a node make a transition; whether it did. ValueError where it does not answer.

        `shutdown` is one of three transitions, by the state that it begins in.
        """
        if transition == 'shutdown':
            transition = f'{self.state(name)}_shutdown'
        number = getattr(Transition, f'TRANSITION_{transition.upper()}', None)
        return number is not None and self._ask(
            ChangeState, f'{name}/change_state',
            ChangeState.Request(transition=Transition(id=number))).success

    def _ask(self, kind, name, request):
        client = self._node.create_client(kind, name)
        if not self._spin(client.service_is_ready, FOUND):
            raise ValueError(f'no node offers {client.srv_name}')
        future = client.call_async(request)
        if not self._spin(future.done, ANSWERED):
            raise ValueError(f'{client.srv_name} did not answer within {ANSWERED:g} s')
        self._node.destroy_client(client)
        return future.result()

    def _spin(self, until, seconds):
        end = time.monotonic() + seconds
        while not until():
            if time.monotonic() > end:
                return False
            self._executor.spin_once(0.05)
        return True

    def close(self):
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
