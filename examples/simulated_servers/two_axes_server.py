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

"""Parts of an INDI server that a telescope needs, for a `TwoAxes`: to try an alt-azimuth mount.

INDI's simulator has no such mount: set to ALTAZ, version 1.9.9 reports hour angle and declination,
and goes through the pole.
"""

import contextlib
import socket
import threading
from xml.etree.ElementTree import ParseError, XMLPullParser

from msg_tools.units import DEG
from telescope_mount.bridges.axes_and_places import HOUR
from telescope_mount.bridges.indi.indi_telescope import TWO_AXES

DEVICE = 'Two-Axis Simulator'
#: s between readings
EVERY = 0.1
SWITCHES = {'CONNECTION': ('CONNECT', 'DISCONNECT'), 'ON_COORD_SET': ('TRACK', 'SLEW', 'SYNC'),
            'TELESCOPE_ABORT_MOTION': ('ABORT',), 'TELESCOPE_PARK': ('PARK', 'UNPARK'),
            'TELESCOPE_TRACK_STATE': ('TRACK_ON', 'TRACK_OFF'),
            'MOUNT_TYPE': ('ALTAZ', 'EQ_FORK', 'EQ_GEM')}


class TwoAxesServer:
    """Serves any number of clients, as a context manager.

    Parameters
    ----------
    telescope : two_axes.TwoAxes
        Of an alt-azimuth mount.
    port : int
        By default a free port.

    Attributes
    ----------
    port : int
    """

    def __init__(self, telescope, port=0):
        self._telescope = telescope
        self._on = {'CONNECTION': 'CONNECT', 'ON_COORD_SET': 'TRACK', 'MOUNT_TYPE': 'ALTAZ',
                    'TELESCOPE_PARK': 'UNPARK', 'TELESCOPE_ABORT_MOTION': ''}
        self._socket = socket.create_server(('127.0.0.1', port))
        self.port = self._socket.getsockname()[1]
        self._clients, self._over, self._lock = [], threading.Event(), threading.Lock()

    def __enter__(self):
        for work in (self._accept, self._publish):
            threading.Thread(target=work, daemon=True).start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        for client in list(self._clients):
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    # --- what is told -------------------------------------------------------------------------

    def _numbers(self):
        telescope = self._telescope
        axes, believed, true = telescope.look()
        moves = 'Busy' if telescope.slewing else 'Ok' if telescope.tracking else 'Idle'
        return [('HORIZONTAL_COORD', 'Ok', {'AZ': axes[0] / DEG, 'ALT': axes[1] / DEG}),
                ('EQUATORIAL_EOD_COORD', moves, _place(('RA', 'DEC'), believed)),
                ('EQUATORIAL_PE', 'Ok', _place(('RA_PE', 'DEC_PE'), true))]

    def _switch(self, name):
        on = self._on.get(name)
        if name == 'TELESCOPE_TRACK_STATE':
            on = 'TRACK_ON' if self._telescope.tracking else 'TRACK_OFF'
        return {member: 'On' if member == on else 'Off' for member in SWITCHES[name]}

    def _all(self):
        site = self._telescope.site
        there = {'LAT': site.latitude / DEG, 'LONG': site.longitude / DEG % 360.0,
                 'ELEV': site.height}
        return ''.join(
            [f'<defTextVector device="{DEVICE}" name="DRIVER_INFO" state="Ok" perm="ro">'
             '<defText name="DRIVER_INTERFACE">1</defText>'
             f'<defText name="DRIVER_EXEC">{TWO_AXES}</defText></defTextVector>',
             *(_vector('def', 'Switch', name, 'Ok', self._switch(name)) for name in SWITCHES),
             _vector('def', 'Number', 'GEOGRAPHIC_COORD', 'Ok', there),
             *(_vector('def', 'Number', *row) for row in self._numbers())])

    def _publish(self):
        tracked = None
        while not self._over.wait(EVERY):
            numbers = self._numbers()
            text = ''.join(_vector('set', 'Number', *row) for row in numbers)
            if tracked != (tracked := self._telescope.tracking):
                text += self._switch_vector('TELESCOPE_TRACK_STATE')
            self._send(text)

    def _switch_vector(self, name):
        return _vector('set', 'Switch', name, 'Ok', self._switch(name))

    def _send(self, text, to=None):
        with self._lock:
            for client in list(self._clients) if to is None else [to]:
                try:
                    client.sendall(text.encode())
                except OSError:
                    self._drop(client)

    def _drop(self, client):
        with contextlib.suppress(ValueError):
            self._clients.remove(client)
        client.close()

    # --- what is requested --------------------------------------------------------------------

    def _accept(self):
        while not self._over.is_set():
            try:
                client, _ = self._socket.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client):
        parser = XMLPullParser(('start', 'end'))
        parser.feed('<all>')
        depth = 0
        with contextlib.suppress(OSError, ParseError):
            while data := client.recv(65536):
                parser.feed(data)
                for what, element in parser.read_events():
                    depth += 1 if what == 'start' else -1
                    if what == 'end' and depth == 1:
                        self._obey(client, element)
                        element.clear()
        with self._lock:
            self._drop(client)

    def _obey(self, client, element):
        name = element.get('name')
        values = {row.get('name'): (row.text or '').strip() for row in element}
        if element.tag == 'getProperties':
            self._send(self._all(), client)
            with self._lock:
                if client not in self._clients:
                    self._clients.append(client)
        elif element.tag == 'newNumberVector' and name == 'EQUATORIAL_EOD_COORD':
            # a real driver would synchronise if told so: this one ignores it
            if self._on['ON_COORD_SET'] == 'TRACK':
                self._telescope.goto(float(values['RA']) * HOUR, float(values['DEC']) * DEG)
                self._send(''.join(_vector('set', 'Number', *row) for row in self._numbers()))
        elif element.tag == 'newNumberVector' and name == 'GEOGRAPHIC_COORD':
            self._send(_vector('set', 'Number', name, 'Ok', values))  # its site does not change
        elif element.tag == 'newSwitchVector' and name in SWITCHES:
            on = next((member for member, value in values.items() if value == 'On'), '')
            if name == 'TELESCOPE_ABORT_MOTION':
                self._telescope.abort()
            elif name == 'TELESCOPE_TRACK_STATE':
                self._telescope.track(on == 'TRACK_ON')
            elif name != 'MOUNT_TYPE':
                self._on[name] = on
            self._send(self._switch_vector(name) + self._switch_vector('TELESCOPE_TRACK_STATE'))


def _place(names, place):
    return dict(zip(names, (place[0] / HOUR, place[1] / DEG)))


def _vector(tag, kind, name, state, values):
    """XML of a vector; `tag` is def or set."""
    element = f'{"def" if tag == "def" else "one"}{kind}'
    rest = '' if tag == 'set' else ' perm="rw"' + (' rule="OneOfMany"' if kind == 'Switch' else '')
    limits = ' format="%g" min="0" max="0" step="0"' if tag == 'def' and kind == 'Number' else ''
    rows = ''.join(f'<{element} name="{member}"{limits}>'
                   f'{value if isinstance(value, str) else repr(float(value))}</{element}>'
                   for member, value in values.items())
    return (f'<{tag}{kind}Vector device="{DEVICE}" name="{name}" state="{state}"{rest}>{rows}'
            f'</{tag}{kind}Vector>\n')
