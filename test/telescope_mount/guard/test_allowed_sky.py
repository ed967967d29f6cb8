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

"""What the guard allows, known where stars are chosen."""

from dataclasses import replace

import numpy as np
import pytest
from bench import START, Bench

from msg_tools.units import DEG, wrap
from pointing_model.mounts import parse_mount
from pointing_model.sky.places import observed_place, sun_place
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.skyline import Horizon, parse_horizon
from pointing_model.sky.star_catalogue import load_catalogue
from telescope_mount.guard import sky_limits
from telescope_mount.guard.allowed_sky import NEAR, AllowedSky, rows_of
from telescope_mount.guard.limits import Axis, Limits
from telescope_mount.observing import star_choice
from telescope_mount.observing.star_choice import choose_stars
from telescope_mount.observing.zero_stars import zero_stars

#: 2026-01-15T13:00:00, a night, and ten hours earlier, a day in which stars are observed
NIGHT, DAY = START * 1e-9, START * 1e-9 - 36000.0
SKYLINE = '0 12, 45 50, 140 55, 180 8'


def told(**limits):
    """As the observer has it from the rows that the guard publishes."""
    return AllowedSky.from_rows(rows_of(Limits(**limits)), DEFAULT_SITE)


def test_what_the_guard_tells_is_what_it_keeps():
    horizon = Horizon(15.0 * DEG, parse_horizon(SKYLINE))
    sky = told(horizon=horizon, keep_out=((sky_limits.SUN, 25.0 * DEG),))
    az = np.linspace(0.0, 2.0 * np.pi, 2000)
    above = horizon.at(az) + NEAR
    assert not sky(NIGHT, az, above - 1e-6).any()
    assert sky(NIGHT, az, above + 4.0 * DEG).all()  # a higher corner may be beside it
    sun_az, sun_el = sun_place(DAY)
    assert sun_el > 20.0 * DEG
    off = np.radians([0.0, 24.0, 26.9, 27.1])
    assert sky(DAY, np.full(4, sun_az), sun_el + off).tolist() == [False, False, False, True]
    everywhere = told(horizon=Horizon(0.0), keep_out=())
    assert everywhere(DAY, np.array([sun_az]), np.array([sun_el])).all()
    axes = tuple(Axis(low * DEG, high * DEG, 1.0, 1.0) for low, high in ((20, 330), (-5, 80)))
    sky, near = told(axes=axes, horizon=Horizon(0.0), keep_out=()), NEAR / DEG
    az = np.array([20.0 - 1.0, 20.0 + near + 1.0, 330.0 - near - 1.0, 331.0, 359.0, 100.0])
    assert sky.within(az * DEG, np.full(6, 0.9)).tolist() == [
        False, True, True, False, False, True]
    assert not sky.within(np.ones(1), np.array([80.0 * DEG]))[0]
    assert AllowedSky.from_rows({'state': 'idle'}, DEFAULT_SITE) is None  # an older guard


@pytest.mark.parametrize(('kind', 'first', 'second'), [
    ('equatorial', (-60.0, 95.0), (-40.0, 70.0)), ('german', (20.0, 150.0), (-20.0, 230.0))])
@pytest.mark.parametrize('choose', [choose_stars, zero_stars])
def test_polar_axes_stay_within_their_travel(kind, first, second, choose):
    mount = parse_mount(kind, DEFAULT_SITE.latitude)
    axes = tuple(Axis(low * DEG, high * DEG, 1.0, 1.0) for low, high in (first, second))
    sky = told(mount=mount, axes=axes, horizon=Horizon(10.0 * DEG), keep_out=())
    stars = load_catalogue(mag_limit=6.0)

    def outside(limits):
        rows = choose(stars, NIGHT, n=30, limits=limits, mount=mount, max_el=88.0 * DEG)
        numbers = stars.hip[rows if isinstance(rows, np.ndarray) else rows.rows]
        chosen = stars.select(np.flatnonzero(np.isin(stars.hip, numbers)))
        angles = np.array(star_choice.axes_at(
            mount, *observed_place(chosen, NIGHT), limits, chosen.hip)) / DEG
        return np.count_nonzero(~((np.array([first, second])[:, 0] <= angles.T)
                                  & (np.array([first, second])[:, 1] >= angles.T)).all(axis=1))

    assert outside(star_choice.AxisLimits(allowed=sky)) == 0 < outside(star_choice.AxisLimits())


