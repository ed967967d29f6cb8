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

"""The way back to the bolts, on mounts whose geometry does not come from the terms."""

import numpy as np
import pytest
from bolts import Bolted, rounds, turned
from scipy.spatial.transform import Rotation

from calibration.analysis.term_fit import fit_terms
from calibration.report.bolt_wording import (
    alignment_document,
    alignment_lines,
    angle_text,
    feet_lines,
    shim_line,
)
from encoder_sim.mount_geometry import MountErrors, MountGeometry
from msg_tools.units import ARCSEC, DEG
from pointing_model.bolts_and_feet import cone_shim, foot_lifts, polar_axis
from pointing_model.model import PointingModel
from pointing_model.mounts import Mount

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize('latitude', [-65.0, -20.0, 28.0, 70.0])
@pytest.mark.parametrize('kind', ['german', 'equatorial'])
def test_a_level_mount_off_by_degrees_is_on_its_pole_after_two_rounds(latitude, kind):
    off, sigma = rounds(np.random.default_rng([7, int(latitude) + 90]), latitude * DEG, kind,
                        count=2)
    assert off[0] > 0.2 * DEG and sigma[-1] < 1.5 * ARCSEC
    assert off[2] < 10.0 * ARCSEC + 3.0 * sigma[-1]


@pytest.mark.parametrize('latitude', [-65.0, 28.0, 70.0])
def test_on_a_base_a_degree_off_level_it_takes_three(latitude):
    off, sigma = rounds(np.random.default_rng([8, int(latitude) + 90]), latitude * DEG,
                        unlevel=1.0 * DEG)
    assert off[1] > 60.0 * ARCSEC  # a bolt moves the other angle too
    assert off[3] < 10.0 * ARCSEC + 3.0 * sigma[-1]


@pytest.mark.parametrize(('latitude', 'ma', 'me', 'way', 'goes', 'height'), [
    (48.0, 300.0, 200.0, 'clockwise', 'east', 'lower'),
    (48.0, -300.0, -200.0, 'anticlockwise', 'west', 'raise'),
    (-30.0, 300.0, 200.0, 'clockwise', 'west', 'raise'),
    (-30.0, -300.0, -200.0, 'anticlockwise', 'east', 'lower')])
def test_ways_of_the_bolts_in_both_hemispheres(latitude, ma, me, way, goes, height):
    # the mount that has these terms by its own geometry is put right by the words
    mount = Mount.equatorial(latitude * DEG, 'german')
    model = PointingModel({'MA': ma * ARCSEC, 'ME': me * ARCSEC}, np.eye(2) * ARCSEC**2,
                          mount=mount)
    _, azimuth, altitude = alignment_lines(alignment_document(model))
    assert f' {way}, seen from above (the axis goes {goes})' in azimuth and height in altitude
    frame = np.array(mount.frame)
    lean = Rotation.from_rotvec(np.cross(frame[2], (ma * frame[0] + me * frame[1]) * ARCSEC))
    end = lean.apply(frame[2]) * np.sign(latitude)
    axis = polar_axis(model)
    by_azimuth = Rotation.from_rotvec(
        -UP * abs(axis.azimuth_error) * (1.0 if way == 'clockwise' else -1.0)).apply(end)
    assert abs(by_azimuth[0]) < 1e-12
    raised = np.arcsin(by_azimuth[2]) + abs(axis.altitude_error) * (
        1.0 if height == 'raise' else -1.0)
    assert raised == pytest.approx(abs(latitude) * DEG, abs=1e-12)


def test_sigma_is_the_scatter_of_simulated_fits():
    rng = np.random.default_rng(5)
    found = []
    for _ in range(40):
        bolted = Bolted(48.0 * DEG, 'german', UP, {})
        bolted.turn_azimuth(2.0 * DEG)
        model = fit_terms(bolted.run(25, 20.0 * ARCSEC, rng), ('IH', 'ID', 'MA', 'ME')).model
        axis = polar_axis(model)
        found.append([(axis.azimuth_error - 2.0 * DEG) / axis.sigmas[0],
                      axis.altitude_error / axis.sigmas[1]])
    assert 0.75 < np.std(found) < 1.3


def test_the_refracted_pole_is_higher_by_what_is_said():
    mount = Mount.equatorial(-30.0 * DEG)
    model = PointingModel({'MA': 0.0, 'ME': 0.0}, np.eye(2) * ARCSEC**2, mount=mount)
    found = alignment_document(model, 98.0 * ARCSEC)
    assert found['altitude_error_arcsec'] == pytest.approx(-98.0)
    lines = alignment_lines(found, (600.0, 600.0))
    assert 'from the refracted pole (altitude 30.0272°, 98″ above the true one)' in lines[0]
    assert lines[1].startswith('Azimuth bolt: leave it')
    assert lines[2] == 'Altitude bolt: raise the axis by 98.0″ ± 1.0″: 0.16 turns.'


