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

"""A long run, of which a part is looked at."""

import json

import numpy as np
import pytest

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.observations import observations
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_view import view_of
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun

TRUTH = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))


def night(seed, n=400, effect=None, noise=None, **terms):
    """Stars above 20 degrees; `effect(columns) -> (x, y)` in arcsec on the sky."""
    rng = np.random.default_rng(seed)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
    az_enc, el_enc = geometry.sky_to_encoder(az, el, {**TRUTH, **terms})
    columns = {
        'az': az, 'el': el, 'time': 1.7e9 + 86400.0 * seed + np.cumsum(rng.uniform(30.0, 60.0, n)),
        'approach_az': np.sign(np.append(1.0, np.diff(az))),
        'approach_el': np.sign(np.append(1.0, np.diff(el))), 'magnitude': rng.uniform(1.0, 6.0, n)}
    e = rng.normal(size=(2, n)) if noise is None else noise(rng, el)
    x, y = (0.0, 0.0) if effect is None else effect(columns)
    columns['az_enc'] = az_enc + (x + e[0]) * ARCSEC / np.cos(el)
    columns['el_enc'] = el_enc + (y + e[1]) * ARCSEC
    return PointingRun(columns)


def two(c):
    return 1.4 * np.cos(2.0 * c['az']) * np.cos(c['el']), 1.2 * c['approach_el']


@pytest.fixture(scope='module')
def both():
    """A part of 750 rows, and all."""
    run = PointingRun.concatenate([night(50 + i, n=250, effect=two) for i in range(3)])
    run.columns['az_enc'][7] += 900.0 * ARCSEC
    return (diagnose(run, most_rows=300, holdout=night(60, effect=two), folds=3),
            diagnose(run, cross_validation=False, flips=299))


def test_a_part_of_the_rows_finds_what_all_of_them_do(both):
    part, whole = both
    assert len(part.observations) == 300 and len(part.observations.whole) == 750
    values = {e.fitted.effect.name: e.fitted for e in part.effects}
    assert set(values) == {'azimuth_encoder_2', 'elevation_hysteresis'}
    for e in whole.effects:
        other = values[e.fitted.effect.name]
        assert np.abs((other.coefficients - e.fitted.coefficients) / other.sigma).max() < 3.0
        # the model is of all rows
        np.testing.assert_allclose(other.sigma, e.fitted.sigma, rtol=0.05)
    assert part.noise_floor_arcsec == pytest.approx(whole.noise_floor_arcsec, rel=0.05)
    assert 1.38 < part.after['holdout_rms_arcsec'] < part.before['holdout_rms_arcsec']


def test_it_says_how_many_rows_and_what_that_costs(both):
    part, whole = both
    told = part.to_dict()
    json.dumps(told)
    assert (told['rows_read'], told['rows_not_drawn']) == (750, 450)
    assert told['detection_factor'] == pytest.approx((750 / 300)**0.5, rel=0.01)
    assert told['after']['cv_rms_arcsec'] is not None
    assert whole.to_dict()['rows_not_drawn'] == 0 and whole.to_dict()['detection_factor'] == 1.0
    (note,) = (wording(n) for n in part.notes if n.kind == 'rows searched')
    assert note.startswith('300 of 750 rows') and '1.6 times those of' in note
    assert 'rows searched' not in [n.kind for n in whole.notes]
    assert '300 of 750 rows, spread evenly over' in render(view_of(part))


def test_the_part_is_spread_over_each_run_and_keeps_short_ones():
    some = [night(80 + i, n=n, effect=two, IA=(20.0 + 300.0 * i) * ARCSEC)
            for i, n in enumerate((2000, 40, 20))]
    obs = observations(some)
    part = obs.thinned(500, np.random.default_rng(1))
    assert np.bincount(part.label).tolist() == [round(500 / 2060 * 2000), 30, 20]
    assert (np.diff(part.lines[part.label == 0]) > 0).all()
    assert np.diff(part.lines[part.label == 0]).max() < 3 * 2060 / 500
    # what a row has of the one before stays
    at = np.searchsorted(obs.run['time'][:2000], part.run['time'][part.label == 0])
    np.testing.assert_array_equal(part.run['approach_az'][part.label == 0],
                                  obs.run['approach_az'][at])


def test_nothing_is_found_in_noise_that_grows_toward_the_horizon():
    run = PointingRun.concatenate([
        night(70 + i, noise=lambda rng, el: rng.normal(size=(2, len(el))) / np.sin(el))
        for i in range(3)])
    result = diagnose(run, most_rows=600, cross_validation=False)
    assert result.verdict == 'none' and result.effects == []
    assert result.before == result.after
