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

from encoder_reading.bar_decoding import AMBIGUOUS, NOT_ON_DISC, BarDecoder, Bits, median
from encoder_reading.bar_template import BarTemplate
from encoder_reading.design import Design
from encoder_reading.disc import BARS, Disc, windows_of

RANK = np.arange(-18, 19)


@pytest.fixture(scope='module')
def decoder():
    return BarDecoder(Disc(), RANK, BarTemplate(Design(), BARS), lambda rows: rows, 4.0)


def seen_bits(bars, legible=None, visible=None):
    narrow = windows_of(Disc().bits, 37)[(bars - 18) % BARS].astype(bool)
    visible = np.ones_like(narrow) if visible is None else visible
    legible = visible.copy() if legible is None else legible
    return Bits(visible, legible, narrow, None, None)


def test_every_place_of_the_disc(decoder):
    bits = seen_bits(np.arange(BARS))
    bits.visible[:, 0] = bits.legible[:, 0] = False
    bits.narrow[:, 0] ^= True
    bar, good, wrong, reason = decoder.find(bits)
    assert np.array_equal(bar, np.arange(BARS)) and not reason.any() and not wrong.any()
    assert np.array_equal(good, bits.visible)


@pytest.mark.parametrize('spoilt', [0, 18, 36])
def test_a_wrong_bit_and_an_illegible_one(decoder, spoilt):
    bars = np.arange(0, BARS, 7)
    bits = seen_bits(bars)
    bits.narrow[:, spoilt] ^= True
    bits.legible[:, 5] = False
    bar, good, wrong, reason = decoder.find(bits)
    assert np.array_equal(bar[reason == 0], bars[reason == 0])
    assert np.mean(reason == 0) > 0.95 and set(reason) <= {0, AMBIGUOUS}
    assert (wrong[reason == 0] == 2).all()
    assert not good[reason == 0][:, [spoilt, 5]].any()
    assert good[reason == 0].sum(axis=1).tolist() == [35] * int(np.sum(reason == 0))


def test_bits_of_no_place_are_refused(decoder):
    narrow = np.random.default_rng(3).integers(0, 2, (2000, 37)).astype(bool)
    whole = np.ones_like(narrow)
    _, _, _, reason = decoder.find(Bits(whole, whole.copy(), narrow, None, None))
    assert set(reason) == {NOT_ON_DISC}
    # too few to tell
    bits = seen_bits(np.arange(BARS))
    bits.legible[:, 15:] = False
    assert (decoder.find(bits)[3] > 0).all()


def test_median_keeps_its_axis_and_its_argument():
    values = np.random.default_rng(4).normal(size=(3, 5, 37)).astype(np.float32)
    before = values.copy()
    assert np.array_equal(median(values)[..., 0], np.median(values, axis=-1))
    assert np.array_equal(values, before) and median(values).shape == (3, 5, 1)