@pytest.mark.parametrize('choose', [
    lambda stars, limits: choose_stars(stars, DAY, n=30, seed=2, limits=limits, duration=1200.0),
    lambda stars, limits: zero_stars(stars, DAY, 16, limits=limits, duration=1200.0).rows])
def test_no_star_is_chosen_where_the_guard_lets_no_tube_look(choose):
    sky = told(horizon=Horizon(10.0 * DEG, parse_horizon(SKYLINE)),
               keep_out=((sky_limits.SUN, 40.0 * DEG),))
    stars = load_catalogue(mag_limit=6.0)

    def outside(limits):
        chosen = stars.select(choose(stars, limits))
        return [int(np.count_nonzero(~sky(t, *observed_place(chosen, t))))
                for t in (DAY, DAY + 1200.0)]

    assert outside(star_choice.AxisLimits(allowed=sky)) == [0, 0]
    assert min(outside(star_choice.AxisLimits())) > 0


def refuses(bench, wrong, reason='below the horizon'):
    """The guard of a bench refuses tracks by the azimuth at which they begin."""
    bench.refusal = lambda stamp: reason if wrong(bench.commands[-1]) else ''
    send = bench.send_command

    def sent(track):
        send(track)
        if wrong(track):
            bench.pending = None
    bench.send_command = sent
    return bench


def test_a_star_that_is_refused_is_no_pointing_of_the_plan_and_another_takes_its_place():
    bench = refuses(Bench('stars 8, check 4'), lambda track: np.sin(track.angles[0, 0]) > 0.6)
    assert bench.run() == ('done', 'plan finished')
    progress = bench.plan.progress
    assert (len(bench.rows), progress.lost, progress.done) == (12, 0, 4)
    stars = [int(row['star'][0]) for row in bench.rows]
    assert len(set(stars)) == 12
    assert all(np.sin(row['az'][0]) < 0.61 for row in bench.rows)
    refused = sum(np.sin(track.angles[0, 0]) > 0.6 for track in bench.commands)
    assert progress.refused == refused > 0
    assert bench.plan.night.refusal.startswith('HIP ')
    assert bench.plan.night.refusal.endswith(': below the horizon')
    # none is asked for again
    asked = [tuple(np.round(np.sin(track.angles[0]), 2)) for track in bench.commands
             if np.sin(track.angles[0, 0]) > 0.6]
    assert len(set(asked)) == len(asked)
    ((check,),) = bench.checks
    assert (check['stars'], check['lost']) == (4, 0)


def test_an_observer_that_knows_the_limits_is_not_refused():
    def low_in_the_south(track):
        az, el = track.angles[0]
        return abs(wrap(az - np.pi)) < 60.0 * DEG and el < 50.0 * DEG

    bench = refuses(Bench('stars 12'), low_in_the_south)
    bench.allowed = told(horizon=Horizon(10.0 * DEG, parse_horizon(
        '119 10, 120 50, 240 50, 241 10')))
    bench.run()
    assert (len(bench.rows), bench.plan.progress.refused) == (12, 0)
    ignorant = refuses(Bench('stars 12'), low_in_the_south)
    ignorant.run()
    assert ignorant.plan.progress.refused > 0


def test_where_no_other_star_is_left_the_plan_goes_on_with_fewer():
    bench = Bench('stars 6')
    refuses(bench, lambda track: any(track is bench.commands[n] for n in (1, 4)
                                     if n < len(bench.commands)))

    class Sky:  # of which nothing is left once the mount has been commanded

        def __call__(self, time, az, el):
            return np.full(len(el), not bench.commands)

        def within(self, first, second):
            return np.ones(len(first), bool)

    bench.allowed = Sky()
    assert bench.run() == ('done', 'plan finished')
    progress = bench.plan.progress
    assert (len(bench.rows), progress.refused, progress.lost) == (4, 2, 2)


def test_a_guard_of_another_site_is_told():
    rows = rows_of(Limits()) | {'latitude_deg': '34.3', 'longitude_deg': '109.0'}
    assert AllowedSky.from_rows(rows, DEFAULT_SITE).elsewhere == ''
    other = AllowedSky.from_rows(rows, replace(DEFAULT_SITE, longitude=-70.7 * DEG)).elsewhere
    assert other.startswith('the guard takes the mount to be at 34.3000, 109.0000 deg, not at 34.3')
