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

"""A night on a mount of an INDI or Alpaca server: its kind, its site, and its graph."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from msg_tools import NAMESPACE
from pointing_model.mount_kinds import KINDS
from pointing_model.sky.site import DEFAULT_SITE, SITE
from telescope_mount.bridges.connection import PORTS, BridgeError, parse_address

from ..graph import NODES, REAL, NodeSpec, pass_of, real_graph

#: how the simulators slew, for the guard: both axes together, immediately at full speed
SIMULATED = {'first_rate_deg_s': 6.0, 'second_rate_deg_s': 6.0, 'first_acceleration_deg_s2': 60.0,
             'second_acceleration_deg_s2': 60.0, 'slew_timing': 0.8}
#: INDI's equatorial simulator turns its hour angle around +90 degrees, and never passes -90
#: (`rotateCentre` in drivers/telescope/scopesim_helper of 1.9.9): it goes the long way round
INDI_FORK = {'first_travel_deg': '-88,178'}
#: s that the axes must rest for a simulator that is polled for its place between readings
REST_BEFORE_POLL = 0.5
#: default exposure time of a camera, s
EXPOSURE = 1.0
#: fitted stars per star of the blind check
CHECKED = 4


class ServerMount(NamedTuple):
    """A mount at a server.

    Attributes
    ----------
    protocol : {'indi', 'alpaca'}
    server : dict
        Parameters of the bridge nodes: ``host``, ``port`` and which telescope.
    kind : str
        Kind of mount.
    sky : dict
        Parameters of site and weather.
    simulated : bool
        Whether it is a simulator that reports its true direction.
    """

    protocol: str
    server: dict
    kind: str
    sky: dict
    simulated: bool


def server_plan(stars, track='', discrimination=''):
    """The plan: one power-on, with the driver's zero; blind stars before and after a diagnosis.

    Parameters
    ----------
    stars : int
    track, discrimination : str
        See `night.run_night`. A tracked model is not validated and taken back.
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
    """Query the server for its mount.

    Parameters
    ----------
    text : str
        ``indi:HOST[:PORT[:KIND]]`` or ``alpaca:...``; the kind if the driver does not report it.
    sky : dict, optional
        Site and weather given by the user; the rest of the site is the driver's.
    seen : bool
        Whether a camera observes the sky; else it must be a simulator that reports its direction.

    Returns
    -------
    ServerMount

    Raises
    ------
    ValueError
        No server, no telescope, or a driver that does not know its true direction.
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
    if site is None or not np.any(site[:2]):  # the initial value of unconfigured drivers
        site = () if not simulated else (
            DEFAULT_SITE.latitude, DEFAULT_SITE.longitude, DEFAULT_SITE.height)
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
    if not seen:
        _with_advice(AlpacaTelescope.knows_where_it_looks, telescope)
    return ({'number': 0}, given or telescope.kind, telescope.site, telescope.is_simulator,
            telescope.device)


def _with_advice(check, telescope):
    try:
        check(telescope)
    except BridgeError as err:
        raise ValueError(f'{str(err).partition(":")[0]}: give a camera with --camera '
                         'indi:HOST:PORT:NAME, or the driver of one with --driver') from None


def nodes_of(found, *, plan, camera='', drivers=(), exposure=EXPOSURE, **graph):
    """The nodes for a mount found at a server.

    Parameters
    ----------
    found : ServerMount
    plan : str
    camera : str
        See `parse_camera`; empty: none.
    drivers : sequence of Path
        The user's drivers, one of which observes the sky.
    exposure : float
        Exposure time of the camera, s; unused if a simulator reports its direction.
    **graph
        See `server_graph`.

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


def server_graph(*, bag, server, mount, sky, protocol='indi', camera=None, seen=False,
                 exposure=0.0, seed=1, plan='', model_file='', first_run=1, state_file='',
                 calibration=None, slews=None):
    """The nodes of a night on a mount of a server, on this machine's clock.

    Parameters
    ----------
    bag : str
        Folder of the log, which must not exist.
    server : dict
        Parameters of the bridge nodes: `host`, `port`, `device` or `number`.
    mount : str
        Kind of mount, see `pointing_model.mounts.parse_mount`.
    sky : dict
        Parameters of site and weather (`latitude_deg`, ...), for all nodes.
    protocol : {'indi', 'alpaca'}
    camera : dict, optional
        Parameters of `indi_sky`, `host`, `port` and `camera`, if a camera observes the sky; by
        default a simulator reports its direction.
    seen : bool
        A driver of the user publishes what is observed; no bridge node does.
    exposure : float
        Exposure time of the camera or driver, s; see `graph.real_graph`.
    seed : int
        Seed of the choice of stars, and of the noise of simulated observations.
    plan, model_file, first_run, calibration
        See `graph.night_graph`.
    state_file : str
        See `graph.real_graph`.
    slews : dict, optional
        Parameters of the guard if the driver's slew profile is known; by default unknown.

    Returns
    -------
    list of NodeSpec
    """
    bridge = dict(sky) | {'mount': mount}
    parameters = {f'{protocol}_mount': dict(server) | bridge}
    if camera:
        parameters['indi_sky'] = camera | bridge | ({'exposure_s': exposure} if exposure else {})
    elif not seen:
        parameters[f'{protocol}_sky'] = dict(server) | bridge | {
            'seed': seed, 'satellite': pass_of(plan)}
        exposure = REST_BEFORE_POLL if protocol == 'alpaca' else 0.0  # INDI: at its readings
    special = {
        'mount_guard': {'goto': True, 'park_deg': KINDS[mount].park_deg,
                        # a driver stops with a short delay
                        'request_timeout_s': 0.35} | (
            # places beyond the zenith are not sent
            {'second_travel_deg': '-5,89'} if KINDS[mount].vertical else {}) | (
            slews or {'slew_timing': 0.0}),
        'star_observer': {
            'star_seed': seed, 'first_run': first_run,
            # the driver chooses the side at the meridian itself
            'meridian_limit_deg': 0.0,
            # it first comes to rest next to the star, and is then sent again
            'on_target_arcsec': 3.0, 'renew_request_s': 0.1,
            'wait_for_nodes': [f'{NAMESPACE}/{name}' for name in (*parameters, *REAL)]}}
    beside = real_graph(bag=bag, plan=plan, mount=mount, sky=sky, model_file=model_file,
                        exposure=exposure, state_file=state_file,
                        calibration={'split_seed': seed, **(calibration or {})})
    return [*(NodeSpec(name, NODES[name], values) for name, values in parameters.items()),
            *(replace(spec, parameters=spec.parameters | special.get(spec.name, {}))
              for spec in beside)]
