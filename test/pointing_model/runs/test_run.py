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

"""The table of observations."""

import numpy as np
import pytest

from pointing_model.runs.run import PointingRun


def run_at(hours, **columns):
    n = len(hours)
    return PointingRun({'az': np.zeros(n), 'el': np.full(n, 0.7), 'az_enc': np.zeros(n),
                        'el_enc': np.full(n, 0.7), 'time': 3600.0 * np.asarray(hours, float),
                        **columns}, {'source': 'x'})


def test_gaps_end_a_session_in_whatever_order_the_rows_are():
    run = run_at([30.0, 0.0, 1.0, 26.0, 3.5, 27.0]).split_sessions(3.0)
    assert run['run'].tolist() == [2, 1, 1, 2, 1, 2] and run.meta['source'] == 'x'
    assert run_at([30.0, 0.0, 1.0, 26.0, 3.5, 27.0]).split_sessions(2.0)['run'].tolist() == [
        4, 1, 1, 3, 2, 3]


def test_runs_that_are_told_apart_stay_apart():
    run = run_at([0.0, 1.0, 2.0, 40.0], run=np.array([7, 7, 9, 9])).split_sessions(3.0)
    assert run['run'].tolist() == [1, 1, 2, 3]


def test_sessions_need_the_time_of_every_row():
    with pytest.raises(ValueError, match='column time'):
        run_at([0.0, np.nan]).split_sessions(3.0)
