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

"""The launch files: the graphs they describe, and how they end; with a stand-in for launch."""

import importlib.util
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from places import ROOT

from msg_tools import NAMESPACE
from pointing_model.mount_shape import urdf
from pointing_model.mounts import parse_mount
from telescope_mount.graph import NIGHT, night_graph, real_graph
from telescope_mount.observing.plan import night_plan, real_plan
from telescope_mount.processes.parent import PARENT
from telescope_mount.simulation import scenario_names

FILE = ROOT / 'launch' / 'night.launch.py'
REAL_FILE = ROOT / 'launch' / 'real_mount.launch.py'
SITE = str(ROOT / 'config' / 'site.yaml')


class Described:
    """Any action: what it was made with."""

    def __init__(self, *args, **values):
        self.args, self.values = args, values

    def perform(self, context):
        return context.arguments[self.args[0]]


def stand_in(monkeypatch):
    """Modules with the names that the launch file imports, each class of its own."""
    names = {'launch': ('LaunchDescription',),
             'launch.actions': ('DeclareLaunchArgument', 'EmitEvent', 'ExecuteProcess', 'LogInfo',
                                'OpaqueFunction', 'RegisterEventHandler', 'SetEnvironmentVariable'),
             'launch.event_handlers': ('OnProcessExit',), 'launch.events': ('Shutdown',),
             'launch.substitutions': ('LaunchConfiguration',), 'launch_ros': (),
             'launch_ros.actions': ('Node',)}
    # imported anew here, and forgotten afterwards
    monkeypatch.setitem(sys.modules, 'telescope_mount.launch_actions', None)
    del sys.modules['telescope_mount.launch_actions']
    for module, classes in names.items():
        made = ModuleType(module)
        for name in classes:
            setattr(made, name, type(name, (Described,), {}))
        monkeypatch.setitem(sys.modules, module, made)


