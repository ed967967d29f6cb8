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

"""Common parts of the launch files. Only they import it: ROS launch is in no wheel."""

import difflib
import os
import re
import sys
from pathlib import Path

from ament_index_python.packages import get_package_prefix
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    ExecuteProcess,
    LogInfo,
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
from msg_tools.units import DEG
from pointing_model.mount_shape import urdf
from pointing_model.mounts import parse_mount
from pointing_model.sky.site import DEFAULT_SITE

from . import ONE_THREAD
from .dds import dds_environment
from .input_files.parameter_file import check, sections, values_of
from .processes.parent import PARENT

#: arguments of every launch file: name, default, text
SHARED = (
    ('namespace', NAMESPACE, 'of the graph: a separate one for each mount'),
    ('display', 'true', 'mount_display, and robot_state_publisher where it is installed: RViz and '
     'Foxglove show the mount'),
    ('params_file', '', 'ROS parameter file (site, limits), read by all nodes after the values '
     'above'),
)
ENVIRONMENT = {**dds_environment(), **ONE_THREAD}


class Values(dict):
    """Launch arguments by name, as text.

    Raises
    ------
    ValueError
        An unknown argument, or an unusable value of a common one.
    """

    def __init__(self, file, arguments, context):
        names = [name for name, _, _ in arguments]
        # launch accepts any name, and a night would run without what the user wanted. If another
        # launch file includes this one, its arguments are unknown
        given = context.argv if any(word.endswith(file) for word in sys.argv) else ()
        for word in given or ():
            name, assigned, _ = word.partition(':=')
            if assigned and name not in names:
                close = difflib.get_close_matches(name, names, 1)
                raise ValueError(f'{file} has no argument {name}; ' + (
                    f'did you mean {close[0]}?' if close else f'it has {", ".join(names)}'))
        super().__init__((name, LaunchConfiguration(name).perform(context)) for name in names)
        if self['params_file'] and not Path(self['params_file']).is_file():
            # launch only warns, and the night would run with another site
            raise ValueError(f'params_file:={self["params_file"]} is no file')
        if not re.fullmatch('(/[A-Za-z][A-Za-z0-9_]*)+', self['namespace']):
            raise ValueError(f'namespace:={self["namespace"]}: write a name such as {NAMESPACE}')

    def number(self, kind, name):
        """A number of type `kind`, int or float; ValueError for other text."""
        try:
            return kind(self[name])
        except ValueError:
            what = 'whole number' if kind is int else 'number'
            raise ValueError(f'{name}:={self[name]} is no {what}') from None

    def truth(self, name):
        """A bool; ValueError for other text."""
        if self[name] not in ('true', 'false'):
            raise ValueError(f'{name}:={self[name]}: write true or false')
        return self[name] == 'true'

    @property
    def files(self):
        """The user's parameter files, list of str."""
        return [self['params_file']] if self['params_file'] else []


def started(values, specs, drivers=()):
    """Actions that start drivers and nodes, and end all when the first one ends.

    Parameters
    ----------
    values : Values
    specs : sequence of graph.NodeSpec
    drivers : sequence of str
        Python files of drivers.

    Returns
    -------
    list
    """
    # on a busy machine closing all files takes longer than launch's 5 s
    patient = {'output': 'screen',
               'sigterm_timeout': LaunchConfiguration('sigterm_timeout', default='20')}
    notes = [LogInfo(msg=text) for path in values.files or [None]
             for text in check(specs, path, drivers, values['namespace'])]
    given = [word for path in values.files for word in ('--params-file', path)]
    processes = [ExecuteProcess(
        cmd=[sys.executable, '-m', 'telescope_mount.processes.parent', path, '--ros-args', '-r',
             f'__ns:={values["namespace"]}', *given],
        name=Path(path).stem, **patient) for path in drivers]
    pictures = _pictures(values, specs) if values.truth('display') else []
    processes += [Node(package='telescope_mount', executable=spec.name, name=spec.name,
                       namespace=values['namespace'],
                       parameters=[spec.parameters, *values.files], **patient) for spec in specs]
    # without one of them a night would wait forever
    return notes + processes + pictures + [
        RegisterEventHandler(OnProcessExit(target_action=process, on_exit=end_all))
        for process in processes]


def _pictures(values, specs):
    """Nodes that display the mount; a night continues without them."""
    observer = next(spec.parameters for spec in specs if spec.name == 'star_observer')
    own = {name: observer[name] for name in ('mount', 'use_sim_time') if name in observer}
    place = {'namespace': values['namespace'], 'output': 'screen'}
    display = {'package': 'telescope_mount', 'executable': 'mount_display',
               'name': 'mount_display', **place}
    try:
        get_package_prefix('robot_state_publisher')
    except (LookupError, OSError):  # no tf: use markers
        return [Node(parameters=[own, *values.files], **display)]
    for path in values.files:
        observer = values_of(f'{values["namespace"]}/star_observer', observer, sections(path))
    latitude = observer.get('latitude_deg', DEFAULT_SITE.latitude / DEG)
    shape = urdf(parse_mount(own['mount'], latitude * DEG))
    return [Node(parameters=[own | {'description': False}, *values.files], **display),
            Node(package='robot_state_publisher', executable='robot_state_publisher',
                 name='robot_state_publisher', **place, parameters=[{
                     'robot_description': shape,
                     'use_sim_time': own.get('use_sim_time', False)}])]


def end_all(event, context):
    """End the launch when a process ends: with code 1 unless the process had 0."""
    if context.is_shutdown:  # Ctrl-C: every process has its signal already
        return None
    if event.returncode:  # launch then ends with code 1 and this line
        raise RuntimeError(f'{event.process_name} ended with code {event.returncode}')
    return EmitEvent(event=Shutdown(reason=f'{event.process_name} ended'))


def description(file, arguments, actions):
    """The LaunchDescription.

    Parameters
    ----------
    file : str
        Name of the launch file.
    arguments : sequence of (str, str, str)
        Name, default, text, as listed by `ros2 launch ... --show-args`. `SHARED` follow them.
    actions : callable
        ``actions(values)`` with a `Values` returns the actions; ValueError for unusable values.
    """
    arguments = (*arguments, *SHARED)
    return LaunchDescription([
        *(SetEnvironmentVariable(name, os.environ.get(name, default))
          for name, default in ENVIRONMENT.items()),
        SetEnvironmentVariable(PARENT, str(os.getpid())),
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in arguments),
        OpaqueFunction(function=lambda context: actions(Values(file, arguments, context)))])
