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

"""Forked nodes: what they say, how they end, and what is left."""

import os
import signal
import subprocess
import sys
import time

import pytest

from telescope_mount.graph import NODES, NodeSpec
from telescope_mount.processes.node_processes import ForkServer, Processes


@pytest.fixture(scope='module')
def fork_server(ros_domain, tmp_path_factory):
    server = ForkServer(tmp_path_factory.mktemp('fork') / 'fork_server.log')
    yield server
    server.close()


@pytest.fixture
def processes(ros_domain, tmp_path, fork_server, monkeypatch):
    """All by one fork server, which imports for most of a second."""
    monkeypatch.setattr(fork_server, 'close', lambda: None)
    monkeypatch.setattr('telescope_mount.processes.node_processes.ForkServer',
                        lambda *_: fork_server)
    started = Processes(tmp_path / 'nodes', ros_domain)
    yield started
    started.stop()


@pytest.fixture
def own(ros_domain, tmp_path):
    """With a fork server of its own."""
    started = Processes(tmp_path / 'nodes', ros_domain)
    yield started
    started.stop()


def spec(name, **parameters):
    return NodeSpec(name, NODES[name], parameters)


def ready(processes, name):
    """Wait until a node has made its parameters' services, so that signals find it spinning."""
    import rclpy
    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.signals import SignalHandlerOptions

    from msg_tools.executor import NodeExecutor
    context = Context()
    rclpy.init(context=context, domain_id=int(processes.environment['ROS_DOMAIN_ID']),
               signal_handler_options=SignalHandlerOptions.NO)
    node = Node('looker', context=context)
    executor = NodeExecutor(context=context)
    executor.add_node(node)
    for _ in range(600):
        executor.spin_once(timeout_sec=0.1)
        if name in node.get_node_names():
            break
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def test_a_node_lives_under_its_name_and_ends_cleanly(own):
    own.start(spec('camera'))
    own.start(spec('calibration'))
    pids = {name: node.pid for name, node in own.running.items()}
    for name, pid in pids.items():
        ready(own, name)
        with open(f'/proc/{pid}/comm') as comm:
            assert comm.read().strip() == name
    own.check()
    assert own.stop() == {'camera': 0, 'calibration': 0}
    assert not any(os.path.exists(f'/proc/{pid}') for pid in pids.values())


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_what_a_node_is_told_before_it_listens_is_not_lost(processes, number):
    for name in ('camera', 'pointing_corrector', 'mount_display'):
        processes.start(spec(name))
        processes.running[name].send_signal(number)
    assert [node.wait(60) for node in processes.running.values()] == [0, 0, 0]


def test_what_is_stopped_is_named_and_goes_on_to_end(processes):
    for name in ('camera', 'mount_display'):
        processes.start(spec(name))
        ready(processes, name)
    assert processes.stopped() == {}
    stopped = processes.running['camera'].pid
    os.kill(stopped, signal.SIGSTOP)
    wait_for(processes.stopped)
    assert processes.stopped() == {'camera': stopped}
    assert processes.stop() == {'camera': 0, 'mount_display': 0}


def test_what_a_node_logged_on_its_way_is_no_reason_for_its_end(processes):
    processes.start(spec('camera'))
    ready(processes, 'camera')
    with open(processes.folder / 'camera.log', 'a') as log:
        log.write('[INFO] [1.0] [mount.camera]: all is well\n')
    processes.running['camera'].send_signal(signal.SIGKILL)
    processes.running['camera'].wait(60)
    with pytest.raises(RuntimeError, match='node camera ended with code -9'):
        processes.check()


def test_bad_input_is_told_in_the_nodes_own_words(processes):
    processes.start(spec('camera', exposure_s=-1.0))
    assert processes.running['camera'].wait(60.0) == 2
    with pytest.raises(RuntimeError, match=r'camera: exposure_s = -1.0: must be 0.01 to 3600'):
        processes.check()


def test_a_killed_node_is_told(processes):
    processes.start(spec('camera'))
    os.kill(processes.running['camera'].pid, signal.SIGKILL)
    assert processes.running['camera'].wait(60.0) == -signal.SIGKILL
    with pytest.raises(RuntimeError, match='node camera ended with code -9'):
        processes.check()


def test_waiting_for_a_node_that_stays_ends_in_time(processes):
    processes.start(spec('camera'))
    with pytest.raises(subprocess.TimeoutExpired):
        processes.running['camera'].wait(0.05)


def test_a_fork_server_that_dies_takes_its_nodes_along(own):
    own.start(spec('camera'))
    node = own.running['camera']
    with open(f'/proc/{node.pid}/stat') as stat:
        fork_server = int(stat.read().rsplit(')', 1)[1].split()[1])
    os.kill(fork_server, signal.SIGKILL)
    assert node.wait(60.0) is not None
    assert not os.path.exists(f'/proc/{node.pid}')


def test_nodes_that_cannot_be_started_are_told(own, tmp_path):
    fork_server = own._fork_server
    fork_server._process.kill()
    fork_server._process.wait()
    fork_server._log.write_text('error: no rclpy here\n')
    with pytest.raises(RuntimeError, match='nodes cannot be started: no rclpy here'):
        own.start(spec('camera'))


#: of a command that has not used ROS yet
COMMAND = """
import sys
from telescope_mount.graph import NODES, NodeSpec
from telescope_mount.processes.node_processes import Processes
nodes = Processes(sys.argv[1], int(sys.argv[2]))
nodes.start(NodeSpec('camera', NODES['camera'], {}))
print(nodes.running['camera'].pid, nodes._fork_server._process.pid, flush=True)
if sys.stdin.readline():
    print(nodes.stop()['camera'])
"""


@pytest.mark.parametrize('killed', (True, False))
def test_a_command_forks_its_nodes_from_itself_and_none_outlives_it(
        ros_domain, tmp_path, killed):
    with subprocess.Popen([sys.executable, '-c', COMMAND, tmp_path / 'nodes', str(ros_domain)],
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as command:
        pids = list(map(int, command.stdout.readline().split()))
        for pid, name in zip(pids, ('camera', 'fork_server')):
            # Python names it as the program that it was forked from
            wait_for(lambda pid=pid, name=name: text_of(pid, 'comm').strip() == name)
            assert 'nodes' in text_of(pid, 'cmdline')
        if killed:
            command.kill()
        else:
            assert command.communicate('\n')[0] == '0\n'  # perhaps while it imports
    wait_for(lambda: not any(text_of(pid, 'comm') for pid in pids))


def text_of(pid, name):
    try:
        with open(f'/proc/{pid}/{name}') as file:
            return file.read()
    except OSError:
        return ''


def wait_for(true):
    for _ in range(6000):
        if true():
            return
        time.sleep(0.01)
    raise AssertionError('waited in vain')
