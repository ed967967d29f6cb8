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
from encoder_night import cross_check, night

from calibration.analysis.encoders.cross_check_rows import CrossCheckNight
from calibration.analysis.encoders.jump_or_slow_change import LEAD, lead_over, slow_changes
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun


def bent(seed, columns, error):
    """A night of six hours, an azimuth encoder of which reads too much: error(azimuth, 0 to 1)."""
    run = night(seed)
    part = np.linspace(0.0, 1.0, len(run['az']))
    values = {**run.columns, 'time': 1.8e9 + 6.0 * 3600.0 * part}
    for name in columns:
        values[name] = values[name] + error(run['az'], part) * ARCSEC
    return PointingRun(values, run.meta)


def turning(az, part):
    """A disc off its axis that turns on its hub."""
    return 8.0 * np.sin(az - 1.0 - 9.0 * part)


@pytest.mark.parametrize('columns, seed', [(('az_enc',), 3), (('az_abs',), 4)])
def test_a_disc_that_turns_is_no_jump(columns, seed):
    report = cross_check(bent(seed, columns, turning))
    assert report.events == [] and report.alarms == []


def test_a_jump_stays_one_and_is_said_to_be_likelier_than_what_goes_slowly():
    report = cross_check(bent(3, ('az_enc',), lambda az, part: 4.0 * (part > 0.6)))
    event, = report.events
    assert event.kind == 'step' and event.lead > LEAD
    assert 'likelihood ratio to a slow change above 1000' in report.alarms[0]
    assert 'by chance' not in report.alarms[0]


def test_that_nothing_jumped_is_noted():
    # both discs: what the sky alone shows
    report = cross_check(bent(2, ('az_enc', 'az_abs'), turning))
    assert report.events == [] and report.alarms == []
    assert report.notes == ['azimuth: nothing jumped: a disc that turns on its hub through the '
                            'night explains the rows as well']


def test_the_lead_is_of_either_sign():
    rows = CrossCheckNight(bent(3, ('az_enc',), turning), None)
    slow, design = slow_changes(rows, 0), rows.difference_design(0)
    step = (rows.rows['time'] > np.median(rows.rows['time'])).astype(float)
    wrong, best = lead_over(slow, design, rows.difference[0], rows.run, [step], 2)
    assert wrong < -50.0 and best.kind == 'disc turns' and best.turn == pytest.approx(9.0, abs=0.6)
    jumps = rows.difference[0] - turning(rows.rows['az'], np.linspace(0, 1, 76)) * ARCSEC \
        + 5.0 * ARCSEC * step
    right, _ = lead_over(slow, design, jumps, rows.run, [step], 2)
    assert right > 50.0
