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

"""What is said of the causes of an effect: which, in what order, what to look at."""

from types import SimpleNamespace

import numpy as np
from documents import CAUSES, causes_of, contended, document

from calibration.report.cause_wording import (
    alternatives_sentence,
    causes_sentence,
    first_check,
    open_causes,
)
from calibration.report.effect_wording import effect_title
from pointing_model.effects import effect
from pointing_model.effects.base import coefficient_word, common_shape
from pointing_model.mount_kinds import KINDS


def test_causes_are_equals_and_the_best_is_first():
    assert [one['effects'] for one in CAUSES] == [['second_flexure'], ['elevation_encoder_2']]
    assert CAUSES[0]['delta_bic'] == 20.1


def test_no_cause_is_an_alternative_for_itself():
    # with a memory of 10 degrees or at once, people are told one cause
    one = [effect('hysteresis', axis='az', shape='cosE', memory_deg=m) for m in (10.0, 0.0)]
    told = causes_of(one, [20.0, 19.0])
    assert len(told) == 1 and len(told[0]['effects']) == 2
    other = effect('hysteresis', axis='az', shape='1', memory_deg=10.0)
    assert len(causes_of([*one, other], [20.0, 19.0, 18.0])) == 2


def test_what_is_seen_is_what_all_causes_share():
    nod, wobble = effect('nod', order=1), effect('bearing_wobble', order=1)
    assert common_shape([nod.shape, wobble.shape], ['azimuth']) == \
        'a wave of the azimuth, once per turn'
    assert common_shape([nod.shape, 'a rise'], ['azimuth']) == 'a curve of the azimuth'
    # a curve of one angle is a hypothesis where causes follow others
    assert common_shape(['a', 'b', 'c'], ['elevation', 'hour_angle', 'elevation']) == \
        'a curve of the elevation or of the hour angle'
    assert common_shape(['a', 'b', 'c'], ['elevation', 'hour_angle', 'time']) == \
        'a curve of the elevation, of the hour angle or of time'
    saw = effect('smooth', axis='el', driver='elevation', shape='sawtooth', start=0.0,
                 period=np.radians(15.2))
    assert saw.shape == 'a sawtooth of the elevation with a period of 15.2°'
    assert coefficient_word(saw, 's1') == 'height of a tooth'

    def wave(order):
        return effect('smooth', axis='el', driver='elevation', shape='fourier', orders=[order],
                      period=2.0 * np.pi).shape
    # one of the periods that are tried; of a long one no second wave is seen
    assert wave(2.5) == 'a smooth curve of the elevation'
    assert wave(12) == 'a wave of the elevation with a period of about 30.0°'


def test_an_effect_acts_where_its_causes_act():
    flexure = effect('terms', name='declination_axis_flexure', mount='german')
    slope = effect('polynomial', result='az', of='az', power=1, mount='german')
    wobble = effect('bearing_wobble', order=1, mount='german')

    def seen(*effects):
        found = SimpleNamespace(fitted=SimpleNamespace(effect=effects[0]),
                                causes=causes_of(list(effects), [9.0] * len(effects)))
        return effect_title(found, KINDS['german'].axes)
    assert seen(flexure, slope) == 'hour angle error: curve vs elevation or hour angle'
    assert seen(flexure, wobble).startswith('both axes: curve vs ')


def test_a_cause_that_takes_more_effects_is_the_last_and_is_not_checked_first():
    easy = {'cause': 'scale', 'effects': ['scale'], 'look_at': 'the scale', 'effort': 0,
            'more_effects': 3, 'delta_bic': 20.0}
    row = {'name': 'elevation_encoder_2', 'causes': [*CAUSES[1:], easy]}
    told = causes_sentence(row['causes'])
    assert told.endswith(') Scale (needs three other effects with it).')
    said = first_check({}, row)
    assert said.startswith(f'Check first: {CAUSES[1]["look_at"]}.')
    assert 'the other needs other effects with it' in said


def test_the_cheapest_check_is_advice():
    told = document(CAUSES, unphysical=[{'name': 'TF'}])
    row = {**told['effects'][0], 'axes': 'el', 'driver': 'elevation'}
    text = first_check(told, row)
    assert text.startswith('It has the same curve as TF (above): check that first. Then: ')
    assert text.endswith(': visual inspection, no disassembly; the other takes more effort. The '
                         'data cannot distinguish the causes.')
    assert first_check(document(CAUSES), row).startswith('Check first: bolts')
    equal = causes_of([effect('nod', order=1), effect('bearing_wobble', order=1)], [9.0, 8.0])
    text = first_check(document(equal), {'name': 'elevation_nod_1', 'causes': equal})
    assert text.startswith('Check first: wheels') and 'the other takes as much effort' in text
    assert first_check(told, {'name': 'smooth_of_x', 'causes': equal[:1]}).endswith(
        'valid within these rows only.')
    assert first_check(told, {'name': 'a', 'alternatives': ['b']}) == ''


def test_a_check_tests_all_causes_that_it_looks_at():
    mount = 'equatorial'
    four = causes_of([effect('nod', order=2, mount=mount), effect('nod', order=1, mount=mount),
                      effect('bearing_wobble', order=1, mount=mount),
                      effect('bearing_wobble', order=2, mount=mount)], [22.7, 19.5, 19.5, 18.3])
    text = first_check(document(four), {'name': 'declination_nod_2', 'causes': four})
    assert 'It tests causes 1 and 2: ' in text
    assert '; the others take more effort.' in text
    text = first_check(document(four[:2]), {'name': 'declination_nod_2', 'causes': four[:2]})
    assert 'other' not in text
    # where nothing goes over a pier, and what a polar axis carries
    assert 'fork, yoke or horseshoe' in text and 'counterweight' not in text
    german = effect('nod', order=1, mount='german')
    assert 'saddle and counterweight' in german.look_at
    assert 'horseshoe ring' in effect('encoder', axis='az', order=2, mount=mount).cause_summary
    assert 'horseshoe' not in effect('encoder', axis='az', order=2, mount='german').cause_summary
    assert 'horseshoe' not in effect('encoder', axis='el', order=2, mount=mount).cause_summary


def test_what_contends_with_an_effect_is_named_and_why_it_lost():
    row = contended()
    told = document([], mount='equatorial')
    text = alternatives_sentence(row, row['causes'][0]['cause'])
    assert 'Line of sight swings is not excluded: alone it fits as well (ΔBIC 111, against ' \
        '110) and it was chosen instead in 50 of 150 resamples. ' in text
    assert text.endswith('But with all effects in the model its ΔBIC is 45 worse.')
    assert open_causes(row) == 2
    assert ('For "line of sight swings": flexure of what turns with the polar axis'
            ) in first_check(told, row)
    closed = contended(open=False, instead=0)
    assert open_causes(closed) == 1 and 'swings' not in first_check(told, closed)
    assert alternatives_sentence(closed, '').startswith(
        'Line of sight swings fits worse: alone')
    assert alternatives_sentence({'contenders': []}, '') == ''


def test_a_german_mount_has_no_fork():
    for one in (effect('terms', name='fork_flexure', mount='german'),
                effect('fork_cross_term', mount='german'), effect('nod', order=1, mount='german'),
                effect('line_of_sight', order=1, mount='german')):
        text = f'{one.cause} {one.cause_summary} {one.look_at} {one.clause(None)} {one.shape}'
        assert 'fork' not in text.lower() and 'saddle' in text.lower()
    assert 'fork or saddle' in effect('terms', name='fork_flexure', mount='equatorial').cause
