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

"""Cleans up what killed processes have left in `/dev/shm`.

Fast DDS gives each participant a segment, ``fastrtps_`` and 16 digits, with a lock file
(``_el``), and each port of a domain a queue, ``fastrtps_port`` and its number, with a lock file
and a semaphore. A killed process leaves these behind, 0.5 MB and some ports of 0.05 MB each, and
nobody removes them: names of segments are random, and those of ports are reused. Ports from
7000 on belong to no domain, and are kept for reuse. We promise that killed nights leave nothing
behind (`benchmarks/stops.py`); this file is unnecessary once Fast DDS cleans up itself.

Only the kernel knows for sure that a file is unused, even by a container: it grants the write
lease of a file (fcntl(2), F_SETLEASE) only while nobody else has it open or mapped. Files of
other users are left alone.
"""

import contextlib
import fcntl
import os
import re
import signal
import stat
import time

FOLDER = '/dev/shm'
#: s that a start may spend on it; the next start continues
BUDGET = 0.012
#: names of Fast DDS 2 and 3: files of a participant, and files of UDP ports
_SEGMENT = re.compile(r'fast(rtps|dds)_[0-9a-f]{16}(_el)?')
_PORT = re.compile(r'(sem\.)?fast(rtps|dds)_port(\d{1,5})(_el|_sl|_mutex)?')


def left_ports(folder=FOLDER):
    """Ports that have files, in use or not, a set of int."""
    with contextlib.suppress(OSError):
        found = map(_PORT.fullmatch, os.listdir(folder))
        return {int(port[3]) for port in found if port}
    return set()


def sweep(ports=(), folder=FOLDER, budget=BUDGET):
    """Remove unused segments, and unused files of `ports`.

    Parameters
    ----------
    ports : container of int
        Ports whose files may be removed: of a domain used only by the caller. A port is opened
        by name, so a file not yet open could be removed just before another process opens it.
    folder : str or Path
    budget : float
        s after which the sweep stops.

    Returns
    -------
    int
        Files removed.
    """
    end, removed = time.monotonic() + budget, 0
    try:
        names = os.listdir(folder)
    except OSError:
        return 0  # another operating system
    for name in names:
        port = _PORT.fullmatch(name)
        if not (int(port[3]) in ports if port else _SEGMENT.fullmatch(name)):
            continue
        if time.monotonic() > end:
            break
        with contextlib.suppress(OSError):  # it is gone, or in use
            removed += _remove(os.path.join(folder, name))
    return removed


def _remove(path):
    """Remove our own file if nobody else has it open; OSError if in use."""
    file = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        found = os.fstat(file)
        if found.st_uid != os.geteuid() or not stat.S_ISREG(found.st_mode):
            return False
        # a process that opens it now waits until it is closed here, and this process gets a signal:
        # choose one that does nothing, since the default one would kill it
        fcntl.fcntl(file, fcntl.F_SETSIG, signal.SIGURG)
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_WRLCK)
        os.unlink(path)
    finally:
        os.close(file)
    return True
