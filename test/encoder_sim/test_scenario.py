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

from encoder_sim.mount_geometry import MountErrors
from encoder_sim.scenario_file import load_scenario, scenario_files, scenario_names, undeclared
from msg_tools.units import ARCSEC, DEG


def write(folder, text, name='mine.yaml'):
    path = folder / name
    path.write_text(text, encoding='utf-8')
    return path


def test_packaged_scenarios():
    assert {'default', 'ideal'} <= set(scenario_names())
    ideal, default = load_scenario('ideal'), load_scenario()
    assert ideal.mount == MountErrors()
    assert ideal.camera.star_noise == ideal.incremental.azimuth.zero_drift == 0.0
    assert default.name == 'default'
    assert default.mount.ia > 100 * ARCSEC
    assert default.camera.star_noise == pytest.approx(1.0 * ARCSEC)
    assert default.incremental.elevation.zero_drift == pytest.approx(20.0 * ARCSEC)
    # from ideal.yaml, on which it is based
    assert default.axes.elevation.travel_max == pytest.approx(91.0 * DEG)
    assert default.incremental.azimuth.lines * default.incremental.azimuth.interpolation == 18880000


def test_file_changes_only_what_it_names(tmp_path):
    path = write(
        tmp_path,
        'based_on: default\n'
        'clock_offset_ms: 150\n'
        'mount:\n  an_arcsec: 60\n  tf_arcsec_per_degc: 0.5\n  ca_arcsec_per_hour: 3.6\n'
        '  wobble:\n  - {per_turn: 2, lean: left, amplitude_arcsec: 3}\n'
        'incremental: {azimuth: {zero_drifts_arcsec: [0, 20]}}\n'
        'weather: {pressure_hpa: 700, humidity_percent: 30}\n',
    )
    scenario, default = load_scenario(path), load_scenario('default')
    assert scenario.clock_offset == pytest.approx(0.15)
    assert scenario.mount.an == pytest.approx(60 * ARCSEC)
    assert scenario.mount.tf_slope == pytest.approx(0.5 * ARCSEC)
    assert scenario.mount.ca_rate == pytest.approx(0.001 * ARCSEC)
    assert scenario.mount.wobble[0].lean == 'left' and scenario.mount.wobble[0].per_turn == 2
    assert scenario.incremental.azimuth.zero_drifts == pytest.approx((0.0, 20 * ARCSEC))
    assert scenario.weather.pressure == 700 and scenario.weather.humidity == pytest.approx(0.3)
    assert scenario.site is None
    assert scenario.mount.ia == default.mount.ia
    assert scenario.incremental.elevation == default.incremental.elevation


def test_incremental_encoder_in_the_units_of_a_data_sheet(tmp_path):
    path = write(
        tmp_path,
        'incremental:\n  azimuth:\n    threshold_percent: 60\n    signal_percent_per_v: 20\n'
        '    signal_percent_per_degc: -0.5\n    mark_arcsec_per_v: 4\n'
        '    zero_arcsec_per_v: 3\n    mark_arcsec_per_degc: 2\n    supply_v_per_hour: -0.36\n'
        '    supply_ripple_v: 0.01\n    max_count_rate_mhz: 20\n    home_rate_deg_s: 2\n'
        '    mark_from: below\n    power_cycles_s: [60, 120]\n'
        '    losses: [{at_s: 30, counts: 120}]\n'
        'housing: {step_c: 6, at_s: 100, time_constant_s: 50}\n')
    scenario = load_scenario(path)
    p = scenario.incremental.azimuth
    assert (p.threshold, p.signal_supply, p.signal_slope) == pytest.approx((0.6, 0.2, -0.005))
    assert (p.mark_supply, p.zero_supply, p.mark_slope) == pytest.approx(
        (4 * ARCSEC, 3 * ARCSEC, 2 * ARCSEC))
    assert (p.supply_rate, p.max_count_rate, p.home_rate) == pytest.approx((-1e-4, 2e7, 2 * DEG))
    assert (p.losses[0].at, p.losses[0].counts, p.power_cycles) == (30.0, 120, (60.0, 120.0))
    assert scenario.temperature([99.0, 100.0, 150.0, 1e4], 0.0) == pytest.approx(
        [10.0, 10.0, 16.0 - 6.0 / 2.718281828, 16.0])


@pytest.mark.parametrize('name', scenario_names())
def test_every_packaged_scenario_can_be_read(name):
    assert load_scenario(name).name == name


def test_file_based_on_a_file_beside_it(tmp_path):
    write(tmp_path, 'mount: {aw_arcsec: 9}\n', 'base.yaml')
    path = write(tmp_path, 'based_on: base.yaml\nmount: {an_arcsec: 5}\n')
    mount = load_scenario(path).mount
    assert (mount.aw, mount.an, mount.ia) == pytest.approx((9 * ARCSEC, 5 * ARCSEC, 0.0))


