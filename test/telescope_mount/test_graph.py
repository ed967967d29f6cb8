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

"""The description of the graph, and the order of the house: who may import whom."""

import ast
import functools
import importlib
import os
import re
import sys
from subprocess import run
from typing import NamedTuple

import pytest
from places import ROOT

from msg_tools import topics
from telescope_mount.graph import (
    MEASURED,
    NIGHT,
    NODES,
    SIMULATED,
    WITH_BUILT_TYPES,
    measured_graph,
    night_graph,
    real_graph,
    replay_graph,
)
from telescope_mount.nights.server_night import server_graph

#: package -> the packages that it may name: import, or mention as a module or a path in a string
BELOW = {
    'msg_tools': (),
    'encoder_reading': ('msg_tools',),
    'pointing_model': ('msg_tools',),
    'calibration': ('pointing_model', 'msg_tools'),
    'encoder_sim': ('encoder_reading', 'msg_tools'),
    'telescope_mount': ('calibration', 'pointing_model', 'encoder_reading', 'msg_tools'),
    'launch': ('telescope_mount', 'calibration', 'pointing_model', 'encoder_reading',
               'msg_tools'),
}
#: a part of a package -> the parts that it may not name
INSIDE = {
    'pointing_model.sky': ('pointing_model.runs', 'pointing_model.effects'),
    'calibration.estimation': ('calibration.analysis', 'calibration.report', 'pointing_model'),
    'calibration.analysis': ('calibration.report',),
    'telescope_mount.observing': ('telescope_mount.commands', 'telescope_mount.bridges'),
    'telescope_mount.guard': ('telescope_mount.commands', 'telescope_mount.bridges'),
    'telescope_mount.bridges': ('telescope_mount.commands', 'telescope_mount.papers'),
}
PACKAGES = tuple(name for name in BELOW if name != 'launch')
#: what the simulator may use of the pointing model: the sky is the same for both, and how a mount
#: stands under it
SKY = ('pointing_model.sky', 'pointing_model.mounts', 'pointing_model.mount_kinds')
#: the one door from outside to the simulator; besides, `NODES` of graph.py names its nodes
DOOR = ROOT / 'telescope_mount' / 'simulation.py'
#: whose names begin as those of packages
TOPICS = {topic.name for topic in vars(topics).values() if isinstance(topic, topics.Topic)}
#: functions whose text argument is the name of a package, or a part of a path
LOADERS = frozenset(('import_module', '__import__', 'files', 'find_spec', 'run_module', 'as_file',
                     'path', 'get_data', 'Path', 'PurePath', 'joinpath', 'join'))
NAMED = re.compile(rf'(?<![\w.-])({"|".join(PACKAGES)})(?![\w-])((?:[./][\w.-]+)*)')


def module_of(name):
    """As much of a dotted name as is a module of the house."""
    parts = name.split('.')
    while len(parts) > 1 and not ((path := ROOT.joinpath(*parts)).is_dir()
                                  or path.with_suffix('.py').is_file()):
        parts.pop()
    return '.'.join(parts)


def named_in(text):
    """Modules and files of the house that a string names.

    Packages share their names with nodes and topics (`calibration/report`): only what exists
    counts. Of the simulator the bare name is enough.
    """
    if text in TOPICS:
        return
    for match in NAMED.finditer(text):
        package, rest = match.groups()
        dotted = module_of((package + rest.split('/')[0]).rstrip('.'))
        if package == 'encoder_sim' or '.' in dotted:
            yield dotted
        elif rest.startswith('/') and (ROOT / (package + rest).rstrip('.')).exists():
            yield (package + rest).replace('/', '.')


