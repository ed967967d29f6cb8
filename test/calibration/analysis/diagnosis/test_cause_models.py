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

"""The model with each of the equal causes: sizes, terms beside them, what is found again."""

from types import SimpleNamespace

import numpy as np
import pytest
from noisy_run import make_run
from simulated import night

from calibration.analysis.diagnosis.alternatives import cause_counts
from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.implausible_terms import sound_with
from msg_tools.units import ARCSEC


@pytest.fixture(scope='module')
def found():
    """What follows the elevation, and other curves of it do as well."""
    run = night(3, n=50, effect=lambda c: (0.0, 15.0 * ARCSEC * np.cos(3.0 * c['el'])))
    return diagnose(run, flips=199, cross_validation=False)


def test_each_cause_has_its_size_and_the_terms_beside_it(found):
    one = next(e for e in found.effects if len(e.causes) > 1)
    own = next(told for told in one.causes if one.fitted.effect.name in told['effects'])
    for coefficient, value, sigma in zip(own['fitted']['coefficients'], one.fitted.coefficients,
                                         one.fitted.sigma):
        assert coefficient['value_arcsec'] == pytest.approx(value / ARCSEC, rel=1e-6)
        assert coefficient['sigma_arcsec'] == pytest.approx(sigma / ARCSEC, rel=1e-6)
    others = [told for told in one.causes if told is not own and told['fitted']]
    assert others
    for told in others:
        assert set(told['fitted']['terms']) == set(found.model.terms)
        assert all(c['sigma_arcsec'] > 0.0 for c in told['fitted']['coefficients'])
    # they are other models: the terms beside them are others
    assert len({round(told['fitted']['terms']['TF']['value_arcsec'], 6)
                for told in (own, *others)}) == len(others) + 1
    beside = sound_with([one], 'TF')
    assert {told['cause'] for told in beside} <= {told['cause'] for told in others}
    assert all(told['value_arcsec'] > -4.0 * told['sigma_arcsec'] for told in beside)


def test_a_choice_repeated_counts_by_any_of_the_causes(found):
    one = next(e for e in found.effects if len(e.causes) > 1)
    chosen = [e.fitted.effect for e in found.effects]
    other = SimpleNamespace(name=one.alternatives[0], line='another')
    by_another = [other if e is one.fitted.effect else e for e in chosen]
    told = cause_counts([chosen, chosen[::-1], by_another], found.effects)
    assert told == {'same_set': 3, 'chosen_set': {e.name: 3 for e in chosen}, 'others_set': {}}
    unknown = SimpleNamespace(name='unknown', line='unknown')
    told = cause_counts([[], [*chosen, other], [unknown]], found.effects)
    assert told == {'same_set': 0, 'chosen_set': {e.name: 1 for e in chosen},
                    'others_set': {other.name: 1, 'unknown': 1}}


def test_each_run_alone_is_asked_for_one_of_the_causes():
    rng, parts = np.random.default_rng(3), []
    for i, size in enumerate((9.0, 9.0, 9.0, 9.0, 0.0)):
        run = make_run(rng, n=30, time=1.7e9 + 86400.0 * i + 100.0 * np.arange(30))
        run.columns['el_enc'] += size * ARCSEC * np.cos(2.0 * run['el'] + 2.0)
        parts.append(run)
    found = diagnose(parts, flips=199, folds=4, partitions=1)
    (one,) = found.effects
    spread = found.after['cv_spread']
    assert spread['runs'] == 5 and spread['runs_set'] == {one.fitted.effect.name: 4}
