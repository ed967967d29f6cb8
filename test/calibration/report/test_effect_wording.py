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

"""How much of a turn was observed, and both sizes of a wave of the first axis."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.analysis.diagnosis.effect_causes import cause_entry
from calibration.report.effect_wording import effect_summary, effect_title
from msg_tools.units import ARCSEC, DEG
from pointing_model.context import Context
from pointing_model.effects import effect
from pointing_model.mounts import Mount


def told(reach, contenders=(), order=2, size=(0.0, -10.0), beyond=(1.0, 0.0)):
    """Summary of a wave of the hour angle, rows to both sides of the meridian, deg."""
    rng = np.random.default_rng(1)
    mount = Mount.equatorial(33.0 * DEG)
    context = Context(np.linspace(-reach, reach, 40) * DEG, rng.uniform(-30.0, 70.0, 40) * DEG,
                      {}, mount=mount)
    e = effect('encoder', axis='az', order=order, mount='equatorial')
    columns = e.columns(context)
    fitted = SimpleNamespace(effect=e, coefficients=np.array(size) * ARCSEC,
                             sigma=np.full(2, ARCSEC))
    offsets = np.tensordot(size, columns, axes=1)
    found = SimpleNamespace(fitted=fitted, offsets=offsets,
                            beyond=np.multiply.outer(beyond, offsets[0]), removes_arcsec=4.5,
                            ranking=[], causes=[cause_entry(e, 90.0)], contenders=list(contenders))
    obs = SimpleNamespace(context=context, run=SimpleNamespace(meta={}))
    diagnosis = SimpleNamespace(observations=obs, weights=np.ones(40), effects=[found])
    return effect_summary(diagnosis, found), found, mount


def test_a_wave_has_both_sizes_and_where_it_was_observed():
    one, found, mount = told(64.0)
    # what the terms would take up of it moves no star by more
    for beyond, times in (((1.5, 0.0), 1.0), ((0.5, 0.0), 0.5), ((0.5, 0.7), 0.7)):
        assert told(64.0, beyond=beyond)[0].reach_arcsec == pytest.approx(
            times * one.reach_arcsec)
    assert '; ±10.0″ in the angle of the axis.' in one.lead
    assert float(re.search(r'([0-9.]+)″ peak to peak', one.lead)[1]) < 20.0
    assert 'twice per turn over the 128° observed' in one.lead
    assert 'it is +10.0″ near −45° and −10.0″ near 45°' in one.text
    assert 'Of the turn 128° of 360° were observed' in one.text
    # all around there is nothing to be said of it
    assert 'observed' not in told(170.0)[0].text
    assert effect_title(found, mount.names.axes) == 'hour angle encoder, 2 per turn'


def test_what_contends_is_in_the_head():
    other = effect('line_of_sight', order=2, mount='equatorial')
    entry = {**cause_entry(other, 49.0), 'behind': 45.0, 'alone': 111.0, 'found_alone': 110.0,
             'instead': 50, 'folds': 150, 'open': True}
    one, found, mount = told(64.0, [entry])
    assert one.lead.startswith(
        'The hour angle error has a wave, twice per turn over the 128° observed. Likely: hour '
        'angle encoder disc, worm wheel or horseshoe ring oval or tilted, or line of sight swings')
    assert effect_title(found, mount.names.axes) == (
        'hour angle error: wave vs hour angle, twice per turn')
    closed, *_ = told(64.0, [{**entry, 'open': False}])
    assert 'is read wrong twice per turn' in closed.lead
    assert 'Line of sight swings fits worse: ' in closed.text
