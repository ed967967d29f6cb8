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

"""The replay: publishes the messages of a log again, unchanged and in their order."""

import re
import time

import rclpy
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from . import topics
from .bag.ros_schema import qos_dict
from .bag.sqlite import open_bag
from .bag.topic_names import prefixes_of
from .bag.topic_selection import check_patterns
from .convert import to_stamp
from .node import MountNode, Param
from .topics import Topic, make_qos

#: number of messages after which a replay at full speed waits for the subscribers
BATCH = 500
#: s before a message is due from which the replay only waits for it
NEAR = 0.0012
#: s after which subscribers without diagnostics count as foreign: only DDS acknowledgements show
#: what they have received, and they lose messages if their queue is shorter than the batch
FOREIGN = 1.5
#: s between checks of services and parameters while nothing is due
IDLE = 0.02
#: s for which subscribers must be known and matched before the replay begins, since they would miss
#: its start; and the same if there are none, or some cannot be matched
SETTLED, ALONE = 0.3, 1.0


def _check_remaps(values):
    for value in values:
        old, mark, new = value.partition(':=')
        if value and not (mark and old.startswith('/') and re.fullmatch(r'(/[A-Za-z]\w*)+', new)):
            raise ValueError(f'{value!r}: write /old/name:=/new/name')


PARAMS = (
    Param('bag', '', 'the log: a folder, an .mcap or a .db3 file', fixed=True),
    Param('topics', [''], 'full names of the topics to publish; empty: all but the clock, '
          'what the graph computes, and what would move a mount (command, request)', fixed=True),
    Param('exclude', [''], 'regular expressions; a topic whose full name matches one is left out',
          check=check_patterns, fixed=True),
    Param('remaps', [''], 'new names of topics, as /old/name:=/new/name', check=_check_remaps,
          fixed=True),
    Param('rate', 1.0, 'recorded seconds a second; 0: as fast as the subscribers take it', 0.0,
          1000.0),
    Param('start_offset_s', 0.0, 'recorded time to leave out at the start [s]', 0.0, 1e9,
          fixed=True),
    Param('duration_s', 0.0, 'recorded time to play [s]; 0: to the end', 0.0, 1e9, fixed=True),
    Param('loop', False, 'begin again at the end'),
    Param('start_paused', False, 'wait for ~/resume or ~/play_next', fixed=True),
    Param('seek_s', 0.0, 'recorded time since the start to go on at [s]; setting it, or ~/seek, '
          'goes there', 0.0, 1e9),
    Param('burst_count', 10, 'messages that ~/burst publishes at once', 1, 1_000_000),
    Param('clock_hz', 0.0, 'publish /clock so often in recorded time [Hz]; 0: with every message',
          0.0, 10000.0, fixed=True),
    Param('wait_for_topics', [''], 'full names of topics that need a subscriber before the replay '
          'starts', fixed=True),
    Param('exit_at_end', True, 'end the node when the log has been published', fixed=True),
)


