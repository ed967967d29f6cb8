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

from calibration.analysis.zero.power_on_zeros import night_zeros, zero_from_exposures
from calibration.calibration_state import CalibrationState
from calibration.night_series import NightSeries
from calibration.report.zero_wording import zero_statement
from calibration.rows import zero_exposures_by_power_on
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.pointing_terms import design
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP
from pointing_model.zero import MARK, is_for_zero, way_of

ZERO = np.array([20.0, -15.0]) * ARCSEC  # coordinate angles
CHANGE = np.array([11.0, -7.0]) * ARCSEC
VALUES = np.array([200.0, 100.0, 60.0, -90.0, 120.0, -130.0, 80.0]) * ARCSEC
FORK = Mount.equatorial(31.0 * DEG)


def model_of(mount=ALTAZ, values=VALUES, noise=1.0, seed=0):
    """A model and the covariance that 30 stars with such noise give it."""
    rng = np.random.default_rng([9, seed])
    az, el = rng.uniform(0.0, 2.0 * np.pi, 30), np.arcsin(rng.uniform(0.35, 0.99, 30))
    first, second = mount.axes_of(az, el) if not mount.vertical else (az, el)
    names = mount.names.physical
    columns = np.concatenate(design(names, first, second, mount))
    return PointingModel(dict(zip(names, values)),
                         np.linalg.inv(columns.T @ columns) * (noise * ARCSEC) ** 2, mount=mount)


def four(mount=ALTAZ, turned=0.0):
    """Axis angles of sixteen exposures, of four stars; and their numbers."""
    star = np.repeat(np.arange(4), 4)
    az = np.array([77.0, 41.0, 272.0, 181.0])[star] * DEG + turned + 0.0005 * np.arange(16)
    el = np.array([32.0, 33.0, 64.0, 35.0])[star] * DEG
    return (*(mount.axes_of(az, el) if not mount.vertical else (az, el)), 100.0 + star)


def exposed(rng, truth, zero, place=None, run=1, noise=1.0, mark=1.0):
    """Exposures through `truth`; the encoder reads `zero` too much."""
    mount = truth.mount
    az, el, star = place or four(mount)
    n = len(az)
    first, second = truth.sky_to_encoder(az, el)
    dx, dy = rng.normal(size=(2, n)) * noise * ARCSEC
    return PointingRun({
        'az': az, 'el': el, 'az_enc': wrap(first + zero[0] + dx / np.cos(el)),
        'el_enc': second + zero[1] + dy, 'star': star, 'run': np.full(n, float(run)),
        MARK: np.full(n, mark)}, {} if mount.vertical else {'mount': mount})


def drawn(rng, model):
    """A truth that the model's covariance allows."""
    values = np.array(list(model.terms.values())) + np.linalg.cholesky(model.covariance) @ (
        rng.normal(size=len(model.terms)))
    return PointingModel(dict(zip(model.terms, values)), mount=model.mount)


@pytest.mark.parametrize('mount', [ALTAZ, FORK], ids=['altaz', 'fork'])
def test_the_errors_are_what_sigma_says_with_the_covariance_of_the_held_terms(mount):
    model, error, sigma = model_of(mount), [], []
    for seed in range(80):
        rng = np.random.default_rng([1, seed])
        zero = zero_from_exposures(exposed(rng, drawn(rng, model), ZERO), model, run=3)
        error.append(zero.angles - ZERO)
        sigma.append(zero.sigma)
    error, sigma = np.array(error), np.array(sigma)
    assert np.all(np.abs(error.mean(axis=0)) < 4.0 * error.std(axis=0) / np.sqrt(80))
    # Student's factor and the weights that reject widen it by 6 %
    np.testing.assert_allclose(error.std(axis=0), sigma.mean(axis=0), rtol=0.22)
    inside = np.mean(np.abs(error) < sigma, axis=0)
    assert np.all(np.abs(inside - 0.683) < 0.11), inside
    # without the covariance of what is held it would say too little
    night = exposed(rng, model, ZERO)
    zero, certain = (zero_from_exposures(night, PointingModel(model.terms, c, mount=mount))
                     for c in (model.covariance, None))
    assert np.all(certain.sigma < 0.97 * zero.sigma) and zero.by == 'stars (4)'


def test_noise_free_exposures_give_the_zero_itself():
    model = model_of()
    zero = zero_from_exposures(
        exposed(np.random.default_rng(0), model, ZERO, noise=0.0), model, run=2)
    np.testing.assert_allclose(zero.angles, ZERO, atol=1e-6 * ARCSEC)
    assert (zero.run, zero.n, zero.rejected, zero.misfit) == (2, 16, 0, 1.0)


