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

"""What processes that were killed have left in `/dev/shm`.

Fast DDS gives each participant a segment, ``fastrtps_`` and 16 digits, with a lock file beside it
(``_el``), and each port of a domain a queue, ``fastrtps_port`` and its number, with a lock file and
a semaphore. A process that is killed leaves its own there, 0.5 MB and some ports of 0.05 MB, and
nobody takes them away: names of segments are drawn, and those of ports are used again. Ports from
7000 on are of no domain, and stay to be used again. That killed nights leave nothing behind is
promised (`benchmarks/stops.py`); this file can go when Fast DDS sweeps what is nobody's itself.

That a file is nobody's any more only the kernel knows for sure, also where a container has it:
it gives the write lease of a file (fcntl(2), F_SETLEASE) only while nobody else has it open or
mapped. Another user's files are left alone.
"""

import contextlib
import fcntl
import os
import re
import signal
import stat
import time

FOLDER = '/dev/shm'
#: s that a start may take for it; what is left then the next one finds
BUDGET = 0.012
#: of Fast DDS 2 and 3: a participant's own, and what belongs to a port of UDP's numbers
_SEGMENT = re.compile(r'fast(rtps|dds)_[0-9a-f]{16}(_el)?')
_PORT = re.compile(r'(sem\.)?fast(rtps|dds)_port(\d{1,5})(_el|_sl|_mutex)?')


def left_ports(folder=FOLDER):
    """Ports that files are there of, dead or not, a set of int."""
    with contextlib.suppress(OSError):
        found = map(_PORT.fullmatch, os.listdir(folder))
        return {int(port[3]) for port in found if port}
    return set()


def sweep(ports=(), folder=FOLDER, budget=BUDGET):
    """Remove segments that nobody has open any more, and such files of ports.

    Parameters
    ----------
    ports : container of int
        Whose files may go: of a domain that nobody but the caller uses, as a port is opened by its
        name, and one that is not open yet could be taken away from under who is about to.
    folder : str or Path
    budget : float
        s after which it is given up.

    Returns
    -------
    int
        Files removed.
    """
    end, removed = time.monotonic() + budget, 0
    try:
        names = os.listdir(folder)
    except OSError:
        return 0  # of another system
    for name in names:
        port = _PORT.fullmatch(name)
        if not (int(port[3]) in ports if port else _SEGMENT.fullmatch(name)):
            continue
        if time.monotonic() > end:
            break
        with contextlib.suppress(OSError):  # it has gone, or belongs to somebody
            removed += _remove(os.path.join(folder, name))
    return removed


def _remove(path):
    """Remove an own file that nobody else has open; OSError where somebody has."""
    file = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        found = os.fstat(file)
        if found.st_uid != os.geteuid() or not stat.S_ISREG(found.st_mode):
            return False
        # who opens it now is held up until it is closed here, and this process gets a signal that
        # does nothing; by default it would end it
        fcntl.fcntl(file, fcntl.F_SETSIG, signal.SIGURG)
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_WRLCK)
        os.unlink(path)
    finally:
        os.close(file)
    return True
