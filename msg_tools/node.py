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

"""What all nodes of the graph share: parameters, diagnostics, message counts, a clean end."""

import copy
import os
import socket
import time
import uuid
from functools import lru_cache
from inspect import iscoroutinefunction

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.publisher import Publisher
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.time_source import TimeSource
from std_srvs.srv import Trigger

from . import NAMESPACE
from .executor import AFTER, ANSWERS, published
from .gaps import SequenceGaps
from .parameter_events import USE_SIM_TIME, ParameterNode
from .params import BadInput, Param
from .readiness import LAST, PUBLISHED, PUBLISHES, RESTS, SUBSCRIBES, GraphReports, is_count
from .service_retry import Answers
from .topics import CLOCK, DIAGNOSTICS, ENDPOINTS

__all__ = ['BadInput', 'Counter', 'MountNode', 'NO_PUBLISHER_EVENTS', 'NO_SUBSCRIPTION_EVENTS',
           'Param']

# Each event handler is one more entity that the executor checks for every message: they took
# half of a node's time. Incompatible endpoints are detected once a second from the graph instead.
NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
#: exceptions that an unusable message can raise: in JSON, infinite numbers or a thousand brackets
#: raise no ValueError
UNUSABLE = ValueError, ArithmeticError, RecursionError
#: s between checks for duplicates of a node
DUPLICATES = 0.25


@lru_cache(64)
def message_of(data, kind):
    """The message of class `kind` in some bytes; ValueError gives the reason if there is none.

    rclpy, asked for messages, silently skips such bytes. A message that several nodes of a process
    take is decoded once.
    """
    try:
        return deserialize_message(data, kind)
    except Exception as err:
        reason = [*str(err).splitlines(), type(err).__name__][0]
        raise ValueError(f'no {kind.__name__}: {reason}') from None


class Counter:
    """Message counts of one endpoint: received, last sequence number, lost.

    Parameters
    ----------
    latched : bool
        A latched topic keeps only the last message: skipping earlier ones is no loss.
    """

    def __init__(self, latched=False):
        self.count = 0
        self.last = 0
        self.sequence = SequenceGaps(latched)

    @property
    def gaps(self):
        """Number of lost messages."""
        return self.sequence.gaps

    def received(self, info):
        """Count a message; a jump in a publisher's sequence number is a loss."""
        self.count += 1
        number = info.get('publication_sequence_number')
        if number is not None:
            self.last = number
            self.sequence.add(number)


class CountedPublisher(Publisher):
    """A publisher that counts its messages, and announces them to the executor of its process.

    Attributes
    ----------
    counter : Counter
    """

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.counter, self._full_name = Counter(), self.topic_name

    def publish(self, msg):
        """As rclpy's, with counting."""
        self.counter.count += 1
        super().publish(msg)
        published(self._full_name)


