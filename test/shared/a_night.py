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

"""A night as the calibration sees it, without nodes: its rows, model and report."""

import numpy as np

from calibration.calibration_state import CalibrationState
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))
LATITUDE = 34.3 * DEG
BEGIN = 1768482000.0


def a_night(stars=20, exposures=8, seed=4):
    """Stars and Polaris in two power-ons, one wild row; (run, model, report)."""
    rng = np.random.default_rng(seed)
    session, blocks, number = CalibrationState(), [], 0
    for run, drift in ((1.0, (0.0, 0.0)), (2.0, (20.0, -12.0))):
        hour = 0.3 + 0.01 * np.arange(exposures)
        az = np.concatenate([0.65 * DEG * np.sin(hour) / np.cos(LATITUDE),
                             rng.uniform(0, 2 * np.pi, stars)])
        el = np.concatenate([LATITUDE + 0.65 * DEG * np.cos(hour),
                             np.arcsin(rng.uniform(0.35, 0.99, stars))])
        n = len(az)
        az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
        x, y = rng.normal(size=(2, n)) * ARCSEC
        if run == 2.0:
            x[-1] += 40.0 * ARCSEC
        az_enc, el_enc = az_enc + drift[0] * ARCSEC + x / np.cos(el), el_enc + y
        block = PointingRun({
            'time': BEGIN + 20.0 * (number + np.arange(n)), 'az': az, 'el': el,
            'az_enc': az_enc, 'el_enc': el_enc + drift[1] * ARCSEC,
            'az_abs': az_enc + 0.3 * rng.normal(size=n) * ARCSEC,
            'el_abs': el_enc + 0.3 * rng.normal(size=n) * ARCSEC,
            'star': np.concatenate([np.full(exposures, float(POLARIS_HIP)),
                                    1000.0 * run + np.arange(stars)]),
            'run': np.full(n, run), 'temperature': 10.0 + 0.1 * rng.normal(size=n)})
        session.add(block, int(1e9 * block['time'][-1]))
        blocks.append(block)
        number += n
    session.calibrate_zero()
    model, report = session.fit()
    return PointingRun.concatenate(blocks), model, report
