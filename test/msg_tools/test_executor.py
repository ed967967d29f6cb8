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

"""The executor against rclpy's own: the same callbacks, whatever comes and goes."""

import time

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed (./install.sh ros)',
                    exc_type=ImportError)

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_tools import topics


@pytest.fixture
def node(graph):
    made = Node('busy', context=graph.context, namespace='/mount')
    graph.executor.add_node(made)
    yield made
    graph.executor.remove_node(made)
    made.destroy_node()


def matched(graph, node, *pubs):
    """Wait until each publisher and all subscriptions of `node` on its topic know each other."""
    subs = [sub for sub in node.subscriptions
            if sub.topic_name in {pub.topic_name for pub in pubs}]
    graph.wait_for(lambda: all(sub.get_publisher_count() for sub in subs) and all(
        pub.get_subscription_count() == sum(s.topic_name == pub.topic_name for s in subs)
        for pub in pubs), 'the endpoints to match')


def test_messages_come_once_and_in_order(graph, node):
    got = []
    node.create_subscription(String, 'text', lambda message: got.append(message.data), 1000)
    pub = graph.tester.create_publisher(String, 'text', 1000)
    matched(graph, node, pub)
    for number in range(300):
        pub.publish(String(data=str(number)))
    graph.wait_for(lambda: len(got) >= 300)
    assert got == [str(number) for number in range(300)]


def test_a_callback_with_message_info_gets_it(graph, node):
    got = []
    node.create_subscription(
        String, 'text', lambda message, info: got.append((message.data, info)), 10)
    pub = graph.tester.create_publisher(String, 'text', 10)
    matched(graph, node, pub)
    pub.publish(String(data='a'))
    pub.publish(String(data='b'))
    graph.wait_for(lambda: len(got) == 2)
    assert [info['publication_sequence_number'] for _, info in got] == [1, 2]


def test_raw_bytes(graph, node):
    got = []
    node.create_subscription(String, 'text', got.append, 10, raw=True)
    pub = graph.tester.create_publisher(String, 'text', 10)
    matched(graph, node, pub)
    pub.publish(String(data='abc'))
    graph.wait_for(lambda: got)
    assert isinstance(got[0], bytes) and b'abc' in got[0]


def test_entities_that_come_and_go_between_callbacks(graph, node):
    got = []
    pub = graph.tester.create_publisher(String, 'late', 10)
    timers = []

    def make():
        timers.append(node.create_timer(0.001, tick))

    def tick():
        node.destroy_timer(timers[0])
        got.append('tick')
        node.create_subscription(String, 'late', lambda message: got.append(message.data), 10)

    make()
    graph.wait_for(lambda: got)
    matched(graph, node, pub)
    pub.publish(String(data='late'))
    graph.wait_for(lambda: 'late' in got)
    assert got == ['tick', 'late']


def test_a_subscription_destroyed_by_the_callback_before_it(graph, node):
    got, subs = [], []

    def first(message):
        got.append('first')
        if len(subs) == 2:
            node.destroy_subscription(subs.pop())

    subs.append(node.create_subscription(String, 'text', first, 10))
    subs.append(node.create_subscription(String, 'text', lambda _: got.append('second'), 10))
    pub = graph.tester.create_publisher(String, 'text', 10)
    matched(graph, node, pub)
    pub.publish(String())
    graph.wait_for(lambda: len(subs) == 1)
    pub.publish(String())
    graph.wait_for(lambda: got.count('first') == 2)
    assert got.count('second') <= 1


def test_services_clients_and_done_callbacks(graph, node):
    def serve(request, response):
        response.success, response.message = True, 'yes'
        return response

    node.create_service(Trigger, 'ask', serve)
    client = graph.tester.create_client(Trigger, 'ask')
    graph.wait_for(client.service_is_ready)
    told = []
    future = client.call_async(Trigger.Request())
    future.add_done_callback(lambda done: told.append(done.result().message))
    graph.wait_for(lambda: told)
    assert told == ['yes']


def test_a_callback_that_awaits_is_finished_later(graph, node):
    gate, got = Future(), []

    async def slow(message):
        got.append('begin')
        await gate
        got.append('end')

    node.create_subscription(String, 'text', slow, 10)
    pub = graph.tester.create_publisher(String, 'text', 10)
    matched(graph, node, pub)
    pub.publish(String())
    graph.wait_for(lambda: got)
    assert got == ['begin']
    gate.set_result(None)
    graph.executor.wake()
    graph.wait_for(lambda: len(got) == 2)
    assert got == ['begin', 'end']


