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

"""The actions with a real star observer, and with a calibration that the test plays."""

import json
import sys

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from answering import Instruments, Night
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.params import BadInput
from telescope_mount.bridges.actions.action_bridge_node import ActionBridge

WHY = ('telescope_mount_msgs is not built: colcon build --base-paths msg_tools --packages-select '
       'telescope_mount_msgs, on a machine with rosidl')
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


@pytest.fixture
def types():
    pytest.importorskip('telescope_mount_msgs', reason=WHY, exc_type=ImportError)
    from telescope_mount_msgs import action, msg
    action.PlanStep = msg.PlanStep
    return action


class Client:
    """Of one action."""

    def __init__(self, graph, kind, name):
        from rclpy.action import ActionClient
        self.graph, self.kind, self.heard = graph, kind, []
        self.client = ActionClient(graph.tester, kind, name)

    def send(self, **goal):
        """The handle of a goal, accepted or not."""
        self.graph.wait_for(self.client.server_is_ready, 'the action to be offered')
        sent = self.client.send_goal_async(
            self.kind.Goal(**goal), lambda message: self.heard.append(message.feedback))
        self.graph.wait_for(sent.done, 'an answer to the goal')
        return sent.result()

    def end(self, handle):
        """State and result of a goal."""
        result = handle.get_result_async()
        self.graph.wait_for(result.done, 'the result')
        return result.result().status, result.result().result

    def cancel(self, handle):
        cancelled = handle.cancel_goal_async()
        self.graph.wait_for(cancelled.done, 'an answer to the cancel')
        return len(cancelled.result().goals_canceling)


@pytest.fixture
def client(graph):
    made = []

    def make(kind, name):
        made.append(Client(graph, kind, name))
        return made[-1]
    yield make
    for one in made:
        one.client.destroy()


def test_without_its_types_one_line_says_what_to_build(graph, monkeypatch):
    for part in ('', '.action', '.msg'):
        monkeypatch.setitem(sys.modules, f'telescope_mount_msgs{part}', None)
    with pytest.raises(BadInput, match=r'telescope_mount_msgs is not built .*; do: colcon build '
                       r'--base-paths src/telescope_mount/msg_tools .*setup\.bash') as error:
        graph.add(ActionBridge)
    assert len(str(error.value).splitlines()) == 1


def test_a_plan_is_observed(graph, types, client):
    Instruments(graph)
    Night(graph, 'stars 5', autostart=False)
    bridge = graph.add(ActionBridge)
    observe = client(types.Observe, 'observe')
    handle = observe.send(steps=[types.PlanStep(verb='stars', count=3)])
    assert handle.accepted
    assert not observe.send(steps=[types.PlanStep(verb='stars', count=1)]).accepted
    state, result = observe.end(handle)
    assert (state, result.progress.state, result.progress.observations) == (SUCCEEDED, 4, 3)
    assert result.progress.message.startswith('plan finished')
    assert (result.progress.step, result.progress.done) == ('stars 3', 3)
    done = [one.progress.done for one in observe.heard]  # the last may come after the result
    assert done == sorted(done) and {one.progress.state for one in observe.heard} <= {1, 2, 4}
    # the same plan once more is another goal
    again = observe.send(steps=[types.PlanStep(verb='stars', count=3)])
    assert observe.end(again)[1].progress.observations == 6
    assert not observe.send().accepted  # an empty plan
    assert not observe.send(steps=[types.PlanStep(verb='stars')]).accepted
    assert not bridge.rejected


def test_a_plan_is_cancelled_and_one_cancelled_by_others_is_aborted(graph, types, client):
    Instruments(graph, homed=False)
    Night(graph, 'stars 5', autostart=False)
    graph.add(ActionBridge)
    observe = client(types.Observe, 'observe')
    goal = {'steps': [types.PlanStep(verb='stars', count=3)]}
    handle = observe.send(**goal)
    graph.wait_for(lambda: observe.heard, 'feedback')
    assert observe.cancel(handle) == 1
    state, result = observe.end(handle)
    assert (state, result.progress.state) == (CANCELED, 5)
    assert result.progress.message == 'by the service cancel'
    handle = observe.send(**goal)
    assert handle.accepted and graph.call('star_observer/cancel').success
    assert observe.end(handle)[0] == ABORTED


