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

"""The Kalman solver: time-varying and constant coefficients from rows in order of time.

A row is the sum of the state (coefficients with `dynamics`), constant coefficients times their
columns, and noise. Constant coefficients and an unknown initial state are not part of the filtered
state: the filter runs over the values and over their columns alike, and generalised least squares
of the innovations of both gives them exactly (de Jong 1991, Annals of Statistics 19, 1073). The
backward pass (de Jong 1989, J. Am. Stat. Assoc. 84, 1085) gives score and information of an impulse
on the state before each row; from these follow the smoothed state and the gain of a jump there.

    passed = forward(rows, RandomWalk(rate))
    passed.log_likelihood(), passed.estimate(), smoothed(passed), jump_gains(passed)

`predict` and `update` are single steps, for filters that run live (`gaussian_sum`).
"""

from typing import NamedTuple

import numpy as np

from .dynamics import Transition
from .estimate import Estimate

#: part of the information on a jump that must remain with the columns fitted: with less the
#: columns explain it
_HELD = 1e-6
#: prior information on coefficients, over that of all rows; a prediction whose variance exceeds
#: that of the known coefficients by this factor is undetermined
_BEFORE, _NOTHING = 1e-12, 1e8


class Rows(NamedTuple):
    """Rows in order of time, each of some values.

    Attributes
    ----------
    time : ndarray, shape (n,)
    state : sequence of ndarray, shape (m, s)
        Design of the state in each row.
    values : sequence of ndarray, shape (m,)
    noise : sequence of ndarray, shape (..., m, m)
        Covariance of the noise; for several hypotheses at once.
    columns : sequence of ndarray, shape (m, c)
        Design of the constant coefficients.
    """

    time: np.ndarray
    state: object
    values: object
    noise: object
    columns: object


class Update(NamedTuple):
    """The filter's update with a row."""

    mean: np.ndarray  # (..., s, d), state after the update
    covariance: np.ndarray  # (..., s, s)
    innovation: np.ndarray  # (..., m, d), values less their prediction
    spread: np.ndarray  # (..., m, m), covariance of the innovation
    whitening: np.ndarray  # (..., m, m), `whitening_of` the spread
    gain: np.ndarray  # (..., s, m), Kalman gain


def predict(mean, covariance, transition):
    """Mean (..., s, d) and covariance (..., s, s) of a state after a `Transition`."""
    if transition.matrix is not None:
        mean = transition.matrix @ mean
        covariance = transition.matrix @ covariance @ transition.matrix.T
    return mean, covariance + transition.added


def innovation_of(mean, covariance, state, values, noise):
    """Innovation of values (m, d), shape (..., m, d), and its covariance, shape (..., m, m)."""
    return values - state @ mean, state @ covariance @ state.T + noise


def update(mean, covariance, state, values, noise):
    """`Update` of a state with values (m, d), whose design of the state is `state` (m, s)."""
    innovation, spread = innovation_of(mean, covariance, state, values, noise)
    whitening = whitening_of(spread)
    across = whitening @ (state @ covariance)
    back = np.swapaxes(across, -1, -2)
    gain = back @ whitening
    return Update(mean + gain @ innovation, covariance - back @ across, innovation, spread,
                  whitening, gain)


def whitening_of(spread):
    """Lower triangular matrices (..., m, m) that whiten noise of the covariance `spread`."""
    if spread.shape[-1] != 2:
        return np.linalg.inv(np.linalg.cholesky(spread))
    # a star has two values, and a tracker takes thousands of pairs at once
    out = np.zeros_like(spread)
    out[..., 0, 0] = 1.0 / np.sqrt(spread[..., 0, 0])
    slope = spread[..., 1, 0] / spread[..., 0, 0]
    out[..., 1, 1] = 1.0 / np.sqrt(spread[..., 1, 1] - slope * spread[..., 1, 0])
    out[..., 1, 0] = -slope * out[..., 1, 1]
    return out


def log_det_of(whitening):
    """ln of the determinant of the covariance from its whitening matrix."""
    return -2.0 * np.log(np.diagonal(whitening, axis1=-2, axis2=-1)).sum(axis=-1)


class Step(NamedTuple):
    """One row of a forward pass."""

    transition: Transition  # from the row before
    mean: np.ndarray  # (..., s, d), predicted state, before the update
    covariance: np.ndarray  # (..., s, s)
    state: np.ndarray  # (m, s)
    columns: np.ndarray  # (m, d - 1), of the coefficients
    update: Update


class ForwardPass(NamedTuple):
    """Result of the forward filter; d is 1 (the values) plus the number of coefficients.

    The coefficients are the initial state, where unknown, then those of the columns.
    """

    steps: list
    whitened: np.ndarray  # (..., values of all rows, d), whitened innovations
    log_det: np.ndarray  # (...), ln of the determinant of the covariance of all values
    unknown: int  # number of coefficients that are the initial state

    def log_likelihood(self, restricted=True, of=slice(None)):
        """Log likelihood of the rows, (...), but for a constant.

        Parameters
        ----------
        restricted : bool
            REML; otherwise at the best coefficients.
        of : sequence of int, optional
            Indices of the coefficients in the model; all by default.
        """
        columns = self.whitened[..., 1:][..., of]
        best, left, normal = _least_squares(self.whitened[..., 0], columns)
        out = -0.5 * (self.log_det + np.square(left).sum(axis=-1))
        return out - 0.5 * np.linalg.slogdet(normal)[1] if restricted else out

    def estimate(self):
        """`Estimate` of the coefficients; residuals and scatter are in sigmas."""
        best, left, normal = _least_squares(self.whitened[:, 0], self.whitened[:, 1:])
        scatter = np.sqrt(left @ left / max(len(left) - len(best), 1))
        return Estimate(best, np.linalg.inv(normal), np.full(len(best), np.inf),
                        (float(scatter),), left, np.ones(len(self.steps)), len(best),
                        log_likelihood=float(self.log_likelihood()))


