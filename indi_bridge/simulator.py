"""INDI's telescope simulator with errors of its own, to try: ``python -m indi_bridge.simulator``.

It draws a model of 0.02 to 0.1 deg a term, sets it, says which, and runs until Ctrl-C.
"""

import argparse
import signal
import sys
import threading

from msg_tools.units import ARCSEC

from . import PORT
from .client import IndiClient, IndiError
from .server import DEVICE, SimulatorServer
from .survey import draw_model, set_model
from .telescope import IndiTelescope


def main(args=None):
    """Run it; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--port', type=int, default=PORT)
    parser.add_argument('--seed', type=int, default=1, help='of the errors (default: 1)')
    parser.add_argument('--kind', choices=('equatorial', 'german'), default='german')
    given = parser.parse_args(args)
    if not 0 < given.port < 65536:
        parser.error(f'--port {given.port}: must be 1 to 65535')
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    terms = draw_model(given.seed)
    try:
        with SimulatorServer(given.port) as server:
            with IndiClient('localhost', server.port) as client:
                telescope = IndiTelescope(client, DEVICE)
                telescope.connect()
                set_model(telescope, terms, given.kind)
            print(f'indi:localhost:{server.port}, a {given.kind} mount; encoder − catalogue, '
                  'arcsec, with one sign on both sides:\n'
                  + ', '.join(f'{name} {value / ARCSEC:+.1f}' for name, value in terms.items())
                  + '\nCtrl-C ends it', flush=True)
            stop.wait()
    except (IndiError, OSError) as err:
        print(f'error: {err}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
