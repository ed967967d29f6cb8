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

"""Loading and exporting runs: files, logs, several of them."""


import numpy as np
import pytest
from mcap.writer import Writer
from places import CASES

from calibration.analysis.term_fit import fit_terms
from msg_tools.bag import BagReader, BagWriter
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import centred
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import cloud_to_run
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.star_catalogue import POLARIS_HIP
from pointing_model.zero import PowerOnZero
from telescope_mount.cli import main
from telescope_mount.commands.export import export_run
from telescope_mount.input_files.run_loader import _power_ons, _readings, load_run, load_runs
from telescope_mount.log_check.log_check import verify_log

HEADER = 'az_deg,el_deg,az_enc_deg,el_enc_deg\n'
ROWS = HEADER + '10,20,10.1,20.1\n350,40,350.2,40.2\n100,60,100.3,60.3\n'


def test_a_file_is_read_with_its_options(tmp_path):
    path = tmp_path / 'run.csv'
    path.write_text(ROWS)
    assert load_run(str(path))['az'][0] == pytest.approx(10 * DEG)
    assert load_run(path, azimuth_origin='S')['az'][0] == pytest.approx(170 * DEG)
    with pytest.raises(ValueError, match='no column az_abs_deg'):
        load_run(path, encoder='abs')


def test_several_runs(tmp_path):
    names = ['a.csv', 'empty.csv', 'b.csv']
    for name, text in zip(names, (ROWS, HEADER, ROWS.replace('\n', '\n2', 3))):
        (tmp_path / name).write_text(text)
    runs, empty = load_runs([tmp_path / name for name in names])
    assert [run['az'][0] / DEG for run in runs] == pytest.approx([10, 210])
    assert len(empty) == 1 and 'empty.csv' in empty[0] and 'no observations' in empty[0]
    with pytest.raises(ValueError, match='no observations'):
        load_runs([tmp_path / 'empty.csv'])
    # one that is no run does not end all
    (tmp_path / 'b.csv').write_text('nonsense')
    paths = [tmp_path / name for name in (*names, 'gone.csv')]
    runs, left_out = load_runs(paths)
    assert len(runs) == 1 and len(left_out) == 3
    assert 'b.csv is not a pointing run' in left_out[1] and 'gone.csv' in left_out[2]
    assert all(line.endswith('(file left out)') for line in left_out[1:])
    with pytest.raises(ValueError, match=r'none of 2 files .*b\.csv is not a pointing run'):
        load_runs([tmp_path / 'b.csv', tmp_path / 'empty.csv'])


def test_what_is_declared_goes_with_the_run(tmp_path):
    path = tmp_path / 'run.csv'
    path.write_text('az_deg,el_deg,az_enc_deg,el_enc_deg,row,flag\n10,20,10.1,20.1,3,4\n')
    run = load_run(path, graduation='grating=47200,el.bars=1080', drivers=['row'])
    assert run.meta['graduation'] == {'az': {'grating': 47200},
                                      'el': {'grating': 47200, 'bars': 1080}}
    assert run.meta['drivers'] == ('column_row',)
    with pytest.raises(ValueError, match='no column wind to take as a cause.*flag'):
        load_run(path, drivers=['wind'])
    with pytest.raises(ValueError, match='number of lines'):
        load_run(path, graduation='grating=27.5')


@pytest.mark.parametrize('beyond', [False, True])
def test_raw_readings_are_those_that_the_miss_distance_moves(beyond):
    rng = np.random.default_rng(5)
    az, el = rng.uniform(-7, 7, 50), rng.uniform(0.1, 1.55, 50)
    el = np.pi - el if beyond else el
    miss = rng.normal(size=(2, 50)) * 100 * ARCSEC
    az_enc, el_enc = centred(az, el, *miss, beyond)
    columns = {'az_enc': az_enc, 'el_enc': el_enc, 'miss_x': miss[0], 'miss_y': miss[1]}
    got = _readings(columns, np.full(50, beyond))
    assert np.abs(got[0] - az).max() < 1e-6 * ARCSEC
    assert np.abs(got[1] - el).max() < 1e-6 * ARCSEC


def test_export_is_not_written_over_its_source(refused, tmp_path):
    path = tmp_path / 'run.csv'
    path.write_text(ROWS)
    for words in ((), ('--overwrite',)):
        line = refused('export', path, tmp_path / '.' / 'run.csv', *words)
        assert 'is the input itself' in line
    assert path.read_text() == ROWS


