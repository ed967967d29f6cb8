"""A ROS domain of one's own: two nights or two test suites on one machine do not meet."""

import errno
import fcntl
import os
import socket
import tempfile
from pathlib import Path

from .shared_memory import sweep

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
        """Let others have the domain."""
        self._file.close()


def _lock(number):
    path = Path(tempfile.gettempdir(), f'telescope_mount_domain_{number}.lock')
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        return None
    file = os.fdopen(handle, 'r+')
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        return None
    return file


def _taken(number):
    """Whether a participant of this machine listens in the domain."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('0.0.0.0', 7400 + 250 * number + 10))
        except OSError as err:
            if err.errno == errno.EADDRINUSE:
                return True
            raise
    return False


def _claimed(number):
    """The lock of a domain that nobody has, or None."""
    file = _lock(number)
    if file is None:
        return None
    if _taken(number):
        file.close()
        return None
    first = 7400 + 250 * number
    sweep(range(first, first + 250))
    return DomainLock(number, file)


def join(number=None):
    """A domain where others may be: drivers that run already.

    Parameters
    ----------
    number : int, optional
        Else that of ``ROS_DOMAIN_ID``, else 0.

    Returns
    -------
    DomainLock
        Of nothing.

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
        That one; else a free one.

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
        if lock is None:
            raise ValueError(f'domain {number} is in use on this machine; choose another with '
                             '--domain, or leave it out to get a free one')
        return lock
    # not the low ones, where people work by hand
    start = os.getpid() % 90
    for i in range(90):
        lock = _claimed(10 + (start + i) % 90)
        if lock is not None:
            return lock
    raise ValueError('no ROS domain from 10 to 99 is free on this machine; end another graph')
