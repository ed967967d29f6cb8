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

"""The cross-check where stars were exposed for the zero in place of Polaris."""


import numpy as np
import pytest
from encoder_night import cross_check, mount, night

from calibration.analysis.encoders.encoder_zeros import StarOffsets
from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.run import PointingRun
from pointing_model.zero import MARK

AT = slice(30, 46)  # where `night` exposes Polaris


def exposed(seed, inc, second, run, stars=5, first=900):
    """A power-on that exposes stars for its zero, some minutes later each."""
    rows = night(seed, inc, second, run, start=3600.0 * run)
    other = night(seed + 100, inc, second, run)
    member = np.arange(16) % stars
    az = np.linspace(0.3, 5.5, stars)[member] + 0.02 * run + 0.001 * np.arange(16)
    el = np.linspace(32.0, 65.0, stars)[member] * DEG - 0.01 * run
    columns = {name: values.copy() for name, values in rows.columns.items()}
    # what the encoders read too much there, as `night` has it at other places
    was = np.array(mount().sky_to_encoder(other['az'][AT], other['el'][AT]))
    now = np.array(mount().sky_to_encoder(az, el))
    for i, axis in enumerate(('az', 'el')):
        turn = np.cos(other['el'][AT]) / np.cos(el) if axis == 'az' else 1.0
        for encoder, zero in (('enc', inc), ('abs', second)):
            noise = other[f'{axis}_{encoder}'][AT] - was[i] - zero[i] * ARCSEC
            columns[f'{axis}_{encoder}'][AT] = now[i] + zero[i] * ARCSEC + noise * turn
    columns['az'][AT], columns['el'][AT], columns['star'][AT] = az, el, first + member
    mark = np.zeros(len(rows))
    mark[AT] = 1.0
    return PointingRun({**columns, MARK: mark})


def nights(second, **options):
    return PointingRun.concatenate([
        exposed(1, (0.0, 0.0), (0.0, 0.0), 1), exposed(2, (12.0, 7.0), second, 2, **options)])


def test_a_zero_of_the_incremental_encoder_moves_without_alarm():
    report = cross_check(nights((0.0, 0.0)), model=mount())
    assert report.alarms == [] and report.notes == []
    for change, true in zip(report.shifts, (12.0, 7.0)):
        assert change.by == 'stars'
        assert change.incremental / ARCSEC == pytest.approx(
            true, abs=4 * change.incremental_sigma / ARCSEC)
        assert 0.2 < change.incremental_sigma / ARCSEC < 0.8
        assert abs(change.pull) < 3.0
    assert isinstance(report.latest, StarOffsets) and len(report.latest.star) == 5


@pytest.mark.parametrize('axis, name', [(0, 'azimuth'), (1, 'elevation')])
def test_the_absolute_encoder_that_moved_is_named(axis, name):
    second = [0.0, 0.0]
    second[axis] = -6.0
    alarm, = cross_check(nights(second), model=mount()).alarms
    assert alarm.startswith(f'{name}: absolute encoder moved by -')
    assert 'the zeros by stars and by the absolute encoder disagree' in alarm


def test_what_was_seen_yesterday_is_compared_with():
    yesterday = cross_check(exposed(1, (0.0, 0.0), (0.0, 0.0), 1), model=mount()).latest
    tonight = exposed(2, (12.0, 7.0), (0.0, -6.0), 2)
    alarm, = cross_check(tonight, yesterday, model=mount()).alarms
    assert alarm.startswith('elevation: absolute encoder moved by -')


def test_zeros_by_other_stars_are_not_compared_and_that_is_said():
    for rows, why in ((nights((0.0, 6.0), first=400), 'they have zeros by other stars'),
                      (PointingRun.concatenate([
                          night(1), exposed(2, (12.0, 7.0), (0.0, 6.0), 2)]),
                       'one has a zero by Polaris, the other by stars')):
        if MARK not in rows:
            mark = (rows['star'] >= 900) & (rows['star'] < 1000)
            rows = PointingRun({**rows.columns, MARK: mark.astype(float)})
        report = cross_check(rows, model=mount())
        assert report.shifts == []
        assert report.notes == [
            f'power-on 1 and power-on 2 were not compared against the sky: {why}']


def test_a_power_on_without_a_zero_is_told():
    later = night(3, (5.0, 5.0), (0.0, 0.0), 2, polaris=0, start=7200.0)
    rows = PointingRun.concatenate([exposed(1, (0.0, 0.0), (0.0, 0.0), 1), PointingRun(
        {**later.columns, MARK: np.zeros(len(later))})])
    report = cross_check(rows, model=mount())
    alarms = [alarm for alarm in report.alarms if 'has no zero on stars since' in alarm]
    assert len(alarms) == 2
    for alarm in alarms:
        assert 'moved by +5.' in alarm or 'moved by +4.' in alarm
