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

"""The code disc of paper 001: 1080 bars in one track, where any 18 in a row occur only once."""

import math

import numpy as np

BARS = 1080
WINDOW = 18
#: the angle of one bar, rad: 1200"
BAR_ANGLE = 2.0 * np.pi / BARS
#: paper 001, eq. 3
INITIAL = '100000000110111111'
#: positions, counted back, of the bits whose sum modulo 2 is the next bit
RECURRENCES = {
    'table': (1, 4, 18),  # generates table 1
    'equation2': (7, 18),  # eq. 2, a primitive polynomial, which table 1 does not follow
}


def code_bits(code):
    """The bits of a disc.

    Parameters
    ----------
    code : {'table', 'equation2'} or str of 0 and 1
        The recurrence of table 1 of paper 001, or that of its eq. 2; both begin with the
        18 bits of eq. 3. Or your own bits, more than 18.

    Returns
    -------
    ndarray of uint8, shape (bars,)

    Raises
    ------
    ValueError
        Unknown code.
    """
    if code in RECURRENCES:
        bits = [int(c) for c in INITIAL]
        for i in range(len(bits), BARS):
            bits.append(sum(bits[i - k] for k in RECURRENCES[code]) % 2)
    elif len(code) > WINDOW and set(code) <= set('01'):
        bits = [int(c) for c in code]
    else:
        raise ValueError(f'code {code!r} is not one of {", ".join(RECURRENCES)}, nor a row of '
                         f'more than {WINDOW} bits, 0 and 1')
    return np.array(bits, dtype=np.uint8)


def windows_of(bits, length=WINDOW):
    """Each bit with its successors around the disc, shape (bars, length)."""
    bits = np.asarray(bits)
    return bits[(np.arange(len(bits))[:, np.newaxis] + np.arange(length)) % len(bits)]


_WEIGHTS = 1 << np.arange(WINDOW - 1, -1, -1)


class Disc:
    """A disc, with a table for finding places on it.

    Parameters
    ----------
    code : {'table', 'equation2'} or str of 0 and 1
        A code of paper 001, or your own, with any number of bars above 18.

    Attributes
    ----------
    bits : ndarray of uint8, shape (bars,)
        1 is a narrow bar. Bar `i` has its centre at disc angle ``i * bar_angle``.
    bars : int
    bar_angle : float
        rad.

    Raises
    ------
    ValueError
        Unknown code, or one with two equal windows; the message names both places.
    """

    def __init__(self, code='table'):
        self.bits = code_bits(code)
        self.bars = len(self.bits)
        self.bar_angle = 2.0 * np.pi / self.bars
        numbers = windows_of(self.bits) @ _WEIGHTS
        order = np.argsort(numbers, kind='stable')
        same = np.flatnonzero(np.diff(numbers[order]) == 0)
        if len(same):
            first, second = order[same[0]], order[same[0] + 1]
            text = ''.join(map(str, windows_of(self.bits)[first]))
            raise ValueError(
                f'disc code: the {WINDOW} bars from bar {first} and those from bar {second} are '
                f'both {text}. A window must be found once only: change the code')
        self._place = np.full(2**WINDOW, -1, dtype=np.int32)
        self._place[numbers] = np.arange(self.bars)

    def find(self, windows):
        """Number of the first bar of windows of 18 bits.

        Parameters
        ----------
        windows : array_like of 0 and 1, shape (..., 18)

        Returns
        -------
        ndarray of int, shape (...)
            -1 if the disc has no such window.
        """
        return self._place[np.asarray(windows, dtype=np.int64) @ _WEIGHTS].astype(np.int64)


#: paper 001, eq. 4: inverted grey level = 250 - grey level
INVERSION = 250.0


def pixel_places(design, bars):
    """Place on the track seen by each pixel, in bar periods from the middle of the row.

    Parameters
    ----------
    design : design.Design
    bars : int
        Number of bars of the disc.

    Returns
    -------
    ndarray, shape (pixels,)
        Increasing with the disc angle.
    """
    offset = np.arange(design.pixels) - 0.5 * (design.pixels - 1)
    return along_track(offset / design.bar_pitch, design.geometry, bars)


def along_track(offset, geometry, bars):
    """Convert offsets along the row to offsets along the circle, both in bar periods.

    Parameters
    ----------
    offset : ndarray
        From the middle of the row.
    geometry : {'arc', 'tangent'}
        The row is bent along the circle, or straight and tangent to it in its middle.
    bars : int
        Number of bars of the disc.
    """
    if geometry == 'tangent':
        radius = bars / (2.0 * math.pi)
        return radius * np.arctan(offset / radius)
    return offset


def blurred_bar(distance, half_width, blur):
    """Light (0 to 1) of a bar after a Gaussian blur, at distances from its centre, in pixels."""
    erf = np.frompyfunc(math.erf, 1, 1)
    root = math.sqrt(2.0) * blur
    edges = erf((distance + half_width) / root) - erf((distance - half_width) / root)
    return 0.5 * edges.astype(float)


def half_widths(design, bars):
    """Half width of a wide ('0') and of a narrow bar ('1'), nominal pixels."""
    scale = design.bar_pitch / (math.pi * design.diameter / bars)  # pixels a metre on the circle
    return 0.5 * design.bar_wide * scale, 0.5 * design.bar_narrow * scale
