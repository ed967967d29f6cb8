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

"""Stars for a zero, and whether Polaris does as well."""


import numpy as np
import pytest
from bench import START, Bench

from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.pointing_terms import design
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE, Site
from pointing_model.sky.star_catalogue import POLARIS_HIP, load_catalogue
from pointing_model.zero import MARK
from telescope_mount.observing.star_choice import ANYWHERE, axes_at
from telescope_mount.observing.zero_method import way_to_zero
from telescope_mount.observing.zero_stars import Before, choose_places, zero_sigma, zero_stars

TIME = START * 1e-9
STARS = load_catalogue(mag_limit=7.0)


def field(n=400, seed=0, mount=ALTAZ):
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    return axes_at(mount, az, el, ANYWHERE, np.arange(n))


def model_of(mount=ALTAZ):
    """With the covariance that 30 stars of 1 arcsec give it."""
    columns = np.concatenate(design(mount.names.physical, *field(30, 5, mount), mount))
    return PointingModel(dict.fromkeys(mount.names.physical, 0.0),
                         np.linalg.inv(columns.T @ columns) * ARCSEC**2, mount=mount)


def polaris(model, latitude=34.3):
    return zero_sigma(np.zeros(16), np.full(16, latitude * DEG), model=model)


@pytest.mark.parametrize('latitude', [-80, -40, 0, 40, 80])
def test_sixteen_exposures_are_as_good_as_those_of_polaris_at_34_degrees(latitude):
    model = model_of()
    chosen = zero_stars(STARS, TIME, 16, site=Site(latitude * DEG, 0.5, 0.0), model=model,
                        duration=640.0)
    assert np.all(chosen.sigma < 1.3 * polaris(model))
    assert chosen.counts.sum() == 16 and 4 <= len(chosen.rows) <= 8 and chosen.counts.min() >= 2
    assert POLARIS_HIP not in STARS.hip[chosen.rows]
    az, el = observed_place(STARS.select(chosen.rows), TIME, Site(latitude * DEG, 0.5, 0.0),
                            DEFAULT_WEATHER)
    assert np.all((el > 19.9 * DEG) & (el < 85.1 * DEG))


@pytest.mark.parametrize('mount', [ALTAZ, Mount.equatorial(31.0 * DEG),
                                   Mount.equatorial(-31.0 * DEG, 'german')],
                         ids=['altaz', 'fork', 'german'])
def test_no_choice_at_random_is_better(mount):
    model, (az, el) = model_of(mount), field(mount=mount)
    chosen = choose_places(az, el, 16, model=model)
    product = np.prod(chosen.sigma)
    rng = np.random.default_rng(1)
    for _ in range(300):
        rows = rng.choice(len(az), len(chosen.rows), replace=False)
        at = np.repeat(rows, chosen.counts)
        assert np.prod(zero_sigma(az[at], el[at], model=model)) > product
    at = np.repeat(chosen.rows, chosen.counts)
    np.testing.assert_allclose(zero_sigma(az[at], el[at], model=model), chosen.sigma, rtol=1e-6)


def test_without_a_model_the_stars_of_the_power_on_before_are_taken_again():
    first = zero_stars(STARS, TIME, 16, duration=2400.0)
    az, el = observed_place(STARS.select(np.repeat(first.rows, first.counts)), TIME, DEFAULT_SITE,
                            DEFAULT_WEATHER)
    before = Before(az, el, np.zeros(16, bool))
    again = zero_stars(STARS, TIME + 600.0, 16, duration=640.0, before=before,
                       prefer=STARS.hip[first.rows].tolist())
    assert set(again.rows) >= set(first.rows)
    # what is held cancels: the change is better known than the zero
    assert again.sigma[0] < 0.4 * first.sigma[0]


def test_few_exposures_and_few_stars():
    model = model_of()
    for n, most in ((1, 1), (2, 1), (4, 2), (7, 3)):
        chosen = choose_places(*field(), n, model=model)
        assert chosen.counts.sum() == n and len(chosen.rows) <= most
    one = choose_places(np.array([1.0]), np.array([0.7]), 16, model=model)
    assert one.rows.tolist() == [0] and one.counts.tolist() == [16]
    with pytest.raises(ValueError, match='no star visible .* to set the zero by: widen the limits'):
        zero_stars(STARS, TIME, 16, min_el=84.0 * DEG, max_el=84.01 * DEG)


