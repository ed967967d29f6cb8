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

"""Nodes that can move a mount: managed nodes of ROS 2, which command nothing unless active.

`design.ros2.org/articles/node_lifecycle.html` defines the states; the managed node of rclpy ends
on a transition that is invalid in its state, and hides exceptions of callbacks. These do not.

Endpoints exist from the start, not only after configure: an unconfigured guard would have no
`guard/status` and no `abort`, so nobody could say why the mount stands (two of its eight tests
failed because of that). A node publishes nothing that moves the mount until it is active.
"""

import traceback

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from . import convert
from .node import MountNode
from .params import Param

AUTOSTART = Param('autostart', True, 'become active at the start; else when a lifecycle manager, '
                  'ros2 lifecycle set or telescope-mount lifecycle says so', fixed=True)
#: what an inactive node waits for
ACTIVATION = 'activation'
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class ManagedNode(MountNode, LifecycleNode):
    """A `MountNode` that is a `LifecycleNode`: unconfigured, inactive, active or finalized.

    `AUTOSTART` is among its parameters. Subscriptions and publishers exist in all states; a
    subclass moves the mount only while `active`.

    Attributes
    ----------
    active : bool
    starting : bool
        About to activate itself, so nobody needs to be told that it is inactive.
    """

    def __init__(self, name, params, **kwargs):
        super().__init__(name, params, **kwargs)
        self.active, self._state = False, 'unconfigured'
        service = next(s for s in self.services if s.srv_type is ChangeState)
        self._change, service.callback = service.callback, self._on_change_state
        self.starting = self.value(AUTOSTART.name)
        # delayed until the node is complete and its executor runs
        self._begin = self.every(max(1e-3, self.look_around()), self._on_begin)

    def _on_begin(self):
        self.destroy_timer(self._begin)
        self.starting = False
        wanted = self.value(AUTOSTART.name) and self._state == 'unconfigured'
        if wanted and self.trigger_configure() == SUCCESS:
            self.trigger_activate()

    def _on_change_state(self, request, response):
        before = self._state
        try:
            response = self._change(request, response)
        except rclpy_implementation.RCLError:
            response.success = False
        if not response.success:
            transition = request.transition.label or f'number {request.transition.id}'
            self.get_logger().warning(f'{before}: the transition {transition} was not made')
        self.announce()
        return response

    # --- for subclasses -----------------------------------------------------------------------

    def look_around(self):
        """Time between start and activation for finding a duplicate, s."""
        return 0.0

    def configured(self):
        """Connect to the hardware; one-line ValueError or OSError on failure."""

    def activated(self):
        """Start commanding; one-line ValueError or OSError on failure."""

    def deactivated(self):
        """Stop the mount: no commands are allowed after this returns."""

    @property
    def inactive(self):
        """Why nothing is commanded, for people; '' if active."""
        if self.active:
            return ''
        what = {'unconfigured': 'configure and activate it', 'finalized': 'start it anew'}
        return f'{self.get_name()} is {self._state}: {what.get(self._state, "activate it")}'

    def read_command(self, message, names):
        """Read a trajectory on `command` for a mount with joints `names`.

        Returns
        -------
        ns, times, positions, velocities
            See `convert.read_trajectory`.

        Raises
        ------
        ValueError
            The node is inactive, or the command is for another mount.
        """
        if not self.active:
            raise ValueError(self.inactive)
        command = convert.read_trajectory(message)
        joints = convert.joints_of(message.joint_names)
        if joints != names:
            raise ValueError(f'command for {" and ".join(joints)}: this mount has '
                             f'{" and ".join(names)}')
        return command

    # --- transitions ---------------------------------------------------------------------------

    def on_configure(self, state):
        """As rclpy's."""
        return self._made(self.configured, 'inactive')

    def on_activate(self, state):
        """As rclpy's."""
        self.active = True
        result = self._made(self.activated, 'active')
        self.active = result == SUCCESS
        return result

    def on_deactivate(self, state):
        """As rclpy's."""
        return self._rest('inactive')

    def on_cleanup(self, state):
        """As rclpy's."""
        return self._rest('unconfigured')

    def on_shutdown(self, state):
        """As rclpy's; shutdown is final, even if something fails."""
        self._state = 'finalized'
        return self._rest('finalized')

    def on_error(self, state):
        """As rclpy's; after an error the node is unconfigured again, or finalized."""
        self._state = 'finalized'
        return self._rest('unconfigured')

    def _rest(self, state):
        """Stop the mount if active, and change to another state."""
        try:
            return self._made(self.deactivated if self.active else lambda: None, state)
        finally:
            self.active = False  # whatever failed

    def _made(self, call, state):
        try:
            call()
        except (ValueError, OSError) as err:
            self.get_logger().error(str(err))
            return FAILURE
        except Exception:  # rclpy would hide it
            self.get_logger().fatal(traceback.format_exc())
            raise
        self._state = state
        return SUCCESS

    def destroy_node(self):
        """Destroy the state machine too: rclpy leaks it, and its files in `/dev/shm`."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    # --- diagnostics ---------------------------------------------------------------------------

    def waiting_for(self):
        """Includes activation."""
        inactive = not self.active and not self.starting
        return [*super().waiting_for(), *([ACTIVATION] if inactive else [])]

    def details(self):
        """Includes the lifecycle state."""
        return [*super().details(), ('lifecycle', self._state)]


class WorkerNode(ManagedNode):
    """A `ManagedNode` whose device has its own threads.

    Attributes
    ----------
    worker : object
        Has ``start()``, called once, when the node is configured, and ``close()``.
    started : bool
    """

    worker, started, _reported = None, False, ''

    def configured(self):
        """Start the worker once; from then on it keeps the connection up."""
        if not self.started:
            self.started = True
            self.worker.start()

    def log_change(self, text, fine):
        """Log a problem (`text`) when it changes, or its end (`fine`)."""
        if text != self._reported:
            self._reported = text
            if text:
                self.get_logger().warning(text)
            else:
                self.get_logger().info(fine)

    def finish(self):
        """Stop the worker."""
        if self.started:
            self.worker.close()