class MountNode(ParameterNode):
    """A node of the graph.

    Parameters
    ----------
    name : str
        Default node name.
    params : iterable of Param
        Its parameters, declared with range and unit; overrides of unknown ones are refused.
    hardware_id : str
        Shown in diagnostics.
    context : rclpy.context.Context, optional
        A private context (tests).
    overrides : dict, optional
        Parameter values as ``--ros-args -p`` would give them (tests).

    Raises
    ------
    BadInput
        A parameter is unknown, of the wrong type or out of range.
    """

    #: least s between wake-ups, see `NodeExecutor`
    GATHER = 0.0

    def __init__(self, name, params=(), *, hardware_id='', context=None, overrides=None,
                 namespace=NAMESPACE):
        super().__init__(name, params, context=context, overrides=overrides, namespace=namespace)
        self._publishers_of = {}
        self._subscriptions_of = {}
        self._instance, self._sole, self._watched = new_instance(), [], None
        self.rejected = {}
        # unique: two mounts may be on one graph
        self._hardware_id = f'{self.get_fully_qualified_name()}: {hardware_id or name}'
        self._announced = None
        self._announced_at = 0.0
        self._last_counts, self._rests = None, False
        self._published_connections = self._published_counts = None
        self._unmatched, self._warned = set(), set()
        self._diagnostics, self._reports_of_endpoints = (
            self.create_publisher(topic.message, topic.name, topic.qos,
                                  event_callbacks=NO_PUBLISHER_EVENTS)
            for topic in (DIAGNOSTICS, ENDPOINTS))
        # diagnostics continue while simulated time is paused
        self.every(0.1, self._diagnose)
        self.every(DUPLICATES, self._look_for_duplicates)

    # --- topics -----------------------------------------------------------------------------

    def publisher(self, topic):
        """A publisher on `topic`, counted, with QoS overrides by parameter."""
        # rclpy writes overrides into the given profile, which topics share
        pub = self.create_publisher(
            topic.message, topic.name, copy.copy(topic.qos), event_callbacks=NO_PUBLISHER_EVENTS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            publisher_class=CountedPublisher)
        self._publishers_of[pub.topic_name] = pub, pub.counter
        if not topic.many:
            self._sole.append(pub.topic_name)
        return pub

    def publisher_count(self, topic):
        """Number of publishers of a `Topic`."""
        return self.count_publishers(self.resolve_topic_name(topic.name))

    def publisher_names(self, topic):
        """Nodes that publish a `Topic`, list of str, and the number of those with unknown name."""
        infos = self.get_publishers_info_by_topic(self.resolve_topic_name(topic.name))
        # right after discovery the name of a node is unknown
        names = [f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos
                 if 'UNKNOWN' not in info.node_name]
        return names, len(infos) - len(names)

    def subscribe(self, topic, callback, after=None):
        """A subscription to `topic`; an unusable message is counted and does not end the node.

        `callback(message)` raises ValueError for an unusable message. `after()` is called after all
        messages that were ready have been taken: for work that costs as much for many messages as
        for one.
        """
        counter = Counter(topic.latched)

        def guarded(data, info):
            counter.received(info)
            try:
                callback(message_of(data, topic.message))
            except UNUSABLE as err:
                self.reject(topic.name, str(err))

        def guarded_after():
            try:
                after()
            except UNUSABLE as err:
                self.reject(topic.name, str(err))

        sub = self.create_subscription(
            topic.message, topic.name, guarded, copy.copy(topic.qos), raw=True,
            event_callbacks=NO_SUBSCRIPTION_EVENTS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
        if after is not None:
            setattr(sub, AFTER, guarded_after)
        counter.sequence.present = sub.get_publisher_count
        self._subscriptions_of.setdefault(sub.topic_name, []).append((sub, counter))
        return sub

    def create_subscription(self, msg_type, topic, callback, *args, **kwargs):
        """As rclpy's, but refuses a negative `/clock`, which ended the node."""
        if isinstance(getattr(callback, '__self__', None), TimeSource):
            take = callback

            def callback(message):
                if message.clock.sec < 0:
                    self.reject(CLOCK.name, f'a clock below zero: {message.clock.sec} s')
                else:
                    take(message)
        return super().create_subscription(msg_type, topic, callback, *args, **kwargs)

    def every(self, seconds, call):
        """A timer on steady wall time, whatever the time source of the graph."""
        return self.create_timer(seconds, call, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def create_service(self, srv_type, *args, **kwargs):
        """As rclpy's; a repeated Trigger request is not executed again."""
        service = super().create_service(srv_type, *args, **kwargs)
        if srv_type is Trigger:
            setattr(service, ANSWERS, Answers())
        return service

    def serve(self, name, call, once=False):
        """A Trigger service; `call()`, or its coroutine, returns success and a sentence.

        With `once`, a request repeated after a lost answer is not executed again; without it, every
        request is executed, as needed for services that stop something.
        """
        def answer(_, response):
            response.success, response.message = call()
            return response

        async def answer_later(_, response):
            response.success, response.message = await call()
            return response
        # a coroutine leaves the node's group to the others, and also answers requests meanwhile
        service = self.create_service(Trigger, name, answer_later, callback_group=(
            ReentrantCallbackGroup())) if iscoroutinefunction(call) else (
                self.create_service(Trigger, name, answer))
        if not once:
            delattr(service, ANSWERS)

    def graph_reports(self):
        """A `GraphReports` of the nodes of its namespace, kept up to date.

        Returns
        -------
        GraphReports
        """
        reports = GraphReports(self.get_namespace())
        self._subscribe_endpoints(reports.take)
        return reports

    def _subscribe_endpoints(self, call):
        return self.create_subscription(ENDPOINTS.message, ENDPOINTS.name, call, ENDPOINTS.qos,
                                        event_callbacks=NO_SUBSCRIPTION_EVENTS)

    # --- one graph in a namespace -----------------------------------------------------------

    def _look_for_duplicates(self):
        """Listen for a duplicate's identity while one exists: same node name or publisher."""
        own = self.get_name(), self.get_namespace()
        crowd = (any(self.count_publishers(topic) > 1 for topic in self._sole)
                 or self.get_node_names_and_namespaces().count(own) > 1)
        if crowd and self._watched is None:
            self._watched = self._subscribe_endpoints(self._on_status)
        elif not crowd and self._watched is not None:
            self.destroy_subscription(self._watched)
            self._watched = None

    def _on_status(self, message):
        for status in message.status:
            reason = earlier_duplicate(self._instance, self.get_fully_qualified_name(), self._sole,
                                   status)
            if reason:
                # topics such as /clock are in no namespace
                place = '' if reason.startswith(f'{CLOCK.name} ') else (
                    'namespace (-r __ns:=/NAME) or ')
                raise BadInput(f'{self.get_name()}: {reason}: end that graph, or start this one in '
                               f'another {place}ROS_DOMAIN_ID')

    def reject(self, source, reason):
        """Count an unusable message; the first ones are logged, repeated reasons once."""
        count, before = self.rejected.get(source, (0, ''))
        self.rejected[source] = (count + 1, reason)
        if count < 5 and reason != before:
            self.get_logger().warning(f'{source}: message refused: {reason}')

    # --- diagnostics ------------------------------------------------------------------------

    def problems(self):
        """Problems for the user, worst first, as (level, text); for subclasses."""
        return []

    def details(self):
        """Additional (key, value) rows of the diagnostics, 13 at most; for subclasses."""
        return []

    def reported(self):
        """Additional (key, value) rows for programs, next to the endpoints; for subclasses."""
        return []

    def waiting_for(self):
        """What this node still needs before it can work, list of str."""
        required = self.required()
        out = [f'a subscriber of {name}' for name, (pub, _) in self._publishers_of.items()
               if name in required and pub.get_subscription_count() == 0]
        if self.value(USE_SIM_TIME.name) and not self.publisher_count(CLOCK):
            out.append(f'a publisher of {CLOCK.name} (use_sim_time is true)')
        return out + [f'a publisher of {name}' for name, subs in self._subscriptions_of.items()
                      if name in required and subs[0][0].get_publisher_count() == 0]

    def incompatible(self):
        """Endpoints in the graph with which this node is not matched, list of str.

        Right after discovery a match may still be in progress: `_diagnose` reports only what is
        seen twice in a row.
        """
        out = []
        for name, (pub, _) in self._publishers_of.items():
            if pub.get_subscription_count() < self.count_subscribers(name):
                out.append(f'{name}: a subscriber with another type or QoS')
        for name, subs in self._subscriptions_of.items():
            if subs[0][0].get_publisher_count() < self.count_publishers(name):
                out.append(f'{name}: a publisher with another type or QoS')
        return out

    def required(self):
        """Full names of the topics that need a counterpart before the node can work."""
        return ()

    def endpoints(self):
        """Matched and counted endpoints as (key, value) rows, read by `msg_tools.readiness`."""
        # a new subscriber changes a row here, and so is informed at once
        rows = [(f'{PUBLISHES} {topic.name}', str(pub.get_subscription_count())) for topic, pub in
                ((DIAGNOSTICS, self._diagnostics), (ENDPOINTS, self._reports_of_endpoints))]
        for name, (pub, counter) in self._publishers_of.items():
            rows.append((f'{PUBLISHES} {name}', str(pub.get_subscription_count())))
            rows.append((f'{PUBLISHED} {name}', str(counter.count)))
        for name, subs in self._subscriptions_of.items():
            matched = max(s.get_publisher_count() for s, _ in subs)
            rows.append((f'{SUBSCRIBES} {name}', str(matched)))
            rows.append((f'received {name}', str(sum(c.count for _, c in subs))))
            rows.append((f'{LAST} {name}', str(max(c.last for _, c in subs))))
            rows.append((f'gaps {name}', str(sum(c.gaps for _, c in subs))))
        return rows

    def _diagnose(self):
        # at once when a connection was added or lost, or the counts settle; else once a second
        rows, matches = self.endpoints(), (PUBLISHES, SUBSCRIBES)
        connections = [row for row in rows if row[0].startswith(matches)]
        counts = [row for row in rows if not (  # those of the clock never settle
            row[0].startswith(matches) or row[0].endswith(f' {CLOCK.name}'))]
        self._rests = counts == self._last_counts
        self._last_counts = counts
        new = (connections != self._published_connections
               or (self._rests and counts != self._published_counts))
        if new or time.monotonic() - self._announced_at >= 1.0:
            self._published_connections, self._published_counts = connections, counts
            self.announce()

    def announce(self):
        """Publish the diagnostics, and the endpoints for programs, now."""
        from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
        rows = self.endpoints()
        elapsed = time.monotonic() - self._announced_at
        before = dict(self._announced or [])
        self._announced, self._announced_at = rows, time.monotonic()
        rates = [(f'rate {key.split(" ", 1)[1]} [Hz]',
                  f'{(int(value) - int(before.get(key, 0))) / elapsed:.1f}')
                 for key, value in rows if key.startswith((PUBLISHED, 'received'))]
        waiting = self.waiting_for()
        issues = list(self.problems())
        unmatched = self.incompatible()
        issues += [(DiagnosticStatus.ERROR, f'incompatible endpoint, nothing passes: {text}')
                   for text in unmatched if text in self._unmatched]
        for text in set(unmatched) & self._unmatched - self._warned:
            self.get_logger().error(f'incompatible endpoint, nothing passes: {text}')
        self._warned |= set(unmatched) & self._unmatched
        self._unmatched = set(unmatched)
        if waiting:
            issues.append((DiagnosticStatus.WARN, 'waiting for ' + ', '.join(waiting)))
        gaps = sum(int(value) for key, value in rows if key.startswith('gaps'))
        if gaps:
            issues.append((DiagnosticStatus.WARN, f'{gaps} messages lost'))
        refused = sum(count for count, _ in self.rejected.values())
        if refused:
            issues.append((DiagnosticStatus.WARN, f'{refused} messages refused'))
        details = [*self.details(), *(
            (f'messages {kind}', str(sum(int(n) for key, n in rows if key.startswith(kind))))
            for kind in (PUBLISHED, 'received'))]
        rows = [(INSTANCE, self._instance), (RESTS, str(self._rests)), *rows, *rates,
                *((f'refused {source}', f'{count} (last: {reason})')
                  for source, (count, reason) in self.rejected.items()), *self.reported()]
        stamp = self.get_clock().now().to_msg()
        for pub, values in (self._diagnostics, details), (self._reports_of_endpoints, rows):
            message = DIAGNOSTICS.message(status=[DiagnosticStatus(
                level=max((level for level, _ in issues), default=DiagnosticStatus.OK),
                name=self.get_fully_qualified_name(),
                message='; '.join(text for _, text in issues) or 'ok',
                hardware_id=self._hardware_id,
                values=[KeyValue(key=key, value=value) for key, value in values])])
            message.header.stamp = stamp
            pub.publish(message)

    # --- the end ----------------------------------------------------------------------------

    def finish(self):
        """Close files; called once at the end, when the ROS context may already be gone."""


#: key of a diagnostics row with the start of a node, ns, and text that makes it unique
INSTANCE = 'instance'


def new_instance(now=None):
    """A unique identity of a node that starts now, str."""
    start = time.time_ns() if now is None else now
    return f'{start} {socket.gethostname()} process {os.getpid()} {uuid.uuid4().hex[:8]}'


def _order(instance):
    """Sort key of instances by start, the same for every node; None for an invalid instance."""
    start, _, rest = instance.partition(' ')
    return (int(start), rest) if is_count(start) else None


def earlier_duplicate(own, name, topics, status):
    """Whether a status comes from a duplicate that was started before this node.

    Parameters
    ----------
    own : str
        Instance of this node.
    name : str
        Full name of this node.
    topics : iterable of str
        Full names of topics that only this node may publish.
    status : DiagnosticStatus
        Status of any node.

    Returns
    -------
    str
        What both are or publish, and the identity of the other; '' if it is no duplicate, or was
        started later.
    """
    rows = {row.key: row.value for row in status.values}
    other = rows.get(INSTANCE, '')
    if _order(other) is None or _order(other) >= _order(own):
        return ''
    common = [topic for topic in topics if f'publishes {topic}' in rows]
    if status.name != name and not common:
        return ''
    who = f'{status.name} ({other.partition(" ")[2].rpartition(" ")[0]})'
    if common:
        return f'{common[0]} is published by {who} already'
    return f'{who} is running already'
