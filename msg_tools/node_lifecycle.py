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

`design.ros2.org/articles/node_lifecycle.html` has the states; rclpy's own managed node ends on a
transition that its state does not have, and keeps what a callback raised to itself. These do not.

Endpoints are there from the start and not made on configure: a guard that is not configured would
have no `guard/status` and no `abort`, so nobody could say why the mount stands (two of its eight
tests failed so). What moves a mount is silent until active.
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
#: what one waits for that is not active
ACTIVATION = 'activation'
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class ManagedNode(MountNode, LifecycleNode):
    """A `MountNode` that is a `LifecycleNode`: unconfigured, inactive, active or finalized.

    `AUTOSTART` is among its parameters. What it subscribes to and publishes is there in all
    states; what moves the mount a subclass does only while `active`.

    Attributes
    ----------
    active : bool
    starting : bool
        It is about to become active by itself: nobody need be told that it is not.
    """

    def __init__(self, name, params, **kwargs):
        super().__init__(name, params, **kwargs)
        self.active, self._state = False, 'unconfigured'
        service = next(s for s in self.services if s.srv_type is ChangeState)
        self._change, service.callback = service.callback, self._on_change_state
        self.starting = self.value(AUTOSTART.name)
        # when it is made, and its executor runs
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
        """s after its start before it may be active: in them a duplicate is found."""
        return 0.0

    def configured(self):
        """Reach for the hardware; ValueError or OSError, one line, where that fails."""

    def activated(self):
        """From now on it may command; ValueError or OSError, one line, where that fails."""

    def deactivated(self):
        """Have the mount stop: it may command no more once this has returned."""

    @property
    def inactive(self):
        """Why nothing is commanded, for people; '' while it is active."""
        if self.active:
            return ''
        what = {'unconfigured': 'configure and activate it', 'finalized': 'start it anew'}
        return f'{self.get_name()} is {self._state}: {what.get(self._state, "activate it")}'

    def read_command(self, message, names):
        """A trajectory on `command` for a mount with joints `names`.

        Returns
        -------
        ns, times, positions, velocities
            As of `convert.read_trajectory`.

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
        """As rclpy's; there is no way back, whatever fails."""
        self._state = 'finalized'
        return self._rest('finalized')

    def on_error(self, state):
        """As rclpy's; after an error it is back at the start, or at the end."""
        self._state = 'finalized'
        return self._rest('unconfigured')

    def _rest(self, state):
        """Have the mount stop if it is active, and be in another state."""
        try:
            return self._made(self.deactivated if self.active else lambda: None, state)
        finally:
            self.active = False  # whatever was in the way

    def _made(self, call, state):
        try:
            call()
        except (ValueError, OSError) as err:
            self.get_logger().error(str(err))
            return FAILURE
        except Exception:  # rclpy would keep it to itself
            self.get_logger().fatal(traceback.format_exc())
            raise
        self._state = state
        return SUCCESS

    def destroy_node(self):
        """And its state machine: rclpy's own forgets it, and what it has in `/dev/shm` stays."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    # --- diagnostics ---------------------------------------------------------------------------

    def waiting_for(self):
        """Activation, too."""
        inactive = not self.active and not self.starting
        return [*super().waiting_for(), *([ACTIVATION] if inactive else [])]

    def details(self):
        """The state."""
        return [*super().details(), ('lifecycle', self._state)]


class WorkerNode(ManagedNode):
    """A `ManagedNode` whose device has its own threads.

    Attributes
    ----------
    worker : object
        With ``start()``, called once, when the node is configured, and ``close()``.
    started : bool
    """

    worker, started, _reported = None, False, ''

    def configured(self):
        """Begin; once, then the worker keeps the connection up."""
        if not self.started:
            self.started = True
            self.worker.start()

    def log_change(self, text, fine):
        """Log what is wrong (`text`) as it changes, or that nothing is any more (`fine`)."""
        if text != self._reported:
            self._reported = text
            if text:
                self.get_logger().warning(text)
            else:
                self.get_logger().info(fine)

    def finish(self):
        """End the worker."""
        if self.started:
            self.worker.close()
