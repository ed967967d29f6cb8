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

"""State of an incremental encoder's reference marks: the message on `incremental/homing`.

A PointCloud2 with a row for each axis and a float64 field for each number. It is sent on every
change: at the start, when the mark is passed, whether it was detected or missed, and after a
power-on.
"""

from typing import NamedTuple

import numpy as np

from .cloud_tables import cloud_to_table, table_to_cloud
from .convert import AXES
from .power_on import PowerOn

_SIDES = {'': 0.0, 'below': 1.0, 'above': -1.0}
_LATER = ('started', 'supply', 'temperature')  # fields that older messages do not have

#: largest possible values: above them float64 no longer counts in steps of one, an axis has no
#: such angle, and a clock no such time
_MOST_COUNTED, _MOST_TURNED, _LATEST = 2.0**53, 16.0 * np.pi, 1e11


class AxisHoming(NamedTuple):
    """Homing state of one axis; the message has a field of the same name for each attribute.

    Attributes
    ----------
    homed : bool
        Whether the mark has cleared the counter since power-on.
    side : str
        ``below`` or ``above``: the side from which the mark was reached then; '' before. In the
        message it is the sign of the motion: 1, -1, 0.
    missed_marks, passages : int
        Index pulses since power-on that were too short to be detected; passages of the mark.
    mark_error : float
        Error of the counter at the last passage, counts; NaN without one.
    count : float
        Angle of one count, rad.
    pulse_width : float
        Width of the index pulse, by the data sheet, rad; NaN if unknown.
    power_on : int
        Number of the power-on, as counted by the encoder.
    started : float
        Start of this power-on, UTC s; NaN if unknown (not in older logs).
    supply, temperature : float
        Supply voltage and temperature that the encoder's electronics measured when the mark cleared
        the counter, V and degC; NaN before, and if they are not measured.
    """

    homed: bool
    side: str
    missed_marks: int
    passages: int
    mark_error: float
    count: float
    pulse_width: float
    power_on: int
    started: float = float('nan')
    supply: float = float('nan')
    temperature: float = float('nan')

    @property
    def identity(self):
        """The `PowerOn`, or None if its start is unknown."""
        return PowerOn(self.power_on, self.started) if np.isfinite(self.started) else None


def homing_to_cloud(axes, ns):
    """The homing state of both axes as a message.

    Parameters
    ----------
    axes : sequence of AxisHoming
        Azimuth, elevation.
    ns : int
        Stamp.
    """
    rows = [axis._replace(side=_SIDES[axis.side]) for axis in axes]
    columns = {'axis': range(len(AXES))}  # a row's place in `convert.AXES`
    return table_to_cloud(
        columns | {name: [getattr(row, name) for row in rows] for name in AxisHoming._fields}, ns)


def cloud_to_homing(message):
    """The inverse of `homing_to_cloud`.

    Returns
    -------
    dict of str to AxisHoming
        By axis name; axes that are not in the message are left out.

    Raises
    ------
    ValueError
        A field is missing, or a number is invalid or out of its range.
    """
    needed = [name for name in AxisHoming._fields if name not in _LATER]
    table = cloud_to_table(message, ('axis', *needed), 'homing')
    table |= {name: np.full(len(table['axis']), np.nan) for name in _LATER if name not in table}
    whole = ('axis', 'homed', 'side', 'missed_marks', 'passages', 'power_on')
    sides = {number: side for side, number in _SIDES.items()}
    out = {}
    for row in zip(*(table[name] for name in ('axis', *AxisHoming._fields))):
        values = dict(zip(('axis', *AxisHoming._fields), map(float, row)))
        wrong = [name for name in whole if not values[name].is_integer()]
        wrong += [name for name, most in _most(values).items()
                  if abs(values[name]) > most or (name == 'count' and np.isnan(values[name]))]
        if wrong or values['side'] not in sides or values['axis'] not in range(len(AXES)):
            raise ValueError(f'homing: {wrong[0] if wrong else "axis or side"} out of range')
        axis = AXES[int(values.pop('axis'))]
        out[axis] = AxisHoming(**values | {
            'homed': bool(values['homed']), 'side': sides[values['side']],
            **{name: int(values[name]) for name in ('missed_marks', 'passages', 'power_on')}})
    return out


def _most(values):
    """Largest allowed values of an axis; NaN stands for an unknown value."""
    counts = dict.fromkeys(('missed_marks', 'passages', 'power_on'), _MOST_COUNTED)
    count = abs(values['count'])
    return counts | {
        'count': _MOST_TURNED, 'pulse_width': _MOST_TURNED, 'started': _LATEST,
        'mark_error': min(_MOST_TURNED / count, _MOST_COUNTED) if count > 0.0 else _MOST_COUNTED,
        'supply': 1e6, 'temperature': 1e6}
