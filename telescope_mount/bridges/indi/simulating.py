"""What the programs that simulate a telescope of a server share: options, words, the end."""

import argparse
import sys
import threading

from msg_tools.signals import on_end
from msg_tools.units import ARCSEC

from .client import IndiError


def simulate(doc, protocol, port, serve, args=None):
    """Serve a telescope until Ctrl-C.

    Parameters
    ----------
    doc : str
        Of the program; its first paragraph is the help's.
    protocol : str
        Before the address that is told.
    port : int
        By default.
    serve : callable
        ``serve(given)``, with ``port``, ``seed`` and ``kind``, is a context that gives the server,
        its terms (rad by their names) and what is said of their signs.
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