@pytest.mark.parametrize('group', [ReentrantCallbackGroup, MutuallyExclusiveCallbackGroup])
def test_while_a_callback_awaits_its_group_says_who_goes_on(graph, node, group):
    gate, group = Future(executor=graph.executor), group()

    async def serve(request, response):
        response.message = await gate
        return response

    node.create_service(Trigger, 'ask', serve, callback_group=group)
    client = graph.tester.create_client(Trigger, 'ask')
    graph.wait_for(client.service_is_ready)
    answers = [client.call_async(Trigger.Request())]
    graph.wait_for(lambda: graph.executor._waiting, 'the service to wait')
    ticks, others, got = [], [], []
    node.create_timer(0.001, lambda: ticks.append(1), callback_group=group)
    node.create_timer(0.001, lambda: others.append(1))
    node.create_subscription(String, 'text', lambda message: got.append(len(others)), 10,
                             callback_group=group)
    pub = graph.tester.create_publisher(String, 'text', 10)
    matched(graph, node, pub)
    pub.publish(String())
    answers.append(client.call_async(Trigger.Request()))
    before = len(others)
    graph.wait_for(lambda: len(others) > before + 20)
    alone = isinstance(group, MutuallyExclusiveCallbackGroup)
    assert not any(answer.done() for answer in answers)
    assert bool(ticks) is bool(got) is not alone
    gate.set_result('opened')
    graph.wait_for(lambda: all(answer.done() for answer in answers) and ticks and got)
    assert [answer.result().message for answer in answers] == ['opened'] * 2


