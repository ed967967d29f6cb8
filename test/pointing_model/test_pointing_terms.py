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

from pointing_model.pointing_terms import PHYSICAL, STANDARD6, TERMS, Trig, design, stacked_design


def test_columns_are_those_of_the_convention():
    az, el = np.radians([0.0, 90.0, 200.0]), np.radians([30.0, 60.0, 45.0])
    sa, ca, se, ce = np.sin(az), np.cos(az), np.sin(el), np.cos(el)
    zero, one = np.zeros(3), np.ones(3)
    expected = {
        'IA': (ce, zero), 'IE': (zero, one), 'CA': (one, zero), 'NPAE': (se, zero),
        'AN': (sa * se, ca), 'AW': (ca * se, -sa), 'TF': (zero, ce), 'TX': (zero, ce / se),
    }
    for name, (x, y) in expected.items():
        got = TERMS[name].of(Trig(az, el))
        np.testing.assert_allclose(got[0], x, atol=1e-15, err_msg=name)
        np.testing.assert_allclose(got[1], y, atol=1e-15, err_msg=name)


def test_design_stacks_all_terms_in_order():
    rng = np.random.default_rng(0)
    az, el = rng.uniform(0, 6, 7), rng.uniform(0.2, 1.5, 7)
    x, y = design(tuple(TERMS), az, el)
    assert x.shape == y.shape == (7, len(TERMS))
    for i, term in enumerate(TERMS.values()):
        np.testing.assert_array_equal(x[:, i], term.of(Trig(az, el))[0])
        np.testing.assert_array_equal(y[:, i], term.of(Trig(az, el))[1])
    both = stacked_design(tuple(TERMS), az, el)
    np.testing.assert_array_equal(both, np.hstack((x.T, y.T)))


def test_tpoint_signs():
    """Wallace's corrections take the encoder to the star, azimuth S=0, E=90: recompute them."""
    az, el = 0.7, 0.9
    their_az = np.pi - az
    tan = np.tan(el)
    # name -> (d their azimuth, d elevation), encoder -> star, in TPOINT's own formulae
    theirs = {
        'IA': (1, 0), 'IE': (0, 1), 'CA': (1 / np.cos(el), 0), 'NPAE': (tan, 0),
        'AN': (np.sin(their_az) * tan, np.cos(their_az)),
        'AW': (-np.cos(their_az) * tan, np.sin(their_az)),
        'TF': (0, -np.cos(el)), 'TX': (0, -1 / tan),
        'ACES': (np.sin(their_az), 0), 'ACEC': (np.cos(their_az), 0), 'ECES': (0, np.sin(el)),
        'HASA2': (np.sin(2 * their_az), 0), 'HACA2': (np.cos(2 * their_az), 0),
        'HESA2': (0, np.sin(2 * their_az)), 'HECA2': (0, np.cos(2 * their_az)),
        'HESA': (0, np.sin(their_az)), 'HECA': (0, np.cos(their_az)),
        'HESE2': (0, np.sin(2 * el)), 'HECE2': (0, np.cos(2 * el)),
        'HVSA2': (np.sin(2 * their_az) * tan, 0), 'HVCA2': (np.cos(2 * their_az) * tan, 0),
    }
    assert set(theirs) == {t.name for t in TERMS.values() if t.tpoint_sign}
    for term in TERMS.values():
        if term.tpoint_sign is None:
            continue
        d_az, d_el = theirs[term.name]
        # encoder - star is the opposite correction, and our azimuth runs the other way
        x, y = term.of(Trig(az, el))
        assert x * term.tpoint_sign == pytest.approx(d_az * np.cos(el), abs=1e-14), term.name
        assert y * term.tpoint_sign == pytest.approx(-d_el, abs=1e-14), term.name


def test_named_sets():
    assert PHYSICAL == ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF')
    assert set(PHYSICAL) - set(STANDARD6) == {'NPAE'}


@pytest.mark.parametrize('names, word', [(('IA', 'XX'), 'XX'), (('IA', 'IA'), 'twice')])
def test_bad_names(names, word):
    with pytest.raises(ValueError, match=word):
        design(names, [0.1], [0.2])
