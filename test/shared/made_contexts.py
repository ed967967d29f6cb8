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

"""Columns and contexts that the tests of the effects share."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.context import Context

LATITUDE, LONGITUDE = 34.3 * DEG, 109.0 * DEG


def make_columns(n=60, seed=1):
    rng = np.random.default_rng(seed)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(0.35, 0.99, n))
    return {
        'az': az, 'el': el, 'az_enc': az + 0.001, 'el_enc': el - 0.001,
        'time': 1.6e9 + np.cumsum(rng.uniform(50.0, 150.0, n)),
        'temperature': rng.normal(8.0, 2.0, n), 'approach_az': rng.choice([-1.0, 1.0], n),
        'approach_el': rng.choice([-1.0, 1.0], n), 'magnitude': rng.uniform(1.0, 6.0, n),
        'miss_x': rng.normal(size=n) * ARCSEC, 'miss_y': rng.normal(size=n) * ARCSEC,
        'pier_side': rng.choice([-1.0, 1.0], n), 'humidity_pct': rng.uniform(20.0, 80.0, n),
        'star': np.array([11767, 32349, 24436] * (n // 3)), 'run': np.repeat([4, 9], n // 2),
    }


def make_context(n=60, seed=1, drop=(), **more):
    columns = {k: v for k, v in {**make_columns(n, seed), **more}.items() if k not in drop}
    return Context(columns.pop('az'), columns.pop('el'), columns, LATITUDE, LONGITUDE)