def test_a_task_runs_in_the_thread_that_spins(graph):
    got = []
    task = graph.executor.create_task(got.append, 'called')
    assert got == [] and not task.done()
    graph.wait_for(task.done)
    assert got == ['called']
    failing = graph.executor.create_task(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        graph.wait_for(lambda: False)
    assert failing.done()


def test_a_task_that_is_cancelled_leaves_its_group_to_others(graph, node):
    got, group = [], MutuallyExclusiveCallbackGroup()

    async def waits():
        await Future()

    first = node.create_timer(0.001, waits, callback_group=group)
    graph.wait_for(lambda: graph.executor._waiting, 'the timer to wait')
    first.cancel()
    node.create_timer(0.001, lambda: got.append('second'), callback_group=group)
    graph.executor._waiting[0].cancel()
    graph.wait_for(lambda: got)
    assert not graph.executor._waiting


def test_a_timer_that_a_callback_before_it_cancels_or_destroys(graph, node):
    # what is ready was found before: neither may be called for it
    timers, got = [], []

    def first():
        got.append('first')
        timers[1].cancel()
        node.destroy_timer(timers[2])

    timers[:] = [node.create_timer(0.02, call) for call in (
        first, lambda: got.append('cancelled'), lambda: got.append('destroyed'))]
    while not all(timer.is_ready() for timer in timers):
        pass  # until all three are due
    graph.wait_for(lambda: got.count('first') >= 3)
    assert set(got) == {'first'}


def test_an_error_in_a_callback_comes_out(graph, node):
    def fail(message):
        raise LookupError('here')

    node.create_subscription(String, 'text', fail, 10)
    pub = graph.tester.create_publisher(String, 'text', 10)
    matched(graph, node, pub)
    pub.publish(String())
    with pytest.raises(LookupError, match='here'):
        graph.wait_for(lambda: False)


def test_a_timeout_is_kept_and_a_wake_ends_it(graph, node):
    executor = graph.executor
    for _ in range(200):  # what is left of discovery
        executor.spin_once(timeout_sec=0.0)
    begin = time.monotonic()
    executor.wake()
    executor.spin_once(timeout_sec=30.0)
    assert time.monotonic() - begin < 20.0


def test_a_flood_on_one_topic_does_not_silence_another(graph, node):
    got = []
    node.create_subscription(String, 'flood', lambda _: got.append('flood'), 5000)
    node.create_subscription(String, 'rare', lambda _: got.append('rare'), 10)
    flood = graph.tester.create_publisher(String, 'flood', 5000)
    rare = graph.tester.create_publisher(String, 'rare', 10)
    matched(graph, node, flood, rare)
    for _ in range(1000):
        flood.publish(String())
    rare.publish(String())
    graph.wait_for(lambda: 'rare' in got)
    assert got.count('flood') < 1000


def test_what_is_gathered_comes_in_its_order_over_all_topics(graph, node):
    from msg_tools.executor import NodeExecutor
    got = []
    pubs = [graph.tester.create_publisher(String, name, 1000) for name in ('first', 'second')]
    for name in ('second', 'first'):
        node.create_subscription(String, name, lambda message: got.append(message.data), 1000)
    matched(graph, node, *pubs)
    graph.executor.remove_node(node)
    gathering = NodeExecutor(context=graph.context, gather=0.005)
    gathering.add_node(node)
    for number in range(200):
        pubs[number % 3 == 0].publish(String(data=str(number)))
    graph.wait_for(lambda: gathering.spin_once(0.01) or len(got) >= 200)
    assert got == [str(number) for number in range(200)]
    gathering.shutdown()


@pytest.mark.parametrize('gather', (0.0, 0.005))
def test_after_the_messages_that_were_ready_it_says_so(graph, node, gather, monkeypatch):
    from msg_tools.executor import AFTER, NodeExecutor
    monkeypatch.setattr('msg_tools.executor._MANY', 0)
    got, ended = [], []
    pub = graph.tester.create_publisher(String, 'text', 10)
    sub = node.create_subscription(String, 'text', lambda message: got.append(message.data), 10)
    setattr(sub, AFTER, lambda: ended.append(len(got)))
    matched(graph, node, pub)
    graph.executor.remove_node(node)
    executor = NodeExecutor(context=graph.context, gather=gather)
    executor.add_node(node)
    for number in range(5):
        pub.publish(String(data=str(number)))
    graph.wait_for(lambda: executor.spin_once(0.01) or len(got) == 5)
    # all five were there; a message is never told before it was taken
    assert ended[-1] == 5 and ended == sorted(ended) and len(ended) < 5
    executor.shutdown()


@pytest.mark.parametrize('busy', (True, False))
def test_services_of_many_nodes_answer_whether_messages_come_or_not(
        graph, node, busy, monkeypatch):
    monkeypatch.setattr('msg_tools.executor._MANY', 0)
    node.create_service(Trigger, 'seldom', lambda _, response: response)
    if busy:
        pub = graph.tester.create_publisher(String, 'text', 10)
        node.create_subscription(String, 'text', pub.publish, 10)
        matched(graph, node, pub)
        pub.publish(String())
    client = graph.tester.create_client(Trigger, 'seldom')
    graph.wait_for(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    graph.wait_for(future.done)


def echo(graph, node, names):
    """Publishers of `node` on two topics, each of which answers the other for ever."""
    pubs = [node.publisher(topic) for topic in names]
    for sub, pub in zip(names, pubs[::-1]):
        node.subscribe(sub, pub.publish)
    matched(graph, node, *pubs)
    return pubs


@pytest.fixture
def talker(graph):
    from msg_tools.node import MountNode

    class Talker(MountNode):

        def __init__(self, **kwargs):
            super().__init__('talker', **kwargs)
    return graph.add(Talker)


def test_what_a_process_sends_itself_is_not_waited_for(graph, talker, monkeypatch):
    from msg_tools import executor
    monkeypatch.setattr(executor, '_AMONG', 1000.0)
    got = []
    talker.subscribe(topics.MISS_DISTANCE, got.append)
    pub = talker.publisher(topics.MISS_DISTANCE)
    matched(graph, talker, pub)
    graph.executor.spin_once(timeout_sec=0.1)  # with all that is new
    waits = graph.executor._wait
    monkeypatch.setattr(graph.executor, '_wait', lambda _: pytest.fail('it waits'))
    pub.publish(topics.MISS_DISTANCE.message())
    graph.executor.spin_once(timeout_sec=0.1)
    assert len(got) == 1
    monkeypatch.setattr(graph.executor, '_wait', waits)
    graph.executor.spin_once(timeout_sec=0.0)
    assert len(got) == 1


def test_nodes_that_talk_for_ever_leave_time_for_all_else(graph, talker):
    seen = []
    talker.create_timer(0.01, lambda: seen.append('timer'))
    talker.create_service(Trigger, 'seldom', lambda _, response: response)
    talker.create_subscription(String, 'text', lambda _: seen.append('text'), 10)
    other = graph.tester.create_publisher(String, 'text', 10)
    matched(graph, talker, other)
    pubs = echo(graph, talker, (topics.MISS_DISTANCE, topics.OFFSET))
    client = graph.tester.create_client(Trigger, 'seldom')
    graph.wait_for(client.service_is_ready)
    pubs[0].publish(topics.MISS_DISTANCE.message())
    future = client.call_async(Trigger.Request())
    other.publish(String())
    graph.wait_for(lambda: future.done() and 'text' in seen and seen.count('timer') > 3)
    assert talker._publishers_of[pubs[1].topic_name][1].count > 10


def test_it_leaves_nothing_behind(ros_domain):
    import gc
    import os
    import weakref

    import rclpy
    from rclpy.context import Context
    from rclpy.signals import SignalHandlerOptions

    from msg_tools.executor import NodeExecutor

    def live():
        context = Context()
        rclpy.init(context=context, domain_id=ros_domain,
                   signal_handler_options=SignalHandlerOptions.NO)
        executor = NodeExecutor(context=context)
        node = Node('short', context=context)
        node.create_publisher(topics.DIAGNOSTICS.message, topics.DIAGNOSTICS.name, 1)
        executor.add_node(node)
        executor.spin_once(timeout_sec=0.0)
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
        executor.spin_once(timeout_sec=0.0)  # of no effect, and no error
        return [weakref.ref(thing) for thing in (executor, node)]

    def held():
        gc.collect()
        return {kind: len(os.listdir(f'/proc/self/{kind}')) for kind in ('task', 'fd')}
    live()  # what DDS makes once for the process
    before = held()
    for _ in range(3):
        things = live()
        assert held() == before
        assert [thing() for thing in things] == [None, None]
