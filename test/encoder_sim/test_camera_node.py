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

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from rclpy.parameter import Parameter

from encoder_sim.camera_node import StarCamera
from msg_tools import convert, topics
from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import parse_mount
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import load_catalogue, satellite_target

START = 1_768_482_000_000_000_000  # 2026-01-15T13:00:00
SIRIUS, CAPELLA = 32349, 24608


@pytest.fixture
def few_stars(tmp_path):
    """An ideal mount whose camera sees Sirius only."""
    path = tmp_path / 'few.yaml'
    path.write_text('based_on: ideal\ncamera: {mag_limit: -1.0}\n')
    return str(path)


def place(hip, ns):
    az, el = observed_place(load_catalogue(hip=[hip]), ns * 1e-9, DEFAULT_SITE, DEFAULT_WEATHER)
    return np.array([az[0], el[0]])


class Shutter:
    """Publishes true angles of an exposure; gives what the camera measured."""

    def __init__(self, graph, **overrides):
        self.graph = graph
        self.node = graph.add(StarCamera, **{'scenario': 'ideal', **overrides})
        self.pub = graph.publisher(topics.TRUTH_JOINTS)
        self.got = graph.listen(topics.MISS_DISTANCE)
        self.begin = START
        graph.connect()

    def __call__(self, angles_at, samples=3, step=500_000_000):
        self.begin += 60 * 10**9
        for i in range(samples):
            stamp = self.begin + i * step
            self.pub.publish(convert.joint_state(stamp, angles_at(stamp), [0.0, 0.0]))
        middle = self.begin + (samples - 1) * step // 2
        self.graph.wait_for(
            lambda: self.got and convert.from_stamp(self.got[-1].header.stamp) == middle,
            'the exposure')
        message = self.got[-1]
        return np.array(convert.read_sky_vector(message))


@pytest.mark.parametrize('hip', [SIRIUS, CAPELLA])
@pytest.mark.parametrize('shift', [(100.0, 0.0), (0.0, 100.0), (-80.0, 60.0)])
def test_a_star_towards_plus_a_plus_e_gives_a_positive_miss(graph, hip, shift):
    shutter = Shutter(graph)
    shift = np.array(shift) * ARCSEC

    def angles(stamp):  # the mount points short of the star by the shift
        star = place(hip, stamp)
        return star - shift / [np.cos(star[1]), 1.0]
    miss = shutter(angles)
    np.testing.assert_allclose(miss / ARCSEC, shift / ARCSEC, rtol=0, atol=0.2)


def test_through_the_pole_of_where_it_stands_the_miss_is_that_of_the_tube(graph, tmp_path):
    path = tmp_path / 'german.yaml'
    path.write_text('based_on: ideal\nmount: {kind: german}\nincremental:\n  hour_angle: '
                    '{mark_angle_deg: 90}\n')
    south = -20.0
    shutter = Shutter(graph, scenario=str(path), latitude_deg=south)
    site, mount = replace(DEFAULT_SITE, latitude=south * DEG), parse_mount('german', south * DEG)
    shift = np.array([-80.0, 60.0]) * ARCSEC
    for beyond in (False, True):
        def angles(stamp, beyond=beyond):
            at = observed_place(load_catalogue(hip=[SIRIUS]), stamp * 1e-9, site, DEFAULT_WEATHER)
            star = np.ravel(mount.axes_of(*at, beyond))
            return star - shift / [np.cos(star[1]), 1.0]
        np.testing.assert_allclose(shutter(angles) / ARCSEC, shift / ARCSEC, rtol=0, atol=0.2)


def test_a_mount_that_stands_still_is_measured_in_the_middle(graph):
    shutter = Shutter(graph)
    at = place(SIRIUS, START + 60 * 10**9 + 500_000_000)
    miss = shutter(lambda stamp: at)
    np.testing.assert_allclose(miss / ARCSEC, 0.0, atol=0.02)


def test_no_star_and_a_smeared_star_are_not_a_number(graph, few_stars):
    shutter = Shutter(graph, scenario=few_stars)
    off = np.array([0.0, 2.0]) * DEG
    assert np.isnan(shutter(lambda stamp: place(SIRIUS, stamp) + off)).all()

    def moving(stamp):  # 100" a second in elevation
        return place(SIRIUS, stamp) + [0.0, (stamp - shutter.begin - 5e8) * 1e-7 * ARCSEC]
    assert np.isnan(shutter(moving)).all()
    assert np.isfinite(shutter(lambda stamp: place(SIRIUS, stamp))).all()
    graph.report('camera', '', 'exposures without a star', 2)


