"""A simulated night under ROS launch: the same graph as `telescope-mount night`."""

import os
from pathlib import Path

from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
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
from pointing_model.observing.plan import night_plan
from telescope_mount.graph import night_graph
from telescope_mount.simulator import kind_of_mount
from telescope_mount.threads import ONE_THREAD

ARGUMENTS = (
    ('bag', 'night_bag', 'folder of the log; it must not exist'),
    ('scenario', 'default', 'what is wrong with the simulated mount'),
    ('mount', '', 'altaz, equatorial, german, free:AZ,EL; empty: what the scenario has'),
    ('seed', '1', 'of every random number'),
    ('stars', '30', 'in each of the two blocks'),
    ('polaris', '16', 'exposures for a zero: of Polaris where it is well up, else of stars'),
    ('start_time', '', 'UTC at which the night begins, ISO 8601'),
    ('time_scale', '0.0', 'simulated seconds a second; 0: as fast as the graph answers'),
    ('params_file', '', 'ROS parameter file, read after the values above'),
)

ENVIRONMENT = {
    # opening the graph to the network is the user's explicit choice
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    **ONE_THREAD,
}


def _number(kind, value, name):
    try:
        return kind(value[name])
    except ValueError:
        what = 'whole number' if kind is int else 'number'
        raise ValueError(f'{name}:={value[name]} is no {what}') from None


def _nodes(context):
    value = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    # launch itself only warns, and the night would run with another site
    if value['params_file'] and not Path(value['params_file']).is_file():
        raise ValueError(f'params_file:={value["params_file"]} is no file')
    specs = night_graph(
        bag=value['bag'], scenario=value['scenario'], seed=_number(int, value, 'seed'),
        mount=value['mount'] or kind_of_mount(value['scenario']),
        start_time=value['start_time'], time_scale=_number(float, value, 'time_scale'),
        plan=night_plan(_number(int, value, 'stars'), _number(int, value, 'polaris')))
    more = [value['params_file']] if value['params_file'] else []
    nodes = [Node(package='telescope_mount', executable=spec.name, name=spec.name,
                  namespace=NAMESPACE, parameters=[spec.parameters, *more], output='screen')
             for spec in specs]
    # a night without one of its nodes would wait for ever
    ends = [RegisterEventHandler(OnProcessExit(target_action=node, on_exit=_end_all))
            for node in nodes]
    return nodes + ends


def _end_all(event, context):
    if context.is_shutdown:  # Ctrl-C: all end, and each has its signal already
        return None
    if event.returncode:  # launch ends all the same, but with code 1 and this line
        raise RuntimeError(f'{event.process_name} ended with code {event.returncode}')
    return EmitEvent(event=Shutdown(reason=f'{event.process_name} ended'))


def generate_launch_description():
    """Arguments as `ros2 launch telescope_mount night.launch.py --show-args` lists them."""
    return LaunchDescription([
        *(SetEnvironmentVariable(name, os.environ.get(name, default))
          for name, default in ENVIRONMENT.items()),
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        OpaqueFunction(function=_nodes)])
