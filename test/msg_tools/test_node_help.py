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

"""``--help`` of a node."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed (./install.sh ros)',
                    exc_type=ImportError)


@pytest.fixture
def told(capsys):
    from msg_tools.node_process import main
    from telescope_mount.graph import NODES

    def help_of(name, monkeypatch):
        monkeypatch.setattr('sys.argv', [name, NODES[name], '--help'])
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code
        return capsys.readouterr().out
    return help_of


def test_every_node_tells_its_parameters_and_what_it_takes_and_gives(told, monkeypatch):
    from telescope_mount.graph import NODES
    for name in NODES:
        text = told(name, monkeypatch)
        assert text.startswith(f'usage: ros2 run telescope_mount {name} ')
        assert 'parameters:' in text and max(map(len, text.splitlines()[1:])) <= 80
        assert 'topics that it ' in text or name == 'mcap_logger'


def test_units_ranges_and_defaults_are_there(told, monkeypatch):
    text = ' '.join(told('star_observer', monkeypatch).split())
    assert 'deg, default' in text
    assert 'camera/miss_distance geometry_msgs/msg/Vector3Stamped' in text
    # what a helper subscribes for it, and what has a loop for it
    for name in ('ambient/temperature', 'zero_on_polaris', 'request/owner', 'observer/plan/status'):
        assert name in text
    text = ' '.join(told('calibration', monkeypatch).split())
    assert "'batch' or 'track', default batch, only at the start" in text
    assert '1 to 100000, default 16' in text and '~/cancel' in text


def test_what_a_live_node_has_is_told(graph):
    from calibration.calibration_node import Calibration
    from msg_tools import topics
    from msg_tools.node_help import endpoints
    node, told = graph.add(Calibration), endpoints('calibration')
    for kind, there in (('gives', node._publishers_of), ('takes', node._subscriptions_of)):
        assert {node.resolve_topic_name(topic.name) for topic in told[kind]} == set(there)
    own = f'{node.get_fully_qualified_name()}/'
    services = {s.srv_name.replace(own, '~/').removeprefix('/mount/') for s in node.services
                if 'parameter' not in s.srv_name and 'type_description' not in s.srv_name}
    assert services == set(told['services'])
    assert topics.ZERO in told['gives']
