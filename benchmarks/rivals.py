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

"""A duplicate node must end itself; the first one and restarted ones must not: time, reliability.

    python benchmarks/rivals.py [--times N] [--full]

Real processes in a separate ROS domain. `--full`: 20 times each, and restarts are observed for
longer than the lease of a killed node's endpoints (20 s).
"""

import argparse
import os
import signal
import subprocess
import sys
import time

import numpy as np

from telescope_mount.dds import dds_environment
from telescope_mount.processes import domain

COMMAND = [sys.executable, '-m', 'msg_tools.node_process', 'pointing_model.pointing_corrector_node']
#: s in which a second one must have ended, else it is counted as mixed with the first
PATIENCE = 30.0
#: s after which a node that started has imported and is in the graph; nothing says so outside it
SETTLED = 2.0


def start():
    """A node, once it is a node of the graph (its imports take longer than discovery)."""
    return subprocess.Popen(COMMAND, stdin=subprocess.DEVNULL,
                            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def end(*nodes):
    """End what runs."""
    for node in nodes:
        if node.poll() is None:
            node.send_signal(signal.SIGKILL)
        node.communicate()


def second():
    """Seconds from the start of a second one to its end, and whether all was as it must be."""
    first = start()
    time.sleep(SETTLED)
    began, other = time.monotonic(), start()
    try:
        _, said = other.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        end(first, other)
        return PATIENCE, False
    took, lives = time.monotonic() - began, first.poll() is None
    end(first)
    return took, lives and other.returncode == 2 and 'is published by' in said


def together():
    """Whether of two that start at once exactly one stays."""
    nodes = start(), start()
    deadline = time.monotonic() + PATIENCE
    while all(node.poll() is None for node in nodes) and time.monotonic() < deadline:
        time.sleep(0.05)  # leaves the cores to the nodes
    time.sleep(SETTLED)  # the other might end too
    lives = sum(node.poll() is None for node in nodes)
    end(*nodes)
    return lives == 1


def again(watched, sign):
    """Whether one that is started as soon as another is ended stays."""
    first = start()
    time.sleep(SETTLED)
    first.send_signal(sign)
    first.wait()
    other = start()
    time.sleep(watched)  # it must not end in that time
    lives = other.poll() is None
    end(first, other)
    return lives


def alone():
    """Seconds from start to end of a node that refuses a parameter: interpreter and imports."""
    began = time.monotonic()
    subprocess.run([*COMMAND, '--ros-args', '-p', 'model_fil:=1'],
                   stdin=subprocess.DEVNULL, capture_output=True)
    return time.monotonic() - began


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--times', type=int, default=3)
    parser.add_argument('--full', action='store_true')
    options = parser.parse_args()
    times = 20 if options.full else options.times
    watched = 25.0 if options.full else 5.0
    lock = domain.claim()
    os.environ.update(dds_environment(lock.number))
    imports = min(alone() for _ in range(3))
    took, good = map(np.array, zip(*(second() for _ in range(times))))
    rows = [
        ('second one ends with code 2 and a line, first stays', f'{good.sum()} of {times}',
         'all'),
        ('  seconds of it beyond interpreter and imports, median, most',
         f'{np.median(took) - imports:.1f}, {took.max() - imports:.1f}', '2'),
        ('of two at once one stays', f'{sum(together() for _ in range(times))} of {times}',
         'all')]
    for name, sign in (('killed', signal.SIGKILL), ('ended by Ctrl-C', signal.SIGINT)):
        stayed = sum(again(watched, sign) for _ in range(times))
        rows.append((f'started as another was {name}: stays {watched:.0f} s',
                     f'{stayed} of {times}', 'all'))
    lock.release()
    print('| what | figure | target |\n| --- | --- | --- |')
    for row in rows:
        print('| ' + ' | '.join(row) + ' |')


if __name__ == '__main__':
    main()
