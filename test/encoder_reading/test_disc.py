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

from encoder_reading.disc import BARS, RECURRENCES, Disc, code_bits, windows_of

TABLE_1 = {  # paper 001, by the number of the first bit; rows that the text kept whole
    73: '010110111101011111001100001001010011',
    145: '100010110011100011001011101001111000',
    181: '110000110011011001100100111111000110',
    217: '101011100001111110011100011111111110',
    253: '111010100110111001101000000100110011',
    289: '000111101100000010001010000111101000',
    361: '010110011101010110001011011111001100',
    397: '101110111000110101010010100011010000',
    433: '011101100110001111000001000011111111',
    469: '010111101001101110110111011000001011',
    505: '101110111101010100101000010111110010',
    541: '111101000010101111111100100000110111',
    577: '000000111101111111010110111011100001',
    613: '100000101110010000111101101111001000',
    649: '010111011100101100111000101011111101',
    685: '110101010100110100111011010001011110',
    721: '000010010000010101100111110101111100',
    757: '011011101101110010011100010111001011',
    793: '011110110111100110000100111000000100',
    829: '011001101011001111000110100001110000',
    865: '000100100010101100100100100000110101',
    901: '011110010001011111000011101010100110',
    973: '101110011001010100101000101101000000',
    1009: '110010111011001000011101110111100100',
    1045: '001001100001000000001110010000000000',
}


def test_table_1():
    text = ''.join(map(str, code_bits('table')))
    assert len(TABLE_1) == 25
    for number, row in TABLE_1.items():
        assert text[number - 1 : number + 35] == row
    # the reading of fig. 4 begins at bit 403
    assert text.find('111000110101010010') == 402
    # eq. 2, which the paper names, is another code
    assert not any(''.join(map(str, code_bits('equation2')))[n - 1 : n + 35] == row
                   for n, row in TABLE_1.items())


def test_equation_2():
    bits = code_bits('equation2')
    assert ''.join(map(str, bits[:18])) == '100000000110111111'
    assert np.array_equal(bits[18:], bits[11:-7] ^ bits[:-18])


def distance(disc, length, reverse=False):
    """Fewest bits by which two windows differ, or a window from all that are read backwards."""
    signs = 2.0 * windows_of(disc.bits, length).astype(np.float32) - 1.0
    products = signs @ (signs[:, ::-1] if reverse else signs).T
    if not reverse:
        np.fill_diagonal(products, -length)
    return int(length - products.max()) // 2


def random_bits():
    return np.random.default_rng(4).integers(0, 2, 400)


def own_disc(bits):
    return Disc(''.join(map(str, bits)))


@pytest.mark.parametrize('code, reversible', [('table', 11), ('equation2', 17)])
def test_every_window_is_found_once_around_the_disc(code, reversible):
    disc = Disc(code)
    windows = windows_of(disc.bits)
    assert np.array_equal(disc.find(windows), np.arange(BARS))
    # the windows at the end go on with the first bars
    assert np.array_equal(windows[-1, 1:], disc.bits[:17])
    # read backwards, almost no window is on the disc
    assert np.count_nonzero(disc.find(windows[:, ::-1]) >= 0) == reversible
    assert distance(disc, 18) == 1 and distance(disc, 18, reverse=True) == 0
    assert distance(disc, 21, reverse=True) in (0, 1)
    assert distance(disc, 22, reverse=True) == 1


@pytest.mark.parametrize('code, distances', [
    ('table', {28: 2, 30: 2, 37: 5}), ('equation2', {28: 3, 30: 4, 37: 5})])
def test_fewest_bits_between_two_places(code, distances):
    disc = Disc(code)
    assert {length: distance(disc, length) for length in distances} == distances
    windows = windows_of(disc.bits, 28)[::7]
    unlike = (windows[:, np.newaxis] != windows[np.newaxis]).sum(axis=2)
    assert unlike[~np.eye(len(windows), dtype=bool)].min() >= distances[28]


def test_a_window_that_is_not_on_the_disc():
    assert Disc().find(np.ones(18, dtype=int)) == -1


def test_own_code():
    bits = random_bits()
    disc = own_disc(bits)
    assert disc.bars == 400
    assert disc.bar_angle == pytest.approx(2 * np.pi / 400)
    assert disc.find(np.roll(bits, -395)[:18]) == 395
    assert np.array_equal(disc.bits, bits)


def test_repeated_window_is_refused_with_both_places():
    bits = random_bits()
    bits[220:238] = bits[31:49]
    with pytest.raises(ValueError, match=r'from bar 31 and those from bar 220 are both [01]{18}\.'):
        own_disc(bits)
    # also where the circle closes
    bits = random_bits()
    bits[99:118] = np.roll(bits, 6)[:19]
    with pytest.raises(ValueError, match='from bar 99 and those from bar 394'):
        own_disc(bits)


def test_repeated_window_of_a_recurrence(monkeypatch):
    monkeypatch.setitem(RECURRENCES, 'bad', (18,))
    assert len(np.unique(windows_of(code_bits('bad')), axis=0)) < BARS
    with pytest.raises(ValueError, match='must be found once only'):
        Disc('bad')


@pytest.mark.parametrize('code, text', [
    ('gray', 'table, equation2'), ('012' * 10, 'bits, 0 and 1'), ('01', 'more than 18')])
def test_no_code(code, text):
    with pytest.raises(ValueError, match=text):
        Disc(code)
