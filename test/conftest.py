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

"""How the suite runs in parallel, and the fixtures of the tests with ROS nodes.

Each process of the suite has a ROS domain of its own, each test a private context in it.
"""

import fcntl
import functools
import gc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from telescope_mount import ONE_THREAD

TESTS = Path(__file__).resolve().parent
# what several tests share, and the benchmarks of which they try a part
sys.path += [str(TESTS / 'shared'), str(TESTS.parent / 'benchmarks'),
             str(TESTS.parent / 'examples' / 'simulated_servers')]
import few_folds  # noqa: E402

os.environ.update(ONE_THREAD | os.environ)  # before numpy comes, and for what is started

# hundreds of processes are started: without bytecode each compiles what all others have compiled,
# and each process of the suite every test
sys.dont_write_bytecode = False
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)

# of the terminal that the suite is started in, or of readline in pytest; a pipe has none
for _size in ('COLUMNS', 'LINES'):
    os.environ.pop(_size, None)

PATIENCE = 60.0  # s until a test gives up waiting; far more than the slowest machine needs
WORKER = os.environ.get('PYTEST_XDIST_WORKER')
MOST_WORKERS = 8  # the slowest file takes an eighth of all


# --- in parallel --------------------------------------------------------------------------------


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """A process for each core and two more (tests of nodes wait, too), a file at a time, if
    pytest-xdist is there and more is asked for than a file. In no option of pyproject.toml: a
    machine with ROS may lack pytest-xdist.
    """
    if WORKER:
        return
    option = config.option
    asked = [path.split('::')[0] for path in config.args]
    if getattr(option, 'numprocesses', 0) is None and option.dist == 'no' and not (
            len(set(asked)) == 1 and asked[0].endswith('.py')):
        option.numprocesses = min((os.cpu_count() or 1) + 2, option.maxprocesses or MOST_WORKERS)
        option.dist = 'loadfile'
        option.loadscopereorder = False  # see below


def pytest_configure(config):
    """Each process begins its collection at another folder, so that it finds most files compiled
    by the others: to rewrite the assertions of all takes 5 s. What it collects is no garbage.
    """
    if WORKER:
        gc.disable()
    places = [Path(arg) for arg in config.args]
    ignored = config.option.ignore or config.option.ignore_glob  # would not hold for arguments
    if WORKER and not ignored and len(places) == 1 and places[0].is_dir():
        parts = sorted(path for path in places[0].iterdir()
                       if path.match('test_*.py') or (path.is_dir() and path.name[0] not in '._'))
        number, count = int(WORKER.removeprefix('gw')), config.workerinput['workercount']
        begin = number * len(parts) // count
        config.args[:] = map(str, parts[begin:] + parts[:begin])


def pytest_collection_finish():
    """What has been collected stays: the garbage collector need not go through it each time."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Files with whole graphs first, then those with nodes, of each kind the long ones first: the
    last to end are short ones.
    """
    files = {}
    for item in items:
        needs = files.setdefault(item.path, set())
        needs.update(item.fixturenames)
    order = {path: ('cli' not in needs, 'ros_domain' not in needs, -path.stat().st_size, path)
             for path, needs in files.items()}
    items.sort(key=lambda item: order[item.path])


@pytest.fixture(scope='session')
def once(tmp_path_factory):
    """``once(name, build)``: a folder that ``build(folder)`` fills, once for all processes."""
    shared = tmp_path_factory.getbasetemp()
    if WORKER:
        shared = shared.parent

    def get(name, build):
        folder, done = shared / name, shared / f'{name}.done'
        with open(shared / f'{name}.lock', 'w') as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                folder.mkdir()  # where another process has failed, this one fails too
                build(folder)
                done.touch()
        return folder
    return get


# --- nodes --------------------------------------------------------------------------------------


