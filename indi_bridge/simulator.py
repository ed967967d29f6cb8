"""INDI's telescope simulator with errors of its own, to try: ``python -m indi_bridge.simulator``.

It draws a model of 0.02 to 0.1 deg a term, sets it, says which, and runs until Ctrl-C. An
alt-azimuth mount, which INDI's simulator has not, is one of this project.
"""

import argparse
import signal
import sys
import threading

from msg_tools.units import ARCSEC
from pointing_model.mounts import ALTAZ
from pointing_model.sky import DEFAULT_SITE

from . import PORT
from .client import IndiClient, IndiError
from .server import DEVICE, SimulatorServer
from .survey import draw_model, set_model
from .telescope import IndiTelescope
from .two_axes import TwoAxes, draw_errors
from .two_axes_server import TwoAxesServer


def _run(server, kind, terms, how, stop):
    """Say what it is, and go on until it is to stop."""
    print(f'indi:localhost:{server.port}, a mount that is {kind}; encoder − catalogue, arcsec'
          f'{how}:\n' + ', '.join(f'{name} {value / ARCSEC:+.1f}' for name, value in terms.items())
          + '\nCtrl-C ends it', flush=True)
    stop.wait()


def main(args=None):
    """Run it; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--port', type=int, default=PORT)
    parser.add_argument('--seed', type=int, default=1, help='of the errors (default: 1)')
    parser.add_argument('--kind', choices=('equatorial', 'german', 'altaz'), default='german')
    given = parser.parse_args(args)
    if not 0 < given.port < 65536:
        parser.error(f'--port {given.port}: must be 1 to 65535')
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        if given.kind == 'altaz':
            terms = draw_errors(given.seed, given.kind)
            with TwoAxesServer(TwoAxes(ALTAZ, DEFAULT_SITE, terms), given.port) as server:
                _run(server, given.kind, terms, '', stop)
            return 0
        terms = draw_model(given.seed)
        with SimulatorServer(given.port) as server:
            with IndiClient('localhost', server.port) as client:
                telescope = IndiTelescope(client, DEVICE)
                telescope.connect()
                set_model(telescope, terms, given.kind)
            _run(server, given.kind, terms, ', with one sign on both sides', stop)
    except (IndiError, OSError) as err:
        print(f'error: {err}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
