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

"""The plan as an action: typed steps in, states and numbers out."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from action_msgs.msg import GoalStatus
from answering import Instruments, Night
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from msg_tools import topics
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from telescope_mount.observing.night_memory import blind_summary
from telescope_mount.observing.plan import VERBS, parse_plan
from telescope_mount.observing.plan_topics import NUMBERS, figures_of, plan_of

ONE_TERM = PointingModel({'IA': 1e-4})


def steps(*given):
    return [Parameter(verb, value=value).to_parameter_msg() for verb, value in given]


def test_typed_steps_are_the_plan():
    assert plan_of(steps(('home', None), ('stars', 20), ('power_cycle', 'both'),
                         ('track', [1.5, 90.0]), ('tell_apart', [15.0, 2.0]),
                         ('pass', ['L52', 'lageos2.sp3']), ('fit', None))) == (
        'home, stars 20, power_cycle both, track 1.5arcsec 90, tell_apart 15 2h, '
        'pass L52 lageos2.sp3, fit')
    for verb in VERBS:  # each step has a way to be typed
        one = {'track': [2.0, 30.0], 'tell_apart': 4, 'pass': ['a', 'b']}.get(
            verb, 3 if 'count' in VERBS[verb].takes or verb == 'wait' else None)
        assert [step.verb for step in parse_plan(plan_of(steps((verb, one))))] == [verb]


@pytest.mark.parametrize(('verb', 'value', 'why'), [
    ('dance', None, 'unknown'), ('stars', None, 'count'), ('stars', True, 'a type'),
    ('stars', 0, 'count'), ('home', 2, 'no count'), ('track', [1.0], 'two numbers'),
    ('stars', [1.0, 2.0], 'a type'), ('home, stars 9', None, 'without a comma')])
def test_other_arguments_are_refused(verb, value, why):
    with pytest.raises(ValueError, match=why):
        plan_of(steps((verb, value)))
    with pytest.raises(ValueError, match='empty'):
        plan_of([])


def test_goal_states_and_feedback(graph):
    Instruments(graph)
    states = graph.listen(topics.PLAN_STATUS)
    feedback = graph.listen(topics.PLAN_FEEDBACK)
    night = Night(graph, 'stars 5', autostart=False)
    graph.connect()
    client = graph.tester.create_client(SetParametersAtomically, 'star_observer/plan')
    graph.wait_for(client.service_is_ready)

    def ask(*given):
        future = client.call_async(SetParametersAtomically.Request(parameters=steps(*given)))
        graph.wait_for(future.done)
        return future.result().result
    refused = ask(('stars', -1))
    assert not refused.successful and 'stars' in refused.reason and not states
    assert ask(('stars', 2)).successful
    assert ask(('stars', 2)).reason == 'a plan is under way'
    assert len(night.run()) == 2
    graph.wait_for(lambda: states and states[-1].status_list[0].status == (
        GoalStatus.STATUS_SUCCEEDED), 'the goal to succeed')
    goals = [message.status_list[0] for message in states]
    assert {tuple(goal.goal_info.goal_id.uuid) for goal in goals} == {
        tuple(goals[0].goal_info.goal_id.uuid)}
    assert [goal.status for goal in goals] == sorted(goal.status for goal in goals)
    last = {row.key: float(row.value) for row in feedback[-1].status[0].values}
    assert set(last) == {'state', 'step', 'steps', *NUMBERS} and len(last) <= 15
    assert (last['step'], last['steps'], last['step_done'], last['step_total']) == (1, 1, 2, 2)
    assert (last['observations'], last['state']) == (2.0, GoalStatus.STATUS_SUCCEEDED)
    assert ask(('stars', 1)).successful
    graph.wait_for(lambda: tuple(states[-1].status_list[0].goal_info.goal_id.uuid) != tuple(
        goals[0].goal_info.goal_id.uuid), 'another goal')


def test_checks_and_clocks_are_numbers_of_the_result():
    checks = [blind_summary([[1e-6, 0.0]]), blind_summary([[3e-6, 4e-6]], 2, ONE_TERM)]
    found = figures_of({'checks': checks, 'clocks': {'found': {'offset_s': 0.1, 'sigma_s': 0.01}}})
    assert found['clocks'] == {'offset_s': 0.1, 'sigma_s': 0.01}
    assert found['check']['rms_arcsec'] == pytest.approx(5e-6 / ARCSEC)
    assert (found['check']['stars'], found['check']['lost']) == (1, 2)
    assert all(isinstance(value, int | float) for value in found['check'].values())
    assert figures_of({'checks': []}) == {} == figures_of({'checks': [], 'clocks': {'found': None}})


def test_each_goal_that_is_accepted_has_a_state_of_its_own(graph):
    """Also the same plan, cancelled before it begins, while simulated time stands still."""
    Instruments(graph, homed=False)
    states, feedback = graph.listen(topics.PLAN_STATUS), graph.listen(topics.PLAN_FEEDBACK)
    Night(graph, 'stars 5', autostart=False)
    graph.connect()
    client = graph.tester.create_client(SetParametersAtomically, 'star_observer/plan')
    graph.wait_for(client.service_is_ready)
    seen = set()
    for _ in range(3):
        future = client.call_async(SetParametersAtomically.Request(
            parameters=steps(('stars', 2))))
        graph.wait_for(future.done)
        assert future.result().result.successful and graph.call('star_observer/cancel').success
        goal = graph.wait_for(lambda: states and states[-1].status_list[0].status == (
            GoalStatus.STATUS_CANCELED) and states[-1].status_list[0].goal_info)
        seen.add(tuple(goal.goal_id.uuid))
        graph.wait_for(lambda: {row.key: row.value for row in feedback[-1].status[0].values}[
            'state'] == '5')
        states.clear()
    assert len(seen) == 3
