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

"""Outliers that lie together."""

import numpy as np

from calibration.estimation.outlier_clusters import Window, clusters


def windows(n=80, length=6):
    return [Window('time', np.arange(i, i + length)) for i in range(n - length + 1)]


def test_outliers_of_one_kind_together_are_a_cluster():
    kind = np.zeros(80, int)
    kind[[20, 21, 23, 24]] = 2
    kind[[3, 50, 70]] = [-1, 2, 1]
    (found,) = clusters(kind, windows(), np.random.default_rng(1))
    assert found.kind == 2 and found.rows.tolist() == [20, 21, 23, 24]
    assert found.window.what == 'time' and found.chance < 0.01


def test_two_clusters_are_told_apart():
    kind = np.zeros(80, int)
    kind[[20, 21, 23, 24]], kind[[60, 61, 62]] = 2, -1
    found = clusters(kind, windows(), np.random.default_rng(1))
    assert [one.rows.tolist() for one in found] == [[20, 21, 23, 24], [60, 61, 62]]


def test_outliers_of_two_signs_or_anywhere_are_none():
    kind = np.zeros(80, int)
    kind[20:24] = [1, -1, 2, -2]
    assert clusters(kind, windows(), np.random.default_rng(1)) == []
    assert clusters(kind, [], np.random.default_rng(1)) == []
    rng, told = np.random.default_rng(2), 0
    for _ in range(60):
        kind = np.zeros(80, int)
        kind[rng.choice(80, 7, replace=False)] = rng.choice([-2, -1, 1, 2], 7)
        told += bool(clusters(kind, windows(), rng))
    assert told <= 2
