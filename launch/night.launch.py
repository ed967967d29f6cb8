"""A simulated night under ROS launch: the same graph as `telescope-mount night`."""

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from msg_tools import NAMESPACE
from pointing_model.plan import night_plan
from telescope_mount.graph import night_graph

ARGUMENTS = (
    ('bag', 'night_bag', 'folder of the log; it must not exist'),
    ('scenario', 'default', 'what is wrong with the simulated mount'),
    ('seed', '1', 'of every random number'),
    ('stars', '30', 'in each of the two blocks'),
    ('polaris', '16', 'exposures of Polaris for a zero'),
    ('start_time', '', 'UTC at which the night begins, ISO 8601'),
    ('time_scale', '0.0', 'simulated seconds a second; 0: as fast as the graph answers'),
    ('params_file', '', 'ROS parameter file, read after the values above'),
)


def _nodes(context):
    value = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    specs = night_graph(
        bag=value['bag'], scenario=value['scenario'], seed=int(value['seed']),
        start_time=value['start_time'], time_scale=float(value['time_scale']),
        plan=night_plan(int(value['stars']), int(value['polaris'])))
    more = [value['params_file']] if value['params_file'] else []
    nodes = [Node(package='telescope_mount', executable=spec.name, name=spec.name,
                  namespace=NAMESPACE, parameters=[spec.parameters, *more], output='screen')
             for spec in specs]
    # a night without one of its nodes would wait for ever
    ends = [RegisterEventHandler(OnProcessExit(
        target_action=node, on_exit=[EmitEvent(event=Shutdown(reason='a node ended'))]))
        for node in nodes]
    return nodes + ends


def generate_launch_description():
    """Arguments as `ros2 launch telescope_mount night.launch.py --show-args` lists them."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        OpaqueFunction(function=_nodes)])
