"""A process that has imported everything, and forks one node after the other.

Eight interpreters that each import numpy, rclpy and the messages take longer than a short night.
Requests come on stdin, a JSON object a line: module, arguments, name, environment, file for the
output. Answers go to stdout: ``{"started": pid}``, later ``{"ended": pid, "code": code}``.
"""

import ctypes
import json
import os
import selectors
import signal
import socket
import sys
from contextlib import suppress
from importlib import import_module

# Linux: prctl
_SET_DEATH_SIGNAL, _SET_NAME = 1, 15


def preload():
    """Import what the nodes need; nothing that opens a file, a socket or a thread."""
    import rclpy
    from rclpy.type_support import check_for_type_support

    from msg_tools import topics

    from .graph import NODES
    for module in NODES.values():
        # a node that cannot be imported says so itself, when it is started
        with suppress(ImportError):
            import_module(module)
    for topic in topics.ALL:
        check_for_type_support(topic.message)
    rclpy.get_rmw_implementation_identifier()  # loads DDS


def run_node(request):
    """In the forked child: become the node, and end as any interpreter does."""
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
        code = _call_main(request['module'])
    except Exception:
        import traceback
        traceback.print_exc()
    sys.exit(code)


def _call_main(module):
    try:
        import_module(module).main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def _reap(answer):
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if pid == 0:
            return
        answer({'ended': pid, 'code': os.waitstatus_to_exitcode(status)})


def main():
    """Serve until stdin ends."""
    ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    preload()
    # signals wake the loop through a socket: no handler runs in the middle of a fork
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    theirs.setblocking(False)
    signal.set_wakeup_fd(theirs.fileno())
    signal.signal(signal.SIGCHLD, lambda *_: None)
    # nodes must not write among the answers
    out = os.fdopen(os.dup(1), 'w', buffering=1)
    os.dup2(2, 1)

    def answer(document):
        out.write(json.dumps(document) + '\n')

    requests = os.fdopen(os.dup(0), 'rb', buffering=0)
    loop = selectors.DefaultSelector()
    loop.register(requests, selectors.EVENT_READ)
    loop.register(ours, selectors.EVENT_READ)
    nursery = os.getpid()
    answer({'ready': nursery})
    pending = b''
    while True:
        for key, _ in loop.select():
            if key.fileobj is ours:
                ours.recv(4096)
                _reap(answer)
                continue
            chunk = os.read(requests.fileno(), 1 << 16)
            if not chunk:
                return
            *lines, pending = (pending + chunk).split(b'\n')
            for line in lines:
                pid = os.fork()
                if pid == 0:
                    signal.set_wakeup_fd(-1)
                    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                    signal.signal(signal.SIGINT, signal.default_int_handler)
                    for end in (loop, requests, out, ours, theirs):
                        end.close()
                    run_node({**json.loads(line), 'parent': nursery})
                answer({'started': pid})


if __name__ == '__main__':
    main()
