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

"""The undeclared effects of the simulator: geometry, which first-order columns only approximate."""

import dataclasses

import numpy as np
import pytest

from encoder_sim.graduated_disc import disc_angle, tilted_angle
from encoder_sim.mount_geometry import MountErrors, MountGeometry, azimuth_elevation
from encoder_sim.scenario import Scenario, TrueWeather
from encoder_sim.scenario_file import load_scenario, scenario_names
from encoder_sim.star_camera import Camera, CameraErrors
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import load_catalogue

LOOPS = [name for name in scenario_names() if name.startswith('loop_')]
NIGHT = 1_768_482_000.0
RNG = np.random.default_rng(5)
AZ = RNG.uniform(0.0, 2.0 * np.pi, 200)
EL = np.arcsin(RNG.uniform(np.sin(20 * DEG), np.sin(80 * DEG), 200))
PLAIN = load_scenario('default').mount


def offsets(mount, **where):
    """Axis angle minus true direction on the sky at (AZ, EL) of the axes, arcsec."""
    az, el = azimuth_elevation(MountGeometry(mount, NIGHT).boresight(AZ, EL, **where))
    return np.array([wrap(AZ - az) * np.cos(el), EL - el]) / ARCSEC


def added(scenario, **where):
    """What a scenario's mount does beyond the declared terms."""
    return offsets(load_scenario(scenario).mount, **where) - offsets(PLAIN)


def only(y=0.0, x=0.0):
    return np.array([np.broadcast_to(x, AZ.shape), np.broadcast_to(y, AZ.shape)])


SINE, COSINE = np.sin(EL), np.cos(EL)


@pytest.mark.parametrize('scenario, where, column', [
    # forward: the tube dips; left: as an axis that leans west where it looks north
    ('loop_bearing_wobble', {}, only(6.0 * np.cos(2 * AZ - 30 * DEG),
                                     6.0 * SINE * np.cos(2 * AZ - 120 * DEG))),
    ('loop_track_bump', {}, only(
        -20.0 * np.exp(-0.5 * (wrap(AZ - 130 * DEG) / (10 * DEG)) ** 2))),
    ('loop_elevation_sawtooth', {}, only(14.0 * np.mod(EL / (16 * DEG), 1.0))),
    ('loop_azimuth_backlash', {'approach_az': 1.0}, only(x=6.0 * COSINE)),
    ('loop_elevation_backlash', {'approach_el': -1.0}, only(-5.0)),
    # half an hour later, two degrees warmer
    ('loop_flexure_drift', {'time': NIGHT + 1800.0}, only(35.0 * COSINE)),
    ('loop_collimation_temperature', {'temperature': 12.0}, only(x=5.0)),
    ('loop_tilt_temperature', {'temperature': 12.0}, only(
        6.0 * np.cos(AZ) + 4.0 * np.sin(AZ), SINE * (6.0 * np.sin(AZ) - 4.0 * np.cos(AZ)))),
])
def test_the_columns_are_its_first_order(scenario, where, column):
    seen = added(scenario, **where)
    assert np.abs(seen).max() > 3.0
    # with terms of some 300" and effects of 35": 35 * 5e-4 * tan 80 deg
    smooth = np.abs(column[1] - np.roll(column[1], 1)) < 1e9
    if scenario == 'loop_elevation_sawtooth':  # the fall lies where the tube is, not the axis
        smooth = np.abs(np.mod(EL / (16 * DEG) + 0.5, 1.0) - 0.5) > 0.05
    error = (seen - column)[:, smooth]
    assert np.abs(error).max() < 0.12
    # and it is not the formula itself
    if 'backlash' not in scenario:
        assert np.abs(error).max() > 1e-6


def test_the_first_order_error_falls_with_the_square_of_the_size():
    """Twice the mount's errors and twice the effect: four times what the column leaves."""
    left = []
    for size in (10.0, 20.0):
        parts = load_scenario('loop_bearing_wobble').mount.wobble
        mount = MountErrors(ca=size * 10 * ARCSEC, an=size * 5 * ARCSEC, wobble=tuple(
            dataclasses.replace(p, amplitude=size * ARCSEC) for p in parts))
        bare = dataclasses.replace(mount, wobble=())
        column = only(size * np.cos(2 * AZ - 30 * DEG), size * SINE * np.cos(2 * AZ - 120 * DEG))
        left.append(offsets(mount) - offsets(bare) - column)
    assert np.abs(left[1] - 4.0 * left[0]).max() < 0.02 * np.abs(left[1]).max()


