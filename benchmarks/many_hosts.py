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

"""A night over two hosts with a network that loses and delays frames or is cut: does it finish?

    python benchmarks/many_hosts.py             # a table, some minutes
    python benchmarks/many_hosts.py --repeat 5  # each case five times, with other frames lost

The mount's side (simulator, encoders, camera, guard) is on one host; observer, calibration,
corrector and logger are on another; see `hosts`. Needs root for network namespaces.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from hosts import two_hosts, why_not

from pointing_model.runs.run_reader import read_run
from telescope_mount.graph import SIMULATED, night_graph
from telescope_mount.observing.plan import night_plan

#: what runs beside the mount
FIRST = (*SIMULATED, 'mount_guard')
#: as of the nights that the tests share
STARS, POLARIS, SEED = 8, 4, 3
DOMAIN = 7
#: s until a night is given up that has not ended
PATIENCE = 400.0
#: name, wire, s that it is cut for
CASES = (
    ('no loss', {}, 0.0),
    ('1 % lost, 50 ms', {'loss': 0.01, 'delay': 0.05}, 0.0),
    ('10 % lost, 50 ms', {'loss': 0.1, 'delay': 0.05}, 0.0),
    ('25 % lost, 50 ms', {'loss': 0.25, 'delay': 0.05}, 0.0),
    ('cut off for 20 s', {}, 20.0),
    ('cut off for 90 s', {}, 90.0),
)


def environment(**more):
    """Environment of nodes that are open to the network, as in docs/many_hosts.md."""
    own = {name: value for name, value in os.environ.items()
           if not name.startswith(('ROS_', 'FASTDDS_', 'FASTRTPS_'))}
    return own | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'} | more


def start(host, folder, specs, plan='', env=None):
    """The nodes of one host; with a `plan` it is observed, see `host_nodes`."""
    folder.mkdir(parents=True)
    with open(folder / 'errors', 'w') as errors:
        process = host.start(
            sys.executable, Path(__file__).with_name('host_nodes.py'), stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=errors, text=True, env=env or environment())
    process.stdin.write(json.dumps({
        'folder': str(folder), 'domain': DOMAIN, 'plan': plan, 'stall': PATIENCE,
        'specs': [[spec.name, spec.module, spec.parameters] for spec in specs]}) + '\n')
    process.stdin.flush()
    return process


def observe(first, second, folder, heard=lambda words: None, env=None):
    """A night on two hosts, or on one if it is given twice.

    Parameters
    ----------
    first, second : Host
        With the mount; with the observer.
    folder : Path
        For what they write, `second` has the results.
    heard : callable
        Called with each line of the second, see `host_nodes`.
    env : dict, optional
        The environment of both.

    Returns
    -------
    list
        The last line: ``report`` or ``failed``, and what comes with it.
    """
    plan = night_plan(STARS, POLARIS, False)
    specs = night_graph(bag=str(folder / 'second' / 'bag'), plan=plan, seed=SEED)
    with contextlib.ExitStack() as stack:
        def run(host, name, own, plan=''):
            process = stack.enter_context(start(host, folder / name, own, plan, env))
            stack.callback(process.kill)  # first, where something has failed
            return process

        mount = run(first, 'first', [spec for spec in specs if spec.name in FIRST])
        night = run(second, 'second', [spec for spec in specs if spec.name not in FIRST], plan)
        words = ['failed', 'it has not said anything']
        for line in night.stdout:
            words = json.loads(line)
            heard(words)
        night.wait(60.0)
        mount.communicate('', 60.0)
    return words


def largest_gap(bag):
    """Longest interval between two diagnostics of the simulator in a log, by send time, s."""
    from msg_tools.bag import BagReader
    times = sorted(
        message.publish_time * 1e-9 for message in BagReader(bag).messages(decode=True)
        if message.topic == '/diagnostics' and any(
                 status.name == '/mount/mount_simulator' for status in message.data.status))
    return max((after - before for before, after in zip(times, times[1:])), default=float('nan'))


def case(wire, cut, alone=None):
    """One night.

    Returns
    -------
    dict
        ``seconds``, ``end`` in words, ``rows``, ``doubled``, ``gap``, and ``files``, the text of
        rows and model; ``same``: those of `alone`.
    """
    with tempfile.TemporaryDirectory() as name, two_hosts(wire) as (first, second, cable):
        folder, since, told = Path(name), time.monotonic(), []

        def heard(words):
            # cut in the middle of the second block of stars
            if cut and cable.up and not told and words[0] == 'at' and words[2] >= 2 * STARS:
                told.append(time.monotonic())
                cable.up = False
            elif words[0] == 'said':
                told.append(words[1])

        over = threading.Event()

        def mend():
            while not over.wait(0.1):
                if not cable.up and time.monotonic() - told[0] > cut:
                    cable.up = True

        thread = threading.Thread(target=mend)
        thread.start()
        try:
            what, *rest = observe(first, second if alone is not None else first, folder, heard)
        finally:
            over.set()
            thread.join()
        out = {'seconds': time.monotonic() - since, 'end': 'whole', 'rows': 0, 'doubled': 0,
               'gap': float('nan'), 'files': None, 'told': told[1:]}
        if what != 'report':
            out['end'] = str(rest[0])
            return out
        results = folder / 'second'
        run = read_run(results / 'observations.csv')
        counts = Counter(zip(run['block'].tolist(), run['time'].tolist()))
        out |= {'rows': len(run), 'doubled': sum(counts.values()) - len(counts),
                'gap': largest_gap(results / 'bag'),
                'files': [(results / name).read_text() for name in (
                    'observations.csv', 'model.json')]}
        out['same'] = alone is None or out['files'] == alone['files']
        return out


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--repeat', type=int, default=1)
    parser.add_argument('--seed', type=int, default=1, help='of the frames that are lost')
    parser.add_argument('--only', default='', help='cases whose name has this')
    options = parser.parse_args()
    why = why_not()
    if why:
        sys.exit(f'error: {why}')
    alone = case({}, 0.0)
    print('| network | night | s | rows | twice | numbers of one host | gap in the log, s |\n'
          '| --- | --- | --- | --- | --- | --- | --- |')
    rows = [('one host', alone)]
    for name, wire, cut in CASES:
        if options.only in name:
            for number in range(options.repeat):
                rows.append((name, case(wire | {'seed': options.seed + number}, cut, alone)))
                _print(*rows.pop(0))
    for row in rows:
        _print(*row)


def _print(name, found):
    same = 'the same' if found.get('same') else 'others'
    print(f'| {name} | {found["end"]} | {found["seconds"]:.0f} | {found["rows"]} | '
          f'{found["doubled"]} | {same} | {found["gap"]:.1f} |', flush=True)
    for text in found['told']:
        if text:
            print(f'      {text}', file=sys.stderr, flush=True)


if __name__ == '__main__':
    main()
