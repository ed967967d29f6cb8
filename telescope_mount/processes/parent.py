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

"""Ends processes with `ros2 launch` and `ros2 run`, which leave them running when killed by
SIGTERM, SIGHUP or SIGKILL.

As a program, ``python -m telescope_mount.processes.parent FILE ARGUMENTS``, it becomes a Python
file that ends in this way.
"""

import ctypes
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

#: environment variable: process id without which a node must end
PARENT = 'TELESCOPE_MOUNT_PARENT'
#: commands of `ros2` that start a node and wait for it
STARTERS = ('run', 'launch')
#: Linux: prctl
_SET_DEATH_SIGNAL = 1


def end_with_parent():
    """Have the kernel send SIGTERM when the parent ends, if it is that in `PARENT`, or `ros2`
    with one of `STARTERS`. Exit at once if it has ended already.

    A process in between (``--launch-prefix``, ``--prefix``) must end by itself.
    """
    wanted, parent = os.environ.get(PARENT, ''), os.getppid()
    if wanted == str(parent) or _starts(parent):
        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)
        if os.getppid() != parent:  # it ended before prctl
            sys.exit(-signal.SIGTERM)
    if (not _runs(wanted) if wanted.isdecimal() else _is_orphan()):
        sys.exit(-signal.SIGTERM)


def _status(process):
    """Fields of ``/proc/PID/stat`` after the name, from the state on; empty if it has ended."""
    with suppress(OSError):
        # the name, in parentheses, may have any characters
        return Path(f'/proc/{process}/stat').read_text().rpartition(') ')[2].split()
    return []


def _runs(process):
    """Whether a process runs and is not a zombie."""
    return _status(process)[:1] not in ([], ['Z'], ['X'])


def _is_orphan():
    """Whether a shell started `ros2`, which started this process and has ended since.

    A shell sets `_` to the command that it starts, and children inherit it; for a service it is not
    `ros2`. A daemon started by `ros2` has its own session.
    """
    if os.path.basename(os.environ.get('_', '')) != 'ros2' or os.getsid(0) == os.getpid():
        return False
    process = os.getppid()
    while process > 0:  # a process in between (`--prefix`) has `ros2` as its parent
        if _starts(process):
            return False
        status = _status(process)
        if not status:  # it has just ended, or /proc is of another system
            return False
        process = int(status[1])
    return True


def _starts(process):
    """Whether a process is a `ros2` that starts a node, by its command line."""
    words = []
    with suppress(OSError):  # it has ended, or /proc is of another system
        words = Path(f'/proc/{process}/cmdline').read_bytes().decode(errors='replace').split('\0')
    return any(os.path.basename(word) == 'ros2' and after in STARTERS
               for word, after in zip(words, words[1:]))


if __name__ == '__main__':
    end_with_parent()
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
