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

import subprocess
import sys

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import ParameterType
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from msg_tools import convert, topics
from msg_tools.node import BadInput, Counter, MountNode, Param


def _even(value):
    if value % 2:
        raise ValueError('it is odd')


class Sample(MountNode):
    """Takes encoder readings, gives the zero."""

    def __init__(self, **kwargs):
        super().__init__('sample', (
            Param('speed', 2.0, 'how fast [m/s]', 0.5, 4.0),
            Param('count', 4, 'how many', 0, 10, check=_even),
            Param('colour', 'red', 'which', choices=('red', 'blue')),
            Param('start', 'now', 'when', fixed=True)), **kwargs)
        self.changes, self.taken = [], []
        self.pub = self.publisher(topics.ZERO)
        self.subscribe(topics.INCREMENTAL, self._on_incremental)

    def parameters_changed(self, names):
        self.changes.append((names, self.value('speed'), self.value('count')))

    def _on_incremental(self, message):
        self.taken.append(convert.read_joints(message))

    def required(self):
        return {self.resolve_topic_name(topics.INCREMENTAL.name)}


# --- parameters ---------------------------------------------------------------------------------


@pytest.mark.parametrize('overrides, text', [
    ({'spede': 1.0}, 'sample: unknown parameter spede; did you mean speed?'),
    ({'zzz': 1.0}, 'sample: unknown parameter zzz; it has speed, count, colour, start'),
    ({'speed': 9.0}, 'sample: speed = 9.0: must be 0.5 to 4.0'),
    ({'speed': float('nan')}, 'must be 0.5 to 4.0'),
    ({'speed': 3}, 'sample: speed = 3: must be a float, write 3.0'),
    ({'speed': 'fast'}, "sample: speed = 'fast': must be a float"),
    ({'count': 11}, 'sample: count = 11: must be 0 to 10'),
    ({'count': 3}, 'sample: count = 3: it is odd'),
    ({'colour': 'green'}, "sample: colour = 'green': use one of red, blue"),
])
def test_bad_start_values_are_refused_with_a_reason(graph, overrides, text):
    with pytest.raises(BadInput) as caught:
        graph.add(Sample, **overrides)
    assert text in str(caught.value)
    assert '\n' not in str(caught.value)


def test_good_start_values_are_taken(graph):
    # the site is told to all nodes in one file, and who has no use for it lets it be
    node = graph.add(Sample, speed=4.0, count=8, colour='blue', start='later', latitude_deg=31.0)
    assert [node.value(n) for n in ('speed', 'count', 'colour', 'start')] == [
        4.0, 8, 'blue', 'later']
    assert node.changes == []


@pytest.mark.parametrize('values, text', [
    ({'speed': 9.0}, 'speed'),
    ({'speed': float('nan')}, 'speed'),
    ({'count': 3}, 'count = 3: it is odd'),
    ({'colour': 'green'}, 'use one of red, blue'),
    ({'start': 'later'}, 'read-only'),
    ({'speed': 'fast'}, 'type'),
    ({'spede': 3.0}, 'unknown parameter spede; did you mean speed?'),
])
def test_bad_values_at_runtime_are_refused_and_change_nothing(graph, values, text):
    node = graph.add(Sample)
    done, reason = graph.set_parameter(node, **values)
    assert not done
    assert text in reason
    assert node.value('speed') == 2.0 and node.value('count') == 4
    assert node.changes == []


def test_validation_has_no_side_effect(graph):
    node = graph.add(Sample)
    # the first is good, the second is not: neither may be applied
    done, reason = graph.set_parameter(node, speed=3.0, count=3)
    assert not done and 'odd' in reason
    assert node.value('speed') == 2.0
    assert node.changes == []


def test_values_are_applied_after_they_were_accepted(graph):
    node = graph.add(Sample)
    assert graph.set_parameter(node, speed=3.0, count=6) == (True, '')
    assert node.changes == [({'speed', 'count'}, 3.0, 6)]


