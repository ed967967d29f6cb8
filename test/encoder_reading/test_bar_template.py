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

from encoder_reading.bar_template import BarTemplate, fixed_point
from encoder_reading.design import Design
from encoder_reading.disc import BARS


def test_products_with_grey_levels_are_exact():
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(5, 600)) * np.array([[1e-3], [1.0], [7.0], [300.0], [1e5]])
    rounded = fixed_point(weights)
    grey = rng.integers(0, 256, (600, 40)).astype(np.float32)
    grey[:, 0] = 255.0
    grey[:, 1] = np.where(weights[1] > 0.0, 255.0, 0.0)
    exact = rounded.astype(float) @ grey.astype(float)
    for order in (np.arange(600), rng.permutation(600)):
        total = np.zeros((5, 40), np.float32)
        for i in order:
            total += rounded[:, i : i + 1] * grey[i]
        assert np.array_equal(total, exact)
    assert np.array_equal(rounded @ grey, exact)
    # as fine as that allows
    scale = np.abs(weights).sum(axis=1, keepdims=True)
    assert np.abs((rounded - weights) / scale).max() < 1.0 / 32000.0


@pytest.mark.parametrize('changes', [{}, {'bar_pitch': 60.0, 'blur': 8.0}])
def test_what_neither_kind_explains(changes):
    template = BarTemplate(Design(**changes), BARS)
    rng = np.random.default_rng(2)
    cells = rng.integers(60, 170, (50, 2 * template.half + 1)).astype(np.float32)
    seen = template.columns @ cells.T
    inner = cells[:, template.inner].astype(float)
    # level, wide and narrow are a least-squares fit: its residual is at right angles to the three
    shapes = np.linalg.pinv(template.columns[:3, template.inner].astype(float))
    rest = inner - seen[:3].T @ shapes.T
    unlike = template.misfit(cells, seen[11:])
    assert unlike == pytest.approx(np.mean(rest**2, axis=1), rel=0.01)
    flat = np.full((1, 2 * template.half + 1), 130.0, np.float32)
    assert np.abs(template.misfit(flat, template.columns[11:] @ flat.T)).max() < 1.0


def test_a_shifted_bar_answers_with_its_slope():
    template = BarTemplate(Design(), BARS)
    for code in range(8):
        own = code >> 1 & 1
        light = [template._light(template._x, shift)[code] for shift in (-0.2, 0.2)]
        low, high = (template.columns[3 + 4 * own] @ row for row in light)
        assert (high - low) / 0.4 == pytest.approx(template.response_slope[code], rel=0.01)
        assert template.response_slope[code] > 0.0