class McapReplay(MountNode):
    """Publishes the messages of a log and the corresponding clock."""

    def __init__(self, **kwargs):
        super().__init__('mcap_replay', PARAMS, hardware_id='log', **kwargs)
        if not self.value('bag'):
            raise ValueError('mcap_replay: parameter bag is empty; give a log with '
                             '-p bag:=FOLDER')
        self._reader = open_bag(self.value('bag'))
        for problem in self._reader.problems:
            self.get_logger().warning(f'{self.value("bag")}: {problem}')
        chosen = self._choose()
        offset = self.value('start_offset_s')
        self._begin = (self._reader.start_time or 0) + round(offset * 1e9)
        if offset and self._begin > (self._reader.end_time or 0):
            length = ((self._reader.end_time or 0) - (self._reader.start_time or 0)) * 1e-9
            raise ValueError(f'mcap_replay: start_offset_s {offset:g} is after the end of the log, '
                             f'which has {length:.1f} s')
        duration = round(self.value('duration_s') * 1e9)
        self._stop = self._begin + duration if duration else 2**63 - 1
        remaps = dict(r.split(':=') for r in self.value('remaps') if r)
        self._replayed = {topic.name: self._publisher(topic, remaps.get(topic.name, topic.name))
                          for topic in chosen}
        self._latched = [topic.name for topic in chosen if topic.latched]
        # most messages in flight: a subscriber's queue is assumed as deep as its publisher's here
        self._most = {topic.name: _depth(topic) // 2 for topic in chosen
                      if not topic.latched}
        self._under_way = dict.fromkeys(self._most, 0)
        self._clock_pub = self.publisher(topics.CLOCK)
        self._clock_step = round(1e9 / self.value('clock_hz')) if self.value('clock_hz') else 0
        self._reports = self.graph_reports()
        self._sent = self._loops = 0
        self._paused = self.value('start_paused')
        self._state, self._subscribers = 'waiting', ((0, 0), time.monotonic())
        self._go_to(self._begin)
        self._make_services()
        self._timer = self.every(IDLE, self._wait)

    # --- topics -----------------------------------------------------------------------------

    def _choose(self):
        there = {topic.name: topic for topic in self._reader.topics if topic.type}
        wanted = [name for name in self.value('topics') if name]
        missing = [name for name in wanted if name not in there]
        if missing:
            raise ValueError(f'mcap_replay: {missing[0]} is not in {self.value("bag")}; it has '
                             f'{", ".join(there)}')
        left_out = {self.resolve_topic_name(topic.name) for topic in topics.NOT_REPLAYED} | {
            f'{prefix}{topic.name}' for topic in topics.NOT_REPLAYED
            for prefix in prefixes_of(self._reader)}
        exclude = [re.compile(pattern) for pattern in self.value('exclude') if pattern]
        names = wanted or [name for name in there if name not in left_out]
        chosen = [there[n] for n in names if not any(e.fullmatch(n) for e in exclude)]
        return [_offered(topic) for topic in chosen
                if self._installed(topic, topic.name in wanted)]

    def _installed(self, topic, required):
        try:
            return Topic(topic.name, topic.type, None).message is not None
        except (ImportError, AttributeError, ValueError):
            text = f'{topic.name}: {topic.type} is not installed'
            if required:
                raise ValueError(f'mcap_replay: {text}') from None
            self.get_logger().warning(f'{text}; not replayed')
            return False

    def _publisher(self, recorded, name):
        depth = _depth(recorded)
        return self.publisher(Topic(name, recorded.type, make_qos(
            depth if recorded.latched else max(depth, 2 * BATCH), latched=recorded.latched,
            reliable=not recorded.qos or recorded.qos[0]['reliability'] != 'best_effort')))

    def waiting_for(self):
        """Subscribers that are needed before the replay starts."""
        if self._state != 'waiting':
            return []
        return [f'a subscriber of {name}' for name in self.value('wait_for_topics') if name
                and (name not in self._replayed
                     or self._replayed[name].get_subscription_count() == 0)]

    # --- time -------------------------------------------------------------------------------

    def _go_to(self, ns):
        """Continue at the first message at or after `ns`, with the latched ones of that time."""
        self._messages = self._reader.messages(
            topics=list(self._replayed), start=ns, end=self._stop)
        self._next = None
        self._earlier = self._reader.last_before(self._latched, ns) if self._latched else []
        self._clock_sent = None
        self._position = ns
        self._anchor(ns)

    def _anchor(self, ns):
        """Let recorded time `ns` correspond to now."""
        self._anchored = time.monotonic(), ns

    def _now(self):
        """Current recorded time, by the rate."""
        wall, ns = self._anchored
        return ns + int((time.monotonic() - wall) * self.value('rate') * 1e9)

    def parameters_changed(self, names):
        """Apply a new rate from now on, or go to a new position."""
        if 'rate' in names and self._state == 'playing':
            self._anchor(self._position)
        if 'seek_s' in names:
            self._seek()

    def _seek(self):
        self._go_to((self._reader.start_time or 0) + round(self.value('seek_s') * 1e9))
        if self._state == 'done':
            self._resume_playing()
        return True, f'at {self.value("seek_s"):g} s'

    # --- playing ----------------------------------------------------------------------------

    def _wait(self):
        if self._discovered() and not self.waiting_for():
            self._resume_playing()

    def _discovered(self):
        """Whether all subscribers have been discovered."""
        pubs = self._replayed.values()
        known = sum(self.count_subscribers(pub.topic_name) for pub in pubs)
        now = known, sum(pub.get_subscription_count() for pub in pubs)
        before, since = self._subscribers
        if now != before:
            since = time.monotonic()
        self._subscribers = now, since
        return time.monotonic() - since > (SETTLED if 0 < known <= now[1] else ALONE)

    def _resume_playing(self):
        self._state = 'playing'
        self._timer.cancel()
        self.destroy_timer(self._timer)
        self._anchor(self._position)
        self._since = time.monotonic()
        self._timer = self.every(0.001, self._play)

    def _play(self):
        rate = self.value('rate')
        if self._paused:
            self._anchor(self._position)
            self._sleep(IDLE)
            return
        for _ in range(BATCH):
            message = self._peek()
            if message is None:
                self._at_end()
                return
            if rate > 0.0:
                wall, ns = self._anchored
                left = wall + (message.log_time - ns) * 1e-9 / rate - time.monotonic()
                if left > NEAR:
                    if self._clock_step:
                        self._tick(self._now())
                        left = min(left, NEAR + self._clock_step * 1e-9 / rate)
                    self._sleep(left - NEAR)
                    return
                if left > 0.0:
                    time.sleep(left)  # at most NEAR: a timer would be less accurate
            elif not self._taken(message.topic):
                self._sleep(0.001)
                return
            self._publish(message)
        self._sleep(0.0)

    def _sleep(self, seconds):
        """Look again after at most so many seconds."""
        period = int(min(max(seconds, 1e-5), IDLE) * 1e9)
        if self._timer.timer_period_ns != period:
            self._timer.timer_period_ns = period
        self._timer.reset()

    def _peek(self):
        """The next message, or None at the end."""
        if self._next is None:
            if self._earlier:
                # sent before this time, but still valid: it is published now
                self._next = self._earlier.pop(0)._replace(log_time=self._anchored[1])
            else:
                self._next = next(self._messages, None)
        return self._next

    def _publish(self, message):
        self._tick(message.log_time)
        self._replayed[message.topic].publish(message.data)
        if message.topic in self._under_way:
            self._under_way[message.topic] += 1
        self._position = message.log_time
        self._sent += 1
        self._next = None

    def _tick(self, ns):
        """Publish /clock if it is due."""
        if self._clock_sent is None or ns - self._clock_sent >= self._clock_step:
            self._clock_sent = ns
            self._clock_pub.publish(Clock(clock=to_stamp(ns)))

    # --- back-pressure ----------------------------------------------------------------------

    def _taken(self, topic):
        """Whether every subscriber's queue has room for another message on `topic`."""
        if sum(self._under_way.values()) < BATCH and (
                self._under_way.get(topic, 0) < max(1, self._most.get(topic, BATCH))):
            return True
        for name, count in self._under_way.items():
            if count and not self._has_all(name):
                return False
        self._under_way = dict.fromkeys(self._under_way, 0)
        return True

    def _has_all(self, name):
        """Whether DDS has acknowledged all messages, and nodes that report have taken them."""
        pub = self._replayed[name]
        if not pub.wait_for_all_acked(Duration(seconds=0.05)):
            return False
        topic, (_, counter) = pub.topic_name, self._publishers_of[pub.topic_name]
        last = [report['last'][topic] for report in self._reports.values()
                if report['subscribes'].get(topic)]  # of the matched subscribers
        if len(last) < pub.get_subscription_count() and (
                time.monotonic() - self._since < FOREIGN):
            return False  # some have not reported yet
        return all(number >= counter.count for number in last)

    # --- the end ----------------------------------------------------------------------------

    def _at_end(self):
        if self.value('loop') and self._sent:
            self._loops += 1
            self._go_to(self._begin)
            self._sleep(0.0)
            return
        self._end()

    def _end(self):
        self._timer.cancel()
        for pub in self._replayed.values():
            pub.wait_for_all_acked(Duration(seconds=30))
        self._state = 'done'
        self.get_logger().info(f'{self._sent} messages published')
        _, at_start = self._subscribers[0]
        if self._sent and not at_start and not any(
                pub.get_subscription_count() for pub in self._replayed.values()):
            self.get_logger().warning('nobody subscribes to what was published')
        for problem in self._reader.problems:
            self.get_logger().warning(f'{self.value("bag")}: {problem}')
        self.announce()
        if self.value('exit_at_end'):
            rclpy.try_shutdown(context=self.context)

    # --- services ---------------------------------------------------------------------------

    def _make_services(self):
        for name, call in (
                ('pause', lambda: self._set_paused(True)),
                ('resume', lambda: self._set_paused(False)),
                ('toggle_paused', lambda: self._set_paused(not self._paused)),
                ('is_paused', lambda: (self._paused, 'paused' if self._paused else self._state)),
                ('get_rate', lambda: (True, repr(self.value('rate')))),
                ('play_next', lambda: self._play_some(1)),
                ('burst', lambda: self._play_some(self.value('burst_count'))),
                ('seek', self._seek), ('stop', self._on_stop)):
            self.serve(f'~/{name}', call)

    def _set_paused(self, paused):
        if self._state == 'playing' and not paused and self._paused:
            self._anchor(self._position)
            self._sleep(0.0)
        self._paused = paused
        return True, 'paused' if paused else self._state

    def _play_some(self, count):
        if not self._paused or self._state != 'playing':
            return False, f'only while paused (~/pause); the replay is {self._state}'
        for number in range(count):
            message = self._peek()
            if message is None:
                return number > 0, f'{number} messages published; the log ends here'
            self._publish(message)
        return True, f'{count} messages published'

    def _on_stop(self):
        if self._state == 'done':
            return False, 'the replay is done'
        self._end()
        return True, f'stopped after {self._sent} messages'

    def details(self):
        """Progress of the replay."""
        return [('state', self._state), ('messages published', str(self._sent)),
                ('messages in the log', str(self._reader.message_count)),
                ('paused', str(self._paused)), ('times from the start again', str(self._loops))]


def _offered(topic):
    """A `LogTopic`; one of a log that has no QoS as the graph has it."""
    known = [one for one in topics.ALL
             if topic.name.endswith(f'/{one.name}') and topic.type == one.type]
    return topic if topic.qos or not known else topic._replace(qos=[qos_dict(known[0].qos)])


def _depth(topic):
    return min(max(topic.qos[0]['depth'] if topic.qos else 10, 1), 100_000)
