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

"""Messages that cannot be, on every topic that a node of the graph hears: it lives, and teaches
nobody a falsehood.
"""

import array
import json
import math
from functools import partial
from importlib import import_module

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription

from msg_tools import topics
from msg_tools.convert import read_trajectory
from telescope_mount.graph import NIGHT, NODES

#: of each message: some are nearly right, so that they come further in
MESSAGES = 12
INFO = {'source_timestamp': 1, 'received_timestamp': 1, 'publication_sequence_number': 0}
NUMBERS = (0.0, -0.0, 0.5, 1e-300, 7.0, -3e9, 1e300, -1e308, math.inf, -math.inf, math.nan)
WHOLE = (0, 1, -1, 2, 3, 127, 255, 2**31 - 1, -2**31, 2**63 - 1, -2**63, 2**32 - 1)
NAMES = ('azimuth', 'elevation', 'x', 'y', 'az', 'el', 'time', 'star', 'run', 'mount_enu', '',
         '/mount/star_observer', '/mount/calibration', '/mount/mcap_logger', 'homed',
         'observations')
TEXTS = ('9' * 5000, '1e999', 'NaN', 'Infinity', '-1', '0x10', '{}', '[]', 'null', '{"model": {',
         '[' * 3000, '{"terms": {"IA": 1e308}}', '{"version": 1, "terms": [], "mount": 7}',
         'a\x00b', '{"checks": [{"n": -1}]}', '[1e999, -1e999, NaN]', '\u202e\U0001f52d',
         ' ' * 3000, 'true')


def _value(kind, rng):
    """Something that a field of this ROS type can carry."""
    if kind.startswith('sequence<') or kind.endswith(']'):
        inner = kind[9:-1].split(',')[0] if kind.startswith('sequence<') else kind.partition('[')[0]
        fixed = kind.partition('[')[2].rstrip(']') if kind.endswith(']') else ''
        count = int(fixed) if fixed else int(rng.choice([0, 1, 2, 2, 2, 3, 48]))
        values = [_value(inner, rng) for _ in range(count)]
        return values if inner not in ('uint8', 'octet', 'byte') else array.array(
            'B', [abs(int(v)) % 256 for v in values])
    if kind in ('float', 'double'):
        value = float(rng.choice(NUMBERS))
        return max(-3e38, min(3e38, value)) if kind == 'float' and math.isfinite(value) else value
    if kind == 'boolean':
        return bool(rng.integers(2))
    if kind in ('octet', 'byte'):
        return bytes([int(rng.integers(256))])
    if kind.lstrip('u').startswith('int'):
        bits = int(kind.lstrip('uint'))
        low, high = (0, 2**bits - 1) if kind[0] == 'u' else (-2**(bits - 1), 2**(bits - 1) - 1)
        return max(low, min(high, WHOLE[rng.integers(len(WHOLE))]))
    if kind == 'string':
        return str(rng.choice(NAMES if rng.random() < 0.7 else TEXTS))
    package, name = kind.split('/')[0], kind.split('/')[-1]
    return hostile(getattr(import_module(f'{package}.msg'), name), rng)


def hostile(message, rng):
    """A message of any type, filled at random."""
    out = message()
    for name, kind in message.get_fields_and_field_types().items():
        setattr(out, name, _value(kind, rng))
    return out


def nearly_right(message, rng):
    """A message as the graph sends it, but for its numbers or its text."""
    out = hostile(message, rng)
    if hasattr(out, 'position') and hasattr(out, 'name'):
        out.name = ['azimuth', 'elevation']
        out.position, out.velocity, out.effort = (
            [float(v) for v in rng.choice(NUMBERS, 2)] for _ in range(3))
    if hasattr(out, 'joint_names'):
        out.joint_names = ['azimuth', 'elevation']
        for number, point in enumerate(out.points):
            point.positions, point.velocities = (
                [float(v) for v in rng.choice(NUMBERS, 2)] for _ in range(2))
            point.time_from_start.sec, point.time_from_start.nanosec = number, 0
    if hasattr(out, 'header') and rng.random() < 0.7:
        out.header.stamp.sec, out.header.stamp.nanosec = 1_768_482_000, 0
    if hasattr(out, 'data') and isinstance(out.data, str):
        out.data = str(rng.choice(TEXTS)) if rng.random() < 0.5 else json.dumps({
            name: float(rng.choice(NUMBERS[:-3])) for name in ('model', 'terms', 'checks', 'run')})
    return out


def _heard(node):
    """Its subscriptions, and how each is called with a message."""
    for subscription in node.subscriptions:
        counted = subscription._callback_type is Subscription.CallbackType.WithMessageInfo
        as_sent = serialize_message if subscription.raw else lambda message: message
        yield subscription, partial(_call, subscription.callback, as_sent, counted)


def _call(callback, as_sent, counted, message):
    callback(as_sent(message), *([INFO] if counted else []))


def _make(name):
    module = import_module(NODES[name])
    found, = (thing for thing in vars(module).values() if isinstance(thing, type)
              and thing.__module__ == module.__name__ and hasattr(thing, 'create_publisher'))
    return found


@pytest.mark.parametrize('name', [*NIGHT, 'frame_reader', 'mount_display'])
def test_a_node_lives_and_publishes_nothing_that_cannot_be(graph, tmp_path, name):
    given = {'mcap_logger': {'folder': str(tmp_path / 'bag')},
             'mount_guard': {'latitude_deg': 34.3, 'longitude_deg': 109.0}}.get(name, {})
    node = graph.add(_make(name), **given)
    commands, models, zeros = (graph.listen(topic) for topic in (
        topics.COMMAND, topics.MODEL, topics.ZERO))
    rng, heard = np.random.default_rng(20), 0
    for _ in range(MESSAGES):
        for subscription, call in list(_heard(node)):
            for make in (hostile, nearly_right):
                call(make(subscription.msg_type, rng))
                heard += 1
        graph.executor.spin_once(timeout_sec=0.0)
    assert heard >= (2 * MESSAGES if name not in ('mount_display',) else MESSAGES)
    graph.report(name)
    assert not models and not zeros
    for command in commands:
        _, _, angles, rates = read_trajectory(command)
        assert np.isfinite(angles).all() and np.isfinite(rates).all()
        assert (angles[:, 1] > 0.0).all()
