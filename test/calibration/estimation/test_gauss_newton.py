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

"""Where the iteration of a fit may end: residuals are those of the rotations themselves."""


import numpy as np
import pytest

from calibration.analysis.term_fit import fit_terms
from calibration.estimation.least_squares import System
from calibration.estimation.robust import LOSS, Loss, hampel
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.runs.run import PointingRun

MOUNTS, NAMES = (ALTAZ, Mount.equatorial(0.6)), ('altaz', 'equatorial')


def simulated(rng, az, el, mount, **columns):
    """A run of random terms with 1" of noise."""
    noise = rng.normal(size=(2, len(az))) * ARCSEC
    truth = dict(zip(mount.names.physical, rng.normal(size=7) * 100 * ARCSEC))
    az_enc, el_enc = PointingModel(truth, mount=mount).sky_to_encoder(az, el)
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + noise[0] / np.cos(el),
                        'el_enc': el_enc + noise[1], **columns}, {'mount': mount})


@pytest.mark.parametrize('robust', [True, False])
@pytest.mark.parametrize('mount', MOUNTS, ids=NAMES)
@pytest.mark.parametrize('kind', ['few', 'some', 'many', 'sigmas', 'near the zenith'])
def test_residuals_are_those_of_the_rotations(kind, mount, robust):
    rng = np.random.default_rng(4)
    n = {'few': 12, 'some': 300}.get(kind, 8000)
    az, el = rng.uniform(-3, 3, n), np.arcsin(rng.uniform(0.3, 0.99, n))
    if kind == 'near the zenith':
        el[::7] = np.radians(89.9)
    columns = {}
    if kind == 'sigmas':
        columns = {f'sigma_{axis}': rng.uniform(0.3, 3.0, n) * ARCSEC for axis in 'xy'}
    run = simulated(rng, az, el, mount, **columns)
    fit = fit_terms(run, robust=robust)
    az_enc, el_enc = fit.model.sky_to_encoder(run['az'], run['el'])
    there = np.isfinite(fit.residual_x)
    assert there.sum() > 0.8 * len(there)
    x = ((run['az_enc'] - az_enc) * np.cos(run['el']))[there]
    y = (run['el_enc'] - el_enc)[there]
    assert np.abs(fit.residual_x[there] - x).max() < 1e-7 * ARCSEC
    assert np.abs(fit.residual_y[there] - y).max() < 1e-7 * ARCSEC


@pytest.mark.parametrize('robust', [True, False])
def test_by_the_zenith_azimuths_go_the_shorter_way_round(robust):
    rng = np.random.default_rng(11)
    n = 3000
    az, el = rng.uniform(-3, 3, n), np.arcsin(rng.uniform(0.3, 0.99, n))
    el[::3] = np.pi / 2 - rng.uniform(30, 90, n // 3) * ARCSEC  # a tilt takes it round the pole
    model = PointingModel({'AN': 300 * ARCSEC, 'AW': -100 * ARCSEC, 'CA': 5 * ARCSEC})
    az_enc, el_enc = model.sky_to_encoder(az, el)
    noise = rng.normal(size=(2, n)) * ARCSEC
    assert (np.abs(az_enc - az + noise[0] / np.cos(el)) > np.pi).sum() > 3
    run = PointingRun({'az': az, 'el': el, 'az_enc': az_enc + noise[0] / np.cos(el),
                       'el_enc': el_enc + noise[1]})
    fit = fit_terms(run, robust=robust)
    there = np.isfinite(fit.residual_x)
    assert np.abs(fit.residual_x[there]).max() < 5 * ARCSEC
    assert fit.scatter[0] == pytest.approx(ARCSEC, rel=0.05)
    assert fit.coefficients[fit.names.index('AN')] == pytest.approx(300 * ARCSEC,
                                                                    abs=0.5 * ARCSEC)


def test_of_columns_of_zeros_a_fit_says_so():
    rng = np.random.default_rng(13)
    with pytest.raises(ValueError, match='do not determine what is to be fitted'):
        fit_terms(simulated(rng, rng.uniform(-3, 3, 300), np.zeros(300), ALTAZ), ('NPAE',))


def test_rows_where_the_mount_cannot_look_are_left_out():
    rng = np.random.default_rng(10)
    az, el = rng.uniform(-3, 3, 8000), np.arcsin(rng.uniform(0.3, 0.99, 8000))
    run = simulated(rng, az, el, ALTAZ)
    model = PointingModel({'CA': 300 * ARCSEC, 'AN': 50 * ARCSEC})
    noise = rng.normal(size=(2, 8000)) * ARCSEC
    az_enc, el_enc = model.sky_to_encoder(az, el)
    run.columns['az_enc'] = az_enc + noise[0] / np.cos(el)
    run.columns['el_enc'] = el_enc + noise[1]
    run.columns['el'][::500] = np.pi / 2 - 100 * ARCSEC
    fit = fit_terms(run)
    assert [of['row'] for of in fit.excluded] == list(range(0, 8000, 500))
    assert np.isnan(fit.residual_x[::500]).all()
    left = fit_terms(run.select(np.arange(8000) % 500 > 0))
    assert np.abs((fit.coefficients - left.coefficients) / left.sigma).max() < 0.01


def test_rows_without_an_offset_fit_nothing():
    """Coefficients of exactly zero, where a residual is what was observed."""
    rng = np.random.default_rng(8)
    az, el = rng.uniform(0, 6, 7000), rng.uniform(0.4, 1.4, 7000)
    fit = fit_terms(PointingRun({'az': az, 'el': el, 'az_enc': az, 'el_enc': el}))
    assert np.abs(fit.coefficients).max() < 1e-9 * ARCSEC
    assert np.abs(fit.residual_x).max() < 1e-9 * ARCSEC


@pytest.mark.parametrize('given', [False, True])
@pytest.mark.parametrize('loss', [LOSS, Loss.of(hampel), Loss.of(lambda u: np.exp(-u**2 / 20))])
def test_the_weights_settle_at_the_minimum_of_the_loss(loss, given):
    rng = np.random.default_rng(4)
    rows, noise = rng.normal(size=(3, 80)), 1e-6 * np.repeat([1.0, 2.0], 40)
    b = np.array([1e-3, -2e-3, 5e-4]) @ rows + noise * rng.normal(size=80)
    b[:4] += 30e-6
    weights = 1.0 / np.square(noise) if given else None
    system = System(rows, b, weights, 1e-12)
    scales, residual = system.noise(3)
    assert scales == pytest.approx([1.0, 1.0] if given else [1e-6, 2e-6], rel=0.3)
    solution, row_weights = system.solve_robust(loss, scales, residual, 1e-15)
    assert row_weights[:4].max() < 0.12 and (row_weights[4:] > 0.0).sum() >= 35
    at = solution.residual / np.repeat(scales, 40) / (noise if given else 1.0)
    u = np.hypot(*at.reshape(2, -1))
    np.testing.assert_allclose(loss.weights(u), row_weights, atol=1e-9)
    # no coefficient moves the weighted residuals
    pull = np.tile(row_weights, 2) * solution.residual * (1.0 if weights is None else weights)
    assert np.abs(rows @ pull).max() < 1e-9 * np.abs(rows * pull).sum()
