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

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.lifecycle import LifecycleNode

from msg_tools.node_lifecycle import AUTOSTART, ManagedNode


class Drive(ManagedNode):
    """Says what was done to it."""

    fault = None

    def __init__(self, **kwargs):
        super().__init__('drive', (AUTOSTART,), **kwargs)
        self.done = []

    def configured(self):
        self.done.append('configured')

    def activated(self):
        if self.fault:
            raise self.fault
        self.done.append('activated')

    def deactivated(self):
        self.done.append('deactivated')


def change(graph, number=0, label=''):
    """Have it make a transition; whether it did."""
    client = graph.tester.create_client(ChangeState, 'drive/change_state')
    graph.wait_for(client.service_is_ready, 'the service')
    future = client.call_async(ChangeState.Request(transition=Transition(id=number, label=label)))
    graph.wait_for(future.done, 'the answer')
    return future.result().success


def test_it_becomes_active_by_itself(graph):
    drive = graph.add(Drive)
    graph.wait_for(lambda: drive.active)
    assert drive.done == ['configured', 'activated'] and drive.inactive == ''
    assert isinstance(drive, LifecycleNode)


def test_without_autostart_it_waits_and_lives_through_what_its_state_does_not_have(graph):
    drive = graph.add(Drive, autostart=False)
    status = graph.report('drive', 'waiting for activation', 'lifecycle', 'unconfigured')
    assert status.level == DiagnosticStatus.WARN
    assert drive.inactive == 'drive is unconfigured: configure and activate it'
    assert not change(graph, Transition.TRANSITION_ACTIVATE)
    assert not change(graph, label='levitate') and not change(graph, 199)
    assert change(graph, Transition.TRANSITION_CONFIGURE)
    assert not change(graph, Transition.TRANSITION_CONFIGURE)
    assert change(graph, Transition.TRANSITION_ACTIVATE) and drive.active
    graph.report('drive', 'ok', 'lifecycle', 'active')
    assert change(graph, Transition.TRANSITION_DEACTIVATE) and not drive.active
    assert drive.done == ['configured', 'activated', 'deactivated']
    assert change(graph, label='activate')
    assert change(graph, Transition.TRANSITION_ACTIVE_SHUTDOWN) and not drive.active
    graph.report('drive', 'waiting for activation', 'lifecycle', 'finalized')
    assert drive.done[3:] == ['activated', 'deactivated']


def test_what_cannot_be_done_leaves_it_inactive(graph):
    drive = graph.add(Drive, autostart=False)
    assert change(graph, Transition.TRANSITION_CONFIGURE)
    drive.fault = ValueError('the drive is off')
    assert not change(graph, Transition.TRANSITION_ACTIVATE)
    graph.report('drive', 'waiting for activation', 'lifecycle', 'inactive')
    drive.fault = RuntimeError('a bug')
    assert not change(graph, Transition.TRANSITION_ACTIVATE)
    graph.report('drive', 'waiting for activation', 'lifecycle', 'unconfigured')
    drive.fault = None
    drive.trigger_configure()
    drive.trigger_activate()
    assert drive.active


@pytest.mark.parametrize('transition', [
    Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVE_SHUTDOWN])
@pytest.mark.parametrize('fault', [None, OSError('the drive is off'), RuntimeError('a bug')])
def test_the_state_that_it_reports_is_that_of_rclpy(graph, transition, fault):
    drive = graph.add(Drive)
    graph.wait_for(lambda: drive.active)

    def fail():
        if fault:
            raise fault
    drive.deactivated = fail
    assert change(graph, transition) is (fault is None) and not drive.active
    client = graph.tester.create_client(GetState, 'drive/get_state')
    graph.wait_for(client.service_is_ready, 'the service')
    future = client.call_async(GetState.Request())
    graph.wait_for(future.done, 'the answer')
    assert ('lifecycle', future.result().current_state.label) in drive.details()