@pytest.fixture(scope='session')
def ros_domain(tmp_path_factory):
    """A ROS domain that no other process of this machine has, until the session ends."""
    pytest.importorskip(
        'rclpy', reason='rclpy is not installed (./install.sh ros)', exc_type=ImportError)
    from telescope_mount.dds import dds_environment
    from telescope_mount.processes import domain
    lock = domain.claim()
    folder = tmp_path_factory.mktemp('ros')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.update(dds_environment(lock.number), ROS_LOG_DIR=str(folder))
    yield lock.number
    lock.release()


class Graph:
    """Nodes under test in one private context, and a node that talks to them."""

    def __init__(self, domain):
        import rclpy
        from rclpy.context import Context
        from rclpy.node import Node
        from rclpy.signals import SignalHandlerOptions

        from msg_tools import topics
        from msg_tools.executor import NodeExecutor
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain,
                   signal_handler_options=SignalHandlerOptions.NO)
        self.executor = NodeExecutor(context=self.context)
        self.tester = Node('tester', context=self.context, namespace='/mount',
                           start_parameter_services=False, enable_rosout=False)
        self.executor.add_node(self.tester)
        self.nodes = []
        self.publishers, self.subscriptions = [], []
        self.reports = {}
        self._rows = {}
        for topic in (topics.DIAGNOSTICS, topics.ENDPOINTS):
            self.listen(topic, call=functools.partial(self._on_diagnostics, topic))

    def _on_diagnostics(self, topic, message):
        for status in message.status:
            name = status.name.rsplit('/', 1)[-1]
            rows = self._rows.setdefault(name, {})
            rows[topic] = list(status.values)
            status.values = [row for one in rows.values() for row in one]
            self.reports[name] = status

    def add(self, make, **overrides):
        """A node under test with parameters `overrides`; its constructor's errors pass."""
        node = make(context=self.context, overrides=overrides)
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def remove(self, node):
        """End a node before the test ends."""
        self.nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def publisher(self, topic, **qos):
        """A publisher of the tester."""
        pub = self.tester.create_publisher(topic.message, topic.name, _changed(topic.qos, qos))
        self.publishers.append(pub)
        return pub

    def listen(self, topic, call=None, raw=False, **qos):
        """A list that fills with the messages on `topic`, or a `call` for each."""
        got = []
        self.subscriptions.append(self.tester.create_subscription(
            topic.message, topic.name, call or got.append, _changed(topic.qos, qos), raw=raw))
        return got

    def service(self, name, answer):
        """A Trigger service of the tester; `answer()` returns (success, message)."""
        from std_srvs.srv import Trigger

        def serve(request, response):
            response.success, response.message = answer()
            return response
        return self.tester.create_service(Trigger, name, serve)

    def wait_for(self, condition, what='', timeout=PATIENCE):
        """Spin until `condition()` is true, and return what it gave; `what` says it if not."""
        deadline = time.monotonic() + timeout
        while not (result := condition()):
            assert time.monotonic() < deadline, (
                f'waited {timeout:g} s for {what() if callable(what) else what or condition}')
            self.executor.spin_once(timeout_sec=0.05)
        return result

    def connect(self):
        """Wait until every endpoint of the tester has a partner, and all are matched both ways.

        A writer that sees its reader may still be unknown to that reader.
        """
        def matched():
            publishers = {pub.topic_name: pub for pub in self.publishers}
            subscriptions = {sub.topic_name: sub for sub in self.subscriptions}
            seen = [(name, 'subscribes', sub.get_publisher_count())
                    for name, sub in subscriptions.items()]
            seen += [(name, 'publishes', pub.get_subscription_count())
                     for name, pub in publishers.items()]
            if not all(count for _, _, count in seen):
                return False
            for node in self.nodes:
                rows = [(key.split(' ', 1), value) for key, value in node.endpoints()]
                seen += [(name, kind, int(value)) for (kind, name), value in rows]
            there = {'subscribes': self.tester.count_publishers,
                     'publishes': self.tester.count_subscribers}
            return all(count >= there[kind](name) for name, kind, count in seen if kind in there)
        self.wait_for(matched, 'the endpoints to match')

    def call(self, name):
        """Call a Trigger service of a node under test."""
        from std_srvs.srv import Trigger
        client = self.tester.create_client(Trigger, name)
        self.wait_for(client.service_is_ready, f'service {name}')
        future = client.call_async(Trigger.Request())
        self.wait_for(future.done, f'{name} to answer')
        return future.result()

    def set_parameter(self, node, **values):
        """Set parameters of `node` as ``ros2 param set`` does; (success, reason)."""
        from rcl_interfaces.srv import SetParametersAtomically
        from rclpy.parameter import Parameter
        client = self.tester.create_client(
            SetParametersAtomically, f'{node.get_fully_qualified_name()}/set_parameters_atomically')
        self.wait_for(client.service_is_ready, 'parameter service')
        future = client.call_async(SetParametersAtomically.Request(
            parameters=[Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]))
        self.wait_for(future.done, 'parameters to be set')
        result = future.result().result
        return result.successful, result.reason

    def report(self, name, text='', key='', value=None):
        """Wait for diagnostics of node `name` that say `text`, and give row `key` as `value`."""
        def there():
            status = self.reports.get(name)
            if status is None or text not in status.message:
                return None
            rows = {row.key: row.value for row in status.values}
            return status if not key or rows.get(key) == str(value) else None
        try:
            return self.wait_for(there, f'{name} to report {text!r} {key} {value}')
        except AssertionError as err:
            raise AssertionError(f'{err}; last: {self.reports.get(name)}') from None

    def close(self):
        """End everything, whatever the test left."""
        self.executor.shutdown()
        for node in (*self.nodes, self.tester):
            node.finish() if hasattr(node, 'finish') else None
            node.destroy_node()
        self.context.try_shutdown()


