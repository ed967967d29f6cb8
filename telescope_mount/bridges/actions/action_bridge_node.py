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

"""Offers a plan, a homing and a diagnosis as actions: Observe, Home, Diagnose.

Their types must be built, with the package telescope_mount_msgs; nothing else needs it. Goals are
passed to the services of the graph, whose topics give feedback and result.
"""

import json
import math
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import NamedTuple

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.node import MountNode
from msg_tools.params import BadInput, Param
from msg_tools.service_retry import AGAIN
from msg_tools.status_rows import Progress, Stage
from msg_tools.steps import CallRefused, ServiceCall

from ...observing.plan_topics import STATES, plan_of
from . import BUILD, TYPES
from .action_goals import GoalPlan, counted, diagnosis_fields, plan_step

PARAMS = (
    Param('give_up_s', 30.0, 'wall time without observer or calibration after which a goal is '
          'given up [s]', 1.0, 86400.0),
)
#: s after a match within which a latched message arrives: then any previous goal is known
LATCHED_WITHIN = 1.0


def built_types():
    """Modules `action` and `msg` of the types; BadInput if they are not built."""
    try:
        return tuple(import_module(f'{TYPES}.{part}') for part in ('action', 'msg'))
    except ImportError as err:
        raise BadInput(f'action_bridge: {TYPES} is not built ({err}); do: {BUILD}, and '
                       'source install/setup.bash') from None


class ActionOffer(NamedTuple):
    """An action: its type, subscriptions and service client, and callbacks.

    `begin` and `run` are callbacks of an action server; `cancels` is the client of a service.
    """

    kind: type
    hears: list
    asks: object
    begin: Callable
    run: Callable
    cancels: object


