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

"""The step `pass` on instruments and a clock of the test, without ROS."""

import numpy as np
import pytest
from bench import SECOND, Bench
from kepler_orbit import START, sp3

from msg_tools.units import DEG, wrap
from pointing_model.mounts import parse_mount
from pointing_model.sky.satellite_place import satellite_place
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import satellite_target
from telescope_mount.guard.allowed_sky import AllowedSky, rows_of
from telescope_mount.guard.axis_track import Cubic
from telescope_mount.guard.limits import Axis, Limits
from telescope_mount.guard.motion import AxisState
from telescope_mount.guard.track_check import TrackCheck
from telescope_mount.observing.plan import parse_plan

LOW = {'axis': 6.85e6, 'eccentricity': 0.001, 'tilt': 0.92}


def observed(path, name, site=DEFAULT_SITE, **settings):
    bench = Bench('', **settings)
    bench.site, bench.stamp = site, round(START * 1e9) + 60 * SECOND
    bench.read(bench.stamp, bench.position)
    bench.plan.start(f'pass {name} {path}')
    return bench


def test_a_plan_names_the_satellite_and_its_file():
    (step,) = parse_plan('pass L52 orbits/lageos2.sp3')
    assert (step.verb, step.what, step.exposures) == ('pass', 'L52 orbits/lageos2.sp3', 0)
    assert str(step) == 'pass L52 orbits/lageos2.sp3'
    for text in ('pass', 'pass L52'):
        with pytest.raises(ValueError, match='a satellite and a file of its orbit, such as pass'):
            parse_plan(text)


def test_a_pass_is_waited_for_and_observed_to_its_end(tmp_path):
    path = tmp_path / 'a.sp3'
    path.write_text(sp3(120.0 * np.arange(400), velocities=False))
    bench = observed(path, 'L52', satellite_interval_s=300.0)
    state, text = bench.run()
    assert state == 'done' and len(bench.rows) > 5
    time = np.array([row['time'][0] for row in bench.rows])
    el = np.array([row['el'][0] for row in bench.rows])
    assert np.all(el > 19.0 * DEG) and np.ptp(time) < 6000.0 and time[0] > START + 600.0
    az, high, _ = satellite_place(satellite_target(f'L52 {path}').orbit, time)
    np.testing.assert_allclose(el, high, atol=1e-9)
    assert all(row['star'][0] < 0 for row in bench.rows)


def test_a_pass_that_does_not_come_ends_the_plan(tmp_path):
    path = tmp_path / 'a.sp3'
    path.write_text(sp3(120.0 * np.arange(40), velocities=False))
    state, text = observed(path, 'L52', min_elevation_deg=84.0).run()
    assert state == 'failed' and 'satellite L52 is not up within 24 h, or its orbit ends' in text


def test_a_file_that_is_not_there_ends_the_plan_alone(tmp_path):
    state, text = observed(tmp_path / 'none.sp3', 'L52').run()
    assert (state, text.endswith('none.sp3: No such file or directory')) == ('failed', True), text


def test_across_the_meridian_a_german_mount_goes_on_on_its_other_side(tmp_path):
    path = tmp_path / 'a.sp3'
    path.write_text(sp3(120.0 * np.arange(400), velocities=False))
    mount = parse_mount('german', DEFAULT_SITE.latitude)
    bench = observed(path, 'L52', kind=mount, satellite_interval_s=100.0, meridian_limit_deg=0.0)
    limits = Limits(mount, (Axis(-3.0 * DEG, 183.0 * DEG, 6.0 * DEG, 3.0 * DEG),
                            Axis(-90.0 * DEG, 270.0 * DEG, 6.0 * DEG, 3.0 * DEG)), timing=1.0)
    bench.allowed = AllowedSky.from_rows(rows_of(limits), DEFAULT_SITE)
    state, text = bench.run()
    assert state == 'done', text
    first = [track.angles[:, 0] for track in bench.commands]
    assert min(one.min() for one in first) > -3.0 * DEG
    assert max(one.max() for one in first) < 183.0 * DEG
    beyond = [track.angles[0, 1] > 0.5 * np.pi for track in bench.commands]
    assert np.count_nonzero(np.diff(beyond)) == 1 and 5 < sum(beyond) < len(beyond) - 5


def test_no_command_of_a_pass_overhead_leaves_the_limits(tmp_path):
    """A low satellite through 88 degrees: the seconds lost are those that were said before."""
    from kepler_orbit import terrestrial

    from pointing_model.sky.site import Site
    from telescope_mount.observing.pass_step import way_through
    path = tmp_path / 'low.sp3'
    path.write_text(sp3(10.0 * np.arange(700), name='X01', velocities=False, **LOW))
    beside = terrestrial(np.array([3500.0]), **LOW)[0][0]
    beside /= np.linalg.norm(beside)
    site = Site(np.arcsin(beside[2]) + 0.1 * DEG, np.arctan2(beside[1], beside[0]), 0.0)
    axes = (Axis(-9.0, 9.0, 6.0 * DEG, 3.0 * DEG), Axis(-0.1, 1.66, 6.0 * DEG, 3.0 * DEG))
    limits = Limits(axes=axes, keep_out=(), timing=1.0)
    bench = observed(path, 'X01', site, satellite_interval_s=5.0)
    bench.allowed = AllowedSky.from_rows(rows_of(limits), site)
    check, refused = TrackCheck(limits), []

    def send(track):
        state = AxisState(tuple(track.angles[0]), tuple(track.rates[0]))
        found = check.check(track.times, track.angles, track.rates, state)
        refused.extend([found.reason] if hasattr(found, 'reason') else [])
        bench.commands.append(track)
        bench.pending = track
    bench.send_command = send
    state, text = bench.run()
    assert (state, refused) == ('done', []), text
    holes = [one for one in bench.statuses if 'keyhole' in one[1]]
    assert holes, text
    # where the commanded way is off the track
    from telescope_mount.observing.pass_forecast import pass_forecasts
    orbit = satellite_target(f'X01 {path}').orbit
    (one,) = pass_forecasts(orbit, START, 2.0, site, axes=[
        Axis(-9.0, 9.0, 6.0 * DEG, 3.0 * DEG)] * 2, dark=False)
    way = way_through(orbit, one, site, bench.sky()[1], bench.kind, axes)
    time, angles = way.x, way(way.x)
    az, el, _ = satellite_place(orbit, time, site)
    off = np.abs(wrap(az - angles[:, 0])) * np.cos(el) > 1e-5
    assert one.lost == pytest.approx(0.25 * off.sum(), abs=2.0) and one.lost > 10.0
    assert Cubic(time - time[0], angles, np.gradient(angles, time, axis=0)).most_rate[0] < 6.1 * DEG
