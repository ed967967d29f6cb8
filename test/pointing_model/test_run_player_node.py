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

from importlib import resources

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.units import DEG
from pointing_model.run_player_node import FIRST_NAMED, NO_TIME, RunPlayer, playable
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import cloud_to_run
from pointing_model.runs.run_reader import read_run

MMT = resources.files('calibration') / 'data' / 'mmt_2021-08-21.csv'


def run(n=10, **more):
    az = np.linspace(10, 300, n) * DEG
    return PointingRun({'az': az, 'el': np.full(n, 50 * DEG), 'az_enc': az + 1e-4,
                        'el_enc': np.full(n, 50.01 * DEG), **more})


# --- what a topic can carry ---------------------------------------------------------------------


def test_a_measured_night_becomes_rows():
    night = read_run(MMT)
    rows, stamps, left_out = playable(night, 4, 1)
    assert left_out == [] and len(rows) == 80
    assert np.all(np.diff(stamps) > 0)
    np.testing.assert_allclose(stamps * 1e-9, night['time'], atol=1e-6)
    for name in ('az', 'el', 'az_enc', 'el_enc', 'az_abs', 'time', 'magnitude'):
        np.testing.assert_array_equal(rows[name], night[name])
    # names become numbers, one for each star, none of them a catalogue's
    assert rows['star'].dtype.kind == 'f' and rows['star'].min() >= FIRST_NAMED
    assert len(np.unique(rows['star'])) == len(np.unique(night['star']))
    assert np.all(rows['run'] == 1.0) and np.all(rows['block'] == 0.0)


def test_one_row_in_four_is_kept_out_all_along_the_night():
    rows, _, _ = playable(run(80), 4, 1)
    kept = rows['check'].reshape(20, 4)
    np.testing.assert_array_equal(kept.sum(axis=1), 1.0)
    assert len(set(map(tuple, kept))) > 1  # and not always the same of the four
    other = playable(run(80), 4, 2)[0]['check']
    assert np.any(other != rows['check'])
    assert not playable(run(80), 0, 1)[0]['check'].any()
    own = np.arange(10.0) % 2
    np.testing.assert_array_equal(playable(run(10, check=own), 4, 1)[0]['check'], own)


def test_what_a_run_does_not_tell():
    rows, stamps, left_out = playable(run(3, note=np.array(['a', 'b', 'c'])), 0, 1)
    assert left_out == ['note']
    np.testing.assert_array_equal(stamps, NO_TIME + 10**9 * np.arange(3))
    assert len(np.unique(rows['star'])) == 3 and 'time' not in rows
    same = run(4, time=np.array([1.6e9, 1.6e9, 1.5e9, 1.7e9]))
    stamps = playable(same, 0, 1)[1]
    assert np.all(np.diff(stamps) > 0) and stamps[-1] == 1_700_000_000 * 10**9
    unusable = run(2, time=np.array([1.6e9, np.nan]))
    assert playable(unusable, 0, 1)[1][0] == NO_TIME
    offsets = run(2)
    offsets.meta['raw_reading'] = False
    assert np.isnan(playable(offsets, 0, 1)[0]['az_raw']).all()


# --- the node -----------------------------------------------------------------------------------


class Desk:
    """A run player under test, and a calibration of the test that says what it has."""

    def __init__(self, graph, file, refuse=None, **overrides):
        self.graph, self.asked = graph, []
        self.rows = graph.listen(topics.OBSERVATION)
        self.tables = graph.listen(topics.OBSERVATIONS)
        self.clock = graph.listen(topics.CLOCK)
        self.status = graph.listen(topics.OBSERVER_STATUS)
        self.said = graph.publisher(topics.CALIBRATION_STATUS)
        for name in ('fit', 'diagnose'):
            graph.service(name, lambda name=name: (
                self.asked.append((name, len(self.rows))) is None and name != refuse,
                f'{name} it is'))
        self.node = graph.add(RunPlayer, file=str(file), **overrides)

    def value(self, key):
        return {row.key: row.value for row in self.status[-1].values}[key] if self.status else ''

    def take(self, count, **taken):
        self.graph.wait_for(lambda: len(self.rows) == count)
        assert self.asked == []  # nothing is asked before all rows have been taken
        self.said.publish(convert.status(
            DiagnosticStatus.OK, 'calibration', '', **{'observations': count, **taken}))


def test_a_run_is_published_then_fitted_then_diagnosed(graph, tmp_path):
    write_csv(run(12, time=1.7e9 + 60.0 * np.arange(12)), tmp_path / 'run.csv')
    desk = Desk(graph, tmp_path / 'run.csv', check_every=3)
    desk.take(12)
    graph.wait_for(lambda: desk.value('state') == 'done')
    assert desk.asked == [('fit', 12), ('diagnose', 12)]
    got = PointingRun.concatenate([cloud_to_run(message) for message in desk.rows])
    np.testing.assert_allclose(got['az_enc'], run(12)['az_enc'], rtol=0, atol=1e-15)
    assert got['check'].sum() == 4
    stamps = [convert.from_stamp(message.header.stamp) for message in desk.rows]
    np.testing.assert_allclose(np.array(stamps) * 1e-9, got['time'], atol=1e-6)
    assert desk.clock and convert.from_stamp(desk.clock[-1].clock) == stamps[-1]
    graph.wait_for(lambda: desk.tables)
    assert desk.tables[-1].width == 12
    assert desk.value('observations') == '12'
    graph.report('run_player', '', 'kept out', 4)


def test_a_logger_that_takes_the_rows_is_no_calibration(graph, tmp_path):
    write_csv(run(5), tmp_path / 'run.csv')
    rows, status = graph.listen(topics.OBSERVATION), graph.listen(topics.OBSERVER_STATUS)
    graph.add(RunPlayer, file=str(tmp_path / 'run.csv'))
    graph.report('run_player', 'a publisher of /mount/calibration/status')
    assert not rows and status[-1].message == 'the graph'
    graph.publisher(topics.CALIBRATION_STATUS)
    graph.wait_for(lambda: len(rows) == 5)


def test_a_calibration_that_keeps_the_last_power_ons_alone_has_taken_all(graph, tmp_path):
    write_csv(run(12, run=np.repeat([1.0, 2.0, 3.0], 4)), tmp_path / 'run.csv')
    desk = Desk(graph, tmp_path / 'run.csv')
    desk.take(12, observations=8, kept_power_ons=2)
    graph.wait_for(lambda: desk.value('state') == 'done')
    assert desk.asked == [('fit', 12), ('diagnose', 12)]


def test_a_calibration_that_refuses_ends_it_with_the_reason(graph, tmp_path):
    write_csv(run(5), tmp_path / 'run.csv')
    desk = Desk(graph, tmp_path / 'run.csv', refuse='fit')
    desk.take(5)
    graph.wait_for(lambda: desk.value('state') == 'failed')
    assert desk.status[-1].message == 'fit: fit it is'
    assert [name for name, _ in desk.asked] == ['fit']
    graph.report('run_player', 'fit: fit it is')


def test_what_is_no_run_is_refused(graph, tmp_path):
    with pytest.raises(ValueError, match='parameter file is empty'):
        graph.add(RunPlayer)
    with pytest.raises(OSError):
        graph.add(RunPlayer, file=str(tmp_path / 'absent.csv'))
    (tmp_path / 'text.csv').write_text('this is no run\n')
    with pytest.raises(ValueError, match='is not a pointing run'):
        graph.add(RunPlayer, file=str(tmp_path / 'text.csv'))
