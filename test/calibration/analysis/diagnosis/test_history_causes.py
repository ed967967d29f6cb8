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

"""What temperature, slews and rotator do to a simulated mount is in the set and said."""

import numpy as np
import pytest
from simulated import FAST

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.report.diagnosis_view import view_of
from calibration.report.wording import wording
from encoder_sim.drives import ShaftCouplings
from encoder_sim.mount_geometry import MountGeometry, azimuth_elevation
from encoder_sim.scenario_file import load_scenario
from encoder_sim.star_camera import Camera
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.context import Context
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

START = 1_768_482_000.0


def run_of(scenario, rows=70, seed=2):
    """A run of the mount of a scenario at its temperatures, with 1" of noise an axis."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(-np.pi, np.pi, rows), np.arcsin(rng.uniform(0.4, 0.98, rows))
    time = START + 150.0 * np.arange(rows) + rng.uniform(0.0, 30.0, rows)
    part = scenario.temperature(time, START, scenario.mount.behind_air)
    seen = azimuth_elevation(MountGeometry(scenario.mount, START).boresight(
        az, el, time=time, temperature=part))
    noise = rng.normal(size=(2, rows)) * ARCSEC
    return PointingRun({
        'az': seen[0], 'el': seen[1], 'az_enc': az + noise[0] / np.cos(el), 'el_enc': el + noise[1],
        'time': time, 'temperature': scenario.temperature(time, START)})


def names(result):
    return {name for e in result.effects
            for name in (e.fitted.effect.name, *e.alternatives, *e.aliases)}


@pytest.mark.parametrize('name, effect, words', [
    ('late_flexure', 'flexure_with_temperature_late', 'late'),
    ('secondary', 'secondary_with_temperature', 'secondary mirror')])
def test_what_follows_the_temperature_is_named(name, effect, words):
    result = diagnose(run_of(load_scenario(f'cause_{name}')), **FAST)
    assert effect in names(result)
    assert words in str(view_of(result))


def test_the_mount_is_behind_the_air():
    scenario = load_scenario('cause_late_flexure')
    time = START + np.arange(0.0, 20000.0, 10.0)
    air, part = (scenario.temperature(time, START, behind) for behind in (0.0, 1800.0))
    # q' = (T - q) / tau
    assert np.gradient(part, 10.0)[1:-1] == pytest.approx(
        ((air - part) / 1800.0)[1:-1], abs=1e-6)


def notes(result):
    return [note if isinstance(note, str) else wording(note) for note in result.notes]


def test_a_column_of_a_truss_explains_flexure_better_than_the_order():
    scenario = load_scenario('cause_late_flexure')
    run = run_of(scenario)
    truss = scenario.temperature(run['time'], START, 1800.0)
    columns = {name: run[name] for name in ('az', 'el', 'az_enc', 'el_enc')}
    columns['auxiliary_1'] = truss
    result = diagnose(PointingRun(columns, {'drivers': ('auxiliary_1',)}), **FAST)
    assert result.effects[0].fitted.effect.name == 'flexure_with_auxiliary_1'
    assert not any('order' in name for name in names(result))
    # and it is named where it was not said to be a cause
    result = diagnose(PointingRun(columns, {}), **FAST)
    assert any('use --cause auxiliary_1' in note for note in notes(result))


def test_how_late_it_is_is_told_by_a_log_that_begins_early_enough(tmp_path):
    scenario, lines = load_scenario('cause_late_flexure'), []
    run = run_of(scenario)

    def cells(time, temperature, *angles):
        when = np.datetime64(round(time * 1000.0), 'ms')
        return ','.join([f'{when}Z', f'{temperature:.3f}', *angles])
    for row in range(len(run)):
        lines.append(cells(run['time'][row], run['temperature'][row], *(
            f'{np.degrees(run[name][row]):.7f}' for name in ('az', 'el', 'az_enc', 'el_enc'))))
    before = START - 180.0 * np.arange(40, 0, -1)
    log = [cells(time, scenario.temperature(time, START), *[''] * 4) for time in before]
    told = []
    for rows in (lines, log + lines):
        path = tmp_path / 'run.csv'
        path.write_text('\n'.join(
            ['time,temperature_c,az_deg,el_deg,az_enc_deg,el_enc_deg', *rows]) + '\n')
        read = read_run(path)
        context = Context.from_run(read)
        assert len(context.log_of('temperature')[0]) == len(rows)
        result = diagnose(read, **FAST)
        assert result.counts['rows_used'] == result.counts['rows_read'] == len(run)
        told.append(next(note for note in notes(result) if 'flexure' in note and 'lag' in note))
    assert 'min before the first star' in told[0]
    minutes = float(told[1].split('temperature by ')[1].split(' min')[0])
    assert minutes == pytest.approx(30.0, abs=3.0)


def test_a_coupling_that_lets_go_in_long_slews_is_named():
    scenario = load_scenario('cause_slipping_coupling')
    run = run_of(scenario)
    shafts, read = ShaftCouplings(scenario.coupling), []
    at = np.zeros(2)
    for az in run['az_enc']:
        way = wrap(az - at[0])
        for part in np.linspace(0.0, 1.0, 40)[1:]:
            now = shafts.turn(at + part * np.array([way, 0.0]))
        shafts.turn(at + np.array([way, 0.0]))  # it stops
        at = at + np.array([way, 0.0])
        read.append(now[0] - at[0])
    read = np.array(read)
    assert len(np.unique(np.round(read / ARCSEC, 3))) > 2
    run.columns['az_enc'] = run['az_enc'] + read
    result = diagnose(run, **FAST)
    assert any(name.startswith(('azimuth_slip_of_slews', 'azimuth_zero_step'))
               for name in names(result)), names(result)


def test_readings_of_one_place_are_no_slews():
    from pointing_model.context import Context
    from pointing_model.effects.slips import propose
    rng = np.random.default_rng(2)
    az = rng.normal(size=40) * 3.0 * ARCSEC
    for length, offered in ((0.0, False), (30.0 * DEG, True)):
        places = az + length * rng.choice([-1.0, 1.0], 40)
        context = Context(0.0 * az, 0.0 * az + 0.7, {
            'time': 60.0 * np.arange(40), 'az_enc': places, 'el_enc': 0.0 * az})
        assert bool(next(propose(context, None, None)).effects) == offered


def test_a_jump_comes_with_its_slew():
    run = run_of(load_scenario('default'))
    way = np.abs(wrap(np.diff(run['az_enc'])))
    row = 20 + int(np.argmax(way[19:50])) + 0
    run.columns['az_enc'] = run['az_enc'] + 8.0 * ARCSEC * (np.arange(len(run)) >= row)
    told = next(note for note in notes(diagnose(run, **FAST)) if 'jumped with the slew' in note)
    assert f'to line {row} ' in told and f'({np.degrees(way[row - 1]):.0f}°' in told


@pytest.mark.parametrize('sense, name', [(1.0, 'left'), (-1.0, 'right')])
def test_a_camera_beside_the_axis_of_its_rotator_is_named(sense, name):
    scenario, rng = load_scenario('cause_rotator'), np.random.default_rng(5)
    run = run_of(scenario)
    angle = rng.uniform(-np.pi, np.pi, len(run))
    middle = Camera(scenario, 1)._middle(sense * angle)
    run.columns['az_enc'] = run['az_enc'] - middle[:, 0] / np.cos(run['el'])
    run.columns['el_enc'] = run['el_enc'] - middle[:, 1]
    run.columns['rotator_deg'] = np.degrees(angle)
    result = diagnose(run, **FAST)
    effect, = result.effects
    assert effect.fitted.effect.name == f'rotator_offset_{name}'
    assert np.hypot(*effect.fitted.coefficients) / ARCSEC == pytest.approx(np.hypot(5, 3), abs=0.6)