def test_polaris_is_of_no_use_to_an_equatorial_mount_and_to_one_near_the_pole():
    limits = {'lowest': 20.0 * DEG, 'highest': 85.0 * DEG}
    stars = np.array([0.5, 0.4]) * ARCSEC

    def way(own, *heights):
        return way_to_zero((np.array(heights) * DEG, own), stars, **limits)
    assert way(1.2 * stars, 34.0, 34.3).polaris
    assert 'well up' in way(1.2 * stars, 34.0, 34.3).why
    low = way(1.2 * stars, 19.9, 20.3)
    assert not low.polaris and 'Polaris stands at 19.9 deg' in low.why
    fork = Mount.equatorial(34.3 * DEG)
    own = zero_sigma(np.full(16, 0.3), np.full(16, 89.37 * DEG), mount=fork, held=False)
    assert own[0] > 20.0 * ARCSEC  # 1 / cos(declination)
    assert not way(own, 34.0, 34.3).polaris
    high = polaris(model_of(), 75.0)
    assert not way(high, 74.0, 75.0).polaris
    assert way_to_zero((np.array([34.0]) * DEG, own), None, **limits).polaris


# --- in a plan ----------------------------------------------------------------------------------


def test_the_plan_exposes_stars_for_the_zero_and_marks_them():
    bench = Bench('stars 2, zero_on_stars 8, stars 2')
    bench.site = Site(-30.0 * DEG, 0.5, 0.0)
    assert bench.run() == ('done', 'plan finished')
    marks = [row[MARK][0] for row in bench.rows]
    assert marks == [0.0] * 2 + [1.0] * 8 + [0.0] * 2
    stars = [int(row['star'][0]) for row in bench.rows]
    assert POLARIS_HIP not in stars
    # what judges fits is no star of the zero
    assert not set(stars[2:10]) & {*stars[:2], *stars[10:]}
    # in groups: no star is slewed to twice
    assert sum(a != b for a, b in zip(stars[2:10], stars[3:10])) == len(set(stars[2:10])) - 1
    np.testing.assert_array_equal(bench.tables[-1][MARK], marks)
    said = [p.step for p, _ in bench.statuses]
    assert any(step == f'zero_on_stars 8: stars ({len(set(stars[2:10]))})' for step in said)


@pytest.mark.parametrize('latitude, polaris', [(34.3, True), (-30.0, False), (10.0, False)])
def test_a_zero_is_by_polaris_where_it_is_well_up(latitude, polaris):
    bench = Bench('zero 4')
    bench.site = Site(latitude * DEG, 0.5, 0.0)
    assert bench.run() == ('done', 'plan finished')
    assert [row['star'][0] == POLARIS_HIP for row in bench.rows] == [polaris] * 4
    assert [row[MARK][0] for row in bench.rows] == [float(not polaris)] * 4


def test_the_second_power_on_has_the_same_stars():
    bench = Bench('home, zero 8, power_cycle, home, zero 8', homed=False)
    bench.site = Site(-30.0 * DEG, 0.5, 0.0)

    def power_cycle():
        bench.error = np.full(2, np.nan)
        bench.read(bench.stamp + 10**9, bench.position)
    bench.homes()
    bench.offers('power_cycle', power_cycle)
    assert bench.run() == ('done', 'plan finished')
    stars = [{row['star'][0] for row in bench.rows if row['run'][0] == run} for run in (1, 2)]
    assert stars[0] == stars[1] and len(bench.rows) == 16


def test_no_star_in_the_field_ends_the_plan_before_the_zero():
    bench = Bench('zero_on_stars 2, calibrate_zero')
    bench.offers('calibrate_zero')
    bench.miss = lambda number: (np.nan, np.nan)
    assert bench.run() == ('failed', 'none of 2 exposures shows a star for the zero: look at sky, '
                           'site and time')
    assert bench.calls == []


def test_exposures_of_one_power_on_go_the_same_way():
    bench = Bench('zero_on_stars 4, zero 4')  # Polaris is well up
    assert bench.run() == ('done', 'plan finished')
    assert [row[MARK][0] for row in bench.rows] == [1.0] * 8


def test_a_star_that_is_not_there_leaves_its_exposures_to_the_others():
    bench = Bench('zero_on_stars 8')
    bench.miss = lambda number: (
        np.nan if number <= 3 else 1e-6 * ARCSEC * number, 0.0)
    assert bench.run() == ('done', 'plan finished')
    stars = [row['star'][0] for row in bench.rows]
    assert len(stars) == 7 and bench.plan.progress.lost == 1 and bench.plan.progress.done == 8
    assert sum(a != b for a, b in zip(stars, stars[1:])) == len(set(stars)) - 1 >= 2
