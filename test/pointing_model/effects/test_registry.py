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

"""An effect is one function and one offer: everything else finds it by itself."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model import effects as package
from pointing_model.context import Context
from pointing_model.effects import (
    ORDER,
    Amount,
    base,
    dictionary,
    effect,
    effect_from_document,
    to_document,
)
from pointing_model.effects.base import arcsec
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel


@pytest.fixture
def context():
    rng = np.random.default_rng(2)
    n = 40
    return Context(rng.uniform(0.0, 6.0, n), rng.uniform(0.4, 1.3, n), {
        'time': 1.7e9 + 60.0 * np.arange(n), 'temperature': rng.normal(size=n),
        'approach_az': rng.choice([-1.0, 1.0], n), 'approach_el': rng.choice([-1.0, 1.0], n),
        'az_enc': rng.uniform(0.0, 6.0, n), 'el_enc': rng.uniform(0.4, 1.3, n),
        'miss_x': rng.normal(size=n), 'miss_y': rng.normal(size=n), 'fan': rng.normal(size=n),
        'magnitude': rng.normal(size=n), 'pier_side': rng.choice([-1.0, 1.0], n),
        'run': np.repeat([1, 2], n // 2)}, 0.6, 0.1)


@pytest.fixture
def swing(monkeypatch):
    """A new effect, as a module of the package would add it."""
    monkeypatch.setattr(base, '_FORMS', dict(base._FORMS))

    @base.form
    def _swing(order, scale=1.0):
        return base.Effect(
            f'swing_{order}', 'the tube swings', '(cos kA, 0)', 'azimuth', 'az', ('cos',),
            lambda c: [(scale * np.cos(order * c.az), 0.0)],
            lambda amount: f'The tube swings by {arcsec(amount.size)}', 'the tube')

    def propose(context, lacking, own):
        yield base.Offer('swing', [effect('swing', order=2)])
        yield base.Offer('swing', [], 'swing of the third order', 'nobody asked')

    module = SimpleNamespace(propose=propose)
    monkeypatch.setattr(package, '_MODULES', [*package._MODULES, module])


def test_a_new_effect_is_one_function_and_one_offer(context, swing):
    effects, untestable = dictionary(context)
    new = effects[-1]  # behind all others: they keep their places
    assert new.name == 'swing_2' and new.form == 'swing'
    assert new.parameters == {'order': 2, 'scale': 1.0}
    assert ('swing of the third order', 'nobody asked') in untestable
    assert new.clause(Amount(np.array([-2.0]))) == 'The tube swings by 2.00″'
    assert effect_from_document(json.loads(json.dumps(to_document(new)))) == new
    model = PointingModel({'IA': 0.0}, effects=[FittedEffect(new, np.array([3.0 * ARCSEC]))])
    again = PointingModel.from_json(model.to_json())
    assert again.offsets(0.3, 0.5)[0] == pytest.approx(3.0 * ARCSEC * np.cos(0.6))


def test_every_form_that_is_offered_has_its_place(context):
    offers = [o for module in package._MODULES if hasattr(module, 'propose')
              for o in module.propose(context, ('CA', 'HACA2'), ())]
    assert {f'{o.form} {o.axis}'.strip() for o in offers} >= set(ORDER)
    assert all(e.form == o.form for o in offers for e in o.effects)


def test_causes_stay_as_they_were_offered(context):
    names = [e.name for e in dictionary(context)[0]]
    first = [names.index(n) for n in (
        'refraction', 'elevation_encoder_1', 'azimuth_encoder_1', 'azimuth_bearing_wobble_1',
        'fork_cross_term', 'latitude', 'annual_aberration', 'azimuth_zero_with_time',
        'azimuth_hysteresis', 'azimuth_subdivision_grating_1', 'elevation_hysteresis',
        'camera_rotation', 'magnitude_equation_az', 'fan_az', 'azimuth_zero_per_run')]
    assert first == sorted(first)


def test_rows_keep_what_they_have_from_the_row_before(context):
    whole = {n: context.get(n) for n in ('travel_az', 'before_el', 'order')}
    for rows in (np.array([3, 4, 9]), slice(5, 20), np.arange(40) % 2 == 0):
        part = context.select(rows)
        for name, values in whole.items():
            np.testing.assert_array_equal(part.get(name), values[rows])
        np.testing.assert_array_equal(part.az, context.az[rows])
        assert part.latitude == context.latitude
