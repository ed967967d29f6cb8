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

"""Goals of actions as plans, and what becomes of them as fields; without ROS."""

import math
from types import SimpleNamespace

import pytest

from msg_tools.status_rows import Progress, Stage
from msg_tools.units import ARCSEC
from telescope_mount.bridges.actions.action_goals import GoalPlan, diagnosis_fields, plan_step
from telescope_mount.observing.plan import VERBS, goal_uuid, parse_plan

WAITS, RUNS, DONE, CANCELLED, FAILED = 1, 2, 4, 5, 6
PLAN = 'home, stars 2'


def step(verb, **given):
    return SimpleNamespace(**{'verb': verb, 'count': 0, 'error': 0.0, 'duration': 0.0,
                              'names': []} | given)


@pytest.mark.parametrize(('given', 'text'), [
    (step('home'), 'home'), (step('stars', count=20), 'stars 20'),
    (step('power_cycle', names=['both']), 'power_cycle both'), (step('power_cycle'), 'power_cycle'),
    (step('track', error=1.5 * ARCSEC, duration=5400.0), 'track 1.5arcsec 90'),
    (step('track', error=2 * ARCSEC), 'track 2arcsec 60'),
    (step('tell_apart', count=15, duration=7200.0), 'tell_apart 15 2h'),
    (step('tell_apart', count=15), 'tell_apart 15'),
    (step('wait', duration=3600.0 * 3), 'wait 3'),
    (step('pass', names=['L52', 'lageos2.sp3']), 'pass L52 lageos2.sp3')])
def test_a_typed_step_is_one_of_a_plan(given, text):
    assert [str(one) for one in parse_plan(str(plan_step(given)))] == [text]


def test_each_verb_can_be_typed():
    arguments = {'track': {'error': 1e-5}, 'wait': {'duration': 3600.0},
                 'pass': {'names': ['a', 'b']}, 'power_cycle': {}}
    for verb, of in VERBS.items():
        given = arguments.get(verb, {'count': 3} if 'count' in of.takes else {})
        assert parse_plan(str(plan_step(step(verb, **given))))[0].verb == verb


@pytest.mark.parametrize(('given', 'why'), [
    (step('dance'), "'dance' is unknown"), (step(''), 'is unknown'),
    (step('home', count=2), 'it takes no count'), (step('stars', count=2, error=1e-5), 'no error'),
    (step('stars', count=2, names=['polaris']), 'no names'),
    (step('wait', duration=5000.0), '5000 s is no multiple of 3600 s'),
    (step('wait', duration=math.nan), 'no multiple'),
    (step('track', error=1e-5, duration=90.0), 'no multiple of 60 s')])
def test_other_arguments_are_refused(given, why):
    with pytest.raises(ValueError, match=why):
        plan_step(given)


@pytest.mark.parametrize('given', [
    step('stars'), step('track', error=math.nan), step('track', error=-1e-5),
    step('pass', names=['a']), step('power_cycle', names=['all']),
    step('tell_apart', count=2, duration=-3600.0)])
def test_what_is_no_step_the_plan_refuses(given):
    with pytest.raises(ValueError, match=f'plan step .{given.verb}.*: write {given.verb}'):
        parse_plan(str(plan_step(given)))


def follow(*events, plan=PLAN, before=None):
    """A `GoalPlan` after goals (stamp, state) and progress (state, text) of its plan."""
    goal = GoalPlan(plan, before)
    for stamp, value in events:
        if isinstance(value, str):
            goal.take_progress(Progress(plan=plan, run=3, step='stars 2', block=1), stamp, value)
        else:
            goal.take_goal(goal_uuid(stamp, plan).bytes, stamp, value)
    return goal


def test_a_plan_that_is_done():
    goal = follow((RUNS, 'stars 2'), (10, RUNS))
    assert goal.begun and goal.known and not goal.over
    goal.take_goal(goal_uuid(10, PLAN).bytes, 10, DONE)
    assert not goal.over  # how is not known yet
    goal.take_progress(Progress(plan=PLAN, run=3, observations=2), DONE, 'plan finished')
    assert goal.over and goal.end(False, '') == 'succeed'
    assert goal.fields == {
        'state': DONE, 'message': 'plan finished', 'step': '', 'block': 0, 'steps': 2, 'done': 0,
        'total': 0, 'observations': 2, 'run': 3, 'lost': 0, 'refused': 0, 'forgotten': 0}


