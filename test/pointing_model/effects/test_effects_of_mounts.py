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

"""One dictionary for every mount: what an axis does, what gravity does, what differs by side."""

import numpy as np
import pytest

from msg_tools.units import DEG
from pointing_model.context import Context
from pointing_model.effects import (
    dictionary,
    effect,
    effect_from_document,
    smooths,
    steps,
    to_document,
)
from pointing_model.mounts import ALTAZ, Mount, is_beyond, through_pole

GERMAN = Mount.equatorial(31.0 * DEG, 'german')


def context(mount=GERMAN, sides=2, n=60, **columns):
    rng = np.random.default_rng(1)
    az, el = rng.uniform(0.0, 6.0, n), rng.uniform(0.4, 1.4, n)
    first, second = mount.axes_of(az, el)
    if sides == 2:
        first, second = through_pole(first, second, np.arange(n) % 2 == 0)
    given = {'time': 1.7e9 + 60.0 * np.arange(n), 'temperature': np.linspace(10.0, 5.0, n),
             'approach_az': np.sign(rng.normal(size=n)), 'approach_el': np.sign(
                 rng.normal(size=n))}
    return Context(first, second, {**given, **columns}, latitude=31.0 * DEG, mount=mount)


def by_name(mount=GERMAN, **options):
    return {e.name: e for e in dictionary(context(mount, **options))[0]}


def test_axes_go_by_the_names_of_the_mount():
    effects = by_name()
    for name in ('hour_angle_encoder_1', 'declination_encoder_2', 'hour_angle_bearing_wobble_1',
                 'declination_nod_3', 'line_of_sight_1', 'declination_axis_wobble_1',
                 'hour_angle_hysteresis', 'hour_angle_zero_with_time', 'refraction',
                 'second_flexure', 'fork_flexure', 'declination_axis_flexure',
                 'hour_angle_grows_with_hour_angle'):
        assert name in effects, name
    words = ' '.join(e.name + e.cause for e in effects.values())
    assert 'azimuth' not in words and 'elevation' not in words


@pytest.mark.parametrize('mount', [ALTAZ, GERMAN, Mount.equatorial(31.0 * DEG)])
def test_an_effect_says_on_which_axes_it_acts(mount):
    c = context(mount, sides=2 if mount is GERMAN else 1)
    for e in [*dictionary(c)[0], *smooths(c)[:20], *steps(c)[:4]]:
        acts = np.abs(e.columns(c)).max(axis=(0, 2)) > 1e-12
        if acts.any():  # a short memory has nothing to show without short moves
            assert e.axes == ('both' if acts.all() else ('az', 'el')[int(acts[1])]), e.name


def test_nothing_is_a_candidate_twice_by_the_side_of_the_pier():
    c = context()
    sided = [e for e in dictionary(c)[0] if e.form == 'by_side']
    assert 'IH_by_side' in {e.name for e in sided}
    assert not any('clock' in e.name or 'latitude' in e.name for e in sided)


def test_tpoint_names_are_those_of_the_catalogue():
    effects = by_name()
    assert effects['hour_angle_encoder_1'].tpoint == 'HCEC HCES'
    assert effects['declination_encoder_1'].tpoint == 'DCEC DCES'
    assert effects['hour_angle_encoder_3'].tpoint == 'HHCH3 HHSH3'
    assert effects['line_of_sight_2'].tpoint == 'HXCH2 HXSH2'
    assert effects['hour_angle_bearing_wobble_2'].tpoint == 'HDCH2 HDSH2 HPCH2 HPSH2'
    assert effects['fork_flexure'].tpoint == 'FO'
    assert effects['declination_axis_flexure'].tpoint == 'DAF'
    assert effects['declination_grows_with_declination_squared'].tpoint == 'PDD2'
    assert effects['hour_angle_on_sky_grows_with_hour_angle'].tpoint == 'PXH'


def test_documents_bring_every_effect_back():
    c = context()
    for e in [*dictionary(c)[0], *smooths(c)[:20], *steps(c)[:4]]:
        back = effect_from_document(to_document(e))
        assert back.name == e.name
        np.testing.assert_array_equal(back.columns(c), e.columns(c))


