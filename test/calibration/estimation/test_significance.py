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

"""What could stand in the place of a found effect."""

from types import SimpleNamespace

import numpy as np

from calibration.estimation.candidate_scores import CandidateBank, CandidateGroup
from calibration.estimation.chance import Chance
from calibration.estimation.correlated_noise import Sequence
from calibration.estimation.equal_causes import SET_WIDTH
from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.selection_problem import ModelChoice, SelectionProblem
from calibration.estimation.significance import significance

N = 60


def effect(name, driver='time', columns=1, scan=None):
    return SimpleNamespace(name=name, coefficient_names=('c',) * columns, line=name, driver=driver,
                           scan=scan, scanned=int(scan is not None), size=None, share='dictionary')


def on_second(*columns):
    return np.array([np.concatenate((0.0 * column, column)) for column in columns])


def set_of_first(effects, columns, b, finer=None):
    """`Significance` of the first candidate, which was chosen."""
    variants = SimpleNamespace(finer=lambda one, scan, level: finer if one.scan else None)
    rng = np.random.default_rng(0)
    at_random = Sequence(rng.permutation(np.arange(float(N))), np.zeros(N, int), np.ones(N))
    problem = SelectionProblem(
        GroupColumns.alone(on_second(np.ones(N))), b, None,
        CandidateBank(effects, np.vstack(columns)), CandidateBank.empty(N), at_random, variants)
    chosen = [CandidateGroup(0)]
    return significance(problem, ModelChoice(chosen, problem.fit(chosen)), 0,
                        Chance(N, 499, rng), 0.01)


def test_another_driver_may_follow_more_than_what_was_found():
    """Of one driver what only follows more is no cause of its own."""
    rng, t = np.random.default_rng(2), np.linspace(-1.0, 1.0, N)
    b = rng.normal(size=2 * N) + on_second(4.0 * t)[0]
    line, curve = on_second(t), on_second(t, t**2)
    found = set_of_first([effect('drift'), effect('of air', 'temperature', 2),
                          effect('bent drift', columns=2)], [line, curve, curve], b)
    assert found.every[1] == found.every[2] > found.every[0] - SET_WIDTH
    assert found.equals == [1]


def test_what_is_scanned_is_compared_where_it_fits_best():
    rng, t = np.random.default_rng(3), np.linspace(-1.0, 1.0, N)
    b = rng.normal(size=2 * N) + on_second(4.0 * t)[0]
    beside = t**2 - np.mean(t**2)
    effects = [effect('drift'), effect('bump', 'azimuth', scan='bumps')]
    for part in np.arange(0.05, 1.0, 0.01):
        columns = [on_second(t), on_second(t + part * beside)]
        coarse = set_of_first(effects, columns, b)
        if coarse.every[1] < coarse.every[0] - SET_WIDTH - 1.0:
            break
    assert not coarse.equals
    finer = CandidateBank(effects[1:], on_second(t + 0.1 * part * beside))
    fine = set_of_first(effects, columns, b, finer)
    assert fine.every[1] > coarse.every[1] + 1.0 and fine.equals == [1]