def test_a_shim_at_the_end_that_is_told_squares_the_tube():
    model = PointingModel({'CH': 300.0 * ARCSEC}, np.array([[9.0]]) * ARCSEC**2,
                          mount=Mount.equatorial(48.0 * DEG, 'german'))
    shim = cone_shim(model, 400.0)
    assert shim.thickness == pytest.approx(400.0 * np.tan(300.0 * ARCSEC))
    # in the meridian the tube is east of its saddle: west of it the rear end is moved east
    tube = MountGeometry(MountErrors(kind='german', ca=300.0 * ARCSEC), latitude=48.0 * DEG)
    _, forward, _ = tube.frames(0.0, 0.0)[0]
    east = forward[0] * 400.0
    assert east == pytest.approx(shim.thickness, rel=1e-5) and shim.rear
    assert 'Shim of 0.582 ± 0.006 mm between tube and saddle, at the rear end' in shim_line(shim)


def test_lifted_feet_stand_the_azimuth_axis_up():
    terms = {'AN': 400.0 * ARCSEC, 'AW': -250.0 * ARCSEC}
    model = PointingModel(terms, np.eye(2) * ARCSEC**2)
    feet = foot_lifts(model, 1200.0, np.array([10.0, 130.0, 250.0]) * DEG)
    axis = MountGeometry(MountErrors(an=terms['AN'], aw=terms['AW'])).boresight(0.0, 90.0 * DEG)[0]
    # where the feet stand on that base, and the lifts on them
    level = np.stack([np.sin(feet.azimuths), np.cos(feet.azimuths), 0.0 * feet.azimuths], axis=1)
    across = level - np.outer(level @ axis, axis)
    placed = 1200.0 * across / np.linalg.norm(across, axis=1)[:, None] + np.outer(feet.lifts, UP)
    normal = np.cross(placed[1] - placed[0], placed[2] - placed[0])
    normal *= np.sign(normal[2]) / np.linalg.norm(normal)
    assert np.hypot(*normal[:2]) < 0.01 * ARCSEC * 400.0
    assert feet.lifts.min() == 0.0 and len(feet_lines(feet)) == 4


@pytest.mark.parametrize(('terms', 'undetermined', 'latitude', 'why'), [
    ({'MA': 0.0}, (), 48.0, 'ME is not among'),
    ({'MA': 0.0, 'ME': 1e-4}, ('ME',), 48.0, 'ME is undetermined'),
    ({'MA': 0.0, 'ME': 0.0}, (), 89.5, 'a pole of the Earth')])
def test_what_is_not_known_is_not_told(terms, undetermined, latitude, why):
    model = PointingModel(terms, mount=Mount.equatorial(latitude * DEG), undetermined=undetermined)
    with pytest.raises(ValueError, match=why):
        polar_axis(model)


def test_the_angle_that_is_left_is_that_between_the_directions():
    bolted = Bolted(60.0 * DEG, 'german', UP, {})
    bolted.turn_azimuth(3.0 * DEG)
    bolted.raise_axis(-1.0 * DEG)
    model = fit_terms(bolted.run(30, 1e-3 * ARCSEC, np.random.default_rng(2)),
                      bolted.mount.names.physical).model
    assert polar_axis(model).pole_distance[0] == pytest.approx(bolted.off(), abs=0.01 * ARCSEC)
    turned(model, bolted)
    assert bolted.off() < 0.01 * ARCSEC


@pytest.mark.parametrize(('arcsec', 'text'), [
    (0.04, '0.0″'), (-99.94, '99.9″'), (99.96, '1′ 40″'), (3599.7, '1° 0′ 00″'),
    (10799.8, '3° 0′ 00″'), (17657.0, '4° 54′ 17″')])
def test_angles_carry_what_is_rounded_up(arcsec, text):
    assert angle_text(arcsec) == text


def test_a_guessed_equinox_is_said_before_a_bolt_is_turned():
    model = PointingModel({'MA': 1e-3, 'ME': 1e-3}, np.eye(2) * ARCSEC**2,
                          mount=Mount.equatorial(0.7))
    guess = {'told': False, 'taken': 'J2000', 'other': 'of date', 'polar_axis_arcsec': {
        'J2000': {'MA': 10.0, 'ME': 20.0}, 'of date': {'MA': 170.0, 'ME': -460.0}}}
    assert alignment_lines(alignment_document(model, equinox=guess))[0] == (
        'Give the equinox of the catalogue (--equinox) before you turn a bolt: J2000 is a guess; '
        'of date moves MA by 2\u2032 40\u2033, ME by 8\u2032 00\u2033.')
    known = alignment_document(model, equinox={**guess, 'told': True})
    assert len(alignment_lines(known)) == 3