def _least_squares(values, columns):
    """Coefficients (..., c), residuals (..., N), and the normal matrix (..., c, c)."""
    back = np.swapaxes(columns, -1, -2)
    normal = back @ columns
    best = np.linalg.solve(normal, back @ values[..., None])
    return best[..., 0], values - (columns @ best)[..., 0], normal


def forward(rows, dynamics, start=None, begin=None):
    """Run the Kalman filter over rows in order.

    Parameters
    ----------
    rows : Rows
    dynamics : object
        Dynamics of the state; see `dynamics`.
    start : (ndarray, ndarray), optional
        Mean (s,) and covariance (s, s) of the initial state; None: unknown.
    begin : float, optional
        Time of the initial state; by default that of the first row.

    Returns
    -------
    ForwardPass
    """
    size = rows.state[0].shape[1]
    unknown = size if start is None else 0
    d = 1 + unknown + rows.columns[0].shape[1]
    mean, covariance = np.zeros((size, d)), np.zeros((size, size))
    if start is None:
        mean[:, 1:1 + size] = -np.eye(size)
    else:
        mean[:, 0], covariance = start
    at, steps, whitened, log_det = rows.time[0] if begin is None else begin, [], [], 0.0
    for time, state, values, noise, columns in zip(*rows):
        transition = dynamics.over(at, time)
        mean, covariance = predict(mean, covariance, transition)
        at, own = time, np.hstack([np.zeros((len(values), unknown)), columns])
        new = update(mean, covariance, state, np.column_stack([values, own]), noise)
        steps.append(Step(transition, mean, covariance, state, own, new))
        mean, covariance = new.mean, new.covariance
        whitened.append(new.whitening @ new.innovation)
        log_det = log_det + log_det_of(new.whitening)
    return ForwardPass(steps, np.concatenate(whitened, axis=-2), log_det, unknown)


def backward(passed):
    """Score (..., s, d) and information (..., s, s) of an impulse on the state before each row."""
    score, information, out = 0.0, 0.0, []
    for step in reversed(passed.steps):
        new = step.update
        seen = new.whitening @ step.state
        keep = np.eye(step.state.shape[1]) - new.gain @ step.state
        back = np.swapaxes(keep, -1, -2)
        if out:
            score, information = back @ score, back @ information @ keep
        score = np.swapaxes(seen, -1, -2) @ (new.whitening @ new.innovation) + score
        information = np.swapaxes(seen, -1, -2) @ seen + information
        out.append((score, information))
        if step.transition.matrix is not None:
            back = step.transition.matrix.T
            score, information = back @ score, back @ information @ step.transition.matrix
    return out[::-1]


def smoothed(passed):
    """Smoothed mean (..., s, d) and covariance (..., s, s) of the state at each row.

    The covariance is for known coefficients; `shown` adds their uncertainty.
    """
    return [(step.mean + step.covariance @ score,
             step.covariance - step.covariance @ information @ step.covariance)
            for step, (score, information) in zip(passed.steps, backward(passed))]


def shown(mean, covariance, state, columns, found):
    """Predicted values of a row from state and coefficients, and their covariance, without noise.

    Parameters
    ----------
    mean, covariance
        State, shapes (s, d) and (s, s).
    state : ndarray, shape (m, s)
    columns : ndarray, shape (m, d - 1)
        Design of all coefficients; 0 for those of an unknown initial state.
    found : Estimate

    Returns
    -------
    mean : ndarray, shape (m,)
    covariance : ndarray, shape (m, m)
    """
    expected = state @ mean
    by_coefficients = columns - expected[:, 1:]
    return (expected[:, 0] + by_coefficients @ found.coefficients,
            state @ covariance @ state.T
            + by_coefficients @ found.covariance @ by_coefficients.T)


def normalised_innovations(passed):
    """Innovations over their standard deviations, each value by itself.

    Returns
    -------
    ndarray, shape (n, m)
        NaN where the rows before do not determine the prediction.
    """
    normal, out = _BEFORE * np.diag(np.square(passed.whitened[:, 1:]).sum(axis=0)), []
    right = np.zeros(len(normal))
    for step in passed.steps:
        new = step.update
        across = new.innovation[:, 1:]
        best = np.linalg.solve(normal, np.column_stack([right, across.T]))
        own = np.diag(new.spread)
        variance = own + np.einsum('ij,ji->i', across, best[:, 1:])
        off = new.innovation[:, 0] - across @ best[:, 0]
        out.append(np.where(variance < _NOTHING * own, off / np.sqrt(variance), np.nan))
        white = new.whitening @ new.innovation
        normal, right = normal + white[:, 1:].T @ white[:, 1:], right + white[:, 1:].T @ white[:, 0]
    return np.array(out)


def jump_gains(passed):
    """Likelihood gain of a jump of each coefficient of the state before each row.

    De Jong and Penzer 1998, J. Am. Stat. Assoc. 93, 796, section 3: all together cost as much as
    one filter.

    Returns
    -------
    ndarray, shape (n, s)
        Twice the difference of the log likelihoods; 0 where the columns already explain the jump.
    """
    found, out = passed.estimate(), []
    for score, information in backward(passed):
        there, across = np.diag(information), score[:, 1:]
        left = there - np.einsum('ij,jk,ik->i', across, found.covariance, across)
        known = left > _HELD * there
        off = score[:, 0] - across @ found.coefficients
        out.append(np.where(known, off**2 / np.where(known, left, 1.0), 0.0))
    return np.array(out)