def test_a_run_with_readings_comes_back(tmp_path):
    run = PointingRun({'az': [0.1, 3.0], 'el': [0.5, 1.0], 'az_enc': [0.1, 3.0],
                       'el_enc': [0.5, 1.0], 'az_raw': [6.1, 9.0], 'el_raw': [0.6, 1.1]})
    write_csv(run, tmp_path / 'run.csv')
    assert 'az_raw_deg,el_raw_deg' in (tmp_path / 'run.csv').read_text()
    assert read_run(tmp_path / 'run.csv')['az_raw'] == pytest.approx([6.1, 9.0], abs=1e-15)


def test_copies_by_the_hundred_are_told_in_few_lines(tmp_path, capsys):
    header, *rows = ROWS.split()
    (tmp_path / 'run.csv').write_text('\n'.join([header, *rows * 100]) + '\n')
    assert main(['export', str(tmp_path / 'run.csv'), str(tmp_path / 'out.csv')]) == 0
    out = capsys.readouterr().out
    assert f'({99} rows) left out: the same as line 2' in ' '.join(out.split())
    assert len(out.splitlines()) < 30


# --------------------------------------------------------------------------- a log of a night

@pytest.mark.usefixtures('ros_domain')
def test_an_exported_log_gives_the_same_fit(night, tmp_path):
    run = export_run(night / 'bag', tmp_path / 'log.csv')
    back = load_run(tmp_path / 'log.csv')
    assert len(run) == len(back) == 16 and set(run.columns) == set(back.columns)
    assert not np.any(back['star'] == POLARIS_HIP)
    assert np.array_equal(run['time'], back['time'])
    assert np.array_equal(run['approach_az'], back['approach_az'])
    for robust in (True, False):
        mine, theirs = (fit_terms(r, ('IA', 'IE', 'CA', 'AN', 'AW'), robust=robust)
                        for r in (run, back))
        assert np.abs(mine.coefficients - theirs.coefficients).max() < 1e-9 * ARCSEC
        assert np.abs(mine.residual_x - theirs.residual_x).max() < 1e-9 * ARCSEC
        assert np.abs(mine.residual_y - theirs.residual_y).max() < 1e-9 * ARCSEC


@pytest.mark.usefixtures('ros_domain')
def test_a_log_has_the_skyline_of_its_guard_and_the_site_of_its_observer(
        monkeypatch, tmp_path, night):
    told = {'calibration': {'horizon': '', 'graduation': 'grating=47200'},
            'mount_guard': {'horizon': '0 10, 90 60'},
            'star_observer': {'latitude_deg': 30.0, 'longitude_deg': 90.0, 'height_m': 500.0}}
    monkeypatch.setattr('msg_tools.bag.bag_pair.parameters_of',
                        lambda metadata, name: told[name.rpartition('/')[2]])
    run = load_run(night / 'bag')
    assert np.degrees(run.meta['skyline']) == pytest.approx(np.array([[0, 10], [90, 60]]))
    assert run.meta['graduation']['az'] == {'grating': 47200}
    assert run.meta['site'] == {
        'latitude': 30.0 * DEG, 'longitude': 90.0 * DEG, 'height': 500.0}
    run = load_run(night / 'bag', site={'latitude': 0.5})
    assert (run.meta['site']['latitude'], run.meta['site']['longitude']) == (0.5, 90.0 * DEG)
    told['mount_guard']['horizon'] = str(tmp_path / 'absent.txt')
    run = load_run(night / 'bag')
    assert 'skyline' not in run.meta and 'absent.txt not found' in run.meta['notes'][-1]


@pytest.mark.usefixtures('ros_domain')
def test_satellites_of_a_log_are_no_stars(monkeypatch, night):
    stars = load_run(night / 'bag')['star']

    def with_a_satellite(data):
        run = cloud_to_run(data)
        run.columns['star'] = np.where(run['star'] == stars[3], -22195, run['star'])
        return run
    monkeypatch.setattr('telescope_mount.input_files.run_loader.cloud_to_run', with_a_satellite)
    run = load_run(night / 'bag')
    assert len(run) == 15 and run['star'].min() > 0
    assert '1 exposures of satellites left out: "satellite" fits them' in run.meta['notes']
    assert -22195 in load_run(night / 'bag', satellites=True)['star']