@pytest.mark.parametrize(
    'text, parts',
    [
        ('mount: {an: 5}', ["mount: unknown key 'an'", 'an_arcsec']),
        ('mounts: {}', ["unknown key 'mounts'", 'mount, axes']),
        ('mount: {an_arcsec: five}', ['mount.an_arcsec', "'five'", '-36000 to 36000']),
        ('mount: {an_arcsec: true}', ['mount.an_arcsec', 'True is not a number']),
        ('mount: {an_arcsec: 1e5}', ['mount.an_arcsec', '1.0e-3']),
        ('mount: {an_arcsec: .nan}', ['mount.an_arcsec', 'nan']),
        ('camera: {star_noise_arcsec: -1}', ['camera.star_noise_arcsec', '-1', '0 to 600']),
        ('incremental: {azimuth: {lines: 2.5}}', ['azimuth.lines', 'a whole number']),
        ('incremental: {azimuth: 3}', ['incremental.azimuth', 'not a mapping']),
        ('incremental: {azimuth: {zero_drifts_arcsec: 3}}', ['not a list']),
        ('mount: {wobble: [{lean: up}]}', ['wobble[0].lean', 'forward, left']),
        ('absolute: {azimuth: {code: gray}}', ["'gray'", 'table, equation2']),
        ('axes: {azimuth: {travel_min_deg: 5, travel_max_deg: 5}}', ['axes.azimuth']),
        ('- 1', ['not a mapping']),
        ('mount: [', ['no valid YAML']),
        ('based_on: nothing', ['nothing', 'list prints all']),
        ('based_on: mine.yaml', ['based on itself']),
    ],
)
def test_bad_file_is_one_line_with_file_and_key(tmp_path, text, parts):
    path = write(tmp_path, text + '\n')
    with pytest.raises(ValueError) as error:
        load_scenario(path)
    message = str(error.value)
    assert '\n' not in message
    for part in parts if 'nothing' in text else ['mine.yaml', *parts]:
        assert part in message


def test_the_words_of_a_scenario_and_of_all_that_it_is_based_on(tmp_path):
    write(tmp_path, 'based_on: ideal\nundeclared: {what: the parent}\n', 'parent.yaml')
    text = 'based_on: parent.yaml\nundeclared: {what: a lean, shows_as: [tilt]}\n'
    files = scenario_files(write(tmp_path, text))
    assert [file['name'] for file in files] == ['mine', 'parent', 'ideal']
    assert files[0]['text'] == text and files[1]['text'].startswith('based_on: ideal')
    assert files[2:] == scenario_files('ideal')
    assert undeclared(text) == {'what': 'a lean', 'shows_as': ['tilt']}
    assert undeclared(files[1]['text']) == {'what': 'the parent', 'shows_as': None}
    assert undeclared(files[2]['text']) is None and undeclared('') is None
    with pytest.raises(ValueError, match='no scenario'):
        scenario_files('best')


def test_missing_file_and_unknown_name():
    with pytest.raises(ValueError, match='does not exist'):
        load_scenario('/nowhere/mine.yaml')
    with pytest.raises(ValueError, match='give a .yaml file or a name'):
        load_scenario('best')


def test_temperature_follows_the_night(tmp_path):
    path = write(tmp_path, 'weather: {temperature_c: 12, temperature_c_per_hour: -1.5}\n')
    scenario = load_scenario(path)
    assert scenario.temperature([0.0, 7200.0], start=0.0) == pytest.approx([12.0, 9.0])
    assert load_scenario('ideal').temperature(7200.0, start=0.0) == 10.0


def test_each_night_has_a_temperature_of_its_own():
    season = load_scenario('season_temperature')
    start = 1.7e9
    nights = season.temperature(start + 86400.0 * np.arange(40), start)
    assert -4.0 <= nights.min() < 0.0 and 12.0 < nights.max() <= 16.0
    # from the begin of a night to its end, however late the next one begins
    late = season.temperature(start + 86400.0 * np.arange(40) + 43200.0, start)
    np.testing.assert_array_equal(late, nights)
    assert abs(np.corrcoef(nights[1:], nights[:-1])[0, 1]) < 0.4
    other = replace(season, weather=replace(season.weather, nightly_draw=2))
    assert not np.allclose(other.temperature(start + 86400.0 * np.arange(40), start), nights)
    trend = load_scenario('season_trend').temperature(start + 86400.0 * np.arange(14), start)
    assert trend[:3].mean() - trend[-3:].mean() > 10.0
