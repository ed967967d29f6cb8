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

"""Runs nodes until a signal: one in its process, or several that share it.

    python -m msg_tools.node_process MODULE,MODULE... --ros-args ...
"""

import ctypes
import faulthandler
import fcntl
import gc
import os
import signal
import sys
import time
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from .executor import NodeExecutor
from .node import MountNode
from .open_files import check_open_files
from .signals import ENDING, on_end

#: s in which DDS lets go of nodes that have ended
LETS_GO = 12.0
#: s for which a process waits that others let go of theirs
TURN = 4.0
#: of the queues of Fast DDS
FOLDER = '/dev/shm'


def run_node(make_node, args=None):
    """Run a node until Ctrl-C, SIGTERM, SIGHUP or shutdown.

    Parameters
    ----------
    make_node : callable
        Returns the node, and its class if it shall tell ``--help``; raises ValueError or OSError
        with one line for bad input. A class may have ``before_end(node)``, which is called after
        a signal, while its topics still work.

    Returns
    -------
    int
        Exit code: 0 after a clean end, 1 where its own file is not whole, 2 after bad input.
    """
    if isinstance(make_node, type) and {'-h', '--help'} & set(args or sys.argv[1:]):
        from .node_help import node_help, wants_help
        if wants_help(args or sys.argv[1:]):
            print(node_help(make_node), end='')
            return 0
    return run_nodes([make_node], args)


def run_nodes(makers, args=None):
    """Run nodes in this process, one executor for all; see `run_node`.

    Parameters
    ----------
    makers : sequence of callable
        Of the nodes, in the order in which they are made.

    Returns
    -------
    int
        Exit code as of `run_node`; where one of them has bad input none runs.
    """
    map_large_blocks()
    nodes, executor, running, ended, code = [], None, False, [], 0
    # rclpy's handlers shut the context down, and call those before them as well, which end a node
    # that imports (`telescope_mount.start`); an exception would fall into the middle of a record
    on_end(lambda *_: ended.append(True))
    try:
        check_open_files()
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        running = True
        for make in makers:
            nodes.append(make())
            nodes[-1].check_overrides()
        # what one may wait for, another beside it may not
        executor = NodeExecutor(gather=min(node.GATHER for node in nodes))
        for node in nodes:
            executor.add_node(node)
        # what is there now stays; of the little that comes after it a whole collection takes no
        # time, and by default would be due once in some hundred nights
        gc.freeze()
        gc.set_threshold(700, 2, 2)
        while not ended and rclpy.ok():
            executor.spin_once()  # a node has timers: it looks at itself ten times a second
        if ended:
            for node in nodes:
                getattr(node, 'before_end', lambda: None)()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ValueError, OSError) as err:
        code = _error(err)
    except RCLError as err:
        # else it was shut down while something was being made or published
        if not running or rclpy.ok():
            # of rcl's own text only the first sentence is for the user
            code = _error(f'{str(err).splitlines()[0].split(", at /")[0]}{_secured()}')
    except RuntimeError as err:
        if 'QoS override' not in str(err):
            raise
        code = _error(err)
    finally:
        if executor is not None:
            executor.shutdown()
        for node in nodes:
            try:
                node.finish()
            except OSError as err:
                code = max(code, _error(err, 1))
        with _turn():
            # Fast DDS may wait for ever while other nodes end too, and lets no Python run meanwhile
            # (github.com/eProsima/Fast-DDS, 6513): files are closed; the process ends, with code 1
            faulthandler.dump_traceback_later(LETS_GO, exit=True, file=2)
            for node in nodes:
                node.destroy_node()
            if executor is None:
                gc.collect()  # what was made of one that failed: it would stay in /dev/shm
            rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
        # while the interpreter is taken apart no handler is called any more
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)
    return code


@contextmanager
def _turn():
    """Wait, for `TURN` s at most, until no other process lets go of its nodes.

    Of processes that close a queue of Fast DDS at the same moment each may take the other for its
    user, and it stays in `/dev/shm`.
    """
    try:
        folder = os.open(FOLDER, os.O_RDONLY)
    except OSError:
        yield  # of another system
        return
    try:
        end = time.monotonic() + TURN
        while time.monotonic() < end:
            with suppress(BlockingIOError):
                fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(0.005)
        yield
    finally:
        os.close(folder)


def _error(err, code=2):
    """Say what is wrong; the exit code."""
    with suppress(OSError):  # the disk may be full that this goes to
        print(f'error: {err}', file=sys.stderr, flush=True)
    return code


def _secured():
    """Where to look if the node shall be secured, after a sentence that it cannot start."""
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return ''
    return ('; ROS_SECURITY_ENABLE is true: it needs a DDS with security, which the one from PyPI '
            'has not, and a keystore (SECURITY.md)')


def node_of(module):
    """The class of the node that a module, by its name, is for."""
    return next(item for item in vars(import_module(module)).values() if isinstance(item, type)
                and issubclass(item, MountNode) and item.__module__ == module)


def main():
    """Run the nodes of the modules that the first argument names."""
    nodes = [node_of(module) for module in sys.argv[1].split(',')]
    sys.exit(run_nodes(nodes) if len(nodes) > 1 else run_node(*nodes))


#: glibc's mallopt: from how many bytes on a block is its own map
_MMAP_THRESHOLD, _LARGE = -3, 128 * 1024


@cache
def _libc_function(name):
    try:
        return getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):
        return lambda *args: 0  # of glibc alone


def map_large_blocks():
    """Large blocks stay apart from the heap, and go when they are freed.

    By default the first that is freed moves the limit up, to 32 MB at most: messages that grow with
    the night then leave holes in the heap, each too small for the next.
    """
    _libc_function('mallopt')(_MMAP_THRESHOLD, _LARGE)


def give_back():
    """After work that took much: else the heap keeps its pages for more of it. About 1 ms."""
    _libc_function('malloc_trim')(0)


if __name__ == '__main__':
    main()
