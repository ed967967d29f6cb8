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

"""Parameters of the logger."""

from .bag.compression import COMPRESSORS, DEFAULT_COMPRESSION
from .bag.topic_selection import check_patterns
from .params import Param

PARAMS = (
    Param('folder', 'telescope_mount_log', 'folder of the log; it must not exist or be empty',
          fixed=True),
    Param('truth_folder', '', 'folder for truth/*; empty: beside the log, with _truth added',
          fixed=True),
    Param('topics', [''], 'what to record, by the names of the graph or full names; empty, and '
          'no pattern: the whole graph but its frames', fixed=True),
    Param('patterns', [''], 'regular expressions; a topic whose full name matches one is recorded',
          check=check_patterns, fixed=True),
    Param('exclude', [''], 'regular expressions; a topic whose full name matches one is not',
          check=check_patterns, fixed=True),
    Param('all', False, 'record every topic there is, whenever it appears', fixed=True),
    Param('compression', DEFAULT_COMPRESSION, 'of the chunks', choices=tuple(COMPRESSORS),
          fixed=True),
    Param('flush_period_s', 0.5, 'wall time after which what came is safe on the disk [s]', 0.05,
          60.0, fixed=True),
    Param('max_file_mb', 0.0, 'size after which a new file is begun [MB]; 0: never', 0.0, 1e6,
          fixed=True),
    Param('max_file_s', 0.0, 'log time after which a new file is begun [s]; 0: never', 0.0, 1e7,
          fixed=True),
    Param('snapshot_mb', 0.0, 'keep so much in memory and write it only when ~/snapshot is called '
          '[MB]; 0: record all', 0.0, 4096.0, fixed=True),
    Param('provenance', True, 'ask all nodes for their parameters and put them into the log',
          fixed=True),
)
