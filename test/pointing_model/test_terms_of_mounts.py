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

"""Terms of every mount: first-order columns are the derivatives of the exact rotations."""

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import Mount, through_pole
from pointing_model.pointing_terms import TERMS, Trig, design, known_terms, terms_of

FORK = Mount.equatorial(31.0 * DEG)
MOUNTS = [FORK, Mount.equatorial(-25.0 * DEG, 'german'), Mount.free(1.0, 0.3)]


def places(n=100, seed=1):
    rng = np.random.default_rng(seed)
    return through_pole(rng.uniform(-3.0, 3.0, n), rng.uniform(-1.2, 1.4, n), rng.random(n) < 0.5)


@pytest.mark.parametrize('mount', MOUNTS, ids=lambda m: m.kind)
def test_columns_are_derivatives_of_the_rotations_on_both_sides(mount):
    first, second = places()
    for name in mount.names.physical:
        plus, minus = (geometry.offsets(first, second, {name: s * 1e-6}, mount) for s in (1, -1))
        x, y = design([name], first, second, mount)
        np.testing.assert_allclose((plus[0] - minus[0]) / 2e-6, x[:, 0], atol=1e-8)
        np.testing.assert_allclose((plus[1] - minus[1]) / 2e-6, y[:, 0], atol=1e-8)


def test_equatorial_columns_are_those_of_the_field():
    """On the sky, hour angle and declination, not through the pole (Wallace, TPOINT)."""
    h, d = places(seed=2)
    h, d = h[np.cos(d) > 0.0], d[np.cos(d) > 0.0]
    phi, zero = 31.0 * DEG, 0.0 * h
    sin_e = np.cos(phi) * np.cos(h) * np.cos(d) + np.sin(phi) * np.sin(d)
    up = (-np.cos(phi) * np.sin(h),
          np.sin(phi) * np.cos(d) - np.cos(phi) * np.cos(h) * np.sin(d))
    for name, x, y in (
            ('IH', np.cos(d), zero), ('ID', zero, zero + 1.0), ('CH', zero + 1.0, zero),
            ('NP', np.sin(d), zero), ('MA', -np.cos(h) * np.sin(d), np.sin(h)),
            ('ME', np.sin(h) * np.sin(d), np.cos(h)), ('TF', *up),
            ('TX', up[0] / sin_e, up[1] / sin_e), ('FO', zero, np.cos(h)), ('DAF', -sin_e, zero),
            ('HCES', np.sin(h) * np.cos(d), zero), ('HCEC', np.cos(h) * np.cos(d), zero),
            ('DCES', zero, np.sin(d)), ('DCEC', zero, np.cos(d))):
        found = design([name], h, d, FORK)
        np.testing.assert_allclose(found[0][:, 0], x, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(found[1][:, 0], y, atol=1e-12, err_msg=name)


def test_one_sag_has_one_coefficient_on_any_mount():
    """What TF does to the star on the horizon is the same, whatever the axes are."""
    rng = np.random.default_rng(3)
    az, el = rng.uniform(0.0, 6.0, 50), rng.uniform(0.2, 1.4, 50)
    for mount in MOUNTS:
        for beyond in (False, True):
            first, second = mount.axes_of(az, el, beyond)
            x, y = design(['TF'], first, second, mount)
            tangents = mount.tangents(first, second)
            moved = x[:, 0] * tangents[0] + y[:, 0] * tangents[1]
            toward = Mount().tangents(az, el)[1]
            np.testing.assert_allclose(np.sum(moved * toward, axis=0), np.cos(el), atol=1e-12)
            np.testing.assert_allclose(np.linalg.norm(moved, axis=0), np.cos(el), atol=1e-12)


def test_the_zenith_has_no_direction_upward_and_no_number_is_lost():
    first, second = FORK.axes_of(0.0, np.pi / 2)
    x, y = Trig(first, second, FORK).lifted(1.0)
    assert np.isfinite([x, y]).all()


@pytest.mark.parametrize('kind', KINDS)
def test_every_kind_has_its_physical_terms(kind):
    names = KINDS[kind]
    assert set(names.physical) <= set(terms_of(kind))
    assert terms_of('altaz') is TERMS


def test_terms_of_another_mount_are_refused():
    with pytest.raises(ValueError, match='IA of an equatorial mount; choose from IH'):
        known_terms(['IA'], FORK)
    with pytest.raises(ValueError, match='IH; choose from IA'):
        known_terms(['IH'])


def test_size_of_the_second_order_near_the_pole():
    """At 89 degrees 60" of CH with 60" of MA leave an arcsecond in first order."""
    terms = {'CH': 60 * ARCSEC, 'MA': 60 * ARCSEC}
    h = np.linspace(-3.0, 3.0, 50)
    exact = np.array(geometry.offsets(h, 0.0 * h + 89.0 * DEG, terms, FORK))
    x, y = design(tuple(terms), h, 0.0 * h + 89.0 * DEG, FORK)
    linear = np.array([x @ list(terms.values()), y @ list(terms.values())])
    assert 0.5 < np.abs(exact - linear).max() / ARCSEC < 3.0
