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

"""A night of two encoders and the sky, one of which moves."""

import numpy as np

from calibration.analysis.encoders.cross_check import cross_check as compare_encoders
from calibration.report.encoder_wording import cross_check_texts
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP

TERMS = {'IA': 310.0, 'IE': -170.0, 'CA': 46.0, 'NPAE': -23.0, 'AN': 37.0, 'AW': -21.0, 'TF': 15.0}


def mount(**changes):
    values = {name: (value + changes.get(name, 0.0)) * ARCSEC for name, value in TERMS.items()}
    return PointingModel(values)


def night(seed, inc=(0.0, 0.0), second=(0.0, 0.0), run=1, stars=30, polaris=16, model=None,
          hour=0.0, start=0.0, noise=1.0):
    """Stars, Polaris, stars; what the encoders read too much in arcsec."""
    rng = np.random.default_rng(seed)
    n = 2 * stars + polaris
    az, el = rng.uniform(0, 2 * np.pi, n), rng.uniform(20 * DEG, 80 * DEG, n)
    pole = slice(stars, stars + polaris)
    az[pole] = 0.76 * DEG * np.sin(hour)
    el[pole] = (34.3 + 0.63 * np.cos(hour)) * DEG
    star = rng.integers(20_000, 90_000, n)
    star[pole] = POLARIS_HIP
    axes = np.array((model or mount()).sky_to_encoder(az, el))
    seen = noise * rng.normal(size=(2, n)) * ARCSEC
    seen[0] /= np.cos(el)
    enc = axes + seen + np.array(inc)[:, None] * ARCSEC
    own = 0.35 * noise * rng.normal(size=(2, n))
    other = axes + seen + (np.array(second)[:, None] + own) * ARCSEC
    return PointingRun({
        'time': start + 1.8e9 + 40.0 * np.arange(n), 'run': np.full(n, float(run)), 'star': star,
        'az': az, 'el': el, 'az_enc': enc[0], 'el_enc': enc[1], 'az_abs': other[0],
        'el_abs': other[1]})


def cross_check(rows, *args, **kwargs):
    """As `cross_check.cross_check`, with sentences in the place of findings."""
    report = compare_encoders(rows, *args, **kwargs)
    report.alarms, report.notes = (cross_check_texts(found, rows.mount.names)
                                   for found in (report.alarms, report.notes))
    return report
