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

from encoder_reading.bar_fit import BarLine
from encoder_reading.bar_lattice import BarLattice
from encoder_reading.bar_template import BarTemplate
from encoder_reading.design import Design
from encoder_reading.disc import BARS, Disc, windows_of


class Line:
    """The line and, beside it, bars of which only their shifts are known."""

    def __init__(self):
        design = Design()
        template = BarTemplate(design, BARS)
        self.lattice = BarLattice(design, BARS, template.half)
        bits = Disc().bits.astype(np.int64)
        codes = 4 * np.roll(bits, 1) + 2 * bits + np.roll(bits, -1)
        self.line = BarLine(design, self.lattice, template, np.roll(windows_of(codes, 37), 18, 0))

    def __call__(self, values, good):
        class Bars:
            pass

        bars = Bars()
        bars.good, bars.bar = good, np.arange(len(values)) % BARS
        bars.scale = np.ones_like(values)
        bars.whole = good[:, 1:-1].all(axis=1)
        return self.line._line(values, bars, True)


@pytest.fixture(scope='module')
def line():
    return Line()


def shifts(line, n, noise=0.001):
    rng = np.random.default_rng(1)
    values = 0.01 + 0.0005 * line.lattice.rank + noise * rng.standard_normal((n, 37))
    return values.astype(np.float32), np.ones((n, 37), bool)


def test_clean_bars(line):
    values, good = shifts(line, 400)
    alpha, beta, weight, spread, rest = line(values, good)
    # as least squares has it
    assert np.std(alpha) == pytest.approx(0.001 / np.sqrt(37.0), rel=0.12)
    assert np.mean(alpha) == pytest.approx(0.01, abs=5e-5)
    assert np.mean(beta) == pytest.approx(0.0005, abs=5e-6)
    assert (weight > 0.0).all() and np.median(spread) == pytest.approx(0.001, rel=0.1)
    assert rest == pytest.approx(
        values - alpha[:, None] - beta[:, None] * line.lattice.rank, abs=1e-6)


@pytest.mark.parametrize('size', [0.02, 0.15, 5.0])
@pytest.mark.parametrize('wrong', [[3], [0], [30, 31, 33, 36]])
def test_bars_off_the_line_do_not_pull_it(line, size, wrong):
    values, good = shifts(line, 400)
    values[:, wrong] += size
    alpha, _, weight, _, _ = line(values, good)
    assert np.std(alpha) < 0.001 / np.sqrt(37.0 - len(wrong)) * 1.3
    assert np.mean(alpha) == pytest.approx(0.01, abs=8e-5)
    assert np.mean(weight[:, wrong] > 0.05) < 0.01


def test_bars_that_are_not_good_do_not_count(line):
    values, good = shifts(line, 50)
    good[:, [0, 7, 20]] = False
    values[:, [0, 7, 20]] = 3.0
    alpha, _, weight, _, _ = line(values, good)
    assert np.abs(alpha - 0.01).max() < 0.001 and not weight[:, [0, 7, 20]].any()
    # only the ends
    values, good = shifts(line, 50)
    good[:, [0, 36]] = False
    values[:, [0, 36]] = 3.0
    alpha, _, weight, _, _ = line(values, good)
    assert np.abs(alpha - 0.01).max() < 0.001 and not weight[:, [0, 36]].any()


def test_parabolas(line):
    rank = line.lattice.rank
    curves = np.stack([130.0 + 0.3 * rank - 0.02 * rank**2, 88.0 - 0.2 * rank + 0.0 * rank])
    bumpy = curves.astype(np.float32)
    good = np.ones((2, 37), bool)
    assert line.line.smooth(bumpy, good) == pytest.approx(curves, rel=1e-5)
    spoilt = np.random.default_rng(5).choice(37, (2, 20))
    np.put_along_axis(bumpy, spoilt, 0.0, axis=1)
    np.put_along_axis(good, spoilt, False, axis=1)
    assert line.line.smooth(bumpy, good) == pytest.approx(curves, rel=1e-4)
    bumpy = curves.astype(np.float32)
    bumpy[:, 5] += 20.0
    good = np.ones((1, 37), bool)
    values, slopes, on = line.line._smooth_dirty(bumpy[:, None], good)
    assert slopes[:, 0, 1:-1] == pytest.approx(0.5 * (curves[:, 2:] - curves[:, :-2]), abs=0.02)
    assert values[:, 0] == pytest.approx(curves, rel=0.003)
    assert on[0].tolist() == [k != 5 for k in range(37)]