def test_the_encoders_are_homed(graph, types, client):
    instruments = Instruments(graph, homed=False)

    def answer():
        instruments.homed = True
        return True, 'homed'
    graph.service('home', answer)
    Night(graph, 'stars 5', autostart=False)
    graph.add(ActionBridge)
    home = client(types.Home, 'home')
    handle = home.send()
    assert handle.accepted
    state, result = home.end(handle)
    assert (state, result.run) == (SUCCEEDED, 1) and 'finished' in result.message
    assert any(one.message for one in home.heard)


def test_an_observer_that_is_gone_ends_the_goal(graph, types, client):
    Instruments(graph, homed=False)
    night = Night(graph, 'stars 5', autostart=False)
    graph.add(ActionBridge, give_up_s=1.0)
    observe = client(types.Observe, 'observe')
    handle = observe.send(steps=[types.PlanStep(verb='stars', count=3)])
    graph.remove(night.node)
    state, result = observe.end(handle)
    assert (state, result.progress.message) == (ABORTED, 'no star observer for 1 s')
    assert not observe.send(steps=[types.PlanStep(verb='fit')]).accepted


class Calibration:
    """That the test plays: it diagnoses until it is told the answer."""

    def __init__(self, graph):
        from rclpy.callback_groups import ReentrantCallbackGroup
        from rclpy.task import Future
        from std_srvs.srv import Trigger
        self.graph, self.answer, self.asked = graph, Future(), False
        self.status = graph.publisher(topics.CALIBRATION_STATUS)
        self.document = graph.publisher(topics.DIAGNOSIS)
        self.document.publish(String(data='{"verdict": "of another diagnosis"}'))

        async def diagnose(_, response):
            self.asked = True
            response.success, response.message = await self.answer
            return response
        graph.tester.create_service(Trigger, 'diagnose', diagnose,
                                    callback_group=ReentrantCallbackGroup())
        graph.service('calibration/cancel', self.cancel)

    def cancel(self):
        if not self.answer.done():
            self.answer.set_result((False, 'diagnosing was cancelled'))
        return True, 'it ends'

    def say(self, **stage):
        self.status.publish(convert.status(DiagnosticStatus.OK, 'calibration', '', **stage))


RMS = {'rms_arcsec': 2.0, 'cv_rms_arcsec': None}
EFFECT = {'name': 'flexure', 'driver': None, 'coefficients_arcsec': {'c': 3.0},
          'sigma_arcsec': {'c': 0.5}, 'p_family': 0.001, 'removes_rms_arcsec': 1.5}


def test_a_diagnosis_has_stages_and_a_result(graph, types, client):
    calibration = Calibration(graph)
    graph.add(ActionBridge)
    diagnose = client(types.Diagnose, 'diagnose')
    handle = diagnose.send()
    assert handle.accepted and not diagnose.send().accepted
    graph.wait_for(lambda: calibration.asked, 'the service to be asked')
    calibration.say(stage='cross-validation', done=3, total=20)
    graph.wait_for(lambda: diagnose.heard, 'feedback')
    heard = diagnose.heard[0]
    assert (heard.stage, heard.done, heard.total) == ('cross-validation', 3, 20)
    calibration.answer.set_result((True, 'flexure; published'))
    calibration.document.publish(String(data=json.dumps({
        'verdict': 'identified', 'published': True, 'before': RMS, 'after': RMS,
        'effects': [EFFECT]})))
    state, result = diagnose.end(handle)
    assert (state, result.verdict, result.published) == (
        SUCCEEDED, types.Diagnose.Result.IDENTIFIED, True)
    assert result.effects[0].name == 'flexure' and result.effects[0].values[0] > 0.0


def test_a_diagnosis_is_cancelled(graph, types, client):
    calibration = Calibration(graph)
    graph.add(ActionBridge)
    diagnose = client(types.Diagnose, 'diagnose')
    handle = diagnose.send()
    graph.wait_for(lambda: calibration.asked, 'the service to be asked')
    assert diagnose.cancel(handle) == 1
    state, result = diagnose.end(handle)
    assert (state, result.verdict, result.message) == (CANCELED, '', 'diagnosing was cancelled')


def test_a_diagnosis_that_cannot_be_is_aborted(graph, types, client):
    calibration = Calibration(graph)
    graph.add(ActionBridge)
    diagnose = client(types.Diagnose, 'diagnose')
    calibration.answer.set_result((False, 'too few stars'))
    state, result = diagnose.end(diagnose.send())
    assert (state, result.message) == (ABORTED, 'too few stars')
