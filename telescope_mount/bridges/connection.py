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

"""The connection to a server: its address, and repeated attempts until it is there."""

import threading

#: default port by protocol: registered for INDI, customary for Alpaca
PORTS = {'indi': 7624, 'alpaca': 11111}
#: s between two attempts
RETRY = 3.0


class BridgeError(RuntimeError):
    """The server or the driver did not do what was requested; the text is one line."""


def parse_address(text, protocol='indi'):
    """Host and port of ``indi:HOST[:PORT]``, or of another protocol.

    Parameters
    ----------
    text : str
    protocol : str
        One of `PORTS`.

    Returns
    -------
    host : str
    port : int

    Raises
    ------
    ValueError
        Not such an address.
    """
    kind, _, rest = text.partition(':')
    host, _, port = rest.partition(':')
    port = port or str(PORTS[protocol])
    if kind != protocol or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        name = {'indi': 'INDI', 'alpaca': 'Alpaca'}[protocol]
        raise ValueError(f'{text!r} is no {name} server; write {protocol}:HOST or {protocol}:HOST:'
                         f'PORT, for instance {protocol}:localhost:{PORTS[protocol]}')
    return host, int(port)


class Reconnection:
    """Calls a function again `retry` seconds after it has ended, or at once when woken.

    Parameters
    ----------
    attempt : callable
        Function; its BridgeError, ValueError or OSError is the reason of a failure.
    failed : callable
        ``failed(sentence)``, called after each failure.
    retry : float
        s.

    Attributes
    ----------
    closed : bool
        Whether no more attempts are made.
    """

    def __init__(self, attempt, failed, retry=RETRY):
        self._attempt, self._failed, self._retry = attempt, failed, retry
        self._wake, self.closed = threading.Event(), False

    def start(self):
        """Begin; returns at once."""
        threading.Thread(target=self._run, daemon=True).start()

    def close(self):
        """End it after the current attempt."""
        self.closed = True
        self.wake()

    def wake(self):
        """Try at once."""
        self._wake.set()

    def pause(self, seconds):
        """Wait so long, or until woken."""
        self._wake.wait(seconds)
        self._wake.clear()

    def _run(self):
        while not self.closed:
            try:
                self._attempt()
            except (BridgeError, ValueError, OSError) as err:
                self._failed(str(err))
            self.pause(self._retry)
