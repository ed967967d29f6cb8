"""The description of the graph, and the order of the house: who may import whom."""

import ast
import functools
import importlib
from pathlib import Path

import pytest

from telescope_mount.graph import (
    MEASURED,
    NIGHT,
    NODES,
    SIMULATED,
    measured_graph,
    night_graph,
    replay_graph,
)

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ('encoder_sim', 'encoder_reading', 'pointing_model', 'calibration', 'msg_tools',
            'telescope_mount')


@functools.cache
def imports(path):
    """Full names of the modules that a source file imports, wherever in it."""
    package = path.relative_to(ROOT).parent.parts
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[:len(package) - node.level + 1] if node.level else ()
            module = '.'.join([*above, *([node.module] if node.module else [])])
            names |= {module} | {f'{module}.{alias.name}' for alias in node.names}
    return names


def sources(*packages):
    return [path for package in packages for path in sorted((ROOT / package).rglob('*.py'))]


def of(names, package):
    return {name for name in names if name == package or name.startswith(package + '.')}


def test_every_node_is_there_and_has_a_main():
    pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
    for module in NODES.values():
        assert callable(importlib.import_module(module).main), module


def test_there_is_no_node_besides_them():
    found = {'.'.join(path.relative_to(ROOT).with_suffix('').parts)
             for path in sources(*PACKAGES) if path.stem.endswith('_node')}
    assert found == set(NODES.values())


def test_setup_makes_an_executable_of_each():
    tree = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    helper = next(item for item in tree.body
                  if isinstance(item, ast.FunctionDef) and item.name == 'nodes')
    space = {'ast': ast, 'Path': lambda name: ROOT / name}
    exec(compile(ast.Module([helper], []), 'setup.py', 'exec'), space)
    assert space['nodes']() == NODES


def test_installed_executables_are_the_nodes():
    from importlib.metadata import PackageNotFoundError, distribution
    try:
        points = distribution('telescope_mount').entry_points
    except PackageNotFoundError:
        pytest.skip('telescope_mount is not installed')
    scripts = {p.name: p.value for p in points if p.group == 'console_scripts'}
    assert scripts.pop('telescope-mount') == 'telescope_mount.cli:main'
    assert scripts.pop('diagnose') == 'telescope_mount.cli:diagnose'
    assert scripts == {name: f'{module}:main' for name, module in NODES.items()}


def test_the_night_has_every_node_but_the_players():
    specs = night_graph(bag='bag')
    assert [spec.name for spec in specs] == list(NIGHT)
    assert set(NIGHT) == set(NODES) - {'mcap_replay', 'run_player', 'frame_reader'}
    assert [spec.full_name for spec in specs] == [f'/mount/{name}' for name in NIGHT]
    for spec in replay_graph('bag', '/mount/observation'):
        assert NODES[spec.name] == spec.module


def test_one_node_publishes_the_angles_of_the_absolute_encoder():
    read, raw = ({spec.name: spec.parameters for spec in night_graph(bag='b', absolute=absolute)}
                 for absolute in ('angles', 'frames'))
    assert 'frame_reader' not in read and 'publishes' not in read['absolute_encoder']
    assert raw['absolute_encoder']['publishes'] == 'frames'
    assert raw['star_observer']['wait_for_nodes'] == [f'/mount/{name}' for name in raw]
    # the reader is told nothing of the scenario
    assert all(name.startswith('qos_overrides.') for name in raw['frame_reader'])


def test_a_measured_run_takes_the_place_of_instruments_and_observer():
    specs = {spec.name: spec for spec in measured_graph(
        bag='the_bag', player={'file': 'run.csv', 'check_every': 5}, seed=3,
        calibration={'alpha': 0.05})}
    assert tuple(specs) == MEASURED
    assert set(MEASURED) - {'run_player'} == set(NIGHT) - set(SIMULATED) - {'star_observer'}
    player = specs['run_player'].parameters
    assert player['file'] == 'run.csv' and player['check_every'] == 5 and player['seed'] == 3
    assert player['wait_for_nodes'] == [spec.full_name for spec in specs.values()]
    assert specs['calibration'].parameters['alpha'] == 0.05
    assert specs['mcap_logger'].parameters['folder'] == 'the_bag'


