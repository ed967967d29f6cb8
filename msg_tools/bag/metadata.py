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

"""The file ``metadata.yaml`` of a bag, version 9 of rosbag2."""

import os
from pathlib import PurePath
from typing import NamedTuple

import yaml

from ..whole_files import write_text
from .chunks import NEVER
from .compression import PACKED_FILE
from .ros_schema import MAX_NESTING, Loader, dump_yaml

METADATA_VERSION = 9
METADATA_FILE = 'metadata.yaml'
#: largest plausible size of a metadata file
MAX_SIZE = 4 * 2**20


def _span(first, last, count):
    return {'starting_time': {'nanoseconds_since_epoch': first if count else NEVER},
            'duration': {'nanoseconds': last - first if count else 0}}


def is_truth(topic):
    """Whether a topic belongs to the simulator's truth, by its name; calibration must refuse it."""
    return '/truth/' in '/' + topic


def information(topics, files, custom_data):
    """The contents of metadata.yaml: rosbag2 calls them the bag file information.

    Parameters
    ----------
    topics : list of (name, type, qos, type hash, count)
    files : list of (file name, first log time, last log time, count)
        Times in ns.
    custom_data : dict of str to str

    Returns
    -------
    dict
        In the order of rosbag2.
    """
    filled = [row for row in files if row[3]]
    first = min((row[1] for row in filled), default=NEVER)
    last = max((row[2] for row in filled), default=0)
    count = sum(row[3] for row in files)
    span = _span(first, last, count)
    return {
        'version': METADATA_VERSION,
        'storage_identifier': 'mcap',
        'duration': span['duration'],
        'starting_time': span['starting_time'],
        'message_count': count,
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': name,
                    'type': type_name,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': qos,
                    'type_description_hash': hash_,
                },
                'message_count': number,
            }
            for name, type_name, qos, hash_, number in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [row[0] for row in files],
        'files': [{'path': name, **_span(begin, end, number), 'message_count': number}
                  for name, begin, end, number in files],
        'custom_data': custom_data or None,
        'ros_distro': os.environ.get('ROS_DISTRO', 'jazzy'),
    }


def write_metadata(folder, info):
    """Write metadata.yaml atomically and sync it to the disk."""
    write_text(folder / METADATA_FILE, dump_yaml({'rosbag2_bagfile_information': info}))
    sync_folder(folder)


def sync_folder(folder):
    """Sync the names of new files to the disk."""
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


class Listed(NamedTuple):
    """What ``metadata.yaml`` says about a file of the bag; NEVER and 0 if it says nothing."""

    count: int = 0
    start: int = NEVER
    end: int = 0


NOTHING = Listed()


def listed_files(folder):
    """The files that metadata.yaml lists, by name without folder, and what it says about them.

    Returns
    -------
    files : dict of str to Listed
    problem : str
        Empty if there is none.
    """
    path = folder / METADATA_FILE
    try:
        if path.stat().st_size > MAX_SIZE:
            return {}, f'{METADATA_FILE} has more than {MAX_SIZE} bytes'
        root = next(iter(_tree(yaml.parse(path.read_text(encoding='utf-8'), Loader=Loader))), None)
    except FileNotFoundError:
        return {}, f'{METADATA_FILE} is missing'
    except (yaml.YAMLError, ValueError) as error:
        return {}, f'{METADATA_FILE} is damaged ({" ".join(str(error).split())[:120]})'
    info = _entry(root, 'rosbag2_bagfile_information')
    # before version 4 the paths had the folder in front
    files = {PurePath(name).name.removesuffix(PACKED_FILE): Listed()
             for name in _entry(info, 'relative_file_paths', list) if isinstance(name, str)}
    for row in _entry(info, 'files', list):
        name, entry = _entry(row, 'path', str).removesuffix(PACKED_FILE), _listed(row)
        if name in files and entry is not None:
            files[name] = entry
    if len(files) == 1 and NOTHING in files.values():  # before version 5 only the bag has counts
        files = dict.fromkeys(files, _listed(info) or NOTHING)
    return files, '' if files else f'{METADATA_FILE} lists no file'


def _listed(row):
    """`Listed` of a row of ``files``; None if a number is invalid."""
    try:
        start = int(_entry(_entry(row, 'starting_time'), 'nanoseconds_since_epoch', str))
        span = int(_entry(_entry(row, 'duration'), 'nanoseconds', str))
        return Listed(int(_entry(row, 'message_count', str)), start, start + span)
    except ValueError:
        return None


def _entry(tree, key, kind=dict):
    """Value of `key`, if it has the given type; otherwise an empty one."""
    value = tree.get(key) if isinstance(tree, dict) else None
    return value if isinstance(value, kind) else kind()


def _tree(events, depth=0):
    """YAML events as lists of dicts, lists and str: safe against deep nesting and foreign types."""
    if depth > MAX_NESTING:
        raise ValueError('nested too deep')
    values = []
    for event in events:
        if isinstance(event, yaml.CollectionEndEvent):
            break
        if isinstance(event, yaml.SequenceStartEvent):
            values.append(_tree(events, depth + 1))
        elif isinstance(event, yaml.MappingStartEvent):
            pairs = _tree(events, depth + 1)
            keys = (key if isinstance(key, str) else '' for key in pairs[::2])
            values.append(dict(zip(keys, pairs[1::2])))
        elif isinstance(event, (yaml.ScalarEvent, yaml.AliasEvent)):
            values.append(getattr(event, 'value', ''))
    return values
