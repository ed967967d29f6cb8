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

"""Standard errors of a model that is refitted in a program's terms."""

from dataclasses import replace

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.model_files.term_columns import on_sky
from pointing_model.runs.model_files.transfer import export, uniform_sky
from pointing_model.runs.programs import PROGRAMS

SEVEN = dict(zip(PHYSICAL, np.array([412.5, -31.25, 25.0, -18.5, 30.75, -22.0, 15.5]) * ARCSEC))
SKY = uniform_sky(200)


def test_a_refit_carries_the_errors_of_the_model():
    # a saw of elevation, which TPOINT has no term for: the file's terms are refitted
    saw = effect('smooth', axis='el', driver='elevation', shape='sawtooth', start=0.2,
                 period=0.4)
    rng = np.random.default_rng(4)
    root = rng.normal(size=(7, 7)) * 0.3 * ARCSEC
    model = PointingModel(SEVEN, geometry='first_order')
    model = replace(model, covariance=root @ root.T, effects=[
        FittedEffect(saw, [3.0 * ARCSEC], [0.5 * ARCSEC])])
    exported = export(model, PROGRAMS['tpoint'])
    assert exported.refitted
    found = PROGRAMS['tpoint'].read('a.mod', exported.text)
    # what is written is how the values scatter where the model does
    drawn = []
    for _ in range(200):
        terms = dict(zip(model.terms, np.array(list(model.terms.values()))
                         + root @ rng.normal(size=7)))
        drawn.append(refitted(replace(model, terms=terms, effects=[
            FittedEffect(saw, [(3.0 + 0.5 * rng.normal()) * ARCSEC])]), list(found.terms)))
    for name, scatter in zip(found.terms, np.std(drawn, axis=0)):
        assert found.sigma[name] == pytest.approx(scatter, rel=0.25), name
    bare = export(replace(model, covariance=None, effects=[FittedEffect(saw, [3.0 * ARCSEC])]),
                  PROGRAMS['tpoint'])
    assert any('no standard errors' in note for note in bare.notes)
    assert not any('no standard errors' in note for note in exported.notes)


def refitted(model, names):
    """Coefficients of some TPOINT terms that are nearest to a model, to first order."""
    columns = []
    for name in names:
        columns.append(sum(share * np.ravel(on_sky(key, SKY.az, SKY.el))
                           for key, share in PROGRAMS['tpoint'].column(name)))
    left = np.ravel(np.stack(model.offsets(SKY.az, SKY.el, SKY)))
    return np.linalg.lstsq(np.stack(columns, axis=1), left, rcond=1e-6)[0]
