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

"""Mock hardware under ros2_control that follows `command` of the graph.

    ros2 launch telescope_mount mock_mount.launch.py
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

HERE = Path(__file__).resolve().parent
#: the graph also has a robot_description, of the model shown in RViz
REMAPPED = [('robot_description', 'hardware_description'),
            ('joint_states', 'joint_state_broadcaster/joint_states')]
#: remappings of each controller's topics to those of the graph
CONTROLLERS = {'joint_state_broadcaster': '',
               'mount_controller': '-r ~/joint_trajectory:=command'}


def generate_launch_description():
    """The controller_manager and its controllers, in the namespace of the mount."""
    namespace = LaunchConfiguration('namespace')
    description = (HERE / 'mount.urdf').read_text()
    spawners = [Node(package='controller_manager', executable='spawner', namespace=namespace,
                     arguments=[name, '--controller-manager', 'controller_manager',
                                *(['--controller-ros-args', names] if names else [])])
                for name, names in CONTROLLERS.items()]
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='/mount'),
        Node(package='robot_state_publisher', executable='robot_state_publisher',
             namespace=namespace, parameters=[{'robot_description': description}],
             remappings=REMAPPED),
        Node(package='controller_manager', executable='ros2_control_node', namespace=namespace,
             parameters=[str(HERE / 'controllers.yaml')], remappings=REMAPPED[:1]),
        *spawners])
