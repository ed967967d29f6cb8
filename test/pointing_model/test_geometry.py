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
from exact_rotations import LARGE, forward_by_matrices, offsets_and_jacobian

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.mount_kinds import CANONICAL
from pointing_model.mounts import ALTAZ, ON_SKY, Mount
from pointing_model.pointing_terms import design


def random_sky(n, top=1.55, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(-4, 8, n), rng.uniform(-0.2, top, n)


def on_sky(az, el, az2, el2):
    return np.hypot(wrap(az2 - az) * np.cos(el), el2 - el) / ARCSEC


def test_inverse_kinematics_against_rotation_matrices():
    az, el = random_sky(200)
    az_enc, el_enc = geometry.sky_to_encoder(az, el, LARGE)
    for i in range(200):
        a = az_enc[i] - LARGE['IA']
        e, high = el_enc[i] - LARGE['IE'], el[i] + LARGE['TF'] * np.cos(el[i])
        star = [np.cos(high) * np.sin(az[i]), np.cos(high) * np.cos(az[i]), np.sin(high)]
        assert np.linalg.norm(forward_by_matrices(a, e, LARGE) - star) < 1e-9 * ARCSEC + 5e-15


@pytest.mark.parametrize('name', CANONICAL)
def test_first_order_is_the_design_column(name):
    az, el = random_sky(200, top=1.45)
    h = 1e-5
    plus, minus = (geometry.offsets(az, el, {name: s * h}) for s in (1, -1))
    x, y = design([name], az, el)
    np.testing.assert_allclose((plus[0] - minus[0]) / (2 * h), x[:, 0], atol=1e-7)
    np.testing.assert_allclose((plus[1] - minus[1]) / (2 * h), y[:, 0], atol=1e-7)


def test_size_of_the_second_order():
    """60" of tilt with 60" of collimation leave a quarter of an arcsec at 85 deg, 300" 25 times."""

    def worst(size):
        out = 0.0
        for direction in np.linspace(0, 2 * np.pi, 73):
            c = {'AN': size * np.cos(direction) * ARCSEC, 'AW': size * np.sin(direction) * ARCSEC,
                 'CA': size * ARCSEC}
            columns = design(tuple(c), [0.4], [85 * DEG])
            exact = geometry.offsets(0.4, 85 * DEG, c)
            linear = [col[0] @ list(c.values()) for col in columns]
            out = max(out, np.hypot(exact[0] - linear[0], exact[1] - linear[1]) / ARCSEC)
        return out

    assert worst(60) == pytest.approx(0.26, abs=0.02)
    assert worst(300) == pytest.approx(6.5, rel=0.1)


@pytest.mark.parametrize('top', [1.4, np.pi / 2 - 600 * ARCSEC])
def test_both_ways(top):
    az, el = random_sky(2000, top)
    az2, el2 = geometry.encoder_to_sky(*geometry.sky_to_encoder(az, el, LARGE), LARGE)
    assert on_sky(az, el, az2, el2).max() < 1e-6
    assert np.abs(az2 - az).max() < np.pi  # the branch of the azimuth is kept


def test_both_ways_with_something_added():
    az, el = random_sky(500, 1.5)

    def added(az, el):
        return 40 * ARCSEC * np.sin(2 * az), 30 * ARCSEC * np.cos(3 * el)

    a, e = geometry.sky_to_encoder(az, el, LARGE)
    d_az, d_el = added(az, el)
    back = geometry.encoder_to_sky(a + d_az, e + d_el, LARGE, added)
    assert on_sky(az, el, *back).max() < 1e-6


def test_zenith_of_a_collimated_mount_cannot_be_seen():
    c = {'CA': 100 * ARCSEC}
    el = np.pi / 2 - np.array([50, 99, 101, 3600]) * ARCSEC
    az_enc, el_enc = geometry.sky_to_encoder(np.full(4, 1.0), el, c)
    assert np.isnan(az_enc).tolist() == [True, True, False, False]
    assert np.isnan(el_enc).tolist() == [True, True, False, False]
    # just outside the hole the axis is nearly a quarter of a turn away, and exact
    az, el2 = geometry.encoder_to_sky(az_enc[2:], el_enc[2:], c)
    assert on_sky(1.0, el[2:], az, el2).max() < 1e-6
    assert wrap(az_enc[2] - 1.0) > 80 * DEG


def test_perfect_mount_at_the_zenith():
    az_enc, el_enc = geometry.sky_to_encoder(1.0, np.pi / 2, {})
    assert az_enc == pytest.approx(1.0) and el_enc == pytest.approx(np.pi / 2)


def test_tube_past_the_zenith_is_understood_backwards():
    az, el = geometry.encoder_to_sky(0.5, 100 * DEG, {})
    assert el == pytest.approx(80 * DEG)
    assert wrap(az - 0.5 - np.pi) == pytest.approx(0.0, abs=1e-12)


def test_jacobian_by_differences():
    az, el = random_sky(200, 1.45)
    x, y, jacobian = offsets_and_jacobian(az, el, LARGE, CANONICAL)
    np.testing.assert_allclose(geometry.offsets(az, el, LARGE), (x, y), atol=1e-14)
    h = 1e-6
    for name in CANONICAL:
        plus, minus = (geometry.offsets(az, el, {**LARGE, name: LARGE[name] + s * h})
                       for s in (1, -1))
        for axis in (0, 1):
            difference = (plus[axis] - minus[axis]) / (2 * h)
            np.testing.assert_allclose(
                np.broadcast_to(jacobian[name][axis], az.shape), difference,
                atol=4e-3 if name == 'TF' else 2e-6)  # that of TF is of first order


def test_unknown_coefficient():
    with pytest.raises(ValueError, match='TX'):
        geometry.sky_to_encoder(0.0, 1.0, {'TX': 1.0})


@pytest.mark.parametrize('mount', [
    ALTAZ, Mount.equatorial(0.6), Mount.equatorial(-0.4, 'german'),
    Mount.equatorial(0.6, 'german').with_errors(ON_SKY), Mount.free(0.3, 0.4, 1.0)],
    ids=lambda m: m.kind + m.errors)
def test_many_as_few_and_back_everywhere(mount):
    """In blocks as one by one; back at the pole and at the zenith of any mount."""
    rng = np.random.default_rng(5)
    values = dict(zip(mount.names.terms, LARGE.values()))
    az, el = random_sky(20_000)
    if not mount.vertical:
        el = rng.uniform(-3.0, 3.0, len(el))
        near = 10.0 ** rng.uniform(-6.0, -2.0, (2, 500))
        az[:500] = np.arctan2(*mount.zenith[:2]) + near[0]
        el[:500] = np.arcsin(mount.zenith[2]) + near[1]
    el[500:1000] = np.pi / 2 - 10.0 ** rng.uniform(-2.0, -1.0, 500)
    az_enc, el_enc = geometry.sky_to_encoder(az, el, values, mount)
    few = rng.integers(0, len(az), 40)
    for i in few:
        one = geometry.sky_to_encoder(az[i], el[i], values, mount)
        np.testing.assert_allclose(one, (az_enc[i], el_enc[i]), rtol=0, atol=1e-10 * ARCSEC + 4e-15)
    seen = np.isfinite(az_enc) & (np.abs(np.cos(el)) > 0.008)  # where each has one place
    back = geometry.encoder_to_sky(az_enc[seen], el_enc[seen], values, mount=mount)
    assert on_sky(az[seen], el[seen], *back).max() < 1e-7
    # the same by the general way
    general = geometry.encoder_to_sky(az_enc[seen][900:], el_enc[seen][900:], values,
                                      lambda a, e: (0.0, 0.0), mount)
    assert on_sky(*(v[900:] for v in back), *general).max() < 1e-6


def test_a_place_that_is_no_number_changes_no_other():
    az, el = np.array([1.0, 1.0, 2.0, -2.0]), np.radians([60.0, 80.0, 80.0, 75.0])
    values = {'AN': 0.02, 'AW': -0.01, 'CA': 1e-4}
    expected = np.array(geometry.sky_to_encoder(az, el, values))
    az[0] = np.nan
    got = np.array(geometry.sky_to_encoder(az, el, values))
    assert np.isnan(got[0, 0])
    np.testing.assert_allclose(got[:, 1:], expected[:, 1:], rtol=0, atol=1e-14)


@pytest.mark.parametrize('mount', [ALTAZ, Mount.equatorial(0.6)], ids=['altaz', 'equatorial'])
def test_derivatives_at_one_place_are_those_of_an_array(mount):
    names = list(mount.names.terms)
    values = dict(zip(names, np.array([10, 20, 30, -40, 50, -60, 15]) * 1e-6))
    az, el = np.array([0.7]), np.array([0.9])
    x, y, columns = offsets_and_jacobian(az, el, values, names, mount)
    one_x, one_y, one = offsets_and_jacobian(0.7, 0.9, values, names, mount)
    assert (one_x, one_y) == pytest.approx((x[0], y[0]), abs=1e-15)
    for name in names:
        for got, expected in zip(one[name], columns[name]):
            assert np.ravel(got)[0] == pytest.approx(np.ravel(expected)[0], abs=1e-14)
