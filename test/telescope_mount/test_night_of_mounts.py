"""A German mount in the south, from the first star to the verified log, in processes."""

import json

import pytest

from msg_tools.bag import BagReader
from pointing_model.model import PointingModel
from pointing_model.mounts import is_beyond
from pointing_model.run_files import read_run
from telescope_mount.verify import verify_log

pytestmark = pytest.mark.usefixtures('ros_domain')


@pytest.fixture(scope='module')
def loop(cli, tmp_path_factory):
    """Folder and output of a loop with a counterweight that nobody was told of."""
    folder = tmp_path_factory.mktemp('german') / 'loop'
    done = cli('close-the-loop', '--scenario', 'german_counterweight', '--latitude', -30,
               '--stars', 40, '--check', 10, '--polaris', 8, '--out', folder)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def test_the_effect_is_found_and_blind_stars_are_missed_by_less(loop):
    folder, text = loop
    report = json.loads((folder / 'report.json').read_text())
    assert report['mount'] == 'german' and report['mount_axes'] == ['hour angle', 'declination']
    assert report['found'] in ('yes', 'in the set')
    assert report['applied'] and report['false'] == []
    assert report['blind_after']['rms_arcsec'] < 0.7 * report['blind_before']['rms_arcsec']
    assert 'ha' in text and 'dec' in text and 'azimuth' not in text
    page = (folder / 'diagnosis.html').read_text()
    assert 'hour angle' in page


def test_both_sides_of_the_pier_are_one_model(loop):
    folder, _ = loop
    run, model = read_run(folder / 'observations.csv'), PointingModel.load(folder / 'model.json')
    beyond = is_beyond(run['el'])
    assert run.mount.kind == 'german' and 10 < beyond.sum() < len(run) - 10
    assert run.mount.agrees(model.mount)
    assert list(model.terms) == ['IH', 'ID', 'CH', 'NP', 'MA', 'ME', 'TF']
    # Polaris is below the horizon: the zero is by stars
    zeros = [message.data for message in BagReader(folder / 'bag').messages(decode=True)
             if message.topic.endswith('/zero')]
    assert zeros[0].header.frame_id.endswith('+stars')
    assert list(zeros[0].name) == ['hour_angle', 'declination']


def test_its_log_holds_to_the_bit(loop):
    folder, _ = loop
    found = verify_log(folder / 'bag')
    assert found['differences'] == [] and found['unchecked'] == []
    assert found['checked']['model'] == 3 and found['checked']['diagnosis'] == 2
