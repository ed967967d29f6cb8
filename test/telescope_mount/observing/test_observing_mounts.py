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

"""Other mounts than alt-azimuth ones under the observer, without ROS."""


import numpy as np
import pytest
from bench import START, Bench

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.mounts import Mount, centred, is_beyond
from pointing_model.runs.run import PointingRun
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.observing.star_choice import choose_stars

LATITUDE = DEFAULT_SITE.latitude
FORK, GERMAN = Mount.equatorial(LATITUDE), Mount.equatorial(LATITUDE, 'german')
HOME = np.array([1.5, 1.5])


def observed(kind, stars=20, **changes):
    """Rows of stars pointed at blind, and the bench."""
    bench = Bench(f'check {stars}', homed=False, kind=kind, magnitude_limit=5.0, **changes)
    bench.position = HOME
    bench.miss = lambda number: ((20.0 + 1e-3 * number) * ARCSEC, (-30.0 + 0.02 * number) * ARCSEC)
    bench.read(bench.stamp, bench.position)
    assert bench.run()[0] == 'done'
    return PointingRun.concatenate(bench.rows), bench


@pytest.mark.parametrize('kind', [FORK, GERMAN, Mount.free(0.0, 0.0)], ids=lambda m: m.kind)
def test_rows_are_of_the_axes_and_on_their_side(kind):
    rows, bench = observed(kind)
    assert rows.mount == kind and len(rows) == 20
    # the encoders have no error: what is off is what the camera says, in the frame of the tube
    x, y = rows.offsets()
    number = np.arange(1, 21)
    np.testing.assert_allclose(x / ARCSEC, 20.0 + 1e-3 * number, atol=0.1)
    np.testing.assert_allclose(y / ARCSEC, -30.0 + 0.02 * number, atol=0.1)
    for i in range(len(rows)):
        star = load_catalogue(hip=[int(rows['star'][i])])
        place = observed_place(star, rows['time'][i], DEFAULT_SITE, DEFAULT_WEATHER)
        seen = kind.horizon_of(rows['az'][i], rows['el'][i])
        np.testing.assert_allclose(kind.direction(rows['az'][i], rows['el'][i]), np.ravel([
            np.cos(place[1]) * np.sin(place[0]), np.cos(place[1]) * np.cos(place[0]),
            np.sin(place[1])]), atol=1e-9)
        assert seen[1] > 19.0 * DEG
    for track in bench.commands:
        # no way around: a knot follows the one before
        assert np.abs(np.diff(track.angles, axis=0)).max() < 3.0 * DEG


def test_a_german_mount_keeps_its_counterweight_down():
    rows, bench = observed(GERMAN, 40, meridian_limit_deg=15.0)
    beyond = is_beyond(rows['el'])
    assert 8 < beyond.sum() < 32
    # through the pole east of the meridian, as far past it as is allowed
    hour_angle = wrap(rows['az'] - np.pi * beyond)
    assert np.all(hour_angle[beyond] < 16.0 * DEG) and np.all(hour_angle[~beyond] > -16.0 * DEG)
    near = np.abs(hour_angle) < 14.0 * DEG
    assert near.any() and set(rows['star'][near & beyond] % 2) <= {1.0}
    first, second = np.concatenate([track.angles for track in bench.commands]).T
    assert first.min() > -16.0 * DEG and first.max() < 196.0 * DEG
    assert second.min() > -90.0 * DEG and second.max() < 270.0 * DEG
    # how an axis came is by the way that it has, never through the counterweight up
    came = np.sign(np.diff(rows['az']))
    np.testing.assert_array_equal(came, rows['approach_az'][1:])


def test_a_camera_beyond_the_pole_is_turned_with_the_tube():
    first, second = 130.0 * DEG, 140.0 * DEG
    miss = np.array([3.0, -2.0]) * ARCSEC
    a, e = centred(first, second, *miss, beyond=True)
    # exact: to the right and the top of the tube
    frame = np.array([np.cos(second) * np.sin(first), np.cos(second) * np.cos(first),
                      np.sin(second)])
    right = np.array([np.cos(first), -np.sin(first), 0.0])
    top = np.cross(right, frame)
    star = frame + miss[0] * right + miss[1] * top
    np.testing.assert_allclose(
        [np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], star / np.linalg.norm(star),
        atol=1e-14)
    assert is_beyond(e) and abs(e - second) < 1e-4


def test_a_model_of_another_mount_is_not_taken():
    bench = Bench(kind=GERMAN)
    with pytest.raises(ValueError, match='of another mount .altaz. than this one .german, lat'):
        bench.in_force.update_model(PointingModel({'IA': 0.1}).to_json())
    bench.in_force.update_model(PointingModel({'IH': 0.1}, mount=GERMAN).to_json())
    assert bench.in_force.models == 1


def test_stars_of_a_fork_keep_away_from_its_pole_and_not_from_the_zenith():
    stars = load_catalogue(mag_limit=7.0)
    rows = choose_stars(stars, START * 1e-9, n=200, mag_limit=5.0, mount=FORK, max_el=80.0 * DEG)
    az, el = observed_place(stars.select(rows), START * 1e-9, DEFAULT_SITE, DEFAULT_WEATHER)
    declination = FORK.axes_of(az, el)[1]
    assert declination.max() < 80.5 * DEG and el.max() > 81.0 * DEG


@pytest.mark.parametrize('kind', [FORK, GERMAN], ids=lambda m: m.kind)
def test_what_a_star_taught_is_carried_on_the_sky(kind):
    """As angles it would be ten times as much at the equator as near the pole."""
    bench = Bench('stars 15', homed=False, kind=kind, magnitude_limit=5.0)
    bench.position = HOME
    bench.miss = lambda number: ((150.0 if number == 1 else 1e-3 * number) * ARCSEC, 0.0)
    bench.read(bench.stamp, bench.position)
    assert bench.run()[0] == 'done'
    rows = PointingRun.concatenate(bench.rows)
    beside = rows.offsets()[0] / ARCSEC
    np.testing.assert_allclose(beside[1:], 150.0, atol=2.0)
    assert np.ptp(np.abs(np.cos(rows['el']))) > 0.5


def test_what_a_star_taught_is_forgotten_after_one_that_was_not_found():
    bench = Bench('stars 3')
    # the first is far off, the second not there
    bench.miss = lambda number: (
        (150.0 * ARCSEC, 0.0) if number == 1 else (np.nan, np.nan) if 3 <= number <= 5
        else (1e-3 * number * ARCSEC, 0.0))
    assert bench.run()[0] == 'done'
    assert bench.plan.progress.lost == 1
    first, last = (rows.offsets()[0][0] / ARCSEC for rows in bench.rows)
    assert first == pytest.approx(150.0, abs=2.0) and abs(last) < 2.0


def test_polaris_is_refused_for_the_zero_of_an_equatorial_mount():
    bench = Bench('stars 1, polaris 4', kind=FORK)
    state, text = bench.run()
    assert state == 'failed' and len(bench.rows) == 0
    assert text.startswith('Polaris stands at 89.') and 'hour angle there: set it on stars' in text
