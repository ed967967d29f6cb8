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

"""A tiny server that speaks as much of INDI as a telescope needs, from lines of a test."""

import contextlib
import re
import socket
import threading

NUMBER = '<{kind}NumberVector device="{device}" name="{name}" state="{state}" {rest}>{members}' \
         '</{kind}NumberVector>'
SWITCH = NUMBER.replace('Number', 'Switch')
DEVICE = 'Mount'


def _members(tag, values, of_what):
    return ''.join(f'<{tag}{of_what} name="{name}"'
                   + (' format="%g" min="0" max="0" step="0"' if tag == 'def' and
                      of_what == 'Number' else '') + f'>{value}</{tag}{of_what}>'
                   for name, value in values.items())


def number(name, values, kind='set', state='Ok', device=DEVICE):
    """XML of a number vector; `kind` is def or set."""
    tag = 'def' if kind == 'def' else 'one'
    return NUMBER.format(kind=kind, device=device, name=name, state=state,
                         rest='perm="rw"' if kind == 'def' else '',
                         members=_members(tag, values, 'Number'))


def switch(name, values, kind='set', state='Ok', device=DEVICE):
    """As `number`, of switches."""
    tag = 'def' if kind == 'def' else 'one'
    rest = 'perm="rw" rule="OneOfMany"' if kind == 'def' else ''
    return SWITCH.format(kind=kind, device=device, name=name, state=state, rest=rest,
                         members=_members(tag, values, 'Switch'))


#: what a telescope defines when it is asked for its properties
TELESCOPE = (
    switch('CONNECTION', {'CONNECT': 'On', 'DISCONNECT': 'Off'}, 'def')
    + f'<defTextVector device="{DEVICE}" name="DRIVER_INFO" state="Ok" perm="ro">'
      '<defText name="DRIVER_INTERFACE">5</defText></defTextVector>'
    + switch('ON_COORD_SET', {'TRACK': 'Off', 'SLEW': 'On', 'SYNC': 'Off'}, 'def')
    + switch('TELESCOPE_ABORT_MOTION', {'ABORT': 'Off'}, 'def')
    + switch('TELESCOPE_TRACK_STATE', {'TRACK_ON': 'Off', 'TRACK_OFF': 'On'}, 'def')
    + switch('TELESCOPE_SLEW_RATE', {'1x': 'On', '2x': 'Off'}, 'def')
    + number('GEOGRAPHIC_COORD', {'LAT': 10, 'LONG': 350, 'ELEV': 100}, 'def')
    + number('EQUATORIAL_EOD_COORD', {'RA': 6, 'DEC': 30}, 'def')
    + number('MOUNT_AXES', {'PRIMARY': 45, 'SECONDARY': 30}, 'def'))


class FakeServer:
    """Serves one client after the other, as a context.

    Parameters
    ----------
    properties : str
        XML that answers ``getProperties``.
    obeys : bool
        Whether it sets what it is told to set, and says so.
    late : str
        XML of properties that it comes to define only when somebody asks for the second time.

    Attributes
    ----------
    port : int
    got : list of str
        What clients sent, an element each.
    """

    def __init__(self, properties=TELESCOPE, obeys=True, late=''):
        self.properties, self.obeys, self.got = properties, obeys, []
        self._late = late
        self._socket = socket.create_server(('127.0.0.1', 0))
        self.port = self._socket.getsockname()[1]
        self._client, self._open = None, True
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._open = False
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self.drop()

    def drop(self):
        """Break the connection."""
        if self._client is not None:
            with contextlib.suppress(OSError):  # the other end was sooner
                # closed alone, it would not end while its thread reads
                self._client.shutdown(socket.SHUT_RDWR)
            self._client.close()

    def say(self, text):
        """To the client."""
        self._client.sendall(text.encode())

    def _serve(self):
        while self._open:
            try:
                self._client, _ = self._socket.accept()
            except OSError:
                return
            self._answer(self._client)

    def _answer(self, client):
        text = ''
        try:
            while data := client.recv(65536):
                text += data.decode()
                while found := re.match(r'\s*<(\w+)([^>]*?)(/>|>(.*?)</\1>)', text, re.S):
                    text = text[found.end():]
                    self.got.append(found[0].strip())
                    self._obey(found[1], found[2], found[4] or '')
        except OSError:
            pass

    def _obey(self, tag, head, body):
        if tag == 'getProperties':
            self.say(self.properties)
            self.properties, self._late = self._late + self.properties, ''
        elif self.obeys and tag.startswith('new'):
            name = re.search(r'name="([^"]*)"', head)[1]
            values = dict(re.findall(r'name="([^"]*)"[^>]*>\s*([^<]*?)\s*<', body))
            kind = tag.removeprefix('new')
            known = re.search(rf'<def{kind} [^>]*name="{name}".*?</def{kind}>', self.properties)[0]
            if kind == 'SwitchVector':
                rest = re.findall(r'<defSwitch name="([^"]*)"', known)
                values = {key: values.get(key, 'Off') for key in rest}
                self.say(switch(name, values))
            else:
                self.say(number(name, values, state='Busy' if 'EOD' in name else 'Ok'))
            # whoever asks again is told what holds now
            define = switch if kind == 'SwitchVector' else number
            self.properties = self.properties.replace(known, define(name, values, 'def'))
