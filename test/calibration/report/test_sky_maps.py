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

"""Maps of the sky on pages: all arrows are within the drawing."""

import re

import numpy as np
import pytest

from calibration.report.page_html import drawn
from calibration.report.residual_figures import sky_maps
from calibration.report.residuals import Residuals
from msg_tools.units import DEG


def maps(size, toward_rim=True, gross=None, left=0.8):
    """Maps of stars, the lowest of them missed outward at the rim."""
    n = 40
    az, el = np.linspace(0.0, 2.0 * np.pi, n), np.linspace(21.0, 88.0, n) * DEG
    y = np.full(n, -size if toward_rim else size)
    y[0] *= gross or 1.0
    before = np.stack((np.zeros(n), y))
    return drawn(sky_maps(Residuals(['a'] * n, az, el, before, left * before, np.ones(n, bool))))


def tips(drawing):
    """Of the arrows of one drawing: where they end; and its box: lowest and highest x, y."""
    x, y, width, height = map(float, re.search('viewBox="([^"]+)"', drawing)[1].split())
    ends = [[float(a) + float(c), float(b) + float(d)] for a, b, c, d in re.findall(
        r'<path d="M([-\d.]+) ([-\d.]+)l([-\d.]+) ([-\d.]+)', drawing)]
    return np.array(ends), (x, y), (x + width, y + height)


@pytest.mark.parametrize('gross', [None, 3.0, 60.0])
@pytest.mark.parametrize('size', [0.3, 240.0])
def test_no_arrow_is_cut(size, gross):
    drawings = maps(size, gross=gross).split('<svg')[1:]
    boxes = set()
    for drawing in drawings:
        ends, low, high = tips(drawing)
        assert len(ends) == 40 and (ends > low).all() and (ends < high).all()
        boxes.add((low, high))
    # the same for both: one scale on paper, too
    assert len(drawings) == 2 and len(boxes) == 1
    assert ('1 of the arrows is longer than drawn' in drawings[0]) == (gross == 60.0)


def test_a_map_whose_arrows_stay_within_has_no_margin():
    assert 'viewBox="0 0 400 400"' in maps(1.0, toward_rim=False)


def test_where_nothing_was_changed_there_is_one_map_always_in_sight():
    text = maps(1.0, left=1.0)
    assert text.count('<svg') == 1 and 'class="when-' not in text
