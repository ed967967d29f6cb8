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

"""A night ended by signals, for each way to start it: do all processes end, is the log complete?

    python benchmarks/stops.py [--times N] [--seed N] [--ways command,executables,run,launch]

Each row is a way to start and a signal, sent once or twice, `--times` times at random moments from
0 to the end of a night. The duration is that of the command as timed before; for the other ways it
is longer (`LONGER`), so at some moments the plan is done but the nodes are still running.

- command: `telescope-mount night`, as installed; only it gets the signal;
- executables: the nodes of a night, each the installed executable that `ros2 run` starts; all get
  the signal, as from `systemctl stop` or a terminal;
- run: the same under `ros2 run`; only these get the signal; for Ctrl-C see `Started.send`;
- launch: `ros2 launch telescope_mount night.launch.py`; only it gets the signal.

The last two need `ros2` on the PATH and the package in AMENT_PREFIX_PATH, else they are skipped.
Executables are those of the package if it is there, else those beside this Python.

A log that was begun must be complete according to `telescope-mount info`. No process may be left,
nothing in `/dev/shm`, and no traceback of ours in the output. `telescope-mount night` must print
one line and exit with 128 plus the signal's number, or 0 if it was done. Processes that end while
the interpreter starts, before running code of the package, are counted separately ("early").
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
import yaml

from telescope_mount import ONE_THREAD
from telescope_mount.dds import dds_environment
from telescope_mount.graph import night_graph
from telescope_mount.processes.domain import claim

PLAN = ('--stars', '8', '--polaris', '4')
TOKEN = 'TELESCOPE_MOUNT_STOPS'
SHM = Path('/dev/shm')
#: ports that belong to no domain stay to be used again: `telescope_mount.processes.shared_memory`
PORT = re.compile(r'(sem\.)?fast(rtps|dds)_port(\d+)')
#: a line of a traceback that is in a module of the package
OURS = re.compile(r'File "[^"]*/(telescope_mount|msg_tools|pointing_model)/\w+\.py"')
END, GONE = 60.0, 5.0  # s
#: s between two signals
APART = 0.1
SIGNALS = ('TERM', 'HUP', 'INT', 'TERM TERM', 'INT INT', 'HUP TERM')
WAYS = ('command', 'executables', 'run', 'launch')
#: how much longer than by the command a night takes where each node starts an interpreter
LONGER = {'command': 1.0, 'executables': 2.0, 'run': 3.0, 'launch': 2.5}
NAMESPACE = '/mount'


def prefix():
    """Install prefix of the package built by colcon, None if there is none."""
    return next((Path(path) for path in os.environ.get('AMENT_PREFIX_PATH', '').split(':')
                 if path and Path(path, 'lib/telescope_mount').is_dir()), None)


def executable(name):
    """Path of an installed executable."""
    found = prefix()
    return str(found / 'lib/telescope_mount' / name if found else Path(sys.executable).with_name(
        name))


def _listens():
    """A benchmark in the background of a script ignores Ctrl-C, and under nohup SIGHUP, and so
    would its children.
    """
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


class Started:
    """A started night; its processes are identified by a token in their environment.

    Parameters
    ----------
    way : str
        One of `WAYS`.
    folder : Path
        Folder for its output.
    """

    def __init__(self, way, folder):
        self.way, self.word, self.folder = way, uuid.uuid4().hex, folder
        self.lock = None if way == 'command' else claim()
        self.environment = os.environ | {TOKEN: self.word}
        if self.lock:
            self.environment |= dds_environment(self.lock.number) | ONE_THREAD | {
                'ROS_DOMAIN_ID': str(self.lock.number), 'ROS_LOG_DIR': str(folder / 'ros')}
        self.bag = folder / 'night' / 'bag'
        self.began = time.monotonic()
        self.children = [self._start(number, words) for number, words in enumerate(
            getattr(self, way)())]

    def _start(self, number, words):
        with open(self.folder / f'{number}.out', 'w') as out:
            return subprocess.Popen(
                words, env=self.environment, stdin=subprocess.DEVNULL, stdout=out,
                stderr=subprocess.STDOUT,
                preexec_fn=_listens)

    def command(self):
        return [[executable('telescope-mount'), 'night', *PLAN, '--out',
                 str(self.folder / 'night')]]

    def executables(self, begin=None):
        """Of the nodes of a night, with their parameters."""
        self.bag.parent.mkdir()
        for spec in night_graph(bag=str(self.bag)):
            params = self.folder / f'{spec.name}.yaml'
            params.write_text(yaml.safe_dump(
                {spec.full_name: {'ros__parameters': spec.parameters}}))
            words = begin(spec.name) if begin else [executable(spec.name)]
            yield [*words, '--ros-args', '-r', f'__ns:={NAMESPACE}', *(
                ['--params-file', str(params)] if spec.parameters else [])]

    def run(self):
        self.environment['_'] = shutil.which('ros2')  # as a shell says what it starts
        return self.executables(lambda name: ['ros2', 'run', 'telescope_mount', name])

    def launch(self):
        self.bag.parent.mkdir()
        return [['ros2', 'launch', 'telescope_mount', 'night.launch.py', f'bag:={self.bag}',
                 'display:=false', 'stars:=8', 'polaris:=4']]

    def processes(self):
        """Ids of all its processes."""
        found = []
        for entry in filter(str.isdigit, os.listdir('/proc')):
            with suppress(OSError):
                if self.word.encode() in Path(f'/proc/{entry}/environ').read_bytes():
                    found.append(int(entry))
        return found

    def after(self, seconds):
        """Wait until `seconds` after its start, or until its first child has ended."""
        with suppress(subprocess.TimeoutExpired):
            self.children[0].wait(max(0.0, self.began + seconds - time.monotonic()))

    def send(self, number):
        """A signal to what was started alone; but Ctrl-C, which a terminal gives to all of a group
        and `ros2 run` does not pass on, to its nodes, too.
        """
        if number == signal.SIGINT and self.way == 'run':
            for pid in self.processes():
                with suppress(ProcessLookupError):
                    os.kill(pid, number)
            return
        for child in self.children:
            child.send_signal(number)

    def end(self):
        """Wait for the end: exit codes, outputs, and ids of processes that had to be killed."""
        codes, last = [], time.monotonic() + END
        for child in self.children:
            try:
                codes.append(child.wait(max(0.1, last - time.monotonic())))
            except subprocess.TimeoutExpired:
                child.kill()
                codes.append('killed')
                child.wait()
        end = time.monotonic() + GONE
        while (left := self.processes()) and time.monotonic() < end:
            time.sleep(0.02)  # nothing tells when an orphan has gone
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        if self.lock:
            self.lock.release()
        texts = [(self.folder / f'{number}.out').read_text(errors='replace')
                 for number in range(len(self.children))]
        return codes, texts, left


def names():
    """Files of DDS domains in `/dev/shm`."""
    found = set()
    for name in os.listdir(SHM):
        port = PORT.match(name)
        if name.startswith(('fast', 'sem.fast')) and (port is None or int(port[3]) >= 7400):
            found.add(name)
    return found


def in_use(processes=None):
    """Files in `/dev/shm` that some processes (default: any) have mapped or open."""
    found = set()
    for entry in filter(str.isdigit, os.listdir('/proc')) if processes is None else processes:
        with suppress(OSError):
            found |= set(re.findall(r'/dev/shm/(\S+)', Path(f'/proc/{entry}/maps').read_text()))
            for file in os.listdir(f'/proc/{entry}/fd'):
                place = os.readlink(f'/proc/{entry}/fd/{file}')
                if place.startswith('/dev/shm/'):
                    found.add(place.removeprefix('/dev/shm/'))
    return found


def closed(bag):
    """Whether a log is complete according to `telescope-mount info`; None if there is no log."""
    if not list(bag.glob('*.mcap')):
        return None
    return subprocess.run([sys.executable, '-m', 'telescope_mount.cli', 'info', str(bag)],
                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0


def early(text):
    """Whether Python was interrupted before it ran code of the package."""
    return 'KeyboardInterrupt' in text and not OURS.search(text)


def stopped(way, told, folder, moment):
    """Run one night that gets signals; a list of failures, and facts."""
    night = Started(way, folder)
    night.after(moment)
    own = in_use(night.processes())
    for number in told:
        night.send(number)
        own |= in_use(night.processes())
        time.sleep(APART)
    at = time.monotonic()
    codes, texts, left = night.end()
    took = time.monotonic() - at
    wrong = []
    begun = [text for text in texts if not early(text)]
    traces = [text for text in begun if 'Traceback' in text and 'telescope_mount' in text]
    if traces:
        wrong.append(f'{len(traces)} tracebacks: {traces[0].strip().splitlines()[-1]}')
    if way == 'command':
        lines = [line for line in texts[0].splitlines() if 'ended by' in line]
        before = not (folder / 'night').exists() and codes[0] < 0
        if codes[0] not in (0, *(128 + number for number in told)) and not before and begun:
            wrong.append(f'code {codes[0]}')
        elif codes[0] > 0 and len(lines) != 1 and begun:
            wrong.append(f'{len(lines)} lines said')
    if left:
        wrong.append(f'{len(left)} processes left')
    if new := own & names() - in_use():
        wrong.append(f'in /dev/shm: {sorted(new)}')
    log = closed(night.bag)
    if log is False:
        wrong.append('the log is not closed')
    return wrong, {'log': log, 'took': took, 'early': len(begun) < len(texts) or (
        way == 'command' and codes[0] in [-number for number in told])}


def killed(folder, moment):
    """All of a night killed: files left in `/dev/shm`, and of these after the next night."""
    night = Started('command', folder / 'first')
    night.after(moment)
    own = in_use(night.processes())
    for process in night.processes():
        with suppress(ProcessLookupError):  # with its parent
            os.kill(process, signal.SIGKILL)
    night.end()
    left = own & names() - in_use()
    Started('command', folder / 'next').end()
    return len(left), len(left & (names() - in_use())), closed(night.bag)


def length():
    """Seconds of a night by the command that nobody disturbs."""
    with tempfile.TemporaryDirectory() as place:
        night = Started('command', Path(place))
        night.end()
        return time.monotonic() - night.began


def row(way, words, moments):
    """One row of the table, printed."""
    told = [signal.Signals[f'SIG{word}'] for word in words.split()]
    counts, problems, took = Counter(), [], []
    for moment in moments:
        with tempfile.TemporaryDirectory() as place:
            wrong, facts = stopped(way, told, Path(place), moment)
        counts['good'] += not wrong
        counts['early'] += facts['early']
        counts['logs'] += facts['log'] is not None
        took.append(facts['took'])
        problems += [f'at {moment:.2f} s: {text}' for text in wrong]
    print(f'| {way} | {words} | {counts["good"]} of {len(moments)} | {counts["logs"]} | '
          f'{counts["early"]} | {np.median(took):.1f}, {max(took):.1f} | '
          f'{"; ".join(problems)} |', flush=True)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--times', type=int, default=10, help='moments of a row (default: 10)')
    parser.add_argument('--ways', default=','.join(WAYS))
    parser.add_argument('--signals', default=','.join(SIGNALS))
    parser.add_argument('--kills', type=int, default=2, help='nights killed with SIGKILL')
    parser.add_argument('--until', type=float,
                        help='the last moment of the command, s; default: of a night')
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    ways = [way for way in args.ways.split(',') if way in ('command', 'executables')
            or (shutil.which('ros2') and prefix())]
    took = args.until or length()
    until = {way: took * LONGER[way] for way in ways}
    print('moments: ' + ', '.join(f'{way} to {took:.1f} s' for way, took in until.items()))
    print('\n| way | signal | as it must be | logs begun | early | ended after, s: median, most | '
          'what was wrong |\n| --- | --- | --- | --- | --- | --- | --- |')
    for way in ways:
        for words in args.signals.split(',') + ['KILL'] * (way in ('run', 'launch')):
            row(way, words, rng.uniform(0.0, until[way], args.times))
    for _ in range(args.kills if 'command' in until else 0):
        moment = rng.uniform(0.3, 1.0) * until['command']
        with tempfile.TemporaryDirectory() as place:
            for name in ('first', 'next'):
                Path(place, name).mkdir()
            left, still, log = killed(Path(place), moment)
        print(f'all killed at {moment:.2f} s: {left} files left in /dev/shm, {still} after the '
              f'next night; log closed: {log}', flush=True)


if __name__ == '__main__':
    main()
