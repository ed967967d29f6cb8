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

"""Which sockets the processes of a graph have: by default none on another interface than loopback.

Linux tells them in /proc.
"""

import json
import os
import re
import subprocess
import sys
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from telescope_mount.dds import IMPLEMENTATION, PROFILES, RANGE, dds_environment

if not Path('/proc/self/net/udp').is_file():
    pytest.skip('no /proc/self/net/udp on this system', allow_module_level=True)

#: tells of whom it hears, whenever that changes
HEARS = """
import json, sys
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
    if sorted(heard) != told:
        told = sorted(heard)
        print(json.dumps(told), flush=True)
"""


def sockets(pid):
    """(protocol, local address) of the sockets of a process that others may send to."""
    mine = set()
    for file in Path(f'/proc/{pid}/fd').iterdir():
        with suppress(OSError):
            mine.update(re.findall(r'socket:\[(\d+)\]', os.readlink(file)))
    found = set()
    for kind in ('udp', 'udp6', 'tcp', 'tcp6', 'raw', 'raw6'):
        with suppress(OSError):
            for line in Path(f'/proc/{pid}/net/{kind}').read_text().splitlines()[1:]:
                cells = line.split()
                if cells[9] in mine:
                    words = bytes.fromhex(cells[1].partition(':')[0])
                    # each word of four bytes is in the machine's own order
                    words = b''.join(words[i:i + 4][::-1] if sys.byteorder == 'little'
                                     else words[i:i + 4] for i in range(0, len(words), 4))
                    found.add((kind, str(ip_address(words))))
    return found


def test_no_socket_of_a_graph_is_on_another_interface_than_loopback(ros_domain, monkeypatch):
    for name in (RANGE, IMPLEMENTATION, *PROFILES):
        monkeypatch.delenv(name, raising=False)
    ours = os.environ | dds_environment(ros_domain)
    # what the range alone is worth: the test would see a socket elsewhere
    ajar = os.environ | {'ROS_DOMAIN_ID': str(ros_domain), RANGE: 'LOCALHOST'}
    nodes = {name: subprocess.Popen([sys.executable, '-c', HEARS, name], env=environment,
                                    text=True, stdout=subprocess.PIPE)
             for name, environment in (('one', ours), ('two', ours), ('ajar', ajar))}
    try:
        for name, others in (('one', {'two', 'ajar'}), ('two', {'one'}), ('ajar', {'one'})):
            assert any(others <= set(json.loads(line)) for line in nodes[name].stdout)
        there = {name: sockets(node.pid) for name, node in nodes.items()}
    finally:
        for node in nodes.values():
            node.kill()
            node.communicate()
    assert there['one'] == there['two'] == {('udp', '127.0.0.1')}
    assert ('udp', '0.0.0.0') in there['ajar']


@pytest.mark.parametrize('asked', ['', 'rmw_fastrtps_cpp', 'rmw_cyclonedds_cpp'])
def test_only_fast_dds_is_left_to_its_profile(monkeypatch, asked):
    """Another DDS does not read it, and keeps the range LOCALHOST."""
    for name in (RANGE, *PROFILES):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(IMPLEMENTATION, asked)
    told = dds_environment(3)
    if asked == 'rmw_cyclonedds_cpp':
        assert told[RANGE] == 'LOCALHOST' and IMPLEMENTATION not in told
    else:
        assert (told[RANGE], told[IMPLEMENTATION]) == ('SYSTEM_DEFAULT', 'rmw_fastrtps_cpp')
    monkeypatch.setenv(RANGE, 'SUBNET')
    assert dds_environment(3)[RANGE] == 'SUBNET'