def test_descriptors_tell_range_and_unit(graph):
    node = graph.add(Sample)
    speed = node.describe_parameter('speed')
    assert speed.description == 'how fast [m/s]'
    limits = speed.floating_point_range[0]
    assert (limits.from_value, limits.to_value) == (0.5, 4.0)
    limits = node.describe_parameter('count').integer_range[0]
    assert (limits.from_value, limits.to_value) == (0, 10)
    assert 'red, blue' in node.describe_parameter('colour').additional_constraints
    assert node.describe_parameter('start').read_only
    clock = node.describe_parameter('use_sim_time')
    assert '/clock' in clock.description and clock.type == ParameterType.PARAMETER_BOOL
    assert not speed.read_only


def test_every_parameter_of_the_graph_describes_itself():
    import importlib

    from telescope_mount.graph import NODES
    for module in NODES.values():
        for param in getattr(importlib.import_module(module), 'PARAMS', ()):
            assert param.doc, param
            if type(param.default) in (int, float):
                assert param.low is not None and param.high is not None, param
                assert param.low <= param.default <= param.high, param
            assert param.refuse(param.default) is None, param


# --- messages -----------------------------------------------------------------------------------


def test_bad_messages_are_counted_and_the_node_lives_on(graph):
    node = graph.add(Sample)
    pub = graph.publisher(topics.INCREMENTAL)
    graph.connect()
    wrong = convert.joint_state(1, [1.0, 2.0])
    wrong.name = ['az', 'el']
    for _ in range(7):
        pub.publish(wrong)
    pub.publish(convert.joint_state(2, [1.0, 2.0]))
    graph.wait_for(lambda: node.taken, 'the good message')
    assert [row[0] for row in node.taken] == [2]
    status = graph.report('sample', '7 messages refused')
    assert status.level == DiagnosticStatus.WARN
    row = next(r.value for r in status.values if r.key == 'refused incremental/joint_states')
    assert row.startswith('7 (last: joint names') and 'need azimuth and elevation' in row


def test_a_callback_that_fails_otherwise_is_not_hidden(graph):
    class Broken(Sample):

        def _on_incremental(self, message):
            raise TypeError('a bug')
    graph.add(Broken)
    pub = graph.publisher(topics.INCREMENTAL)
    graph.connect()
    pub.publish(convert.joint_state(1, [1.0, 2.0]))
    with pytest.raises(TypeError, match='a bug'):
        graph.wait_for(lambda: False, 'the bug')


@pytest.mark.parametrize('cut', [4, 13, 40, -9])
def test_bytes_that_are_no_message_are_counted_and_the_node_lives_on(graph, cut):
    node = graph.add(Sample)
    pub = graph.publisher(topics.INCREMENTAL)
    graph.connect()
    good = serialize_message(convert.joint_state(2, [1.0, 2.0], frame='mount'))
    for data in (good[:cut], good):
        pub.publish(bytes(data))
    graph.wait_for(lambda: node.taken, 'the good message')
    assert [row[0] for row in node.taken] == [2]
    status = graph.report('sample', '1 messages refused')
    row = next(r.value for r in status.values if r.key == 'refused incremental/joint_states')
    assert row.startswith('1 (last: no JointState: ')


def test_gaps_are_counted_by_sequence_number(graph):
    depth = 'qos_overrides./mount/incremental/joint_states.subscription.depth'
    node = graph.add(Sample, **{depth: 1})
    pub = graph.publisher(topics.INCREMENTAL)
    graph.connect()
    pub.publish(convert.joint_state(1, [1.0, 2.0]))
    graph.wait_for(lambda: len(node.taken) == 1)
    # a queue of one keeps the last of six
    for i in range(2, 8):
        pub.publish(convert.joint_state(i, [1.0, 2.0]))
    graph.wait_for(lambda: len(node.taken) == 2)
    assert node.taken[-1][0] == 7
    status = graph.report('sample', '5 messages lost', 'gaps /mount/incremental/joint_states', 5)
    assert status.level == DiagnosticStatus.WARN


