"""The eleven nights of paper 000 through the graph, with few stars."""

import csv
import json

import numpy as np
import pytest

from calibration.paper_table_1 import COLUMNS, PAPER_TABLE_1
from msg_tools.bag import BagReader
from pointing_model.plan import parse_plan
from pointing_model.run_files import read_run
from telescope_mount.experiment import NIGHTS, experiment_plan


@pytest.fixture(scope='module')
def experiment(cli, tmp_path_factory):
    folder = tmp_path_factory.mktemp('experiment') / 'out'
    done = cli('experiment', '--out', folder, '--stars', 8, '--polaris', 4, '--satellite', 3)
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
    assert names.count('/mount/zero') >= 13


def test_what_is_printed(experiment):
    text = (experiment.parent / 'stdout').read_text()
    for words in ('table 1', 'GPS satellite 26690', 'section 1.1', '+13.99 ± 11.33', 'RMS'):
        assert words in text, words
    for name in ('nights.png', 'gps.png'):
        assert (experiment / name).read_bytes().startswith(b'\x89PNG')


def test_bad_input_is_one_line(cli, tmp_path):
    (tmp_path / 'full').mkdir()
    (tmp_path / 'full' / 'file').write_text('')
    done = cli('experiment', '--out', tmp_path / 'full')
    assert done.returncode == 2 and done.stderr.count('\n') == 1 and 'not empty' in done.stderr
