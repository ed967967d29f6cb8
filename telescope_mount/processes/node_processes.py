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

"""Node processes: start, watch, end."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from multiprocessing import Pipe, get_context
from pathlib import Path

import yaml

from msg_tools import NAMESPACE

from .. import ONE_THREAD
from ..dds import dds_environment
from .fork_server import preload, prepare, serve_forked
from .interrupt import raise_noted
from .parent import PARENT


class Node:
    """A forked node, with the needed part of the interface of `subprocess.Popen`.

    Attributes
    ----------
    pid : int
    returncode : int or None
        None while it runs.
    """

    def __init__(self, fork_server, pid):
        self._fork_server, self.pid, self.returncode = fork_server, pid, None

    def poll(self):
        """The exit code, or None."""
        if self.returncode is None:
            self._fork_server.listen(0.0)
        return self.returncode

    def wait(self, timeout):
        """The exit code; subprocess.TimeoutExpired after `timeout` seconds."""
        deadline = time.monotonic() + timeout
        while self.poll() is None:
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise subprocess.TimeoutExpired(f'process {self.pid}', timeout)
            self._fork_server.listen(left)
        return self.returncode

    def send_signal(self, number):
        """Send a signal, unless the process has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)


class _Forked(get_context('fork').Process):
    """A fork of this process, with the needed part of the interface of `subprocess.Popen`."""

    def poll(self):
        """The exit code, or None."""
        return self.exitcode

    def wait(self, timeout=None):
        """The exit code; subprocess.TimeoutExpired after `timeout` seconds."""
        self.join(timeout)
        if self.exitcode is None:
            raise subprocess.TimeoutExpired(f'process {self.pid}', timeout)
        return self.exitcode


def _can_fork():
    """Whether this process can be forked safely: ROS was not used in it, and its only threads are
    timers of the progress line.
    """
    threads = threading.enumerate()
    return ('rclpy' not in sys.modules and threading.current_thread() is threading.main_thread()
            and all(isinstance(thread, threading.Timer) for thread in threads[1:])
            and len(os.listdir('/proc/self/task')) == len(threads))


class ForkServer:
    """The process `telescope_mount.processes.fork_server`, which forks the nodes.

    Parameters
    ----------
    log : Path
        File for its error messages.
    modules : sequence of str, optional
        Modules that this process needs, and nodes as well.
    """

    def __init__(self, log, modules=()):
        self._log = log
        self._connection, theirs = Pipe()
        with theirs:
            self._process = self._forked(theirs, modules) if _can_fork() else self._begun(theirs)
        self._nodes = {}
        self._started = []

    def _forked(self, theirs, modules):
        """Fork it from here: this process needs the same imports."""
        preload()
        prepare(modules)
        process = _Forked(target=serve_forked, args=(theirs, self._connection, self._log),
                          daemon=True)
        with warnings.catch_warnings():
            # the warning is about locks held by threads: the child uses none of them
            warnings.simplefilter('ignore', DeprecationWarning)
            process.start()
        return process

    def _begun(self, theirs):
        """Start it as a program: it imports while the caller works."""
        with open(self._log, 'ab') as file:
            return subprocess.Popen(
                [sys.executable, '-m', f'{__package__}.fork_server', str(theirs.fileno())],
                stdin=subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True,
                pass_fds=[theirs.fileno()],
                env={**os.environ, **ONE_THREAD, 'PYTHONUNBUFFERED': '1'})

    def start(self, **request):
        """Fork a node; see `telescope_mount.processes.fork_server`.

        Returns
        -------
        Node

        Raises
        ------
        RuntimeError
            It could not be started.
        """
        with contextlib.suppress(BrokenPipeError):
            self._connection.send(request)
        while not self._started:
            self.listen(1.0)
            raise_noted()  # the server may be stopped
            if self._process.poll() is not None and not self._started:
                words = self._log.read_text(errors='replace').strip().split('\n')[-1]
                raise RuntimeError(f'nodes cannot be started: {words.removeprefix("error: ")}')
        return self._started.pop()

    def listen(self, timeout):
        """Process answers, waiting at most `timeout` seconds for the first."""
        try:
            while self._connection.poll(timeout):
                self._take(self._connection.recv())
                timeout = 0.0
        except (EOFError, ConnectionResetError):
            self._lost()

    def _take(self, answer):
        if 'started' in answer:
            pid = answer['started']
            self._nodes[pid] = Node(self, pid)
            self._started.append(self._nodes[pid])
        elif answer.get('ended') in self._nodes:
            self._nodes.pop(answer['ended']).returncode = answer['code']

    def _lost(self):
        """The server has ended: remaining nodes were told to end, and their codes are unknown."""
        for pid in list(self._nodes):
            if not os.path.exists(f'/proc/{pid}'):
                self._nodes.pop(pid).returncode = -signal.SIGTERM
        if self._nodes:
            time.sleep(0.01)  # cannot wait: they are not our children

    def go_on(self):
        """Resume it if it is stopped (SIGSTOP): it reports the ends of nodes."""
        if self._process.poll() is None:
            os.kill(self._process.pid, signal.SIGCONT)

    def close(self):
        """End the server; the nodes must have ended."""
        self._connection.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5.0)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()


