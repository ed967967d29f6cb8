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

"""What mounts do beyond their terms, made by the simulator's geometry, is in the set and said."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import FAST

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.report.diagnosis_view import view_of
from encoder_sim.azimuth_track import Bump
from encoder_sim.incremental import IncrementalEncoder
from encoder_sim.mount_geometry import MountErrors, MountGeometry, azimuth_elevation
from encoder_sim.scenario_file import load_scenario, scenario_files, undeclared
from msg_tools.units import ARCSEC, DEG
from pointing_model.effects import Amount
from pointing_model.mounts import Mount, is_beyond
from pointing_model.runs.run import PointingRun

START, LATITUDE = 1_768_482_000.0, 34.3 * DEG


def made(mount, rows, seed=1, hours=3.0, encoder=None):
    """A run of a simulated mount: its geometry, its azimuth encoder, and 1" of noise an axis."""
    rng, kind = np.random.default_rng(seed), mount.at(LATITUDE)
    az, el = rng.uniform(-170.0, 350.0, rows) * DEG, np.arcsin(rng.uniform(0.4, 0.98, rows))
    first, second = az, el
    if not kind.vertical:
        first, second = kind.axes_of(az, el, rng.random(rows) < 0.5)
    time = START + np.sort(rng.uniform(0.0, 3600.0 * hours, rows))
    up = np.sign(np.append(1.0, np.diff(second)))
    seen = azimuth_elevation(MountGeometry(mount, START, latitude=LATITUDE).boresight(
        first, second, time=time, approach_el=up))
    place = kind.axes_of(*seen, is_beyond(second))
    if encoder is not None:
        shown = IncrementalEncoder(encoder, 1, 'azimuth')._shown(first, 0.0, time - START)
        first = shown
    noise = rng.normal(size=(2, rows)) * ARCSEC
    return PointingRun({
        'az': place[0], 'el': place[1], 'az_enc': first + noise[0] / np.cos(second),
        'el_enc': second + noise[1], 'time': time, 'approach_el': up,
        'approach_az': np.sign(np.append(1.0, np.diff(first)))}, {'mount': kind})


def shown(result):
    return {name for e in result.effects
            for name in (e.fitted.effect.name, *e.alternatives, *e.aliases)}


SENTENCES = {
    'flop': 'flops', 'rail_joints': '60° from there', 'cables': 'wound up its cables',
    'uneven_fork': 'a nod would be the same', 'creeping_disc': 'nothing has jumped',
    'focuser': 'ocuser or mirror sags'}


@pytest.mark.parametrize('name', SENTENCES)
def test_a_scenario_is_named(name):
    scenario = load_scenario(f'cause_{name}')
    encoder = scenario.incremental.azimuth if name == 'creeping_disc' else None
    result = diagnose(made(scenario.mount, 90, encoder=encoder), **FAST)
    wanted = undeclared(scenario_files(f'cause_{name}')[0]['text'])['shows_as']
    assert any(one.startswith(tuple(wanted)) for one in shown(result)), shown(result)
    text = str(view_of(result))
    assert SENTENCES[name] in text
    # and without it nothing is found
    if name == 'flop':
        plain = replace(scenario.mount, flop=MountErrors().flop)
        assert not diagnose(made(plain, 90), **FAST).effects


@pytest.mark.parametrize('kind, steps, name, wording', (
    ('equatorial', (('hour', (1.0, 0.6)),), 'flop_sideways', 'at hour angle −'),
    ('equatorial', (('dec', (0.0, 1.0)),), 'declination_jump', 'jump by +24.'),
    ('altaz', (('hour', (1.0, 0.0)),), 'azimuth_jump', 'azimuth readings jump by +2')))
def test_a_step_at_one_place(kind, steps, name, wording):
    """Mirrors and encoder tapes; they were taken for waves of 1 to 6 in a turn."""
    rng, n = np.random.default_rng(6), 50
    mount = Mount() if kind == 'altaz' else Mount.equatorial(40.0 * DEG)
    first, second = rng.uniform(-1.1, 1.1, n), np.arcsin(rng.uniform(0.0, 0.9, n))
    of = {'hour': first + 2.0 * DEG, 'dec': second - 26.0 * DEG}
    offset = rng.normal(size=(2, n)) + sum(
        12.0 * np.sign(of[driver]) * np.array([[x], [y]])
        * (np.cos(second) if kind == 'altaz' else 1.0) for driver, (x, y) in steps)
    x, y = offset * ARCSEC
    result = diagnose(PointingRun({
        'az': first, 'el': second, 'az_enc': first + x / np.cos(second),
        'el_enc': second + y}, {'mount': mount}), **FAST)
    assert [e.fitted.effect.name for e in result.effects] == [name]
    assert wording in str(view_of(result))


def test_a_cage_up_and_down_is_not_told_from_cables_over_few_turns():
    """Both are a slow curve of 1.4 turns: a scan has as many directions as numbers."""
    bearing = replace(load_scenario('mount_runout').mount.runouts[0], slip=0.0,
                      amplitude=2.5 * ARCSEC)
    for seed in (1, 2):
        result = diagnose(made(MountErrors(runouts=(bearing,)), 90, seed), **FAST)
        assert {'bearing_cage_el', 'cable_drag_elevation'} <= shown(result), seed


