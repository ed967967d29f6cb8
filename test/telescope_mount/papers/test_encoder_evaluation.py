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

from msg_tools.units import ARCSEC
from telescope_mount.papers.encoder_evaluation import (
    TABLE_2_MEASURED,
    TABLE_2_STANDARD,
    evaluate,
    harmonic_verdict,
    sigma_interval,
)

PRINTED_ERRORS = [
    0.64, -7.27, -7.59, 6.28, 3.88, 0.67, -0.27, -6.41, 6.31, 7.71, 1.76, 3.92, 6.8, 3.75, 0.23,
    2.71, -0.34, -4.89, -1.78, 7.39, -0.43, -1.56, 2.99]


def test_table_2():
    found = evaluate(TABLE_2_MEASURED, TABLE_2_STANDARD)
    assert found.graduation_errors / ARCSEC == pytest.approx(PRINTED_ERRORS, abs=1e-6)
    assert found.mean / ARCSEC == pytest.approx(1.065, abs=5e-4)
    assert found.std / ARCSEC == pytest.approx(4.571, abs=5e-4)
    assert found.largest / ARCSEC == pytest.approx(7.71, abs=1e-6)
    assert found.smallest / ARCSEC == pytest.approx(0.23, abs=1e-6)
    # the printed standard angles are 23 equal parts, cut off at 0.1"
    exact = 2 * np.pi * np.arange(23) / 23
    assert np.abs(TABLE_2_STANDARD - exact).max() < 0.1 * ARCSEC


def test_nothing_found_in_table_2():
    verdict = harmonic_verdict(np.array(PRINTED_ERRORS) * ARCSEC)
    assert not verdict.found and verdict.holm.min() > 0.9
    assert verdict.std_without / ARCSEC == pytest.approx(2.43, abs=0.005)
    assert verdict.left_out / ARCSEC == pytest.approx(4.67, abs=0.005)
    assert verdict.left_out_without / ARCSEC == pytest.approx(5.47, abs=0.005)


def test_harmonics_against_a_plain_fit():
    from scipy.special import fdtrc

    n, rng = 23, np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(n) / n
    errors = rng.normal(size=n) + 1.5 * np.cos(2 * angle - 0.4)
    verdict = harmonic_verdict(errors)
    assert verdict.found and np.argmin(verdict.holm) == 1
    for k in range(1, 7):
        columns = np.stack([np.ones(n), np.cos(k * angle), np.sin(k * angle)], axis=1)
        rest = errors - columns @ np.linalg.lstsq(columns, errors, rcond=None)[0]
        centred = errors - errors.mean()
        f = (centred @ centred - rest @ rest) / 2 / (rest @ rest / (n - 3))
        assert verdict.p_values[k - 1] == pytest.approx(fdtrc(2, n - 3, f), rel=1e-9)
    # leave one out in earnest
    columns = np.stack([np.ones(n), *(g(k * angle) for k in range(1, 7) for g in (np.cos, np.sin))],
                       axis=1)
    misses = []
    for i in range(n):
        keep = np.arange(n) != i
        fit = np.linalg.lstsq(columns[keep], errors[keep], rcond=None)[0]
        misses.append(errors[i] - columns[i] @ fit)
    assert verdict.left_out_without == pytest.approx(np.sqrt(np.mean(np.square(misses))), rel=1e-9)
    with pytest.raises(ValueError, match='more than 13'):
        harmonic_verdict(np.ones(13))


def test_evaluation_takes_differences_around_the_turn():
    found = evaluate([2 * np.pi - 1e-6, 1.0], [1e-6, 1.0 + 2e-6])
    assert found.graduation_errors == pytest.approx([-2e-6, -2e-6], abs=1e-12)
    assert found.std == pytest.approx(0.0, abs=1e-12)
    assert evaluate([1e-6, 3e-6], [0.0, 0.0]).std == pytest.approx(np.sqrt(2.0) * 1e-6)


@pytest.mark.parametrize('measured, standard, text', [
    ([1.0], [1.0], 'at least two'),
    ([1.0, 2.0], [1.0, 2.0, 3.0], 'as many'),
    ([1.0, np.nan], [1.0, 2.0], 'angle 2 is not a finite number'),
])
def test_bad_angles(measured, standard, text):
    with pytest.raises(ValueError, match=text):
        evaluate(measured, standard)


def test_interval_of_sigma():
    # 22 degrees of freedom: chi square 10.982 and 36.781
    assert sigma_interval(4.57, 23) == pytest.approx((3.534, 6.468), abs=0.002)
