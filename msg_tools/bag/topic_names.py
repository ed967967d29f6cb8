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

"""Names of the topics of the graph in a log, whatever namespace it was recorded in."""

from .. import topics


def prefixes_of(log):
    """Namespaces of a log with observations, as ``/mount/``; those with messages if there are any.

    Parameters
    ----------
    log : BagReader or SqliteReader

    Returns
    -------
    list of str

    Raises
    ------
    ValueError
        Their messages are not encoded as those of ROS 2.
    """
    for of in (topics.OBSERVATION, topics.OBSERVATIONS):
        there = [topic for topic in log.topics
                 if topic.name.endswith(f'/{of.name}') and topic.type == of.type]
        filled = [topic for topic in there if topic.count]
        for topic in filled:
            encoding = log.schema_of(topic.name, topic.type)[1]
            if encoding not in ('cdr', ''):
                raise ValueError(f'{log.path}: the messages of {topic.name} are encoded as '
                                 f'{encoding}; only those of ROS 2 (cdr) can be read: convert them')
        if there:
            return sorted({topic.name[:-len(of.name)] for topic in filled or there})
    return []


def prefix_of(log):
    """Namespace of the observations of a log, as ``/mount/``; ``/`` without one.

    Parameters
    ----------
    log : BagReader or SqliteReader

    Returns
    -------
    str

    Raises
    ------
    ValueError
        It has no observations, those of several mounts, or the simulator's truth.
    """
    if log.has_truth:
        raise ValueError(f'{log.path} holds the truth of the simulator; give the log beside it')
    found = prefixes_of(log)
    if not found:
        raise ValueError(f'{log.path} has no topic observation; it is no log of a night')
    if len(found) > 1:
        raise ValueError(
            f'{log.path} has observations of {len(found)} mounts, '
            f'{" and ".join(f"{name}{topics.OBSERVATION.name}" for name in found)}; record each in '
            'a separate log (exclude of mcap_logger, or ros2 bag convert)')
    return found[0]
