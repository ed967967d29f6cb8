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

"""The one description of the graph: which nodes there are, and with which parameters.

`telescope-mount` starts it with processes of its own, `launch/night.launch.py` with ROS launch.
"""

import math
from dataclasses import dataclass, field

from msg_tools import NAMESPACE
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import parse_mount
from telescope_mount.observing.plan import parse_plan

#: executable -> module; setup.py makes one executable of each
NODES = {
    'mount_simulator': 'encoder_sim.mount_simulator_node',
    'incremental_encoder': 'encoder_sim.incremental_encoder_node',
    'absolute_encoder': 'encoder_sim.absolute_encoder_node',
    'frame_reader': 'encoder_reading.frame_reader_node',
    'camera': 'encoder_sim.camera_node',
    'mount_guard': 'telescope_mount.guard.mount_guard_node',
    'star_observer': 'telescope_mount.observing.star_observer_node',
    'pointing_corrector': 'pointing_model.pointing_corrector_node',
    'calibration': 'calibration.calibration_node',
    'mount_display': 'pointing_model.mount_display_node',
    'mcap_logger': 'msg_tools.mcap_logger_node',
    'mcap_replay': 'msg_tools.mcap_replay_node',
    'run_player': 'pointing_model.run_player_node',
    'indi_mount': 'telescope_mount.bridges.indi.indi_mount_node',
    'indi_sky': 'telescope_mount.bridges.indi.indi_sky_node',
    'alpaca_mount': 'telescope_mount.bridges.alpaca.alpaca_mount_node',
    'alpaca_sky': 'telescope_mount.bridges.alpaca.alpaca_sky_node',
}

#: executables that need types of telescope_mount_msgs, which is built apart, and say so
WITH_BUILT_TYPES = {
    'action_bridge': 'telescope_mount.bridges.actions.action_bridge_node',
}

#: of the simulated incremental encoder (paper 000): lines in a turn
GRATING = 'grating=47200'
SIMULATED = ('mount_simulator', 'incremental_encoder', 'absolute_encoder', 'camera')
NIGHT = (*SIMULATED, 'mount_guard', 'star_observer', 'pointing_corrector', 'mcap_logger',
         'calibration')

#: without a time scale each of these waits for the others: apart, most of a night would be their
#: start and the way of messages from one process to the next
IN_TURN = (*SIMULATED, 'frame_reader', 'mount_guard', 'star_observer', 'pointing_corrector')

#: topics that only simulated hardware has
TRUTH = '.*/truth/.*'

#: parameters of the site
SITE = ('latitude_deg', 'longitude_deg', 'height_m')


@dataclass(frozen=True)
class NodeSpec:
    """A node to start: its executable, its module and its parameters.

    Those that have the same `process` share one of that name; by default each has its own.
    """

    name: str
    module: str
    parameters: dict = field(default_factory=dict)
    process: str = ''

    @property
    def full_name(self):
        """Fully qualified node name, in the namespace of the command line."""
        return f'{NAMESPACE}/{self.name}'


def _known(sky, names):
    return {name: sky[name] for name in names if name in sky}


def _of_pass(plan):
    """The satellite of a plan's passes, which the simulated sky must have."""
    found = [step.what for step in parse_plan(plan) if step.verb == 'pass'] if plan else []
    return found[0] if found else ''


def _mode(plan):
    """Of the calibration: a plan that has the step `track` needs a model after each star."""
    tracks = plan and any(step.verb == 'track' for step in parse_plan(plan))
    return {'mode': 'track'} if tracks else {}


