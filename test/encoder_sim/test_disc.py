import numpy as np
import pytest

from encoder_sim.disc import BARS, RECURRENCES, Disc, code_bits, window_numbers

TABLE_1 = {  # paper 001, by the number of the first bit; rows that the text kept whole
    73: '010110111101011111001100001001010011',
    253: '111010100110111001101000000100110011',
    397: '101110111000110101010010100011010000',
    613: '100000101110010000111101101111001000',
    1045: '001001100001000000001110010000000000',
}


def test_table_1():
    text = ''.join(map(str, code_bits('table')))
    for number, row in TABLE_1.items():
        assert text[number - 1 : number + 35] == row
    # the reading of fig. 4 begins at bit 403
    assert text.find('111000110101010010') == 402


def test_equation_2():
    bits = code_bits('equation2')
    assert ''.join(map(str, bits[:18])) == '100000000110111111'
    assert np.array_equal(bits[18:], bits[11:-7] ^ bits[:-18])
    assert not np.array_equal(bits, code_bits('table'))


@pytest.mark.parametrize('code, reversible', [('table', 11), ('equation2', 17)])
def test_every_window_is_found_once_around_the_disc(code, reversible):
    disc = Disc(code)
    windows = np.stack([np.roll(disc.bits, -k) for k in range(18)], axis=1)
    assert np.array_equal(disc.find(windows), np.arange(BARS))
    # read backwards, almost no window is on the disc
    assert np.count_nonzero(disc.find(windows[:, ::-1]) >= 0) == reversible


def test_a_window_that_is_not_on_the_disc():
    assert Disc().find(np.ones(18, dtype=int)) == -1


def test_repeated_window_is_refused(monkeypatch):
    monkeypatch.setitem(RECURRENCES, 'bad', (18,))
    assert len(np.unique(window_numbers(code_bits('bad')))) < BARS
    with pytest.raises(ValueError, match='repeats a window'):
        Disc('bad')
    with pytest.raises(ValueError, match='table, equation2'):
        Disc('gray')
