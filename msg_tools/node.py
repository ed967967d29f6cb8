"""What every node of the graph shares: parameters, diagnostics, counted messages, a clean end."""

import copy
import signal
import sys
import time

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.time_source import TimeSource
from std_srvs.srv import Trigger

from . import NAMESPACE
from .executor import NodeExecutor
from .gaps import SequenceGaps
from .params import BadInput, Param
from .readiness import LAST, PUBLISHED, PUBLISHES, SUBSCRIBES, GraphReports
from .topics import CLOCK, DIAGNOSTICS

__all__ = ['BadInput', 'Counter', 'MountNode', 'NO_PUBLISHER_EVENTS', 'NO_SUBSCRIPTION_EVENTS',
           'Param', 'run_node']

# Each event handler is one more entity that the executor looks at for every message: they took
# half of a node's time. Incompatible endpoints are found once a second in the graph instead.
NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)


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


class MountNode(Node):
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

    def __init__(self, name, params=(), *, hardware_id='', context=None, overrides=None,
                 namespace=NAMESPACE):
        given = [Parameter(key, value=value) for key, value in (overrides or {}).items()]
        super().__init__(name, context=context, namespace=namespace, parameter_overrides=given,
                         start_parameter_services=True, enable_rosout=True)
        self._params = {}
        self._publishers_of = {}
        self._subscriptions_of = {}
        self.rejected = {}
        # unique: two mounts may be on one graph
        self._hardware_id = f'{self.get_fully_qualified_name()}: {hardware_id or name}'
        self._announced = None
        self._announced_at = 0.0
        self._last_counts, self._told = None, (None, None)
        self._unmatched, self._warned = set(), set()
        self.declare(params)
        unknown = [key for key in self._parameter_overrides
                   if not self.has_parameter(key) and not key.startswith('qos_overrides.')]
        if unknown:
            import difflib
            close = difflib.get_close_matches(unknown[0], list(self._params), 1)
            hint = f'did you mean {close[0]}?' if close else f'it has {", ".join(self._params)}'
            raise BadInput(f'{name}: unknown parameter {unknown[0]}; {hint}')
        try:
            self.check_together({key: self.value(key) for key in self._params})
        except ValueError as err:
            raise BadInput(f'{name}: {err}') from None
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._apply)
        self._diagnostics = self.create_publisher(
            DIAGNOSTICS.message, DIAGNOSTICS.name, DIAGNOSTICS.qos,
            event_callbacks=NO_PUBLISHER_EVENTS)
        # diagnostics go on while simulated time stands still
        self.every(0.1, self._diagnose)

    # --- parameters -------------------------------------------------------------------------

    def declare(self, params):
        """Declare `params`; BadInput where a start-up value is refused."""
        for param in params:
            try:
                value = self.declare_parameter(
                    param.name, param.default, param.descriptor()).value
            except InvalidParameterValueException:
                given = self._parameter_overrides[param.name].value
                raise BadInput(f'{self.get_name()}: {param.name} = {given}: '
                               f'must be {param.low} to {param.high}') from None
            except InvalidParameterTypeException:
                given = self._parameter_overrides[param.name].value
                kind = type(param.default).__name__
                if kind == 'float' and isinstance(given, int):
                    kind += f', write {given}.0'
                raise BadInput(
                    f'{self.get_name()}: {param.name} = {given!r}: must be a {kind}') from None
            reason = param.refuse(value)
            if reason:
                raise BadInput(f'{self.get_name()}: {reason}')
            self._params[param.name] = param

    def check_overrides(self):
        """BadInput where a QoS override fits no endpoint; all endpoints must have been made."""
        for key in self._parameter_overrides:
            if not self.has_parameter(key):
                raise BadInput(f'{self.get_name()}: {key} fits no topic and policy of this node; '
                               f'see ros2 param list {self.get_fully_qualified_name()}')

    def value(self, name):
        """The value of parameter `name`."""
        return self.get_parameter(name).value

    def _validate(self, parameters):
        for parameter in parameters:
            known = self._params.get(parameter.name)
            reason = known.refuse(parameter.value) if known else None
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        try:
            self.check_together({name: self.value(name) for name in self._params}
                                | {p.name: p.value for p in parameters})
        except ValueError as err:
            return SetParametersResult(successful=False, reason=str(err))
        return SetParametersResult(successful=True)

    def check_together(self, values):
        """Raise ValueError where parameter values do not go together; for subclasses."""

    def _apply(self, parameters):
        names = {p.name for p in parameters} & set(self._params)
        if names:
            self.parameters_changed(names)

    def parameters_changed(self, names):
        """Called after `names` have new, valid values."""

    # --- topics -----------------------------------------------------------------------------

    def publisher(self, topic):
        """A publisher on `topic`, counted, with QoS overrides by parameter."""
        # rclpy writes overrides into the profile that it is given; topics share theirs
        pub = self.create_publisher(
            topic.message, topic.name, copy.copy(topic.qos), event_callbacks=NO_PUBLISHER_EVENTS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
        counter = Counter()
        self._publishers_of[pub.topic_name] = (pub, counter)
        publish = pub.publish

        def counted(message):
            counter.count += 1
            publish(message)

        pub.publish = counted
        return pub

    def subscribe(self, topic, callback):
        """A subscription on `topic`; a message that `callback` cannot use is counted, not fatal.

        `callback(message)` raises ValueError for a bad message.
        """
        counter = Counter(topic.latched)

        def guarded(message, info):
            counter.received(info)
            try:
                callback(message)
            except ValueError as err:
                self.reject(topic.name, str(err))

        sub = self.create_subscription(
            topic.message, topic.name, guarded, copy.copy(topic.qos),
            event_callbacks=NO_SUBSCRIPTION_EVENTS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
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

    def serve(self, name, call):
        """A Trigger service; `call()` returns whether it was done, and a sentence."""
        def answer(_, response):
            response.success, response.message = call()
            return response
        self.create_service(Trigger, name, answer)

    def graph_reports(self):
        """What the nodes of the graph report of themselves: a `GraphReports`, kept up to date."""
        reports = GraphReports()
        self.create_subscription(DIAGNOSTICS.message, DIAGNOSTICS.name, reports.take,
                                 DIAGNOSTICS.qos, event_callbacks=NO_SUBSCRIPTION_EVENTS)
        return reports

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
        """Further (key, value) rows of the diagnostics; for subclasses."""
        return []

    def waiting_for(self):
        """What this node still needs before it can work, as a list of str."""
        out = [f'a subscriber of {name}' for name, (pub, _) in self._publishers_of.items()
               if name in self.required() and pub.get_subscription_count() == 0]
        return out + [f'a publisher of {name}' for name, subs in self._subscriptions_of.items()
                      if name in self.required() and subs[0][0].get_publisher_count() == 0]

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
        # whoever begins to listen to the diagnostics changes this row, and so is told at once
        rows = [(f'{PUBLISHES} {DIAGNOSTICS.name}',
                 str(self._diagnostics.get_subscription_count()))]
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
        rows = self.endpoints()
        connections = [row for row in rows if row[0].startswith((PUBLISHES, SUBSCRIBES))]
        # at once when a connection came or went, or messages have come to rest; the clock never
        # does; else once a second
        counts = [row for row in rows if row not in connections and CLOCK.name not in row[0]]
        quiet = counts == self._last_counts
        self._last_counts = counts
        new = connections != self._told[0] or (quiet and counts != self._told[1])
        if new or time.monotonic() - self._announced_at >= 1.0:
            self._told = connections, counts
            self.announce(rows)

    def announce(self, rows=None):
        """Publish the diagnostics now."""
        from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
        rows = self.endpoints() if rows is None else rows
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
        status = DiagnosticStatus(
            level=max((level for level, _ in issues), default=DiagnosticStatus.OK),
            name=self.get_fully_qualified_name(),
            message='; '.join(text for _, text in issues) or 'ok',
            hardware_id=self._hardware_id)
        rows = rows + rates + [(f'refused {source}', f'{count} (last: {reason})')
                               for source, (count, reason) in self.rejected.items()]
        status.values = [KeyValue(key=k, value=v) for k, v in [*rows, *self.details()]]
        message = DIAGNOSTICS.message(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    # --- the end ----------------------------------------------------------------------------

    def finish(self):
        """Close files; called once at the end, when the ROS context may already be gone."""


def run_node(make_node, args=None):
    """Run a node until Ctrl-C, SIGTERM or shutdown.

    Parameters
    ----------
    make_node : callable
        Returns the node; raises ValueError or OSError with one line for bad input.

    Returns
    -------
    int
        Exit code: 0 after a clean end, 2 after bad input.
    """
    node = executor = None
    running = False
    # KeyboardInterrupt could fall into the middle of a record of the log; rclpy shuts the
    # context down at either signal, and that ends `spin`
    signal.signal(signal.SIGINT, lambda *_: None)
    try:
        rclpy.init(args=args)
        running = True
        node = make_node()
        node.check_overrides()
        executor = NodeExecutor()
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ValueError, OSError) as err:
        print(f'error: {err}', file=sys.stderr)
        return 2
    except RCLError as err:
        if running and not rclpy.ok():
            return 0  # a signal came while something was being made or published
        # of rcl's own text only the first sentence is for the user
        print(f'error: {str(err).splitlines()[0].split(", at /")[0]}', file=sys.stderr)
        return 2
    except RuntimeError as err:
        if 'QoS override' not in str(err):
            raise
        print(f'error: {err}', file=sys.stderr)
        return 2
    finally:
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.finish()
            node.destroy_node()
        rclpy.try_shutdown()
        # a second signal would find rclpy's handlers gone and end the process hard
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    return 0
