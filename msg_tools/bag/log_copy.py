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

"""A whole log of what can be read from another, which may be damaged."""

from collections import Counter
from pathlib import Path

from .file import attachment_data
from .sqlite import open_bag
from .writer import OWN_RECORD, REPEATED_RECORD, STOPPED_RECORD, BagWriter, plain_name


def recover_log(bag, out=None):
    """Write everything that can be read of a log into a new one, with index and metadata.

    Parameters
    ----------
    bag : str or Path
        A folder, an ``.mcap`` or a ``.db3`` file; it is only read.
    out : str or Path, optional
        Folder of the new log, which must not exist or must be empty; default ``<bag>_recovered``.

    Returns
    -------
    dict
        ``out`` (Path), ``messages``, ``topics``, ``attachments``: contents of the new log;
        ``whole``: whether nothing is lost; ``messages_lost``, with ``missing`` and ``recorded`` by
        topic; ``all_known``: whether these are all lost messages; ``parts``: damaged parts of the
        files, with bytes, times (ns) and messages; ``lost_bytes``; ``lost``: a line for each
        problem of the log and for everything that could not be saved.

    Raises
    ------
    ValueError
        Nothing can be read, or `out` is not empty or lies in the log.
    OSError
        The log is not readable, or `out` cannot be written.
    """
    bag = Path(bag)
    out = Path(out) if out is not None else bag.with_name(f'{bag.stem}_recovered')
    if bag.is_dir() and bag.resolve() in (out.resolve(), *out.resolve().parents):
        raise ValueError(f'{out} lies in the log itself; choose another folder with --out')
    reader = open_bag(bag)
    # records that the new log writes itself, or that describe the old files
    own = ('rosbag2', OWN_RECORD, REPEATED_RECORD, STOPPED_RECORD)
    notes = []
    with BagWriter(out, metadata=reader.metadata.get(OWN_RECORD)) as new:
        topics = [topic for topic in reader.topics if _add_topic(reader, new, topic, notes)]
        for name, data in reader.metadata.items():
            if name not in own:
                new.add_metadata(name, data)
        types = {topic.name: topic.type for topic in topics}
        saved = Counter()
        for message in reader.messages(list(types)):
            # a log cannot hold later times
            if message.type == types[message.topic] and message.log_time < 2**63:
                saved[message.topic] += 1
                new.write(message.topic, message.data, message.log_time,
                          min(message.publish_time, 2**63 - 1), message.sequence)
        attachments = [info.name for info in reader.attachments
                       if _add_attachment(new, info, notes)]
        count = new.message_count
    recorded, others, known = reader.recorded()
    missing = {topic: recorded[topic] - saved[topic] for topic in sorted(recorded)
               if topic and recorded[topic] > saved[topic]}
    lost = sum(missing.values()) + recorded[''] + others
    return {'out': out, 'messages': count, 'topics': len(topics), 'attachments': attachments,
            'whole': known and not lost and not notes, 'messages_lost': lost,
            'missing': missing, 'recorded': dict(sorted(recorded.items())), 'all_known': known,
            'parts': [{'file': file.name, 'offset': part.offset, 'bytes': part.length,
                       'why': part.why, 'start_ns': part.start, 'end_ns': part.end,
                       'messages': part.counts, 'all_known': part.known}
                      for file, part in reader.lost],
            'lost_bytes': sum(part.length for _, part in reader.lost),
            'lost': reader.problems + notes}


def _add_topic(reader, new, topic, notes):
    schema, encoding = reader.schema_of(topic.name, topic.type)
    if encoding != 'cdr':
        notes.append(f'{topic.name}: no messages of ROS 2, left out')
        return False
    try:
        new.add_foreign_topic(topic.name, topic.type, topic.qos, schema.data, topic.type_hash,
                              schema.encoding)
    except ValueError as error:
        notes.append(f'{error}: {topic.count} messages left out')
        return False
    return True


def _add_attachment(new, info, notes):
    try:
        plain_name(info.name)
        new.add_attachment(info.name, info.media_type, attachment_data(info))
    except ValueError as error:
        notes.append(f'{error}; left out')
        return False
    return True
