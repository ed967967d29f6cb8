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

"""Runs of a German mount whose errors are those of its parts, or applied on the sky."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.geometry import sky_to_encoder
from pointing_model.mounts import Mount, through_pole
from pointing_model.runs.run import PointingRun

MOUNT = Mount.equatorial(34.3 * DEG, 'german')
NAMES = ('IH', 'ID', 'CH', 'NP', 'MA', 'ME')


def a_run(kind, seed, rows=40, size=60.0, noise=1.0, east=0.5):
    """A run whose errors are of the mount or on the sky; its terms, arcsec."""
    rng = np.random.default_rng(seed)
    terms = {name: size * value * ARCSEC for name, value in zip(NAMES, rng.normal(size=6))}
    beyond = np.arange(rows) < round(rows * east)
    hour_angle = rng.uniform(5.0, 60.0, rows) * DEG * np.where(beyond, -1.0, 1.0)
    dec = rng.uniform(-20.0, 65.0, rows) * DEG
    first, second = MOUNT.on_travel(*through_pole(hour_angle, dec, beyond))
    if kind == 'mount':
        readings = sky_to_encoder(first, second, terms, MOUNT)
    else:
        readings = MOUNT.on_travel(*through_pole(
            *sky_to_encoder(hour_angle, dec, terms, MOUNT), beyond))
    x, y = noise * ARCSEC * rng.normal(size=(2, rows))
    return PointingRun({'az': first, 'el': second, 'az_enc': readings[0] + x / np.cos(second),
                        'el_enc': readings[1] + y}, {'mount': MOUNT}), terms