class ActionBridge(MountNode):
    """Action servers for star observer and calibration."""

    def __init__(self, **kwargs):
        super().__init__('action_bridge', PARAMS, hardware_id='actions', **kwargs)
        self._actions, self._messages = built_types()
        self._waits = []  # condition, until when (wall s), Future
        self._goal_known = None  # last goal on observer/plan/status
        self._plan = self._diagnosis = None  # of the current goal
        self._tell = lambda: None  # sends the feedback of the plan
        self._plan_client = self.create_client(SetParametersAtomically, 'star_observer/plan')
        cancel_plan, self._diagnosis_client, cancel_diagnosis = (
            self.create_client(Trigger, name)
            for name in ('star_observer/cancel', 'diagnose', 'calibration/cancel'))
        observer = [self.subscribe(topics.OBSERVER_STATUS, self._on_progress),
                    self.subscribe(topics.PLAN_STATUS, self._on_goal)]
        calibration = [self.subscribe(topics.CALIBRATION_STATUS, self._on_stage),
                       self.subscribe(topics.DIAGNOSIS, self._on_diagnosis)]
        self._observer, self._observer_seen = observer[-1], 0.0  # wall s

        def whole(plan):
            return {'progress': self._messages.PlanProgress(**plan.fields)}

        def message(plan):
            return {'message': plan.fields['message']}
        types = self._actions
        self._servers, self._since = {}, {}
        self._offers = {
            'observe': ActionOffer(
                types.Observe, observer, self._plan_client, partial(self._begin_plan, 'observe'),
                partial(self._follow_plan, types.Observe, whole, whole), cancel_plan),
            'home': ActionOffer(
                types.Home, observer, self._plan_client, partial(self._begin_plan, 'home'),
                partial(self._follow_plan, types.Home, message,
                        lambda plan: message(plan) | {'run': plan.fields['run']}), cancel_plan),
            'diagnose': ActionOffer(
                types.Diagnose, calibration, self._diagnosis_client, self._begin_diagnosis,
                self._run_diagnosis, cancel_diagnosis)}
        self.every(0.05, self._look)

    # --- the actions --------------------------------------------------------------------------

    def _offer(self):
        """Offer an action once its service is there and its latched messages have arrived."""
        now = time.monotonic()
        for name in self._offers.keys() - self._servers:
            offer = self._offers[name]
            if not (offer.asks.service_is_ready() and all(
                    sub.get_publisher_count() for sub in offer.hears)):
                self._since.pop(name, None)
            elif now - self._since.setdefault(name, now) >= LATCHED_WITHIN:
                self._servers[name] = ActionServer(
                    self, offer.kind, name, offer.run, goal_callback=offer.begin,
                    cancel_callback=partial(self._on_cancel, offer.cancels),
                    # a goal waits for the answer of a service
                    callback_group=ReentrantCallbackGroup())

    def _refuse(self, name, why):
        """Log the reason for rejecting a goal, since an action cannot transmit it."""
        self.get_logger().warning(f'{name}: goal refused: {why}')
        return GoalResponse.REJECT

    def _on_cancel(self, client, handle):
        self.executor.create_task(self._cancel, client, handle)
        return CancelResponse.ACCEPT

    async def _cancel(self, client, handle):
        """Repeat cancelling until the goal has ended, since its work may not have started yet."""
        try:
            while handle.is_active:
                await self._ask(client)
                await self._until(lambda: not handle.is_active, AGAIN)
        except CallRefused as err:
            self.get_logger().warning(f'not cancelled: {err}')

    # --- a plan -------------------------------------------------------------------------------

    async def _begin_plan(self, name, request):
        mine = None
        try:
            steps = [plan_step(step) for step in request.steps] if name == 'observe' else [
                plan_step(self._messages.PlanStep(verb=name))]
            parameters = [Parameter(step.verb, value=str(step).partition(' ')[2] or None)
                          .to_parameter_msg() for step in steps]
            plan = plan_of(parameters)
            if self._plan is not None and not self._plan.over:
                raise ValueError('a goal is under way')
            if not self._plan_client.service_is_ready():
                raise ValueError(f'nobody offers {self._plan_client.srv_name}')
            self._plan = mine = GoalPlan(plan, self._goal_known)
            answer = (await self._ask(self._plan_client, SetParametersAtomically.Request(
                parameters=parameters))).result
            if not answer.successful:
                raise ValueError(answer.reason)
        except (ValueError, CallRefused) as err:
            if mine is not None:
                self._plan = None
            return self._refuse(name, err)
        self._observer_seen = time.monotonic()
        return GoalResponse.ACCEPT

    async def _follow_plan(self, kind, feedback, result, handle):
        plan, limit = self._plan, self.value('give_up_s')

        def tell():
            if plan.begun and plan.known:
                handle.publish_feedback(kind.Feedback(**feedback(plan)))
        self._tell = tell
        tell()
        try:
            await self._until(
                lambda: plan.over or time.monotonic() - self._observer_seen > limit)
        finally:
            self._plan, self._tell = None, lambda: None
        end = plan.end(handle.is_cancel_requested, f'no star observer for {limit:g} s')
        getattr(handle, end)()
        return kind.Result(**result(plan))

    def _on_progress(self, message):
        progress = Progress.read(message)
        if progress.state not in STATES:
            raise ValueError(f'a plan in the state {progress.state!r}')
        if self._plan is not None:
            self._plan.take_progress(progress, STATES[progress.state], message.message)
            self._tell()
            self._look()

    def _on_goal(self, message):
        for goal in message.status_list[:1]:
            number = bytes(goal.goal_info.goal_id.uuid)
            if self._plan is not None:
                begun = self._plan.begun
                self._plan.take_goal(number, convert.from_stamp(goal.goal_info.stamp), goal.status)
                if self._plan.begun and not begun:
                    self._tell()
            self._goal_known = number
        self._look()

    # --- a diagnosis --------------------------------------------------------------------------

    def _begin_diagnosis(self, _):
        if self._diagnosis is not None:
            return self._refuse('diagnose', 'a goal is under way')
        if not self._diagnosis_client.service_is_ready():
            return self._refuse('diagnose', f'nobody offers {self._diagnosis_client.srv_name}')
        self._diagnosis = {'tell': lambda stage: None}
        return GoalResponse.ACCEPT

    async def _run_diagnosis(self, handle):
        types, known, fields = self._actions.Diagnose, self._diagnosis, None

        def tell(stage):
            handle.publish_feedback(types.Feedback(**stage))
        known['tell'] = tell
        try:
            answer = await self._ask(self._diagnosis_client, effect=lambda: 'document' in known)
            done, message = answer is None or answer.success, getattr(
                answer, 'message', 'the answer was lost on the way')
            if done and not await self._until(
                    lambda: 'document' in known, self.value('give_up_s')):
                raise CallRefused('the diagnosis was not published')
            if done:
                fields = diagnosis_fields(known['document'], message)
        except (ValueError, CallRefused) as err:
            message = str(err)
        finally:
            self._diagnosis = None
        if fields is None:
            (handle.canceled if handle.is_cancel_requested else handle.abort)()
            return types.Result(message=message, **dict.fromkeys(
                ('rms_before', 'rms_after', 'validated_rms_before', 'validated_rms_after'),
                math.nan))
        fields['effects'] = [self._messages.Effect(**effect) for effect in fields['effects']]
        handle.succeed()
        return types.Result(**fields)

    def _on_stage(self, message):
        stage = Stage.read(message)
        if self._diagnosis is not None and stage is not None:
            self._diagnosis['tell'](counted(stage._asdict()))

    def _on_diagnosis(self, message):
        if self._diagnosis is not None:
            self._diagnosis['document'] = json.loads(message.data)
            self._look()

    # --- what is waited for -------------------------------------------------------------------

    async def _ask(self, client, request=None, effect=lambda: False):
        """Answer of a service; None if it was lost but `effect` shows that it was executed.

        Raises
        ------
        CallRefused
            Nobody offers it.
        """
        question = ServiceCall(client, self._look, effect, patient=True, request=request)
        limit = self.value('give_up_s')
        await self._until(lambda: question.over() or question.away > limit)
        if not question.over():
            raise CallRefused(f'nobody has offered {client.srv_name} for {limit:g} s')
        return question.answer

    async def _until(self, condition, seconds=math.inf):
        """Wait for a condition, at most so long; return whether it holds."""
        future = Future()
        self._waits.append((condition, time.monotonic() + seconds, future))
        self._look()
        return await future

    def _look(self):
        now = time.monotonic()
        if self._observer.get_publisher_count():
            self._observer_seen = now
        self._offer()
        waits, self._waits = self._waits, []
        for condition, end, future in waits:
            holds = condition()
            if holds or now >= end:
                future.set_result(holds)
            else:
                self._waits.append((condition, end, future))

    def waiting_for(self):
        """Includes actions whose services are missing."""
        return super().waiting_for() + [
            f'{offer.asks.srv_name}, to offer the action {name}'
            for name, offer in self._offers.items() if name not in self._servers]

    def finish(self):
        """Withdraw the actions."""
        for server in self._servers.values():
            server.destroy()
