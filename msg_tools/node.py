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

"""What every node of the graph shares: parameters, diagnostics, counted messages, a clean end."""

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

# Each event handler is one more entity that the executor looks at for every message: they took
# half of a node's time. Incompatible endpoints are found once a second in the graph instead.
NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
#: what a message that cannot be used raises: of JSON an infinite number, or a thousand brackets,
#: are no ValueError
UNUSABLE = ValueError, ArithmeticError, RecursionError
#: s between two looks whether a node is alone in its place
DUPLICATES = 0.25


@lru_cache(64)
def message_of(data, kind):
    """The message of class `kind` that bytes are; ValueError says why they are none.

    rclpy, asked for messages, skips such bytes without a word. One that several nodes of a process
    take is made once.
    """
    try:
        return deserialize_message(data, kind)
    except Exception as err:
        reason = [*str(err).splitlines(), type(err).__name__][0]
        raise ValueError(f'no {kind.__name__}: {reason}') from None


class Counter:
    """Messages of one endpoint: how many, the last sequence number, how many were lost.

    Parameters
    ----------
    latched : bool
        A latched topic keeps the last message only: that earlier ones are skipped is no loss.
    """

    def __init__(self, latched=False):
        self.count = 0
        self.last = 0
        self.sequence = SequenceGaps(latched)

    @property
    def gaps(self):
        """Messages lost."""
        return self.sequence.gaps

    def received(self, info):
        """Count a message; a jump in a publisher's sequence number is a loss."""
        self.count += 1
        number = info.get('publication_sequence_number')
        if number is not None:
            self.last = number
            self.sequence.add(number)


