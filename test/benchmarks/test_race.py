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

"""How benchmarks judge: ratios against the history, growth of cost."""

import importlib.util
import sys

import numpy as np
import pytest
from places import ROOT

FOLDER = ROOT / 'benchmarks'
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason='benchmarks/ is not here')


def load(name):
    spec = importlib.util.spec_from_file_location(f'benchmark_{name}', FOLDER / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


race = load('race')


def test_a_row_says_how_many_times_as_fast_and_whether_that_is_enough():
    row = race.Row('fit', 'default', '30', 2e-3, 'katpoint', 1e-3, 0.4)
    assert row.ratio == 0.5 and row.met and row.key == 'fit | default | 30 | katpoint'
    assert race.Row('fit', 'default', '30', 2e-3, 'katpoint', 7e-4, 0.4).met is False
    alone = race.Row('fit', 'default', '30', 2e-3, 'katpoint', None, 0.4)
    assert alone.ratio is None and alone.met is None


def test_candidates_take_turns_and_the_best_round_counts():
    seen, now = [], [0.0]

    def call(name, seconds):
        def one():
            seen.append(name)
            now[0] += seconds
        return one
    best = race.race({'a': call('a', 1.0), 'b': call('b', 3.0)}, 2, clock=lambda: now[0])
    assert best == {'a': 1.0, 'b': 3.0}
    turns = ''.join(seen).replace('aa', 'a').replace('bb', 'b')
    while 'aa' in turns or 'bb' in turns:
        turns = turns.replace('aa', 'a').replace('bb', 'b')
    assert turns == 'ababab'  # once to see how long they take, then two rounds


@pytest.mark.parametrize('power, met', [(0.9, True), (1.0, True), (1.5, False), (2.0, False)])
def test_growth_is_that_beyond_the_fixed_cost(power, met):
    sizes = np.array([30.0, 300.0, 3000.0, 30_000.0])
    cost = 1e-3 + 1e-6 * sizes**power
    curve = race.Curve('x', 'rows', tuple(sizes), tuple(cost), (1, 1, 1, 1))
    assert curve.power == pytest.approx(power, abs=0.05)
    assert curve.met == met
    n_log_n = race.Curve('x', 'rows', tuple(sizes), tuple(sizes * np.log(sizes)), (1, 1, 1, 1))
    assert n_log_n.met
    memory = race.Curve('x', 'rows', tuple(sizes), tuple(sizes), tuple(int(s**2) for s in sizes))
    assert not memory.met


def test_a_ratio_a_quarter_below_that_of_its_processor_is_a_step_back(tmp_path, monkeypatch):
    history = load('history')
    path = tmp_path / 'history.json'

    def rows(**ratios):
        return [race.Row('fit', name, '30', 1.0, 'katpoint', ratio)
                for name, ratio in ratios.items()]
    monkeypatch.setattr(history, 'processor', lambda: 'mine')
    history.History(path).record(rows(same=1.0, little=1.0, much=1.0, rare=1.0)[:3])
    monkeypatch.setattr(history, 'processor', lambda: 'yours')
    history.History(path).record(rows(same=3.0, little=3.0, much=0.5, rare=3.0))
    monkeypatch.setattr(history, 'processor', lambda: 'mine')
    assert history.History(path).slower(rows(same=1.0, little=0.85, much=0.7, new=0.1)) == {
        'fit | much | 30 | katpoint'}
    # where this kind of processor has not been seen, the slowest that was counts
    assert history.History(path).slower(rows(rare=2.5)) == set()
    monkeypatch.setattr(history, 'processor', lambda: 'new')
    assert history.History(path).slower(rows(same=0.7, much=0.41, rare=2.3)) == {
        'fit | same | 30 | katpoint', 'fit | rare | 30 | katpoint'}