def _changed(qos, changes):
    if not changes:
        return qos
    from rclpy.qos import QoSProfile
    values = {name: getattr(qos, name) for name in ('history', 'depth', 'reliability',
                                                    'durability')}
    return QoSProfile(**(values | changes))


@pytest.fixture
def graph(ros_domain):
    """An empty graph."""
    graph = Graph(ros_domain)
    yield graph
    graph.close()


@pytest.fixture
def process(ros_domain, tmp_path):
    """Start ``process(executable, name=value, ...)``: a node with parameters, as its installed
    script does; ended after the test.
    """
    import yaml
    started = []

    def start(executable, *, preexec_fn=None, **parameters):
        number = len(started)
        params = tmp_path / f'process_{number}.yaml'
        params.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}))
        script = f'import sys; from telescope_mount.start import {executable} as main; '
        command = [sys.executable, '-c', script + 'sys.exit(main())', '--ros-args', '-r',
                   '__ns:=/mount', '--params-file', str(params)]
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                 stderr=subprocess.PIPE, text=True, preexec_fn=preexec_fn)
        started.append(child)
        return child

    yield start
    for child in started:
        if child.poll() is None:
            child.send_signal(signal.SIGKILL)
        child.communicate()


@pytest.fixture(scope='session')
def cli(ros_domain, tmp_path_factory):
    """Run ``telescope-mount`` with arguments in a process; the CompletedProcess."""
    home = tmp_path_factory.mktemp('cli')
    # as a user would start it, with nothing of this session's
    environment = {name: value for name, value in os.environ.items()
                   if not name.startswith(('ROS_', 'FASTDDS_', 'FASTRTPS_'))}

    def start(*args, **options):
        def prepare():
            # a suite in the background of a script ignores Ctrl-C, and its children would too
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            options.get('preexec_fn', lambda: None)()
        return subprocess.Popen(
            [sys.executable, few_folds.__file__, *map(str, args)], cwd=home, env=environment,
            **{'stdin': subprocess.DEVNULL, 'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE,
               'text': True, **options, 'preexec_fn': prepare})

    def run(*args):
        with start(*args) as child:
            try:
                out, err = child.communicate(timeout=300)
            except BaseException:
                child.terminate()
                raise
        return subprocess.CompletedProcess(child.args, child.returncode, out, err)
    run.start = start
    return run


