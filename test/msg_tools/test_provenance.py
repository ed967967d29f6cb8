"""Parameters of the other nodes, asked one after another."""

from types import SimpleNamespace

import pytest

pytest.importorskip(
    'rclpy', reason='rclpy is not installed (./install.sh ros)', exc_type=ImportError)
from msg_tools.bag.provenance import PATIENCE, TRIES, ParameterCollector
from msg_tools.params import OF_TRUTH


class Asker:
    """Stands for a node that sees two others, of which one is not ready for `deaf` clients."""

    def __init__(self, deaf):
        self.deaf, self.asked = deaf, []

    def get_fully_qualified_name(self):
        return '/mount/log'

    def get_node_names_and_namespaces(self):
        return [('log', '/mount'), ('slow', '/mount'), ('quick', '/mount')]

    def get_service_names_and_types_by_node(self, name, namespace):
        return [(f'{namespace}/{name}/{verb}_parameters', [])
                for verb in ('list', 'describe', 'get')]

    def create_client(self, kind, service):
        name, what = service.split('/')[-2:]
        self.asked.append((name, what))
        ready = name != 'slow' or sum(n == 'slow' for n, _ in self.asked) > self.deaf
        if what == 'list_parameters':
            answer = SimpleNamespace(result=SimpleNamespace(names=['rate', 'seed']))
        elif what == 'describe_parameters':
            answer = SimpleNamespace(descriptors=[
                SimpleNamespace(additional_constraints=text) for text in ('', OF_TRUTH)])
        else:
            answer = SimpleNamespace(values=[SimpleNamespace(
                type=2, integer_value=k) for k in (7, 3)])
        future = SimpleNamespace(result=lambda: answer, add_done_callback=None)
        future.add_done_callback = lambda then: then(future)
        return SimpleNamespace(service_is_ready=lambda: ready, call_async=lambda request: future)

    def destroy_client(self, client):
        pass


def collected(deaf, monkeypatch):
    from msg_tools.bag import provenance
    monkeypatch.setattr(provenance, 'parameter_value_to_python', lambda v: v.integer_value)
    node, got = Asker(deaf), {}

    def take(name, values, truth):
        assert truth == {'seed'}
        got[name] = values
    collector = ParameterCollector(node, take)
    for _ in range((PATIENCE + 3) * (TRIES + 2)):
        collector.step()
    return node, got


def test_a_node_that_is_busy_is_asked_again_after_the_others(monkeypatch):
    node, got = collected(2, monkeypatch)
    assert got == dict.fromkeys(
        ('/mount/quick', '/mount/slow'), {'rate': '7', 'seed': '3'})
    assert node.asked[:2] == [('slow', 'list_parameters'), ('quick', 'list_parameters')]


def test_a_node_that_never_answers_is_left_alone(monkeypatch):
    node, got = collected(10**6, monkeypatch)
    assert list(got) == ['/mount/quick']
    assert sum(name == 'slow' for name, _ in node.asked) == TRIES
