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

"""What lost its place to a found effect: said, and where it is chosen often the cause is open."""

from dataclasses import replace

import numpy as np
from simulated import make_problem

from calibration.analysis.diagnosis.alternatives import alternatives
from calibration.estimation.candidate_scores import CandidateBank
from calibration.estimation.chance import Chance
from calibration.estimation.correlated_noise import WhiteNoise
from calibration.estimation.select import choose
from msg_tools.units import ARCSEC
from pointing_model.effects import Effect

N = 80


def problem_of(seed):
    """Rows of a bent axis and a small helper; alone a scale is nearly as good."""
    rng = np.random.default_rng(seed)
    problem = make_problem(seed, N)
    basis, made = problem.base.basis(WhiteNoise(np.ones(2 * N))), []

    def unit(row):
        row = basis.off(row)
        for other in made:
            row = row - (row @ other) * other
        return row / np.linalg.norm(row)
    for _ in range(5):
        made.append(unit(rng.normal(size=2 * N)))
    bent, helper, aside, *others = made
    signal = 40.0 * bent + 9.0 * helper
    scale = 0.97 * bent + 0.12 * helper + np.sqrt(1.0 - 0.97**2 - 0.12**2) * aside
    names = ('bent axis', 'helper', 'scale', 'other', 'another')
    effects = [Effect(name, name, '', 'azimuth', 'both', ('size',), None, look_at=f'the {name}')
               for name in names]
    columns = np.array([bent, helper, scale, *others])
    return replace(problem, b=(signal + rng.normal(size=2 * N)) * ARCSEC, variants=None,
                   dictionary=CandidateBank(effects, columns)), effects


def test_what_is_chosen_instead_leaves_the_cause_open():
    problem, effects = problem_of(7)
    chosen = choose(problem, 0.01, Chance(N, 199, np.random.default_rng(7)))
    names = [c.effect(problem).name for c in chosen.chosen]
    assert names == ['bent axis', 'helper']
    bent, helper, scale, other, _ = effects
    folds = [[bent, helper]] * 15 + [[scale]] * 4 + [[other]]
    ((group, told),), second = alternatives(problem, chosen, folds)
    assert second == []  # the scale takes up nothing like the helper, and the other is none of it
    assert told['cause'] == 'scale' and told['look_at'] == 'the scale' and told['open']
    assert (told['instead'], told['folds']) == (4, 20)
    stand = chosen.significances[0]
    assert told['behind'] == stand.delta_bic - stand.every[group] > 6.0
    # a model of its own may be nearer
    stand.behind = {group: 7.5}
    assert alternatives(problem, chosen, folds)[0][0][1]['behind'] == 7.5
    # chosen seldom, or beside it, or with no rows left out, it leaves nothing open
    for some in ([[bent, helper]] * 99 + [[scale]], [[bent, helper, scale]] * 20, []):
        assert [one['open'] for _, one in alternatives(problem, chosen, some)[0]] == [False]
    # what is far behind even alone is none, however often it was chosen
    problem.dictionary.columns[2] = problem.dictionary.columns[4]
    assert alternatives(problem, chosen, folds) == [[], []]
