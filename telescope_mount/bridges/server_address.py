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

"""Where a server is: host and port of a text such as ``indi:HOST:PORT``."""

#: of a server by protocol: as INDI has registered it, and Alpaca's by custom
PORTS = {'indi': 7624, 'alpaca': 11111}


def parse_address(text, protocol='indi'):
    """Host and port of ``indi:HOST[:PORT]``, or of another protocol.

    Parameters
    ----------
    text : str
    protocol : str
        Of `PORTS`.

    Returns
    -------
    host : str
    port : int

    Raises
    ------
    ValueError
        It is no such address.
    """
    kind, _, rest = text.partition(':')
    host, _, port = rest.partition(':')
    port = port or str(PORTS[protocol])
    if kind != protocol or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        name = {'indi': 'INDI', 'alpaca': 'Alpaca'}[protocol]
        raise ValueError(f'{text!r} is no {name} server; write {protocol}:HOST or {protocol}:HOST:'
                         f'PORT, for instance {protocol}:localhost:{PORTS[protocol]}')
    return host, int(port)
