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

"""The commands `guard` and `lifecycle` beside a guard that runs."""

import json
import os

import pytest

from telescope_mount.commands.guard import sentence

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools import convert
from telescope_mount.commands import watch
from telescope_mount.running_graph import graph_client
from telescope_mount.running_graph.graph_client import elsewhere


def test_the_guard_is_asked_from_the_command_line(process, ros_domain, ended, monkeypatch):
    monkeypatch.setitem(os.environ, 'ROS_DOMAIN_ID', str(ros_domain))
    monkeypatch.setattr(graph_client, 'FOUND', 60.0)
    process('mount_guard', park_deg='180,45', latitude_deg=34.3,
            longitude_deg=109.0)
    assert ended('guard') == (0, 'idle: no request\n', '')
    assert ended('guard', 'resume') == (1, 'resume refused: nothing is paused\n', '')
    code, out, _ = ended('guard', 'park')
    assert code == 1 and out.startswith('park refused: where the axes stand is not known')
    code, out, _ = ended('guard', 'abort')
    assert code == 0 and out.startswith('aborted: the axes move, or report no angle')  # no encoder
    assert ended('guard') == (0, 'aborted: aborted: call resume\n', '')
    assert ended('lifecycle', 'mount_guard', 'deactivate')[:2] == (0, 'mount_guard: inactive\n')
    code, out, _ = ended('guard', 'resume')
    assert code == 1 and 'mount_guard is inactive' in out
    monkeypatch.setattr(watch, 'FOUND', 60.0)
    code, out, _ = ended('watch', '--json')
    state = json.loads(out)
    # whichever came first
    assert code == 0 and (state['guard'] == 'inactive' or '/mount/mount_guard' in state['nodes'])
    monkeypatch.setattr(graph_client, 'FOUND', 1.0)
    monkeypatch.setattr(watch, 'FOUND', 1.0)
    code, out, err = ended('watch', '--namespace', 'other')
    assert code == 2 and out == '' and 'no messages in /other; ' in err
    code, out, err = ended('guard', 'abort', '--namespace', '/other')
    assert code == 2 and out == '' and err.startswith(
        f'error: no node offers /other/abort; domain {ros_domain} has nodes in /mount and none in '
        '/other')


def test_where_no_node_is_found_domain_and_namespace_are_named():
    assert elsewhere(3, '/mount', {'/mount', '/b'}) == ''
    assert 'no node at all in domain 3: give the ROS domain' in elsewhere(3, '/mount', set())
    assert 'has nodes in /a, /b and none in /mount' in elsewhere(3, '/mount', {'/b', '/a'})


def test_the_last_refusal_is_told_with_the_state():
    assert sentence(convert.status(b'\0', 'guard', 'as requested', state='following',
                                   refused=7, reason='below the horizon')) == (
        'following: as requested\nlast refused: below the horizon')
