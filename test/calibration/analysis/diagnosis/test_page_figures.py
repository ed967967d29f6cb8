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

"""Figures beside the result: the part of an effect that counts, correlations, histograms."""

import numpy as np
import pytest

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.page_figures import beyond_base
from calibration.report.effect_wording import ends
from calibration.report.residual_figures import histogram
from msg_tools.units import ARCSEC
from pointing_model.pointing_terms import PHYSICAL, stacked_design
from pointing_model.rms import rms
from pointing_model.runs.run import PointingRun


@pytest.fixture(scope='module')
def found():
    rng = np.random.default_rng(4)
    n = 60
    az, el = rng.uniform(0.0, 6.28, n), np.arcsin(rng.uniform(0.35, 0.98, n))
    side = rng.choice([-1.0, 1.0], n)
    x, y = rng.normal(size=(2, n))
    return diagnose(PointingRun({
        'az': az, 'el': el, 'az_enc': az + (x + 5.0 * side) * ARCSEC / np.cos(el),
        'el_enc': el + y * ARCSEC, 'approach_az': side}), flips=199, cross_validation=False)


def test_what_the_terms_take_up_is_no_part_of_an_effect(found):
    moved = found.effects[0].offsets
    assert np.abs(moved[0]) == pytest.approx(np.full(60, 5.0), abs=0.6) and not moved[1].any()
    size = rms(*beyond_base(found, moved))
    assert 4.0 < size < 5.6
    context = found.observations.context
    taken = 30.0 * stacked_design(('AN',), context.az, context.el)[0].reshape(2, -1)
    assert np.abs(beyond_base(found, taken)).max() < 1e-6
    assert rms(*beyond_base(found, moved + taken)) == pytest.approx(size)


def test_places_are_of_neighbours_and_only_of_what_is_followed():
    # both sides of the pier of a German mount, declination beyond 90 degrees through the pole:
    # the sky has an error of the hour angle with both signs, and both extremes at one hour angle
    rng = np.random.default_rng(3)
    hour, dec = rng.uniform(0.0, np.pi, 300), rng.uniform(-0.4, 1.4, 300)
    beyond = np.where(rng.random(300) < 0.5, dec, np.pi - dec)
    wave = 20.0 * np.cos(hour)
    low, high = ends(np.degrees(hour), wave)
    assert low.at > 170.0 and high.at < 10.0 and low.end and high.end
    reversed_ = wave * np.cos(beyond)
    assert ends(np.degrees(hour), reversed_) is None
    # shrunk by the other axis it is followed still
    low, high = ends(np.degrees(hour), wave * np.cos(dec))
    assert low.at > 130.0 and high.at < 50.0
    assert ends(np.full(8, np.nan), np.zeros(8)) is None


def test_a_plateau_is_no_place_and_an_end_no_extremum():
    el = np.linspace(20.0, 88.0, 120)
    low, high = ends(el, -np.sin(np.radians(el)))
    # flat near the zenith, steep at the horizon: both are where the rows end
    assert low.end and low.high == 88.0 and low.low < 75.0
    assert high.end and high.at == 20.0 and high.high < 30.0
    low, high = ends(el, np.cos(np.radians(6.0 * (el - 54.0))))
    assert not high.end and 45.0 < high.low <= high.at <= high.high < 63.0
    # all round an axis there is no end
    az = np.linspace(0.0, 359.0, 120)
    assert not any(one.end for one in ends(az, np.cos(np.radians(az))))


def test_what_is_drawn_of_an_effect_is_its_own(found):
    own, = (one.own for one in found.effects)
    used = found.weights > 0.0
    columns = found.base.columns(found.observations.context, found.observations.label)
    both = np.concatenate((used, used))
    assert np.abs(columns.common[:, both] @ own.reshape(-1)[both]).max() < 1e-6
    assert np.isnan(own[:, ~used]).all()
    # of one effect alone it is what its size is told of
    assert np.sqrt(np.square(own[:, used]).sum() / used.sum()) == pytest.approx(
        found.effects[0].removes_arcsec)


def test_correlations_are_those_of_the_fit(found):
    names, matrix = found.correlations
    assert names == [*((t, None) for t in PHYSICAL),
                     ('azimuth_hysteresis', 'half_difference')]
    size = np.sqrt(np.diag(found.model.covariance))
    assert matrix[:7, :7] == pytest.approx(found.model.covariance / np.outer(size, size), abs=0.05)
    assert np.diag(matrix) == pytest.approx(np.ones(8))


def test_histograms_count_every_row():
    rng = np.random.default_rng(1)
    before, after = 3.0 * rng.normal(size=500), rng.normal(size=500)
    edges, counts, sigmas = histogram(before, after, 2.0)
    assert len(edges) % 2 == 0 and edges[0] == -2.0 and edges[-1] == 2.0
    assert [c.sum() for c in counts] == [500, 500] and counts[0][0] > counts[1][0]
    assert sigmas == pytest.approx([3.0, 1.0], rel=0.1)