def _is_stopped(pid):
    with contextlib.suppress(OSError):  # it has ended
        # the state follows the name, which may have any characters
        return Path(f'/proc/{pid}/stat').read_bytes().rpartition(b')')[2].split()[0] in b'Tt'
    return False


class Processes:
    """The processes of the nodes of a graph.

    Parameters
    ----------
    folder : Path
        Folder for the output and the parameter file of each node.
    domain : int
        ROS domain.
    params_file : Path, optional
        The user's ROS parameter file, read after the graph's own values.
    modules : sequence of str, optional
        Modules that this process needs, and nodes as well: imported once if it can be forked.
    """

    def __init__(self, folder, domain, params_file=None, modules=()):
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.params_file = params_file
        self.running, self._checked, self._looked, self._stopped = {}, 0.0, 0.0, {}
        self.environment = (ONE_THREAD | os.environ | dds_environment(domain)
                            | {'ROS_LOG_DIR': str(self.folder)})
        self._fork_server = ForkServer(self.folder / 'fork_server.log', modules)

    def start_all(self, specs):
        """Start all `graph.NodeSpec`; those with the same `process` share one.

        Raises
        ------
        KeyboardInterrupt
            A signal arrived, within `interrupt.noted`.
        """
        groups = {}
        for spec in specs:
            groups.setdefault(spec.process or spec.name, []).append(spec)
        for name, group in groups.items():
            raise_noted()
            self._start(name, group)

    def start(self, spec):
        """Start a `graph.NodeSpec` in its own process."""
        self._start(spec.name, [spec])

    def _start(self, name, specs):
        for spec in specs:
            self._params_of(spec).write_text(yaml.safe_dump(
                {spec.full_name: {'ros__parameters': spec.parameters}}))
        self.running[name] = self._fork_server.start(
            name=name, modules=[spec.module for spec in specs],
            # rcl refuses an empty file
            arguments=self._arguments(*(self._params_of(spec) for spec in specs
                                        if spec.parameters)),
            environment=self.environment, log=str(self.folder / f'{name}.log'))

    def _params_of(self, spec):
        return self.folder / f'{spec.name}.params.yaml'

    def _arguments(self, *files):
        """The namespace, and parameter files; the user's file is the last."""
        files = filter(None, (*files, self.params_file))
        return ['--ros-args', '-r', f'__ns:={NAMESPACE}',
                *(word for file in files for word in ('--params-file', str(file)))]

    def start_script(self, path):
        """Start a driver: the user's Python file, in the same namespace, with the user's values."""
        path = Path(path)
        with open(self.folder / f'{path.stem}.log', 'ab') as log:
            self.running[path.stem] = subprocess.Popen(
                [sys.executable, '-m', f'{__package__}.parent', str(path), *self._arguments()],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
                env={**self.environment, 'PYTHONUNBUFFERED': '1', PARENT: str(os.getpid())})

    def last_words(self, name):
        """The last line of a node's output that is not a log message; '' for none."""
        try:
            lines = (self.folder / f'{name}.log').read_text(errors='replace').split('\n')
        except OSError:
            return ''
        return next((line.strip() for line in reversed(lines)
                     if line.strip() and not line.startswith(('[INFO]', '[WARN]', '[DEBUG]'))), '')

    def stopped(self):
        """Names and ids of processes that are stopped (SIGSTOP), a dict; checks twice a second."""
        now = time.monotonic()
        if now - self._looked >= 0.5:
            self._looked = now
            self._stopped = {name: process.pid for name, process in self.running.items()
                             if _is_stopped(process.pid)}
        return self._stopped

    def check(self):
        """Raise RuntimeError with a node's message if one has ended; checks ten times a second."""
        now = time.monotonic()
        if now - self._checked < 0.1:
            return
        self._checked = now
        for name, process in self.running.items():
            code = process.poll()
            if code is not None:
                words = self.last_words(name).removeprefix('error: ')
                raise RuntimeError(words or f'node {name} ended with code {code}')

    def stop(self):
        """End all nodes: SIGINT first, so that files are closed; then SIGTERM and SIGKILL.

        A process that is stopped (SIGSTOP) is resumed, to close its files.

        Returns
        -------
        dict of str to int
            Exit codes.
        """
        self._fork_server.go_on()
        for sign, seconds in ((signal.SIGINT, 20.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 5.0)):
            alive = [process for process in self.running.values() if process.poll() is None]
            for process in alive:
                process.send_signal(sign)
                process.send_signal(signal.SIGCONT)
            deadline = time.monotonic() + seconds
            for process in alive:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.01, deadline - time.monotonic()))
        codes = {name: process.returncode for name, process in self.running.items()}
        self.running.clear()
        self._fork_server.close()
        return codes