def test_without_a_model_the_terms_cancel_in_the_change_of_the_same_stars():
    truth = PointingModel(dict(zip(ALTAZ.names.physical, 2.0 * VALUES)))
    error, sigma, alone = [], [], []
    for seed in range(24):
        rng = np.random.default_rng([2, seed])
        then = exposed(rng, truth, ZERO)
        now = exposed(rng, truth, ZERO + CHANGE, four(turned=3.0 * DEG), run=2)
        change = zero_from_exposures(now, then, run=2, reference_name='power-on 1')
        error.append(change.angles - CHANGE)
        sigma.append(change.sigma)
        zeros, _ = night_zeros(PointingRun.concatenate([then, now]), None)
        np.testing.assert_allclose(zeros[2].angles - zeros[1].angles, change.angles,
                                   atol=0.05 * ARCSEC)
        # all power-ons together tell IA and IE themselves, as far as they can
        alone.append((zeros[1].angles - ZERO - 2.0 * VALUES[:2]) / zeros[1].sigma)
    error, sigma = np.array(error), np.array(sigma)
    assert np.all(np.abs(error.mean(axis=0)) < 4.0 * error.std(axis=0) / np.sqrt(24))
    np.testing.assert_allclose(error.std(axis=0), sigma.mean(axis=0), rtol=0.32)
    assert np.all(sigma.mean(axis=0) < [0.75 * ARCSEC, 0.5 * ARCSEC])
    assert np.all(np.sqrt(np.mean(np.square(alone), axis=0)) < 1.25)
    assert change.reference == '16 exposures of stars (4), power-on 1'


def test_what_a_changed_term_does_is_told():
    model, rng = model_of(), np.random.default_rng(3)
    for name in ('CA', 'AW', 'TF'):
        changed = PointingModel({**model.terms, name: model.terms[name] + ARCSEC})
        zero = zero_from_exposures(exposed(rng, changed, ZERO, noise=1e-3), model)
        told = [zero.contamination[axis].get(name, 0.0) for axis in ('az', 'el')]
        np.testing.assert_allclose((zero.angles - ZERO) / ARCSEC, told, atol=0.02)
        assert f'{name} {told[name == "TF"]:+.2f}' in zero_statement(zero)


def test_stars_that_contradict_the_model_widen_the_sigma_and_say_so():
    model, rng = model_of(), np.random.default_rng(4)
    leant = PointingModel({**model.terms, 'AN': model.terms['AN'] + 10.0 * ARCSEC})
    plain, zero = (zero_from_exposures(exposed(rng, truth, ZERO), model)
                   for truth in (model, leant))
    assert zero.misfit > 3.0 and zero.sigma_el > 3.0 * plain.sigma_el
    assert 'the stars disagree' in zero_statement(zero) and 'disagree' not in zero_statement(plain)
    assert zero.to_dict()['misfit'] == zero.misfit


def test_one_wild_exposure_does_not_move_it():
    model = model_of()
    night = exposed(np.random.default_rng(5), model, ZERO)
    clean = zero_from_exposures(night, model)
    night['az_enc'][5] += 25.0 * ARCSEC
    zero = zero_from_exposures(night, model)
    assert (zero.rejected, zero.n) == (1, 15)
    np.testing.assert_allclose(zero.angles, clean.angles, atol=0.3 * ARCSEC)


def test_sigmas_that_are_given_are_taken():
    model = model_of(noise=1e-3)
    night = exposed(np.random.default_rng(6), model, ZERO)
    zero = zero_from_exposures(PointingRun({
        **night.columns, 'sigma_x': np.full(16, ARCSEC), 'sigma_y': np.full(16, 2.0 * ARCSEC)}),
        model)
    assert zero.sigma_from == 'given sigmas'
    # sigma / sqrt(16), little widened by the weights that reject
    assert zero.sigma_el / ARCSEC == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize('exposures, why', [
    (0, 'no usable exposure for a zero'), (1, 'one exposure for a zero .tonight. has no scatter')])
def test_too_few_exposures_are_refused(exposures, why):
    model = model_of()
    night = exposed(np.random.default_rng(7), model, ZERO)
    night['az_enc'][exposures:] = np.nan
    with pytest.raises(ValueError, match=why):
        zero_from_exposures(night, model)


# --- a night ------------------------------------------------------------------------------------


def night(seed=8, second_by_polaris=False):
    """Blocks of a night in the south, in order."""
    rng = np.random.default_rng(seed)
    truth = PointingModel(dict(zip(ALTAZ.names.physical, VALUES)))

    def field(run, zero):
        n = 24
        az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
        return exposed(rng, truth, zero, (az, el, 1000.0 * run + np.arange(n)), run, mark=0.0)
    after = exposed(rng, truth, ZERO + CHANGE, run=2)
    if second_by_polaris:
        place = 0.01 + 0.001 * np.arange(16), np.full(16, 34.3 * DEG), np.full(16, POLARIS_HIP)
        after = exposed(rng, truth, ZERO + CHANGE, place, 2, mark=0.0)
    return [field(1, ZERO), exposed(rng, truth, ZERO), after, field(2, ZERO + CHANGE)]