def night_graph(*, bag, scenario='default', seed=1, start_time='', plan='', time_scale=0.0,
                model_file='', first_run=1, sky=None, reference_age=0, satellite='',
                sample_rate_hz=None, calibration=None, absolute='angles', mount='altaz',
                namespace=NAMESPACE, kept_power_ons=None):
    """The nodes of a simulated night.

    Parameters
    ----------
    bag : str
        Folder of the log, which must not exist; the truth goes beside it.
    scenario : str
        What is wrong with the simulated mount; only the simulator's nodes read it.
    seed : int
        Of every random number.
    start_time : str
        UTC, ISO 8601; empty for the simulator's default.
    plan : str
        Steps of the observer; empty for its default.
    time_scale : float
        Simulated seconds a second; 0 as fast as the machine can.
    model_file : str
        Active pointing model at the start.
    first_run : int
        Run number of the first power-on.
    sky : dict, optional
        Parameters of site and weather (`latitude_deg`, ...), for simulator and observer alike.
    reference_age : int
        The zero of a night is relative to the model of so many nights before; 0: to `model_file`.
    satellite : str
        What the step `satellite` tracks, in the sky and by the observer.
    sample_rate_hz : float, optional
        Readings a second of an exposure.
    calibration : dict, optional
        Further parameters of the calibration.
    absolute : {'angles', 'frames'}
        The simulated absolute encoder reads itself, or publishes images that `frame_reader` reads.
    mount : str
        What the observer is told of the kind of mount, see `pointing_model.mounts.parse_mount`.
    namespace : str
        In which the nodes will be started.
    kept_power_ons : int, optional
        Of observer and calibration; by default the nodes' own.

    Returns
    -------
    list of NodeSpec
    """
    kept = {} if kept_power_ons is None else {'kept_power_ons': kept_power_ons}
    sky, altaz = dict(sky or {}), parse_mount(mount, 0.0).vertical
    below = parse_mount(mount, 0.0).two_sided and sky.get('latitude_deg', 90.0) < 0.0
    names = (*NIGHT, *(['frame_reader'] if absolute == 'frames' else []))
    simulator = {'scenario': scenario, 'seed': seed} | (
        {'start_time': start_time} if start_time else {})
    parameters = {
        # live, the servo and the camera need more than the few samples around an exposure
        'mount_simulator': simulator | {'time_scale': time_scale} | _known(sky, SITE[:1]) | (
            {'sample_rate_hz': sample_rate_hz} if sample_rate_hz
            else {'sample_rate_hz': 10.0} if time_scale else {}),
        'incremental_encoder': dict(simulator),
        'absolute_encoder': simulator | ({'publishes': 'frames'} if absolute == 'frames' else {}),
        'frame_reader': every_frame(namespace) | {'mount': parse_mount(mount, 0.0).kind},
        'camera': simulator | sky | {'satellite': satellite or _of_pass(plan)},
        # a simulated mount has no cables, and without time scale its time waits for events
        'mount_guard': {
            'use_sim_time': True, 'mount': mount, 'first_rate_deg_s': 6.0,
            'second_rate_deg_s': 4.0 if altaz else 6.0, 'first_acceleration_deg_s2': 3.0,
            'second_acceleration_deg_s2': 2.0 if altaz else 3.0,
            'slew_timing': 1.0,
            # one that is simulated in the south goes through the pole below the horizon
            'least_elevation_deg': -90.0 if below else 0.0,
        } | ({'ahead_s': 1.5 * time_scale, 'request_timeout_s': 1.0, 'silence_s': 1.0,
               # half a second of the wall at full speed
               'behind_deg': min(2.0 + 3.0 * time_scale, 180.0)} | _simulated_site()
              if time_scale else {'renew_s': 0.0}) | (
            {'first_travel_deg': '-36000,36000'} if altaz
            else {'second_travel_deg': '-90,270'} if below else {}) | _known(sky, SITE),
        'star_observer': {
            'use_sim_time': True, 'renew_request_s': 0.2 if time_scale else 0.0,
            'star_seed': seed, 'model_file': model_file,
            'first_run': first_run, 'satellite': satellite, 'mount': mount,
            'wait_for_nodes': [f'{namespace}/{name}' for name in names],
        } | ({'plan': plan} if plan else {}) | sky | kept,
        'pointing_corrector': {'use_sim_time': True, 'model_file': model_file},
        'calibration': {'use_sim_time': True, 'model_file': model_file, 'split_seed': seed,
                        'reference_age': reference_age,
                        'graduation': GRATING} | kept | _mode(plan) | (calibration or {}),
        'mcap_logger': {'use_sim_time': True, 'folder': bag},
    }
    shared = {} if time_scale else dict.fromkeys(IN_TURN, 'telescope')
    return [NodeSpec(name, NODES[name], parameters[name], shared.get(name, '')) for name in names]


