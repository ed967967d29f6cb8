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

"""A process that has imported what all nodes need, and forks one node after the other.

Importing numpy, rclpy and the messages in eight interpreters takes longer than a short night: one
of 30 stars takes 1.3 times the processor time and 0.8 s more without this (4.5 instead of 3.4 s).
It becomes unnecessary when an interpreter with rclpy starts in 0.1 s.

Requests arrive on the connection whose file descriptor is its argument, each a dict: modules
of nodes, arguments, name, environment, file for the output. It answers
``{'started': pid}``, later ``{'ended': pid, 'code': code}``. A command that has not used ROS yet
forks it from itself; otherwise it is a separate program.
"""

import ctypes
import gc
import inspect
import os
import signal
import sys
from contextlib import contextmanager, suppress
from importlib import import_module
from multiprocessing.connection import Connection, wait

from msg_tools.signals import ENDING, on_end

# Linux: prctl
_SET_DEATH_SIGNAL, _SET_NAME = 1, 15


@contextmanager
def _kept():
    """Keep objects made within from the garbage collector, which would otherwise copy memory pages
    shared with the nodes.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@_kept()
def preload():
    """Import what all nodes need, but nothing that opens a file, a socket or a thread."""
    import rclpy
    from rclpy.type_support import check_for_type_support

    from msg_tools import topics
    for topic in topics.ALL:
        check_for_type_support(topic.message)
    rclpy.get_rmw_implementation_identifier()  # loads DDS
    # the first log line of a node looks up the file of every module: cache this
    inspect.getframeinfo(inspect.currentframe())


@_kept()
def prepare(modules):
    """Import modules of nodes."""
    for module in modules:
        # a failing import is reported by the node itself when it starts
        with suppress(ImportError):
            import_module(module)


def run_node(request):
    """In the forked child: become the node, and end with its exit code."""
    code = 1
    try:
        # a request to end during imports is obeyed silently
        on_end(lambda *_: os._exit(0))
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        os.setsid()
        libc = ctypes.CDLL(None)
        libc.prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)  # no node outlives its graph
        if os.getppid() != request['parent']:
            sys.exit(-signal.SIGTERM)  # the server died before prctl
        libc.prctl(_SET_NAME, request['name'].encode()[:15])
        _redirect(request['log'])
        os.environ.clear()
        os.environ.update(request['environment'])
        prepare(request['modules'])
        from msg_tools import node_process
        sys.argv = [request['name'], ','.join(request['modules']), *request['arguments']]
        node_process.main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except Exception:
        import traceback
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    # everything is destroyed; tearing down the interpreter would copy shared pages, 0.2 s
    os._exit(code)


def main():
    """Serve as a program."""
    serve(Connection(int(sys.argv[1])))


def serve_forked(connection, others, log):
    """Serve as a fork of a command; `others` is its end, `log` the file for errors."""
    for number in ENDING:
        signal.signal(number, signal.SIG_DFL)
    others.close()
    os.setsid()
    _redirect(log)
    # new streams: a thread of the command may have been writing to the old ones
    sys.stdin = os.fdopen(0, encoding='utf-8', closefd=False)
    sys.stdout, sys.stderr = (os.fdopen(
        number, 'w', encoding='utf-8', errors='backslashreplace', buffering=1, closefd=False)
        for number in (1, 2))
    serve(connection)


def _redirect(log):
    """Send both outputs to a file, and close the input."""
    log = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    null = os.open(os.devnull, os.O_RDONLY)
    for number, source in enumerate((null, log, log)):
        os.dup2(source, number)


def serve(connection):
    """Serve until the other end of the connection is closed."""
    libc = ctypes.CDLL(None)
    libc.prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)
    libc.prctl(_SET_NAME, b'fork_server')
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    preload()
    fork_server = os.getpid()
    nodes = {}  # read end of a pipe that closes when the node ends -> pid
    seen = set()
    while True:
        for source in wait([connection, *nodes]):
            if source is not connection:
                os.close(source)
                pid, status = os.waitpid(nodes.pop(source), 0)
                connection.send({'ended': pid, 'code': os.waitstatus_to_exitcode(status)})
                continue
            try:
                request = connection.recv()
            except EOFError:
                return
            # a group of modules, or one requested again, will be needed by others, too: import it
            # here. Otherwise the node imports its own, in parallel with those that follow
            if len(request['modules']) > 1 or seen.issuperset(request['modules']):
                prepare(request['modules'])
            seen.update(request['modules'])
            alive, end = os.pipe()
            # signals sent to a node before it handles them are blocked, not lost
            signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
            pid = os.fork()
            if pid == 0:
                connection.close()
                run_node({**request, 'parent': fork_server})
            signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
            os.close(end)
            nodes[alive] = pid
            connection.send({'started': pid})


if __name__ == '__main__':
    main()