def session(blocks):
    out = CalibrationState()
    for number, block in enumerate(blocks):
        out.add(block, (number + 1) * 10**9)
    return out


def test_a_night_without_polaris_says_by_which_way_its_zeros_are():
    collected = session(night())
    run, zero = collected.calibrate_zero()
    assert run == 2 and zero.by == 'stars (4)'
    _, report = collected.fit()
    assert report['stars'] == 48 and report['polaris'] == 0
    change, = report['changes']
    for axis, wanted in zip(('az', 'el'), CHANGE / ARCSEC):
        assert abs(change[f'{axis}_arcsec'] - wanted) < 3.5 * change[f'sigma_{axis}_arcsec'] < 3.5
    assert [zero['by'] for zero in report['zeros']] == ['stars (4)'] * 2
    assert report['steps'][1]['step'] == 'zero set on stars'
    check = [row['check'] for row in report['external_check']]
    assert check[-1].endswith('zero by stars')
    assert report['external_check'][-1]['radial'] < 2.5
    # the zero in force goes with terms that were fitted: it does not hold their errors
    measured = collected.zeros.newest
    assert measured.sigma_az > 2.0 * np.sqrt(measured.with_fitted_terms[0, 0])


def test_polaris_in_one_power_on_and_stars_in_the_other():
    collected = session(night(second_by_polaris=True))
    _, zero = collected.calibrate_zero()
    assert zero.by == 'Polaris' and collected.zeros[1].by == 'stars (4)'
    _, report = collected.fit()
    change, = report['changes']
    for axis, wanted in zip(('az', 'el'), CHANGE / ARCSEC):
        assert abs(change[f'{axis}_arcsec'] - wanted) < 3.5 * change[f'sigma_{axis}_arcsec']
    assert report['polaris'] == 16


def test_exposures_for_a_zero_are_those_of_polaris_and_those_with_a_mark():
    rows = PointingRun.concatenate(night(second_by_polaris=True))
    assert is_for_zero(rows).sum() == 32
    assert [(number, way_of(part)) for number, part in zero_exposures_by_power_on(rows)] == [
        (1, 'stars (4)'), (2, 'Polaris')]
    old = PointingRun({n: v for n, v in rows.columns.items() if n != MARK})
    assert is_for_zero(old).sum() == 16


def test_a_power_on_with_one_exposure_does_not_keep_the_next_from_its_zero():
    blocks = night()
    blocks[1] = blocks[1].select(slice(0, 1))
    collected = session(blocks)
    run, zero = collected.calibrate_zero()
    assert run == 2 and zero.by == 'stars (4)' and list(collected.zeros) == [2]
    with pytest.raises(ValueError, match='one exposure for a zero'):
        session(blocks[:2]).calibrate_zero()


def test_nights_in_a_row_are_judged_with_zeros_by_stars():
    series = NightSeries(1)
    rng = np.random.default_rng(11)
    truth = PointingModel(dict(zip(ALTAZ.names.physical, VALUES)))
    for number in (1, 2, 3):
        zero = ZERO + number * CHANGE
        blocks = []
        for k, n in enumerate((24, 16, 24)):
            place, mark = four(turned=0.1 * number), float(k == 1)
            if k != 1:
                place = (rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n)),
                         1000.0 * number + 100.0 * k + np.arange(n))
            block = exposed(rng, truth, zero, place, number, mark=mark)
            time = 1e5 * number + 1e3 * k + np.arange(n)
            blocks.append(PointingRun({**block.columns, 'time': time}))
        for k, block in enumerate(blocks):
            series.add(block, number * 10**12 + k)
            if k == 1:
                series.calibrate_zero()
        _, report = series.fit()
    assert [row['night'] for row in report['nights']] == [2, 3]
    after = report['nights'][-1]['physical']
    assert after['zero']['by'] == 'stars (4)'
    for axis, wanted in zip(('az', 'el'), CHANGE / ARCSEC):
        sigma = after['zero'][f'sigma_{axis}_arcsec']
        assert abs(after[f'change_{axis}_arcsec'] - wanted) < 4.0 * np.hypot(sigma, 0.5)
    # the mean of the stars after the zero, in units of what is expected of it
    for axis in ('az', 'el'):
        sigma = after['after'][f'{axis}_sigma_arcsec']
        assert 0.2 < sigma < 1.0 and abs(after['after'][f'{axis}_mean_arcsec']) < 4.0 * sigma
    seasons = [row['zero_arcsec'] for row in report['power_ons']]
    np.testing.assert_allclose(np.diff(seasons, axis=0), [CHANGE / ARCSEC] * 2, atol=2.5)
