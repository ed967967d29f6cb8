"""Logs in the layout of rosbag2: a folder with ``metadata.yaml`` and MCAP files.

Writing takes messages as the bytes that came from the wire, so a recorder never rebuilds them.
Reading needs no ROS and no index: what a crash left behind is read as far as it goes, and
`BagReader.problems` says how far that was.
"""

from .file import AttachmentInfo
from .reader import BagMessage, BagReader, Topic
from .ros_schema import message_definition, qos_dict, type_hash
from .writer import OWN_RECORD, REPEATED_RECORD, BagWriter

__all__ = [
    'OWN_RECORD', 'REPEATED_RECORD', 'AttachmentInfo', 'BagMessage', 'BagReader', 'BagWriter',
    'Topic', 'message_definition', 'qos_dict', 'type_hash',
]
