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

from calibration.analysis.external_check import external_check, split_half
from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.rms import rms_arcsec
from pointing_model.runs.run import PointingRun
from pointing_model.zero import PowerOnZero

MODEL = PointingModel(dict(zip(
    PHYSICAL, np.array([200, 100, 60, -90, 120, -130, 80]) * ARCSEC)))


def make_run(seed, n=60, noise=1.0, **columns):
    rng = np.random.default_rng(seed)
    az = rng.uniform(0, 2 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(np.radians(20)), np.sin(np.radians(85)), n))
    az_enc, el_enc = MODEL.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, n)) * noise * ARCSEC
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el),
                        'el_enc': el_enc + y, **columns})


@pytest.mark.parametrize('n', [2, 7, 30, 60, 61])
def test_halves(n):
    run = make_run(0, n)
    used = split_half(run, 3)
    assert abs(2 * used.sum() - n) <= 1
    assert np.array_equal(used, split_half(run, 3))
    if n >= 30:
        assert not np.array_equal(used, split_half(run, 4))


def test_halves_are_spread_over_the_sky():
    """The mean direction of a half stays nearer to that of all than with halves at random."""
    def distance(run, used):
        v = np.array([np.cos(run['el']) * np.sin(run['az']), np.cos(run['el']) * np.cos(run['az']),
                      np.sin(run['el'])])
        return np.linalg.norm(v[:, used].mean(axis=1) - v.mean(axis=1))

    rng = np.random.default_rng(1)
    stratified, random = [], []
    for seed in range(100):
        run = make_run(seed)
        stratified.append(distance(run, split_half(run, seed)))
        random.append(distance(run, rng.permutation(60) < 30))
    assert np.mean(stratified) < 0.6 * np.mean(random)


def test_halves_share_every_night():
    night = np.repeat([1, 2, 3, 4], [11, 20, 9, 20])
    run = make_run(2, 60, run=night)
    used = split_half(run, 5)
    for number in (1, 2, 3, 4):
        rows = night == number
        assert abs(2 * used[rows].sum() - rows.sum()) <= 1
    assert used.sum() == 30


def test_rows_of_one_star_are_in_one_half():
    run = make_run(3, 40)
    run = run.select(np.repeat(np.arange(40), 3))
    run.columns['time'] = 300.0 * np.repeat(np.arange(40), 3) + np.tile([0.0, 30.0, 60.0], 40)
    used = split_half(run).reshape(40, 3)
    assert np.array_equal(used.all(axis=1), used.any(axis=1)) and used.all(axis=1).sum() == 20


def test_held_out_error_of_seven_terms_on_thirty_stars():
    held_out = [external_check(make_run(seed), seed=seed).radial for seed in range(60)]
    assert np.median(held_out) <= 1.08 * 2**0.5
    assert np.median(held_out) > 0.98 * 2**0.5  # better than the noise would be a leak


def test_each_half_is_judged_by_a_fit_to_the_other():
    run = make_run(8)
    used = split_half(run, 2)
    parts = [rms_arcsec(*fit_terms(run.select(half)).model.residuals(run.select(~half)))
             for half in (used, ~used)]
    both = external_check(run, seed=2)
    assert both.n == 60
    for axis in ('x', 'y', 'radial'):
        assert getattr(both, axis)**2 == pytest.approx(
            sum(getattr(part, axis)**2 for part in parts) / 2)


def test_options():
    run = make_run(10)
    assert external_check(run, names=('IA', 'IE')).radial > 20
    shifted = PointingRun({**run.columns, 'az_enc': run['az_enc'] + 1e-3})
    zero = external_check(shifted, zero=PowerOnZero(1e-3, 0.0))
    assert zero.radial == pytest.approx(external_check(run).radial, rel=1e-6)


def test_bad_input():
    with pytest.raises(ValueError, match='1 observations'):
        split_half(make_run(0, 1))
    with pytest.raises(ValueError, match='3 usable'):
        external_check(make_run(0, 6))
