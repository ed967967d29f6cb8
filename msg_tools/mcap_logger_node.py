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

"""The logger: records all topics, as received, into an MCAP folder in the layout of rosbag2."""

import copy
import json
import time
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy._rclpy_pybind11 import RCLError
from rclpy.qos import DurabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from . import topics
from .bag import BagWriter
from .bag.bag_pair import BagPair
from .bag.compression import COMPRESSORS, DEFAULT_COMPRESSION
from .bag.parameter_query import ParameterCollector, as_text
from .bag.topic_selection import DEPTH, Selection, adapt_qos, check_patterns, versions
from .node import NO_SUBSCRIPTION_EVENTS, Counter, MountNode
from .params import Param
from .readiness import AWAITED
from .topics import Topic

#: frames are rendered only if somebody subscribes
NOT_BY_DEFAULT = (topics.ABSOLUTE_FRAME.name,)
#: parameters with the path of an output file: that is no provenance, and the name of a folder may
#: reveal what was simulated
PLACES = ('folder', 'truth_folder', 'diagnosis_page')
#: s between searches of the graph for new topics and publishers
DISCOVERY = 0.25
PARAMS = (
    Param('folder', 'telescope_mount_log', 'folder of the log; it must not exist or be empty',
          fixed=True),
    Param('truth_folder', '', 'folder for truth/*; empty: beside the log, with _truth added',
          fixed=True),
    Param('topics', [''], 'what to record, by the names of the graph or full names; empty, and '
          'no pattern: the whole graph but its frames', fixed=True),
    Param('patterns', [''], 'regular expressions; a topic whose full name matches one is recorded',
          check=check_patterns, fixed=True),
    Param('exclude', [''], 'regular expressions; a topic whose full name matches one is not',
          check=check_patterns, fixed=True),
    Param('all', False, 'record every topic there is, whenever it appears', fixed=True),
    Param('compression', DEFAULT_COMPRESSION, 'of the chunks', choices=tuple(COMPRESSORS),
          fixed=True),
    Param('flush_period_s', 0.5, 'wall time after which what came is safe on the disk [s]', 0.05,
          60.0, fixed=True),
    Param('max_file_mb', 0.0, 'size after which a new file is begun [MB]; 0: never', 0.0, 1e6,
          fixed=True),
    Param('max_file_s', 0.0, 'log time after which a new file is begun [s]; 0: never', 0.0, 1e7,
          fixed=True),
    Param('snapshot_mb', 0.0, 'keep so much in memory and write it only when ~/snapshot is called '
          '[MB]; 0: record all', 0.0, 4096.0, fixed=True),
    Param('provenance', True, 'ask all nodes for their parameters and put them into the log',
          fixed=True),
)


