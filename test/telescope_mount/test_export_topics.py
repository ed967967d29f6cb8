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

import csv
import struct
import sys
from types import SimpleNamespace

import pytest
from places import ROOT

from msg_tools.bag import BagWriter
from msg_tools.cloud_tables import cloud_points
from telescope_mount.cli import main
from telescope_mount.commands.export import export_run, export_topics, time_of
from telescope_mount.input_files.run_loader import load_run

START = 1_768_482_000_000_000_000  # 2026-01-15T13:00:00
JOINTS = b"""int32 id
string name
float64[] position
uint8[100] raw
Inner inner
================================================================================
MSG: odd_msgs/Inner
bool good
"""


def joints(i, n):
    return (b'\0\1\0\0' + struct.pack('<iI', i, 3) + b'a,\0' + bytes(1) + struct.pack('<I', n)
            + struct.pack(f'<{n}d', *(0.1 * (i + k) for k in range(n))) + bytes(100) + b'\1')


@pytest.fixture
def log(tmp_path):
    with BagWriter(tmp_path / 'log') as writer:
        for name in ('/mount/joints', '/mount/other'):
            writer.add_foreign_topic(name, 'odd_msgs/msg/Joints', [], JOINTS, '')
        for i in range(20):
            writer.write('/mount/joints', joints(i, 2 + i % 2), START + i * 10**9, START + i, i)
    return tmp_path / 'log'


def rows_of(path):
    with open(path, newline='') as stream:
        return list(csv.DictReader(stream))


def test_every_number_of_a_topic(log, tmp_path):
    files, problems = export_topics(log, tmp_path / 'out', ['joints', '/mount/other'])
    assert problems == []
    assert {path.name: rows for path, rows in files.items()} == {
        'mount_joints.csv': 20, 'mount_other.csv': 0}
    rows = rows_of(tmp_path / 'out' / 'mount_joints.csv')
    assert list(rows[0]) == ['log_time_ns', 'publish_time_ns', 'id', 'name', 'position[0]',
                             'position[1]', 'raw.length', 'inner.good', 'position[2]']
    assert [int(row['id']) for row in rows] == list(range(20))
    assert int(rows[3]['log_time_ns']) == START + 3 * 10**9
    assert float(rows[3]['position[1]']) == 0.1 * 4  # every digit
    assert (rows[4]['position[2]'], float(rows[5]['position[2]'])) == ('', 0.1 * 7)
    assert rows[0]['name'] == 'a,' and rows[0]['raw.length'] == '100'


@pytest.mark.parametrize('span, expected', [
    (('5', '8'), [5, 6, 7]),
    (('2026-01-15T13:00:17Z', None), [17, 18, 19]),
    ((None, '2026-01-15T13:00:02'), [0, 1]),
    (('2026-01-15T14:00:01+01:00', '2.5'), [1, 2]),
])
def test_span(log, tmp_path, span, expected):
    (path,), _ = export_topics(log, tmp_path / 'out', ['joints'], start=span[0], end=span[1])
    assert [int(row['id']) for row in rows_of(path)] == expected


def test_times():
    assert time_of('1.5', 7) == 1_500_000_007
    assert time_of('2026-01-15T13:00:00.25', 0) == START + 250_000_000
    for text in ('nan', 'noon', ''):
        with pytest.raises(ValueError, match='write seconds'):
            time_of(text, 0)


def test_parquet(log, tmp_path, monkeypatch):
    parquet = pytest.importorskip('pyarrow.parquet')
    (path,), _ = export_topics(log, tmp_path / 'out', ['joints'], form='parquet')
    table = parquet.read_table(path).to_pydict()
    assert table['id'] == list(range(20)) and table['name'] == ['a,'] * 20
    assert table['position[2]'][4:6] == [None, 0.1 * 7] and table['inner.good'] == [True] * 20


