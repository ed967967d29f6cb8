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

from calibration.estimation.least_squares import reweighted
from calibration.estimation.robust import Loss, bisquare, hampel, huber
from pointing_model.rms import sigma_of

U = np.linspace(0.0, 12.0, 120_001)
DENSITY = U * np.exp(-0.5 * U**2)  # of the radial distance at Gaussian noise


def efficiency(weights):
    """Of an M-estimate of a place in the plane, by numerical integration (Hampel et al. 1986)."""
    w = weights(U)
    slope = np.gradient(w, U)
    step = U[1] - U[0]
    a = np.sum((w + 0.5 * slope * U) * DENSITY) * step
    b = np.sum(0.5 * np.square(w * U) * DENSITY) * step
    return a * a / b


@pytest.mark.parametrize('weights, expected', [
    (huber, 0.950), (bisquare, 0.986), (hampel, 0.999)])
def test_efficiency_at_gaussian_noise_is_what_the_constants_promise(weights, expected):
    assert efficiency(weights) == pytest.approx(expected, abs=0.0006)


@pytest.mark.parametrize('weights', [huber, hampel, bisquare])
def test_the_constants_of_a_loss(weights):
    w, loss = weights(U), Loss.of(weights)
    variance = np.sum(0.5 * w * U**2 * DENSITY) / np.sum(w * DENSITY)
    assert loss.variance == pytest.approx(variance, rel=1e-4)
    mean_weight = np.sum(w * DENSITY) * (U[1] - U[0])
    assert loss.inflation == pytest.approx(mean_weight / efficiency(weights), rel=1e-3)


def test_weights_at_their_bends():
    np.testing.assert_allclose(huber(np.array([0.0, 1.5, 3.0])), [1.0, 1.0, 0.5])
    np.testing.assert_allclose(hampel(np.array([3.0, 12.0, 18.5, 25.0, 90.0])),
                               [1.0, 0.25, 3 / 18.5 * 0.5, 0.0, 0.0])
    np.testing.assert_allclose(bisquare(np.array([0.0, 7.0 / 2**0.5, 7.0, 1e9])),
                               [1.0, 0.25, 0.0, 0.0])


def test_sigma_from_the_median():
    noise = np.random.default_rng(0).normal(size=(2, 20_000)) * [[2.0], [5.0]]
    np.testing.assert_allclose(sigma_of(noise, axis=1), [2.0, 5.0], rtol=0.02)
    assert sigma_of(noise[0], 1.5) == pytest.approx(1.5 * sigma_of(noise[0]))


def test_any_solver_can_be_iterated():
    """The mean with Huber's weights is where their sum balances."""
    y = np.concatenate((np.random.default_rng(1).normal(size=30), [40.0, 50.0]))
    mean, weights = reweighted(
        lambda w: float(w @ y / w.sum()), lambda mean: huber(np.abs(y - mean)), float(y.mean()),
        200, lambda new, old: abs(new - old) < 1e-12)
    assert np.clip(y - mean, -1.5, 1.5).sum() == pytest.approx(0.0, abs=1e-9)
    assert weights[-1] < 0.05 and abs(mean) < 0.3


def test_the_iteration_ends_when_told():
    solved = []
    fit, weights = reweighted(lambda w: solved.append(w) or w, lambda fit: fit + 1, 0, 3)
    assert (fit, weights, solved) == (3, 3, [1, 2, 3])
    # `None` for the weights: the fit is left as it is
    assert reweighted(None, lambda fit: None, 'start', 3) == ('start', None)
    assert reweighted(lambda w: w, lambda fit: fit + 1 if fit < 2 else None, 0, 9) == (2, 2)
    assert reweighted(lambda w: w, lambda fit: fit + 1, 0, 9, lambda new, old: new == 4)[0] == 4
