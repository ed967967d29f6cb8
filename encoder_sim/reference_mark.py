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

"""The reference mark of an incremental encoder: position of its index pulse, and its detection."""

from typing import NamedTuple

import numpy as np

from . import keyed_noise

_TURN = 2.0 * np.pi
#: largest distance of the mark from its nominal angle, with all drifts, rad
_REACH = 0.2


class Passages(NamedTuple):
    """Detected pulses: number of the sample after each, sense (-1, 1), axis angle of its near edge.

    And the rate of the axis there, rad/s.
    """

    row: np.ndarray
    sense: np.ndarray
    angle: np.ndarray
    rate: np.ndarray


_NONE = Passages(np.empty(0, dtype=int), np.empty(0), np.empty(0), np.empty(0))


class ReferenceMark:
    """The mark of one axis, and the index pulses from its comparator.

    Parameters
    ----------
    params : incremental.Incremental
    seed : int
    device : str
        Name of the encoder and axis, for the random numbers.
    """

    def __init__(self, params, seed, device):
        self._params, self._seed, self._device = params, seed, device

    def passages(self, stamps, angles, volts, temperature, drift):
        """Passages of the mark.

        Parameters
        ----------
        stamps : ndarray of int, shape (n,)
            ns.
        angles, volts, temperature : ndarray, shape (n,)
            Axis angle, rad; supply, V; degC.
        drift : float
            Zero drift in this power-on, rad.

        Returns
        -------
        met : Passages
        short : ndarray of int
            Rows after passages whose pulses are too short.
        """
        if len(stamps) < 2:
            return _NONE, _NONE.row
        met, short = _NONE, _NONE.row
        if not self.far_from(angles):
            met, short = self._met(stamps, angles, volts, temperature, drift)
        if self._params.spurious_index > 0.0:
            met = _merged(met, self._spurious(stamps, angles))
        return met, short

    def _pulse(self, volts, temperature, drift):
        """Lower edge and width of the index pulse, rad; width NaN if the signal is too weak."""
        p = self._params
        volts, warmth = volts - p.supply_nominal, temperature - p.reference_temperature
        peak = (1.0 + p.signal_supply * volts) * (1.0 + p.signal_slope * warmth)
        there = peak > p.threshold
        peak = np.where(there, peak, 1.0)
        width = np.where(there, 2.0 * p.pulse_width * (1.0 - p.threshold / peak), np.nan)
        shift = drift + p.mark_supply * volts + p.mark_slope * warmth
        return p.mark_angle - shift + 0.5 * (p.pulse_width - width), width

    def _spurious(self, stamps, angles):
        """False `Passages`, from disturbances of the index signal."""
        moments = keyed_noise.pulses(
            self._seed, self._device, 'spurious index', self._params.spurious_index,
            int(stamps[0]), int(stamps[-1]))
        row = np.searchsorted(stamps, moments)
        span, step = np.diff(stamps)[row - 1] * 1e-9, np.diff(angles)[row - 1]
        part = (moments - stamps[row - 1]) * 1e-9 / span
        found = Passages(row, np.where(step >= 0.0, 1.0, -1.0), angles[row - 1] + part * step,
                         step / span)
        known = np.isfinite(found.angle)
        return Passages(*(column[known] for column in found))

    def _met(self, stamps, angles, volts, temperature, drift):
        """`passages` of the mark itself."""
        p = self._params
        before, after = angles[:-1], angles[1:]
        sense = np.where(after >= before, 1.0, -1.0)
        lower, width = (np.broadcast_to(v, before.shape)
                        for v in self._pulse(volts, temperature, drift))
        # the pulse begins at its near edge, reached from below or from above, once per turn
        edge = np.where(sense > 0.0, lower, lower + width)
        # comparisons with NaN (no pulse) are false
        turns_before = np.floor(sense * (before - edge) / _TURN)
        turns_after = np.floor(sense * (after - edge) / _TURN)
        crossed = turns_after > turns_before
        rate = (after - before) / np.maximum(np.diff(stamps) * 1e-9, 1e-12)
        short = crossed & (np.abs(rate) * p.pulse_time > width)
        rows = np.flatnonzero(crossed & ~short)
        place = edge[rows] + sense[rows] * _TURN * (turns_before[rows] + 1.0)
        if p.mark_scatter > 0.0:
            place = place + p.mark_scatter * keyed_noise.normal(
                self._seed, self._device, 'mark scatter', stamps[rows + 1])
        return Passages(rows + 1, sense[rows], place, rate[rows]), np.flatnonzero(short) + 1

    def far_from(self, angles):
        """Whether no passage is possible; most calls end here."""
        low, high = angles.min() - _REACH, angles.max() + _REACH
        turn = np.ceil((low - self._params.mark_angle) / _TURN)
        return self._params.mark_angle + turn * _TURN > high

    def clears(self, passages):
        """Whether passages may clear the counter."""
        wanted = {'any': 0.0, 'below': 1.0, 'above': -1.0}[self._params.mark_from]
        return (passages.sense == wanted) | (wanted == 0.0)


def _merged(*parts):
    """All passages of `parts` in order of time."""
    row, sense, angle, rate = map(np.concatenate, zip(*parts))
    order = np.lexsort((sense * angle, row))
    return Passages(row[order], sense[order], angle[order], rate[order])
