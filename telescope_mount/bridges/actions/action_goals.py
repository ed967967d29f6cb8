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

"""Goals of actions, and the fields of their feedback and results; without ROS.

The fields are those of the interface files in `msg_tools/telescope_mount_msgs`.
"""

import math

from msg_tools.status_rows import Progress
from msg_tools.units import ARCSEC

from ...observing.plan import VERBS, PlanStep, check_verb, goal_uuid

_MINUTE, _HOUR = 60.0, 3600.0
#: states: goals from the first on have ended; cancelled; failed
_SUCCEEDED, _CANCELLED, _FAILED = 4, 5, 6


def plan_step(step):
    """Convert a typed step to a step of a plan.

    Parameters
    ----------
    step
        Has the fields of PlanStep.msg: ``verb``, ``count``, ``error`` (rad), ``duration`` (s),
        ``names``.

    Returns
    -------
    PlanStep
        Its text may still be refused by `parse_plan`.

    Raises
    ------
    ValueError
        An unknown verb, an argument that it does not take, or a duration that plans cannot express.
    """
    verb = step.verb
    check_verb(verb)
    for name in ('count', 'error', 'duration', 'names'):
        if name not in VERBS[verb].takes and getattr(step, name):
            raise ValueError(f'plan step {verb}: it takes no {name}')
    if verb == 'track':
        return PlanStep(verb, _whole(step, _MINUTE), f'{step.error / ARCSEC:g}arcsec')
    if verb == 'wait':
        return PlanStep(verb, _whole(step, _HOUR))
    hours = f'{step.duration / _HOUR:g}h' if step.duration else ''
    return PlanStep(verb, step.count, hours or ' '.join(step.names))


def _whole(step, unit):
    """Duration of a step in multiples of `unit` (s)."""
    count = step.duration / unit
    if not (math.isfinite(count) and count == round(count)):
        raise ValueError(f'plan step {step.verb}: a duration of {step.duration:g} s is no '
                         f'multiple of {unit:g} s')
    return round(count)


class GoalPlan:
    """Follows the plan of a goal by the observer's messages.

    Parameters
    ----------
    plan : str
    before : bytes or None
        Id of the last goal on `observer/plan/status` before the request.

    Attributes
    ----------
    begun : bool
        Whether the observer has started it.
    replaced : bool
        Whether the observer has replaced it by another plan.
    known : bool
        Whether anything has been published about it.
    fields : dict
        Fields of PlanProgress.msg.
    """

    def __init__(self, plan, before):
        self.plan, self._before = plan, before
        self.begun = self.replaced = self.known = False
        self.fields, self._state = _fields(Progress(), 0, ''), 0

    def take_goal(self, number, stamp, state):
        """Take a goal on `observer/plan/status`: its UUID (bytes), stamp (int, ns), and state."""
        if number == self._before:
            return
        if number == goal_uuid(stamp, self.plan).bytes:  # even if the observer was restarted
            self.begun, self._state = True, state
        elif self.begun:
            self.replaced = True

    def take_progress(self, progress, state, text):
        """Take `observer/status`: a `Progress`, the number of its state, and the sentence.

        Raises
        ------
        ValueError
            A number does not fit its field.
        """
        if progress.plan == self.plan:
            self.known, self.fields = True, _fields(progress, state, text)

    @property
    def over(self):
        """Whether it has ended with a known result."""
        ended = self.begun and self._state >= _SUCCEEDED and self.fields['state'] == self._state
        return ended or self.replaced

    def end(self, cancelled, silence):
        """Method of the goal's handle by which it ends; afterwards `fields` are the result.

        Parameters
        ----------
        cancelled : bool
            Whether the goal was asked to cancel: plans cancelled by others are aborted.
        silence : str
            Message if the plan has not ended and its progress is unknown.
        """
        if self.replaced or not self.over:
            self.fields |= {'state': _FAILED, 'message': (
                'another plan has taken its place' if self.replaced else silence)}
            return 'abort'
        if self._state == _CANCELLED and cancelled:
            return 'canceled'
        return 'succeed' if self._state == _SUCCEEDED else 'abort'


def _fields(progress, state, text):
    rows = progress.rows() | {'steps': progress.steps}
    del rows['plan']
    return counted(rows) | {'state': state, 'message': text}


def counted(fields):
    """Return `fields`; ValueError if a number does not fit its type, which ends a process."""
    for name, value in fields.items():
        low, high = (-2**31, 2**31) if name == 'run' else (0, 2**32)
        if isinstance(value, int) and not low <= value < high:
            raise ValueError(f'{name} = {value}: no count')
    return fields


def diagnosis_fields(document, message):
    """Fields of the result of Diagnose.action.

    Parameters
    ----------
    document : dict
        Document on `diagnosis`.
    message : str
        Result in words.

    Returns
    -------
    dict
        ``effects`` contains dicts with the fields of Effect.msg.

    Raises
    ------
    ValueError
        Not such a document.
    """
    try:
        before, after = document['before'], document['after']
        return {
            'verdict': document['verdict'], 'published': document['published'],
            'effects': [_effect_fields(effect) for effect in document['effects']],
            'rms_before': _rad(before['rms_arcsec']), 'rms_after': _rad(after['rms_arcsec']),
            'validated_rms_before': _rad(before['cv_rms_arcsec']),
            'validated_rms_after': _rad(after['cv_rms_arcsec']), 'message': message}
    except (KeyError, TypeError, AttributeError) as err:
        raise ValueError(f'no document of a diagnosis: {err}') from None


def _effect_fields(effect):
    values, chance = effect['coefficients_arcsec'], effect['p_family']
    return {'name': effect['name'], 'driver': effect['driver'] or '', 'coefficients': list(values),
            'values': [_rad(value) for value in values.values()],
            'sigmas': [_rad(effect['sigma_arcsec'][name]) for name in values],
            'chance': math.nan if chance is None else float(chance),
            'removed_rms': _rad(effect['removes_rms_arcsec'])}


def _rad(arcsec):
    return math.nan if arcsec is None else float(arcsec) * ARCSEC