def test_the_mean_of_two_cameras_is_told_with_their_angle():
    """Places of cameras 1.2 degrees left and right of the tube leave c^2 / 2 tan E."""
    mount = MountErrors(ie=40.0 * ARCSEC, an=30.0 * ARCSEC)
    runs = [made(replace(mount, ca=side * 1.2 * DEG), 60) for side in (-1.0, 1.0)]
    away = np.mod(runs[1]['az'] - runs[0]['az'] + np.pi, 2.0 * np.pi) - np.pi
    run = PointingRun({**runs[0].columns, 'az': runs[0]['az'] + 0.5 * away,
                       'el': 0.5 * (runs[0]['el'] + runs[1]['el'])}, runs[0].meta)
    found = diagnose(run, **FAST).effects[0].fitted
    assert found.effect.name == 'off_axis_camera'
    size = found.coefficients[0]
    assert np.sqrt(2.0 * size) / DEG == pytest.approx(1.2, abs=0.05)


def test_turns_are_counted_by_the_encoder():
    scenario = load_scenario('mount_runout')
    cage = tuple(replace(one, slip=0.0) for one in scenario.mount.runouts[:2])
    result = diagnose(made(replace(scenario.mount, runouts=cage), 120), **FAST)
    assert any(name.startswith('bearing_cage') for name in shown(result))
    one = next(e.fitted.effect for e in result.effects if e.fitted.effect.form == 'bearing_cage')
    # of 1.4 turns its standard error is 0.04
    assert one.parameters['ratio'] == pytest.approx(0.43, abs=0.08)
    run = made(scenario.mount, 60)
    run.columns['az_enc'] = np.mod(run['az_enc'], 2.0 * np.pi)
    run.columns['az'] = np.mod(run['az'], 2.0 * np.pi)
    reasons = dict(diagnose(run, **FAST).untestable)
    assert 'turns' in reasons['cage of the bearing']


def test_outliers_that_gather_at_rail_joints_are_no_accidents():
    """Two joints, each of three rows or more, 40 standard deviations deep."""
    az, grid = np.degrees(made(MountErrors(), 120)['az']), np.arange(0.0, 360.0, 5.0)
    rows = (np.abs(np.mod(az - grid[:, None] + 180.0, 360.0) - 180.0) < 4.0).sum(axis=1)
    one = grid[np.argmax(rows)]
    other = grid[np.argmax(rows * (np.abs(np.mod(grid - one + 180.0, 360.0) - 180.0) > 40.0))]
    bumps = tuple(Bump(at=at * DEG, width=3.0 * DEG, amplitude=40.0 * ARCSEC)
                  for at in (one, other))
    result = diagnose(made(MountErrors(ia=30.0 * ARCSEC, bumps=bumps), 120), **FAST)
    found = [e.fitted.effect for e in result.effects]
    assert [e.form for e in found] == ['track_bump'] * 2
    at = sorted(np.degrees(e.parameters['centre']) for e in found)
    assert at == pytest.approx(sorted((one, other)), abs=0.5)
    assert all(e.parameters['width'] / DEG == pytest.approx(3.0, abs=0.7) for e in found)
    assert (result.weights > 0.0).all()


@pytest.mark.parametrize('seed', range(2))
def test_a_wide_bump_is_one_bump(seed):
    """Of 12 degrees, between the widths that are tried: not two of 8, one up and one down."""
    bump = Bump(at=115.0 * DEG, width=12.0 * DEG, amplitude=12.0 * ARCSEC)
    result = diagnose(made(MountErrors(ia=30.0 * ARCSEC, bumps=(bump,)), 90, seed), **FAST)
    one, = result.effects
    assert one.fitted.effect.form == 'track_bump'
    assert np.degrees(one.fitted.effect.parameters['centre']) == pytest.approx(115.0, abs=2.0)
    assert one.fitted.effect.parameters['width'] / DEG == pytest.approx(12.0, abs=2.5)
    assert one.fitted.coefficients / ARCSEC == pytest.approx([12.0], abs=1.5)
    assert 'The mount dips by 1' in view_of(result).sentences[0]


def test_two_bumps_of_one_width_and_both_signs_are_two():
    bumps = tuple(Bump(at=at * DEG, width=8.0 * DEG, amplitude=up * ARCSEC)
                  for at, up in ((100.0, 15.0), (140.0, -15.0)))
    result = diagnose(made(MountErrors(ia=30.0 * ARCSEC, bumps=bumps), 120), **FAST)
    found = {round(float(np.degrees(e.fitted.effect.parameters['centre'])) / 10.0) * 10:
             e.fitted.effect.clause(Amount(e.fitted.coefficients / ARCSEC)) for e in result.effects}
    assert sorted(found) == [100, 140]
    assert 'dips by' in found[100] and 'rises by' in found[140]
