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

from calibration.analysis.zero.power_on_zeros import zero_from_exposures
from calibration.report.zero_wording import zero_document, zero_statement
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP

LATITUDE = 34.3 * DEG
MOUNT = PointingModel(dict(zip(
    PHYSICAL, np.array([200, 100, 60, -90, 120, -130, 80]) * ARCSEC)))
ZERO = np.array([20.0, -15.0]) * ARCSEC  # coordinate angles


def polaris(rng, n, start=None):
    hour = (rng.uniform(0, 2 * np.pi) if start is None else start) + 0.02 * np.arange(n)
    radius = 0.65 * DEG
    return radius * np.sin(hour) / np.cos(LATITUDE), LATITUDE + radius * np.cos(hour)


def exposures(rng, n, zero=ZERO, noise=1.0, mount=MOUNT, start=None):
    az, el = polaris(rng, n, start)
    x, y = mount.offsets(az, el)
    dx, dy = rng.normal(size=(2, n)) * noise * ARCSEC
    return exposed(az, el, x + zero[0] * np.cos(el) + dx, y + zero[1] + dy)


def exposed(az, el, x, y, **columns):
    return PointingRun({'az': az, 'el': el, 'star': np.full(len(az), POLARIS_HIP),
                        'az_enc': az + x / np.cos(el), 'el_enc': el + y,
                        **columns})


def test_zero_is_a_coordinate_angle_to_subtract():
    rng = np.random.default_rng(0)
    night = exposures(rng, 4, noise=0)
    zero = zero_from_exposures(night, MOUNT)
    assert zero.az == pytest.approx(ZERO[0], abs=1e-9 * ARCSEC)
    assert zero.el == pytest.approx(ZERO[1], abs=1e-9 * ARCSEC)
    np.testing.assert_allclose(
        (night['az_enc'] - zero.az, night['el_enc'] - zero.el),
        MOUNT.sky_to_encoder(night['az'], night['el']), atol=1e-12)
    assert zero.to_dict()['az_arcsec'] == pytest.approx(20.0)


@pytest.mark.parametrize('kind', ['model', 'exposures'])
def test_two_hundred_nights(kind):
    error, sigma = [], []
    for seed in range(200):
        rng = np.random.default_rng([1, seed])
        night = exposures(rng, 16)
        if kind == 'model':
            zero = zero_from_exposures(night, MOUNT)
        else:
            reference = exposures(rng, 16, (0.0, 0.0))
            zero = zero_from_exposures(night, reference, model=MOUNT)
        error.append([zero.az - ZERO[0], zero.el - ZERO[1]])
        sigma.append([zero.sigma_az, zero.sigma_el])
    error, sigma = np.array(error) / ARCSEC, np.array(sigma) / ARCSEC
    expected = np.array([1 / np.cos(LATITUDE), 1.0]) / 4 * (2**0.5 if kind == 'exposures' else 1)
    assert np.all(np.abs(error.mean(axis=0)) < 4 * expected / np.sqrt(200))
    np.testing.assert_allclose(error.std(axis=0), expected, rtol=0.18)
    np.testing.assert_allclose(sigma.mean(axis=0), expected, rtol=0.10)
    inside = np.mean(np.abs(error) < sigma, axis=0)
    assert np.all(np.abs(inside - 0.683) < 0.11)


@pytest.mark.parametrize('n', [2, 3, 4, 6])
def test_few_exposures_hold_68_percent(n):
    inside = 0
    for seed in range(150):
        zero = zero_from_exposures(exposures(np.random.default_rng([2, n, seed]), n), MOUNT)
        inside += int(abs(zero.az - ZERO[0]) < zero.sigma_az) + int(
            abs(zero.el - ZERO[1]) < zero.sigma_el)
    assert inside / 300 == pytest.approx(0.683, abs=0.08)


def test_one_wild_exposure_does_not_move_it():
    night = exposures(np.random.default_rng(3), 16)
    clean = zero_from_exposures(night.select(slice(1, None)), MOUNT)
    night['az_enc'][0] += 20 * ARCSEC / np.cos(night['el'][0])
    zero = zero_from_exposures(night, MOUNT)
    assert zero.rejected == 1 and zero.n == 15
    assert zero.az == pytest.approx(clean.az, abs=0.15 * ARCSEC)
    assert zero.sigma_az == pytest.approx(clean.sigma_az, rel=0.15)


def test_one_exposure_needs_a_sigma():
    night = exposures(np.random.default_rng(4), 1)
    with pytest.raises(ValueError, match='sigma'):
        zero_from_exposures(night, MOUNT)
    sigmas = {'sigma_x': np.array([ARCSEC]), 'sigma_y': np.array([2 * ARCSEC])}
    zero = zero_from_exposures(PointingRun({**night.columns, **sigmas}), MOUNT)
    assert zero.sigma_from == 'given sigmas' and zero.n == 1
    # 1.21 sigma_x at latitude 34.3 degrees
    assert zero.sigma_az / ARCSEC == pytest.approx(1.21, abs=0.02)
    assert zero.sigma_el / ARCSEC == pytest.approx(2.0)


