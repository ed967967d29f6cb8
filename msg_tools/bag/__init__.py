"""Logs in the layout of rosbag2: a folder with ``metadata.yaml`` and MCAP files.

Writing takes messages as the bytes that came from the wire, so a recorder never rebuilds them.
Reading needs no ROS and no index: what a crash left behind is read as far as it goes, and
`BagReader.problems` says how far that was.
"""

from .reader import BagReader
from .writer import OWN_RECORD, BagWriter

__all__ = ['OWN_RECORD', 'BagReader', 'BagWriter']
