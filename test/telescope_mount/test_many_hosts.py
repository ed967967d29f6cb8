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

"""The graph over two hosts, in network namespaces: benchmarks/many_hosts.py has the larger cases.

Skipped where none can be made, with the reason.
"""

import json
import subprocess
import sys

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

import many_hosts
from hosts import two_hosts, why_not

from telescope_mount.dds import PROFILES, dds_environment

WHY_NOT = why_not()
pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)

#: tells whom it sees, and of whom it hears, whenever that changes
SEES = """
import json, sys, time
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
rclpy.init()
node, heard, told = Node(sys.argv[1]), set(), None
own = node.create_publisher(String, '/said', 10)
node.create_subscription(String, '/said', lambda message: heard.add(message.data), 10)
while True:
    rclpy.spin_once(node, timeout_sec=0.05)
    own.publish(String(data=sys.argv[1]))
    now = sorted(node.get_node_names()), sorted(heard)
    if now != told:
        told = now
        print(json.dumps(now), flush=True)
"""


@pytest.fixture
def hosts():
    with two_hosts() as (first, second, _):
        yield first, second


def test_a_night_over_two_hosts_has_the_numbers_of_one(hosts, night, tmp_path):
    what, report = many_hosts.observe(*hosts, tmp_path)
    assert what == 'report', report
    for name in ('observations.csv', 'model.json'):
        assert (tmp_path / 'second' / name).read_text() == (night / name).read_text()


def test_by_default_no_other_host_sees_a_graph_even_one_that_names_this_one_as_its_peer(
        hosts, monkeypatch):
    first, second = hosts
    for name in ('ROS_AUTOMATIC_DISCOVERY_RANGE', *PROFILES):
        monkeypatch.delenv(name, raising=False)
    closed = many_hosts.environment(**dds_environment(7))
    # what LOCALHOST is worth alone: the test would see it if nothing were closed
    ajar = many_hosts.environment(ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST', ROS_DOMAIN_ID='7')
    far = many_hosts.environment(ROS_STATIC_PEERS=first.address, ROS_DOMAIN_ID='7')
    nodes = {}
    for host, name, environment in ((first, 'closed', closed), (first, 'ajar', ajar),
                                    (second, 'far', far)):
        nodes[name] = host.start(sys.executable, '-c', SEES, name, env=environment, text=True,
                                 stdout=subprocess.PIPE)
    try:
        seen = {'ajar': set()}
        # ajar and closed hear each other, ajar and far too: whoever wanted to has met
        for name, others in (('far', {'ajar'}), ('closed', {'ajar'}), ('ajar', {'closed', 'far'})):
            for line in nodes[name].stdout:
                names, heard = map(set, json.loads(line))
                seen[name] = names | heard
                if others <= heard:
                    break
            assert others <= heard, (name, seen)
    finally:
        later = {}
        for name, node in nodes.items():
            node.kill()
            later[name] = node.communicate()[0]
    assert 'closed' not in seen['far'] and '"closed"' not in later['far']
    assert 'far' not in seen['closed'] and '"far"' not in later['closed']