def test_the_same_plan_before_is_another_goal():
    old = goal_uuid(10, PLAN).bytes
    assert not follow((DONE, 'plan finished'), (10, DONE), before=old).begun
    assert follow((DONE, 'plan finished'), (10, DONE), (20, RUNS), before=old).begun


@pytest.mark.parametrize(('state', 'asked', 'end'), [
    (DONE, False, 'succeed'), (DONE, True, 'succeed'), (FAILED, False, 'abort'),
    (FAILED, True, 'abort'), (CANCELLED, True, 'canceled'),
    (CANCELLED, False, 'abort')])  # by another: an action ends so only where its client asked
def test_how_a_goal_ends(state, asked, end):
    goal = follow((10, RUNS), (state, 'why'), (10, state))
    assert goal.end(asked, '') == end and goal.fields['message'] == 'why'


def test_an_observer_that_was_restarted_goes_on_with_it():
    assert follow((10, RUNS), (20, RUNS), (DONE, 'plan finished'), (20, DONE)).over


@pytest.mark.parametrize('wrong', [{'done': -1}, {'total': 2**32}, {'run': 2**31}])
def test_what_no_field_holds_is_refused(wrong):
    with pytest.raises(ValueError, match='no count'):
        GoalPlan(PLAN, None).take_progress(Progress(plan=PLAN, **wrong), RUNS, '')
    GoalPlan(PLAN, None).take_progress(Progress(plan=PLAN, run=-3), RUNS, '')


def test_another_plan_or_silence_is_an_end():
    goal = follow((10, RUNS), (RUNS, 'stars 2'))
    assert goal.end(False, 'no star observer for 30 s') == 'abort'
    assert goal.fields['message'] == 'no star observer for 30 s'
    goal.take_progress(Progress(plan='fit'), RUNS, 'fit')
    goal.take_goal(goal_uuid(20, 'fit').bytes, 20, RUNS)
    assert goal.over and goal.end(True, '') == 'abort'
    assert goal.fields['message'] == 'another plan has taken its place'
    assert (goal.fields['state'], goal.fields['run']) == (FAILED, 3)


def document(**changes):
    rms = {'rms_arcsec': 2.0, 'cv_rms_arcsec': None}
    return {'verdict': 'identified', 'published': True, 'before': rms,
            'after': rms | {'rms_arcsec': 1.0, 'cv_rms_arcsec': 1.5}, 'effects': [{
                'name': 'flexure', 'driver': None, 'coefficients_arcsec': {'c': 3.0},
                'sigma_arcsec': {'c': 0.5}, 'p_family': 0.001, 'removes_rms_arcsec': None}]
            } | changes


def test_fields_of_a_diagnosis():
    fields = diagnosis_fields(document(), 'found')
    assert (fields['verdict'], fields['published'], fields['message']) == (
        'identified', True, 'found')
    assert fields['rms_before'] == pytest.approx(2.0 * ARCSEC)
    assert fields['validated_rms_after'] == pytest.approx(1.5 * ARCSEC)
    assert math.isnan(fields['validated_rms_before'])
    effect, = fields['effects']
    assert (effect['name'], effect['driver'], effect['coefficients']) == ('flexure', '', ['c'])
    assert effect['values'] == pytest.approx([3.0 * ARCSEC])
    assert effect['sigmas'] == pytest.approx([0.5 * ARCSEC])
    assert effect['chance'] == 0.001 and math.isnan(effect['removed_rms'])


@pytest.mark.parametrize('wrong', [
    [], {}, document(before=None), document(effects=[{}]), document(effects=7)])
def test_what_is_no_diagnosis_is_refused(wrong):
    with pytest.raises(ValueError, match='no document of a diagnosis'):
        diagnosis_fields(wrong, '')


def test_how_far_a_diagnosis_is():
    def status(**rows):
        return SimpleNamespace(values=[SimpleNamespace(key=key, value=str(value))
                                       for key, value in rows.items()])
    stage = Stage('cross-validation', 3, 20)
    assert Stage.read(status(**stage._asdict())) == stage
    assert str(stage) == 'cross-validation, 3 of 20' and str(Stage('looking')) == 'looking'
    assert Stage.read(status(observations=3)) is None
    with pytest.raises(ValueError):
        Stage.read(status(stage='looking', done='many', total=1))
