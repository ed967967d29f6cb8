"""A telescope of an Alpaca server that points beside: ``python -m alpaca_bridge.simulator``.

It draws errors of its parts of 0.02 to 0.1 deg each, says which, and runs until Ctrl-C. Where its
tube looks it tells by an action of its own, `TRUE_PLACE`, as no driver of a real mount can.
"""

import argparse
import signal
import sys
import threading

from indi_bridge.pointing import HOUR
from indi_bridge.two_axes import TwoAxes, draw_errors
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import parse_mount
from pointing_model.sky import DEFAULT_SITE

from . import PORT
from .server import AlpacaServer
from .telescope import KINDS, TRUE_PLACE


class SimulatedTelescope(AlpacaServer):
    """A `TwoAxes` that speaks Alpaca.

    Parameters
    ----------
    telescope : TwoAxes
    port : int
    """

    def __init__(self, telescope, port=0):
        super().__init__(port)
        self._telescope, self._parked = telescope, True

    def tell(self, name):
        """A property."""
        telescope = self._telescope
        (ra, dec), site = telescope.look()[1], telescope.site
        kind = next(number for number, kind in KINDS.items() if kind == telescope.mount.kind)
        now = {'RightAscension': ra / HOUR, 'Declination': dec / DEG,
               'Slewing': telescope.slewing, 'Tracking': telescope.tracking,
               'SideOfPier': int(telescope.beyond), 'AtPark': self._parked}
        return {name.lower(): value for name, value in {
            **now, 'DeviceState': [{'Name': name, 'Value': value} for name, value in now.items()],
            'Connected': True, 'AlignmentMode': kind, 'EquatorialSystem': 1, 'CanSlewAsync': True,
            'SiteLatitude': site.latitude / DEG, 'SiteLongitude': float(wrap(site.longitude)) / DEG,
            'SiteElevation': site.height, 'SupportedActions': [TRUE_PLACE]}.items()}[name]

    def obey(self, order, told):
        """An order."""
        telescope = self._telescope
        if order == 'slewtocoordinatesasync':
            if self._parked:
                raise ValueError('it is parked')
            telescope.goto(float(told['RightAscension']) * HOUR, float(told['Declination']) * DEG)
        elif order == 'tracking':
            telescope.track(told['Tracking'] == 'True')
        elif order == 'abortslew':
            if telescope.slewing:
                telescope.abort()
        elif order == 'unpark':
            self._parked = False
        elif order == 'action' and told['Action'] == TRUE_PLACE:
            axes, _, true = telescope.look()
            return ' '.join(repr(float(value)) for value in (*true, axes[1]))
        elif order != 'connected':
            raise KeyError(order)
        return None


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
    errors = draw_errors(given.seed, given.kind)
    mount = parse_mount(given.kind, DEFAULT_SITE.latitude)
    try:
        with SimulatedTelescope(TwoAxes(mount, DEFAULT_SITE, errors), given.port) as server:
            print(f'alpaca:localhost:{server.port}, a mount that is {given.kind}; encoder − '
                  'catalogue, arcsec:\n' + ', '.join(
                      f'{name} {value / ARCSEC:+.1f}' for name, value in errors.items())
                  + '\nCtrl-C ends it', flush=True)
            stop.wait()
    except OSError as err:
        print(f'error: port {given.port}: {err}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