def _simulated_site():
    """Where a simulated mount stands, for a guard that leads it live: it goes by no default."""
    from pointing_model.sky.site import DEFAULT_SITE
    return {'latitude_deg': math.degrees(DEFAULT_SITE.latitude),
            'longitude_deg': math.degrees(DEFAULT_SITE.longitude)}


def every_frame(namespace=NAMESPACE):
    """A camera's images may be lost on the way; those of a simulated encoder must not be."""
    return {f'qos_overrides.{namespace}/absolute/frame.subscription.{policy}': value
            for policy, value in (('reliability', 'reliable'), ('depth', 5000))}


#: beside the mount of a server and what tells where it looks
BESIDE = ('mount_guard', 'star_observer', 'pointing_corrector', 'calibration', 'mcap_logger')


#: of a simulator that is asked where it looks between its readings, s: so long the axes must rest
REST_BEFORE_POLL = 0.5


def server_graph(*, bag, server, mount, sky, protocol='indi', camera=None, seen=False,
                 exposure=0.0, seed=1, plan='', model_file='', first_run=1, state_file='',
                 calibration=None, slews=None):
    """The nodes of a night on a mount of a server, on the clock of this machine.

    Parameters
    ----------
    bag : str
        Folder of the log, which must not exist.
    server : dict
        Parameters of the nodes of the bridge: `host`, `port`, `device` or `number`.
    mount : str
        Its kind, see `pointing_model.mounts.parse_mount`.
    sky : dict
        Parameters of site and weather (`latitude_deg`, ...), for all.
    protocol : {'indi', 'alpaca'}
    camera : dict, optional
        Parameters of `indi_sky`, `host`, `port` and `camera`, where a camera sees the sky; by
        default a simulator tells where it looks.
    seen : bool
        A driver of the user's publishes what is seen; no node of the bridge does.
    exposure : float
        Of the camera or driver, s; see `real_graph`.
    seed : int
        Of the choice of stars, and the noise of what is seen.
    plan, model_file, first_run, calibration
        As of `night_graph`.
    state_file : str
        As of `real_graph`.
    slews : dict, optional
        Parameters of the guard where it is known how the driver slews; by default nothing is.

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
            'seed': seed, 'satellite': _of_pass(plan)}
        exposure = REST_BEFORE_POLL if protocol == 'alpaca' else 0.0  # at the readings of INDI's
    names = *parameters, *BESIDE
    parameters |= {
        'mount_guard': {'mount': mount, 'goto': True, 'park_deg': KINDS[mount].park_deg,
                        # a driver stops a moment after it is told
                        'request_timeout_s': 0.35} | (
            # none is sent places beyond the zenith
            {'second_travel_deg': '-5,89'} if KINDS[mount].vertical else {}) | (
            slews or {'slew_timing': 0.0}) | _known(sky, SITE),
        'star_observer': {
            'star_seed': seed, 'model_file': model_file, 'first_run': first_run, 'mount': mount,
            'state_file': state_file,
            # the driver chooses its side at the meridian by itself
            'absolute_encoder': False, 'meridian_limit_deg': 0.0,
            # it comes to rest beside the star first, and is sent on
            'on_target_arcsec': 3.0, 'renew_request_s': 0.1, 'exposure_s': exposure,
            'wait_for_nodes': [f'{NAMESPACE}/{name}' for name in names],
        } | ({'plan': plan} if plan else {}) | sky,
        'pointing_corrector': {'model_file': model_file},
        'calibration': {'model_file': model_file, 'split_seed': seed} | _mode(plan) | (
            calibration or {}),
        'mcap_logger': {'folder': bag, 'exclude': [TRUTH]},
    }
    return [NodeSpec(name, NODES[name], parameters[name]) for name in names]


#: all but the hardware, whose drivers take the place of the simulator's nodes
REAL = tuple(name for name in NIGHT if name not in SIMULATED)


def real_graph(*, bag, plan='', mount='altaz', sky=None, model_file='', absolute_encoder=False,
               inclinometer=False, exposure=0.0, state_file='', calibration=None,
               namespace=NAMESPACE, autostart=True):
    """The nodes beside the drivers of a real mount, on the time of the wall.

    Parameters
    ----------
    bag, plan, model_file, sky, mount, calibration, namespace
        As of `night_graph`.
    absolute_encoder : bool
        Whether a driver publishes `absolute/joint_states`.
    inclinometer : bool
        Whether a driver publishes `inclinometer`.
    exposure : float
        Length of the camera's exposures, s, over which the mount must rest on its track; 0: it is
        tested in their middle.
    state_file : str
        Where the observer keeps the night, so that it goes on after the graph was killed.
    autostart : bool
        Whether the guard becomes active by itself.

    Returns
    -------
    list of NodeSpec
    """
    sky = dict(sky or {})
    parameters = {
        'mount_guard': {'mount': mount, 'autostart': autostart} | _known(sky, SITE),
        'star_observer': {
            'model_file': model_file, 'mount': mount, 'absolute_encoder': absolute_encoder,
            'inclinometer': inclinometer, 'exposure_s': exposure, 'state_file': state_file,
            'wait_for_nodes': [f'{namespace}/{name}' for name in REAL],
        } | ({'plan': plan} if plan else {}) | sky,
        'pointing_corrector': {'model_file': model_file},
        'calibration': {'model_file': model_file} | _mode(plan) | (calibration or {}),
        'mcap_logger': {'folder': bag, 'exclude': [TRUTH]},
    }
    return [NodeSpec(name, NODES[name], parameters[name]) for name in REAL]


#: with which a measured run is tested as a night is
MEASURED = ('run_player', 'pointing_corrector', 'calibration', 'mcap_logger')


def measured_graph(*, bag, player, seed=1, calibration=None):
    """The nodes that take a measured run as they take a night.

    Parameters
    ----------
    bag : str
        Folder of the log, which must not exist.
    player : dict
        Parameters of the run player: `file` at least.
    seed : int
        Of the choice of held-out rows.
    calibration : dict, optional
        Further parameters of the calibration.

    Returns
    -------
    list of NodeSpec
    """
    parameters = {
        'run_player': {'seed': seed, 'wait_for_nodes': [
            f'{NAMESPACE}/{name}' for name in MEASURED]} | player,
        'pointing_corrector': {'use_sim_time': True},
        # the rows of the file are all that will come
        'calibration': {'use_sim_time': True, 'split_seed': seed, 'kept_power_ons': 0} | (
            calibration or {}),
        'mcap_logger': {'use_sim_time': True, 'folder': bag},
    }
    return [NodeSpec(name, NODES[name], parameters[name]) for name in MEASURED]


def replay_graph(bag, prefix, played, seed=1, reference=None, calibration=None):
    """The nodes that calibrate anew on a log.

    Parameters
    ----------
    bag : str
        The log.
    prefix : str
        The namespace in which it was recorded, as ``/mount/``.
    played : sequence of str
        Full names of its topics to publish, that of the observations first.
    seed : int
        Of the choice of held-out stars.
    reference : str or Path, optional
        The reference model that the night had.
    calibration : dict, optional
        Further parameters of the calibration.
    """
    here = f'{NAMESPACE}/'
    parameters = {
        'mcap_replay': {'bag': bag, 'rate': 0.0, 'topics': list(played),
                        'remaps': [''] if prefix == here else [
                            f'{name}:={here}{name[len(prefix):]}' for name in played],
                        'wait_for_topics': [played[0]], 'exit_at_end': False},
        'calibration': {'model_file': str(reference or ''), 'split_seed': seed} | (
            calibration or {}),
    }
    return [NodeSpec(name, NODES[name], values) for name, values in parameters.items()]
