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

"""A connection to an INDI server, maintained by its own thread.

indipyclient implements the protocol and reconnects after a loss. This module adds what callers
from other threads need: the last values of each property, waiting with a time limit, and errors
of one line.
"""

import asyncio
import concurrent.futures
import contextlib
import logging
import threading
import time
from dataclasses import dataclass

from ..connection import BridgeError

#: s of silence after which a server is polled, and the same again until it counts as lost
SILENCE = 2
#: s between checks whether the server has closed the connection, and before reconnecting
LOOK, AGAIN = 0.1, 0.5
#: s to wait for a property by default
PATIENCE = 10.0


class IndiError(BridgeError):
    """The server or the driver did not do what was requested; the text is one line."""


@dataclass(frozen=True)
class Vector:
    """Last values of a property.

    Attributes
    ----------
    values : dict of str to (float or str)
        By element: numbers as float, switches as ``On`` and ``Off``.
    state : str
        ``Idle``, ``Ok``, ``Busy`` or ``Alert``.
    received : int
        Time of reception, ns since 1970 by the clock of this machine.
    """

    values: dict
    state: str = ''
    received: int = 0

    @property
    def on(self):
        """Name of the switch that is on, '' for none."""
        return next((name for name, value in self.values.items() if value == 'On'), '')


