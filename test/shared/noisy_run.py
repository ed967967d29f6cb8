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

"""A simulated pointing run: seven terms as exact rotations, noise on the sky."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun

TRUTH = np.array([200, 100, 60, -90, 120, -130, 80]) * ARCSEC
MODEL = PointingModel(dict(zip(PHYSICAL, TRUTH)))


def make_run(rng, n=30, noise=(1.0, 1.0), model=MODEL, low=20.0, high=85.0, **columns):
    az = rng.uniform(0, 2 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(np.radians(low)), np.sin(np.radians(high)), n))
    az_enc, el_enc = model.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, n)) * [np.broadcast_to(s, n) for s in noise] * ARCSEC
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el),
                        'el_enc': el_enc + y, **columns})
