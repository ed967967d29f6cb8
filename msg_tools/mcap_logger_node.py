"""The logger: everything on the topics, as received, into a rosbag2-layout MCAP folder."""

import copy
import sys

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.qos_overriding_options import QoSOverridingOptions

from . import topics
from .bag import BagWriter
from .node import NO_SUBSCRIPTION_EVENTS, Counter, MountNode, Param, run_node

#: a frame is rendered only for those who ask
NOT_BY_DEFAULT = (topics.ABSOLUTE_FRAME.name,)

PARAMS = (
    Param('folder', 'telescope_mount_log', 'folder of the log; it must not exist or be empty',
          fixed=True),
    Param('truth_folder', '', 'folder for truth/*; empty: beside the log, with _truth added',
          fixed=True),
    Param('topics', [''], 'what to record, by the names of the graph; empty: everything',
          fixed=True),
    Param('compression', 'zstd', 'of the chunks', choices=('zstd', 'lz4', 'none'), fixed=True),
    Param('flush_period_s', 1.0, 'wall time after which what came is safe on the disk [s]', 0.1,
          60.0, fixed=True),
)


class McapLogger(MountNode):
    """Records raw bytes; a log that is cut short stays readable up to the last flush."""

    def __init__(self, **kwargs):
        super().__init__('mcap_logger', PARAMS, hardware_id='log', **kwargs)
        wanted = [name for name in self.value('topics') if name]
        by_name = {topic.name: topic for topic in topics.ALL}
        unknown = [name for name in wanted if name not in by_name]
        if unknown:
            raise ValueError(f'mcap_logger: topics: {unknown[0]} is not a topic of the graph; '
                             f'it has {", ".join(by_name)}')
        chosen = [by_name[name] for name in wanted] if wanted else [
            topic for topic in topics.ALL if topic.name not in NOT_BY_DEFAULT]
        folder = self.value('folder')
        truth_folder = self.value('truth_folder') or folder.rstrip('/') + '_truth'
        self._error = None
        self._before_clock = []
        self._written = 0
        self._bag = BagWriter(folder, compression=self.value('compression'))
        # truth has a bag of its own, which fit and diagnose refuse
        truth = [topic for topic in chosen if topic.name.startswith(topics.TRUTH_PREFIX)]
        self._truth_bag = None
        if truth:
            self._truth_bag = BagWriter(truth_folder, compression=self.value('compression'))
        for topic in chosen:
            self._record(topic, self._truth_bag if topic in truth else self._bag)
        self.create_timer(self.value('flush_period_s'), self._flush,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _record(self, topic, bag):
        name = self.resolve_topic_name(topic.name)
        counter = Counter(topic.latched)
        bag.add_topic(name, topic.type, [topic.qos])

        def take(data, info):
            counter.received(info)
            self._take(bag, name, data, info)

        sub = self.create_subscription(
            topic.message, topic.name, take, copy.copy(topic.qos), raw=True,
            event_callbacks=NO_SUBSCRIPTION_EVENTS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
        if topic is not topics.DIAGNOSTICS:  # it never comes to rest, so its count says nothing
            self.keep_subscription(sub, counter)

    def _take(self, bag, name, data, info):
        now = self.get_clock().now().nanoseconds
        entry = (bag, name, data, info['source_timestamp'], info['publication_sequence_number'])
        if now <= 0:
            # under simulated time nothing has a time of reception before the first /clock
            self._before_clock.append(entry)
            return
        for earlier in self._before_clock:
            self._write(*earlier[:3], now, *earlier[3:])
        self._before_clock.clear()
        self._write(*entry[:3], now, *entry[3:])

    def _write(self, bag, name, data, log_time, publish_time, sequence):
        if self._error:
            return
        try:
            bag.write(name, data, log_time, max(0, publish_time), sequence or 0)
            self._written += 1
        except OSError as err:
            self._fail(err)

    def _flush(self):
        if self._error:
            return
        try:
            for bag in (self._bag, self._truth_bag):
                if bag is not None:
                    bag.refresh()
        except OSError as err:
            self._fail(err)

    def _fail(self, err):
        self._error = f'recording stopped: {err}'
        self.get_logger().error(f'{self._error}; what was written before is safe')

    def problems(self):
        """A disk that refused."""
        return [(DiagnosticStatus.ERROR, self._error)] if self._error else []

    def details(self):
        """Where the log is."""
        return [('folder', str(self._bag.folder)), ('messages written', str(self._written))]

    def finish(self):
        """Write index and metadata; needs no ROS."""
        for bag, name, data, publish_time, sequence in self._before_clock:
            # no /clock ever came: the source's time is the best there is
            self._write(bag, name, data, max(0, publish_time), publish_time, sequence)
        for bag in (self._bag, self._truth_bag):
            if bag is None:
                continue
            try:
                bag.close()
            except OSError as err:
                print(f'error: {bag.folder}: {err}', file=sys.stderr)


def main(args=None):
    """Entry point of ``ros2 run telescope_mount mcap_logger``."""
    sys.exit(run_node(McapLogger, args))


if __name__ == '__main__':
    main()
