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

import dataclasses

import numpy as np
import pytest

from encoder_sim.azimuth_track import Wobble
from encoder_sim.mount_geometry import (
    FORWARD,
    RIGHT,
    UP,
    MountErrors,
    MountGeometry,
    azimuth_elevation,
    direction,
)
from encoder_sim.scenario_file import load_scenario
from msg_tools.units import ARCSEC, DEG, wrap

NORTH, EAST, SOUTH, WEST = 0.0, 90 * DEG, 180 * DEG, 270 * DEG


def offset(az, el, **errors):
    """Axis angle minus true direction, on the sky, arcsec."""
    where = {k: errors.pop(k) for k in list(errors) if k.startswith('approach')}
    mount = MountErrors(**{k: v * ARCSEC for k, v in errors.items()})
    true_az, true_el = azimuth_elevation(MountGeometry(mount).boresight(az, el, **where))
    x = wrap(az - true_az) * np.cos(true_el)
    return np.array([x[0], el - true_el[0]]) / ARCSEC


def test_perfect_mount_points_where_its_axes_say():
    az, el = np.array([0.0, 1.0, 3.0, 6.0, 0.0]), np.array([0.0, 0.5, 1.2, 0.1, np.pi / 2])
    frames = MountGeometry(MountErrors()).frames(az, el)
    assert frames[:, FORWARD] == pytest.approx(direction(az, el), abs=1e-15)
    # right is towards rising azimuth, up towards rising elevation
    step = 1e-6
    assert frames[0, RIGHT] == pytest.approx([1, 0, 0])
    assert frames[0, UP] == pytest.approx([0, 0, 1])
    for i in range(3):
        towards_a = direction(az[i] + step, el[i]) - direction(az[i], el[i])
        assert frames[i, RIGHT] @ towards_a == pytest.approx(step * np.cos(el[i]), rel=1e-5)
        towards_e = direction(az[i], el[i] + step) - direction(az[i], el[i])
        assert frames[i, UP] @ towards_e == pytest.approx(step, rel=1e-5)


def test_frames_stay_rotations():
    mount = dataclasses.replace(
        load_scenario('default').mount, wobble=(Wobble(2, 'left', 5 * ARCSEC, 0.3),)
    )
    frames = MountGeometry(mount).frames(np.linspace(0, 7, 50), np.linspace(0, 1.6, 50))
    assert frames @ frames.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (50, 1, 1)))
    assert np.linalg.det(frames) == pytest.approx(np.ones(50))


@pytest.mark.parametrize(
    'errors, az, el, expected',
    [
        # the axis zero: at 60 degrees an azimuth step is half as long on the sky
        ({'ia': 10}, EAST, 60 * DEG, (5, 0)),
        ({'ie': 10}, EAST, 60 * DEG, (0, 10)),
        # the azimuth axis leans north: looking north the tube dips, south it rises
        ({'an': 10}, NORTH, 0.0, (0, 10)),
        ({'an': 10}, SOUTH, 0.0, (0, -10)),
        # looking east and high, the line of sight is carried north: azimuth too small
        ({'an': 10}, EAST, 30 * DEG, (5, 0)),
        ({'an': 10}, WEST, 30 * DEG, (-5, 0)),
        ({'aw': 10}, WEST, 0.0, (0, 10)),
        ({'aw': 10}, EAST, 0.0, (0, -10)),
        ({'aw': 10}, NORTH, 30 * DEG, (5, 0)),
        # the boresight lies left of the tube by that much at every elevation
        ({'ca': 10}, EAST, 0.0, (10, 0)),
        ({'ca': 10}, WEST, 70 * DEG, (10, 0)),
        # right end of the elevation axis high: nothing at the horizon, to the left above
        ({'npae': 10}, SOUTH, 0.0, (0, 0)),
        ({'npae': 10}, SOUTH, 30 * DEG, (5, 0)),
        # the tube sags: nothing at the zenith
        ({'tf': 10}, EAST, 0.0, (0, 10)),
        ({'tf': 10}, EAST, 60 * DEG, (0, 5)),
        # the tube follows the axis behind half the play
        ({'backlash_azimuth': 10, 'approach_az': 1}, EAST, 0.0, (5, 0)),
        ({'backlash_azimuth': 10, 'approach_az': -1}, EAST, 0.0, (-5, 0)),
        ({'backlash_elevation': 10, 'approach_el': 1}, EAST, 1.0, (0, 5)),
    ],
)
def test_signs_by_hand(errors, az, el, expected):
    assert offset(az, el, **errors) == pytest.approx(expected, abs=0.003)


