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

"""A whole night in processes."""

import csv
import fcntl
import json
import os
import resource
import shutil
import signal
import termios
import time
from contextlib import suppress
from functools import partial
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from msg_tools.bag import BagReader
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.mount_shape import urdf
from pointing_model.mounts import ALTAZ
from pointing_model.runs.run_messages import cloud_to_run
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.star_catalogue import POLARIS_HIP
from telescope_mount.graph import NIGHT, measured_graph, night_graph
from telescope_mount.input_files.run_loader import with_rows_before
from telescope_mount.nights.night_files import write_results
from telescope_mount.nights.whole_night import NightFailed, observe, prepare_folder

MMT = resources.files('calibration') / 'data' / 'mmt_2021-08-21.csv'
#: nodes that wait for one another share one
PROCESSES = {spec.process or spec.name for spec in night_graph(bag='bag')}

pytestmark = pytest.mark.usefixtures('ros_domain')


@pytest.fixture(scope='module')
def report(night):
    return json.loads((night / 'report.json').read_text())


def test_it_says_what_it_did_and_nothing_on_stderr(night):
    assert (night.parent / 'stderr').read_text() == ''
    text = (night.parent / 'stdout').read_text()
    for words in ('Zero on Polaris', 'RMS on the sky', 'External check',
                  'encoder − catalogue', 'simulated',
                  str(night / 'model.json')):
        assert words in text, words


def test_the_files_are_there(night):
    for name in ('observations.csv', 'model.json', 'report.json',
                 'bag/metadata.yaml', 'bag_truth/metadata.yaml'):
        assert (night / name).stat().st_size > 0, name
    page = (night / 'page.html').read_text(encoding='utf-8')
    assert len(page) < 400_000 and 'All 9 nodes ended without a warning.' in page
    # nothing that only the simulator knows
    assert 'simulated</' not in page and 'bag_truth' not in page
    assert f'page          {night / "page.html"}' in (night.parent / 'stdout').read_text()
    logs = {path.name.removesuffix('.log') for path in (night / 'nodes').glob('*.log')}
    # those that wait for one another share a process
    assert logs >= PROCESSES


def test_the_report_is_of_this_night(report):
    assert report['format'] == 'telescope_mount/calibration_report' and report['version'] == 1
    assert report['stars'] == 16 and report['polaris'] == 8
    assert [zero['run'] for zero in report['zeros']] == [1, 2]
    assert all(zero['exposures'] == 4 for zero in report['zeros'])
    # too few stars for harmonics that are there to compare with, and nobody asked for
    assert not any('harmonics' in note for note in report['notes'])


def test_calibration_brings_the_held_out_error_down(report):
    held_out = [step['held_out']['radial'] for step in report['steps']]
    assert [step['step'] for step in report['steps']][::2] == [
        'raw', '7 physical terms']
    assert held_out[0] > 100 > held_out[1] > 10 > 4 > held_out[2]
    checks = report['external_check']
    assert checks[1]['radial'] < checks[0]['radial']


def test_the_measured_change_of_the_zero_is_the_simulated_one(night, report):
    change, = report['changes']
    drifts = [message.data.position for message in
              BagReader(night / 'bag_truth').messages('/mount/truth/incremental_zero', decode=True)]
    assert len(drifts) == 2
    for i, axis in enumerate(('az', 'el')):
        simulated = (drifts[1][i] - drifts[0][i]) / ARCSEC
        assert change[f'{axis}_arcsec'] == pytest.approx(
            simulated, abs=5 * change[f'sigma_{axis}_arcsec'])


def test_observations_can_be_read_back(night, report):
    run = read_run(night / 'observations.csv')
    assert len(run) == 24
    assert list(run['block']) == sorted(run['block'])
    assert np.count_nonzero(run['star'] == POLARIS_HIP) == 8
    others = run['star'][run['star'] != POLARIS_HIP]
    assert len(set(others)) == len(others)
    assert set(run['run']) == {1.0, 2.0}
    assert (np.diff(run['time']) > 0).all()
    assert np.isfinite(run['az_abs']).all()
    with open(night / 'observations.csv', newline='') as stream:
        assert 'az_enc_deg' in next(csv.reader(line for line in stream if line[0] != '#'))


