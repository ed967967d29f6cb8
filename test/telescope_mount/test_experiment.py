"""Nights of paper 000 through the graph, the first of eleven and with few stars."""

import csv
import json

import numpy as np
import pytest

from calibration.paper_table_1 import COLUMNS, PAPER_TABLE_1
from msg_tools.bag import BagReader
from pointing_model.observing.plan import parse_plan
from pointing_model.run_files import read_run
from telescope_mount.experiment import SATELLITE_NIGHT, experiment_plan

NIGHTS = SATELLITE_NIGHT


@pytest.fixture(scope='module')
def experiment(cli, tmp_path_factory):
    folder = tmp_path_factory.mktemp('experiment') / 'out'
    done = cli('experiment', '--out', folder, '--nights', NIGHTS, '--stars', 8, '--polaris',
               4, '--satellite', 3)
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


def test_table_1_has_the_papers_errors_before_and_none_after(experiment):
    with open(experiment / 'table1.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [int(row['night']) for row in rows] == list(range(1, NIGHTS + 1))
    report = json.loads((experiment / 'report.json').read_text())
    sigma = {night['night']: night['physical']['after'] for night in report['nights']}
    for row, paper in zip(rows, PAPER_TABLE_1):
        for axis in ('az', 'el'):
            error = sigma[int(row['night'])][f'{axis}_sigma_arcsec']
            assert abs(float(row[f'after_{axis}_arcsec'])) < 5.0 * error
            before = f'before_{axis}_arcsec'
            assert abs(float(row[before]) - paper[before]) < 6.0 * error


def test_the_satellite_before_and_after(experiment):
    gps = json.loads((experiment / 'gps.json').read_text())
    # the drift of its night: 12.9 and 4.6 arcsec
    assert gps['before']['az_mean_arcsec'] == pytest.approx(12.9, abs=4.0)
    assert gps['before']['el_mean_arcsec'] == pytest.approx(4.6, abs=3.0)
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
    for name in ('nights.png', 'gps.png'):
        assert (experiment / name).read_bytes().startswith(b'\x89PNG')


def test_zeros_beside_a_constant_temperature_have_no_cause(experiment):
    found = json.loads((experiment / 'report.json').read_text())['zeros']
    assert len(found['power_ons']) == NIGHTS + 3 and found['causes']['nights'] == NIGHTS + 2
    assert found['causes']['verdict'] == 'nothing' and found['causes']['drivers'] == []
    assert 'temperature: constant' in found['causes']['text']
    assert found['tonight']['run'] == NIGHTS + 1 and found['tonight']['azimuth']['by'] == []
    names = [topic.name for topic in BagReader(experiment / 'bag').topics]
    assert '/mount/zero/expected_change' in names


def test_a_season_is_measured_where_the_marks_are_met(cli, tmp_path):
    done = cli('experiment', '--out', tmp_path / 'out', '--scenario', 'season_temperature',
               '--nights', 4, '--stars', 8, '--polaris', 4, '--satellite', 2)
    assert done.returncode == 0, (done.stdout, done.stderr)
    with open(tmp_path / 'out' / 'zeros.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert [int(row['run']) for row in rows] == list(range(-1, 6))
    zero, warmth = (np.array([float(row[name]) for row in rows]) for name in (
        'zero_az_arcsec', 'temperature_az_c'))
    # 3"/degC over -4 to 16 degC, 3" unexplained
    assert np.ptp(warmth) > 5.0 and np.corrcoef(zero, warmth)[0, 1] > 0.8
    supply, up = (np.array([float(row[name]) for row in rows]) for name in (
        'supply_el_v', 'zero_el_arcsec'))
    assert np.corrcoef(up, supply)[0, 1] > 0.8
    found = json.loads((tmp_path / 'out' / 'report.json').read_text())['zeros']
    assert found['causes']['drivers'] == ['temperature', 'supply']
    told = found['tonight']['azimuth']
    assert abs(told['expected_arcsec'] - told['measured_arcsec']) < 5.0 * told['sigma_arcsec']
    assert 'What the zeros of 6 power-ons follow' in done.stdout
    assert (tmp_path / 'out' / 'zeros.png').read_bytes().startswith(b'\x89PNG')


def test_bad_input_is_one_line(refused, tmp_path):
    (tmp_path / 'full').mkdir()
    (tmp_path / 'full' / 'file').write_text('')
    assert 'not empty' in refused('experiment', '--out', tmp_path / 'full')
    assert 'not allowed with' in refused(
        'experiment', '--drifts', 'random', '--scenario', 'season_none')
