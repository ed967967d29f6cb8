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

"""Runs and problems that the tests of the diagnosis share."""

import numpy as np

from calibration.analysis.diagnosis.observations import sequence_of
from calibration.analysis.diagnosis.offered_effects import effect_bank
from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.selection_problem import SelectionProblem
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.context import Context
from pointing_model.effects import dictionary, smooths, steps
from pointing_model.pointing_terms import PHYSICAL, stacked_design
from pointing_model.runs.run import PointingRun

TRUTH = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))
SITE = {'latitude': 34.3 * DEG, 'longitude': 109.0 * DEG}
FAST = {'flips': 299, 'cross_validation': False}


def night(seed, n=60, effect=None, noise=None, terms=TRUTH):
    """Stars above 20 degrees; `effect(columns) -> (d_az, d_el)` is added to the encoder angles."""
    rng = np.random.default_rng(seed)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
    az_enc, el_enc = geometry.sky_to_encoder(az, el, terms)
    columns = {
        'az': az, 'el': el, 'time': 1.7e9 + np.cumsum(rng.uniform(60.0, 120.0, n)),
        'temperature': 12.0 - 4.0 * np.linspace(0.0, 1.0, n)**0.7 + 0.3 * rng.normal(size=n),
        'approach_az': np.sign(np.append(1.0, np.diff(az))),
        'approach_el': np.sign(np.append(1.0, np.diff(el))),
        'magnitude': rng.uniform(1.0, 6.0, n),
    }
    e = rng.normal(size=(2, n)) if noise is None else noise(rng, el)
    d_az, d_el = (0.0, 0.0) if effect is None else effect(columns)
    columns['az_enc'] = az_enc + d_az + e[0] * ARCSEC / np.cos(el)
    columns['el_enc'] = el_enc + d_el + e[1] * ARCSEC
    return PointingRun(columns, {'site': SITE})


def backlash(size):
    return lambda c: (0.5 * size * ARCSEC * c['approach_az'], 0.0)


def oval_disc(c):
    """Of the azimuth axis."""
    return 5.0 * ARCSEC * np.cos(2.0 * c['az'] + 0.3), 0.0


def names(result):
    return [e.fitted.effect.name for e in result.effects]


def make_context(rng, n=60):
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(0.34, 0.99, n))
    columns = {
        'time': 1.7e9 + np.cumsum(rng.uniform(60.0, 120.0, n)),
        'temperature': rng.normal(8.0, 2.0, n), 'approach_az': rng.choice([-1.0, 1.0], n),
        'approach_el': rng.choice([-1.0, 1.0], n), 'magnitude': rng.uniform(1.0, 6.0, n)}
    return Context(az, el, columns)


def make_problem(seed, n=60, signal=None, curves=False, noise=None):
    rng = np.random.default_rng(seed)
    context = make_context(rng, n)
    e = rng.normal(size=(2, n)) if noise is None else noise(rng, context)
    b = e * ARCSEC
    if signal is not None:
        b = b + signal(context)
    effects = dictionary(context)[0] + steps(context)
    return SelectionProblem(
        GroupColumns.alone(stacked_design(PHYSICAL, context.az, context.el)), b.ravel(), None,
        effect_bank(effects, context), effect_bank(smooths(context) if curves else [], context),
        sequence_of(context, np.zeros(n, int)))