def test_the_smear_limit_can_be_changed(graph, few_stars):
    shutter = Shutter(graph, scenario=few_stars)
    assert graph.set_parameter(shutter.node, smear_limit_arcsec=200.0) == (True, '')

    def moving(stamp):
        return place(SIRIUS, stamp) + [0.0, (stamp - shutter.begin - 5e8) * 1e-7 * ARCSEC]
    np.testing.assert_allclose(shutter(moving) / ARCSEC, 0.0, atol=0.1)


def test_a_gap_ends_an_exposure(graph, few_stars):
    shutter = Shutter(graph, scenario=few_stars)
    # half an exposure elsewhere, long before: it must not become part of the next
    shutter.pub.publish(convert.joint_state(START, [1.0, 1.0], [0.0, 0.0]))
    shutter.pub.publish(convert.joint_state(START + 500_000_000, [1.0, 1.0], [0.0, 0.0]))
    miss = shutter(lambda stamp: place(SIRIUS, stamp))
    np.testing.assert_allclose(miss / ARCSEC, 0.0, atol=0.02)
    assert len(shutter.got) == 1


def test_samples_across_north_are_no_turn(graph):
    polaris = 11767
    shutter = Shutter(graph)

    def angles(stamp):
        az, el = place(polaris, stamp)
        return [az + (2 * np.pi if (stamp // 500_000_000) % 2 else 0.0), el]
    np.testing.assert_allclose(shutter(angles) / ARCSEC, 0.0, atol=0.02)


def test_bad_angles_are_refused_and_the_next_exposure_works(graph, few_stars):
    shutter = Shutter(graph, scenario=few_stars)
    wrong = convert.joint_state(START, [1.0, 1.0])
    wrong.name = ['x', 'y']
    shutter.pub.publish(wrong)
    graph.report('camera', '1 messages refused')
    for i in range(3):
        shutter.pub.publish(convert.joint_state(START + i * 500_000_000, [np.nan, np.nan]))
    assert np.isfinite(shutter(lambda stamp: place(SIRIUS, stamp))).all()


def test_another_site_is_another_sky(graph, few_stars):
    shutter = Shutter(graph, scenario=few_stars, latitude_deg=20.0)
    assert np.isnan(shutter(lambda stamp: place(SIRIUS, stamp))).all()


def test_of_a_star_and_a_satellite_the_one_that_is_followed_is_measured(graph):
    """Beside the track of the satellite lies a star, which drifts through the field."""
    start = 1_379_854_800_000_000_000  # 2013-09-22 13:00 UTC
    shutter = Shutter(graph, satellite='gps-26690', start_time='2013-09-22T13:00:00')
    shutter.begin = start
    satellite = satellite_target('gps-26690')

    def follow(stamp):
        az, el = satellite.place(np.array([stamp * 1e-9]), DEFAULT_SITE, DEFAULT_WEATHER)
        return [az[0], el[0] - 12.0 * ARCSEC]
    assert shutter(follow) / ARCSEC == pytest.approx([0.0, 12.0], abs=0.1)

    def stay(stamp):
        return follow(start)
    # it moves 30 arcsec a second: seen, but smeared
    shutter.node.set_parameters([Parameter('smear_limit_arcsec', value=5.0)])
    assert np.isnan(shutter(stay)).all()


def test_an_image_is_where_the_axes_were_on_the_mean(graph, few_stars):
    shutter = Shutter(graph, scenario=few_stars)

    def slipping(stamp):  # for most of the exposure 8 arcsec high, at its ends and middle not
        part = (stamp - shutter.begin) / 1e9
        high = 8.0 * ARCSEC * (part not in (0.0, 0.5, 1.0))
        return place(SIRIUS, stamp) + [0.0, high]
    miss = shutter(slipping, samples=17, step=62_500_000)
    np.testing.assert_allclose(miss / ARCSEC, [0.0, -8.0 * 14 / 16], rtol=0, atol=0.05)


def test_the_wind_bends_the_tube_unseen_by_the_axes(graph, tmp_path):
    path = tmp_path / 'windy.yaml'
    path.write_text('based_on: ideal\ncamera: {mag_limit: -1.0}\n'
                    'wind: {speed_m_s: 10.0, origin_deg: 0.0, intensity_percent: 0.0, '
                    'shelter_percent: 0.0, bending_arcsec: 20.0}\n')
    shutter = Shutter(graph, scenario=str(path))
    miss = shutter(lambda stamp: place(SIRIUS, stamp))
    az, el = place(SIRIUS, shutter.begin)
    # a wind from the north takes the boresight south, and the star is on the other side
    wanted = 20.0 * np.array([-np.sin(az), -np.sin(el) * np.cos(az)])
    np.testing.assert_allclose(miss / ARCSEC, wanted, rtol=0, atol=0.05)