def test_the_model_is_that_of_the_log(night):
    text = (night / 'model.json').read_text()
    model = PointingModel.from_json(text)
    assert set(model.terms) >= {'IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF'}
    logged = [message.data.data for message in
              BagReader(night / 'bag').messages('/mount/model', decode=True)]
    assert [entry + '\n' for entry in logged] == [text]
    # nothing of the simulation in it
    assert 'scenario' not in text and 'simulated' not in text


def test_the_log_is_complete_and_without_the_truth(night):
    bag, truth = BagReader(night / 'bag'), BagReader(night / 'bag_truth')
    for reader in (bag, truth):
        assert reader.complete and reader.problems == []
    assert not bag.has_truth and truth.has_truth
    counts = {topic.name: topic.count for topic in bag.topics}
    assert counts['/mount/observation'] == counts['/mount/offset'] == 24
    assert counts['/mount/model'] == 1
    assert counts['/mount/incremental/joint_states'] == counts['/mount/absolute/joint_states']
    true = {topic.name: topic.count for topic in truth.topics}
    assert true['/mount/truth/joint_states'] == counts['/mount/incremental/joint_states']
    assert true['/mount/truth/incremental_zero'] == 2
    # every node told how it was
    told = [status for message in bag.messages('/diagnostics', decode=True)
            for status in message.data.status]
    assert {status.name for status in told} >= {f'/mount/{name}' for name in NIGHT}
    assert max(len(status.values) for status in told) <= 15
    # log times are those of the simulated night
    assert bag.start_time == 1_768_482_000 * 10**9 < bag.end_time


def test_no_message_was_lost_or_refused(night):
    last = {}
    for message in BagReader(night / 'bag').messages('/endpoints', decode=True):
        for status in message.data.status:
            last[status.name] = {row.key: row.value for row in status.values}
    assert len(last) >= len(NIGHT)
    for name, rows in last.items():
        assert not [key for key in rows if key.startswith('refused')], (name, rows)
        assert all(value == '0' for key, value in rows.items() if key.startswith('gaps')), name


def children_of(pid):
    """Process id -> name, of the direct children of a process."""
    out = {}
    for entry in os.listdir('/proc'):
        if entry.isdigit():
            try:
                with open(f'/proc/{entry}/stat') as stat:
                    name, rest = stat.read().split('(', 1)[1].rsplit(')', 1)
            except OSError:
                continue
            if int(rest.split()[1]) == pid:
                out[int(entry)] = name
    return out


def nodes_of(pid):
    """Process id -> name (15 letters of it), of the nodes of a command line."""
    fork_server, = [child for child, name in children_of(pid).items() if name == 'fork_server']
    return children_of(fork_server)


def segments_of(pid):
    """Names in `/dev/shm` that a process has locked: its own. Ports from 7000 on are those of all
    graphs of the machine, and of other tests.
    """
    links = []
    for link in Path(f'/proc/{pid}/fd').iterdir():
        with suppress(FileNotFoundError):  # closed since it was listed
            links.append(os.readlink(link))
    return {Path(link).name for link in links if link.startswith('/dev/shm/')
            and link.endswith('_el') and '_port' not in link}


def segments_of_all(nodes, patience=30.0):
    """Those of all nodes, as soon as each has one: a loaded machine prints before that."""
    end, found = time.monotonic() + patience, set()
    while len(found) < len(PROCESSES) and time.monotonic() < end:
        found = {name for pid in nodes for name in segments_of(pid)}
        os.sched_yield()
    assert len(found) >= len(PROCESSES)
    return found


def wait_for_lines(child, text):
    """Read the child's output until a line has `text` in it."""
    for line in child.stdout:
        if text in line:
            return
    raise AssertionError(f'{text!r} never came; stderr: {child.stderr.read()}')


def test_a_killed_node_ends_the_night_with_one_line_and_a_readable_log(tmp_path):
    """In this process, and of a measured night: its graph has the fewest nodes."""
    folder = tmp_path / 'night'
    specs = measured_graph(bag=str(folder / 'bag'), player={'file': str(MMT)})
    nodes = {}

    def kill(step, done, total):  # while it diagnoses at the latest
        if done and not nodes:
            nodes.update(nodes_of(os.getpid()))
            lost, = [pid for pid, name in nodes.items() if name == 'calibration']
            os.kill(lost, signal.SIGKILL)
    with pytest.raises(NightFailed) as failed:
        observe(prepare_folder(folder), specs, 'fit, diagnose', None, kill)
    line = str(failed.value)
    assert len(line.splitlines()) == 1
    assert 'node calibration ended with code -9' in line and str(folder / 'bag') in line
    assert BagReader(folder / 'bag').complete
    assert not [pid for pid in nodes if os.path.exists(f'/proc/{pid}')]


