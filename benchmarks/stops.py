"""`telescope-mount night` stopped at any moment: is it said, is all gone, is the log readable?

    python benchmarks/stops.py [--times N] [--seed N]

A night is timed; then nights are sent SIGINT and SIGTERM in turn at moments that are drawn from 0
to its end. Each must end with 130 or 143 (0 where it was done already) and one line, leave no
process and nothing in `/dev/shm`, and its log, where it was begun, must be one that
`telescope-mount info` reads. In the first moments, until Python runs the command, the kernel or
the interpreter ends it: these are counted apart. Then all processes of a night are killed with
SIGKILL: what they leave in `/dev/shm` the next night must have taken away.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from pathlib import Path

import numpy as np

NIGHT = ('--stars', '8', '--polaris', '4')
TOKEN = 'TELESCOPE_MOUNT_STOPS'
SHM = Path('/dev/shm')
#: ports that belong to no domain stay to be used again, see `telescope_mount.shared_memory`
PORT = re.compile(r'(sem\.)?fast(rtps|dds)_port(\d+)')
END = 60.0  # s


class Night:
    """One run of the command, whose processes are known by a word in their environment."""

    def __init__(self, out, *options):
        self.word, self.out = uuid.uuid4().hex, out
        self.began = time.monotonic()
        self.child = subprocess.Popen(
            [sys.executable, '-m', 'telescope_mount.cli', 'night', *NIGHT, '--out', str(out),
             *options], env=os.environ | {TOKEN: self.word}, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            # a benchmark in the background of a script ignores Ctrl-C, and its children would too
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))

    def processes(self):
        """Ids of all that belong to it."""
        found = []
        for entry in filter(str.isdigit, os.listdir('/proc')):
            try:
                if self.word.encode() in Path(f'/proc/{entry}/environ').read_bytes():
                    found.append(int(entry))
            except OSError:
                continue
        return found

    def after(self, seconds):
        """Wait until so long after its begin; whether it still runs."""
        try:
            self.child.wait(max(0.0, self.began + seconds - time.monotonic()))
        except subprocess.TimeoutExpired:
            return True
        return False

    def end(self):
        """Exit code, and the lines of stderr."""
        _, err = self.child.communicate(timeout=END)
        return self.child.returncode, err.splitlines()

    def left(self):
        """Processes that are there 2 s after its end."""
        end = time.monotonic() + 2.0
        while (found := self.processes()) and time.monotonic() < end:
            time.sleep(0.02)  # nothing tells when an orphan has gone
        return found


def names():
    """What is in `/dev/shm` of domains."""
    found = set()
    for name in os.listdir(SHM):
        port = PORT.match(name)
        if name.startswith(('fast', 'sem.fast')) and (port is None or int(port[3]) >= 7400):
            found.add(name)
    return found


def in_use(processes=None):
    """Names in `/dev/shm` that a process, by default any, has mapped or open."""
    found = set()
    for entry in filter(str.isdigit, os.listdir('/proc')) if processes is None else processes:
        try:
            found |= set(re.findall(r'/dev/shm/(\S+)', Path(f'/proc/{entry}/maps').read_text()))
            for file in os.listdir(f'/proc/{entry}/fd'):
                place = os.readlink(f'/proc/{entry}/fd/{file}')
                if place.startswith('/dev/shm/'):
                    found.add(place.removeprefix('/dev/shm/'))
        except OSError:
            continue
    return found


def readable(out):
    """What `telescope-mount info` says of the log: exit code, None where there is none."""
    if not list(Path(out).glob('bag/*.mcap')):
        return None
    return subprocess.run([sys.executable, '-m', 'telescope_mount.cli', 'info', str(out / 'bag')],
                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode


def stopped(folder, number, moment):
    """One night that gets a signal; what is wrong, a list of sentences, and what it said."""
    night = Night(folder / 'night')
    night.after(moment)
    own = in_use(night.processes())
    night.child.send_signal(number)
    own |= in_use(night.processes())
    code, lines = night.end()
    took = time.monotonic() - night.began - moment
    wrong = []
    early = not night.out.exists() and (code == -number or 'KeyboardInterrupt' in lines[-1:])
    if code not in (0, 128 + number) and not early:
        wrong.append(f'code {code}')
    if len(lines) != (code != 0) and not early:
        wrong.append(f'{len(lines)} lines said: {lines[-1:]}')
    if left := night.left():
        wrong.append(f'processes left: {left}')
    if new := own & names() - in_use():
        wrong.append(f'in /dev/shm: {sorted(new)}')
    log = readable(folder / 'night')
    if log not in (None, 0):
        wrong.append(f'info: code {log}')
    return {'code': code, 'wrong': wrong, 'lines': lines, 'log': log, 'took': took,
            'early': early}


def killed(folder, moment):
    """All of a night killed: files left in `/dev/shm`, and of these after the next night."""
    night = Night(folder / 'night')
    night.after(moment)
    own = in_use(night.processes())
    for process in night.processes():
        try:
            os.kill(process, signal.SIGKILL)
        except ProcessLookupError:
            continue  # with its parent
    night.end()
    night.left()
    left = own & names() - in_use()
    Night(folder / 'next').end()
    return left, left & (names() - in_use()), readable(folder / 'night')


def main():
    """Print a line a night, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--times', type=int, default=24)
    parser.add_argument('--kills', type=int, default=2, help='nights killed with SIGKILL')
    parser.add_argument('--until', type=float, help='the last moment, s; default: of a night')
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    with tempfile.TemporaryDirectory() as place:
        night = Night(Path(place) / 'night')
        code, lines = night.end()
        length = time.monotonic() - night.began
        print(f'undisturbed: code {code}, {length:.1f} s {lines}', flush=True)
    good = early = 0
    for i in range(args.times):
        number = (signal.SIGINT, signal.SIGTERM)[i % 2]
        moment = rng.uniform(0.0, args.until or length)
        with tempfile.TemporaryDirectory() as place:
            found = stopped(Path(place), number, moment)
        good += not found['wrong']
        early += found['early']
        log = {None: 'no log', 0: 'log readable'}.get(found['log'], 'log not readable')
        print(f'{number.name:8}{moment:6.2f} s: code {found["code"]:4}, ended after '
              f'{found["took"]:5.2f} s, {log}; '
              f'{"; ".join(found["wrong"]) or " ".join(found["lines"])}', flush=True)
    print(f'{good} of {args.times} as they must be; {early} ended before the command ran')
    for _ in range(args.kills):
        moment = rng.uniform(0.3, 1.0) * length
        with tempfile.TemporaryDirectory() as place:
            left, still, log = killed(Path(place), moment)
        print(f'SIGKILL {moment:6.2f} s: {len(left)} files left in /dev/shm, {len(still)} after '
              f'the next night; info: {log}', flush=True)


if __name__ == '__main__':
    main()
