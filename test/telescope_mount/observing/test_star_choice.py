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

"""Choice and order of the stars of a pointing run."""

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import Stars, load_catalogue
from telescope_mount.observing.star_choice import bright_stars, choose_stars, has_neighbour
from telescope_mount.observing.star_order import observing_order

TIME = 1.78e9
SEEDS = range(10)


@pytest.fixture(scope='module')
def plans():
    """Azimuth and elevation of 30 stars in observing order, for ten nights."""
    stars = load_catalogue(8.0)
    result = []
    for seed in SEEDS:
        time = TIME + 7000.0 * seed
        rows = choose_stars(stars, time, n=30, seed=seed)
        result.append(observed_place(stars.select(rows), time))
    return result


def _harmonics(az, el):
    z = np.pi / 2 - el
    return np.stack([np.cos(z) ** k for k in range(5)]
                    + [np.cos(az) * np.sin(z) * np.cos(z) ** k for k in range(4)]
                    + [np.sin(az) * np.sin(z) * np.cos(z) ** k for k in range(4)], axis=1)


def _slews(az, el):
    return np.maximum(np.abs(wrap(np.diff(az))), np.abs(np.diff(el))) / DEG


def _confusion(az, el):
    """Largest correlation of time, approach_az and approach_el with place and each other."""
    time = np.arange(1.0, len(az))
    drivers = [time, np.sign(wrap(np.diff(az))), np.sign(np.diff(el))]
    place = [np.sin(az)[1:], np.cos(az)[1:], np.sin(el)[1:]]
    c = np.abs(np.corrcoef(drivers + place))
    return max(c[:3, 3:].max(), c[0, 1], c[0, 2], c[1, 2])


def _draw(count, el=None):
    stars = load_catalogue(6.0)
    az, el = observed_place(stars, TIME)
    rows = np.flatnonzero((el > 20 * DEG) & (el < 85 * DEG))
    rng = np.random.default_rng(3)
    for _ in range(count):
        some = rng.permutation(rows)[:30]
        yield az[some], el[some]


def test_stars_are_bright_high_and_different():
    stars = load_catalogue(8.0)
    for seed in SEEDS[:3]:
        rows = choose_stars(stars, TIME, n=30, seed=seed, mag_limit=5.0)
        _, el = observed_place(stars.select(rows), TIME)
        assert len(set(rows.tolist())) == 30
        assert stars.mag[rows].max() <= 5.0
        assert el.min() >= 20 * DEG and el.max() <= 85 * DEG


def _largest_hole(az, el):
    """Distance from the loneliest direction between the limits to the next star, degrees."""
    grid_az, grid_sin = np.meshgrid(
        np.linspace(0, 2 * np.pi, 73), np.linspace(np.sin(20 * DEG), np.sin(85 * DEG), 21))
    g, s = ((np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e))
            for a, e in ((grid_az.ravel(), np.arcsin(grid_sin.ravel())), (az, el)))
    return np.arccos(np.clip(np.transpose(g) @ np.array(s), -1, 1)).min(axis=1).max() / DEG


def test_sky_is_covered_evenly(plans):
    holes = [_largest_hole(az, el) for az, el in plans]
    drawn = [_largest_hole(az, el) for az, el in _draw(50)]
    assert max(holes) < np.median(drawn)
    assert np.median(holes) < 0.8 * np.median(drawn)
    for az, _ in plans:
        assert np.histogram(az, np.linspace(0, 2 * np.pi, 5))[0].min() >= 5


def test_condition_of_the_harmonic_fit(plans):
    condition = [np.linalg.cond(_harmonics(az, el)) for az, el in plans]
    drawn = [np.linalg.cond(_harmonics(az, el)) for az, el in _draw(100)]
    assert max(condition) < 7200
    assert np.median(condition) < 0.7 * np.median(drawn)


def test_worst_prediction_of_the_harmonic_fit(plans):
    """What counts in the end: sigma of the fitted correction anywhere on the sky."""
    grid_az, grid_el = np.meshgrid(np.linspace(0, 2 * np.pi, 37), np.linspace(20, 85, 27) * DEG)
    grid = _harmonics(grid_az.ravel(), grid_el.ravel())

    def worst(az, el):
        return np.linalg.norm(grid @ np.linalg.pinv(_harmonics(az, el)), axis=1).max()

    assert max(worst(az, el) for az, el in plans) < 1.3
    assert np.median([worst(az, el) for az, el in _draw(50)]) > 2.0


def test_slews_are_short(plans):
    rng = np.random.default_rng(0)
    for az, el in plans:
        random = [_slews(az[p], el[p]).mean() for p in (rng.permutation(30) for _ in range(50))]
        assert _slews(az, el).mean() < 0.75 * np.mean(random)


def test_approaches_from_both_sides(plans):
    for az, el in plans:
        for sign in (np.sign(wrap(np.diff(az))), np.sign(np.diff(el))):
            assert 10 <= np.sum(sign > 0) <= 19
        # all four combinations
        both = 2 * (wrap(np.diff(az)) > 0) + (np.diff(el) > 0)
        assert np.bincount(both, minlength=4).min() >= 4


def test_time_place_and_approach_are_not_confused(plans):
    rng = np.random.default_rng(0)
    mine = [_confusion(az, el) for az, el in plans]
    random = [_confusion(az[p], el[p]) for az, el in plans for p in [rng.permutation(30)]]
    assert max(mine) < 0.35
    assert np.median(mine) < 0.4 * np.median(random)