def test_parquet_of_a_run_has_the_columns_of_its_csv(tmp_path):
    parquet = pytest.importorskip('pyarrow.parquet')
    source = tmp_path / 'run.csv'
    source.write_text('time,az_deg,el_deg,az_enc_deg,el_enc_deg,temperature_c\n'
                      '2026-01-15T13:00:00.25Z,10,50,10.5,50.5,3\n,200,40,200.5,40.5,\n')
    assert main(['export', str(source), str(tmp_path / 'run.parquet')]) == 0
    table = parquet.read_table(tmp_path / 'run.parquet').to_pydict()
    assert table['az_deg'] == pytest.approx([10.0, 200.0], abs=1e-12)
    assert table['el_enc_deg'] == pytest.approx([50.5, 40.5], abs=1e-12)
    assert [one and one.isoformat() for one in table['time']] == [
        '2026-01-15T13:00:00.250000+00:00', None]


def test_parquet_that_is_not_installed_is_one_line(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    for args in (['--topics', 'joints', '--format', 'parquet', str(tmp_path / 'out')],
                 [str(tmp_path / 'run.parquet')]):
        assert main(['export', str(log), *args]) == 2
        assert capsys.readouterr().err == (
            'error: Parquet needs the package pyarrow, which is not installed: pip install '
            'pyarrow, or write CSV\n')
    assert not (tmp_path / 'run.parquet').exists()


def test_command_and_what_is_refused(log, tmp_path, capsys):
    assert main(['export', str(log), str(tmp_path / 'out'), '--topics', 'joints',
                 '--end', '4']) == 0
    assert '4 rows: ' in capsys.readouterr().out
    for args, words in ((['--topics', 'joints'], 'is there already'),
                        (['--topics', 'nothing'], 'is no topic of'),
                        (['--topics', 'joints', '--start', '9', '--end', '8'], 'not after'),
                        (['--topics', 'joints', '--start', 'x'], 'write seconds')):
        assert main(['export', str(log), str(tmp_path / 'out'), *args]) == 2
        error = capsys.readouterr().err
        assert words in error and error.count('\n') == 1


def test_observations_of_a_span(tmp_path):
    run = tmp_path / 'run.csv'
    lines = [f'2026-01-15T13:00:{i:02d}Z,{10 * i},45,{10 * i},45' for i in range(20)]
    run.write_text('time,az_deg,el_deg,az_enc_deg,el_enc_deg\n' + '\n'.join(lines) + '\n')
    written = export_run(run, tmp_path / 'part.csv', start='5', end='2026-01-15T13:00:08')
    assert len(written) == 3
    assert len(rows_of(tmp_path / 'part.csv')) == 3
    with pytest.raises(ValueError, match='no observation from 500'):
        export_run(run, tmp_path / 'none.csv', start='500')


def test_points_of_a_cloud_are_rows_and_a_span_without_messages_is_refused(tmp_path, capsys):
    log, out = ROOT / 'examples' / 'night' / 'bag', tmp_path / 'out'
    (path,), problems = export_topics(log, out, ['observation'])
    rows, run = rows_of(path), load_run(log)
    assert problems == [] and len(rows) >= len(run)
    assert {'log_time_ns', 'header.stamp.sec', 'az', 'el', 'az_enc', 'star'} <= set(rows[0])
    assert not any(name.startswith('fields') or name == 'data.length' for name in rows[0])
    assert set(run['az'].tolist()) <= {float(row['az']) for row in rows}
    assert main(['export', str(log), str(tmp_path / 'none'), '--topics', 'observation',
                 '--start', '99999']) == 2
    assert 'has no message of observation from 99999 to its end' in capsys.readouterr().err
    assert not (tmp_path / 'none').exists()


def test_clouds_of_all_kinds_of_fields():
    def field(name, offset, datatype, count=1):
        return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)
    cloud = SimpleNamespace(
        width=2, height=1, point_step=16, is_bigendian=True, data=2 * struct.pack(
            '>hBb3f', -2, 200, -1, 1.0, 2.0, 3.0),
        fields=[field('a', 0, 3), field('b', 2, 2), field('c', 3, 1), field('d', 4, 7, 3)])
    points = cloud_points(cloud)
    assert points['a'].tolist() == [-2, -2] and points['b'].tolist() == [200, 200]
    assert points['c'].tolist() == [-1, -1] and points['d'].tolist() == 2 * [[1.0, 2.0, 3.0]]
    for wrong in (field('e', 12, 8), field('e', 0, 9), field('e', 0, 7, 2**31)):
        with pytest.raises(ValueError):
            cloud_points(SimpleNamespace(**{**vars(cloud), 'fields': [wrong]}))