class McapLogger(MountNode):
    """Records raw bytes; an interrupted log remains readable up to the last flush."""

    # nobody waits for the logger, and a wake-up for one message costs as much as for many
    GATHER = 0.02

    def __init__(self, **kwargs):
        super().__init__('mcap_logger', PARAMS, hardware_id='log', **kwargs)
        self._known = {self.resolve_topic_name(topic.name): topic for topic in topics.ALL}
        self._selection = self._select()
        folder = self.value('folder')
        self._bags = BagPair(
            self._make_bag, folder, self.value('truth_folder') or folder.rstrip('/') + '_truth',
            self.get_logger(), round(self.value('snapshot_mb') * 1e6))
        self._recorded = {}  # full name -> (subscription, counter)
        self._refused, self._suspect, self._warned_gaps = set(), set(), {}
        self._model, self._attached = None, False
        for name, topic in self._known.items():
            if name in self._selection:
                self._record(name, topic.type, topic.qos, [topic.qos])
        self._collector = ParameterCollector(self, self._take_parameters)
        if self.value('provenance'):
            self._take_parameters(self.get_fully_qualified_name(), {
                name: as_text(self.value(name)) for name in self._params})
        self._make_services()
        self.every(self.value('flush_period_s'), self._bags.flush)
        self.every(DISCOVERY, self._discover)

    # --- what is recorded -------------------------------------------------------------------

    def _select(self):
        by_name = {topic.name: full for full, topic in self._known.items()}
        wanted = [name for name in self.value('topics') if name]
        unknown = [n for n in wanted if n not in by_name and not n.startswith('/')]
        if unknown:
            raise ValueError(f'mcap_logger: topics: {unknown[0]} is not a topic of the graph; '
                             f'it has {", ".join(by_name)}; other topics by their full names')
        patterns, exclude = ([p for p in self.value(name) if p] for name in ('patterns', 'exclude'))
        names = [by_name.get(name, name) for name in wanted]
        # whether topics that are not known yet may be selected
        self._waits = bool(self.value('all') or patterns or set(names) - set(self._known))
        if not names and not patterns and not self.value('all'):
            names = [full for name, full in by_name.items() if name not in NOT_BY_DEFAULT]
        return Selection(names, patterns, exclude, self.value('all'))

    def _make_bag(self, folder):
        return BagWriter(
            folder, compression=self.value('compression'), chunk_seconds=self.value(
                'flush_period_s'), max_bytes=round(self.value('max_file_mb') * 1e6),
            max_seconds=self.value('max_file_s'), metadata=versions())

    def _record(self, name, type_name, qos, offers, counter=None):
        """Subscribe to a topic; raises errors of the middleware or the bag."""
        latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        message = Topic(name, type_name, qos).message
        again = counter is not None
        counter = counter or Counter()
        # a subscriber needs the last message of a latched topic, a log all of them
        deep = copy.copy(qos)
        deep.depth = max(qos.depth, DEPTH)
        keep = name == self.resolve_topic_name(topics.MODEL.name)
        clock, take_message = self.get_clock(), self._bags.take

        def take(data, info):
            counter.received(info)
            if clock.ros_time_is_active:
                now = clock.now().nanoseconds
            else:
                now = info['received_timestamp'] or time.time_ns()
            if keep:
                self._model = data
            take_message(name, data, now, info['source_timestamp'],
                         info['publication_sequence_number'], latched)

        options = {} if again or name not in self._known else {
            'qos_overriding_options': QoSOverridingOptions.with_default_policies()}
        sub = self.create_subscription(
            message, name, take, deep, raw=True,
            event_callbacks=NO_SUBSCRIPTION_EVENTS, **options)
        counter.sequence.present = sub.get_publisher_count
        try:
            self._bags.add_topic(
                name, type_name, offers, self._type_hash(name, type_name))
        except (ValueError, OSError):
            self.destroy_subscription(sub)
            raise
        self._recorded[name] = sub, counter
        # their counts never settle, so they cannot show that a graph is at rest
        if name not in (topics.DIAGNOSTICS.name, topics.ENDPOINTS.name):
            self._subscriptions_of[name] = [(sub, counter)]

    def _type_hash(self, name, type_name):
        """Type hash from the publishers, or else the own subscription; None if neither has one."""
        infos = (*self.get_publishers_info_by_topic(name),
                 *self.get_subscriptions_info_by_topic(name))
        return next((str(info.topic_type_hash) for info in infos
                     if info.topic_type == type_name and info.topic_type_hash.version > 0), None)

    def _discover(self):
        """Find new topics, publishers that are not received, and parameters of new nodes."""
        if self._waits:
            for name, types in self.get_topic_names_and_types():
                if name not in self._recorded and name in self._selection:
                    self._appeared(name, types)
        for name, (sub, counter) in list(self._recorded.items()):
            if sub.get_publisher_count() < self.count_publishers(name):
                # a match may still be in progress: act only if it is seen twice
                if name in self._suspect:
                    self._adapt(name, sub, counter)
                self._suspect ^= {name}
            elif name in self._suspect:
                self._suspect.discard(name)
            self._warn_of_gaps(name, counter)
        if self.value('provenance') and not self._bags.error:
            before = self._collector.awaited
            self._collector.step()
            if before and not self._collector.awaited:
                self.announce()  # saves those who wait for a complete log up to a second

    def _appeared(self, name, types):
        offers = [info.qos_profile for info in self.get_publishers_info_by_topic(name)]
        if not offers or name in self._refused:
            return
        if len(types) > 1:
            self._refuse(name, f'it has {len(types)} types, {", ".join(types)}')
            return
        qos, warnings = adapt_qos(offers)
        try:
            self._record(name, types[0], qos, offers)
        except (ValueError, OSError, ImportError, AttributeError, RCLError) as err:
            self._refuse(name, str(err).split(', at /')[0])
            return
        self._warn(name, warnings)

    def _refuse(self, name, why):
        self._refused.add(name)
        self.get_logger().warning(f'{name} is not recorded: {why}')

    def _warn(self, name, warnings):
        for text in warnings:
            self.get_logger().warning(f'{name}: {text}')

    def _adapt(self, name, sub, counter):
        """Subscribe again if a publisher offers less than this subscription requests."""
        infos = self.get_publishers_info_by_topic(name)
        own = self._known[name].type if name in self._known else None
        other = {info.topic_type for info in infos} - {own} if own else set()
        if other:
            if name not in self._refused:
                self._refuse(name, f'a publisher sends it as {", ".join(other)}')
            return
        offers = [info.qos_profile for info in infos]
        if not offers:
            return
        qos, warnings = adapt_qos(offers)
        before = self._warned_gaps.get(f'qos {name}')
        if before == (qos.reliability, qos.durability):
            return
        self._warned_gaps[f'qos {name}'] = qos.reliability, qos.durability
        type_name = infos[0].topic_type
        self.destroy_subscription(sub)
        try:
            self._record(name, type_name, qos, offers, counter)
        except (ValueError, OSError, RCLError) as err:
            del self._recorded[name]
            self._refuse(name, str(err).split(', at /')[0])
            return
        self._warn(name, [f'subscribed anew, {qos.reliability.name.lower()} and '
                          f'{qos.durability.name.lower()}, as its publishers offer', *warnings])

    def _warn_of_gaps(self, name, counter):
        lost = counter.gaps
        if lost > self._warned_gaps.get(name, 0):
            self.get_logger().warning(
                f'{name}: {lost} messages lost so far, of {counter.sequence.publishers} publishers')
        self._warned_gaps[name] = lost

    # --- services ---------------------------------------------------------------------------

    def _make_services(self):
        bags = self._bags
        for call, once in ((bags.pause, False), (bags.resume, False),
                           (bags.is_paused, False), (bags.split_bagfile, True),
                           (bags.snapshot, True)):
            self.serve(f'~/{call.__name__}', call, once)

    # --- provenance -------------------------------------------------------------------------

    def _take_parameters(self, node, values, truth=()):
        values = {key: as_text(Path(json.loads(text)).name) if key in PLACES else text
                  for key, text in values.items()}
        self._bags.add_parameters(node, values, truth)
        # a file that a node was given belongs to its parameters
        text = json.loads(values.get('model_file', '""'))
        if not text or self._attached or not Path(text).is_file():
            return
        try:
            data = Path(text).read_bytes()
        except OSError:
            return
        self._attached = True
        self._bags.attach('reference_model.json', 'application/octet-stream', data)

    def problems(self):
        """Disk errors, and topics that cannot be recorded."""
        out = [(DiagnosticStatus.ERROR, error)] if (error := self._bags.error) else []
        return out + [(DiagnosticStatus.WARN, f'{name} is not recorded')
                      for name in sorted(self._refused)]

    def details(self):
        """Folder, file and state of the log."""
        bags = self._bags
        return [('folder', Path(bags.bag.folder).name), ('file', bags.bag.file.name),
                ('messages written', str(bags.written)), ('state', bags.state)]

    def reported(self):
        """Number of nodes whose parameters are awaited, and lost messages by topic."""
        return [(AWAITED, str(len(self._collector.awaited))), *(
            (f'lost {name}', f'{counter.gaps} of {counter.sequence.publishers} publishers')
            for name, (_, counter) in self._recorded.items() if counter.gaps)]

    def finish(self):
        """Write index and metadata; needs no ROS. Raises OSError if the log is incomplete."""
        model = ()
        if self._model is not None:
            size = int.from_bytes(self._model[4:8], 'little')
            model = (('model.json', 'application/json', self._model[8:7 + size]),)
        self._bags.close(*model)
