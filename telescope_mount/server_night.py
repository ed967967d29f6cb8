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

"""A night on a mount of an INDI or Alpaca server: what it is, where it stands, and its graph."""

from typing import NamedTuple

import numpy as np

from pointing_model.sky.site import DEFAULT_SITE, SITE
from telescope_mount.bridges.connection import PORTS, BridgeError, parse_address

from .graph import server_graph

#: how the simulators slew, for the guard: both axes at once, and at once at full speed
SIMULATED = {'first_rate_deg_s': 6.0, 'second_rate_deg_s': 6.0, 'first_acceleration_deg_s2': 60.0,
             'second_acceleration_deg_s2': 60.0, 'slew_timing': 0.8}
#: INDI's own one turns its hour angle about +90 degrees, and never passes -90 (`rotateCentre` in
#: drivers/telescope/scopesim_helper of 1.9.9): to a star beyond it goes the long way round
INDI_FORK = {'first_travel_deg': '-88,178'}
#: stars of the blind check, of those that are fitted
CHECKED = 4


class ServerMount(NamedTuple):
    """What is at a server.

    Attributes
    ----------
    protocol : {'indi', 'alpaca'}
    server : dict
        Parameters of the nodes of the bridge: ``host``, ``port`` and which telescope.
    kind : str
        Of mount.
    sky : dict
        Parameters of site and weather.
    simulated : bool
        Whether it is a simulator that tells where it truly looks.
    """

    protocol: str
    server: dict
    kind: str
    sky: dict
    simulated: bool


def server_plan(stars, track='', discrimination=''):
    """The plan: one power-on, as the driver has its zero; blind stars before and after a diagnosis.

    Parameters
    ----------
    stars : int
    track, discrimination : str
        As of `night.run_night`. A model that is tracked is not tested and taken back.
    """
    check = f'check {max(4, stars // CHECKED)}'
    steps = ['home', f'stars {stars}', 'fit', check]
    if discrimination or not track:
        steps += ['diagnose', *([discrimination] if discrimination else [])]
    return ', '.join([*steps, track, check] if track else [*steps, check, 'judge'])


def parse_camera(text):
    """Parameters of `indi_sky` for a camera of an INDI server, ``indi:HOST[:PORT]:NAME``."""
    address, _, name = text.rpartition(':')
    if not name.strip() or address.count(':') not in (1, 2):
        raise ValueError(f'--camera {text!r}: write indi:HOST:PORT:NAME, for instance '
                         f'indi:localhost:{PORTS["indi"]}:CCD Simulator')
    host, port = parse_address(address)
    return {'host': host, 'port': port, 'camera': name}


def ask_server(text, sky=None, seen=False):
    """What is at the server.

    Parameters
    ----------
    text : str
        ``indi:HOST[:PORT[:KIND]]`` or ``alpaca:...``; the kind where the driver does not tell it.
    sky : dict, optional
        Parameters of site and weather that the user gave; the rest of the site is the driver's.
    seen : bool
        Whether a camera sees the sky; else it must be a simulator that tells where it looks.

    Returns
    -------
    ServerMount

    Raises
    ------
    ValueError
        No server, no telescope, a driver that does not know where it looks.
    """
    protocol, parts = text.partition(':')[0], text.split(':')
    kind = parts.pop() if len(parts) == 4 else ''
    host, port = parse_address(':'.join(parts), protocol)
    try:
        ask = _ask_indi if protocol == 'indi' else _ask_alpaca
        server, kind, site, simulated, device = ask(host, port, kind, seen)
    except BridgeError as err:
        raise ValueError(str(err)) from None
    if not kind:
        raise ValueError(f'{device} does not say what kind of mount it is: write '
                         f'{protocol}:{host}:{port}:equatorial, german or altaz')
    if site is None or not np.any(site[:2]):  # as drivers begin that nobody has told
        site = DEFAULT_SITE.latitude, DEFAULT_SITE.longitude, DEFAULT_SITE.height
    there = {name: value / one.size for (name, one), value in zip(SITE.items(), site)}
    return ServerMount(protocol, {'host': host, 'port': port} | server, kind, there | (sky or {}),
                 simulated)


def _ask_indi(host, port, given, seen):
    from telescope_mount.bridges.indi.client import IndiClient
    from telescope_mount.bridges.indi.indi_telescope import (
        SIDE,
        IndiTelescope,
        check_kind,
        find_device,
        is_simulator,
        knows_where_it_looks,
    )
    with IndiClient(host, port) as client:
        telescope = IndiTelescope(client, find_device(client))
        telescope.connect()
        if not seen:
            _with_advice(knows_where_it_looks, telescope)
        kind = given or telescope.kind or ('german' if telescope.get(SIDE) else '')
        check_kind(telescope, kind)
        return ({'device': telescope.device}, kind, telescope.site,
                is_simulator(telescope), telescope.device)


def _ask_alpaca(host, port, given, seen):
    from telescope_mount.bridges.alpaca.alpaca_telescope import AlpacaTelescope
    telescope = AlpacaTelescope(host, port)
    telescope.connect()
    simulated = telescope.is_simulator
    if not seen:
        _with_advice(AlpacaTelescope.knows_where_it_looks, telescope)
    return {'number': 0}, given or telescope.kind, telescope.site, simulated, telescope.device


def _with_advice(check, telescope):
    try:
        check(telescope)
    except BridgeError as err:
        raise ValueError(f'{str(err).partition(":")[0]}: give a camera with --camera '
                         'indi:HOST:PORT:NAME, or the driver of one with --driver') from None


def nodes_of(found, *, plan, camera='', drivers=(), exposure=1.0, **graph):
    """The nodes for what was found.

    Parameters
    ----------
    found : ServerMount
    plan : str
    camera : str
        As of `parse_camera`; empty: none.
    drivers : sequence of Path
        Whether one of the user's sees the sky.
    exposure : float
        Of the camera, s; no matter where a simulator tells where it looks.
    **graph
        As of `graph.server_graph`.

    Returns
    -------
    list of NodeSpec
    """
    slews = SIMULATED if found.simulated else None
    if slews and (found.protocol, found.kind) == ('indi', 'equatorial'):
        slews = slews | INDI_FORK
    return server_graph(
        protocol=found.protocol, server=found.server, mount=found.kind, sky=found.sky, plan=plan,
        camera=parse_camera(camera) if camera else {}, seen=bool(drivers),
        exposure=exposure if camera or drivers else 0.0,
        slews=slews, **graph)
