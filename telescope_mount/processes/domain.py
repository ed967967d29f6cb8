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

"""A private ROS domain: two nights or test suites on one machine do not interfere."""

import contextlib
import errno
import fcntl
import os
import socket
import tempfile
import time
from pathlib import Path

from .shared_memory import left_ports, sweep

#: RTPS well-known ports: 7400 + 250 * domain, unicast of the first participant at + 10
#: (DDSI-RTPS 2.5, section 9.6.2.3); from 102 on they fall into the ephemeral ports of Linux
LAST_DOMAIN = 101


class DomainLock:
    """Holds a domain until `release` or the end of the process.

    Attributes
    ----------
    number : int
    """

    def __init__(self, number, file):
        self.number = number
        self._file = file

    def release(self):
        """Release the domain for others."""
        self._file.close()


def _lock_file(number):
    return Path(tempfile.gettempdir(), f'telescope_mount_domain_{number}.lock')


def _lock(number):
    shared = _lock_file(number)
    # if another user owns the first file, it may not be writable
    for path in (shared, shared.with_name(f'{shared.stem}_of_{os.geteuid()}.lock')):
        with contextlib.suppress(OSError):
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
            break
    else:
        return None
    file = os.fdopen(handle, 'r+')
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        return None
    return file


def _taken(number):
    """Whether a participant on this machine uses the domain."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('0.0.0.0', 7400 + 250 * number + 10))
        except OSError as err:
            if err.errno == errno.EADDRINUSE:
                return True
            raise
    return False


def _claimed(number):
    """The lock of a free domain, or None."""
    file = _lock(number)
    if file is None:
        return None
    if _taken(number):
        file.close()
        return None
    _clear(number)
    return DomainLock(number, file)


def _ports(number):
    """UDP ports of a domain."""
    return range(7400 + 250 * number, 7650 + 250 * number)


def _clear(number):
    """Remove what dead graphs have left in this domain, which we hold, and in domains that are now
    unused.
    """
    free, ports = contextlib.ExitStack(), {*_ports(number)}
    with free:
        for other in {(port - 7400) // 250 for port in left_ports()} - {number}:
            # leave domains alone that no graph of ours has ever used
            if 0 <= other <= LAST_DOMAIN and _lock_file(other).exists():
                file = _lock(other)
                if file is not None:
                    free.enter_context(file)
                    ports.update(() if _taken(other) else _ports(other))
        sweep(ports)


def join(number=None):
    """A domain shared with others: with drivers that already run.

    Parameters
    ----------
    number : int, optional
        By default that of ``ROS_DOMAIN_ID``, or 0.

    Returns
    -------
    DomainLock
        It locks nothing.

    Raises
    ------
    ValueError
        Out of range.
    """
    text = str(os.environ.get('ROS_DOMAIN_ID') or 0) if number is None else str(number)
    if not text.isdecimal() or int(text) > LAST_DOMAIN:
        raise ValueError(f'domain {text}: must be 0 to {LAST_DOMAIN}')
    sweep()
    return DomainLock(int(text), open(os.devnull))


def claim(number=None):
    """Lock a domain.

    Parameters
    ----------
    number : int, optional
        This domain; by default a free one.

    Returns
    -------
    DomainLock

    Raises
    ------
    ValueError
        `number` is out of range or in use, or no domain is free.
    """
    if number is not None:
        if not 0 <= number <= LAST_DOMAIN:
            raise ValueError(f'domain {number}: must be 0 to {LAST_DOMAIN}')
        lock = _claimed(number)
        if lock is None:  # another start may be clearing it for a moment
            time.sleep(0.05)
            lock = _claimed(number)
        if lock is None:
            raise ValueError(f'domain {number} is in use on this machine; choose another with '
                             '--domain, or leave it out to get a free one')
        return lock
    # not the low numbers, which people use by hand
    start = os.getpid() % 90
    for i in range(90):
        lock = _claimed(10 + (start + i) % 90)
        if lock is not None:
            return lock
    raise ValueError('no ROS domain from 10 to 99 is free on this machine; end another graph')
