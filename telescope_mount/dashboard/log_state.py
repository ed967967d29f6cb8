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

"""State from a log, at its end or at a given time."""

from collections import deque

from msg_tools import topics

from .graph_state import STARS, SUBSCRIBED, LastMessages, full_name


def log_messages(bag, namespace, end=None):
    """Last messages of a log at a time.

    Parameters
    ----------
    bag : BagReader or another that `open_bag` gives
    namespace : str
        Namespace of the graph.
    end : int, optional
        ns since 1970; by default the end of the log.

    Returns
    -------
    LastMessages

    Raises
    ------
    ValueError
        It has no topics of such a graph.
    """
    before = 2**63 - 1 if end is None else end + 1
    types = {full_name(namespace, topic): topic.type for topic in SUBSCRIBED}
    names = {full_name(namespace, topic): topic.name for topic in SUBSCRIBED}
    there = {topic.name for topic in bag.topics
             if topic.count and types.get(topic.name) == topic.type}
    if not there & {name for name in names if name.startswith(f'{namespace}/')}:
        raise ValueError(f'{bag.path} has no message of a graph in {namespace}: '
                         'name another with --namespace; `telescope-mount info` lists its topics')
    last = LastMessages(str(bag.path), namespace)
    # a log has its own time stamps
    wanted = [name for name in names if name in there and names[name] != topics.CLOCK.name]
    messages = bag.last_before(wanted, before)
    newest = {message.topic: message.log_time for message in messages}
    # rows up to the last complete table are contained in it
    table = newest.get(full_name(namespace, topics.OBSERVATIONS), bag.start_time)
    for topic, first in ((topics.OBSERVATION, table), (topics.DIAGNOSTICS, bag.start_time)):
        name = full_name(namespace, topic)  # for these the last one is not enough
        if name in newest:
            messages = [message for message in messages if message.topic != name]
            messages += _last(bag, name, first, newest[name])
    messages = [message for message in messages if message.type == types[message.topic]]
    for message in sorted(messages, key=lambda message: message.log_time):
        decoded = bag.decode(message)
        if decoded is not None:
            last.take(names[message.topic], decoded, message.log_time)
    return last


def _last(bag, name, first, newest):
    """The last `STARS` messages of a topic between two times, not decoded.

    Searches further back only if they are few.
    """
    span = 60 * 10**9
    while True:
        found = deque(bag.messages(name, max(newest - span, first), newest + 1), STARS)
        if len(found) == STARS or newest - span <= first:
            return found
        span *= 8
