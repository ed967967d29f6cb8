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

from dataclasses import replace

import numpy as np
import pytest

from calibration.analysis.refit import going_on, held_within, left_out, refitted
from msg_tools.units import ARCSEC
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import Harmonics
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))
START, PACE = 1_768_482_000.0, 15.0


def rows(seed, move, n=90, noise=1.0, run=None):
    """Stars whose elevation encoder reads `move` (n,) arcsec too much."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, n)) * noise * ARCSEC
    return PointingRun({
        'time': START + PACE * np.arange(n), 'az': az, 'el': el,
        'az_enc': az_enc + x / np.cos(el), 'el_enc': el_enc + y + move * ARCSEC,
        'run': np.ones(n) if run is None else run})


def drifting(n=90):
    """The mount with a drift of the elevation zero, and a step that is none."""
    middle = START + 0.5 * PACE * (n - 1)
    about = {'of': 'IE', 'driver': 'time', 'origin': middle, 'scale': 3600.0,
             'within': [START, START + PACE * n]}
    return replace(MOUNT, effects=[
        FittedEffect(effect('drift', **about, power=1), [0.0]),
        FittedEffect(effect('step', axis='az', at=middle), [0.0])])


U = np.linspace(0.0, 1.0, 90)


def test_a_drift_goes_on_where_the_end_of_the_night_was_predicted_better_with_it():
    assert going_on(drifting(), rows(1, 12.0 * U)) == [1.0, 0.0]
    # up, and down again: half of the night says on, the end says no
    assert going_on(drifting(), rows(1, 24.0 * np.minimum(U, 1.0 - U))) == [0.0, 0.0]
    # too small to be seen at the end, and too few rows
    assert going_on(drifting(), rows(1, 0.3 * U)) == [0.0, 0.0]
    assert going_on(drifting(), rows(1, 12.0 * U[:12], n=12)) == [0.0, 0.0]


def test_a_random_walk_is_mostly_held():
    reached = []
    for seed in range(60):
        walk = np.cumsum(np.random.default_rng(1000 + seed).normal(size=90)) * 0.6
        reached.append(going_on(drifting(), rows(seed, walk))[0])
    assert np.mean(np.array(reached) > 0.0) < 0.35


def test_terms_effects_and_zeros_of_runs_are_fitted_anew():
    run = np.repeat([1.0, 2.0], 45)
    observed = rows(3, 10.0 * (run == 1.0) + 8.0 * U - 4.0, noise=0.2, run=run)
    model = drifting()
    again, shifts = refitted(model, observed, model.effects[:1])
    assert len(again.effects) == 1
    assert shifts[1.0] / ARCSEC == pytest.approx([0.0, 10.0], abs=0.4)
    hours = PACE * 89 / 3600.0
    assert again.effects[0].coefficients[0] * hours / ARCSEC == pytest.approx(8.0, abs=0.6)
    for name in PHYSICAL:
        assert again.terms[name] / ARCSEC == pytest.approx(MOUNT.terms[name] / ARCSEC, abs=0.6)
    assert np.sqrt(again.covariance[0, 0]) / ARCSEC < 0.5
    # to some of the rows only
    wild = rows(3, 8.0 * U - 4.0 + 500.0 * (U > 0.8), noise=0.2)
    part, _ = refitted(model, wild, model.effects[:1], U <= 0.8)
    assert part.terms['IE'] / ARCSEC == pytest.approx(-170.0, abs=0.6)
    with pytest.raises(ValueError, match='observe more'):
        refitted(model, observed, (), U < 0.02)


def test_what_is_held_ends_at_once():
    held = held_within(drifting().effects[0], START, START + 100.0)
    assert held.effect.parameters['within'] == [START, START + 100.0]


def test_the_end_and_some_of_the_others_are_left_out():
    hidden = left_out(rows(1, U))
    assert hidden.sum() == 22 and hidden[-11:].all() and 0 < hidden[:45].sum() < 11
    assert not left_out(rows(1, U[:20], n=20)).any()
    shuffled = rows(1, U).select(np.arange(90)[::-1])
    assert left_out(shuffled)[:11].all()


def test_harmonics_are_fitted_again_with_the_terms():
    """They had taken a part of what another effect does, and give it back."""
    rng = np.random.default_rng(3)
    series = Harmonics.from_degree(2, 'printed', rng.normal(size=14) * 4 * ARCSEC,
                                   np.zeros((14, 14)))
    mount = replace(MOUNT, harmonics=series)
    observed = rows(5, 0.0, noise=0.1)
    x, y = series.offsets(observed['az'], observed['el'])
    observed.columns['az_enc'] = observed['az_enc'] + x / np.cos(observed['el'])
    observed.columns['el_enc'] = observed['el_enc'] + y
    wrong = replace(mount, harmonics=series.moved(rng.normal(size=14) * 5 * ARCSEC, np.eye(14)))
    assert np.std(wrong.residuals(observed)) > 2.0 * ARCSEC
    again, _ = refitted(wrong, observed, ())
    assert np.std(again.residuals(observed)) < 0.12 * ARCSEC
    assert (again.harmonics.interpretation, again.harmonics.degree) == ('printed', 2)
    assert again.harmonics.covariance.any()
