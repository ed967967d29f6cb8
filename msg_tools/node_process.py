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

"""Runs nodes until a signal: one per process, or several in one.

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
from rclpy.utilities import remove_ros_args

from .executor import NodeExecutor
from .node import MountNode
from .open_files import check_open_files
from .signals import ENDING, on_end

#: most s that DDS may take to destroy ended nodes
LETS_GO = 12.0
#: most s that a process waits for others to destroy their nodes
TURN = 4.0
#: folder of the queues of Fast DDS
FOLDER = '/dev/shm'
#: what to do about words that a node does not take
USAGE = 'write --ros-args -p PARAMETER:=VALUE --params-file FILE'


def run_node(make_node):
    """Run a node until Ctrl-C, SIGTERM, SIGHUP or shutdown.

    Parameters
    ----------
    make_node : callable
        Returns the node; its class if ``--help`` shall work; raises ValueError or OSError with one
        line for invalid input. A class may have ``before_end(node)``, which is called after a
        signal, while its topics still work.

    Returns
    -------
    int
        Exit code: 0 after a clean end, 1 if a file of the node is incomplete, 2 for invalid input.
    """
    if isinstance(make_node, type):
        try:
            words = remove_ros_args()[1:]
        except RuntimeError as err:
            # only the first sentence of rcl's own text is for the user
            return _error(f"{str(err).split(', at /')[0].strip('[]')}; {USAGE}")
        if '-h' in words or '--help' in words:
            from .node_help import node_help
            print(node_help(make_node), end='')
            return 0
        if words:
            return _error(f'{" ".join(words)} would be ignored; {USAGE}')
    return run_nodes([make_node])


def run_nodes(makers):
    """Run nodes in this process with one executor for all; see `run_node`.

    Parameters
    ----------
    makers : sequence of callable
        Functions that create the nodes, in this order.

    Returns
    -------
    int
        See `run_node`; if one of them has invalid input, none runs.
    """
    map_large_blocks()
    nodes, executor, running, ended, code = [], None, False, [], 0
    # the handlers of rclpy shut the context down and also call the previous handlers, which end a
    # node during imports (`telescope_mount.start`); an exception could interrupt writing a record
    on_end(lambda *_: ended.append(True))
    try:
        check_open_files()
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        running = True
        for make in makers:
            nodes.append(make())
            nodes[-1].check_overrides()
        # a delay that is fine for one node may not be for another
        executor = NodeExecutor(gather=min(node.GATHER for node in nodes))
        for node in nodes:
            executor.add_node(node)
        # keep what exists now out of garbage collection: little is created later, so a full
        # collection takes no time; by default one would run once in some hundred nights
        gc.freeze()
        gc.set_threshold(700, 2, 2)
        while not ended and rclpy.ok():
            executor.spin_once()  # returns often: a node has timers, ten times a second
        if ended:
            for node in nodes:
                getattr(node, 'before_end', lambda: None)()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ValueError, OSError) as err:
        code = _error(err)
    except RCLError as err:
        # else the shutdown came while something was being created or published
        if not running or rclpy.ok():
            # only the first sentence of rcl's own text is for the user
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
            # Fast DDS may wait forever while other nodes end too, and blocks Python meanwhile
            # (github.com/eProsima/Fast-DDS, 6513): files are closed; the process ends, with code 1
            faulthandler.dump_traceback_later(LETS_GO, exit=True, file=2)
            for node in nodes:
                node.destroy_node()
            if executor is None:
                gc.collect()  # parts of a node that failed would stay in /dev/shm
            rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
        # no handler is called any more during interpreter shutdown
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)
    return code


@contextmanager
def _turn():
    """Wait, for at most `TURN` s, until no other process destroys its nodes.

    If processes close a queue of Fast DDS at the same moment, each may take the other for its
    user, and the queue stays in `/dev/shm`.
    """
    try:
        folder = os.open(FOLDER, os.O_RDONLY)
    except OSError:
        yield  # another operating system
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
    """Print an error; return the exit code."""
    with suppress(OSError):  # standard error may go to a full disk
        print(f'error: {err}', file=sys.stderr, flush=True)
    return code


def _secured():
    """Hint for a secured node, appended to the sentence that it cannot start."""
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return ''
    return ('; ROS_SECURITY_ENABLE is true: it needs a DDS with security, which the one from PyPI '
            'has not, and a keystore (SECURITY.md)')


def node_of(module):
    """The node class of a module, given by its name."""
    return next(item for item in vars(import_module(module)).values() if isinstance(item, type)
                and issubclass(item, MountNode) and item.__module__ == module)


def main():
    """Run the nodes of the modules in the first argument."""
    nodes = [node_of(module) for module in sys.argv.pop(1).split(',')]
    sys.exit(run_nodes(nodes) if len(nodes) > 1 else run_node(*nodes))


#: glibc's mallopt: size above which a block gets its own memory map
_MMAP_THRESHOLD, _LARGE = -3, 128 * 1024


@cache
def _libc_function(name):
    try:
        return getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):
        return lambda *args: 0  # only in glibc


def map_large_blocks():
    """Keep large blocks apart from the heap, so that they are returned when freed.

    By default, freeing the first one raises the threshold, to 32 MB at most: messages that grow
    during the night then leave holes in the heap, each too small for the next message.
    """
    _libc_function('mallopt')(_MMAP_THRESHOLD, _LARGE)


def give_back():
    """Return free heap memory after large tasks: else the heap keeps it for later. About 1 ms."""
    _libc_function('malloc_trim')(0)


if __name__ == '__main__':
    main()
