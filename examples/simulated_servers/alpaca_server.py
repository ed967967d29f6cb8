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

"""Parts of an Alpaca server that a telescope needs, for trials and tests."""

import json
import threading
from abc import ABC, abstractmethod
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

#: error numbers of ASCOM
NOT_IMPLEMENTED, INVALID_VALUE = 0x400, 0x401


class AlpacaServer(ABC):
    """Serves one device, as a context manager.

    Parameters
    ----------
    port : int
        By default a free port.

    Attributes
    ----------
    port : int
    """

    def __init__(self, port=0):
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = 'HTTP/1.1'

            def answer(self, call, *args):
                value, number, text = None, 0, ''
                try:
                    value = call(*args)
                except KeyError as missing:
                    number, text = NOT_IMPLEMENTED, f'{missing} is not implemented'
                except ValueError as error:
                    number, text = INVALID_VALUE, str(error)
                data = json.dumps({'Value': value, 'ErrorNumber': number, 'ErrorMessage': text,
                                   'ClientTransactionID': 1, 'ServerTransactionID': 1}).encode()
                self.send_response(200)
                self.send_header('Content-Type', 'application/json')
                self.send_header('Content-Length', str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def do_GET(self):
                self.answer(outer.value, urlsplit(self.path).path.rpartition('/')[2])

            def do_PUT(self):
                size = int(self.headers.get('Content-Length', 0))
                given = {key: value[0] for key, value in parse_qs(
                    self.rfile.read(size).decode(), keep_blank_values=True).items()}
                self.answer(outer.obey, self.path.rpartition('/')[2], given)

            def log_message(self, *_):
                pass

        class Quiet(ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, *_):
                pass  # the client has disconnected

        self._http = Quiet(('127.0.0.1', port), Handler)
        self.port = self._http.server_port

    @abstractmethod
    def value(self, name):
        """Value of a property with its name in lower case; KeyError if there is none."""

    @abstractmethod
    def obey(self, order, given):
        """Execute an order with its name in lower case; return its answer.

        Parameters
        ----------
        order : str
        given : dict of str to str

        Raises
        ------
        KeyError, ValueError
            There is no such order; it cannot be executed with these values.
        """

    def __enter__(self):
        threading.Thread(target=self._http.serve_forever, args=(0.05,), daemon=True).start()
        return self

    def __exit__(self, *_):
        self._http.shutdown()
        self._http.server_close()