def test_a_node_that_is_stopped_is_named_and_does_not_hold_up_the_end(tmp_path):
    folder = tmp_path / 'night'
    specs = measured_graph(bag=str(folder / 'bag'), player={'file': str(MMT)})
    nodes, named = {}, []

    def stop(step, done, total):
        if done and not nodes:
            nodes.update({name: pid for pid, name in nodes_of(os.getpid()).items()})
            os.kill(nodes['calibration'], signal.SIGSTOP)
        if 'is stopped' in step and not named:
            named.append(step)
            os.kill(os.getpid(), signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        observe(prepare_folder(folder), specs, 'fit, diagnose', None, stop)
    assert f', calibration is stopped (kill -CONT {nodes["calibration"]})' in named[0]
    assert BagReader(folder / 'bag').complete
    assert not [pid for pid in nodes.values() if os.path.exists(f'/proc/{pid}')]


def test_ctrl_c_ends_every_node_and_closes_the_log(cli, tmp_path):
    out = tmp_path / 'night'
    child = cli.start('night', '--out', out, '--stars', 4, '--polaris', 1000)
    with child:
        wait_for_lines(child, 'zero 1000')
        nodes = nodes_of(child.pid)
        assert set(nodes.values()) == PROCESSES
        segments = segments_of_all(nodes)
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=120)
    assert child.returncode == 130, err
    assert len(err.splitlines()) == 1 and 'Traceback' not in err
    bag = BagReader(out / 'bag')
    assert bag.complete and bag.problems == []
    assert not [pid for pid in nodes if os.path.exists(f'/proc/{pid}')]
    assert not segments & set(os.listdir('/dev/shm'))


def test_what_is_incomplete_on_a_full_disk_is_named_and_the_code_is_1(cli, tmp_path):
    out = tmp_path / 'night'
    # the page and the log are larger, and so are segments of shared memory: DDS does without
    limit = 40_000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    child = cli.start('night', '--out', out, '--stars', 4, '--polaris', 2,
                      preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit))
    with child:
        told, err = child.communicate(timeout=300)
    assert child.returncode == 1, err
    line = err.splitlines()[-1]
    assert line.startswith(f'error: incomplete: {out / "bag"}: recording stopped: File too large')
    assert f'; {out / "page.html"}: File too large' in line and 'model.json' not in line
    assert 'encoder − catalogue' in told and 'page.html' not in told
    assert str(out / 'model.json') in told
    assert {path.name for path in out.iterdir()} == {
        'bag', 'bag_truth', 'nodes', 'model.json', 'observations.csv', 'report.json'}
    assert BagReader(out / 'bag').topics


def test_a_terminal_that_is_closed_ends_it_in_order(cli, tmp_path):
    """As ssh does whose connection is lost: a SIGHUP, and from then on no output works."""
    out = tmp_path / 'night'
    ours, theirs = os.openpty()
    child = cli.start('night', '--out', out, '--stars', 4, '--polaris', 1000, stdin=theirs,
                      stdout=theirs, stderr=theirs, start_new_session=True,
                      preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0))
    os.close(theirs)
    told = b''
    while b'exposures' not in told:  # in the line of progress
        told += os.read(ours, 4096)
    nodes = nodes_of(child.pid)
    segments = segments_of_all(nodes)
    os.close(ours)
    assert child.wait(timeout=120) == 129
    assert not [pid for pid in nodes if os.path.exists(f'/proc/{pid}')]
    assert not segments & set(os.listdir('/dev/shm'))
    if (out / 'bag').exists():  # it had begun to observe
        assert BagReader(out / 'bag').complete


@pytest.mark.parametrize('report_stamp, model_stamp, good', [
    (2, 2, True), (1, 2, False), (2, 1, False)])
