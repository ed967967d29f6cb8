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

"""INDI's simulator with errors: ``python examples/simulated_servers/indi_simulator.py``.

It draws a model with terms of 0.02 to 0.1 deg, sets it, prints it, and runs until Ctrl-C. For an
alt-azimuth mount, which INDI's simulator does not have, it uses one of this project.
"""

import argparse
import sys
import threading
from contextlib import contextmanager

from indi_server import DEVICE, SimulatorServer
from two_axes import TERMS, TwoAxes, draw_errors
from two_axes_server import TwoAxesServer

from msg_tools.signals import on_end
from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ
from pointing_model.sky.site import DEFAULT_SITE
from telescope_mount.bridges.connection import PORTS
from telescope_mount.bridges.indi.client import IndiClient, IndiError
from telescope_mount.bridges.indi.indi_telescope import KIND, KINDS, IndiTelescope

#: term of `pointing_model` -> element of MOUNT_MODEL, and its sign there
MODEL = {'IH': ('MM_IH', -1.0), 'ID': ('MM_ID', -1.0), 'CH': ('MM_CH', -1.0),
         'NP': ('MM_NP', -1.0), 'MA': ('MM_MA', 1.0), 'ME': ('MM_ME', -1.0)}


def set_model(telescope, terms, kind='german'):
    """Set the errors of the simulator, which it applies on the sky before the flip.

    Parameters
    ----------
    telescope : IndiTelescope
        Connected.
    terms : dict of str to float
        Terms of `MODEL`, rad.
    kind : str
        Kind of mount.
    """
    client, device = telescope.client, telescope.device
    client.property(device, KIND)
    client.switch(device, KIND, next(name for name, of in KINDS.items() if of == kind))
    client.property(device, 'MOUNT_MODEL')
    client.send(device, 'MOUNT_MODEL', **{
        element: sign * terms.get(name, 0.0) / DEG for name, (element, sign) in MODEL.items()})
    client.wait(lambda: telescope.get('MOUNT_MODEL').state == 'Ok',
                f'{device} does not take its model')


@contextmanager
def _serve(given):
    if given.kind == 'altaz':
        terms = draw_errors(given.seed, TERMS[True])
        with TwoAxesServer(TwoAxes(ALTAZ, DEFAULT_SITE, terms), given.port) as server:
            yield server, terms, ''
        return
    terms = draw_errors(given.seed, MODEL)
    with SimulatorServer(given.port) as server:
        with IndiClient('localhost', server.port) as client:
            telescope = IndiTelescope(client, DEVICE)
            telescope.connect()
            set_model(telescope, terms, given.kind)
        yield server, terms, ', with one sign on both sides'


def main(args=None):
    """Run it; return the exit code."""
    return simulate(__doc__, 'indi', PORTS['indi'], _serve, args)


def simulate(doc, protocol, port, serve, args=None):
    """Serve a telescope until Ctrl-C.

    Parameters
    ----------
    doc : str
        Docstring of the program; its first paragraph is used for the help.
    protocol : str
        Protocol, printed before the address.
    port : int
        Default port.
    serve : callable
        ``serve(given)``, with ``port``, ``seed`` and ``kind``, is a context manager that gives the
        server, its terms (rad by name) and a remark on their signs.
    args : list of str, optional

    Returns
    -------
    int
        The exit code.
    """
    parser = argparse.ArgumentParser(description=doc.split('\n\n')[0])
    parser.add_argument('--port', type=int, default=port)
    parser.add_argument('--seed', type=int, default=1, help='of the errors (default: 1)')
    parser.add_argument('--kind', choices=('equatorial', 'german', 'altaz'), default='german')
    given = parser.parse_args(args)
    if not 0 < given.port < 65536:
        parser.error(f'--port {given.port}: must be 1 to 65535')
    stop = threading.Event()
    on_end(lambda *_: stop.set())
    try:
        with serve(given) as (server, terms, how):
            print(f'{protocol}:localhost:{server.port}, a mount that is {given.kind}; encoder − '
                  f'catalogue, arcsec{how}:\n' + ', '.join(
                      f'{name} {value / ARCSEC:+.1f}' for name, value in terms.items())
                  + '\nCtrl-C ends it', flush=True)
            stop.wait()
    except (IndiError, OSError) as err:
        print(f'error: port {given.port}: {err}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
