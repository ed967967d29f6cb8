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

"""Requirements of this project's nodes on an executor: one case each, run by `executor.py`.

A case gets a spinning node (`executor.Spun`) and returns whether its docstring holds.
"""

import os
import statistics
import time


def _publish_text(spun, callback, text='a'):
    from std_msgs.msg import String
    spun.node.create_subscription(String, 'text', callback, 10)
    pub = spun.node.create_publisher(String, 'text', 10)
    spun.matched(pub)
    pub.publish(String(data=text))


def spin(spun):
    """runs what is ready"""
    import threading
    got = []
    spun.node.create_timer(0.01, lambda: got.append(1))
    threading.Timer(1.0, lambda: os._exit(0 if len(got) > 10 else 3)).start()
    spun.executor.spin()


def a_callback_with_message_info(spun):
    """(message, info), from which every subscription of ours counts what was lost"""
    got = []
    _publish_text(spun, lambda message, info: got.append((message.data, info)))
    return spun.until(lambda: got) and got[0][1]['publication_sequence_number'] == 1


def an_error_in_a_callback(spun):
    """comes out of spin_once"""
    def fail(message):
        raise LookupError('here')
    try:
        _publish_text(spun, fail)
        spun.until(lambda: False, 2.0)
    except LookupError:
        return True
    return False


def an_async_callback(spun):
    """of a subscription is finished later"""
    from rclpy.task import Future
    gate, got = Future(), []

    async def slow(message):
        got.append(await gate)
    _publish_text(spun, slow)
    spun.until(lambda: False, 0.5)
    gate.set_result('end')
    spun.executor.wake()
    return spun.until(lambda: got == ['end'], 2.0)


def an_async_service(spun):
    """answers later, as the mount's `home` does"""
    from rclpy.task import Future
    from std_srvs.srv import Trigger
    gate = Future(executor=spun.executor)

    async def serve(request, response):
        response.success = await gate
        return response
    spun.node.create_service(Trigger, 'ask', serve)
    client = spun.node.create_client(Trigger, 'ask')
    spun.until(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    spun.until(answer.done, 0.3)
    spun.node.create_timer(0.05, lambda: gate.done() or gate.set_result(True))
    return spun.until(answer.done, 3.0) and answer.result().success


def a_timer_on_the_steady_clock(spun):
    """keeps its period within 20 %"""
    from rclpy.clock import Clock, ClockType
    got = []
    spun.node.create_timer(0.01, lambda: got.append(time.monotonic()),
                           clock=Clock(clock_type=ClockType.STEADY_TIME))
    spun.until(lambda: len(got) > 100)
    return abs(statistics.median(b - a for a, b in zip(got, got[1:])) - 0.01) < 0.002


def a_timer_on_simulated_time(spun):
    """goes with /clock and with nothing else"""
    from builtin_interfaces.msg import Time
    from rclpy.parameter import Parameter
    from rosgraph_msgs.msg import Clock
    spun.node.set_parameters([Parameter('use_sim_time', value=True)])
    got = []
    spun.node.create_timer(1.0, lambda: got.append(1))
    pub = spun.node.create_publisher(Clock, '/clock', 10)
    spun.matched(pub)
    for second in range(100, 110):
        pub.publish(Clock(clock=Time(sec=second)))
        spun.until(lambda: False, 0.1)
    return len(got) == 10


def entities_that_a_callback_destroys(spun):
    """are not called any more"""
    from std_msgs.msg import String
    got, subs = [], []

    def first(message):
        got.append('first')
        if len(subs) == 2:
            spun.node.destroy_subscription(subs.pop())
    subs.append(spun.node.create_subscription(String, 'text', first, 10))
    subs.append(spun.node.create_subscription(String, 'text', lambda _: got.append('no'), 10))
    pub = spun.node.create_publisher(String, 'text', 10)
    spun.until(lambda: pub.get_subscription_count() == 2)
    for count in (1, 2):
        pub.publish(String())
        spun.until(lambda: got.count('first') == count)  # noqa: B023 (called at once)
    return got.count('first') == 2 and got.count('no') <= 1


def wake(spun):
    """ends a spin_once that waits"""
    for _ in range(200):
        spun.executor.spin_once(timeout_sec=0.0)
    begun = time.monotonic()
    spun.executor.wake()
    spun.executor.spin_once(timeout_sec=3.0)
    return time.monotonic() - begun < 2.0


def spin_once_after_the_end(spun):
    """is of no effect, and no error"""
    spun.executor.shutdown()
    spun.node.destroy_node()
    spun.context.try_shutdown()
    spun.executor.spin_once(timeout_sec=0.0)
    return True


CASES = (spin, a_callback_with_message_info, an_error_in_a_callback, an_async_callback,
         an_async_service, a_timer_on_the_steady_clock, a_timer_on_simulated_time,
         entities_that_a_callback_destroys, wake, spin_once_after_the_end)