class CountedPublisher(Publisher):
    """A publisher that counts, and tells the executor of its process what need not be waited for.

    Attributes
    ----------
    counter : Counter
    """

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.counter, self._full_name = Counter(), self.topic_name

    def publish(self, msg):
        """As rclpy's."""
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
        Its parameters, declared with range and unit; an override of an unknown one is refused.
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

    #: s for which what comes may wait for more, see `NodeExecutor`
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
        # diagnostics go on while simulated time stands still
        self.every(0.1, self._diagnose)
        self.every(DUPLICATES, self._look_for_duplicates)

    # --- topics -----------------------------------------------------------------------------

    def publisher(self, topic):
        """A publisher on `topic`, counted, with QoS overrides by parameter."""
        # rclpy writes overrides into the profile that it is given; topics share theirs
        pub = self.create_publisher(
            topic.message, topic.name, copy.copy(topic.qos), event_callbacks=NO_PUBLISHER_EVENTS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            publisher_class=CountedPublisher)
        self._publishers_of[pub.topic_name] = pub, pub.counter
        if not topic.many:
            self._sole.append(pub.topic_name)
        return pub

    def publisher_count(self, topic):
        """How many publishers a `Topic` has."""
        return self.count_publishers(self.resolve_topic_name(topic.name))

    def publisher_names(self, topic):
        """Nodes that publish a `Topic`, list of str, and how many have no name yet."""
        infos = self.get_publishers_info_by_topic(self.resolve_topic_name(topic.name))
        # right after its discovery the name of a node is not known
        names = [f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos
                 if 'UNKNOWN' not in info.node_name]
        return names, len(infos) - len(names)

    def subscribe(self, topic, callback, after=None):
        """A subscription on `topic`; a message that `callback` cannot use is counted, not fatal.

        `callback(message)` raises ValueError for a bad message. `after()` is called when the
        messages that were ready have been taken: what costs as much for many as for one waits for
        it.
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
        """As rclpy's; but a `/clock` below zero, which ended the node, is refused."""
        if isinstance(getattr(callback, '__self__', None), TimeSource):
            take = callback

            def callback(message):
                if message.clock.sec < 0:
                    self.reject(CLOCK.name, f'a clock below zero: {message.clock.sec} s')
                else:
                    take(message)
        return super().create_subscription(msg_type, topic, callback, *args, **kwargs)

    def every(self, seconds, call):
        """A timer of wall time, that is steady, whatever the time of the graph is."""
        return self.create_timer(seconds, call, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def create_service(self, srv_type, *args, **kwargs):
        """As rclpy's; a question of ours that is asked again is not done again."""
        service = super().create_service(srv_type, *args, **kwargs)
        if srv_type is Trigger:
            setattr(service, ANSWERS, Answers())
        return service

    def serve(self, name, call, once=False):
        """A Trigger service; `call()`, or what it awaits, is whether it was done, and a sentence.

        With `once` a question that is asked again, as its answer was lost, is not done again;
        without it what stops something is done whenever it is requested.
        """
        def answer(_, response):
            response.success, response.message = call()
            return response

        async def answer_later(_, response):
            response.success, response.message = await call()
            return response
        # one that awaits leaves the node's group to the others, and answers whoever asks meanwhile
        service = self.create_service(Trigger, name, answer_later, callback_group=(
            ReentrantCallbackGroup())) if iscoroutinefunction(call) else (
                self.create_service(Trigger, name, answer))
        if not once:
            delattr(service, ANSWERS)

    def graph_reports(self):
        """What the nodes of its namespace report of themselves: a `GraphReports`, kept up to date.

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
        """While another is, or publishes, what this node does, listen who it is."""
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
        """Count a message that could not be used; in the log the first times, each reason once."""
        count, before = self.rejected.get(source, (0, ''))
        self.rejected[source] = (count + 1, reason)
        if count < 5 and reason != before:
            self.get_logger().warning(f'{source}: message refused: {reason}')

    # --- diagnostics ------------------------------------------------------------------------

    def problems(self):
        """Sentences that a user should see, worst first, as (level, text); for subclasses."""
        return []

    def details(self):
        """Further (key, value) rows of the diagnostics, 13 at most; for subclasses."""
        return []

    def reported(self):
        """Further (key, value) rows for programs, beside the endpoints; for subclasses."""
        return []

    def waiting_for(self):
        """What this node still needs before it can work, as a list of str."""
        required = self.required()
        out = [f'a subscriber of {name}' for name, (pub, _) in self._publishers_of.items()
               if name in required and pub.get_subscription_count() == 0]
        if self.value(USE_SIM_TIME.name) and not self.publisher_count(CLOCK):
            out.append(f'a publisher of {CLOCK.name} (use_sim_time is true)')
        return out + [f'a publisher of {name}' for name, subs in self._subscriptions_of.items()
                      if name in required and subs[0][0].get_publisher_count() == 0]

    def incompatible(self):
        """Endpoints that the graph knows and this node is not matched with, as a list of str.

        Right after discovery a match may still be under way: `_diagnose` asks for what is seen
        twice in a row.
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
        """Full names of the topics without whose other side the node cannot work."""
        return ()

    def endpoints(self):
        """Matched and counted endpoints as (key, value) rows; `msg_tools.readiness` reads them."""
        # whoever begins to listen to these changes its row, and so is told at once
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
        # at once when a connection came or went, or messages have come to rest; else once a second
        rows, matches = self.endpoints(), (PUBLISHES, SUBSCRIBES)
        connections = [row for row in rows if row[0].startswith(matches)]
        counts = [row for row in rows if not (  # those of the clock never rest
            row[0].startswith(matches) or row[0].endswith(f' {CLOCK.name}'))]
        self._rests = counts == self._last_counts
        self._last_counts = counts
        new = (connections != self._published_connections
               or (self._rests and counts != self._published_counts))
        if new or time.monotonic() - self._announced_at >= 1.0:
            self._published_connections, self._published_counts = connections, counts
            self.announce()

    def announce(self):
        """Publish the diagnostics, and beside them the endpoints for programs, now."""
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


#: key of a row of diagnostics: when a node was started, ns, and what tells it from all others
INSTANCE = 'instance'


def new_instance(now=None):
    """What distinguishes a node that starts now from all others, str."""
    start = time.time_ns() if now is None else now
    return f'{start} {socket.gethostname()} process {os.getpid()} {uuid.uuid4().hex[:8]}'


def _order(instance):
    """Instances in the order in which they were started, whoever compares; None for no such."""
    start, _, rest = instance.partition(' ')
    return (int(start), rest) if is_count(start) else None


def earlier_duplicate(own, name, topics, status):
    """Whether a status is that of a node before which another has to go.

    Parameters
    ----------
    own : str
        Instance of the node that asks.
    name : str
        Its full name.
    topics : iterable of str
        Full names of what it alone may publish.
    status : DiagnosticStatus
        Of any node.

    Returns
    -------
    str
        What both are or publish, and who the other is; '' where it is none, or was started later.
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