def test_results_of_an_earlier_fit_are_not_taken_for_the_last(report_stamp, model_stamp, good):
    from std_msgs.msg import String

    from msg_tools import topics
    from pointing_model.runs.run import PointingRun
    from pointing_model.runs.run_messages import run_to_cloud
    from telescope_mount.nights.whole_night import _up_to_date
    second = 10**9
    run = PointingRun({'az': [0.1, 0.2], 'el': [0.5, 0.6], 'az_enc': [0.1, 0.2],
                       'el_enc': [0.5, 0.6], 'time': [1.7e9, 1.7e9 + 1.0], 'block': [0.0, 2.0]})
    begin = 1_700_000_000 * second

    def stamp(row):
        return begin + (row - 1) * second
    latest = {
        topics.OBSERVATIONS.name: run_to_cloud(run, stamp(2)),
        topics.CALIBRATION_REPORT.name: String(data=json.dumps(
            {'last_stamp_ns': stamp(report_stamp)})),
        topics.MODEL.name: String(data=json.dumps(
            {'provenance': {'last_stamp_ns': stamp(model_stamp)}})),
    }
    assert _up_to_date(latest, ['stars', 'fit', 'stars', 'fit']) == good
    # a measured run that tells no time: its steps come once
    del run.columns['time']
    latest[topics.OBSERVATIONS.name] = run_to_cloud(run, stamp(2))
    assert _up_to_date(latest, ['fit', 'diagnose'])


def test_what_the_nodes_do_not_keep_comes_from_the_log(cli, tmp_path):
    """Four power-ons, of which observer and calibration keep two."""
    out = prepare_folder(tmp_path / 'night')
    night = 'home, stars 6, zero 2, calibrate_zero, fit'
    plan = ', power_cycle, '.join([night] * 4)
    specs = night_graph(bag=str(out / 'bag'), plan=plan, sample_rate_hz=1.0, kept_power_ons=2)
    observe(out, specs, plan, partial(write_results, out))
    run = read_run(out / 'observations.csv')
    report = json.loads((out / 'report.json').read_text())
    assert [run['run'].tolist().count(number) for number in (1, 2, 3, 4)] == [8] * 4
    assert (np.diff(run['time']) > 0.0).all()
    assert report['stars'] == 12 and [zero['run'] for zero in report['zeros']] == [3, 4]
    assert any('the last 2 power-ons' in note for note in report['notes'])
    last = list(BagReader(out / 'bag').messages(['/mount/observations'], decode=True))[-1].data
    assert last.width == 16
    # of a night that was started again, with a log that was cut short
    shutil.copytree(out / 'bag', out / 'bag_2')
    (out / 'bag_3').mkdir()
    (out / 'bag_3' / 'bag_3_0.mcap').write_bytes(b'no log')
    whole = with_rows_before(cloud_to_run(last), out)
    np.testing.assert_allclose(whole['time'], run['time'], rtol=0.0, atol=1e-6)  # as in a file
    again = cli('verify', out / 'bag')
    assert again.returncode == 0, again.stdout + again.stderr
    replayed = cli('replay', out / 'bag', '--save', tmp_path / 'model.json')
    assert replayed.returncode == 0, replayed.stderr
    assert PointingModel.load(tmp_path / 'model.json').terms == PointingModel.load(
        out / 'model.json').terms


def test_a_night_read_from_frames_is_the_same_night(night, other_night):
    """The same seed is the same night, and images over DDS and their reader give what the
    simulated encoder reads by itself.
    """
    name = 'observations.csv'
    assert (other_night / name).read_bytes() == (night / name).read_bytes()
    ours, theirs = (PointingModel.load(folder / 'model.json') for folder in (night, other_night))
    assert ours.terms == theirs.terms
    np.testing.assert_array_equal(ours.covariance, theirs.covariance)
    assert (other_night / 'nodes' / 'frame_reader.params.yaml').is_file()
    assert not (night / 'nodes' / 'frame_reader.params.yaml').exists()


def test_every_stamped_message_is_in_a_frame_of_the_urdf(night):
    links = {link.get('name') for link in ElementTree.fromstring(urdf(ALTAZ)).iter('link')}
    frames = {}
    for message in BagReader(night / 'bag').messages(decode=True):
        if hasattr(message.data, 'header'):
            frames.setdefault(message.topic, set()).add(message.data.header.frame_id)
    for name in ('/diagnostics', '/endpoints', '/mount/observer/plan/feedback'):
        assert frames.pop(name) == {''}  # of no place, as diagnostic_updater has it
    assert set().union(*frames.values()) <= links
    assert len(frames) >= 15
    assert {name for name, found in frames.items() if found == {'axes'}} == {
        '/mount/zero/pose', '/mount/absolute/pose'}
    assert {name for name, found in frames.items() if found == {'boresight_optical'}} == {
        '/mount/camera/miss_distance', '/mount/offset', '/mount/calibration/residual'}
