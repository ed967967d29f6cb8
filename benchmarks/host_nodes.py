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

"""The part of a night that runs on one host: started there by `many_hosts.start`.

Reads one line of JSON: ``folder``, ``domain``, ``specs`` (name, module, parameters) and ``plan``.
With a plan it observes like `telescope-mount night` and prints its progress, one JSON list (state,
step, observations, message) per line, and at the end ``report`` or ``failed``. Without a plan it
runs the nodes until its input ends, then prints their exit codes.
"""

import json
import sys
from functools import partial
from pathlib import Path

from telescope_mount.graph import NodeSpec
from telescope_mount.processes import domain


def _say(*words):
    print(json.dumps(words), flush=True)


def _observe(folder, specs, asked):
    from telescope_mount.nights.night_files import write_results
    from telescope_mount.nights.whole_night import NightFailed, observe
    try:
        written = observe(
            folder, specs, asked['plan'], partial(write_results, folder),
            lambda step, done, total: _say('at', step, done, total), asked['domain'],
            claim=domain.join, stall=asked['stall'], hold_up=partial(_say, 'said'))
    except NightFailed as err:
        _say('failed', str(err))
    else:
        _say('report', written.report)


def main():
    """Run it."""
    asked = json.loads(sys.stdin.readline())
    folder = Path(asked['folder'])
    folder.mkdir(parents=True, exist_ok=True)
    specs = [NodeSpec(*spec) for spec in asked['specs']]
    if asked.get('plan'):
        _observe(folder, specs, asked)
        return
    from telescope_mount.processes.node_processes import Processes
    nodes = Processes(folder / 'nodes', asked['domain'])
    for spec in specs:
        nodes.start(spec)
    _say('started')
    sys.stdin.read()
    _say('ended', nodes.stop())


if __name__ == '__main__':
    main()
