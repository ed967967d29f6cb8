"""The file ``metadata.yaml`` of a bag, version 9 of rosbag2."""

import os
from pathlib import PurePath

import yaml

from .chunks import NEVER
from .ros_schema import Loader, dump_yaml

METADATA_VERSION = 9
METADATA_FILE = 'metadata.yaml'
#: a file larger than this is no metadata of a bag
MAX_SIZE = 4 * 2**20


def _span(first, last, count):
    return {'starting_time': {'nanoseconds_since_epoch': first if count else NEVER},
            'duration': {'nanoseconds': last - first if count else 0}}


def is_truth(topic):
    """Whether a topic is of the simulator's truth, by its name; calibration must refuse it."""
    return '/truth/' in '/' + topic


def information(topics, files, custom_data):
    """What rosbag2 calls the bag file information.

    Parameters
    ----------
    topics : list of (name, type, qos, type hash, count)
    files : list of (file name, first log time, last log time, count)
        Times in ns.
    custom_data : dict of str to str

    Returns
    -------
    dict
        In the order in which rosbag2 writes it.
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
    """Put metadata.yaml in place in one step, on the disk."""
    temporary = folder / f'.{METADATA_FILE}.tmp'
    with open(temporary, 'w', encoding='utf-8') as stream:
        stream.write(dump_yaml({'rosbag2_bagfile_information': info}))
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(temporary, folder / METADATA_FILE)
    sync_folder(folder)


def sync_folder(folder):
    """Put the names of new files on the disk."""
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def listed_files(folder):
    """Names of the files that metadata.yaml lists, without any folder in front.

    Returns
    -------
    names : list of str
    problem : str
        Empty if all is well.
    """
    path = folder / METADATA_FILE
    try:
        if path.stat().st_size > MAX_SIZE:
            return [], f'{METADATA_FILE} has more than {MAX_SIZE} bytes'
        paths = _paths(yaml.parse(path.read_text(encoding='utf-8'), Loader=Loader))
    except FileNotFoundError:
        return [], f'{METADATA_FILE} is missing'
    except (yaml.YAMLError, ValueError) as error:
        return [], f'{METADATA_FILE} is damaged ({" ".join(str(error).split())[:120]})'
    if not paths:
        return [], f'{METADATA_FILE} lists no file'
    # before version 4 the paths had the folder in front
    return [PurePath(path).name for path in paths], ''


def _paths(events):
    """The scalars of ``relative_file_paths``, from YAML events: foreign nesting cannot hurt."""
    depth, found = 0, None
    for event in events:
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > 20:
                raise ValueError('nested too deep')
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
            if found is not None:
                return found
        elif isinstance(event, yaml.ScalarEvent):
            if found is not None and depth == 3:
                found.append(event.value)
            elif depth == 2 and event.value == 'relative_file_paths':
                found = []
    return found
