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

"""The description of the graph: its nodes and their parameters.

`telescope-mount` starts it with its own processes, `launch/night.launch.py` with ROS launch.
The graph for the mount of a server is `server_night.server_graph`.
"""

import math
from dataclasses import dataclass, field

from msg_tools import NAMESPACE
from pointing_model.mounts import parse_mount
from telescope_mount.observing.plan import parse_plan

#: executable -> module; setup.py makes an executable for each
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

#: executables that need types of telescope_mount_msgs, which is built separately
WITH_BUILT_TYPES = {
    'action_bridge': 'telescope_mount.bridges.actions.action_bridge_node',
}

#: lines per turn of the simulated incremental encoder (paper 000)
GRATING = 'grating=47200'
SIMULATED = ('mount_simulator', 'incremental_encoder', 'absolute_encoder', 'camera')
NIGHT = (*SIMULATED, 'mount_guard', 'star_observer', 'pointing_corrector', 'mcap_logger',
         'calibration')

#: without a time scale these nodes wait for each other in turn: in separate processes most of a
#: night would be start-up and transport of messages
IN_TURN = (*SIMULATED, 'frame_reader', 'mount_guard', 'star_observer', 'pointing_corrector')

#: topics that only simulated hardware publishes
TRUTH = '.*/truth/.*'

#: parameters of the site
SITE = ('latitude_deg', 'longitude_deg', 'height_m')


@dataclass(frozen=True)
class NodeSpec:
    """A node to start: its executable, its module and its parameters.

    Nodes with the same `process` share a process of that name; by default each has its own.
    """

    name: str
    module: str
    parameters: dict = field(default_factory=dict)
    process: str = ''

    @property
    def full_name(self):
        """Fully qualified node name, in the namespace of the command line."""
        return f'{NAMESPACE}/{self.name}'


def given_of(sky, names):
    """Those parameters in `names` of site and weather that are given."""
    return {name: sky[name] for name in names if name in sky}


def pass_of(plan):
    """The satellite of the passes in a plan, which the simulated sky must contain."""
    found = [step.what for step in parse_plan(plan) if step.verb == 'pass'] if plan else []
    return found[0] if found else ''


def mode_of(plan):
    """Mode of the calibration: a plan with the step `track` needs a model after each star."""
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
        Folder of the log, which must not exist; the truth is written next to it.
    scenario : str
        Errors of the simulated mount; only the simulator's nodes read it.
    seed : int
        Seed of all random numbers.
    start_time : str
        UTC, ISO 8601; empty for the simulator's default.
    plan : str
        Steps of the observer; empty for its default.
    time_scale : float
        Simulated seconds per second; 0: as fast as the machine can.
    model_file : str
        Active pointing model at the start.
    first_run : int
        Run number of the first power-on.
    sky : dict, optional
        Parameters of site and weather (`latitude_deg`, ...), for both simulator and observer.
    reference_age : int
        The zero of a night is relative to the model of this many nights before; 0: to
        `model_file`.
    satellite : str
        Satellite for the step `satellite`, in the sky and for the observer.
    sample_rate_hz : float, optional
        Readings per second of an exposure.
    calibration : dict, optional
        Further parameters of the calibration.
    absolute : {'angles', 'frames'}
        The simulated absolute encoder publishes angles, or images that `frame_reader` reads.
    mount : str
        Kind of mount for the observer, see `pointing_model.mounts.parse_mount`.
    namespace : str
        Namespace of the nodes.
    kept_power_ons : int, optional
        For observer and calibration; by default the nodes' own.

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
        # live, servo and camera need more than the few samples around an exposure
        'mount_simulator': simulator | {'time_scale': time_scale} | given_of(sky, SITE[:1]) | (
            {'sample_rate_hz': sample_rate_hz} if sample_rate_hz
            else {'sample_rate_hz': 10.0} if time_scale else {}),
        'incremental_encoder': dict(simulator),
        'absolute_encoder': simulator | ({'publishes': 'frames'} if absolute == 'frames' else {}),
        'frame_reader': every_frame(namespace) | {'mount': parse_mount(mount, 0.0).kind},
        'camera': simulator | sky | {'satellite': satellite or pass_of(plan)},
        # a simulated mount has no cables; without a time scale its time waits for events
        'mount_guard': {
            'use_sim_time': True, 'mount': mount, 'first_rate_deg_s': 6.0,
            'second_rate_deg_s': 4.0 if altaz else 6.0, 'first_acceleration_deg_s2': 3.0,
            'second_acceleration_deg_s2': 2.0 if altaz else 3.0,
            'slew_timing': 1.0,
            # a simulated mount in the south goes through the pole below the horizon
            'least_elevation_deg': -90.0 if below else 0.0,
        } | ({'ahead_s': 1.5 * time_scale, 'request_timeout_s': 1.0, 'silence_s': 1.0,
               # half a second of wall time at full speed
               'behind_deg': min(2.0 + 3.0 * time_scale, 180.0)} | simulated_site()
              if time_scale else {'renew_s': 0.0}) | (
            {'first_travel_deg': '-36000,36000'} if altaz
            else {'second_travel_deg': '-90,270'} if below else {}) | given_of(sky, SITE),
        'star_observer': {
            'use_sim_time': True, 'renew_request_s': 0.2 if time_scale else 0.0,
            'star_seed': seed, 'model_file': model_file,
            'first_run': first_run, 'satellite': satellite, 'mount': mount,
            'wait_for_nodes': [f'{namespace}/{name}' for name in names],
        } | ({'plan': plan} if plan else {}) | sky | kept,
        'pointing_corrector': {'use_sim_time': True, 'model_file': model_file},
        'calibration': {'use_sim_time': True, 'model_file': model_file, 'split_seed': seed,
                        'reference_age': reference_age,
                        'graduation': GRATING} | kept | mode_of(plan) | (calibration or {}),
        'mcap_logger': {'use_sim_time': True, 'folder': bag},
    }
    shared = {} if time_scale else dict.fromkeys(IN_TURN, 'telescope')
    return [NodeSpec(name, NODES[name], parameters[name], shared.get(name, '')) for name in names]


