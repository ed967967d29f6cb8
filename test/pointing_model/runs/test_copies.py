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

"""Observations that are written twice count once, and honest ones of one star are kept."""


import numpy as np
import pytest
from places import CASES

from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.copies import copies, without_copies
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

START = 1772539800.0


def night(n=60, seed=1, source='one.csv', digits=7, timed=True):
    """Observations as a file has them."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0.0, 360.0, n), rng.uniform(15.0, 80.0, n)
    columns = {'az': az, 'el': el, 'az_enc': az + rng.normal(size=n) * 0.02,
               'el_enc': el + rng.normal(size=n) * 0.02}
    columns = {name: np.round(values, digits) * DEG for name, values in columns.items()}
    if timed:
        columns['time'] = np.round(START + np.cumsum(rng.uniform(30.0, 300.0, n)), 3)
    return PointingRun(columns, {'source': source, 'lines': np.arange(2, n + 2)})


def rounded(run, digits=None, time_digits=None, chop=False):
    """The same written with fewer digits, rounded or cut off."""
    columns = dict(run.columns)
    cut = np.floor if chop else np.rint
    if digits is not None:
        for name in ('az', 'el', 'az_enc', 'el_enc'):
            columns[name] = cut(columns[name] / DEG * 10.0**digits) / 10.0**digits * DEG
    if time_digits is not None:
        columns['time'] = cut(columns['time'] * 10.0**time_digits) / 10.0**time_digits
    return PointingRun(columns, {**run.meta, 'source': 'two.csv'})


@pytest.mark.parametrize('timed', [True, False], ids=['timed', 'without time'])
@pytest.mark.parametrize('digits, time_digits, chop', [
    (None, None, False), (6, None, False), (4, 0, False), (4, 0, True), (3, 0, True), (5, 1, True)])
def test_a_night_written_with_fewer_digits_counts_once(timed, digits, time_digits, chop):
    one = night(timed=timed)
    two = rounded(one, digits, time_digits if timed else None, chop)
    kept, notes = without_copies([one, two])
    assert [len(run) for run in kept] == [60] and kept[0] is one
    assert notes == ['two.csv left out: all 60 rows are also in one.csv']
    assert len(without_copies([two, one])[0]) == 1


def test_times_in_whole_minutes_are_those_of_the_night():
    one = night()
    two = PointingRun({**one.columns, 'time': np.floor(one['time'] / 60.0) * 60.0}, one.meta)
    assert len(without_copies([one, two])[0]) == 1


def test_a_part_that_another_file_has_is_left_out_by_line():
    one, other = night(), night(20, seed=2, source='more.csv')
    both = PointingRun.concatenate([one.select(np.arange(12)), other])
    both.meta = {'source': 'more.csv', 'lines': np.arange(2, 34)}
    kept, notes = without_copies([one, both])
    assert [len(run) for run in kept] == [60, 20]
    assert notes == ['more.csv: 12 of 32 rows excluded: they are also in one.csv']
    assert [e['row'] for e in kept[1].meta['excluded']] == list(range(2, 14))
    assert kept[1].lines.tolist() == list(range(14, 34))
    np.testing.assert_array_equal(kept[1]['az'], other['az'])


def test_observations_that_judge_others_are_not_among_them():
    one = night()
    held, _ = without_copies([night(30, seed=3), one.select(np.arange(5))], [one])
    assert [len(run) for run in held] == [30]
    with pytest.raises(ValueError, match='all 60 rows are also in one.csv; give other'):
        without_copies([rounded(one)], [one])


@pytest.mark.parametrize('step, digits, noise', [(1.0, 7, 0.5), (3.0, 4, 0.5), (5.0, 3, 0.3),
                                                 (2.0, 4, 0.0)])
@pytest.mark.parametrize('rate', [15.0, 0.3, 0.0], ids=['star', 'Polaris', 'standing'])
def test_honest_exposures_of_one_place_seconds_apart_are_kept(step, digits, noise, rate):
    """A mount that stands, without noise, reads the same: the time tells them."""
    rng = np.random.default_rng(4)
    t = np.arange(200) * step
    az, el = 80.0 + rate * t / 3600.0, 40.0 + 0.5 * rate * t / 3600.0
    run = PointingRun({'time': START + t, **{
        name: np.round(v + noise * rng.normal(size=200) / 3600.0, digits) * DEG
        for name, v in (('az', az), ('el', el), ('az_enc', az + 0.1), ('el_enc', el - 0.1))}})
    assert (copies(run) == -1).all()


def test_honest_nights_without_time_are_kept():
    rng = np.random.default_rng(5)
    n = 4000  # of encoders that read to 0.36 arcsec, ten stars again and again
    az, el = (np.tile(np.round(rng.uniform(20, 70, 10), 4), n // 10) for _ in range(2))
    run = PointingRun({'az': az * DEG, 'el': el * DEG,
                       'az_enc': az * DEG + 5.0 * ARCSEC * rng.normal(size=n),
                       'el_enc': el * DEG + 5.0 * ARCSEC * rng.normal(size=n)})
    assert (copies(run) == -1).all()


def test_last_digits_that_are_zeros_by_chance_are_no_fewer_digits():
    """A slow axis without a time, read to 0.36 arcsec: one row in ten ends in zero."""
    az = np.round(30.0 + 3e-4 * np.arange(500), 4) * DEG
    run = PointingRun({'az': az, 'el': np.full(500, 40.0 * DEG), 'az_enc': az + 0.1 * DEG,
                       'el_enc': np.full(500, 40.1 * DEG)})
    assert (copies(run) == -1).all()


def test_stars_of_one_image_are_several():
    run = night(6)
    same = PointingRun({**run.columns, 'time': np.full(6, START), 'az_enc': np.full(6, 1.0),
                        'el_enc': np.full(6, 0.5)})
    assert (copies(same) == -1).all()


def test_hundreds_of_copies_are_of_the_first():
    run = night(3)
    many = PointingRun.concatenate([run] * 300)
    assert np.array_equal(copies(many)[3:], np.tile(np.arange(3), 299))
    assert (copies(many)[:3] == -1).all()


def test_north_is_no_edge():
    a = PointingRun({'az': [0.0], 'el': [0.5], 'az_enc': [-4e-9], 'el_enc': [0.5]})
    b = PointingRun({'az': [0.0], 'el': [0.5], 'az_enc': [2.0 * np.pi - 4e-9], 'el_enc': [0.5]})
    assert copies(PointingRun.concatenate([a, b])).tolist() == [-1, 0]


@pytest.mark.skipif(not CASES.is_dir(), reason='the small inputs are not there')
def test_the_small_input_of_a_reformatted_night():
    kept, notes = without_copies([read_run(CASES / f'{name}.csv')
                                  for name in ('base', 'dup_reformatted')])
    assert len(kept) == 1 and len(kept[0]) == 60 and 'all 60 rows' in notes[0]