def test_nothing_of_an_altaz_mount_is_written_down_otherwise():
    e = effect('encoder', axis='az', order=2, mount='altaz')
    assert to_document(e) == {'family': 'encoder', 'parameters': {'axis': 'az', 'order': 2}}
    for one in dictionary(context(ALTAZ, sides=1))[0]:
        assert 'mount' not in one.parameters and 'by_side' not in one.name


def test_each_effect_of_the_direction_also_differs_by_side():
    effects = by_name()
    c = context()
    side = np.where(is_beyond(c.el), -1.0, 1.0)
    for name in ('fork_flexure', 'declination_encoder_1', 'ID', 'CH', 'NP', 'TF', 'refraction'):
        sided = effects[f'{name}_by_side']
        whole = effect_from_document(sided.parameters['of'])
        np.testing.assert_allclose(sided.columns(c), whole.columns(c) * side)
    assert 'hour_angle_zero_with_time_by_side' not in effects


def test_a_counterweight_pulls_the_other_way_below_the_pole():
    # looking west: high, then below the pole; looking east through the pole: the same
    first, second = through_pole(np.array([30.0, 150.0, -30.0, -150.0]) * DEG,
                                 np.array([40.0, 80.0, 40.0, 80.0]) * DEG,
                                 np.array([False, False, True, True]))
    c = Context(first, second, mount=GERMAN)
    effects = by_name()
    whole = effect('term', name='ME', mount='german').columns(c)
    for how, pull in (('by', [1.0, -1.0, -1.0, 1.0]), ('with', np.cos(first))):
        leaning = effects[f'ME_{how}_counterweight']
        np.testing.assert_allclose(leaning.columns(c), whole * pull)
    assert not any('counterweight' in name for name in by_name(Mount.equatorial(31.0 * DEG)))
    west = Context(c.az[[0] * 9], c.el[[0] * 9], mount=GERMAN)
    assert dict(dictionary(west)[1])['what changes with the counterweight'].endswith(
        'in nearly all rows')


def test_on_one_side_it_says_what_it_cannot_tell_from_it():
    effects, untestable = dictionary(context(sides=1))
    assert not any('by_side' in e.name for e in effects)
    reason = dict(untestable)['what differs by the side of the pier']
    assert 'ID, CH and NP' in reason and 'one side' in reason


def test_aliases_are_those_of_the_mount():
    clock = effect('clock', latitude=31.0 * DEG, mount='german')
    assert 'exactly IH' in clock.alias
    c = context()
    x, y = clock.columns(c)[0]
    np.testing.assert_allclose(np.abs(x), np.abs(np.cos(c.el)), atol=1e-12)
    np.testing.assert_allclose(y, 0.0, atol=1e-12)
    assert 'IA + AW' in effect('clock', latitude=31.0 * DEG).alias


def test_gravity_follows_the_zenith_and_an_axis_its_angle():
    c = context()
    tube = effect('terms', name='second_flexure', mount='german').columns(c)[0]
    t1, t2 = c.tangent()
    moved = tube[0] * t1 + tube[1] * t2
    el = c.get('elevation')
    np.testing.assert_allclose(moved[2], np.sin(el) * np.cos(el), atol=1e-12)
    disc = effect('encoder', axis='el', order=1, mount='german').columns(c)
    np.testing.assert_allclose(disc[1][1], np.sin(c.el), atol=1e-12)


def test_parts_are_single_coefficients():
    wobble = effect('bearing_wobble', order=2, mount='german')
    c = context()
    single = [effect('part', of=to_document(wobble), keep=[i])
              for i in range(len(wobble.coefficient_names))]
    assert [p.tpoint for p in single] == wobble.tpoint.split()
    np.testing.assert_array_equal(np.vstack([p.columns(c) for p in single]), wobble.columns(c))
    back = effect_from_document(to_document(single[1]))
    np.testing.assert_array_equal(back.columns(c), single[1].columns(c))


def test_rates_of_the_stars_are_sidereal_about_the_polar_axis():
    c = context()
    np.testing.assert_allclose(c.get('az_rate'), 2.0 * np.pi / 86164.0905, rtol=1e-9)
    np.testing.assert_allclose(c.get('el_rate'), 0.0, atol=1e-15)


def test_an_unknown_mount_is_one_line():
    with pytest.raises(ValueError, match='wrong parameters'):
        effect('encoder', axis='az', order=1, mount='dobson')
