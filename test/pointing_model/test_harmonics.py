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

from pointing_model.harmonics import COUNT, Harmonics, basis, sky_factor
from pointing_model.pointing_terms import design


def test_functions_of_the_paper():
    az, el = 0.7, 0.4
    for reading, theta in (('zenith', np.pi / 2 - el), ('printed', el)):
        c, s = np.cos(theta), np.sin(theta)
        ca, sa = np.cos(az) * s, np.sin(az) * s
        expected = [1, c, ca, sa, c**2, ca * c, sa * c, c**3, ca * c**2, sa * c**2, c**4,
                    ca * c**3, sa * c**3]
        np.testing.assert_allclose(basis(az, el, reading)[0], expected, atol=1e-15)


def test_zenith_reading_spans_the_spherical_harmonics():
    from scipy.special import lpmv

    rng = np.random.default_rng(2)
    az, el = rng.uniform(0, 2 * np.pi, 400), np.arcsin(rng.uniform(0, 1, 400))
    functions = basis(az, el)
    for degree in range(5):
        for order in range(min(degree, 1) + 1):
            for wave in (np.cos(order * az), np.sin(order * az)):
                y = lpmv(order, degree, np.sin(el)) * wave
                left = y - functions @ np.linalg.lstsq(functions, y, rcond=None)[0]
                assert np.abs(left).max() < 1e-10


def test_what_each_reading_holds():
    """CA and NPAE are exact members in zenith distance; IA and tilt are not."""
    rng = np.random.default_rng(3)
    az = rng.uniform(0, 2 * np.pi, 4000)
    el = np.arcsin(rng.uniform(np.sin(np.radians(15)), 1, 4000))

    def left(name, reading):
        x = design([name], az, el)[0][:, 0]
        functions = basis(az, el, reading) * sky_factor(el, reading)[:, None]
        rest = x - functions @ np.linalg.lstsq(functions, x, rcond=None)[0]
        return np.linalg.norm(rest) / np.linalg.norm(x)

    assert left('CA', 'zenith') < 1e-9 and left('NPAE', 'zenith') < 1e-9
    assert 0.004 < left('IA', 'zenith') < 0.02
    assert 0.08 < left('AN', 'zenith') < 0.2
    assert left('HASA2', 'zenith') > 0.99
    assert left('CA', 'printed') > 1e-3


def test_offsets_scale_to_the_sky():
    coef_x, coef_y = np.zeros(COUNT), np.zeros(COUNT)
    coef_x[0], coef_y[1] = 2.0, 3.0
    el = np.array([0.5, 1.0])
    x, y = Harmonics('zenith', coef_x, coef_y, np.eye(26)).offsets(np.zeros(2), el)
    np.testing.assert_allclose((x, y), ([2, 2], 3 * np.sin(el)))
    # printed: f_A = dA sin E, so the offset on the sky is f_A cot E
    x, y = Harmonics('printed', coef_x, coef_y, np.eye(26)).offsets(np.zeros(2), el)
    np.testing.assert_allclose((x, y), (2 / np.tan(el), 3 * np.cos(el)))


def test_variance_by_sampling():
    rng = np.random.default_rng(4)
    root = rng.normal(size=(26, 26)) * 0.1
    mean = rng.normal(size=26)
    h = Harmonics('printed', mean[:13], mean[13:], root @ root.T)
    draws = mean + rng.normal(size=(20000, 26)) @ root.T
    f = basis(0.3, 0.8, 'printed')[0]
    vx, vy = h.variance(0.3, 0.8)
    assert vx[0] == pytest.approx(np.var(draws[:, :13] @ f / np.tan(0.8)), rel=0.05)
    assert vy[0] == pytest.approx(np.var(draws[:, 13:] @ f), rel=0.05)


def test_bad_input():
    with pytest.raises(ValueError, match='interpretation'):
        basis(0.0, 1.0, 'nadir')
    with pytest.raises(ValueError, match='coef_x'):
        Harmonics('zenith', np.zeros(14), np.zeros(13), np.eye(26))
