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

"""Speed ratios of earlier runs by processor, and which have become slower.

The ratio to a peer differs between processors by up to a quarter (numpy uses wide vectors, the peer
does not). So a run is compared with runs on the same kind of processor, and on a new kind with the
lowest ratio of all.
"""

import json
import platform
from pathlib import Path

#: a ratio that is slower by so much is a step back
SLOWER = 0.25


def processor():
    """Name of this machine's processor, and numpy's widest vectors on it."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
        name = next(line.split(':', 1)[1].strip() for line in lines
                    if line.startswith('model name'))
    except (OSError, StopIteration):
        pass
    import numpy as np
    found = np.show_config(mode='dicts').get('SIMD Extensions', {}).get('found', [])
    return ', '.join([name, *found[-1:]])


class History:
    """Ratios by processor.

    Parameters
    ----------
    path : Path
        JSON; what is not there yet is empty.
    """

    def __init__(self, path):
        self._path, self._here = path, processor()
        self._of = json.loads(path.read_text())['ratios'] if path.exists() else {}

    def ratio(self, key):
        """Reference ratio for a line; None if there is none."""
        known = [ratios[key] for ratios in self._of.values() if key in ratios]
        return self._of.get(self._here, {}).get(key, min(known, default=None))

    def slower(self, rows):
        """Keys of the rows (`race.Row`) whose ratio is below by more than a quarter."""
        return {row.key for row in rows if row.ratio is not None
                and row.ratio < (self.ratio(row.key) or 0.0) / (1.0 + SLOWER)}

    def record(self, rows):
        """Record the ratios to peers for this processor, without times against a limit."""
        here = self._of.setdefault(self._here, {})
        here |= {row.key: round(row.ratio, 3) for row in rows
                 if row.ratio is not None and not row.peer.startswith('limit')}
        self._of[self._here] = dict(sorted(here.items()))
        self._path.write_text(json.dumps({'ratios': self._of}, indent=1) + '\n')