def simulated_site():
    """Site of a simulated mount, for a guard that runs live: it accepts no default."""
    from pointing_model.sky.site import DEFAULT_SITE
    return {'latitude_deg': math.degrees(DEFAULT_SITE.latitude),
            'longitude_deg': math.degrees(DEFAULT_SITE.longitude)}


def every_frame(namespace=NAMESPACE):
    """Reliable QoS for images: a camera may lose some, a simulated encoder must not."""
    return {f'qos_overrides.{namespace}/absolute/frame.subscription.{policy}': value
            for policy, value in (('reliability', 'reliable'), ('depth', 5000))}


#: all nodes except the hardware, for which drivers replace the simulator's nodes
REAL = tuple(name for name in NIGHT if name not in SIMULATED)


def real_graph(*, bag, plan='', mount='altaz', sky=None, model_file='', absolute_encoder=False,
               inclinometer=False, exposure=0.0, state_file='', calibration=None,
               namespace=NAMESPACE, autostart=True):
    """The nodes besides the drivers of a real mount, on wall time.

    Parameters
    ----------
    bag, plan, model_file, sky, mount, calibration, namespace
        See `night_graph`.
    absolute_encoder : bool
        Whether a driver publishes `absolute/joint_states`.
    inclinometer : bool
        Whether a driver publishes `inclinometer`.
    exposure : float
        Exposure time of the camera, s, during which the mount must stay on its track; 0: this is
        checked only at mid-exposure.
    state_file : str
        File in which the observer saves the night, to resume it after the graph was killed.
    autostart : bool
        Whether the guard activates itself.

    Returns
    -------
    list of NodeSpec
    """
    sky = dict(sky or {})
    parameters = {
        'mount_guard': {'mount': mount, 'autostart': autostart} | given_of(sky, SITE),
        'star_observer': {
            'model_file': model_file, 'mount': mount, 'absolute_encoder': absolute_encoder,
            'inclinometer': inclinometer, 'exposure_s': exposure, 'state_file': state_file,
            'wait_for_nodes': [f'{namespace}/{name}' for name in REAL],
        } | ({'plan': plan} if plan else {}) | sky,
        'pointing_corrector': {'model_file': model_file},
        'calibration': {'model_file': model_file} | mode_of(plan) | (calibration or {}),
        'mcap_logger': {'folder': bag, 'exclude': [TRUTH]},
    }
    return [NodeSpec(name, NODES[name], parameters[name]) for name in REAL]


#: nodes with which a measured run is tested like a night
MEASURED = ('run_player', 'pointing_corrector', 'calibration', 'mcap_logger')


def measured_graph(*, bag, player, seed=1, calibration=None):
    """The nodes that process a measured run like a night.

    Parameters
    ----------
    bag : str
        Folder of the log, which must not exist.
    player : dict
        Parameters of the run player, at least `file`.
    seed : int
        Seed of the choice of held-out rows.
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
        # no more rows will come than those of the file
        'calibration': {'use_sim_time': True, 'split_seed': seed, 'kept_power_ons': 0} | (
            calibration or {}),
        'mcap_logger': {'use_sim_time': True, 'folder': bag},
    }
    return [NodeSpec(name, NODES[name], parameters[name]) for name in MEASURED]


def replay_graph(bag, prefix, played, seed=1, reference=None, calibration=None):
    """The nodes that repeat a calibration on a log.

    Parameters
    ----------
    bag : str
        The log.
    prefix : str
        The namespace in which it was recorded, e.g. ``/mount/``.
    played : sequence of str
        Full names of its topics to publish, the observations first.
    seed : int
        Seed of the choice of held-out stars.
    reference : str or Path, optional
        The reference model of the night.
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