def imported(nodes, package):
    """(line, full name) of all that a source in `package` imports, wherever in it."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[:len(package) - node.level + 1] if node.level else ()
            parts = [*above, *([node.module] if node.module else [])]
            yield from ((node.lineno, '.'.join([*parts, alias.name])) for alias in node.names)


def names_used(nodes, package=()):
    """(line, name) of what a source names of the house: imports, and strings in it.

    Parameters
    ----------
    nodes : list of ast.AST
        All of its tree.
    package : tuple of str
        In which it stands, for relative imports.
    """
    prose = {id(node.body[0].value) for node in nodes if isinstance(node, (
        ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
        and node.body and isinstance(node.body[0], ast.Expr)}
    named = list(imported(nodes, package))
    for node in nodes:
        names = ()
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            names = () if id(node) in prose else named_in(node.value)
        elif isinstance(node, ast.JoinedStr):
            # a module whose name is put together
            names = [part.value[:-1] for part in node.values if isinstance(part, ast.Constant)
                     and part.value.endswith('.')]
        elif isinstance(node, (ast.Call, ast.BinOp)):
            names = [part.value for part in _parts(node) if isinstance(part, ast.Constant)]
        named += [(node.lineno, name) for name in names]
    return {(line, module_of(name))
            for line, name in named if str(name).split('.')[0] in PACKAGES}


def _parts(node):
    """What a path or a package is made of, in a call or by `/`."""
    if isinstance(node, ast.BinOp):
        return (node.left, node.right) if isinstance(node.op, ast.Div) else ()
    name = getattr(node.func, 'attr', getattr(node.func, 'id', None))
    return [*node.args, *(k.value for k in node.keywords)] if name in LOADERS else ()


def nodes_of(text):
    return list(ast.walk(ast.parse(text)))


def uses(path):
    """`names_used` of a file; without the names of the nodes, which `NODES` has for all."""
    return read(path).used


def imports(path):
    """Full names of all that a source file imports, wherever in it."""
    return read(path).imported


class Source(NamedTuple):
    """What the tests ask of a file: its tree, which is large, is not kept."""

    used: set
    imported: set
    called_last: bool  # a program is its last statement, or it is none
    defined: set  # names that it defines, or hands on
    named: list  # module and class that its docstrings name


@functools.cache
def read(path):
    text, package = path.read_text(encoding='utf-8'), path.relative_to(ROOT).parent.parts
    tree = ast.parse(text)
    whole = list(ast.walk(tree))
    found = {name for _, name in imported(whole, package)}
    programs = [node for node in tree.body if isinstance(node, ast.If)
                and '__main__' in ast.dump(node.test)]
    defined = {name for node in tree.body if not isinstance(node, ast.FunctionDef)
               for name in ([node.name] if isinstance(node, ast.ClassDef) else
                            re.findall(r'\b[A-Z]\w+', ast.unparse(node).split('\n')[0]))}
    named = [pair for node in whole
             if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
             for pair in re.findall(r'(?:`|: |^ *)([a-z_]+)\.([A-Z]\w+)(?=`|,|$)',
                                    ast.get_docstring(node) or '', flags=re.M)]
    if path == ROOT / 'telescope_mount' / 'graph.py':
        nodes = next(item for item in tree.body
                     if isinstance(item, ast.Assign) and item.targets[0].id == 'NODES')
        lines = text.splitlines()
        whole = nodes_of('\n'.join([*lines[:nodes.lineno - 1], *lines[nodes.end_lineno:]]))
    return Source(names_used(whole, package), found, programs in ([], tree.body[-1:]), defined,
                  named)


def sources(*packages):
    return [path for package in packages for path in sorted((ROOT / package).rglob('*.py'))]


def of(names, package):
    return {name for name in names if name == package or name.startswith(package + '.')}


def test_every_node_is_there():
    pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
    from msg_tools.node_process import node_of
    for name, module in {**NODES, **WITH_BUILT_TYPES}.items():
        assert node_of(module).__module__ == module, name


def test_a_program_is_called_where_all_of_it_is_defined():
    for path in sources(*PACKAGES):
        assert read(path).called_last, path


def test_there_is_no_node_besides_them():
    found = {'.'.join(path.relative_to(ROOT).with_suffix('').parts)
             for path in sources(*PACKAGES) if path.stem.endswith('_node')}
    assert found == {*NODES.values(), *WITH_BUILT_TYPES.values()}


def test_setup_makes_an_executable_of_each():
    tree = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    helper = next(item for item in tree.body
                  if isinstance(item, ast.FunctionDef) and item.name == 'nodes')
    space = {'ast': ast, 'Path': lambda name: ROOT / name}
    exec(compile(ast.Module([helper], []), 'setup.py', 'exec'), space)
    assert space['nodes']() == [*NODES, *WITH_BUILT_TYPES]


def test_installed_executables_are_the_nodes():
    from importlib.metadata import PackageNotFoundError, distribution
    try:
        points = distribution('telescope_mount').entry_points
    except PackageNotFoundError:
        pytest.skip('telescope_mount is not installed')
    scripts = {p.name: p.value for p in points if p.group == 'console_scripts'}
    assert scripts.pop('telescope-mount') == 'telescope_mount.cli:main'
    assert scripts.pop('diagnose') == 'telescope_mount.cli:diagnose'
    assert scripts == {
        name: f'telescope_mount.start:{name}' for name in (*NODES, *WITH_BUILT_TYPES)}


def test_a_node_has_one_thread_however_it_is_started():
    told = run([sys.executable, '-c', (
        'import os, sys, telescope_mount.start as s; assert "numpy" not in sys.modules; '
        'print(os.environ["OPENBLAS_NUM_THREADS"], callable(s.camera), '
        '"encoder_sim.camera_node" in sys.modules)')],
        capture_output=True, text=True, check=True, env={
            name: value for name, value in os.environ.items() if not name.endswith('_THREADS')})
    assert told.stdout.split() == ['1', 'True', 'True']


@pytest.mark.parametrize('protocol', ['indi', 'alpaca'])
def test_a_night_on_a_server_is_on_the_clock_of_the_machine_and_without_a_simulator(protocol):
    sky, server = {'latitude_deg': 10.0}, {'host': 'dome', 'port': 1}
    given = {'bag': 'bag', 'server': server, 'mount': 'german', 'sky': sky, 'seed': 3,
             'plan': 'home', 'protocol': protocol, 'state_file': 'kept'}
    specs = server_graph(**given)
    assert not set(SIMULATED) & {spec.name for spec in specs}
    values = {spec.name: spec.parameters for spec in specs}
    assert not any('use_sim_time' in given for given in values.values())
    for name in (f'{protocol}_mount', f'{protocol}_sky', 'star_observer'):
        assert values[name]['mount'] == 'german' and values[name]['latitude_deg'] == 10.0
    assert values['star_observer']['absolute_encoder'] is False
    assert values['star_observer']['state_file'] == 'kept'
    assert values['star_observer']['wait_for_nodes'] == [spec.full_name for spec in specs]
    assert values[f'{protocol}_sky']['host'] == 'dome' and values[f'{protocol}_sky']['seed'] == 3
    # where something else sees the sky
    seen = {spec.name: spec.parameters for spec in server_graph(**given, camera={
        'host': 'c', 'port': 2, 'camera': 'CCD'})}
    assert seen['indi_sky']['camera'] == 'CCD' and seen['indi_sky']['host'] == 'c'
    assert not any(name.endswith('_sky') for name in (
        spec.name for spec in server_graph(**given, seen=True)))


def test_the_night_has_every_node_but_the_players():
    specs = night_graph(bag='bag')
    assert [spec.name for spec in specs] == list(NIGHT)
    assert set(NIGHT) == set(NODES) - {'mcap_replay', 'run_player', 'frame_reader', 'indi_mount',
                                       'indi_sky', 'alpaca_mount', 'alpaca_sky',
                                       'mount_display'}
    assert [spec.full_name for spec in specs] == [f'/mount/{name}' for name in NIGHT]
    for spec in replay_graph('bag', '/mount/', ['/mount/observation']):
        assert NODES[spec.name] == spec.module


#: nodes that a replay feeds
COMPUTING = {'calibration', 'pointing_corrector', 'mount_display'}


def test_every_topic_of_the_graph_is_measured_or_made_anew_by_a_replay():
    """Who publishes what is taken from docs/topics.md, which is made from what nodes declare."""
    rows = [[cell.strip() for cell in line.split('|')[1:-1]]
            for line in (ROOT / 'docs' / 'topics.md').read_text().splitlines()
            if line.startswith('| `')]
    by = {row[0].strip('`'): set(re.findall(r'nodes/(\w+)\.md', row[4])) - {'mcap_replay'}
          for row in rows}
    declared = {topic.name: topic for topic in vars(topics).values()
                if isinstance(topic, topics.Topic)}
    assert set(by) == set(declared)
    # what others say of themselves is of no use, and of the clock there is one
    own = {'/clock', '/diagnostics', '/endpoints', 'observer/status', 'observer/checks',
           'observer/plan/status', 'observer/plan/feedback', 'guard/status'}
    computed = {name for name, nodes in by.items() if nodes and nodes <= COMPUTING} | own
    assert {topic.name for topic in topics.COMPUTED} == computed


def test_one_node_publishes_the_angles_of_the_absolute_encoder():
    read, raw = ({spec.name: spec.parameters for spec in night_graph(bag='b', absolute=absolute)}
                 for absolute in ('angles', 'frames'))
    assert 'frame_reader' not in read and 'publishes' not in read['absolute_encoder']
    assert raw['absolute_encoder']['publishes'] == 'frames'
    assert raw['star_observer']['wait_for_nodes'] == [f'/mount/{name}' for name in raw]
    # the reader is told nothing of the scenario, but what the observer is too
    assert raw['frame_reader'].pop('mount') == 'altaz'
    assert all(name.startswith('qos_overrides.') for name in raw['frame_reader'])


def test_a_measured_run_takes_the_place_of_instruments_and_observer():
    specs = {spec.name: spec for spec in measured_graph(
        bag='the_bag', player={'file': 'run.csv', 'check_every': 5}, seed=3,
        calibration={'alpha': 0.05})}
    assert tuple(specs) == MEASURED
    assert set(MEASURED) - {'run_player'} == set(NIGHT) - set(SIMULATED) - {
        'star_observer', 'mount_guard'}
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
    for spec in [*specs, *replay_graph('b', '/mount/', ['/mount/observation']),
                 *real_graph(bag='b', plan='stars 3', sky={'latitude_deg': 30.0}),
                 *measured_graph(bag='b', player={'file': 'f', 'azimuth_origin': 'N',
                                                  'check_every': 3},
                                 calibration={'alpha': 0.1, 'site': '', 'diagnosis_page': ''})]:
        module = importlib.import_module(spec.module)
        known = {p.name for p in getattr(module, 'PARAMS', (*DEVICE_PARAMS, MAX_RATE))}
        assert set(spec.parameters) - {'use_sim_time'} <= known, spec.name


def test_a_real_mount_has_the_time_of_the_wall_and_no_simulated_node():
    for spec in real_graph(bag='b'):
        assert spec.name not in SIMULATED and 'use_sim_time' not in spec.parameters


def test_launch_and_command_line_start_the_same_graph():
    launch = ROOT / 'launch' / 'night.launch.py'
    for path in (launch, ROOT / 'telescope_mount' / 'nights' / 'whole_night.py'):
        assert 'telescope_mount.graph.night_graph' in imports(path), path
    # and the launch file names no node itself
    text = {node.value for node in ast.walk(ast.parse(launch.read_text(encoding='utf-8')))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    assert not text & set(NODES)


def is_sky(name):
    return any(of([name], part) for part in SKY)


def forbidden(package, names):
    """Those of `names_used` that a package may not name."""
    allowed = {package, *BELOW[package]}
    return {(line, name) for line, name in names if name.split('.')[0] not in allowed
            and not (package == 'encoder_sim' and is_sky(name))}


def test_names_run_one_way():
    for package in BELOW:
        for path in sources(package):
            if path != DOOR:
                assert not forbidden(package, uses(path)), path


def test_the_simulator_is_seen_through_one_door_and_by_the_list_of_nodes():
    assert {name.split('.')[0] for _, name in forbidden('telescope_mount', uses(DOOR))} == {
        'encoder_sim'}
    graph = (ROOT / 'telescope_mount' / 'graph.py').read_text(encoding='utf-8')
    named = {name for _, name in forbidden('telescope_mount', names_used(nodes_of(graph)))}
    assert named == {module for module in NODES.values() if module.startswith('encoder_sim.')}


def test_the_sky_does_not_know_the_model():
    for path in sources('pointing_model'):
        if is_sky('.'.join(path.relative_to(ROOT).with_suffix('').parts)):
            assert all(is_sky(n) for _, n in uses(path) if n.startswith('pointing_model')), path


def test_nothing_imports_the_demonstrations():
    for path in sources(*PACKAGES):
        if path.parent.name != 'papers':
            assert not of(imports(path), 'telescope_mount.papers'), path


def test_the_arrows_inside_a_package_run_one_way():
    for package, others in INSIDE.items():
        for path in sources(package.replace('.', '/')):
            found = {n for _, n in uses(path) if of([n], package.split('.')[0])}
            assert not {n for other in others for n in of(found, other)}, path


def test_a_class_that_a_docstring_names_is_in_the_module_that_it_names():
    files = {path: read(path) for path in sources(*BELOW)}
    known = {(path.parent.name if path.stem == '__init__' else path.stem, name)
             for path, file in files.items() for name in file.defined}
    named = [(path, *pair) for path, file in files.items() for pair in file.named]
    wrong = [f'{path.relative_to(ROOT)}: {module}.{name}' for path, module, name in named
             if (module, name) not in known and not hasattr(sys.modules.get(module), name)]
    assert len(named) > 50
    assert not wrong, '\n'.join(wrong)


def test_every_package_has_its_place():
    tree = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    parts = next(item.value for item in tree.body
                 if isinstance(item, ast.Assign) and item.targets[0].id == 'PARTS')
    assert set(ast.literal_eval(parts)) == set(PACKAGES)
    # each of them stands on others that do not stand on it
    for package, below in BELOW.items():
        assert all(package not in BELOW[other] for other in below)
        assert set(below) >= {far for near in below for far in BELOW[near]}


@pytest.mark.parametrize('source, wanted', [
    ('import encoder_sim', 'encoder_sim'),
    ('import encoder_sim.mount as m', 'encoder_sim.mount'),
    ('def f():\n    from encoder_sim.mount import SimulatedMount', 'encoder_sim.mount'),
    ('from encoder_sim import mount', 'encoder_sim.mount'),
    ('from ..encoder_sim import mount', 'encoder_sim.mount'),
    ('from .. import encoder_sim', 'encoder_sim'),
    ("import_module('encoder_sim.mount')", 'encoder_sim.mount'),
    ("importlib.import_module(name='encoder_sim')", 'encoder_sim'),
    ("__import__('encoder_sim')", 'encoder_sim'),
    ("resources.files('encoder_sim') / 'scenarios'", 'encoder_sim'),
    ("resources.files('encoder_sim.scenarios')", 'encoder_sim.scenarios'),
    ("Path('/somewhere/encoder_sim/scenarios')", 'encoder_sim'),
    ("open(root + '/encoder_sim/scenarios/ideal.yaml')", 'encoder_sim'),
    ("Path(__file__).parents[1] / 'encoder_sim'", 'encoder_sim'),
    ("f'{root}/encoder_sim/scenarios/{name}.yaml'", 'encoder_sim'),
    ("f'encoder_sim.{name}'", 'encoder_sim'),
    ("'-m encoder_sim.mount_simulator_node'.split()", 'encoder_sim.mount_simulator_node'),
    ("PLACE = 'encoder_sim'", 'encoder_sim'),
    ('from calibration.analysis import term_fit', 'calibration.analysis.term_fit'),
    ("import_module('calibration')", 'calibration'),
    ("find_spec('calibration.calibration_node')", 'calibration.calibration_node'),
    ("f'calibration.{name}'", 'calibration'),
    ("resources.files('calibration') / 'data'", 'calibration'),
    ("root / 'calibration' / 'data'", 'calibration'),
    ("root.joinpath('calibration', 'data')", 'calibration'),
    ("os.path.join(root, 'calibration')", 'calibration'),
    ("open('calibration/data/README.md')", 'calibration.data'),
    ("MODULE = 'calibration.calibration_node'", 'calibration.calibration_node'),
    ("MODULE = 'calibration.calibration_node:main'", 'calibration.calibration_node'),
    ("run_module('telescope_mount.cli')", 'telescope_mount.cli'),
])
def test_the_checker_finds(source, wanted):
    found = names_used(nodes_of(source), ('pointing_model',))
    assert wanted in {name for _, name in found}
    assert all(line == source.count('\n') + 1 for line, _ in found)
    assert forbidden('pointing_model', found)


@pytest.mark.parametrize('source', [
    '"""As `encoder_sim.mount` has it."""',
    'def f():\n    """See `calibration.analysis.term_fit`."""',
    '# encoder_sim\nx = 1',
    "Topic('calibration/report')",
    "super().__init__('calibration')",
    "FORMAT = 'telescope_mount/pointing_model'",
    "version('telescope_mount')",
    "'the calibration. It fits'",
    "f'/mount/calibration/{name}'",
    "'my_encoder_sim', 'encoder_simulated', 'x.encoder_sim'",
    'from .calibration import x',
    'from ..msg_tools import topics',
    'import calibrations',
])
def test_the_checker_lets_pass(source):
    assert not forbidden('pointing_model', names_used(nodes_of(source), ('pointing_model',)))


def test_the_simulator_may_use_the_sky_and_nothing_else_of_the_model():
    found = names_used(nodes_of(
        'from pointing_model import sky, pointing_terms\n'
        'from pointing_model.sky.star_catalogue import Star\nfrom pointing_model import x'))
    assert {name for _, name in forbidden('encoder_sim', found)} == {
        'pointing_model.pointing_terms', 'pointing_model'}


def test_algorithms_know_no_ros():
    ros = ('rclpy', 'std_msgs', 'sensor_msgs', 'diagnostic_msgs', 'std_srvs', 'trajectory_msgs',
           'geometry_msgs', 'rosgraph_msgs', 'msg_tools.node', 'msg_tools.topics',
           'msg_tools.convert')
    nodes = {ROOT / (module.replace('.', '/') + '.py') for module in NODES.values()}
    # what turns messages and parameters into arrays, and back
    glue = {ROOT / f'{name}.py' for name in (
        'encoder_sim/device_params', 'encoder_reading/angle_output',
        'encoder_reading/frame_messages', 'pointing_model/sky/sky_params',
        'pointing_model/runs/run_messages', 'pointing_model/calibration_messages',
        'pointing_model/active_topics', 'calibration/calibration_params')}
    for path in sources('encoder_sim', 'encoder_reading', 'pointing_model', 'calibration'):
        if path not in nodes | glue:
            assert not any(of(imports(path), name) for name in ros), path
