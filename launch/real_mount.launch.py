"""The graph of a real mount under ROS launch: drivers, and the nodes that are no hardware."""

import os
import sys
from pathlib import Path

from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from msg_tools import NAMESPACE
from pointing_model.observing.plan import parse_plan, real_plan
from telescope_mount.graph import real_graph
from telescope_mount.threads import ONE_THREAD

EXAMPLES = Path(__file__).resolve().parents[1] / 'examples'
SAMPLES = ','.join(str(EXAMPLES / f'{name}.py') for name in (
    'toy_telescope', 'mount_driver', 'encoder_driver', 'camera_driver'))
ARGUMENTS = (
    ('bag', 'night_bag', 'folder of the log; it must not exist'),
    ('mount', 'altaz', 'altaz, equatorial, german, free:AZ,EL'),
    ('drivers', SAMPLES, 'Python files to start, separated by commas; none: they run already'),
    ('absolute_encoder', 'false', 'whether a driver publishes absolute/joint_states'),
    ('exposure', '0.0', "length of the camera's exposures, s, in which the mount must rest on its "
     'track; 0: it is judged in their middle'),
    ('state_file', '', 'file in which the night is kept: started again with it (and another bag), '
     'a plan that was interrupted goes on; none: not kept'),
    ('plan', real_plan(30), 'steps of the observer'),
    ('params_file', '', 'ROS parameter file (site, limits), read by all nodes and drivers'),
)
ENVIRONMENT = {
    # opening the graph to the network is the user's explicit choice
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    **ONE_THREAD,
}


def _actions(context):
    value = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    # launch itself only warns, and the night would run with another site
    if value['params_file'] and not Path(value['params_file']).is_file():
        raise ValueError(f'params_file:={value["params_file"]} is no file')
    if value['absolute_encoder'] not in ('true', 'false'):
        raise ValueError(f'absolute_encoder:={value["absolute_encoder"]}: write true or false')
    parse_plan(value['plan'])
    try:
        exposure = float(value['exposure'])
    except ValueError:
        raise ValueError(f'exposure:={value["exposure"]} is no number') from None
    drivers = [] if value['drivers'] == 'none' else value['drivers'].split(',')
    for path in drivers:
        if not Path(path).is_file():
            raise ValueError(f'drivers:= names {path}, which is no file')
    more = [value['params_file']] if value['params_file'] else []
    given = [word for path in more for word in ('--params-file', path)]
    started = [ExecuteProcess(
        cmd=[sys.executable, path, '--ros-args', '-r', f'__ns:={NAMESPACE}', *given],
        name=Path(path).stem, output='screen') for path in drivers]
    specs = real_graph(bag=value['bag'], plan=value['plan'], mount=value['mount'],
                       absolute_encoder=value['absolute_encoder'] == 'true', exposure=exposure,
                       state_file=value['state_file'])
    started += [Node(package='telescope_mount', executable=spec.name, name=spec.name,
                     namespace=NAMESPACE, parameters=[spec.parameters, *more], output='screen')
                for spec in specs]
    # a night without one of them would wait for ever
    return started + [RegisterEventHandler(OnProcessExit(target_action=action, on_exit=_end_all))
                      for action in started]


def _end_all(event, context):
    if context.is_shutdown:  # Ctrl-C: all end, and each has its signal already
        return None
    if event.returncode:  # launch ends all the same, but with code 1 and this line
        raise RuntimeError(f'{event.process_name} ended with code {event.returncode}')
    return EmitEvent(event=Shutdown(reason=f'{event.process_name} ended'))


def generate_launch_description():
    """Arguments as `ros2 launch telescope_mount real_mount.launch.py --show-args` lists them."""
    return LaunchDescription([
        *(SetEnvironmentVariable(name, os.environ.get(name, default))
          for name, default in ENVIRONMENT.items()),
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        OpaqueFunction(function=_actions)])