def test_options_reach_the_nodes_that_need_them():
    specs = {spec.name: spec.parameters for spec in night_graph(
        bag='the_bag', scenario='ideal', seed=7, start_time='2026-02-01', plan='stars 3',
        model_file='m.json', first_run=4, sky={'latitude_deg': 30.0})}
    for name in SIMULATED:
        assert specs[name]['scenario'] == 'ideal' and specs[name]['seed'] == 7
        assert specs[name]['start_time'] == '2026-02-01'
    # the scenario is the truth: nobody else hears of it
    for name in set(NIGHT) - set(SIMULATED):
        assert 'scenario' not in specs[name] and 'seed' not in specs[name]
        assert specs[name]['use_sim_time'] is True
    assert specs['camera']['latitude_deg'] == specs['star_observer']['latitude_deg'] == 30.0
    assert specs['star_observer']['plan'] == 'stars 3'
    assert specs['star_observer']['first_run'] == 4
    assert specs['mcap_logger']['folder'] == 'the_bag'
    for name in ('star_observer', 'pointing_corrector', 'calibration'):
        assert specs[name]['model_file'] == 'm.json'


def test_every_parameter_of_the_graph_is_one_of_its_node():
    pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
    from encoder_sim.device_params import DEVICE_PARAMS, MAX_RATE
    specs = night_graph(bag='b', start_time='2026-02-01', plan='stars 3',
                        sky={'latitude_deg': 30.0})
    for spec in [*specs, *replay_graph('b', '/mount/observation'),
                 *measured_graph(bag='b', player={'file': 'f', 'azimuth_origin': 'N',
                                                  'check_every': 3},
                                 calibration={'alpha': 0.1, 'site': '', 'diagnosis_page': ''})]:
        module = importlib.import_module(spec.module)
        known = {p.name for p in getattr(module, 'PARAMS', (*DEVICE_PARAMS, MAX_RATE))}
        assert set(spec.parameters) - {'use_sim_time'} <= known, spec.name


def test_launch_and_command_line_start_the_same_graph():
    launch = ROOT / 'launch' / 'night.launch.py'
    for path in (launch, ROOT / 'telescope_mount' / 'night.py'):
        assert 'telescope_mount.graph.night_graph' in imports(path), path
    # and the launch file names no node itself
    text = {node.value for node in ast.walk(ast.parse(launch.read_text(encoding='utf-8')))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    assert not text & set(NODES)


def test_nobody_but_its_own_nodes_sees_the_simulator():
    for path in sources('pointing_model', 'calibration', 'msg_tools', 'telescope_mount', 'launch'):
        names = of(imports(path), 'encoder_sim')
        if path == ROOT / 'telescope_mount' / 'encoder_test.py':
            # the test bench of the encoder calibrates nothing
            names = {n for n in names if not of({n}, 'encoder_sim.indexing_table')}
        assert not names, path


def test_the_simulator_does_not_know_the_model():
    for path in sources('encoder_sim'):
        names = imports(path)
        for module in ('terms', 'geometry', 'model', 'harmonics'):
            assert not of(names, f'pointing_model.{module}'), (path, module)
        assert not of(names, 'calibration'), path


def test_imports_run_one_way():
    for path in sources('pointing_model'):
        assert not of(imports(path), 'calibration'), path
    for path in sources('msg_tools', 'encoder_reading'):
        for package in PACKAGES:
            if package not in ('msg_tools', path.relative_to(ROOT).parts[0]):
                assert not of(imports(path), package), (path, package)
    for package in PACKAGES[:-1]:
        for path in sources(package):
            assert not of(imports(path), 'telescope_mount'), path


def test_algorithms_know_no_ros():
    ros = ('rclpy', 'std_msgs', 'sensor_msgs', 'diagnostic_msgs', 'std_srvs', 'trajectory_msgs',
           'geometry_msgs', 'rosgraph_msgs', 'msg_tools.node', 'msg_tools.topics',
           'msg_tools.convert')
    nodes = {ROOT / (module.replace('.', '/') + '.py') for module in NODES.values()}
    glue = {ROOT / 'encoder_sim' / 'device_params.py', ROOT / 'pointing_model' / 'sky_params.py',
            ROOT / 'pointing_model' / 'run_messages.py', ROOT / 'encoder_reading' / 'messages.py'}
    for path in sources('encoder_sim', 'encoder_reading', 'pointing_model', 'calibration'):
        if path not in nodes | glue:
            assert not any(of(imports(path), name) for name in ros), path
