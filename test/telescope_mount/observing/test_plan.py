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

from telescope_mount.observing.night_steps import NightSteps
from telescope_mount.observing.plan import POWER_CYCLES, VERBS, PlanStep, night_plan, parse_plan


def test_a_plan_in_order():
    assert parse_plan(' home, stars 30,polaris 16 ,fit,') == [
        PlanStep('home'), PlanStep('stars', 30), PlanStep('polaris', 16), PlanStep('fit')]


def test_text_and_back():
    for reference in (False, True):
        for cycle in POWER_CYCLES:
            text = night_plan(7, 3, reference, cycle)
            assert ', '.join(str(step) for step in parse_plan(text)) == text


def test_what_a_power_cycle_switches():
    assert parse_plan('power_cycle, power_cycle incremental, power_cycle absolute, '
                      'power_cycle both') == [
        PlanStep('power_cycle'), PlanStep('power_cycle'), PlanStep('power_cycle', what='absolute'),
        PlanStep('power_cycle', what='both')]
    # the absolute encoder needs no mark
    assert 'power_cycle absolute, zero 3' in night_plan(7, 3, cycle='absolute')
    assert 'power_cycle both, home' in night_plan(7, 3, cycle='both')


def test_every_verb_is_known_to_the_observer():
    for verb in VERBS:
        assert callable(getattr(NightSteps, f'_do_{verb}'))


@pytest.mark.parametrize('text, reason', [
    ('', 'empty'), (' , ,', 'empty'), ('hmoe', "'hmoe' is unknown; use home"),
    ('home 3', 'home takes no count'), ('stars', 'a count of 1 to 100000'),
    ('stars 0', 'a count'), ('stars -3', 'a count'), ('stars 3.5', 'a count'),
    ('power_cycle 2', 'power_cycle, alone or with one of incremental, absolute, both'),
    ('power_cycle both absolute', 'alone or with one of'),
    ('stars 3 4', 'a count'), ('stars 100001', 'a count'), ('stars ²', 'a count'),
])
def test_a_bad_plan_says_what_is_wrong(text, reason):
    with pytest.raises(ValueError, match=reason) as caught:
        parse_plan(text)
    assert '\n' not in str(caught.value)


def test_a_night_has_two_power_ons_unless_it_has_a_reference():
    verbs = [step.verb for step in parse_plan(night_plan(30, 16))]
    assert verbs == ['home', 'stars', 'zero', 'calibrate_zero', 'power_cycle', 'home',
                     'zero', 'calibrate_zero', 'stars', 'fit']
    verbs = [step.verb for step in parse_plan(night_plan(30, 16, reference=True))]
    assert verbs == ['home', 'stars', 'zero', 'calibrate_zero', 'stars', 'fit']
    assert [s.count for s in parse_plan(night_plan(5, 4)) if s.count] == [5, 4, 4, 5]
