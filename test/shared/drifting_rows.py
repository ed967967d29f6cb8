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

"""Rows of a mount whose terms drift."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun

START = 1_768_482_000_000_000_000
MOUNT = PointingModel(
    dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)),
    np.eye(7) * (0.4 * ARCSEC)**2, provenance={'fitted_rms_arcsec': {'x': 1.0, 'y': 1.0}})


def rows(n, seed=0, run=1.0, zero=(0.0, 0.0), begin=0, drift=0.0, second=None, **columns):
    """Stars every ten minutes; the azimuth's zero drifts by arcsec a star."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(0.4, 1.3, n)
    enc = np.array(MOUNT.sky_to_encoder(az, el))
    enc[0] += (zero[0] + drift * np.arange(n)) * ARCSEC
    enc[1] += zero[1] * ARCSEC
    enc += ARCSEC * rng.standard_normal((2, n)) / [np.cos(el), np.ones(n)]
    out = {'time': (START + 600 * 10**9 * (begin + 1 + np.arange(n))) * 1e-9,
           'run': np.full(n, run), 'star': 1.0 + np.arange(n), 'az': az, 'el': el,
           'az_enc': enc[0], 'el_enc': enc[1], 'encoder_start': np.full(n, 1e9 + run),
           'miss_x': ARCSEC * rng.standard_normal(n), 'miss_y': ARCSEC * rng.standard_normal(n)}
    if second is not None:
        out['az_abs'], out['el_abs'] = enc + ARCSEC * (second + 0.3 * rng.standard_normal((2, n)))
    return PointingRun(out | columns)
