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

"""Are all the nodes of a graph connected, and has the log everything? Read from `/endpoints`.

Discovery between processes takes from 0.3 s to several seconds, and one side of a connection
may see it before the other; a message sent in between is lost. So each node says on
`/endpoints` how many endpoints it is matched with, and whoever starts the work compares.
"""

import time

# first words of the rows, before the topic's name: `MountNode.endpoints` writes, `parse` reads
PUBLISHES, SUBSCRIBES = 'publishes', 'subscribes'  # endpoints matched
PUBLISHED, LAST = 'published', 'last'  # messages, the last one's sequence number
#: a row for itself: since it came to rest nothing came or went; when that changes, and it comes to
#: rest again, a node says so within so many seconds
RESTS, REST = 'rests', 0.35
#: what a node says of itself while its level is an error or worse
ERRORS = 'errors'
#: a row of the logger: nodes whose parameters are to come yet
AWAITED = 'awaited'

#: DiagnosticStatus.ERROR, which comes with ROS
_ERROR = b'\x02'
#: first letters of nodes that hear `command` and drive nothing
_HEARERS = ('mcap_logger', 'rosbag2_', 'star_observer', 'check_drivers', '_ros2cli', 'foxglove_',
            'rqt')


#: digits of a count, at most: Python refuses to read some thousands of them
_DIGITS = 19


def is_count(text):
    """Whether the value of a row is a whole number that a counter can have."""
    return len(text) <= _DIGITS and text.isdecimal()


def drives(node):
    """Whether a node that subscribes to `command` may be the driver of a mount, by its name."""
    return not node.startswith(_HEARERS)


class GraphReports(dict):
    """What the nodes of a graph last reported of themselves: node name -> what `parse` returned.

    Parameters
    ----------
    namespace : str
        Of the graph; what others report is left alone.

    Attributes
    ----------
    received : dict of str to float
        Node name -> when, by `time.monotonic`.
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
        """Nodes, by their own names, that have not reported for so long and did so before."""
        now = time.monotonic()
        return [name.removeprefix(self._within) for name, at in self.received.items()
                if now - at > seconds]

    def errors_of(self, node):
        """What a node of the graph, by its own name, reported last as errors, '' for nothing."""
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
        # whoever else publishes diagnostics may use such keys for something else
        if isinstance(out.get(kind), dict) and topic.startswith('/') and is_count(row.value):
            out[kind][topic] = int(row.value)
    return out


def unmatched(nodes, reports):
    """What is missing until every endpoint of `nodes` is connected on both sides.

    Parameters
    ----------
    nodes : iterable of str
        Fully qualified names that must be there.
    reports : dict of str to dict
        Node name to what `parse` returned.

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
    """Messages that the nodes had published `then` and `receiver` has not taken yet.

    Counts of received messages would not do: a receiver that was matched late has fewer.
    Sequence numbers count from the publisher's first message.

    Parameters
    ----------
    receiver : str
        Node name.
    reports, then : dict of str to dict
        Node name to what `parse` returned, now and at the time that counts.

    Returns
    -------
    dict of str to int
        Topic to the number still missing; topics that `receiver` does not subscribe are left
        out.
    """
    last = reports[receiver][LAST]
    sent = {}
    for name, report in then.items():
        if name != receiver:
            for topic, count in report[PUBLISHED].items():
                sent[topic] = max(sent.get(topic, 0), count)
    return {topic: count - last[topic] for topic, count in sent.items()
            if topic in last and count > last[topic]}
