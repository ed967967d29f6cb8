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

"""The plan as an action: goal, feedback and result as numbers and states in standard messages.

Actions of ROS 2 need types that must be built; `docs/ros.md` maps each topic to a part of one.
"""

from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import SetParametersAtomically

from msg_tools import convert, topics

from .plan import VERBS, goal_uuid, parse_plan

#: state of a plan -> state of an action's goal
STATES = {'waiting': GoalStatus.STATUS_ACCEPTED, 'observing': GoalStatus.STATUS_EXECUTING,
          'done': GoalStatus.STATUS_SUCCEEDED, 'cancelled': GoalStatus.STATUS_CANCELED,
          'failed': GoalStatus.STATUS_ABORTED}
#: numbers of the feedback -> fields of `Progress`; steps are counted from 1 here
NUMBERS = {'step_done': 'done', 'step_total': 'total', 'observations': 'observations',
           'power_on': 'run', 'lost': 'lost', 'refused': 'refused', 'forgotten': 'forgotten'}
_ENDED = GoalStatus.STATUS_SUCCEEDED
_ARGUMENT = {
    ParameterType.PARAMETER_NOT_SET: lambda value: '',
    ParameterType.PARAMETER_INTEGER: lambda value: str(value.integer_value),
    ParameterType.PARAMETER_STRING: lambda value: value.string_value,
    ParameterType.PARAMETER_STRING_ARRAY: lambda value: ' '.join(value.string_array_value),
}


def plan_of(steps):
    """Convert typed steps to a plan.

    Parameters
    ----------
    steps : sequence of rcl_interfaces.msg.Parameter
        For each step the verb is the name, and the argument is the value: none, a count, two
        numbers (`track`: arcsec, minutes; `tell_apart`: count, hours), or names.

    Returns
    -------
    str
        Text for `parse_plan`.

    Raises
    ------
    ValueError
        An unknown verb or an invalid argument.
    """
    words = []
    for step in steps:
        value, verb = step.value, step.name
        form = VERBS[verb].pair if verb in VERBS else ''
        if value.type == ParameterType.PARAMETER_DOUBLE_ARRAY and form:
            pair = value.double_array_value
            if len(pair) != 2:
                raise ValueError(f'plan step {verb}: give two numbers, not {len(pair)}')
            argument = form.format(*pair)
        elif value.type in _ARGUMENT:
            argument = _ARGUMENT[value.type](value)
        else:
            raise ValueError(f'plan step {verb}: its argument has a type that no step takes')
        if ',' in verb + argument:
            raise ValueError(f'plan step {verb!r}: one step a parameter, without a comma')
        words.append(f'{verb} {argument}'.strip())
    plan = ', '.join(words)
    parse_plan(plan)
    return plan


def figures_of(document):
    """Numbers of the last blind check and of the clocks, dict of str to dict.

    Parameters
    ----------
    document : dict
        Document of `observer/checks`.
    """
    groups = {'check': (document['checks'] or [{}])[-1],
              'clocks': document.get('clocks', {}).get('found') or {}}
    return {name: {key: value for key, value in rows.items() if isinstance(value, int | float)}
            for name, rows in groups.items() if rows}


class PlanTopics:
    """Publishes the states of goals and their feedback, and serves the typed goal.

    Parameters
    ----------
    node : MountNode
    begin : callable
        ``begin(plan)`` returns whether it was accepted, and a sentence.

    Attributes
    ----------
    results : dict
        Results besides the feedback, see `figures_of`.
    """

    def __init__(self, node, begin):
        self._node, self._begin, self._goal = node, begin, None
        self._begun, self.results = 0, {}  # stamp of the last goal, ns
        self._state_pub = node.publisher(topics.PLAN_STATUS)
        self._feedback_pub = node.publisher(topics.PLAN_FEEDBACK)
        node.create_service(SetParametersAtomically, '~/plan', self._on_goal)

    def _on_goal(self, request, response):
        result = response.result
        try:
            result.successful, result.reason = self._begin(plan_of(request.parameters))
        except ValueError as error:
            result.successful, result.reason = False, str(error)
        return response

    def publish(self, progress, busy):
        """Publish the progress of a plan.

        Parameters
        ----------
        progress : Progress
        busy : bool
            Whether it is under way; before the first plan there is no goal.
        """
        state, stamp = STATES[progress.state], self._node.now()
        ended = self._goal is None or self._goal.status >= _ENDED
        if ended and busy and state < _ENDED:
            # simulated time may stand still between two goals, which must differ
            self._begun = max(stamp, self._begun + 1)
            self._goal = GoalStatus(goal_info=GoalInfo(stamp=convert.to_stamp(self._begun)))
            self._goal.goal_info.goal_id.uuid = list(goal_uuid(self._begun, progress.plan).bytes)
        if self._goal is None:
            return
        if self._goal.status != state:
            self._goal.status = state
            self._state_pub.publish(GoalStatusArray(status_list=[self._goal]))
        message = DiagnosticArray(status=[
            convert.status(b'\0', 'plan', progress.step, state=state,
                           step=progress.block + 1, steps=progress.steps,
                           **{key: getattr(progress, name) for key, name in NUMBERS.items()}),
            *convert.figures(stamp, self.results).status])
        message.header.stamp = convert.to_stamp(stamp)
        self._feedback_pub.publish(message)