def test_the_reference_adds_its_own_uncertainty():
    night = exposures(np.random.default_rng(5), 16, noise=0.1)
    covariance = np.zeros((7, 7))
    covariance[0, 0] = (3 * ARCSEC) ** 2  # IA: straight into the azimuth
    covariance[2, 2] = (1 * ARCSEC) ** 2  # CA: through 1 / cos E
    covariance[4, 4] = (2 * ARCSEC) ** 2  # AN: into the elevation
    zero = zero_from_exposures(night, PointingModel(MOUNT.terms, covariance))
    assert zero.sigma_az / ARCSEC == pytest.approx(np.hypot(3, 1.21), rel=0.01)
    assert zero.sigma_el / ARCSEC == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize('name', PHYSICAL)
def test_contamination_is_what_a_changed_term_does(name):
    rng = np.random.default_rng(6)
    changed = PointingModel({**MOUNT.terms, name: MOUNT.terms[name] + ARCSEC})
    night = exposures(rng, 5, (0.0, 0.0), 0, changed)
    zero = zero_from_exposures(night, MOUNT)
    if name in ('IA', 'IE'):
        expected = (1.0, 0.0) if name == 'IA' else (0.0, 1.0)
    else:
        expected = [zero.contamination[axis].get(name, 0.0) for axis in ('az', 'el')]
    assert zero.az / ARCSEC == pytest.approx(expected[0], abs=0.01)
    assert zero.el / ARCSEC == pytest.approx(expected[1], abs=0.01)


def test_contamination_numbers_at_this_latitude():
    zero = zero_from_exposures(exposures(np.random.default_rng(7), 16, start=0.0), MOUNT)
    assert zero.contamination['az']['CA'] == pytest.approx(1 / np.cos(LATITUDE), rel=0.02)
    assert zero.contamination['az']['NPAE'] == pytest.approx(np.tan(LATITUDE), rel=0.03)
    assert zero.contamination['az']['AW'] == pytest.approx(np.tan(LATITUDE), rel=0.03)
    assert zero.contamination['el']['AN'] == pytest.approx(1.0, rel=0.01)
    assert zero.contamination['el']['TF'] == pytest.approx(np.cos(LATITUDE), rel=0.02)
    assert 'CA' not in zero.contamination['el'] and 'TF' not in zero.contamination['az']


def test_model_takes_out_the_circle_of_polaris():
    rng = np.random.default_rng(8)
    night = exposures(rng, 16, noise=0, start=0.0)
    reference = exposures(rng, 16, (0.0, 0.0), 0, start=np.pi)
    raw = zero_from_exposures(night, reference)
    assert abs(raw.az - ZERO[0]) > 1 * ARCSEC
    zero = zero_from_exposures(night, reference, model=MOUNT)
    assert zero.az == pytest.approx(ZERO[0], abs=1e-8 * ARCSEC)
    assert zero.el == pytest.approx(ZERO[1], abs=1e-8 * ARCSEC)


def test_unusable_exposures():
    night = exposures(np.random.default_rng(9), 8)
    night['az_enc'][2] = np.nan
    zero = zero_from_exposures(night, MOUNT)
    assert zero.n == 7
    with pytest.raises(ValueError, match='second'):
        zero_from_exposures(night, MOUNT, model=MOUNT)
    night['az_enc'][:] = np.nan
    with pytest.raises(ValueError, match='no usable exposure'):
        zero_from_exposures(night, MOUNT)


def test_the_power_on_and_the_encoder_are_told():
    night = exposures(np.random.default_rng(10), 8)
    both = PointingRun({**night.columns, 'az_abs': night['az_enc'] + 1e-4,
                        'el_abs': night['el_enc'] - 2e-4})
    first, second = (zero_from_exposures(both, MOUNT, encoder=encoder, run=3)
                     for encoder in ('enc', 'abs'))
    assert first.run == 3 and first.to_dict()['run'] == 3
    np.testing.assert_allclose(second.angles - first.angles, [1e-4, -2e-4], atol=1e-12)


def test_the_statement_names_what_polaris_cannot_tell_from_the_zero():
    """Erratum 4: IA + CA / cos E + (NPAE + AW) tan E and IE + AN + TF cos E, at the pole."""
    el = 34.3 * DEG
    now = exposed(np.zeros(4), np.full(4, el), np.zeros(4), np.zeros(4),
                  sigma_x=np.full(4, 1e-6), sigma_y=np.full(4, 1e-6))
    zero = zero_from_exposures(now, now, reference_name='night 3')
    text = zero_statement(zero)
    azimuth, elevation = text.split('; elevation by ')
    for words in (f'CA {1 / np.cos(el):+.2f}″', f'NPAE {np.tan(el):+.2f}″',
                  f'AW {np.tan(el):+.2f}″',
                  'night 3'):
        assert words in azimuth, words
    assert elevation == f'AN +1.00″, TF {np.cos(el):+.2f}″'
    assert zero_document(zero)['statement'] == text
    assert 'no reference model' in zero_statement(zero_from_exposures(now, PointingModel({})))
