"""The launch file: the graph it describes, and how it ends; with a stand-in where launch is not."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from msg_tools import NAMESPACE
from pointing_model.observing.plan import night_plan, real_plan
from telescope_mount.graph import NIGHT, night_graph, real_graph

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / 'launch' / 'night.launch.py'
REAL_FILE = ROOT / 'launch' / 'real_mount.launch.py'


class Described:
    """Any action: what it was made with."""

    def __init__(self, *args, **values):
        self.args, self.values = args, values

    def perform(self, context):
        return context.arguments[self.args[0]]


def stand_in(monkeypatch):
    """Modules with the names that the launch file imports, each class of its own."""
    names = {'launch': ('LaunchDescription',),
             'launch.actions': ('DeclareLaunchArgument', 'EmitEvent', 'ExecuteProcess',
                                'OpaqueFunction', 'RegisterEventHandler', 'SetEnvironmentVariable'),
             'launch.event_handlers': ('OnProcessExit',), 'launch.events': ('Shutdown',),
             'launch.substitutions': ('LaunchConfiguration',), 'launch_ros': (),
             'launch_ros.actions': ('Node',)}
    for module, classes in names.items():
        made = ModuleType(module)
        for name in classes:
            setattr(made, name, type(name, (Described,), {}))
        monkeypatch.setitem(sys.modules, module, made)


def load(path=FILE):
    spec = importlib.util.spec_from_file_location(path.name.split('.')[0], path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def launch_file(monkeypatch):
    stand_in(monkeypatch)
    return load()


@pytest.fixture
def actions(launch_file):
    """``actions(name=value)``: what the launch file makes of its arguments, by class name."""
    def make(**arguments):
        values = {name: default for name, default, _ in launch_file.ARGUMENTS} | arguments
        out = {}
        for action in launch_file._nodes(SimpleNamespace(arguments=values)):
            out.setdefault(type(action).__name__, []).append(action)
        return out
    return make


def test_every_node_is_started_with_its_parameters_and_watched(actions, tmp_path):
    (tmp_path / 'site.yaml').write_text('')
    made = actions(scenario='ideal', seed='7', bag='b', params_file=str(tmp_path / 'site.yaml'))
    nodes = [node.values for node in made['Node']]
    assert [node['executable'] for node in nodes] == [node['name'] for node in nodes] == list(NIGHT)
    wanted = {spec.name: spec.parameters for spec in night_graph(
        bag='b', scenario='ideal', seed=7, plan=night_plan(30, 16))}
    for node in nodes:
        assert node['package'] == 'telescope_mount' and node['namespace'] == NAMESPACE
        given, more = node['parameters']
        assert given == wanted[node['name']]
        assert more == str(tmp_path / 'site.yaml')
    watched = [handler.args[0].values['target_action'] for handler in made['RegisterEventHandler']]
    assert watched == made['Node']


@pytest.mark.parametrize('arguments, words', [
    ({'seed': 'many'}, 'seed:=many is no whole number'),
    ({'time_scale': 'fast'}, 'time_scale:=fast is no number'),
    ({'params_file': 'absent.yaml'}, 'params_file:=absent.yaml is no file'),
])
def test_bad_arguments_are_refused(actions, arguments, words):
    with pytest.raises(ValueError, match=words):
        actions(**arguments)


def real(monkeypatch, **arguments):
    """What the launch file of a real mount makes of its arguments, by class name."""
    stand_in(monkeypatch)
    module, out = load(REAL_FILE), {}
    values = {name: default for name, default, _ in module.ARGUMENTS} | arguments
    for action in module._actions(SimpleNamespace(arguments=values)):
        out.setdefault(type(action).__name__, []).append(action)
    return out


def test_a_real_mount_is_launched_with_sample_drivers_or_ones_own(monkeypatch):
    made = real(monkeypatch, bag='b', mount='german', absolute_encoder='true')
    wanted = real_graph(bag='b', plan=real_plan(30), mount='german', absolute_encoder=True)
    assert [(node.values['name'], node.values['parameters']) for node in made['Node']] == [
        (spec.name, [spec.parameters]) for spec in wanted]
    drivers = [process.values['cmd'] for process in made['ExecuteProcess']]
    assert sorted(Path(words[1]).name for words in drivers) == sorted(
        path.name for path in (ROOT / 'examples').glob('*.py'))
    assert all(words[2:] == ['--ros-args', '-r', f'__ns:={NAMESPACE}'] for words in drivers)
    assert len(made['RegisterEventHandler']) == len(wanted) + len(drivers)
    assert 'ExecuteProcess' not in real(monkeypatch, drivers='none')


@pytest.mark.parametrize('arguments, words', [
    ({'drivers': 'absent.py'}, 'drivers:= names absent.py, which is no file'),
    ({'absolute_encoder': 'yes'}, 'absolute_encoder:=yes: write true or false'),
    ({'plan': 'stars'}, 'write stars and a count'),
])
def test_bad_arguments_of_a_real_mount_are_refused(monkeypatch, arguments, words):
    with pytest.raises(ValueError, match=words):
        real(monkeypatch, **arguments)


def test_a_node_that_ends_ends_all(launch_file):
    running, ending = SimpleNamespace(is_shutdown=False), SimpleNamespace(is_shutdown=True)
    well = SimpleNamespace(process_name='camera-4', returncode=0)
    refused = SimpleNamespace(process_name='camera-4', returncode=2)
    assert launch_file._end_all(well, running).values['event'].values == {
        'reason': 'camera-4 ended'}
    # what launch makes exit code 1 of
    with pytest.raises(RuntimeError, match='^camera-4 ended with code 2$'):
        launch_file._end_all(refused, running)
    assert launch_file._end_all(well, ending) is launch_file._end_all(refused, ending) is None


@pytest.mark.parametrize('code, wanted', [(0, 0), (2, 1)])
def test_the_exit_code_of_launch(code, wanted):
    for name in ('launch.actions', 'launch_ros.actions'):
        pytest.importorskip(
            name, reason='ROS launch is not installed: it is in no wheel', exc_type=ImportError)
    from launch.actions import ExecuteProcess, RegisterEventHandler
    from launch.event_handlers import OnProcessExit

    from launch import LaunchDescription, LaunchService
    service = LaunchService()
    service.include_launch_description(LaunchDescription([
        RegisterEventHandler(OnProcessExit(on_exit=load()._end_all)),
        ExecuteProcess(name='stays', cmd=[
            sys.executable, '-c', 'import time; time.sleep(600)']),  # ended before: none waits
        ExecuteProcess(cmd=[sys.executable, '-c', f'raise SystemExit({code})'], name='ends')]))
    assert service.run() == wanted