@pytest.mark.usefixtures('ros_domain')
def test_a_log_keeps_what_the_encoders_read(night):
    run = load_run(night / 'bag')
    assert run.meta['graduation'] == {'az': {'grating': 47200}, 'el': {'grating': 47200}}
    az, el = centred(run['az_raw'], run['el_raw'], run['miss_x'], run['miss_y'])
    # the zero of each power-on is all that is taken off
    for number in np.unique(run['run']):
        rows = run['run'] == number
        assert np.ptp((el - run['el_enc'])[rows]) < 1e-6 * ARCSEC
    assert np.abs(run['miss_x']).max() > ARCSEC
    swapped = load_run(night / 'bag', encoder='abs')
    assert np.array_equal(swapped['el_enc'], run['el_abs']) and 'az_raw' not in swapped


@pytest.mark.usefixtures('ros_domain')
def test_power_ons_of_several_nights_with_one_number_keep_their_zeros():
    run = PointingRun({'run': np.array([1, 2, 1, 2]), 'az': np.zeros(4), 'el': np.zeros(4),
                       'az_enc': np.zeros(4), 'el_enc': np.zeros(4),
                       'encoder_start': 1.768e9 + np.array([0.1234, 100.0, 9e4, 9.1e4])}, {})
    zeros = {(n, round(t, 3)): PowerOnZero(float(i), 0.0, run=int(n), started=round(t, 3))
             for i, (n, t) in enumerate(zip(run['run'], run['encoder_start']))}
    notes = []
    numbered, of = _power_ons(run, zeros, notes)
    assert numbered['run'].tolist() == [1, 2, 3, 4] and '4 power-ons share 2 numbers' in notes[0]
    assert of.row_angles(numbered)[0].tolist() == [0.0, 1.0, 2.0, 3.0]
    same, of = _power_ons(run.select(slice(2)), zeros, notes)
    assert same['run'].tolist() == [1, 2] and len(notes) == 1


def test_the_newest_zero_of_each_power_on_is_taken_off(night):
    zeros = [message.data.position for message in
             BagReader(night / 'bag').messages('/mount/zero', decode=True)]
    run, logged = load_run(night / 'bag'), read_run(night / 'observations.csv')
    logged = logged.select(logged['star'] != POLARIS_HIP)
    assert len(zeros) == 3  # that of power-on 2 once more, against the fit
    for number, zero in ((1, zeros[0]), (2, zeros[-1])):
        rows = run['run'] == number
        for axis, value in zip(('az', 'el'), zero):
            taken = wrap(logged[f'{axis}_enc'] - run[f'{axis}_enc'])[rows] / ARCSEC
            assert taken == pytest.approx(np.full(8, value / ARCSEC), abs=1e-6)


def renamed(log, folder, *prefixes):
    """A log as it is recorded in other namespaces, with the parameters of its nodes."""
    log = BagReader(log)
    with BagWriter(folder) as new:
        for prefix in prefixes:
            for name, values in log.metadata.items():
                if name.startswith('parameters /mount/'):
                    new.add_metadata(name.replace('/mount/', prefix), values)
            for topic in log.topics:
                definition = log.schema_of(topic.name, topic.type)[0].data
                new.add_foreign_topic(topic.name.replace('/mount/', prefix), topic.type, topic.qos,
                                      definition, topic.type_hash)
            for message in log.messages():
                new.write(message.topic.replace('/mount/', prefix), message.data,
                          message.log_time, message.publish_time, message.sequence)
    return folder


def test_a_log_of_any_namespace_is_read_and_one_of_two_mounts_is_refused(night, tmp_path, refused):
    here = load_run(night / 'bag')
    for number, prefix in enumerate(('/dome/east/', '/')):
        log = renamed(night / 'bag', tmp_path / str(number), prefix)
        there = load_run(log)
        assert there.meta['notes'] == here.meta['notes']
        for name in here.columns:
            assert np.array_equal(here[name], there[name], equal_nan=True), name
        report = verify_log(log)
        assert report['checked']['model'] and not report['differences']
    log = renamed(night / 'bag', tmp_path / 'both', '/a/', '/b/')
    for command in ('fit', 'verify', 'replay', 'diagnose'):
        assert 'observations of 2 mounts, /a/observation and /b/observation' in refused(
            command, log)


