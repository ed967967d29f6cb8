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

"""The rows of a night, taken from another table."""

import numpy as np
import pytest

from pointing_model.runs.run import PointingRun
from telescope_mount.observing.night_memory import NEEDED, NightMemory


def rows(*names):
    angles = ('az', 'el', 'az_enc', 'el_enc')
    return PointingRun({name: np.arange(3.0) for name in (*angles, *names)})


def test_a_night_goes_on():
    table = NightMemory()
    table.restore(rows(*NEEDED), 2_000_000_007)
    assert len(table) == 3 and table.rows[-1]['stamp'] == 2_000_000_007


def test_rows_are_as_they_came():
    table, angles = NightMemory(), dict.fromkeys(('az', 'el', 'az_enc', 'el_enc'), 0.5)
    for i in range(150):
        more = {'exposure': 3.0} if i >= 100 else {}
        part = table.add({'stamp': 10 + i, 'run': i // 50, 'block': i // 30, 'star': i % 40,
                          **angles, **more})
        assert len(part) == 1 and part['star'][0] == i % 40 and 'stamp' not in part
    assert table.newest == 159 and table.trailing(4) == 30 and table.trailing(3) == 0
    assert table.last_stars(3) == {27, 28, 29} and table.stars_since(158) == {28, 29}
    assert table.last_of(2)['star'] == 29 and table.last_of(1) is None
    assert table.rows_from(148) == table.rows[-2:] and table.rows[120]['block'] == 4
    run = table.all()
    assert table.all() is None and len(table.all(again=True)) == 150
    assert np.isnan(run['exposure'][:100]).all() and (run['exposure'][100:] == 3.0).all()
    again = NightMemory()
    again.rows = table.rows
    assert again.all()['star'].tolist() == run['star'].tolist()


def test_of_a_power_on_long_over_the_rows_are_counted_and_not_kept():
    table, angles = NightMemory(power_ons=3), dict.fromkeys(('az', 'el', 'az_enc', 'el_enc'), 0.5)
    for i in range(60):
        table.add({'stamp': 10 + i, 'time': (10 + i) * 1e-9, 'run': 1 + i // 10, 'block': i // 10,
                   'star': i, **angles})
        assert len(table) == i + 1 and len(table.rows) <= 30
    assert table.forgotten == 30 and table.rows[0]['star'] == 30
    # rows have the numbers that they had
    assert [row['star'] for row in table.rows_from(58)] == [58, 59]
    assert table.rows_from(5) == table.rows and table.rows_from(-1)[0]['star'] == 59
    assert [table.newest_rows(n) for n in (0, 1, 2, 9)] == [30, 10, 20, 30]
    run = table.all()
    assert run['run'].tolist() == sorted(10 * [4.0, 5.0, 6.0])
    assert table.all() is None
    table.add({'stamp': 99, 'time': 99e-9, 'run': 7, 'block': 6, 'star': 60, **angles})
    assert len(table.all()) == 21

    again = NightMemory(power_ons=3)
    again.restore(run, 69, before=30)
    assert (len(again), again.forgotten) == (60, 30)
    from_file = NightMemory(power_ons=3)
    from_file.rows = [{'stamp': i, 'run': i // 10, 'block': 0, 'star': i, **angles}
                      for i in range(50)]
    assert (len(from_file), from_file.forgotten) == (50, 20)


@pytest.mark.parametrize('missing', NEEDED)
def test_rows_of_nobody_are_refused(missing):
    with pytest.raises(ValueError, match=f'without column {missing}: they are of no observer'):
        NightMemory().restore(rows(*(name for name in NEEDED if name != missing)), 1)
