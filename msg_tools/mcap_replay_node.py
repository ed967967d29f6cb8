"""The replay: publishes a log again, byte for byte, in its order."""

import sys
import time

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from . import topics
from .bag import BagReader
from .node import MountNode, Param, run_node
from .topics import Topic

#: what a replay makes anew: the clock, and what the nodes under test compute from the rest
NOT_BY_DEFAULT = (
    topics.CLOCK, topics.DIAGNOSTICS, topics.ZERO, topics.MODEL, topics.CALIBRATION_REPORT,
    topics.CALIBRATION_STATUS, topics.OBSERVER_STATUS, topics.DEMAND, topics.DEMAND_SIGMA,
)
#: messages after which a replay as fast as possible waits for the subscribers
BATCH = 500

PARAMS = (
    Param('bag', '', 'the log: a folder or an .mcap file', fixed=True),
    Param('topics', [''], 'full names of the topics to publish; empty: all but the clock and '
          'what the graph computes', fixed=True),
    Param('rate', 1.0, 'recorded seconds a second; 0: as fast as the subscribers take it', 0.0,
          1000.0, fixed=True),
    Param('wait_for_topics', [''], 'full names of topics that need a subscriber before the replay '
          'starts', fixed=True),
    Param('exit_at_end', True, 'end the node when the log has been published', fixed=True),
)


class McapReplay(MountNode):
    """Publishes the messages of a log and the clock that belongs to them."""

    def __init__(self, **kwargs):
        super().__init__('mcap_replay', PARAMS, hardware_id='log', **kwargs)
        if not self.value('bag'):
            raise ValueError('mcap_replay: parameter bag is empty; give a log with '
                             '-p bag:=FOLDER')
        self._reader = BagReader(self.value('bag'))
        for problem in self._reader.problems:
            self.get_logger().warning(f'{self.value("bag")}: {problem}')
        chosen = self._choose()
        self._rate = self.value('rate')
        self._replayed = {topic.name: self._publisher(topic) for topic in chosen}
        self._clock_pub = self.publisher(topics.CLOCK)
        self._messages = self._reader.messages(topics=[topic.name for topic in chosen])
        self._next = None
        self._sent = 0
        self._began = None
        self._state = 'waiting'
        self._timer = self.create_timer(
            0.02, self._wait, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _choose(self):
        there = {topic.name: topic for topic in self._reader.topics}
        wanted = [name for name in self.value('topics') if name]
        missing = [name for name in wanted if name not in there]
        if missing:
            raise ValueError(f'mcap_replay: {missing[0]} is not in {self.value("bag")}; it has '
                             f'{", ".join(there)}')
        if wanted:
            return [there[name] for name in wanted]
        left_out = {self.resolve_topic_name(topic.name) for topic in NOT_BY_DEFAULT}
        return [topic for name, topic in there.items() if name not in left_out]

    def _publisher(self, recorded):
        qos = recorded.qos[0] if recorded.qos else {}
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=max(int(qos.get('depth', 10)), 2 * BATCH),
            reliability=(ReliabilityPolicy.BEST_EFFORT
                         if qos.get('reliability') == 'best_effort'
                         else ReliabilityPolicy.RELIABLE),
            durability=(DurabilityPolicy.TRANSIENT_LOCAL
                        if qos.get('durability') == 'transient_local'
                        else DurabilityPolicy.VOLATILE))
        return self.publisher(Topic(recorded.name, recorded.type, profile))

    def waiting_for(self):
        """Subscribers without whom the replay does not start."""
        if self._state != 'waiting':
            return []
        return [f'a subscriber of {name}' for name in self.value('wait_for_topics') if name
                and (name not in self._replayed
                     or self._replayed[name].get_subscription_count() == 0)]

    def _wait(self):
        if self.waiting_for():
            return
        self._state = 'playing'
        self._timer.cancel()
        self._began = time.monotonic()
        period = 0.0 if self._rate == 0.0 else 0.001
        self._timer = self.create_timer(
            period, self._play, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _play(self):
        for _ in range(BATCH):
            if self._next is None:
                self._next = next(self._messages, None)
                if self._next is None:
                    self._end()
                    return
            message = self._next
            if self._rate > 0.0:
                due = (message.log_time - self._reader.start_time) * 1e-9 / self._rate
                if due > time.monotonic() - self._began:
                    return
            self._set_clock(message.log_time)
            self._replayed[message.topic].publish(message.data)
            self._sent += 1
            self._next = None
        if self._rate == 0.0:
            self._all_acknowledged()

    def _all_acknowledged(self):
        from rclpy.duration import Duration
        for pub in self._replayed.values():
            pub.wait_for_all_acked(Duration(seconds=30))

    def _set_clock(self, ns):
        from rosgraph_msgs.msg import Clock as ClockMessage

        from .convert import to_stamp
        self._clock_pub.publish(ClockMessage(clock=to_stamp(ns)))

    def _end(self):
        self._timer.cancel()
        self._all_acknowledged()
        self._state = 'done'
        self.get_logger().info(f'{self._sent} messages published')
        for problem in self._reader.problems:
            self.get_logger().warning(f'{self.value("bag")}: {problem}')
        self.announce()
        if self.value('exit_at_end'):
            rclpy.try_shutdown(context=self.context)

    def details(self):
        """How far the replay is."""
        return [('state', self._state), ('messages published', str(self._sent)),
                ('messages in the log', str(self._reader.message_count))]


def main(args=None):
    """Entry point of ``ros2 run telescope_mount mcap_replay``."""
    sys.exit(run_node(McapReplay, args))


if __name__ == '__main__':
    main()