@pytest.fixture(scope='session', autouse=True)
def few_partitions():
    """Cross-validation over few partitions, here; `cli` has its processes do as much."""
    with pytest.MonkeyPatch.context() as patch:
        few_folds.patched(patch.setattr, patch.setitem)
        yield


@pytest.fixture(scope='session', autouse=True)
def one_parser():
    """The parser of all commands once, as in a process of a user."""
    from telescope_mount import command_parser as parsing
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parsing, 'make_parser', functools.cache(parsing.make_parser))
        yield


@pytest.fixture
def short_diagnosis(monkeypatch):
    """Diagnoses of the dictionary alone: no cross-validation, no curves without a cause, no
    periods, no alternatives in models of their own. A quarter of the time, where a test asks what
    becomes of the result; how it is found the tests of calibration/analysis/diagnosis ask.
    """
    from calibration.analysis.diagnosis import (
        alternatives,
        diagnosis,
        discrimination,
        offered_effects,
    )
    from calibration.estimation.periodogram import PeriodBank
    monkeypatch.setitem(diagnosis.diagnose.__kwdefaults__, 'cross_validation', False)
    monkeypatch.setattr(alternatives, 'MOST_TRIED', 0)
    monkeypatch.setattr(offered_effects, 'period_bank', lambda context: PeriodBank([]))
    for module in (discrimination, offered_effects):
        monkeypatch.setattr(module, 'smooths', lambda context: [])


@pytest.fixture
def nothing_expected(monkeypatch):
    """A fit that does not say what is to be expected of it: a third of its time."""
    monkeypatch.setattr('calibration.calibration_state.expected_error', lambda *args: None)


@pytest.fixture
def ended(capsys):
    """``ended(*args)``: run ``telescope-mount`` in this process; (code, stdout, stderr)."""
    from telescope_mount.cli import main

    def run(*args):
        try:
            code = main([str(arg) for arg in args])
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()
    return run


@pytest.fixture
def refused(ended):
    """``refused(*args)``: the one line on stderr of a command that must end with code 2.

    In this process: for what is refused before a graph is started.
    """
    return lambda *args: only_line(*ended(*args))


@pytest.fixture(scope='session')
def refused_by_graph(cli):
    """`refused` in a process, for what the nodes refuse."""
    def run(*args):
        done = cli(*args)
        return only_line(done.returncode, done.stdout, done.stderr)
    return run


def only_line(code, out, err):
    """The line, if it is the only one."""
    assert code == 2, (out, err)
    assert len(err.splitlines()) == 1 and err.startswith('error: '), err
    return err.rstrip('\n')


def _night_in(folder, cli, *more):
    done = cli('night', '--out', folder / 'night', '--stars', 8, '--polaris', 4, '--seed', 3,
               '--verbose', *more)
    assert done.returncode == 0, (done.stdout, done.stderr)
    (folder / 'stdout').write_text(done.stdout)
    (folder / 'stderr').write_text(done.stderr)


@pytest.fixture(scope='session')
def night(cli, once):
    """Folder of a short night: 8 stars, Polaris, power off and on, Polaris, 8 stars."""
    return once('night', lambda folder: _night_in(folder, cli)) / 'night'


@pytest.fixture(scope='session')
def other_night(cli, once):
    """The same night, with the absolute encoder read from images and harmonics in the model."""
    return once('other_night', lambda folder: _night_in(
        folder, cli, '--absolute', 'frames', '--harmonics', 'printed',
        '--harmonics-degree', 1)) / 'night'
