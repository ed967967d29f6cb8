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

"""Processes killed (SIGKILL) and restarted during a plan: what is lost, what is repeated?

    python benchmarks/interrupted.py             # three moments
    python benchmarks/interrupted.py --full      # every pointing, the observer and the whole graph

Observer, guard, calibration and corrector are processes, the drivers are in this process, in real
time. After a given number of observations and a random delay, the observer alone or all four are
killed and restarted with the same parameters.
"""

import argparse
import os
import signal
import tempfile
import threading
from collections import Counter
from pathlib import Path

import numpy as np
from live_mount import GUARD, Night

from msg_tools import topics
from pointing_model.runs.run_messages import cloud_to_run
from telescope_mount.graph import real_graph
from telescope_mount.observing.plan import parse_plan

PLAN = 'home, stars 5, fit, check 2'
TOTAL = sum(step.exposures for step in parse_plan(PLAN))
NAMES = ('mount_guard', 'star_observer', 'pointing_corrector', 'calibration')


def run(after, whole, seed):
    """One night, interrupted after `after` observations.

    Returns
    -------
    dict
        ``state``, ``lost``, ``doubled`` pointings, ``commands`` and those ``beyond`` the limits,
        and where the observer said that it went on.
    """
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        specs = [spec for spec in real_graph(bag='', plan=PLAN,
                                             state_file=str(Path(folder) / 'state'))
                 if spec.name in NAMES]
        for spec in specs:
            if spec.name == 'mount_guard':
                spec.parameters.update(GUARD)
            if spec.name == 'star_observer':
                spec.parameters.update(slew_rate_deg_s=16.0, star_seed=seed, wait_for_nodes=[
                    f'/mount/{name}' for name in NAMES])
        with Night(folder, specs, seed) as night:
            night.mount.offer_home()
            night.start()
            night.until(lambda: night.progress().observations >= after, 300.0)
            night.lasts(rng.uniform(0.0, 4.0))
            for name in NAMES if whole else ('star_observer',):
                os.kill(night.nodes.running[name].pid, signal.SIGKILL)
            night.lasts(0.2)
            for name in (topics.OBSERVER_STATUS.name, topics.OBSERVATIONS.name):
                night.watcher.latest.pop(name, None)
            # the mount goes on meanwhile
            start = threading.Thread(target=night.start, args=NAMES if whole else NAMES[1:2])
            start.start()
            night.until(lambda: not start.is_alive(), 60.0)
            night.until(lambda: night.progress().state in ('done', 'failed', 'cancelled'), 300.0)
            night.lasts(1.5)
            at, table = night.progress(), night.watcher.latest.get(topics.OBSERVATIONS.name)
            said = [text for _, text in night.log('star_observer') if 'goes on at' in text]
            stars = Counter()
            if table is not None:
                rows = cloud_to_run(table)
                stars.update(zip(rows['block'].tolist(), rows['star'].tolist()))
            return {'state': at.state, 'lost': TOTAL - len(stars) - at.lost,
                    'doubled': sum(stars.values()) - len(stars), 'clouds': at.lost,
                    'commands': night.mount.commands, 'beyond': night.mount.beyond,
                    'said': said, 'text': night.text()}


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--killed', default='observer,whole graph')
    parser.add_argument('--verbose', action='store_true')
    args = parser.parse_args()
    moments = range(TOTAL + 1) if args.full else (0, 3, 6)
    print('killed          nights   done   pointings lost, most   doubled, most   said where   '
          'beyond limits, of commands')
    for name, whole in (('observer', False), ('whole graph', True)):
        if name not in args.killed.split(','):
            continue
        out = []
        for after in moments:
            out.append(run(after, whole, 1 + after))
            if args.verbose:
                print('   ', after, out[-1], flush=True)
        print(f'{name:14} {len(out):7} {sum(one["state"] == "done" for one in out):6} '
              f'{max(one["lost"] for one in out):22} {max(one["doubled"] for one in out):15} '
              f'{sum(bool(one["said"]) for one in out):12} '
              f'{sum(len(one["beyond"]) for one in out):8} of '
              f'{sum(one["commands"] for one in out)}', flush=True)


if __name__ == '__main__':
    main()
