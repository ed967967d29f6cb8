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

"""Bridge to mounts that an INDI server drives: protocol and numerics without ROS, thin nodes."""

#: of a server, as INDI has registered it
PORT = 7624


def parse_address(text, protocol='indi', usual=PORT):
    """Host and port of ``indi:HOST[:PORT]``, or of another protocol.

    Parameters
    ----------
    text : str
    protocol : str
    usual : int
        Port where none is given.

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
    port = port or str(usual)
    if kind != protocol or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        name = {'indi': 'INDI', 'alpaca': 'Alpaca'}[protocol]
        raise ValueError(f'{text!r} is no {name} server; write {protocol}:HOST or '
                         f'{protocol}:HOST:PORT, for instance {protocol}:localhost:{usual}')
    return host, int(port)