def made(path, **arguments):
    """Actions of a launch file, by class name."""
    spec = importlib.util.spec_from_file_location(path.name.split('.')[0], path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    described = module.generate_launch_description().args[0]
    declared = {action.args[0]: action.values['default_value'] for action in described
                if type(action).__name__ == 'DeclareLaunchArgument'}
    context = SimpleNamespace(arguments=declared | arguments,
                              argv=[f'{name}:={value}' for name, value in arguments.items()])
    out = {}
    for action in (*described, *described[-1].values['function'](context)):
        out.setdefault(type(action).__name__, []).append(action)
    return out


@pytest.fixture
def night(monkeypatch):
    """``night(name=value)``: what the launch file of a night makes of its arguments."""
    stand_in(monkeypatch)
    return partial(made, FILE)


@pytest.fixture
def real(monkeypatch):
    """The same of a real mount."""
    stand_in(monkeypatch)
    return partial(made, REAL_FILE)


def test_every_node_is_started_with_its_parameters_and_watched(night, tmp_path):
    (tmp_path / 'site.yaml').write_text('')
    actions = night(scenario='ideal', seed='7', bag='b', params_file=str(tmp_path / 'site.yaml'))
    *nodes, display = [node.values for node in actions['Node']]
    assert [node['executable'] for node in nodes] == [node['name'] for node in nodes] == list(NIGHT)
    wanted = {spec.name: spec.parameters for spec in night_graph(
        bag='b', scenario='ideal', seed=7, plan=night_plan(30, 16))}
    for node in nodes:
        assert node['package'] == 'telescope_mount' and node['namespace'] == NAMESPACE
        given, more = node['parameters']
        assert given == wanted[node['name']]
        assert more == str(tmp_path / 'site.yaml')
    watched = [handler.args[0].values['target_action']
               for handler in actions['RegisterEventHandler']]
    assert watched == actions['Node'][:-1]
    # the picture is none of the night: without it all goes on
    assert display['executable'] == 'mount_display'
    assert display['parameters'][0] == {'mount': 'altaz', 'use_sim_time': True}
    assert len(night(display='false')['Node']) == len(nodes)
    # and none outlives the launch
    assert [PARENT, str(os.getpid())] in [
        list(action.args) for action in actions['SetEnvironmentVariable']]


@pytest.mark.parametrize('arguments, words', [
    ({'seed': 'many'}, 'seed:=many is no whole number'),
    ({'time_scale': 'fast'}, 'time_scale:=fast is no number'),
    ({'params_file': 'absent.yaml'}, 'params_file:=absent.yaml is no file'),
    ({'namespace': 'mount2'}, 'namespace:=mount2: write a name such as /mount'),
    ({'plan': 'stars'}, 'write stars and a count'),
    ({'scenario': 'nothing'}, "no scenario 'nothing'"),
])
def test_bad_arguments_are_refused(night, arguments, words):
    with pytest.raises(ValueError, match=words):
        night(**arguments)


def test_an_argument_that_is_none_is_refused_where_this_file_was_launched(night, monkeypatch):
    night(sead='1')  # of a launch file that includes this one
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', 'telescope_mount', FILE.name, 'sead:=1'])
    with pytest.raises(ValueError, match='no argument sead; did you mean seed?'):
        night(sead='1')


def test_every_scenario_plan_and_namespace_can_be_launched(night):
    for scenario in scenario_names():
        nodes = night(scenario=scenario, namespace='/dome/north', plan='home, stars 3')['Node']
        by_name = {node.values['name']: node.values for node in nodes}
        assert {node['namespace'] for node in by_name.values()} == {'/dome/north'}
        told = by_name['star_observer']['parameters'][0]
        assert told['plan'] == 'home, stars 3'
        assert '/dome/north/camera' in told['wait_for_nodes']


def test_with_robot_state_publisher_the_mount_is_described_by_it(night, tmp_path, monkeypatch):
    index = tmp_path / 'share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    (index / 'robot_state_publisher').touch()
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    (tmp_path / 'site.yaml').write_text('/**: {ros__parameters: {latitude_deg: -30.0}}')
    *_, display, state = night(
        scenario='german', params_file=str(tmp_path / 'site.yaml'))['Node']
    assert state.values['executable'] == 'robot_state_publisher'
    assert state.values['parameters'][0] == {'use_sim_time': True, 'robot_description': urdf(
        parse_mount('german', np.radians(-30.0)))}
    # which publishes robot_description: it has one publisher
    assert display.values['parameters'][0]['description'] is False


def test_a_real_mount_is_launched_with_sample_drivers_or_ones_own(real):
    actions = real(bag='b', mount='german', params_file=SITE, absolute_encoder='true', exposure='1',
                   display='false')
    wanted = real_graph(bag='b', plan=real_plan(30), mount='german', absolute_encoder=True,
                        exposure=1.0)
    assert [(node.values['name'], node.values['parameters']) for node in actions['Node']] == [
        (spec.name, [spec.parameters, SITE]) for spec in wanted]
    drivers = [process.values['cmd'] for process in actions['ExecuteProcess']]
    assert sorted(Path(words[3]).name for words in drivers) == sorted(
        path.name for path in (ROOT / 'examples').glob('*.py'))
    assert all(words[4:] == ['--ros-args', '-r', f'__ns:={NAMESPACE}', '--params-file', SITE]
               for words in drivers)
    assert len(actions['RegisterEventHandler']) == len(wanted) + len(drivers)
    assert 'ExecuteProcess' not in real(drivers='none', params_file=SITE)


def test_a_parameter_file_that_sets_nothing_is_refused_and_what_drivers_read_is_named(
        real, night, tmp_path):
    with pytest.raises(ValueError, match='no site for mount_guard and star_observer'):
        real()
    path = tmp_path / 'mine.yaml'
    path.write_text(Path(SITE).read_text() + '/**/dome: {ros__parameters: {slit_m: 2.0}}\n')
    with pytest.raises(ValueError, match=f'{path}: section /../dome matches no node in /mount'):
        night(params_file=str(path))
    assert [action.values['msg'] for action in real(params_file=str(path))['LogInfo']] == [
        f'{path}: section /**/dome matches no node here; a driver of that name may read it']
    path.write_text('/mount/camera: {ros__parameters: {seed: 2}}')
    assert night(params_file=str(path))
    with pytest.raises(ValueError, match=r'no node in /dome/north: write /\*\*/camera'):
        night(params_file=str(path), namespace='/dome/north')


@pytest.mark.parametrize('arguments, words', [
    ({'drivers': 'absent.py'}, 'drivers:= names absent.py, which is no file'),
    ({'absolute_encoder': 'yes'}, 'absolute_encoder:=yes: write true or false'),
    ({'exposure': 'long'}, 'exposure:=long is no number'),
    ({'plan': 'stars'}, 'write stars and a count'),
])
def test_bad_arguments_of_a_real_mount_are_refused(real, arguments, words):
    with pytest.raises(ValueError, match=words):
        real(**arguments)


def test_a_node_that_ends_ends_all(monkeypatch):
    stand_in(monkeypatch)
    from telescope_mount.launch_actions import end_all
    running, ending = SimpleNamespace(is_shutdown=False), SimpleNamespace(is_shutdown=True)
    well = SimpleNamespace(process_name='camera-4', returncode=0)
    refused = SimpleNamespace(process_name='camera-4', returncode=2)
    assert end_all(well, running).values['event'].values == {'reason': 'camera-4 ended'}
    # what launch makes exit code 1 of
    with pytest.raises(RuntimeError, match='^camera-4 ended with code 2$'):
        end_all(refused, running)
    assert end_all(well, ending) is end_all(refused, ending) is None


@pytest.mark.parametrize('words, marked', [
    (['ros2', 'run', 'telescope_mount', 'camera'], False), (['ros2', 'launch', FILE.name], False),
    (['own_launch.py'], True)])
def test_a_process_of_a_launch_or_of_ros2_run_ends_with_it(tmp_path, words, marked):
    script = tmp_path / 'driver.py'
    script.write_text('import os, time\nprint(os.getpid(), flush=True)\ntime.sleep(600)\n')
    starter = tmp_path / words[0]
    starter.write_text(f"""
import os, subprocess, sys
if {marked}:
    os.environ[{PARENT!r}] = str(os.getpid())
subprocess.Popen([sys.executable, '-m', 'telescope_mount.processes.parent', {str(script)!r}]).wait()
""")
    launch = subprocess.Popen([sys.executable, str(starter), *words[1:]], cwd=ROOT,
                              stdout=subprocess.PIPE, text=True)
    driver = int(launch.stdout.readline())
    assert os.path.exists(f'/proc/{driver}')
    launch.kill()
    # the driver holds the other end until it has ended
    assert launch.communicate(timeout=60)[0] == ''


@pytest.mark.parametrize('shell_says, marked, begins', [
    ('/opt/ros/jazzy/bin/ros2', False, False), ('nohup', False, True), ('launch', True, False)])
def test_a_process_that_begins_when_its_starter_has_ended_ends(
        tmp_path, shell_says, marked, begins):
    script = tmp_path / 'driver.py'
    script.write_text('print("begun")\n')
    starter = tmp_path / 'starter.py'
    starter.write_text(f"""
import os, subprocess, sys
if {marked}:
    os.environ[{PARENT!r}] = str(os.getpid())
subprocess.Popen(['sh', '-c', 'echo; read word; exec env "$@"', 'sh',
                  '_=' + {shell_says!r}, sys.executable, '-m', 'telescope_mount.processes.parent',
                  {str(script)!r}]).wait()
""")
    starts = subprocess.Popen([sys.executable, str(starter)], cwd=ROOT, stdin=subprocess.PIPE,
                              stdout=subprocess.PIPE, text=True)
    starts.stdout.readline()
    starts.kill()
    if not marked:  # else its parent has not asked for it yet
        starts.wait()
    assert starts.communicate('go\n', timeout=60)[0] == ('begun\n' if begins else '')


@pytest.mark.parametrize('code, wanted', [(0, 0), (2, 1)])
def test_the_exit_code_of_launch(code, wanted):
    for name in ('launch.actions', 'launch_ros.actions'):
        pytest.importorskip(
            name, reason='ROS launch is not installed: it is in no wheel', exc_type=ImportError)
    from launch.actions import ExecuteProcess, RegisterEventHandler
    from launch.event_handlers import OnProcessExit

    from launch import LaunchDescription, LaunchService
    from telescope_mount.launch_actions import end_all
    service = LaunchService()
    service.include_launch_description(LaunchDescription([
        RegisterEventHandler(OnProcessExit(on_exit=end_all)),
        ExecuteProcess(name='stays', cmd=[
            sys.executable, '-c', 'import time; time.sleep(600)']),  # ended before: none waits
        ExecuteProcess(cmd=[sys.executable, '-c', f'raise SystemExit({code})'], name='ends')]))
    assert service.run() == wanted
