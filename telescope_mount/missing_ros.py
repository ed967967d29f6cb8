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

"""What to do if ROS is not installed: one line with the command that installs it."""

import platform
import sys
from importlib.util import find_spec
from pathlib import Path

from msg_tools.open_files import check_open_files

#: beginnings of names of modules that only ROS provides
_ROS_PACKAGES = ('rclpy', 'rcl_interfaces', 'rosidl', 'rpyutils', 'builtin_interfaces',
                 'lifecycle_msgs', 'rosgraph_msgs', 'std_msgs', 'std_srvs', 'sensor_msgs',
                 'geometry_msgs', 'trajectory_msgs', 'diagnostic_msgs', 'visualization_msgs')


def check(command):
    """Refuse a command that needs ROS if ROS is missing or cannot run.

    Raises
    ------
    ValueError
        With the command that installs it, or makes it run.
    """
    if find_spec('rclpy') is None:
        raise ValueError(_line(command))
    check_open_files()


def missing(error, command):
    """Message for an ImportError due to a missing or incomplete ROS; else None.

    Parameters
    ----------
    error : ImportError
    command : str
        The user's command.
    """
    name = error.name or ''
    if not name.startswith(_ROS_PACKAGES):
        return None
    return _line(command, '' if isinstance(error, ModuleNotFoundError)
                 else f' ({" ".join(str(error).split())[:120]})')


def _line(command, why=''):
    root = Path(__file__).resolve().parents[1]
    there = sorted(Path('/opt/ros').glob('*/setup.bash')) if sys.platform == 'linux' else []
    if there:
        how = f'source {there[-1]}'
    elif sys.platform != 'linux' or platform.machine() not in ('x86_64', 'AMD64'):
        how = 'install ROS 2 Jazzy (its wheels are for Linux on x86-64 only)'
    elif (root / 'install.sh').is_file() and Path(sys.prefix).resolve() == root / '.venv':
        how = f'{root / "install.sh"} ros'
    else:
        how = (f"{sys.executable} -m pip install 'ros-jazzy-rclpy[fastrtps]' "
               'ros-jazzy-common-interfaces')
    return (f'{command} needs ROS 2, which cannot be loaded here{why}; do: {how}')
