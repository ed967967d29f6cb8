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

import numpy as np
import pytest

from msg_tools.units import ARCSEC, wrap
from pointing_model import geometry
from pointing_model.harmonics import Harmonics
from pointing_model.model import PointingModel
from pointing_model.mount_kinds import CANONICAL
from pointing_model.pointing_terms import TERMS, Trig, design
from pointing_model.runs.run import PointingRun
from pointing_model.zero import PowerOnZero, Zeros


def make(reading='zenith', seed=5, **kwargs):
    rng = np.random.default_rng(seed)
    names = ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF', 'HASA2', 'TX')
    root = rng.normal(size=(9, 9)) * ARCSEC
    h = None
    if reading:
        c = rng.normal(size=(2, 13)) * 10 * ARCSEC
        hroot = rng.normal(size=(26, 26)) * ARCSEC
        h = Harmonics(reading, *c, hroot @ hroot.T)
    values = np.array([200, 100, 60, -90, 120, -130, 80, 20, 40]) * ARCSEC
    return PointingModel(dict(zip(names, values)), root @ root.T, h, {'source': 'x'}, **kwargs)


def sky(n=1000, top=1.53):
    rng = np.random.default_rng(6)
    return rng.uniform(0, 7, n), rng.uniform(0.2, top, n)


@pytest.mark.parametrize('kwargs', [
    {'reading': None}, {'reading': 'zenith'}, {'reading': 'printed'},
    {'reading': 'zenith', 'geometry': 'first_order'}])
def test_forward_and_backward_are_inverse(kwargs):
    model = make(**kwargs)
    az, el = sky()
    az2, el2 = model.encoder_to_sky(*model.sky_to_encoder(az, el))
    assert np.hypot(wrap(az2 - az) * np.cos(el), el2 - el).max() < 1e-6 * ARCSEC


def test_offset_is_rotation_plus_columns_plus_harmonics():
    model = make()
    az, el = sky(50)
    x, y = geometry.offsets(az, el, {n: model.terms[n] for n in CANONICAL})
    for name in ('HASA2', 'TX'):
        cx, cy = TERMS[name].of(Trig(az, el))
        x, y = x + model.terms[name] * cx, y + model.terms[name] * cy
    hx, hy = model.harmonics.offsets(az, el)
    np.testing.assert_allclose(model.offsets(az, el), (x + hx, y + hy), atol=1e-14)


def test_first_order_geometry_is_the_design():
    model = make(reading=None, geometry='first_order')
    az, el = sky(50)
    coefficients = np.array(list(model.terms.values()))
    x, y = design(tuple(model.terms), az, el)
    np.testing.assert_allclose(
        model.offsets(az, el), (x @ coefficients, y @ coefficients), atol=1e-14)


def test_scalars_and_shapes():
    model = make()
    az_enc, el_enc = model.sky_to_encoder(1.0, 0.8)
    assert np.shape(az_enc) == np.shape(el_enc) == ()
    grid = model.sky_to_encoder(np.full((2, 3), 1.0), 0.8)
    assert grid[0].shape == (2, 3) and grid[0][1, 2] == pytest.approx(float(az_enc), abs=1e-15)
    assert model.sigma(np.full((2, 3), 1.0), 0.8)[1].shape == (2, 3)


def test_sigma_by_sampling():
    model = make()
    rng = np.random.default_rng(7)
    terms = rng.multivariate_normal(np.zeros(9), model.covariance, 20000)
    series = rng.multivariate_normal(np.zeros(26), model.harmonics.covariance, 20000)
    from pointing_model.harmonics import basis

    x, y = design(tuple(model.terms), [2.0], [1.1])
    f = basis(2.0, 1.1)[0]
    sx, sy = model.sigma(2.0, 1.1)
    assert sx == pytest.approx(np.std(terms @ x[0] + series[:, :13] @ f), rel=0.03)
    assert sy == pytest.approx(np.std(terms @ y[0] + series[:, 13:] @ f), rel=0.03)


def test_residuals_and_zeros():
    model = make()
    az, el = sky(20)
    az_enc, el_enc = model.sky_to_encoder(az, el)
    night = np.repeat([1, 2], 10)
    shift = np.where(night == 1, 30, -20) * ARCSEC
    run = PointingRun({'az': az, 'el': el, 'az_enc': az_enc + shift + 2 * np.pi,
                       'el_enc': el_enc - shift, 'run': night})
    x, y = model.residuals(run)
    np.testing.assert_allclose(x, shift * np.cos(el), atol=1e-13)
    np.testing.assert_allclose(y, -shift, atol=1e-13)
    zeros = Zeros([PowerOnZero(30 * ARCSEC, -30 * ARCSEC, run=1),
                   PowerOnZero(-20 * ARCSEC, 20 * ARCSEC, run=2)])
    assert np.abs(model.residuals(run, zero=zeros)).max() < 1e-13
    with pytest.raises(ValueError, match='run 2'):
        model.residuals(run, zero=Zeros([PowerOnZero(0.0, 0.0, run=1)]))
