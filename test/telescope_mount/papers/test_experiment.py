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

"""The experiment of paper 000 through the graph: few nights, few stars, and marks that move with
temperature and supply. That the scenario's own drifts are the printed ones test_papers.py holds.
"""

import csv
import json

import numpy as np
import pytest

from msg_tools.bag import BagReader
from msg_tools.units import ARCSEC
from pointing_model.runs.run_messages import cloud_to_run
from pointing_model.runs.run_reader import read_run
from pointing_model.zero import is_for_zero
from telescope_mount.nights.night_files import Written
from telescope_mount.observing.plan import parse_plan
from telescope_mount.papers import experiment as module
from telescope_mount.papers.experiment import SATELLITE_NIGHT, experiment_plan
from telescope_mount.papers.experiment_page import residuals_of_nights
from telescope_mount.papers.table_1 import COLUMNS

NIGHTS = SATELLITE_NIGHT


@pytest.fixture(scope='module')
def experiment(cli, tmp_path_factory):
    folder = tmp_path_factory.mktemp('experiment') / 'out'
    done = cli('experiment', '--out', folder, '--scenario', 'season_temperature', '--nights',
               NIGHTS, '--stars', 8, '--polaris', 4, '--satellite', 3, '--verbose')
    assert done.returncode == 0, (done.stdout, done.stderr)
    assert done.stderr == ''
    (folder.parent / 'stdout').write_text(done.stdout)
    return folder


def test_plan():
    steps = parse_plan(experiment_plan(30, 16, 20))
    assert sum(step.exposures for step in steps) == 11 * 76 + 2 * 46 + 2 * 20
    verbs = [step.verb for step in steps]
    assert verbs.count('fit') == verbs.count('calibrate_zero') == verbs.count('home') == 13
    assert verbs.count('power_cycle') == verbs.count('wait') == 12
    assert verbs[0] == 'home'


@pytest.fixture(scope='module')
def moved(experiment):
    """How far the simulated zeros stand from those of the reference, two nights before, arcsec:
    rows of nights 1, 2, ...
    """
    zeros = np.array([message.data.position for message in BagReader(
        experiment / 'bag_truth').messages('/mount/truth/incremental_zero', decode=True)])
    assert len(zeros) == NIGHTS + 3
    return (zeros[2:] - zeros[:-2]) / ARCSEC


