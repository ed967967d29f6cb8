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

"""Steps in which the angles and times of a file are written, and the error of such rounding."""

import numpy as np

from msg_tools.units import ARCSEC

#: steps of angles, arcsec, coarse first: digits of degrees, minutes and seconds, encoder counts
_ANGLES = sorted((*(size * 10.0**-k for size in (3600.0, 60.0, 15.0) for k in range(5)),
                  *(1296000.0 / 2.0**k for k in range(12, 24))), reverse=True)
_TIMES = (60.0, 30.0, 10.0, 1.0, 0.1)  # s
_TOLERANCE = 0.02  # of a step: the digits behind it may be rounded too
_FEWEST = 8  # rows
_TURNING = 15.041  # arcsec of hour angle a second


def note_steps(table):
    """Store the steps of the columns that place star and mount in ``meta['steps']``.

    Each is a dict of ``column``, ``step`` in ``unit``, and ``rms_arcsec``: the RMS error on the sky
    of rounding to such steps.
    """
    columns, sound = table.columns, table.reasons == 0
    steps = table.meta['steps'] = []
    if sound.sum() < _FEWEST:
        return
    reach = {'el': 1.0, 'dec_deg': 1.0, 'el_enc': 1.0}
    for first, second in (('az', 'el'), ('az_enc', 'el_enc'), ('ra_deg', 'dec_deg'),
                          ('ra_enc_deg', 'el_enc')):
        if second in columns:  # a degree of the first angle is as long as its cosine
            reach[first] = float(np.sqrt(np.mean(np.cos(columns[second][sound])**2)))
    if 'ra_deg' in columns and not {'ra_enc_deg', 'lst_given'} & set(columns):
        reach['time'] = reach['ra_deg'] * _TURNING
    for name in filter(columns.__contains__, reach):
        values, clock = columns[name][sound], name == 'time'
        away = (values - values[0]) / (1.0 if clock else ARCSEC)
        step = next((one for one in (_TIMES if clock else _ANGLES) if np.all(
            np.abs(away / one - np.rint(away / one)) < _TOLERANCE)), None)
        if step is not None:
            steps.append({'column': table.label(name), 'step': step, 'unit': ' s' if clock else '″',
                          'rms_arcsec': step * reach[name] / np.sqrt(12.0)})
