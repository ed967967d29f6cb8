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

"""Common errors of all encoders: an eccentric disc, a zero that drifts, late stamps."""

from dataclasses import dataclass

import numpy as np

from . import keyed_noise
from .field_kinds import number, numbers


@dataclass(frozen=True)
class EncoderScale:
    """Common errors of all encoders: an eccentric disc, and a zero that drifts.

    Attributes
    ----------
    diameter : float
        Diameter of the graduated circle, m.
    eccentricity, eccentricity_phase : float
        Distance of the disc's centre from the axis (m), and the axis angle at which the centre is
        farthest from the head (rad).
    eccentricity_rate : float
        Creep of the disc on its hub: growth of that phase, rad/s from the first reading.
    zero_offset : float
        Mounting offset in the reading, rad.
    zero_drift : float
        1-sigma change of the zero at a power-on, in the reading, rad.
    zero_drifts : tuple of float
        Fixed changes at each power-on instead, in order; the last one is used from then on.
    zero_rate, zero_slope : float
        Drift of the reading with time (rad/s) and temperature (rad/degC from
        `reference_temperature`).
    latency : float
        Age of a reading when it is stamped, s.
    stamp_jitter, late_stamps, late_by : float
        1-sigma of the time between a reading and its stamp (s), the fraction of the messages that
        a busy computer stamps even later, and the mean of that exponential delay (s). Both axes
        share them, as they are in one message. A driver in hard real time has microseconds; a
        USB-to-serial adapter delays a reading by up to 16 ms by default (FTDI, application note
        AN232B-04); no measured distribution was found for a mount.
    power_cycles : tuple of float
        A fault: times of short power failures, s after the start.
    """

    diameter: float = number(300.0, 'mm', 1.0, 10000.0)
    eccentricity: float = number(0.0, 'um', 0.0, 1000.0)
    eccentricity_phase: float = number(0.0, 'deg', -360.0, 360.0)
    eccentricity_rate: float = number(0.0, 'deg_per_hour', -3600.0, 3600.0)
    zero_offset: float = number(0.0, 'arcsec', -36000.0, 36000.0)
    zero_drift: float = number(0.0, 'arcsec', 0.0, 3600.0)
    zero_drifts: tuple = numbers('arcsec', -3600.0, 3600.0)
    zero_rate: float = number(0.0, 'arcsec_per_hour', -600.0, 600.0)
    zero_slope: float = number(0.0, 'arcsec_per_degc', -600.0, 600.0)
    reference_temperature: float = number(10.0, 'c', -60.0, 60.0)
    latency: float = number(0.0, 'ms', -1000.0, 1000.0)
    stamp_jitter: float = number(0.0, 'ms', 0.0, 1000.0)
    late_stamps: float = number(0.0, 'percent', 0.0, 100.0)
    late_by: float = number(100.0, 'ms', 0.0, 10000.0)
    power_cycles: tuple = numbers('s', 0.0, 1e6)


class ZeroDrift:
    """The zero of an encoder, from mounting, power-on, time and temperature.

    Parameters
    ----------
    params : EncoderScale
        Parameters of the encoder.
    seed : int
    device : str
        Name of the encoder and axis, for the random numbers.
    """

    def __init__(self, params, seed, device):
        self._params, self._seed, self._device = params, seed, device
        self._drawn = {}

    def at_power_on(self, power_on):
        """Shift of the reading in this power-on (1, 2, ...), rad."""
        if power_on not in self._drawn:  # each sample asks for it
            self._drawn[power_on] = self._at_power_on(power_on)
        return self._drawn[power_on]

    def _at_power_on(self, power_on):
        p = self._params
        if p.zero_drifts:
            return p.zero_drifts[min(power_on, len(p.zero_drifts)) - 1]
        if p.zero_drift == 0.0:
            return 0.0
        return p.zero_drift * float(
            keyed_noise.normal(self._seed, self._device, 'zero drift', power_on)
        )

    def later(self, seconds, temperature):
        """Shift of the reading by time and temperature, rad.

        Parameters
        ----------
        seconds : ndarray
            Time since the start of the night.
        temperature : float or ndarray
            degC.
        """
        p = self._params
        return (
            p.zero_rate * np.asarray(seconds)
            + p.zero_slope * (np.asarray(temperature) - p.reference_temperature)
        )


def stamp_delays(params, seed, device, stamps):
    """Delay of a message's stamp after its reading, in addition to the mean latency.

    Parameters
    ----------
    params : EncoderScale
        Parameters of an axis.
    seed : int
    device : str
        Name of the encoder, without axis, since one message contains both axes.
    stamps : ndarray of int, shape (n,)
        ns.

    Returns
    -------
    float or ndarray, shape (n,)
        s: white noise of mean 0, plus an exponential delay in a fraction of the messages.
    """
    delay = 0.0
    if params.stamp_jitter > 0.0:
        delay = params.stamp_jitter * keyed_noise.normal(seed, device, 'stamp jitter', stamps)
    if params.late_stamps > 0.0:
        late = keyed_noise.uniform(seed, device, 'late stamps', stamps) < params.late_stamps
        delay = delay - late * params.late_by * np.log(
            keyed_noise.uniform(seed, device, 'how late', stamps))
    return delay
