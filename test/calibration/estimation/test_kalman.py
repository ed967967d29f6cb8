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

"""The Kalman solver against the covariance of all rows at once."""

import numpy as np
import pytest

from calibration.estimation.dynamics import (
    Constant,
    ExponentialMemory,
    Jump,
    RandomWalk,
    Together,
    Transition,
)
from calibration.estimation.kalman import (
    Rows,
    forward,
    jump_gains,
    normalised_innovations,
    shown,
    smoothed,
)

TIMES = np.array([0.0, 0.4, 1.5, 1.7, 3.0, 4.2, 5.0])
N = len(TIMES)


def rows(rng, state=3, columns=0, m=2):
    noise = [a @ a.T + np.eye(m) for a in rng.normal(size=(N, m, m))]
    return Rows(TIMES, rng.normal(size=(N, m, state)), rng.normal(size=(N, m)), noise,
                rng.normal(size=(N, m, columns)))


def whole(of, dynamics, first):
    """What the state is at all rows, and the values: covariances of a Gaussian of them all."""
    s, at = len(first), of.time[0]
    joint, covariance = np.zeros((N, s, N, s)), first
    for i, time in enumerate(of.time):
        step = dynamics.over(at, time)
        matrix = np.eye(s) if step.matrix is None else step.matrix
        covariance = matrix @ covariance @ matrix.T + step.added
        for j in range(i):
            joint[i, :, j] = matrix @ joint[i - 1, :, j]
            joint[j, :, i] = joint[i, :, j].T
        joint[i, :, i], at = covariance, time
    show = np.zeros((N, of.values.shape[1], N, s))
    show[range(N), :, range(N)] = of.state
    joint, show = joint.reshape(N * s, -1), show.reshape(of.values.size, -1)
    noise = np.zeros((N, of.values.shape[1], N, of.values.shape[1]))
    noise[range(N), :, range(N)] = of.noise
    return joint, show, show @ joint @ show.T + noise.reshape(of.values.size, -1)


class Trend:
    """A level that goes on by a slope that drifts, beside what stays: a dynamics that the product
    does not have.
    """

    def over(self, begin, end):
        span = end - begin
        matrix, added = np.eye(3), np.zeros((3, 3))
        matrix[0, 1] = span
        added[:2, :2] = [[span**3 / 3.0, span**2 / 2.0], [span**2 / 2.0, span]]
        return Transition(matrix, added)


LAST = np.diag([0.0, 0.0, 1.0])


DYNAMICS = {
    'constant': Constant(), 'walk': RandomWalk(np.diag([0.5, 0.0, 2.0])),
    'memory': ExponentialMemory(np.diag([0.5, 0.2, 2.0]), np.array([1.0, np.inf, 0.3])),
    'jump': Jump(1.6, np.diag([3.0, 0.0, 1.0])),
    'each its own': Together([Trend(), RandomWalk(LAST), Jump(1.6, LAST)])}


@pytest.mark.parametrize('name', DYNAMICS)
def test_the_state_is_the_posterior_of_all_rows(name):
    of, first = rows(np.random.default_rng(1)), np.diag([1.0, 2.0, 3.0])
    joint, show, spread = whole(of, DYNAMICS[name], first)
    passed = forward(of, DYNAMICS[name], (np.zeros(3), first))
    gain = joint @ show.T @ np.linalg.inv(spread)
    covariance = (joint - gain @ show @ joint).reshape(N, 3, N, 3)
    for i, (mean, own) in enumerate(smoothed(passed)):
        np.testing.assert_allclose(mean[:, 0], (gain @ of.values.ravel()).reshape(N, 3)[i])
        np.testing.assert_allclose(own, covariance[i, :, i], atol=1e-9)
    assert passed.log_det == pytest.approx(np.linalg.slogdet(spread)[1])
    y = of.values.ravel()
    assert np.sum(np.square(passed.whitened)) == pytest.approx(y @ np.linalg.solve(spread, y))


def test_coefficients_and_their_likelihood_are_those_of_least_squares():
    rng = np.random.default_rng(2)
    of, dynamics = rows(rng, state=2, columns=2), RandomWalk(np.diag([0.5, 2.0]))
    _, show, spread = whole(of, dynamics, np.zeros((2, 2)))
    at_first = show.reshape(-1, N, 2).sum(axis=1)
    columns, y = np.hstack([at_first, of.columns.reshape(-1, 2)]), of.values.ravel()
    normal = columns.T @ np.linalg.solve(spread, columns)
    passed = forward(of, dynamics)
    found = passed.estimate()
    best = np.linalg.solve(normal, columns.T @ np.linalg.solve(spread, y))
    np.testing.assert_allclose(found.coefficients, best)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(normal))
    left = y - columns @ best
    plain = -0.5 * (left @ np.linalg.solve(spread, left) + np.linalg.slogdet(spread)[1])
    assert passed.log_likelihood(restricted=False) == pytest.approx(plain)
    assert found.log_likelihood == pytest.approx(plain - 0.5 * np.linalg.slogdet(normal)[1])


def test_several_hypotheses_are_filtered_at_once():
    of = rows(np.random.default_rng(3))
    rates = np.array([0.1, 1.0, 10.0])[:, None, None] * np.eye(3)
    each = [forward(of, RandomWalk(rate)).log_likelihood() for rate in rates]
    np.testing.assert_allclose(forward(of, RandomWalk(rates)).log_likelihood(), each)


def test_what_a_row_shows_is_foretold_by_those_before_it():
    of, dynamics = rows(np.random.default_rng(4), columns=1), RandomWalk(0.5 * np.eye(3))
    off = normalised_innovations(forward(of, dynamics))
    assert np.isnan(off[:2]).all() and np.isfinite(off[2:]).all()
    past = forward(Rows(*(part[:-1] for part in of)), dynamics)
    last, found = past.steps[-1].update, past.estimate()
    mean, covariance = shown(last.mean, last.covariance + 0.5 * (TIMES[-1] - TIMES[-2]) * np.eye(3),
                             of.state[-1], np.hstack([np.zeros((2, 3)), of.columns[-1]]), found)
    sigma = np.sqrt(np.diag(covariance + of.noise[-1]))
    np.testing.assert_allclose(off[-1], (of.values[-1] - mean) / sigma, rtol=1e-6)


def test_all_jumps_at_once_gain_what_each_gains_by_itself():
    of, dynamics = rows(np.random.default_rng(5), columns=1), RandomWalk(np.diag([0.5, 0.0, 2.0]))
    base = forward(of, dynamics).log_likelihood(restricted=False)
    gains = jump_gains(forward(of, dynamics))
    for at in range(1, N):
        for place in range(3):
            step = of.state[:, :, [place]] * (np.arange(N) >= at)[:, None, None]
            more = of._replace(columns=np.concatenate([of.columns, step], axis=2))
            value = forward(more, dynamics).log_likelihood(restricted=False)
            assert gains[at, place] == pytest.approx(2.0 * (value - base), rel=1e-6)
    held = of._replace(columns=np.concatenate(
        [of.columns, of.state[:, :, [1]] * (np.arange(N) >= 3)[:, None, None]], axis=2))
    assert jump_gains(forward(held, dynamics))[3, 1] == 0.0
