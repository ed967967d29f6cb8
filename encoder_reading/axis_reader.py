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

"""Angle of an axis from the frames of its reading heads."""

import dataclasses
from functools import lru_cache

import numpy as np

from .frame_readings import FrameReadings
from .paper_reader import PaperReader
from .template_reader import TemplateReader

_TURN = 2.0 * np.pi
_METHODS = {'template': TemplateReader, 'paper': PaperReader}


@lru_cache(maxsize=8)
def _reader(design):
    return _METHODS[design.method](design)


def reader_of(design):
    """The reader of single frames for a design; axes of one design share it.

    Parameters
    ----------
    design : design.Design

    Raises
    ------
    ValueError
        The design cannot be read.
    """
    # the number of heads and the sense of the disc do not matter in a single frame
    return _reader(dataclasses.replace(design, heads=1, sense='with'))


class AxisReader:
    """Reads one axis.

    Parameters
    ----------
    design : design.Design
    axis : str
        Name of the axis.
    lowest : float, optional
        Reading at which a turn begins, rad. By default ``azimuth`` reads from 0 to 360 degrees,
        any other axis from -180 to 180.

    Raises
    ------
    ValueError
        The design cannot be read.
    """

    def __init__(self, design, axis, lowest=None):
        self.design, self.axis = design, axis
        self.lowest = (0.0 if axis == 'azimuth' else -np.pi) if lowest is None else lowest
        self.reader = reader_of(design)

    def join(self, readings):
        """Combine the readings of the heads of an axis.

        Parameters
        ----------
        readings : FrameReadings
            Of all heads, one after the other.

        Returns
        -------
        FrameReadings
            Angle of the axis and its 1-sigma. Rejected if any head is: a single head would be
            affected by the eccentricity.
        """
        angle, quality, sigma = readings.angle, readings.quality, readings.sigma
        if self.design.heads == 2:
            first, second = angle.reshape(2, -1)
            difference = (second - first) % _TURN - np.pi
            angle = (first + 0.5 * difference) % _TURN
            quality = quality.reshape(2, -1).max(axis=0)
            sigma = 0.5 * np.hypot(*sigma.reshape(2, -1))
        if self.design.sense == 'against':
            angle = -angle % _TURN
        if self.lowest:
            angle = (angle - self.lowest) % _TURN + self.lowest
        return FrameReadings(angle, quality, sigma)


def read_frames(axes, frames):
    """Read several axes, all axes of one design together.

    Parameters
    ----------
    axes : sequence of AxisReader
    frames : sequence of ndarray, shape (heads, n, pixels)
        Frames of each axis, all with the same n.

    Returns
    -------
    FrameReadings
        Arrays of shape (n, len(axes)); identical to the last bit, whatever is read together.

    Raises
    ------
    ValueError
        The number of pixels differs from that of the design.
    """
    n = frames[0].shape[1]
    out = FrameReadings(np.empty((n, len(axes))), np.empty((n, len(axes)), dtype=np.int8),
                   np.empty((n, len(axes))))
    for reader in {id(axis.reader): axis.reader for axis in axes}.values():
        mine = [i for i, axis in enumerate(axes) if axis.reader is reader]
        rows = np.concatenate([frames[i].reshape(-1, frames[i].shape[2]) for i in mine])
        readings = _read_in_blocks(reader, rows) if reader.BLOCK else reader.read(rows)
        begin = 0
        for i in mine:
            end = begin + frames[i].shape[0] * n
            joined = axes[i].join(_part(readings, begin, end))
            for column, values in zip(_columns(out), _columns(joined)):
                column[:, i] = values
            begin = end
    return out


def _columns(readings):
    return readings.angle, readings.quality, readings.sigma


def _part(readings, begin, end):
    return FrameReadings(*(column[begin:end] for column in _columns(readings)))


def _read_in_blocks(reader, rows):
    """Read frames in blocks of constant size.

    The last digit of a matrix product depends on the sizes of the matrices. With blocks of constant
    size a reading is identical to the last bit whatever else is read with it, as it is by design
    with our own reader.
    """
    parts = []
    for i in range(0, len(rows), reader.BLOCK):
        block = rows[i : i + reader.BLOCK]
        n = len(block)
        if n < reader.BLOCK:
            block = np.concatenate([block, np.repeat(block[-1:], reader.BLOCK - n, axis=0)])
        parts.append(_columns(_part(reader.read(block), 0, n)))
    if not parts:
        return reader.read(rows)
    return FrameReadings(*map(np.concatenate, zip(*parts)))
