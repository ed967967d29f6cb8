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

"""Parameters of the other nodes: asked at once, and again where an answer is lost."""

from types import SimpleNamespace

import pytest

pytest.importorskip(
    'rclpy', reason='rclpy is not installed (./install.sh ros)', exc_type=ImportError)
from msg_tools.bag.parameter_query import GIVEN_UP, WAITED_FOR, ParameterCollector
from msg_tools.params import TRUTH_MARK


class Asker:
    """Stands for a node that sees two others, of which `slow` is deaf at first.

    It is ready after so many looks, and then loses so many questions.
    """

    def __init__(self, unready=0, lost=0):
        self.unready, self.lost, self.asked, self.clients = unready, lost, [], 0
        self.executor = SimpleNamespace(create_task=lambda call, *args: call(*args))

    def get_fully_qualified_name(self):
        return '/mount/log'

    def get_namespace(self):
        return '/mount'

    def get_node_names_and_namespaces(self):
        # the last is of another mount: none of its parameters go into this log
        return [('log', '/mount'), ('slow', '/mount'), ('quick', '/mount'), ('quick', '/mount_2')]

    def get_service_names_and_types_by_node(self, name, namespace):
        return [(f'{namespace}/{name}/{verb}_parameters', [])
                for verb in ('list', 'describe', 'get')]

    def create_client(self, kind, service):
        name, what = service.split('/')[-2:]
        self.clients += 1
        if what == 'list_parameters':
            answer = SimpleNamespace(result=SimpleNamespace(names=['rate', 'seed']))
        elif what == 'describe_parameters':
            answer = SimpleNamespace(descriptors=[
                SimpleNamespace(additional_constraints=text) for text in ('', TRUTH_MARK)])
        else:
            answer = SimpleNamespace(values=[SimpleNamespace(
                type=2, integer_value=k) for k in (7, 3)])

        def ready():
            self.unready -= name == 'slow'
            return name != 'slow' or self.unready < 0

        def call(request):
            self.asked.append((name, what))
            self.lost -= name == 'slow'
            heard = name != 'slow' or self.lost < 0
            return SimpleNamespace(result=lambda: answer, add_done_callback=(
                lambda then: then(SimpleNamespace(result=lambda: answer)) if heard else None))
        return SimpleNamespace(service_is_ready=ready, call_async=call)

    def destroy_client(self, client):
        self.clients -= 1


def collected(monkeypatch, steps, **deaf):
    from msg_tools.bag import parameter_query
    monkeypatch.setattr(parameter_query, 'parameter_value_to_python', lambda v: v.integer_value)
    node, got = Asker(**deaf), {}

    def take(name, values, truth):
        assert truth == {'seed'}
        got[name] = values
    collector = ParameterCollector(node, take)
    for _ in range(steps):
        collector.step()
    return node, got, collector


BOTH = dict.fromkeys(('/mount/quick', '/mount/slow'), {'rate': '7', 'seed': '3'})


def test_all_nodes_are_asked_at_once(monkeypatch):
    node, got, collector = collected(monkeypatch, 1)
    assert got == BOTH and node.clients == 0 and not collector.awaited


@pytest.mark.parametrize('deaf, steps', [({'unready': 3}, 3), ({'lost': 1}, 2),
                                         ({'lost': 2}, 2 + 4)])
def test_a_lost_answer_is_asked_for_again_soon(monkeypatch, deaf, steps):
    node, got, collector = collected(monkeypatch, steps - 1, **deaf)
    assert list(got) == ['/mount/quick'] and collector.awaited
    node, got, collector = collected(monkeypatch, steps, **deaf)
    assert got == BOTH and not collector.awaited


def test_who_never_answers_is_waited_for_a_while_and_asked_more_and_more_seldom(monkeypatch):
    node, got, collector = collected(monkeypatch, WAITED_FOR + 1, lost=10**6)
    assert list(got) == ['/mount/quick'] and not collector.awaited and node.clients == 1
    for _ in range(GIVEN_UP):
        collector.step()
    assert node.clients == 0
    assert sum(name == 'slow' for name, _ in node.asked) == 8  # at 0, 2, 6, 14 ... 254
