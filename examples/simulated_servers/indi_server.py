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

"""Runs a private server with INDI's telescope simulator, for trials and tests."""

import shutil
import socket
import subprocess
import tempfile
import time
from pathlib import Path

from telescope_mount.bridges.indi.indi_telescope import SIMULATOR

SERVER = 'indiserver'
DEVICE = 'Telescope Simulator'


def missing():
    """What is not installed, in words; '' if nothing is missing."""
    lacking = [name for name in (SERVER, SIMULATOR) if shutil.which(name) is None]
    return f'no {" and no ".join(lacking)}: apt-get install indi-bin' if lacking else ''


class SimulatorServer:
    """Runs `indiserver` with the telescope simulator on a free port, as a context manager.

    Parameters
    ----------
    port : int, optional
        By default a free port.

    Attributes
    ----------
    port : int

    Raises
    ------
    OSError
        It is not installed, or does not listen.
    """

    def __init__(self, port=0):
        self.port = port
        self._process = self._home = None

    def __enter__(self):
        if missing():
            raise OSError(missing())
        if not self.port:
            with socket.socket() as probe:
                probe.bind(('127.0.0.1', 0))
                self.port = probe.getsockname()[1]
        # drivers keep settings in the home directory, where a user may have others
        self._home = self._home or tempfile.TemporaryDirectory()
        home = Path(self._home.name)
        with open(home / 'server.log', 'ab') as log:
            self._process = subprocess.Popen(
                # a second server on a machine also needs its own local socket
                [SERVER, '-p', str(self.port), '-u', str(home / 'socket'), SIMULATOR],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                env={'HOME': str(home), 'PATH': '/usr/local/bin:/usr/bin:/bin'})
        end = time.monotonic() + 10.0
        while True:
            try:
                socket.create_connection(('127.0.0.1', self.port), 1.0).close()
                return self
            except OSError:
                if self._process.poll() is not None or time.monotonic() > end:
                    self.__exit__()
                    raise OSError(f'{SERVER} does not listen on port {self.port}') from None
                time.sleep(0.05)  # polling: another process's port gives no event to wait for

    def stop(self):
        """End the server with its driver; the settings remain for the next start."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(5.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None

    def __exit__(self, *_):
        self.stop()
        if self._home is not None:
            self._home.cleanup()
            self._home = None
