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

"""Determines from `/endpoints` whether all nodes of a graph are connected and the log is complete.

Discovery between processes takes from 0.3 s to several seconds, and one side of a connection
may see it before the other; messages sent in between are lost. So each node publishes on
`/endpoints` how many endpoints it is matched with, and programs that start work compare these.
"""

import time

# first words of row keys, before the topic name: `MountNode.endpoints` writes, `parse` reads them
PUBLISHES, SUBSCRIBES = 'publishes', 'subscribes'  # endpoints matched
PUBLISHED, LAST = 'published', 'last'  # messages, the last one's sequence number
#: key of the row that says that all counts have settled; when a count changes and settles again,
#: a node reports it within `REST` s
RESTS, REST = 'rests', 0.35
#: key of a node's message while its level is ERROR or higher
ERRORS = 'errors'
#: row of the logger: number of nodes whose parameters are still awaited
AWAITED = 'awaited'

#: DiagnosticStatus.ERROR, which comes with ROS
_ERROR = b'\x02'
#: beginnings of names of nodes that subscribe to `command` but drive nothing
_HEARERS = ('mcap_logger', 'rosbag2_', 'star_observer', 'check_drivers', '_ros2cli', 'foxglove_',
            'rqt')


#: most digits of a count: Python refuses to convert some thousands of digits
_DIGITS = 19


def is_count(text):
    """Whether the value of a row is a valid count."""
    return len(text) <= _DIGITS and text.isdecimal()


def drives(node):
    """Whether a node that subscribes to `command` may be the driver of a mount, by its name."""
    return not node.startswith(_HEARERS)


class GraphReports(dict):
    """Latest reports of the nodes of a graph: node name -> result of `parse`.

    Parameters
    ----------
    namespace : str
        Namespace of the graph; reports of other nodes are ignored.

    Attributes
    ----------
    received : dict of str to float
        Node name -> time of reception, by `time.monotonic`.
    """

    def __init__(self, namespace):
        super().__init__()
        self._within = namespace.rstrip('/') + '/'
        self.received = {}

    def take(self, message):
        """Keep the reports in a DiagnosticArray."""
        for status in message.status:
            if status.name.startswith(self._within):
                self[status.name] = parse(status)
                self.received[status.name] = time.monotonic()

    def silent(self, seconds):
        """Nodes (names relative to the namespace) whose last report is older than that."""
        now = time.monotonic()
        return [name.removeprefix(self._within) for name, at in self.received.items()
                if now - at > seconds]

    def errors_of(self, node):
        """Errors in the last report of a node (name relative to the namespace), '' for none."""
        return self.get(self._within + node, {}).get(ERRORS, '')


def parse(status):
    """The endpoint counts in a DiagnosticStatus of a `MountNode`.

    Returns
    -------
    dict
        ``{PUBLISHES: {topic: matched}, SUBSCRIBES: ..., PUBLISHED: {topic: messages},
        LAST: {topic: sequence number}, RESTS: bool, AWAITED: nodes, ERRORS: text}``.
    """
    out = {PUBLISHES: {}, SUBSCRIBES: {}, PUBLISHED: {}, LAST: {}, RESTS: False, AWAITED: 0,
           ERRORS: status.message if status.level >= _ERROR else ''}
    for row in status.values:
        if row.key == RESTS:
            out[RESTS] = row.value == 'True'
            continue
        if row.key == AWAITED:
            out[AWAITED] = int(row.value) if is_count(row.value) else 0
            continue
        kind, _, topic = row.key.partition(' ')
        # other publishers of diagnostics may use such keys for something else
        if isinstance(out.get(kind), dict) and topic.startswith('/') and is_count(row.value):
            out[kind][topic] = int(row.value)
    return out


def unmatched(nodes, reports):
    """What is missing until all endpoints of `nodes` are connected on both sides.

    Parameters
    ----------
    nodes : iterable of str
        Fully qualified names of the required nodes.
    reports : dict of str to dict
        Node name -> result of `parse`.

    Returns
    -------
    list of str
        Empty when the graph is complete.
    """
    nodes = list(nodes)
    missing = [f'node {name}' for name in nodes if name not in reports]
    there = [name for name in nodes if name in reports]
    for name in there:
        for own, others, what in ((PUBLISHES, SUBSCRIBES, 'subscribers'),
                                  (SUBSCRIBES, PUBLISHES, 'publishers')):
            for topic, matched in reports[name][own].items():
                expected = sum(topic in reports[other][others] for other in there)
                if matched < expected:
                    missing.append(f'{name} to see {expected - matched} more {what} of {topic}')
    return missing


def unreceived(receiver, reports, then):
    """Messages that the nodes had published at `then` and `receiver` has not taken yet.

    Counts of received messages would be wrong: a receiver that was matched late has fewer.
    Sequence numbers count from the publisher's first message.

    Parameters
    ----------
    receiver : str
        Node name.
    reports, then : dict of str to dict
        Node name -> result of `parse`, now and at the reference time.

    Returns
    -------
    dict of str to int
        Topic -> number of missing messages; without topics that `receiver` does not subscribe
        to.
    """
    last = reports[receiver][LAST]
    sent = {}
    for name, report in then.items():
        if name != receiver:
            for topic, count in report[PUBLISHED].items():
                sent[topic] = max(sent.get(topic, 0), count)
    return {topic: count - last[topic] for topic, count in sent.items()
            if topic in last and count > last[topic]}
