"""A night on a mount of an INDI server: what it is, where it stands, and the graph for it."""

import numpy as np

from indi_bridge import parse_address
from indi_bridge.client import IndiClient, IndiError
from indi_bridge.telescope import (
    SIDE,
    IndiTelescope,
    find_device,
    is_simulator,
    knows_where_it_looks,
)
from msg_tools.units import DEG
from pointing_model.sky import DEFAULT_SITE

from .graph import indi_graph

#: parameters of the site, in the order in which a telescope tells it, and their units
SITE = (('latitude_deg', DEG), ('longitude_deg', DEG), ('height_m', 1.0))
#: how INDI's simulator slews, for the guard: both axes at once, and at once at full speed
SIMULATED = {'first_rate_deg_s': 6.0, 'second_rate_deg_s': 6.0, 'first_acceleration_deg_s2': 60.0,
             'second_acceleration_deg_s2': 60.0, 'slew_timing': 0.8}
#: stars of the blind check, of those that are fitted
CHECKED = 4


def indi_plan(stars):
    """The plan: one power-on, as the driver has its zero; blind stars before and after a diagnosis.

    Parameters
    ----------
    stars : int
    """
    check = max(4, stars // CHECKED)
    return f'home, stars {stars}, fit, check {check}, diagnose, check {check}, judge'


def ask_server(text, sky=None):
    """What is at the server.

    Parameters
    ----------
    text : str
        ``indi:HOST[:PORT[:KIND]]``; the kind where the driver does not tell it.
    sky : dict, optional
        Parameters of site and weather that the user gave; the rest of the site is the driver's.

    Returns
    -------
    server : dict
        ``host``, ``port``, ``device``.
    kind : str
        Of mount.
    sky : dict
    simulated : bool
        Whether it is INDI's simulator.

    Raises
    ------
    ValueError
        No server, no telescope, a driver that does not know where it looks.
    """
    parts = text.split(':')
    told = parts.pop() if len(parts) == 4 else ''
    host, port = parse_address(':'.join(parts))
    try:
        with IndiClient(host, port) as client:
            telescope = IndiTelescope(client, find_device(client))
            telescope.connect()
            knows_where_it_looks(telescope)
            kind = told or telescope.kind or ('german' if telescope.get(SIDE) else '')
            site, simulated = telescope.site, is_simulator(telescope)
    except IndiError as err:
        raise ValueError(str(err)) from None
    if not kind:
        raise ValueError(f'{telescope.device} does not say what kind of mount it is: write '
                         f'indi:{host}:{port}:equatorial, or german')
    if site is None or not np.any(site[:2]):  # as drivers begin that nobody has told
        site = DEFAULT_SITE.latitude, DEFAULT_SITE.longitude, DEFAULT_SITE.height
    there = {name: value / unit for (name, unit), value in zip(SITE, site)}
    server = {'host': host, 'port': port, 'device': telescope.device}
    return server, kind, there | (sky or {}), simulated


def specs(mount, *, stars, sky=None, **graph):
    """Plan and nodes.

    Parameters
    ----------
    mount : str
        As of `ask_server`.
    stars : int
    sky : dict, optional
    **graph
        As of `graph.indi_graph`.

    Returns
    -------
    plan : str
    list of NodeSpec
    """
    server, kind, sky, simulated = ask_server(mount, sky)
    plan = indi_plan(stars)
    return plan, indi_graph(server=server, mount=kind, sky=sky, plan=plan,
                            slews=SIMULATED if simulated else None, **graph)
