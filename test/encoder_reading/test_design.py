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

import dataclasses

import numpy as np
import pytest

from encoder_reading.axis_reader import reader_of
from encoder_reading.design import Design
from encoder_reading.disc import Disc
from encoder_reading.paper_reader import PaperReader
from encoder_reading.template_reader import TemplateReader
from encoder_sim.absolute import Absolute


def test_the_default_is_the_papers_encoder_and_the_simulated_one():
    assert Design() == Absolute().design
    assert np.array_equal(Design().disc.bits, Disc().bits)
    assert Design().disc is Design(pixels=2000).disc


def test_a_simulated_encoder_tells_its_drawing_and_no_flaw():
    told = Absolute(
        diameter=0.1, code='equation2', heads=2, geometry='tangent', pixels=2048, bar_pitch=60.0,
        blur=8.0, method='paper', mounting='reversed', scale_error=0.004, noise=2.0, ccd_dust=3,
        eccentricity=1e-6, zero_offset=0.1).design
    assert told == Design(diameter=0.1, code='equation2', heads=2, geometry='tangent', pixels=2048,
                          bar_pitch=60.0, blur=8.0, method='paper')
    assert told.mounting == 'detect'


def test_own_bits():
    bits = ''.join(map(str, np.random.default_rng(2).integers(0, 2, 720)))
    design = Design(code=bits, diameter=0.0526)
    assert design.disc.bars == 720
    assert reader_of(design).read(np.zeros((1, 1800), np.uint8)).quality.tolist() == [2]


def test_readers_are_shared_and_of_the_method_asked_for():
    design = Design()
    assert isinstance(reader_of(design), TemplateReader)
    assert reader_of(design) is reader_of(dataclasses.replace(design, heads=2, sense='against'))
    assert reader_of(design) is not reader_of(dataclasses.replace(design, mounting='forward'))
    assert isinstance(reader_of(dataclasses.replace(design, method='paper')), PaperReader)


@pytest.mark.parametrize('values, text', [
    ({'mounting': 'up'}, "mounting 'up' is not one of 'detect', 'forward', 'reversed'"),
    ({'sense': 'up'}, "'with', 'against'"),
    ({'method': 'sine'}, "'template', 'paper'"),
    ({'geometry': 'ring'}, "'arc', 'tangent'"),
    ({'pixels': 100}, 'pixels 100: must be 400 to 16384'),
    ({'pixels': 1800.5}, 'pixels 1800.5: must be a whole number'),
    ({'heads': 3}, 'heads 3: must be 1 to 2'),
    ({'diameter': 79.0}, 'diameter 79000 mm: must be 1 to 10000'),
    ({'blur': float('nan')}, 'blur nan px: must be 0.3 to 30'),
    ({'code': 'morse'}, "code 'morse' is not one of table, equation2, nor a row of more"),
    ({'code': ''}, 'nor a row of more'),
    ({'code': '0110'}, 'more than 18 bits'),
    ({'code': '01' * 10 + '2'}, 'more than 18 bits'),
    ({'code': '01' * 20}, 'must be found once only'),
    ({'bar_narrow': 0.2e-3}, r'0\.149 mm \(0\) and 0\.2 mm \(1\) every 0\.2298 mm: a 0 must be'),
    ({'bar_wide': 0.3e-3}, 'narrower than that'),
])
def test_what_is_no_design(values, text):
    with pytest.raises(ValueError, match=text):
        Design(**values)


def test_a_design_that_cannot_be_read():
    with pytest.raises(ValueError, match='cannot be distinguished'):
        reader_of(Design(bar_narrow=0.148e-3))
    with pytest.raises(ValueError, match='show 18 whole bars: 22 are needed'):
        reader_of(Design(pixels=1200, bar_pitch=60.0, blur=8.0))
