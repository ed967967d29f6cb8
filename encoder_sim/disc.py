"""The code disc of paper 001: 1080 bars in one track, each 18 in a row found only once."""

import numpy as np

BARS = 1080
WINDOW = 18
#: the angle of one bar, rad: 1200"
BAR_ANGLE = 2.0 * np.pi / BARS
#: paper 001, eq. 3
INITIAL = '100000000110111111'
#: bits before the new one whose sum modulo 2 it is
RECURRENCES = {
    'table': (1, 4, 18),  # generates table 1
    'equation2': (7, 18),  # eq. 2, a primitive polynomial, which table 1 does not follow
}


def code_bits(code):
    """The bits of a disc.

    Parameters
    ----------
    code : {'table', 'equation2'}
        The recurrence that table 1 of paper 001 follows, or that of its eq. 2; both begin with
        the 18 bits of eq. 3.

    Returns
    -------
    ndarray of uint8, shape (1080,)

    Raises
    ------
    ValueError
        Unknown code.
    """
    if code not in RECURRENCES:
        raise ValueError(f'disc code {code!r} is not one of {", ".join(RECURRENCES)}')
    bits = [int(c) for c in INITIAL]
    for i in range(len(bits), BARS):
        bits.append(sum(bits[i - k] for k in RECURRENCES[code]) % 2)
    return np.array(bits, dtype=np.uint8)


def window_numbers(bits):
    """Each bit with the 17 that follow it around the disc, as one number, shape of `bits`."""
    return sum(
        np.roll(bits, -k).astype(np.int64) << (WINDOW - 1 - k) for k in range(WINDOW)
    )


class Disc:
    """A disc and the table that finds a place on it.

    Parameters
    ----------
    code : {'table', 'equation2'}

    Attributes
    ----------
    bits : ndarray of uint8, shape (1080,)
        1 is a narrow bar. Bar `i` has its centre at disc angle `i` * 1200".

    Raises
    ------
    ValueError
        Unknown code, or one with two equal windows.
    """

    def __init__(self, code='table'):
        self.code = code
        self.bits = code_bits(code)
        numbers = window_numbers(self.bits)
        if len(np.unique(numbers)) != BARS:
            raise ValueError(f'disc code {code!r} repeats a window of {WINDOW} bits')
        self._place = np.full(2**WINDOW, -1, dtype=np.int16)
        self._place[numbers] = np.arange(BARS)

    def find(self, windows):
        """Number of the first bar of windows of 18 bits.

        Parameters
        ----------
        windows : array_like of 0 and 1, shape (..., 18)

        Returns
        -------
        ndarray of int, shape (...)
            -1 where the disc has no such window.
        """
        weights = 1 << np.arange(WINDOW - 1, -1, -1)
        return self._place[np.asarray(windows, dtype=np.int64) @ weights].astype(np.int64)
