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

from calibration.analysis.tracking.innovations import Measurement
from calibration.analysis.tracking.motion_causes import TrackingSettings
from calibration.analysis.tracking.smoother import smooth
from calibration.analysis.tracking.tracker import Tracker
from calibration.estimation.gaussian_sum import GaussianSum, PossibleJump
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import design

N, HOUR = 3, 3_600_000_000_000


def observations(rng, count=8):
    return (rng.uniform(0.1, 0.5, count), rng.normal(size=(count, 2, N)),
            rng.normal(size=(count, 2)))


def dense(hours, columns, values, first, walk, decay, noise):
    """Posterior of the terms at all moments from all values, as one Gaussian of them all."""
    count = len(hours)
    times, n = np.cumsum(hours), len(first)
    joint = np.zeros((count, n, count, n))
    both = decay[:, None] + decay

    def at(t):  # covariance by then
        long = np.where(both > 0.0, -np.expm1(-both * t) / np.where(both > 0.0, both, 1.0), t)
        kept = np.exp(-decay * t)
        return first * np.outer(kept, kept) + walk * long

    for i, s in enumerate(times):
        for j, t in enumerate(times):
            early = at(min(s, t))
            later = np.exp(-decay * abs(s - t))
            joint[i, :, j] = early * later if i <= j else early * later[:, None]
    joint = joint.reshape(count * n, -1)
    rows = np.zeros((count, 2, count, n))
    rows[range(count), :, range(count)] = columns
    rows = rows.reshape(2 * count, -1)
    gain = joint @ rows.T @ np.linalg.inv(
        rows @ joint @ rows.T + noise**2 * np.eye(2 * count))
    covariance = joint - gain @ rows @ joint
    return ((gain @ values.ravel()).reshape(count, n),
            np.diagonal(covariance).reshape(count, n), covariance[-n:, -n:])


@pytest.mark.parametrize('memory', [(np.inf,) * N, (0.5, np.inf, 2.0)])
def test_without_changes_it_is_the_posterior_of_all_observations_at_once(memory):
    rng = np.random.default_rng(1)
    hours, columns, values = observations(rng)
    root = rng.normal(size=(N, N))
    walk, first = root @ root.T, np.diag([1.0, 2.0, 3.0])
    bank = GaussianSum(np.zeros(N), first, [walk], memory_h=memory, outliers=1e-12)
    for hour, column, value in zip(hours, columns, values):
        bank.wait(hour)
        bank.observe(column, value, [0.7, 0.7])
    means, _, covariance = dense(hours, columns, values, first, walk, 1.0 / np.array(memory), 0.7)
    np.testing.assert_allclose(bank.estimate()[0], means[-1], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(bank.estimate()[1], covariance, rtol=1e-5, atol=1e-9)


def test_joined_histories_have_the_mean_and_covariance_that_they_had():
    rng = np.random.default_rng(2)
    hours, columns, values = observations(rng, 2)
    jumps = [PossibleJump('first', np.eye(N)[:, :1], 5.0, 0.5),
             PossibleJump('second', np.eye(N)[:, 1:2], 5.0, 0.5)]
    banks = [GaussianSum(np.zeros(N), np.eye(N), [0.1 * np.eye(N), np.eye(N)], jumps=jumps,
                        outliers=0.2,
                         outlier_sigma=4.0, depth=depth, most=999) for depth in (1, 99)]
    for hour, column, value in zip(hours, columns, 3.0 * values):
        for bank in banks:
            bank.wait(hour)
            bank.observe(column, value, [0.5, 0.5])
    short, long = banks
    assert 1 < len(short.histories) < len(long.histories)
    for mine, other in zip(short.estimate(), long.estimate()):
        np.testing.assert_allclose(mine, other, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(short.chance(1), long.chance(1), rtol=1e-10)


def test_rates_are_others_after_a_while():
    prior = np.array([0.7, 0.3])
    bank = GaussianSum(np.zeros(N), np.eye(N), [1e-4 * np.eye(N), 10.0 * np.eye(N)], prior,
                      turn_h=5.0,
                      outlier_sigma=1e3)
    for _ in range(10):
        bank.wait(0.2)
        bank.observe(np.eye(N)[:2], [0.0, 0.0], [0.01, 0.01])
    assert bank.rate_weights()[0] > 0.95
    bank.wait(100.0)
    np.testing.assert_allclose(bank.rate_weights(), prior, rtol=1e-3)


def test_a_smoothed_night_is_the_posterior_of_the_whole_night():
    rng = np.random.default_rng(3)
    names = ('IA', 'IE', 'AN', 'AW')
    first = np.diag([4.0, 3.0, 2.0, 1.0]) * ARCSEC**2
    settings = TrackingSettings(zeros=(3 * ARCSEC,), tilts=(1 * ARCSEC,), jumps=((ARCSEC, 1e-9),),
                                knocks=(), wrong=1e-9)
    tracker = Tracker(PointingModel(dict.fromkeys(names, 0.0), first), 0, settings=settings)
    hours, az, el = rng.uniform(0.1, 0.5, (3, 10))
    values = rng.normal(size=(10, 2)) * 4.0 * ARCSEC
    stamps = np.rint(np.cumsum(hours) * HOUR).astype(np.int64)
    back = smooth(tracker, [Measurement('star', int(t), (a, e, *v, ARCSEC))
                               for t, a, e, v in zip(stamps, az, el, values)])
    means, variance, _ = dense(
        np.diff(stamps, prepend=0) / HOUR, np.stack(design(names, az, el), axis=1), values, first,
        np.diag([9.0, 9.0, 1.0, 1.0]) * ARCSEC**2, np.zeros(4), ARCSEC)
    np.testing.assert_allclose(back.terms, means, atol=2e-3 * ARCSEC)
    np.testing.assert_allclose(back.sigma, np.sqrt(variance), rtol=1e-3)


def test_terms_that_are_far_are_found_and_go_home_to_the_evening():
    names = dict(zip(('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW'), (100.0, 0.0, 400.0, 0.0, 300.0, 0.0)))
    evening = PointingModel({n: v * ARCSEC for n, v in names.items()},
                            np.diag([0.1, 0.1, 900.0, 0.1, 900.0, 900.0]) ** 2 * ARCSEC**2)
    off = {'IA': 3100.0, 'IE': 900.0, 'CA': 1000.0, 'AN': 1500.0, 'AW': -900.0}
    true = PointingModel({**evening.terms, **{n: v * ARCSEC for n, v in off.items()}})
    tracker = Tracker(evening, 0, settings=TrackingSettings(memory_h={'IA': 1.0}))
    assert tracker.power_on(1, sigma=3000.0 * ARCSEC).taken
    rng = np.random.default_rng(4)
    for k in range(1, 25):
        az, el = rng.uniform(0.0, 6.0), rng.uniform(0.4, 1.4)
        assert tracker.star(1000 + k, az, el, *true.offsets(az, el), 0.1 * ARCSEC).taken
    found, _ = tracker.terms()
    for name, value in true.terms.items():
        assert found[name] == pytest.approx(value, abs=1.5 * ARCSEC)
    assert tracker.power_on(20 * HOUR, sigma=1e-12).taken
    assert tracker.terms()[0]['IA'] == pytest.approx(100.0 * ARCSEC, abs=0.1 * ARCSEC)
    tracker.consistency.noise = 3.0
    update = tracker.star(20 * HOUR + 1, 1.0, 1.0, 0.0, 0.0, 1000.0 * ARCSEC)
    assert update.covariance[1, 1] > (2999.0 * ARCSEC) ** 2
