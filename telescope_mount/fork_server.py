"""A process that has imported everything, and forks one node after the other.

Eight interpreters that each import numpy, rclpy and the messages take longer than a short night.
Requests come on the connection whose file descriptor is its argument, a dict each: module,
arguments, name, environment, file for the output, and further modules to import before. It answers
``{'started': pid}``, later ``{'ended': pid, 'code': code}``.
"""

import ctypes
import gc
import inspect
import os
import signal
import sys
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection, wait

# Linux: prctl
_SET_DEATH_SIGNAL, _SET_NAME = 1, 15


def preload():
    """Import what all nodes need; nothing that opens a file, a socket or a thread."""
    import rclpy
    from rclpy.type_support import check_for_type_support

    from msg_tools import running, topics  # noqa: F401
    for topic in topics.ALL:
        check_for_type_support(topic.message)
    rclpy.get_rmw_implementation_identifier()  # loads DDS
    # a node's first line of log asks which module is in which file: of all modules
    inspect.getframeinfo(inspect.currentframe())


def prepare(modules):
    """Import what a node needs: the next one of its kind begins at once."""
    for module in modules:
        # one that cannot be imported says so itself, when it is started
        with suppress(ImportError):
            import_module(module)
    gc.collect()
    gc.freeze()  # a node's collector would copy the pages of what all share


def run_node(request):
    """In the forked child: become the node, and end with its exit code."""
    code = 1
    try:
        os.setsid()
        libc = ctypes.CDLL(None)
        libc.prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)  # no node outlives its graph
        if os.getppid() != request['parent']:
            sys.exit(-signal.SIGTERM)  # it died before that
        libc.prctl(_SET_NAME, request['name'].encode()[:15])
        log = os.open(request['log'], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        null = os.open(os.devnull, os.O_RDONLY)
        for number, source in enumerate((null, log, log)):
            os.dup2(source, number)
        os.environ.clear()
        os.environ.update(request['environment'])
        sys.argv = [request['module'], *request['arguments']]
        import_module(request['module']).main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except Exception:
        import traceback
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    # all is destroyed; to take the interpreter apart copies each page shared with the others, 0.2 s
    os._exit(code)


def main():
    """Serve until the other end of the connection is closed."""
    ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    preload()
    connection = Connection(int(sys.argv[1]))
    fork_server = os.getpid()
    nodes = {}  # read end of a pipe whose other end closes with the node -> pid
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
            prepare([request['module'], *request.get('also', ())])
            alive, end = os.pipe()
            pid = os.fork()
            if pid == 0:
                signal.signal(signal.SIGINT, signal.default_int_handler)
                connection.close()
                run_node({**request, 'parent': fork_server})
            os.close(end)
            nodes[alive] = pid
            connection.send({'started': pid})


if __name__ == '__main__':
    main()