def test_counter_knows_restarts_and_latched_topics():
    counter = Counter()
    for number in (1, 2, 5, 6, 1, 2, None, 4):
        counter.received({'publication_sequence_number': number})
    assert (counter.count, counter.gaps, counter.last) == (8, 3, 4)
    counter = Counter(latched=True)
    for number in (3, 9):
        counter.received({'publication_sequence_number': number})
    assert (counter.count, counter.gaps, counter.last) == (2, 0, 9)


# --- diagnostics --------------------------------------------------------------------------------


def test_diagnostics_say_what_the_node_waits_for(graph):
    graph.add(Sample)
    topic = '/mount/incremental/joint_states'
    status = graph.report('sample', f'waiting for a publisher of {topic}')
    assert status.level == DiagnosticStatus.WARN
    assert status.name == '/mount/sample'
    assert status.hardware_id == '/mount/sample: sample'
    graph.publisher(topics.INCREMENTAL)
    status = graph.report('sample', 'ok', f'subscribes {topic}', 1)
    assert status.message == 'ok' and status.level == DiagnosticStatus.OK


def test_diagnostics_count_messages_and_rates(graph):
    node = graph.add(Sample)
    pub = graph.publisher(topics.INCREMENTAL)
    graph.listen(topics.ZERO)
    graph.connect()
    for i in range(3):
        pub.publish(convert.joint_state(i + 1, [1.0, 2.0]))
    node.pub.publish(convert.joint_state(1, [0.0, 0.0]))
    graph.report('sample', '', 'received /mount/incremental/joint_states', 3)
    graph.report('sample', '', 'last /mount/incremental/joint_states', 3)
    graph.report('sample', '', 'publishes /mount/zero', 1)
    status = graph.report('sample', '', 'published /mount/zero', 1)
    graph.report('sample', '', 'rests', True)
    counted = {row.key: row.value for row in graph.reports['sample'].values}
    assert counted['received /mount/incremental/joint_states'] == '3'
    keys = [row.key for row in status.values]
    assert 'rate /mount/zero [Hz]' in keys


def test_a_node_reads_what_another_reports(graph):
    reports = graph.add(lambda **kwargs: MountNode('reader', **kwargs)).graph_reports()
    node = graph.add(Sample)
    pub = graph.publisher(topics.INCREMENTAL)
    graph.listen(topics.ZERO)
    graph.connect()
    pub.publish(convert.joint_state(1, [1.0, 2.0]))
    node.pub.publish(convert.joint_state(1, [0.0, 0.0]))
    zero, incremental = '/mount/zero', '/mount/incremental/joint_states'

    def told():
        report = reports.get('/mount/sample')
        return report and (
            report['publishes'].get(zero), report['published'].get(zero),
            report['subscribes'].get(incremental), report['last'].get(incremental))
    graph.wait_for(lambda: told() == (1, 1, 1, 1), told)


def test_diagnostics_go_on_before_the_first_clock(graph):
    node = graph.add(Sample, use_sim_time=True)
    graph.report('sample', 'waiting')
    assert node.get_clock().now().nanoseconds == 0
    graph.reports.clear()
    graph.report('sample', 'waiting')