class IndiClient:
    """A connection.

    Parameters
    ----------
    host : str
    port : int
    update : callable, optional
        ``update(device, name, vector)``, in the thread of the connection, for each property.
    connection : callable, optional
        ``connection(up)``: called when it is made or lost.
    blob : callable, optional
        ``blob(device, values, formats)``: bytes and their formats by name, for images that
        `enable_blobs` has requested.

    Attributes
    ----------
    connected : bool
    """

    def __init__(self, host, port, update=None, connection=None, blob=None):
        try:
            import indipyclient
        except ImportError:
            raise IndiError('the bridge to INDI needs the package indipyclient: '
                            './install.sh ros,indi') from None
        logger = logging.getLogger('indipyclient')
        logger.addHandler(logging.NullHandler())
        # its log messages are reported here in other ways, and by the callers
        logger.propagate = False
        self.host, self.port = host, port
        self.connected = self._closed = False
        self._update, self._connection, self._blob = update, connection, blob
        self._vectors, self._defined = {}, {}
        self._news = threading.Condition()
        self._loop = self._client = None
        bridge = self

        class Client(indipyclient.IPyClient):
            async def rxevent(self, event):
                vector = getattr(event, 'vector', None)
                if vector is not None and vector.timeout is None:
                    # vectors may have no timeout: indipyclient 0.9.4 compares it with numbers when
                    # an answer is due, fails, and drops the connection for 5 s
                    vector.timeout = 0.0
                bridge._take(event)

            async def hardware(self):
                # indipyclient notices a closed connection only when it sends
                while not self.stop:
                    await asyncio.sleep(LOOK)
                    reader = getattr(self, '_reader', None)
                    if reader is not None and reader.at_eof():
                        self.shutdown()

        self._make = lambda: Client(host, port)
        self._thread = threading.Thread(target=self._run, name=f'INDI {host}:{port}', daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.close()

    def start(self):
        """Start to connect; returns immediately."""
        self._thread.start()

    def close(self):
        """End the connection and its thread."""
        self._closed = True
        if self._client is not None:
            self._client.shutdown()
        if self._thread.is_alive():
            self._thread.join(5.0)

    def _run(self):
        async def work():
            self._loop = asyncio.get_running_loop()
            while not self._closed:
                self._client = self._make()
                self._client.set_vector_timeouts(timeout_min=1, timeout_max=SILENCE // 2)
                await self._client.asyncrun()
                if not self._closed:
                    await asyncio.sleep(AGAIN)

        asyncio.run(work())

    # --- what comes ---------------------------------------------------------------------------

    def _take(self, event):
        now = time.time_ns()
        kind, device, name = event.eventtype, event.devicename, event.vectorname
        if kind in ('ConnectionMade', 'ConnectionLost'):
            up = kind == 'ConnectionMade'
            with self._news:
                changed, self.connected = self.connected != up, up
                self._vectors.clear()
                self._news.notify_all()
            if changed and self._connection is not None:
                self._connection(up)
        elif kind in ('Define', 'Set') and event.vector.vectortype != 'BLOBVector':
            vector = Vector(_values(event.vector), event.vector.state, now)
            with self._news:
                self._vectors[device, name] = vector
                if kind == 'Define':
                    self._defined[device, name] = now
                self._news.notify_all()
            if self._update is not None:
                self._update(device, name, vector)
        elif kind == 'SetBLOB' and self._blob is not None:
            self._blob(device, dict(event), {
                member: form for member, (_, form) in event.sizeformat.items()})
        elif kind == 'Delete':
            with self._news:
                for key in [key for key in self._vectors
                            if key[0] == device and name in (None, key[1])]:
                    del self._vectors[key]
                self._news.notify_all()

    def get(self, device, name, default=None):
        """The `Vector` of a property, `default` if none was received."""
        with self._news:
            return self._vectors.get((device, name), default)

    def only(self, what, interface, timeout=PATIENCE):
        """Name of the only `what` on the server.

        Before it is connected it is identified by its driver's description: a bit of
        DRIVER_INTERFACE. IndiError if there is none, or there are several.
        """
        def found():
            return sorted(
                device for (device, name), vector in self._vectors.items() if name == 'DRIVER_INFO'
                and int(vector.values.get('DRIVER_INTERFACE', '0')) & interface)
        devices = self.wait(found, f'the server has no {what}', timeout)
        if len(devices) > 1:
            raise IndiError(f'several {what}s on the server: {", ".join(devices)}; choose one by '
                            'its name')
        return devices[0]

    def wait(self, condition, what, timeout=PATIENCE):
        """Wait until `condition` returns something true, and return that.

        Parameters
        ----------
        condition : callable
            Evaluated again after each message.
        what : str
            Description of the condition, for people.
        timeout : float
            s.

        Raises
        ------
        IndiError
            Not fulfilled in time.
        """
        end = time.monotonic() + timeout
        with self._news:
            while True:
                found = condition()
                if found:
                    return found
                left = end - time.monotonic()
                if left <= 0.0:
                    break
                self._news.wait(left)
        if not self.connected:
            raise IndiError(f'no INDI server answers at {self.host}:{self.port}: start indiserver '
                            'there, or give another address')
        raise IndiError(f'{what}: not within {timeout:g} s')

    def property(self, device, name, timeout=PATIENCE):
        """Like `get`, but waits for the property; IndiError if it does not arrive."""
        return self.wait(lambda: self._vectors.get((device, name)),
                         f'{device} does not send its property {name}', timeout)

    def settle(self, device, name, timeout):
        """Wait until a driver has defined all its properties.

        INDI does not mark the end of the definitions. The driver is asked for a property that it
        has, and works sequentially: so its answer follows everything that it sent before.

        Parameters
        ----------
        device, name : str
        timeout : float
            s; a missing answer is not an error.
        """
        sent = time.time_ns()
        with contextlib.suppress(IndiError, concurrent.futures.TimeoutError):
            self._await(self._client.send_getProperties(device, name), timeout)
            self.wait(lambda: self._defined.get((device, name), 0) > sent, '', timeout)

    def _await(self, work, timeout=PATIENCE):
        asyncio.run_coroutine_threadsafe(work, self._loop).result(timeout)

    # --- what is sent -------------------------------------------------------------------------

    def send(self, device, name, **members):
        """Request the driver to set a property.

        Parameters
        ----------
        device, name : str
        **members : float or str
            By element; omitted numbers keep their values.

        Raises
        ------
        IndiError
            There is no connection, or no such property or element.
        """
        vector = self.get(device, name)
        if vector is None or not self.connected:
            raise IndiError(f'{name} cannot be set: '
                            + (f'{device} has no such property' if self.connected else
                               f'the connection to {self.host}:{self.port} is lost'))
        unknown = set(members) - set(vector.values)
        if unknown:
            raise IndiError(f'{name} of {device} has no {", ".join(sorted(unknown))}')
        self._await(self._client.send_newVector(device, name, members={
            key: value if isinstance(value, str) else repr(float(value))
            for key, value in members.items()}))

    def enable_blobs(self, device):
        """Request the images of a device."""
        self._await(self._client.send_enableBLOB('Also', device))

    def switch(self, device, name, member):
        """Set a switch to on."""
        self.send(device, name, **{member: 'On'})


def _values(vector):
    numbers = vector.vectortype == 'NumberVector'
    return {name: vector.getfloatvalue(name) if numbers else vector[name] for name in vector}
