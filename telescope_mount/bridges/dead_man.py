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

"""Stops a mount whose commander has died: a separate process, which needs only Python.

A driver goes to the place it was sent and tracks there, even if the commander dies. So a commander
has this process beside it, and regularly writes to its input: `ARMED` or `SAFE`. If the input
ends, or nothing comes for `SILENCE` seconds, while it is armed, it stops the mount at the
server through its own connection, and again if the driver reports that it tracks again.

    python -I -S dead_man.py KIND HOST PORT DEVICE [SILENCE]
"""

import contextlib
import os
import re
import select
import signal
import socket
import subprocess
import sys
import time

ARMED, SAFE = b'1', b'0'
#: kinds of servers
INDI, ALPACA = 'indi', 'alpaca'
#: s; an Alpaca server may take a second to answer an order, an INDI server does not
SILENCE = {INDI: 1.0, ALPACA: 3.0}
#: s between attempts if the server does not answer, and until giving up
AGAIN, LONGEST = 0.5, 30.0
#: number of stop orders, and the most if the driver tracks again
TIMES, MOST = 4, 20
#: reports of INDI drivers whether they track
_TRACKS = re.compile(rb'<setSwitchVector[^>]*"TELESCOPE_TRACK_STATE".*?</setSwitchVector>', re.S)
_ON = re.compile(rb'"TRACK_ON"[^>]*>\s*On\s*<')
_STOP = ''.join(
    f'<newSwitchVector device="{{device}}" name="{name}"><oneSwitch name="{member}">On</oneSwitch>'
    '</newSwitchVector>\n' for name, member in (
        ('TELESCOPE_ABORT_MOTION', 'ABORT'), ('TELESCOPE_TRACK_STATE', 'TRACK_OFF')))


class DeadMan:
    """Starts the process, and signals that all is well.

    Parameters
    ----------
    host : str
    port : int
    device : str
        For an Alpaca server its number.
    silence : float, optional
        See `watch`; by default that of the kind.
    kind : {'indi', 'alpaca'}
    """

    def __init__(self, host, port, device, silence=None, kind=INDI):
        self._process = subprocess.Popen(
            [sys.executable, '-I', '-S', __file__, kind, host, str(port), device,
             str(silence or SILENCE[kind])],
            stdin=subprocess.PIPE, start_new_session=True)
        os.set_blocking(self._process.stdin.fileno(), False)

    def signal(self, armed):
        """Send whether to stop the mount if signals cease; False if the process has ended."""
        try:
            os.write(self._process.stdin.fileno(), ARMED if armed else SAFE)
        except BlockingIOError:
            pass
        except OSError:
            return False
        return self._process.poll() is None

    def close(self):
        """End it; the last signal still counts, even without its sender."""
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)


def stop(kind, host, port, device):
    """Stop the mount; return whether the server has accepted it."""
    end = time.monotonic() + LONGEST
    while time.monotonic() < end:
        try:
            (_stop_alpaca if kind == ALPACA else _stop_indi)(host, port, device)
            return True
        except OSError:
            time.sleep(AGAIN)  # polling: another machine's port gives no event to wait for
    return False


def _stop_indi(host, port, device):
    name = device.replace('&', '&amp;').replace('"', '&quot;').replace('<', '&lt;')
    with socket.create_connection((host, port), 2.0) as connection:
        connection.sendall(f'<getProperties version="1.7" device="{name}"/>\n'.encode())
        # an aborted slew may still end in tracking: send again, several times
        sent, due, received = 0, 0.0, b''
        connection.settimeout(0.05)
        end = time.monotonic() + TIMES * AGAIN
        while time.monotonic() < end:
            if time.monotonic() >= due and sent < MOST:
                connection.sendall(_STOP.format(device=name).encode())
                sent, due = sent + 1, time.monotonic() + AGAIN
            with contextlib.suppress(TimeoutError):
                data = connection.recv(65536)
                if not data:
                    return
                received, taken = received + data, 0
                for state in _TRACKS.finditer(received):
                    taken = state.end()
                    if _ON.search(state[0]):
                        due = 0.0
                received = received[taken:][-4096:]


def _stop_alpaca(host, port, device):
    from http.client import HTTPConnection
    for n in range(TIMES):
        for order, body in (('abortslew', ''), ('tracking', 'Tracking=False&')):
            connection = HTTPConnection(host, port, timeout=2.0)
            with contextlib.closing(connection):
                connection.request('PUT', f'/api/v1/telescope/{device}/{order}',
                                   f'{body}ClientID=65000&ClientTransactionID=1',
                                   {'Content-Type': 'application/x-www-form-urlencoded'})
                connection.getresponse().read()
        if n < TIMES - 1:
            time.sleep(AGAIN)  # polling: nothing reports when a driver tracks again


def watch(stream, kind, host, port, device, silence=SILENCE[INDI]):
    """Listen until the input ends; stop the mount if it ends, or is silent, while armed."""
    armed = False
    while True:
        ready, _, _ = select.select([stream], [], [], silence if armed else None)
        words = os.read(stream, 4096) if ready else b''
        if words:
            armed = words[-1:] == ARMED
            continue
        if armed:
            why = 'has died' if ready else f'is silent for {silence:g} s'
            done = stop(kind, host, port, device)
            print(f'the process that commanded the mount {why}: {device} '
                  + ('is stopped' if done else f'may still move: nobody answers at {host}:{port}'),
                  file=sys.stderr, flush=True)
            armed = False
        if ready:
            return


if __name__ == '__main__':
    # Ctrl-C is meant for the commander alone
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    watch(0, *sys.argv[1:3], int(sys.argv[3]), sys.argv[4], *map(float, sys.argv[5:]))
