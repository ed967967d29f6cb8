"""Processes that end with `ros2 launch`, which leaves them behind when SIGTERM or SIGHUP end it.

As a program, ``python -m telescope_mount.parent FILE ARGUMENTS``, it becomes a Python file that
does.
"""

import ctypes
import os
import signal
import sys

#: environment: the process without which a node is not wanted any more
PARENT = 'TELESCOPE_MOUNT_PARENT'
#: Linux: prctl
_SET_DEATH_SIGNAL = 1


def end_with_parent():
    """Have the kernel send SIGTERM when the parent has ended, if that is the one in `PARENT`.

    One in between (``--launch-prefix``) has to end by itself.
    """
    wanted = os.environ.get(PARENT, '')
    if not wanted.isdecimal():
        return
    if os.getppid() == int(wanted):
        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)
    if not os.path.exists(f'/proc/{wanted}'):  # it ended before that
        sys.exit(-signal.SIGTERM)


if __name__ == '__main__':
    end_with_parent()
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