def test_a_log_that_is_not_encoded_as_ros_2_is_named(tmp_path, refused):
    with open(tmp_path / 'log.mcap', 'wb') as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema('sensor_msgs/msg/PointCloud2', 'jsonschema', b'{}')
        channel = writer.register_channel('/mount/observation', 'json', schema)
        writer.add_message(channel, 10**18, b'{}', 10**18)
        writer.finish()
    for command in ('fit', 'verify', 'replay', 'watch'):
        assert 'of /mount/observation are encoded as json; only those of ROS 2' in refused(
            command, tmp_path / 'log.mcap')


def test_the_truth_is_refused(night):
    with pytest.raises(ValueError, match='truth of the simulator'):
        load_run(night / 'bag_truth')


def test_what_a_lying_camera_found_is_left_out_of_a_log(tmp_path):
    serialization = pytest.importorskip('rclpy.serialization', exc_type=ImportError)
    from msg_tools.topics import OBSERVATION
    from pointing_model.runs.run_messages import run_to_cloud
    rng = np.random.default_rng(7)
    miss = rng.normal(size=(2, 20)) * ARCSEC
    miss[:, 12:] = 0.0
    with BagWriter(tmp_path / 'log') as writer:
        writer.add_topic('/mount/observation', OBSERVATION.type, [{'depth': 100}])
        for i in range(20):
            run = PointingRun({name: np.array([value]) for name, value in {
                'az': 0.3 * i, 'el': 0.8, 'az_enc': 0.3 * i, 'el_enc': 0.8, 'run': 1.0,
                'star': 100.0 + i, 'time': 1e9 + i, 'encoder_start': 1e9, 'miss_x': miss[0, i],
                'miss_y': miss[1, i]}.items()})
            writer.write('/mount/observation', serialization.serialize_message(
                run_to_cloud(run, 10**18 + i)), 10**18 + i, 10**18 + i, i + 1)
    run = load_run(tmp_path / 'log')
    assert len(run) == 12
    assert any(note.startswith('8 of 20 observations left out, rows 12 to 19')
               for note in run.meta['notes'])


def test_a_log_that_recorded_what_another_played_has_each_observation_once(tmp_path):
    serialization = pytest.importorskip('rclpy.serialization', exc_type=ImportError)
    from msg_tools.topics import OBSERVATION
    from pointing_model.runs.run_messages import run_to_cloud
    rng = np.random.default_rng(8)
    az, el = rng.uniform(0.0, 6.0, 60), rng.uniform(0.3, 1.4, 60)
    rows = [PointingRun({name: np.array([value]) for name, value in {
        'az': az[i], 'el': el[i], 'az_enc': az[i] + 1e-4, 'el_enc': el[i] - 1e-4, 'run': 1.0,
        'star': 100.0 + i, 'time': 1e9 + 60.0 * i}.items()}) for i in range(60)]
    for name, times in (('log', 1), ('recorded', 2)):
        with BagWriter(tmp_path / name) as writer:
            writer.add_topic('/mount/observation', OBSERVATION.type, [{'depth': 100}])
            for i, row in enumerate(row for row in rows for _ in range(times)):
                writer.write('/mount/observation', serialization.serialize_message(
                    run_to_cloud(row, 10**18 + i)), 10**18 + i, 10**18 + i, i + 1)
    whole, run = load_run(tmp_path / 'log'), load_run(tmp_path / 'recorded')
    assert len(run) == len(whole) == 60
    assert any(note.startswith('60 of 120 rows are duplicates') for note in run.meta['notes'])
    np.testing.assert_array_equal(run['az_enc'], whole['az_enc'])
    write_csv(whole, tmp_path / 'whole.csv', plain=True)
    runs, notes = load_runs([tmp_path / 'whole.csv', tmp_path / 'log', tmp_path / 'recorded'])
    assert [len(run) for run in runs] == [60] and len(notes) == 2
    with pytest.raises(ValueError, match='give other observations to validate with'):
        load_runs([tmp_path / 'recorded'], runs)


@pytest.mark.skipif(not CASES.is_dir(), reason='the small inputs are not there')
def test_a_row_in_a_leap_second_of_another_year_is_left_out_by_name():
    run = load_run(CASES / 'time_leap60.csv')
    (left,) = run.meta['excluded']
    assert len(run) == 59 and left['row'] == 8 and 'deg from where the encoders' in left['reason']
