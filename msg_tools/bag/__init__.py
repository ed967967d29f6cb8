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

"""Logs in the layout of rosbag2: a folder with ``metadata.yaml`` and MCAP files.

Writing takes messages as serialized bytes, so a recorder never decodes them. Reading needs no ROS
and no index: after a crash a log is read as far as possible, and `BagReader.problems` says how far
that was.
"""

from .reader import BagReader
from .writer import OWN_RECORD, BagWriter

__all__ = ['OWN_RECORD', 'BagReader', 'BagWriter']
