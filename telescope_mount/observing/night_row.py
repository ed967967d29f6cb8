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

"""A row of the night: the columns that an observation fills, by the names of `run.COLUMNS`."""

from typing import NamedTuple

import numpy as np

from .instruments import ABSOLUTE


class Measured(NamedTuple):
    """What was measured in an exposure.

    Attributes
    ----------
    stamp : int
        Of its middle, ns.
    miss : (float, float)
        Star - boresight, rad.
    enc, second : ndarray, shape (2,)
        What the encoders read with the star centred, rad; NaN of the second where not known.
    rate : ndarray, shape (2,)
        Of the axes, rad/s.
    """

    stamp: int
    miss: tuple
    enc: np.ndarray
    second: np.ndarray
    rate: np.ndarray


def night_row(measured, pointing, conditions, block, blind, instruments, inclinometer, value):
    """The row of an observation.

    Parameters
    ----------
    measured : Measured
    pointing : Pointing
    conditions : Conditions
    block : int
        Number of the step of the plan.
    blind : bool
        With model and zero alone.
    instruments : Instruments
    inclinometer : pointing_model.active_calibration.Gauge
        North and west.
    value : callable
        Gives the value of a parameter of the observer.

    Returns
    -------
    dict
        Names to numbers, rad, and ``stamp``.
    """
    stamp, miss, enc, second, rate = measured
    target, (site, air, *_) = pointing.target, conditions
    power_on, second_on = instruments.power_on, instruments.absolute_power_on
    az, el = (float(v[0]) for v in pointing.place(np.array([stamp]), site, air))
    row = {
        'stamp': stamp, 'time': stamp * 1e-9, 'run': instruments.run,
        'encoder_start': power_on.started if power_on else np.nan,
        'absolute_start': second_on.started if second_on else np.nan, 'block': block,
        'check': float(blind), 'star': target.number, 'az': az, 'el': el,
        'az_enc': enc[0], 'el_enc': enc[1], 'az_abs': second[0], 'el_abs': second[1],
        'miss_x': miss[0], 'miss_y': miss[1], 'az_rate': rate[0], 'el_rate': rate[1],
        'approach_az': pointing.approach[0], 'approach_el': pointing.approach[1],
        'temperature': air.temperature_c, 'pressure': air.pressure_hpa,
        'magnitude': target.magnitude,
    }
    for name, parameter in (('exposure', 'exposure_s'), ('camera_late', 'camera_late_s')):
        if value(parameter):  # as before where neither is used
            row[name] = value(parameter)
    if value('inclinometer'):
        row['lean_north'], row['lean_west'] = inclinometer.before(stamp, (np.nan, np.nan))
    if ABSOLUTE not in instruments.names:  # no column: not one that gave no angle
        for name in ('absolute_start', 'az_abs', 'el_abs'):
            del row[name]
    return row
