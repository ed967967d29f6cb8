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

"""Requests motions from the guard of a graph; starts a guard if there is none."""

from msg_tools import convert, topics
from pointing_model.mounts import mount_text

#: interval at which a request is renewed, s
RENEW = 0.2


class GuardClient:
    """Publishes `request`.

    Parameters
    ----------
    node : rclpy.node.Node
    executor : rclpy.executors.Executor
        Executor for the guard, if the graph has none.
    mount : Mount
    spin : callable
        ``spin(seconds, until)`` of `Listener`.
    guard : dict
        Parameters of that guard.

    Attributes
    ----------
    status : dict of str to str
        Rows of the guard's last status.

    Raises
    ------
    ValueError
        Another node may command the mount: one line.
    """

    def __init__(self, node, executor, mount, spin, guard):
        commanders = [info.node_name for info in node.get_publishers_info_by_topic(
            node.resolve_topic_name(topics.REQUEST.name))]
        if commanders:
            raise ValueError(f'not nudged: {" and ".join(commanders)} may command the mount; end '
                             'it first')
        self._node, self._executor, self._mount, self._spin = node, executor, mount, spin
        self._request, self.status, self._message, self._guard = None, {}, '', None
        self._pub = node.create_publisher(topics.REQUEST.message, topics.REQUEST.name,
                                          topics.REQUEST.qos)
        self._owner_pub = node.create_publisher(
            topics.REQUEST_OWNER.message, topics.REQUEST_OWNER.name, topics.REQUEST_OWNER.qos)
        node.create_subscription(topics.GUARD_STATUS.message, topics.GUARD_STATUS.name,
                                 self._on_status, topics.GUARD_STATUS.qos)
        if not node.count_publishers(node.resolve_topic_name(topics.COMMAND.name)):
            from telescope_mount.guard.mount_guard_node import MountGuard
            self._guard = MountGuard(context=node.context, namespace=node.get_namespace(),
                                     overrides={'mount': mount_text(mount), **guard})
            executor.add_node(self._guard)
        if not spin(10.0, lambda: self.status and self._pub.get_subscription_count()):
            raise ValueError('not nudged: the publisher of command takes no requests; end it, and '
                             'a guard is started')
        node.create_timer(RENEW, self._renew)

    def _on_status(self, message):
        self.status = {row.key: row.value for row in message.values}
        self._message = message.message

    def _renew(self):
        if self._request is not None:
            self._pub.publish(self._request)

    def ask(self, stamp, times, angles, rates):
        """Request a track, and keep renewing it: ns, s, rad, rad/s."""
        self._request = convert.trajectory(stamp, times, angles, rates, self._mount.names.keys)
        self._owner_pub.publish(convert.owner(self._request, self._node))
        self._renew()

    def obeyed(self, seconds, until=lambda: False):
        """Spin so long, or until a condition holds; ValueError if the guard has stopped."""
        stamp = str(convert.from_stamp(self._request.header.stamp))

        def stopped():
            return self.status.get('refused') == stamp or self.status.get('state') in (
                'stopped', 'aborted', 'paused', 'parked', 'parking')
        self._spin(seconds, lambda: stopped() or until())
        if stopped():
            raise ValueError('the guard stopped it: ' + (
                self.status['reason'] if self.status.get('refused') == stamp else self._message))

    def close(self):
        """Withdraw the request, so that the mount stops."""
        if self._request is not None:
            self._request.points = []
            self._renew()
            self._request = None
            self._spin(0.5, lambda: self.status.get('state') == 'idle')
        if self._guard is not None:
            self._executor.remove_node(self._guard)
            self._guard.destroy_node()