def test_endpoints_that_cannot_match_are_an_error(graph):
    graph.add(Sample)
    graph.publisher(topics.INCREMENTAL, reliability=ReliabilityPolicy.BEST_EFFORT)
    graph.listen(topics.ZERO, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    status = graph.report('sample', 'incompatible endpoint, nothing passes: '
                          '/mount/incremental/joint_states: a publisher with another type or QoS')
    assert status.level == DiagnosticStatus.ERROR
    assert '/mount/zero' not in status.message


def test_an_override_makes_them_match(graph):
    reliability = 'qos_overrides./mount/incremental/joint_states.subscription.reliability'
    node = graph.add(Sample, **{reliability: 'best_effort'})
    pub = graph.publisher(topics.INCREMENTAL, reliability=ReliabilityPolicy.BEST_EFFORT)
    graph.connect()
    pub.publish(convert.joint_state(1, [1.0, 2.0]))
    graph.wait_for(lambda: node.taken)


def test_an_override_is_for_its_topic_alone(graph):
    before = topics.INCREMENTAL.qos.depth, topics.ABSOLUTE.qos.depth
    node = graph.add(Sample, **{
        'qos_overrides./mount/incremental/joint_states.subscription.depth': 1,
        'qos_overrides./mount/zero.publisher.depth': 7})
    assert node.value('qos_overrides./mount/zero.publisher.depth') == 7
    assert (topics.INCREMENTAL.qos.depth, topics.ABSOLUTE.qos.depth) == before
    assert topics.MODEL.qos.depth == topics.ZERO.qos.depth == 1


def test_relative_names_live_in_the_namespace_of_the_mount(graph):
    node = graph.add(Sample)
    assert node.get_fully_qualified_name() == '/mount/sample'
    assert node.pub.topic_name == '/mount/zero'


# --- as a process -------------------------------------------------------------------------------


@pytest.mark.parametrize('arguments, text', [
    (['-p', 'model_fil:=x.json'], 'unknown parameter model_fil; did you mean model_file?'),
    (['-p', 'model_file:=absent.json'], 'absent.json'),
    (['-p', 'model_file:=3'], 'must be a str'),
    (['--params-file', 'absent.yaml'], 'absent.yaml'),
    (['--params-file', 'of_root.yaml'], 'of_root.yaml: section pointing_corrector does not match '
     '/mount/pointing_corrector: write /**/pointing_corrector'),
    (['--params-file', 'misspelt.yaml'], 'section /**/pointing_corector does not match'),
])
def test_bad_input_of_a_process_is_one_line_and_code_2(ros_domain, tmp_path, arguments, text):
    section = 'pointing_corrector: {ros__parameters: {model_file: absent.json}}\n'
    (tmp_path / 'of_root.yaml').write_text(section)
    (tmp_path / 'misspelt.yaml').write_text('/**/' + section.replace('rr', 'r'))
    done = subprocess.run(
        [sys.executable, '-m', 'msg_tools.node_process', 'pointing_model.pointing_corrector_node',
         '--ros-args', *arguments],
        cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2, done.stderr
    lines = done.stderr.splitlines()
    # before a line of ours rcl may have logged one of its own
    assert [line for line in lines if '[rcl]' not in line] == lines[-1:], done.stderr
    assert lines[-1].startswith('error: ') and text in lines[-1]


def test_a_clock_below_zero_is_refused_and_the_node_lives_on(graph):
    clock = graph.publisher(topics.CLOCK)
    node = graph.add(Sample, use_sim_time=True)
    graph.connect()
    clock.publish(Clock(clock=Time(sec=-1, nanosec=0)))
    graph.report('sample', '1 messages refused')
    clock.publish(Clock(clock=Time(sec=5, nanosec=7)))
    graph.wait_for(lambda: node.get_clock().now().nanoseconds == 5_000_000_007)


def test_a_second_one_ends_and_says_beside_whom(graph, process):
    import os
    graph.add(Sample)  # publishes `zero`, as the calibration does
    second = process('calibration')
    graph.wait_for(lambda: second.poll() is not None, 'the second one to end')
    err = second.communicate()[1].splitlines()
    assert second.returncode == 2
    assert err[-1].startswith('error: calibration: /mount/zero is published by /mount/sample (')
    assert f'process {os.getpid()}' in err[-1] and 'another namespace' in err[-1]


def test_a_node_that_shall_be_secured_does_not_run_without_security(
        ros_domain, process, monkeypatch, tmp_path):
    for name, value in (('ENABLE', 'true'), ('STRATEGY', 'Enforce'), ('KEYSTORE', str(tmp_path))):
        monkeypatch.setenv(f'ROS_SECURITY_{name}', value)
    child = process('pointing_corrector')
    err = child.communicate(timeout=60)[1]
    lines = [line for line in err.splitlines() if line.startswith('error: ')]
    assert child.returncode == 2 and len(lines) == 1 and 'SECURITY.md' in lines[0], err
