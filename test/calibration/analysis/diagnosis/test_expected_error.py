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

"""The error to be expected on fresh stars."""

import numpy as np
import pytest
from simulated import night

from calibration.analysis.diagnosis.expected_error import (
    CONFIDENCE,
    expected_error,
    expected_error_of_terms,
)
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun


def test_the_interval_holds_fresh_stars_as_often_as_it_says():
    rng = np.random.default_rng(1)
    held, widths = 0, []
    for _ in range(400):
        n = 60
        told = expected_error(ARCSEC * rng.normal(size=(2, n)), np.ones(n, bool), np.arange(n), rng)
        fresh = np.hypot(*rng.normal(size=(2, 100)))
        rms = np.sqrt(np.mean(fresh**2))
        held += told['low_arcsec'] <= rms <= told['high_arcsec']
        widths.append((told['high_arcsec'] - told['low_arcsec']) / told['rms_arcsec'])
        assert told['low_arcsec'] < told['rms_arcsec'] < told['high_arcsec']
    assert told['confidence'] == CONFIDENCE == 0.9
    assert 0.86 * 400 <= held <= 0.96 * 400 and np.median(widths) < 0.4


def test_what_wanders_widens_it_and_outliers_do_not():
    rng = np.random.default_rng(2)
    residual = ARCSEC * rng.normal(size=(2, 60))
    residual[:, 7] = 400.0 * ARCSEC
    keep = np.arange(60) != 7
    still = expected_error(residual, keep, np.arange(60), np.random.default_rng(3))
    assert still['rms_arcsec'] == pytest.approx(np.sqrt(2.0), rel=0.2)
    ahead = np.square(3.0 * ARCSEC * rng.normal(size=1000))
    moved = expected_error(residual, keep, np.arange(60), np.random.default_rng(3), ahead)
    assert moved['high_arcsec'] > 4.0 and moved['low_arcsec'] < 1.1 * still['rms_arcsec']


def test_given_sigmas_are_no_radians():
    run = night(3, 60)
    rng = np.random.default_rng(4)
    size = np.exp(rng.uniform(-0.5, 0.5, 60)) * ARCSEC
    for axis, factor in (('az', np.cos(run['el'])), ('el', 1.0)):
        run[f'{axis}_enc'][:] += 1.5 * size * rng.normal(size=60) / factor
    given = PointingRun({**run.columns, 'sigma_x': size, 'sigma_y': size}, run.meta)
    plain, weighted = (expected_error_of_terms(one) for one in (run, given))
    for key in ('rms_arcsec', 'low_arcsec', 'high_arcsec'):
        assert weighted[key] == pytest.approx(plain[key], rel=0.2)