def test_bearing_wobble():
    for az in (0.3, 2.0, 5.0):
        forward = MountErrors(wobble=(Wobble(2, 'forward', 10 * ARCSEC, 0.4),))
        true_az, true_el = azimuth_elevation(MountGeometry(forward).boresight(az, 0.5))
        assert (0.5 - true_el[0]) / ARCSEC == pytest.approx(10 * np.cos(2 * az - 0.4), abs=0.002)
        assert true_az[0] == pytest.approx(az, abs=1e-8)
        left = MountErrors(wobble=(Wobble(3, 'left', 10 * ARCSEC, 0.0),))
        true_az, true_el = azimuth_elevation(MountGeometry(left).boresight(az, 0.5))
        x = wrap(az - true_az[0]) * np.cos(0.5) / ARCSEC
        assert x == pytest.approx(10 * np.sin(0.5) * np.cos(3 * az), abs=0.002)
        assert true_el[0] == pytest.approx(0.5, abs=1e-8)


def test_lean_of_the_axis_is_the_constant_wobble():
    # leaning north by 30" is leaning forward by 30 cos A and left by 30 sin A
    parts = (Wobble(1, 'forward', 30 * ARCSEC, 0.0), Wobble(1, 'left', 30 * ARCSEC, 90 * DEG))
    az, el = np.linspace(0, 6, 20), np.linspace(0.1, 1.4, 20)
    leaning = MountGeometry(MountErrors(an=30 * ARCSEC)).boresight(az, el)
    assert MountGeometry(MountErrors(wobble=parts)).boresight(az, el) == pytest.approx(
        leaning, abs=1e-12)


def test_drifts():
    mount = MountErrors(an=10 * ARCSEC, an_rate=2 * ARCSEC, tf_slope=3 * ARCSEC)
    geometry = MountGeometry(mount, start=100.0)
    _, el = azimuth_elevation(
        geometry.boresight([0.0, 0.0], 0.0, time=[100.0, 104.0], temperature=[10.0, 12.0])
    )
    assert -el / ARCSEC == pytest.approx([10.0, 10.0 + 8.0 + 6.0], abs=1e-4)
    _, el = azimuth_elevation(geometry.boresight(0.0, 0.0))
    assert -el / ARCSEC == pytest.approx([10.0], abs=1e-4)


def sky_grid():
    az, el = np.meshgrid(np.arange(0.0, 360.0, 15.0) * DEG, np.arange(15.0, 86.0, 10.0) * DEG)
    return az.ravel(), el.ravel()


def test_the_terms_of_the_field_are_recovered():
    from pointing_model.pointing_terms import PHYSICAL, design

    # so small that first order holds: the signs and the shares of both axes
    values = {'ia': 3.0, 'ie': -2.0, 'ca': 1.5, 'npae': -1.2, 'an': 2.5, 'aw': -1.7, 'tf': 2.2}
    mount = MountErrors(**{k: v * ARCSEC for k, v in values.items()})
    az, el = sky_grid()
    true_az, true_el = azimuth_elevation(MountGeometry(mount).boresight(az, el))
    x, y = wrap(az - true_az) * np.cos(true_el), el - true_el
    columns = np.concatenate(design(PHYSICAL, true_az, true_el))
    found = np.linalg.lstsq(columns, np.concatenate([x, y]), rcond=None)[0] / ARCSEC
    assert found == pytest.approx([values[n.lower()] for n in PHYSICAL], abs=0.005)


def test_agrees_with_the_exact_geometry_of_the_model():
    from pointing_model.geometry import encoder_to_sky
    from pointing_model.mount_kinds import CANONICAL

    mount = dataclasses.replace(load_scenario('default').mount, an=3600 * ARCSEC)
    coefficients = {name: getattr(mount, name.lower()) for name in CANONICAL}
    az, el = sky_grid()
    model_az, model_el = encoder_to_sky(az, el, coefficients)
    apart = direction(model_az, model_el) - MountGeometry(mount).boresight(az, el)
    # they differ only in where the cosine of the sag is taken
    assert np.linalg.norm(apart, axis=1).max() < 0.05 * ARCSEC