def test_table_1_has_the_simulated_errors_before_and_none_after(experiment, moved):
    with open(experiment / 'table1.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [int(row['night']) for row in rows] == list(range(1, NIGHTS + 1))
    report = json.loads((experiment / 'report.json').read_text())
    sigma = {night['night']: night['physical']['after'] for night in report['nights']}
    assert np.abs(moved).max() > 20.0
    for row, true in zip(rows, moved):
        for axis, change in zip(('az', 'el'), true):
            error = sigma[int(row['night'])][f'{axis}_sigma_arcsec']
            assert abs(float(row[f'after_{axis}_arcsec'])) < 5.0 * error
            assert abs(float(row[f'before_{axis}_arcsec']) - change) < 6.0 * error


def test_the_satellite_before_and_after(experiment, moved):
    gps = json.loads((experiment / 'gps.json').read_text())
    az, el = moved[SATELLITE_NIGHT - 1]
    assert abs(az) > 10.0 and abs(el) > 5.0
    assert gps['before']['az_mean_arcsec'] == pytest.approx(az, abs=4.0)
    assert gps['before']['el_mean_arcsec'] == pytest.approx(el, abs=3.0)
    assert abs(gps['after']['az_mean_arcsec']) < 4.0
    assert abs(gps['after']['el_mean_arcsec']) < 3.0
    assert gps['before']['n'] == gps['after']['n'] == 3
    assert gps['after']['az_std_arcsec'] > 0.0


def test_one_log_holds_all_nights(experiment):
    bag = BagReader(experiment / 'bag')
    assert bag.complete and bag.problems == []
    rows = read_run(experiment / 'observations.csv')
    assert set(np.unique(rows['run'])) == set(range(-1, NIGHTS + 2))
    evenings = [rows['time'][rows['run'] == run].min() for run in np.unique(rows['run'])]
    np.testing.assert_allclose(np.diff(evenings), 86400.0, atol=300.0)
    names = [message.topic for message in bag.messages()]
    assert names.count('/mount/observation') == len(rows)
    assert names.count('/mount/zero') >= NIGHTS + 2


def test_what_is_printed(experiment):
    text = (experiment.parent / 'stdout').read_text()
    for words in ('table 1', 'GPS satellite 26690', 'section 1.1', '+13.99 ± 11.33', 'RMS'):
        assert words in text, words


def test_the_page_has_every_star_by_the_model_that_the_report_judges(experiment):
    page = (experiment / 'page.html').read_text(encoding='utf-8')
    assert 'What the zeros of the power-ons follow' in page and '>nan' not in page
    report = json.loads((experiment / 'report.json').read_text())
    run = cloud_to_run([message.data for message in BagReader(experiment / 'bag').messages(
        '/mount/observations', decode=True)][-1])
    data = residuals_of_nights(report, run)
    for night in report['nights']:
        own = data.groups == night['night']
        polaris = run['time'][(run['run'] == night['night']) & is_for_zero(run)]
        for when, rows in (('before', own & (data.time < polaris[0])),
                           ('after', own & (data.time > polaris[-1]))):
            told = night['physical'][when]
            assert told['stars'] == rows.sum()
            assert np.mean(data.of(when)[1, rows]) == pytest.approx(told['el_mean_arcsec'],
                                                                    abs=1e-9)
            assert data.radial(when, rows) == pytest.approx(told['radial_rms_arcsec'], abs=1e-9)
    assert page.count('<tr data-i=') == len(data) + NIGHTS and len(page) < 1_000_000


def test_the_zeros_go_with_what_is_measured_where_the_marks_are_met(experiment):
    with open(experiment / 'zeros.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert [int(row['run']) for row in rows] == list(range(-1, NIGHTS + 2))
    zero, warmth = (np.array([float(row[name]) for row in rows]) for name in (
        'zero_az_arcsec', 'temperature_az_c'))
    # 3"/degC over -4 to 16 degC, 3" unexplained
    assert np.ptp(warmth) > 5.0 and np.corrcoef(zero, warmth)[0, 1] > 0.8
    supply, up = (np.array([float(row[name]) for row in rows]) for name in (
        'supply_el_v', 'zero_el_arcsec'))
    assert np.corrcoef(up, supply)[0, 1] > 0.8
    found = json.loads((experiment / 'report.json').read_text())['zeros']
    assert len(found['power_ons']) == NIGHTS + 3 and found['causes']['nights'] == NIGHTS + 2
    assert found['causes']['drivers'] == ['temperature', 'supply']
    told = found['tonight']['azimuth']
    assert found['tonight']['run'] == NIGHTS + 1
    assert abs(told['expected_arcsec'] - told['measured_arcsec']) < 5.0 * told['sigma_arcsec']
    names = [topic.name for topic in BagReader(experiment / 'bag').topics]
    assert '/mount/zero/expected_change' in names


def test_what_does_not_change_is_no_cause(experiment):
    text = ' '.join((experiment.parent / 'stdout').read_text().split())
    assert 'not tried: side from which the mark was met: constant' in text
    assert 'Causes of changes of the zero, 6 power-ons' in text


@pytest.mark.parametrize('given, scenario', [
    ({}, 'eleven_nights'), ({'scenario': 'season_none'}, 'season_none'),
    ({'drifts': 'random'}, 'eleven_random_nights')])
def test_the_drifts_are_the_papers_unless_others_are_asked_for(
        monkeypatch, tmp_path, given, scenario):
    seen = {}
    monkeypatch.setattr(module, 'observe', lambda folder, specs, plan, *_, **__: seen.update(
        {spec.name: spec.parameters for spec in specs}, plan=plan) or Written(
            {'files': {}, 'incomplete': []}, None))
    monkeypatch.setattr(module, 'render_experiment', lambda *_: '')
    module.run_experiment(tmp_path / 'out', stars=8, nights=4, **given)
    for node in ('mount_simulator', 'incremental_encoder', 'absolute_encoder', 'camera'):
        assert seen[node]['scenario'] == scenario
    # the power-on after table 1: the paper's section 1.1, or the one that is foretold
    assert seen['plan'].count('power_cycle') == 5 + (given.get('drifts') != 'random')


def test_bad_input_is_one_line(refused, tmp_path):
    (tmp_path / 'full').mkdir()
    (tmp_path / 'full' / 'file').write_text('')
    assert 'not empty' in refused('experiment', '--out', tmp_path / 'full')
    assert 'not allowed with' in refused(
        'experiment', '--drifts', 'random', '--scenario', 'season_none')