def test_a_tilted_disc_reads_twice_a_turn():
    angle = np.linspace(-7.0, 20.0, 5000)
    tilt, phase = 0.87 * DEG, 25 * DEG
    error = tilted_angle(angle, tilt, phase) - angle
    # projected on the plane of the head
    np.testing.assert_allclose(
        np.tan(angle + error - phase) * np.cos(tilt), np.tan(angle - phase), rtol=1e-6)
    first = 0.25 * tilt**2 * np.sin(2.0 * (angle - phase))
    assert np.abs(first).max() / ARCSEC == pytest.approx(11.9, abs=0.1)
    assert 1e-5 < np.abs(error - first).max() / ARCSEC < 0.01
    assert tilted_angle(1.0, 0.0, 0.3) == 1.0


@pytest.mark.parametrize('scenario, wanted', [
    ('loop_azimuth_eccentric', -9.63), ('loop_elevation_disc_tilted', 0.0)])
def test_the_encoder_shows_it(scenario, wanted):
    from encoder_sim.incremental import IncrementalEncoder
    axis = scenario.split('_')[1]
    params = getattr(load_scenario(scenario).incremental, axis)
    plain = getattr(load_scenario('default').incremental, axis)
    angle = np.linspace(0.3, 1.5, 400)
    seen, bare = (IncrementalEncoder(p, 1, axis)._shown(angle) for p in (params, plain))
    if scenario == 'loop_azimuth_eccentric':
        column = wanted * np.sin(angle - 70 * DEG)
        bare = disc_angle(angle, 0.0, 0.0, 1.0)
    else:
        column = 11.9 * np.sin(2.0 * (angle - 25 * DEG))
    assert np.abs((seen - bare) / ARCSEC - column).max() < 0.12


def test_a_faint_star_is_drawn_aside_more():
    stars = load_catalogue(mag_limit=6.5)
    az, el = observed_place(stars, NIGHT)
    up = np.flatnonzero(el > 30 * DEG)[:400]
    stamps = np.full(len(up), int(NIGHT) * 10**9)
    frames = MountGeometry(MountErrors()).frames(az[up], el[up])
    plain, drawn = (Camera(
        Scenario(camera=CameraErrors(field_of_view=600 * ARCSEC, trail=trail)), 1).expose(
        stamps, frames) for trail in (0.0, 30.0 * ARCSEC))
    shift = (drawn.miss - plain.miss) / ARCSEC
    assert np.abs(shift[:, 1]).max() == 0.0
    assert shift[:, 0] == pytest.approx(30.0 * 10 ** (0.04 * (drawn.mag - 4.0)))
    slope = np.polyfit(drawn.mag, shift[:, 0], 1)[0]
    assert 2.0 < slope < 4.0


def test_the_air_swings_about_its_drift():
    air = TrueWeather(temperature=8.0, temperature_rate=2.0 / 3600.0, temperature_swing=3.0,
                      swing_period=600.0)
    start = NIGHT
    assert air.temperature_at(start, start) == 8.0
    assert air.temperature_at(start + 150.0, start) == pytest.approx(11.0 + 300.0 / 3600.0)
    assert air.temperature_at(start + 600.0, start) == pytest.approx(8.0 + 1200.0 / 3600.0)


def test_there_are_enough_of_them_and_each_does_what_the_declared_model_does_not():
    assert len(LOOPS) >= 12 and 'loop_clean' in LOOPS
    default = load_scenario('default')
    for name in LOOPS:
        scenario = load_scenario(name)
        same = dataclasses.replace(scenario, name=default.name) == default
        assert same == (name == 'loop_clean'), name


def test_the_description_is_nothing_to_the_simulator(tmp_path):
    path = tmp_path / 'told.yaml'
    path.write_text('undeclared: {what: a secret, shows_as: [x]}\n')
    assert dataclasses.replace(load_scenario(path), name='ideal') == Scenario(name='ideal')


@pytest.mark.parametrize('text', ['a text', '[1]', '{shows_as: []}', '{what: 3}',
                                  '{what: a, how: b}'])
def test_a_description_of_another_form_is_refused(tmp_path, text):
    path = tmp_path / 'bad.yaml'
    path.write_text(f'undeclared: {text}\n')
    with pytest.raises(ValueError, match='undeclared') as caught:
        load_scenario(path)
    assert '\n' not in str(caught.value)