def test_order_starts_near_the_mount():
    rng = np.random.default_rng(5)
    az, el = rng.uniform(0, 2 * np.pi, 40), rng.uniform(20, 80, 40) * DEG
    first = []
    for start in (10 * DEG, 190 * DEG):
        order = observing_order(az, el, np.random.default_rng(1), (start, 30 * DEG))
        assert sorted(order) == list(range(40))
        first.append(abs(wrap(az[order[0]] - start)) / DEG)
    assert np.mean(first) < 80


def test_same_seed_same_plan():
    stars = load_catalogue(6.0)
    plan = [choose_stars(stars, TIME, n=30, seed=s).tolist() for s in (4, 4, 5)]
    assert plan[0] == plan[1] != plan[2]


def test_excluded_stars_and_held_out_set():
    stars = load_catalogue(6.0)
    first = choose_stars(stars, TIME, n=30, seed=1)
    second = choose_stars(stars, TIME, n=30, seed=1, exclude=stars.hip[first])
    assert not set(first.tolist()) & set(second.tolist())


@pytest.mark.parametrize('n', [1, 2, 3, 8, 150])
def test_any_number_of_stars(n):
    rows = choose_stars(load_catalogue(6.0), TIME, n=n, seed=2)
    assert len(set(rows.tolist())) == n


def test_few_candidates_fill_empty_cells():
    stars = load_catalogue(6.0)
    _, el = observed_place(stars, TIME)
    up = stars.select((el > 20 * DEG) & (el < 85 * DEG) & (stars.mag < 3.0))
    up = up.select(~has_neighbour(up, np.arange(len(up))))
    rows = choose_stars(up, TIME, n=len(up), seed=2)
    assert sorted(rows.tolist()) == list(range(len(up)))


def test_stars_stay_up_for_the_duration():
    stars = load_catalogue(6.0)
    rows = choose_stars(stars, TIME, n=60, seed=3, duration=7200.0)
    for later in (0.0, 3600.0, 7200.0):
        _, el = observed_place(stars.select(rows), TIME + later)
        assert el.min() >= 20 * DEG and el.max() <= 85 * DEG


def test_neighbours_are_found():
    minute = 60 * ARCSEC
    ra = np.array([1.0, 1.0 + 10 * minute / np.cos(0.5), 2.0, 2.0, 3.0, 3.0, 0.001 * minute,
                   2 * np.pi - 5 * minute, 0.0, np.pi])
    dec = np.array([0.5, 0.5, 0.1, 0.1 + 14 * minute, -0.7, -0.7 + 32 * minute, 0.0, 0.0,
                    np.pi / 2 - 5 * minute, np.pi / 2 - 5 * minute])
    mag = np.array([3.0, 4.0, 3.0, 5.5, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0])
    zero = np.zeros(10)
    stars = Stars(np.arange(10), ra, dec, zero, zero, zero, zero, mag)
    # equal pair; faint companion of a bright one; 32' apart; across 0h; across the pole
    expected = [True, True, False, True, False, False, True, True, True, True]
    assert has_neighbour(stars, np.arange(10)).tolist() == expected


def test_neighbours_against_all_pairs():
    stars = load_catalogue(6.0)
    v = np.stack([np.cos(stars.dec) * np.cos(stars.ra), np.cos(stars.dec) * np.sin(stars.ra),
                  np.sin(stars.dec)], axis=1)
    expected = np.zeros(len(stars), bool)
    for k in range(0, len(stars), 500):
        chord = np.sqrt(np.maximum(2 - 2 * v[k : k + 500] @ v.T, 0))
        close = chord < 2 * np.sin(15.0 * 60 * ARCSEC)
        close &= stars.mag[None, :] - stars.mag[k : k + 500, None] < 2.0
        close[np.arange(len(close)), np.arange(k, k + len(close))] = False
        expected[k : k + 500] = close.any(axis=1)
    assert np.array_equal(has_neighbour(stars, np.arange(len(stars))), expected)
    chosen = choose_stars(stars, TIME, n=100, seed=0)
    assert expected.any() and not expected[chosen].any()


@pytest.mark.parametrize('options, words', [
    ({'n': 500, 'mag_limit': 3.0}, r'500 stars requested, \d+ available of \d+ to Hp 3'),
    ({'min_el': 89.99 * DEG, 'max_el': 90 * DEG}, 'no star visible to Hp 6 between 89.99'),
    ({'min_el': 80 * DEG, 'max_el': 20 * DEG}, 'elevation limits 80 to 20'),
    ({'n': 0}, '0 stars asked for'),
])
def test_errors_in_one_line(options, words):
    with pytest.raises(ValueError, match=words) as error:
        choose_stars(load_catalogue(6.0), TIME, **options)
    assert '\n' not in str(error.value)


def test_bright_stars_are_kept_and_know_who_is_alone():
    stars = load_catalogue(6.0)
    rows, bright, lonely = bright_stars(stars, 4.0)
    assert np.array_equal(rows, np.flatnonzero(stars.mag <= 4.0))
    assert np.array_equal(bright.hip, stars.hip[rows])
    assert np.array_equal(lonely, ~has_neighbour(stars, rows)) and 0 < lonely.sum() < len(rows)
    assert bright_stars(stars, 4.0)[1] is bright
    with pytest.raises(ValueError, match='read-only'):
        lonely[0] = False
