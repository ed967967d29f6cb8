"""INDI's simulator with errors: ``python -m telescope_mount.bridges.indi.simulator``.

It draws a model of 0.02 to 0.1 deg a term, sets it, says which, and runs until Ctrl-C. An
alt-azimuth mount, which INDI's simulator has not, is one of this project.
"""

import sys
from contextlib import contextmanager

from pointing_model.mounts import ALTAZ
from pointing_model.sky.places import DEFAULT_SITE

from . import PORT
from .client import IndiClient
from .indi_server import DEVICE, SimulatorServer
from .indi_telescope import IndiTelescope
from .simulating import simulate
from .survey import draw_model, set_model
from .two_axes import TwoAxes, draw_errors
from .two_axes_server import TwoAxesServer


@contextmanager
def _serve(given):
    if given.kind == 'altaz':
        terms = draw_errors(given.seed, given.kind)
        with TwoAxesServer(TwoAxes(ALTAZ, DEFAULT_SITE, terms), given.port) as server:
            yield server, terms, ''
        return
    terms = draw_model(given.seed)
    with SimulatorServer(given.port) as server:
        with IndiClient('localhost', server.port) as client:
            telescope = IndiTelescope(client, DEVICE)
            telescope.connect()
            set_model(telescope, terms, given.kind)
        yield server, terms, ', with one sign on both sides'


def main(args=None):
    """Run it; the exit code."""
    return simulate(__doc__, 'indi', PORT, _serve, args)


if __name__ == '__main__':
    sys.exit(main())
