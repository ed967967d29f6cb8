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
from encoder_night import cross_check, mount, night

from calibration.analysis.encoders.cross_check import (
    Homing,
    axis_homings,
    diagnostic_homings,
)
from calibration.analysis.encoders.cross_check_rows import Budget
from calibration.report.encoder_wording import MARKS_UNKNOWN
from msg_tools.homing import AxisHoming
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun

DAY = 86400.0


def moved(run, column, arcsec, since=46):
    """The run with a column moved from row `since` on."""
    values = run[column].copy()
    values[since:] += arcsec * ARCSEC
    return PointingRun({**run.columns, column: values})


def test_the_incremental_encoder_moves_at_a_power_on_without_alarm():
    report = cross_check(night(2, (12.0, -7.0)), night(1))
    assert report.alarms == [] and report.events == []
    for change, true in zip(report.shifts, (12.0, -7.0)):
        assert change.incremental / ARCSEC == pytest.approx(
            true, abs=4 * change.incremental_sigma / ARCSEC)
        assert change.difference / ARCSEC == pytest.approx(
            true, abs=4 * change.difference_sigma / ARCSEC)
        assert 0.2 < change.incremental_sigma / ARCSEC < 0.8
        assert change.difference_sigma < 0.2 * ARCSEC
        assert abs(change.pull) < 3.0 and change.moved == {}


@pytest.mark.parametrize('axis, name', [(0, 'azimuth'), (1, 'elevation')])
def test_the_absolute_encoder_that_moved_is_named(axis, name):
    second = [0.0, 0.0]
    second[axis] = -6.0
    report = cross_check(night(2, (12.0, 7.0), second), night(1))
    assert len(report.alarms) == 1
    assert report.alarms[0].startswith(f'{name}: absolute encoder moved by -')
    change = report.shifts[axis]
    assert change.absolute / ARCSEC == pytest.approx(-6.0, abs=4 * change.absolute_sigma / ARCSEC)
    # that the whole mount turned about this axis cannot be excluded
    assert 0.5 < change.moved['absolute encoder'] < 0.9


def test_a_mount_that_leans_is_named():
    report = cross_check(night(2, (12.0, -7.0), model=mount(AN=8.0)), night(1))
    assert [line.split(' moved')[0] for line in report.alarms] == ['elevation: mount or sky']
    assert report.shifts[1].moved['mount or sky'] > 0.99


def test_all_moved_together_is_the_mount():
    # no usual drift of the incremental encoder has the size of what both encoders show
    report = cross_check(night(2, (0.0, 9.0), (0.0, 9.0)), night(1),
                             budget=Budget(power_on=0.3 * ARCSEC))
    assert [line.split(' moved')[0] for line in report.alarms] == ['elevation: both or mount']
    report = cross_check(night(2, (0.0, 0.0), (0.0, 9.0)), night(1),
                             budget=Budget(power_on=0.3 * ARCSEC))
    assert [line.split(' moved')[0] for line in report.alarms] == ['elevation: absolute encoder']


@pytest.mark.parametrize('column, axis, who, arcsec', [
    ('az_enc', 'azimuth', 'incremental encoder', 5.0),
    ('el_enc', 'elevation', 'incremental encoder', -20.0),
    ('az_abs', 'azimuth', 'absolute encoder', -20.0),
    ('el_abs', 'elevation', 'absolute encoder', 5.0)])
def test_a_step_inside_a_power_on(column, axis, who, arcsec):
    rows = moved(night(2, (12.0, -7.0)), column, arcsec, since=55)
    report = cross_check(rows, night(1))
    event = report.events[0]
    assert len(report.events) == len(report.alarms) == 1
    assert (event.axis, event.kind, event.moved) == (axis, 'step', who)
    assert event.amount / ARCSEC == pytest.approx(arcsec, abs=4 * event.sigma / ARCSEC)
    assert rows['time'][53] < event.time < rows['time'][56]
    assert event.confidence > 0.9
    assert report.alarms[0].startswith(f'{axis}: {who} moved at ')


def test_errors_of_the_place_of_polaris_are_no_step_drift_or_walk():
    for seed in (7, 11, 17, 21, 27):
        rows = night(seed, noise=0.5).select(np.arange(46))  # ends on Polaris
        rows = PointingRun({**rows.columns, **{
            f'{axis}_abs': rows[f'{axis}_abs'] + 0.6 * ARCSEC * np.sin(
                1080.0 * rows[f'{axis}_enc']) for axis in ('az', 'el')}})
        assert not cross_check(rows).alarms
    report = cross_check(moved(rows, 'el_abs', 8.0, since=30))
    assert report.alarms[0].startswith('elevation: absolute encoder ')


def test_a_drift_inside_a_power_on():
    rows = night(2)
    hours = (rows['time'] - rows['time'][0]) / 3600.0
    rows = PointingRun({**rows.columns, 'el_abs': rows['el_abs'] + 4.0 * hours * ARCSEC})
    report = cross_check(rows)
    assert [(e.kind, e.moved) for e in report.events] == [('drift', 'absolute encoder')]
    assert report.events[0].amount * 3600.0 / ARCSEC == pytest.approx(4.0, abs=0.8)
    assert 'arcsec an hour' in report.alarms[0]


@pytest.mark.parametrize('inc, second, cause, words', [
    ((8.0, -5.0), (0.0, 0.0), ('incremental encoder',) * 2, []),
    ((0.0, 0.0), (-6.0, 0.0), ('absolute encoder', 'nothing'),
     ['azimuth: absolute encoder moved by -']),
    ((8.0, 0.0), (-6.0, 5.0), ('both encoders', 'absolute encoder'),
     ['azimuth: absolute encoder moved by -', 'elevation: absolute encoder moved by +']),
    ((0.0, 12.0), (0.0, 5.0), ('nothing', 'both encoders'),
     ['elevation: absolute encoder moved by +']),
    ((7.0, -4.0), (7.0, -4.0), ('both or mount',) * 2,
     ['azimuth: both or mount moved by +', 'elevation: both or mount moved by -']),
])
def test_who_moved_at_a_power_on(inc, second, cause, words):
    report = cross_check(night(2, inc, second), night(1))
    assert tuple(change.cause for change in report.shifts) == cause
    assert [line.startswith(start) for line, start in zip(report.alarms, words, strict=True)
            ] == [True] * len(words)
    for change, line in zip([c for c in report.shifts if c.alarm], report.alarms):
        assert ('the incremental encoder by' in line) == (change.cause == 'both encoders')
        assert sum(change.causes.values()) == pytest.approx(1.0)


@pytest.mark.parametrize('inc, second, short, axis', [
    (6.0, -4.0, 'az', 'azimuth'), (9.0, 4.0, 'el', 'elevation'), (-4.0, -9.0, 'az', 'azimuth')])
def test_both_encoders_jump_inside_a_power_on(inc, second, short, axis):
    rows = moved(moved(night(2), f'{short}_enc', inc), f'{short}_abs', second)
    report = cross_check(rows, night(1))
    (event,) = report.events
    assert (event.axis, event.moved, event.kind) == (axis, 'both encoders', 'step')
    assert event.amount / ARCSEC == pytest.approx(inc, abs=4 * event.sigma / ARCSEC)
    assert event.second / ARCSEC == pytest.approx(second, abs=4 * event.second_sigma / ARCSEC)
    (line,) = report.alarms
    assert line.startswith(f'{axis}: both encoders moved at ') and '(the absolute one)' in line


def test_a_small_difference_of_two_large_jumps_is_found_with_them():
    named = []
    for seed in range(3):
        rows = moved(moved(night(20 + seed), 'el_enc', 5.6), 'el_abs', 5.0)
        report = cross_check(rows)
        assert len(report.events) == len(report.alarms) == 1
        named.append(report.events[0].moved)
        event = report.events[0]
        if event.moved == 'both encoders':
            assert event.amount / ARCSEC == pytest.approx(5.6, abs=4 * event.sigma / ARCSEC)
            assert (event.amount - event.second) / ARCSEC == pytest.approx(0.6, abs=0.4)
    assert named.count('both encoders') >= 2


def causes_named(jump, seeds, since, short='el'):
    """Causes that are named of a jump of (incremental, absolute), arcsec."""
    out = []
    for seed in seeds:
        rows = night(seed)
        columns = {name: values.copy() for name, values in rows.columns.items()}
        for encoder, value in zip(('enc', 'abs'), jump):
            columns[f'{short}_{encoder}'][since:] += value * ARCSEC
        report = cross_check(PointingRun(columns), model=mount())
        out.append([event.moved for event in report.events])
    return out


@pytest.mark.parametrize('cause, jump, since', [
    # 0.35" of a reading: 0.08" of a step of the difference; 1": 0.25" of one against the sky
    ('incremental encoder', (2.0, 0.0), 25), ('absolute encoder', (0.0, -2.0), 50),
    ('both encoders', (2.0, -2.0), 50), ('both encoders', (2.45, 2.0), 25),
    ('both or mount', (2.0, 2.0), 25), ('both or mount', (2.0, 2.0), 50)])
def test_who_moved_at_a_moment_that_nobody_knows(cause, jump, since):
    said = causes_named(jump, range(40, 43), since)
    assert sum(one == [cause] for one in said) >= 2, said


def cycled(rows, since=46):
    """The rows, with Polaris again behind a power-on of the absolute encoder alone."""
    other = night(7)
    out = {name: values.copy() for name, values in rows.columns.items()}
    for name in ('star', 'az', 'el', 'az_enc', 'el_enc', 'az_abs', 'el_abs'):
        out[name][since:since + 16] = other[name][since - 16:since]
    out['absolute_start'] = np.where(np.arange(len(rows)) < since, 1.8e9, 1.8e9 + 5000.0)
    return PointingRun(out)


def test_a_power_on_of_the_absolute_encoder_alone():
    still = cross_check(cycled(night(2)))
    assert still.alarms == [] and [c.cause for c in still.shifts] == ['nothing'] * 2
    assert [(c.since, c.run) for c in still.shifts] == [(1.0, 1.01)] * 2
    assert still.latest.run == 1.01
    # it moves: once told, as a jump at its moment
    report = cross_check(moved(cycled(night(2)), 'el_abs', 6.0))
    assert [line.split(' at ')[0] for line in report.alarms] == [
        'elevation: absolute encoder moved']
    assert [c.cause for c in report.shifts] == ['nothing', 'absolute encoder']
    # yesterday's place of the absolute encoder is compared with that before, and tonight's is kept
    report = cross_check(moved(cycled(night(2)), 'el_abs', 6.0), night(1))
    assert [c.cause for c in report.shifts] == [
        'nothing', 'nothing', 'nothing', 'absolute encoder']
    later = cross_check(night(3, second=(0.0, 6.0)), report.latest)
    assert later.alarms == [] and later.shifts[0].since == -1.0


def test_all_that_moves_when_the_absolute_encoder_is_switched_on():
    rows = cycled(night(2))
    report = cross_check(moved(moved(rows, 'az_abs', 4.0), 'az_enc', 4.0))
    assert all(line.startswith('azimuth: both or mount moved') for line in report.alarms)
    assert report.shifts[0].cause == 'both or mount' and len(report.alarms) == 1


def test_without_a_zero_since_the_absolute_encoder_was_switched_on():
    rows = night(2, polaris=16)
    start = np.where(np.arange(len(rows)) < 50, 1.8e9, 1.8e9 + 5000.0)
    assert cross_check(PointingRun({**rows.columns, 'absolute_start': start})).alarms == []
    start[:3] = np.nan
    assert cross_check(PointingRun({**rows.columns, 'absolute_start': start})).alarms == []


def test_a_mount_that_is_pushed_in_the_night():
    rows = moved(moved(night(2), 'az_enc', 8.0), 'az_abs', 8.0)
    report = cross_check(rows)
    assert [(e.axis, e.moved) for e in report.events] == [('azimuth', 'both or mount')]


def test_a_power_on_without_a_zero_of_its_own():
    first = night(2, (3.0, 0.0))
    later = night(3, (23.0, -9.0), run=2, polaris=0, start=4000.0)
    report = cross_check(PointingRun.concatenate([first, later]))
    assert [line.split(' and has')[0] for line in report.alarms] == [
        f'{axis}: incremental encoder began power-on 2 at 09:06:40 UTC'
        for axis in ('azimuth', 'elevation')]
    moved = float(report.alarms[0].split('moved by ')[1].split()[0])
    assert moved == pytest.approx(20.0, abs=1.0)
    # with Polaris it is an expected change
    later = night(3, (23.0, -9.0), run=2, start=4000.0)
    report = cross_check(PointingRun.concatenate([first, later]))
    assert report.alarms == []
    assert [(c.since, c.run) for c in report.shifts] == [(1.0, 2.0)] * 2


def test_the_newest_power_on_of_the_reference_counts():
    earlier = PointingRun.concatenate(
        [night(1), night(4, (3.0, 3.0), (9.0, 9.0), run=2, start=4000.0)])
    report = cross_check(night(2, (12.0, -7.0), (9.0, 9.0), start=DAY), earlier)
    assert report.alarms == [] and len(report.shifts) == 2
    assert report.shifts[0].difference / ARCSEC == pytest.approx(9.0, abs=0.6)


def test_an_encoder_that_gives_no_angle():
    rows = night(2)
    rows['az_enc'][10:20] = np.nan
    report = cross_check(rows)
    assert report.alarms == [
        'azimuth: incremental encoder gave no angle in 10 of 76 observations: reference mark not '
        'met (confidence 1.00)']


def test_what_an_encoder_says_that_should_say_something():
    assert MARKS_UNKNOWN in cross_check(night(2), homings=None).notes
    assert cross_check(night(2), homings=None).alarms == []
    assert cross_check(night(2), homings=()).notes == cross_check(night(2)).notes
    assert MARKS_UNKNOWN not in cross_check(night(2)).notes


def test_numbers_and_old_logs_say_the_same():
    axes = {'azimuth': AxisHoming(True, 'above', 2, 1, np.nan, 0.0686 * ARCSEC, 3 * ARCSEC, 4),
            'elevation': AxisHoming(False, '', 3, 0, np.nan, 0.0686 * ARCSEC, 3 * ARCSEC, 4)}
    rows = {'resolution [arcsec]': '0.0686'}
    for axis, one in axes.items():
        rows |= {f'{axis} homed': str(one.homed), f'{axis} mark met from': one.side,
                 f'{axis} missed marks': str(one.missed_marks),
                 f'{axis} mark error [counts]': f'{one.mark_error:.0f}',
                 f'{axis} mark width [arcsec]': '3.00'}
    for new, old in zip(axis_homings(axes, 7), diagnostic_homings(rows, 7), strict=True):
        assert new[:5] == old[:5]
        np.testing.assert_allclose(new[5:], old[5:], rtol=1e-12)


def test_what_the_encoder_says_of_itself():
    rows = {'resolution [arcsec]': '0.0686', 'azimuth homed': 'True',
            'azimuth mark met from': 'above', 'azimuth missed marks': '2',
            'azimuth mark error [counts]': 'nan', 'azimuth mark width [arcsec]': '3.00',
            'elevation homed': 'False', 'elevation missed marks': '3'}
    azimuth, elevation = diagnostic_homings(rows, 7)
    assert (azimuth.side, azimuth.homed, elevation.homed) == ('above', True, False)
    lines = cross_check(night(2), homings=[azimuth, elevation]).alarms
    assert lines[0].startswith('azimuth: incremental encoder, power-on 7: homed from above, not '
                               'from below: its zero differs by -3.00 arcsec')
    assert lines[1].startswith('elevation: incremental encoder, power-on 7: reference mark not '
                               'met, missed 3 times')
    lost = Homing(1, 'azimuth', True, 'below', 0, -120.0, 0.0686 * ARCSEC)
    assert '-120 counts (-8.23 arcsec)' in cross_check(night(2), homings=[lost]).alarms[0]
    assert cross_check(night(2), homings=[lost._replace(mark_error=3.0)]).alarms == []


def test_the_latest_zeros_of_a_night_is_a_reference():
    kept = cross_check(night(1, (1.0, 2.0))).latest
    rows = night(2, (12.0, -7.0), (0.0, 6.0))
    for change, whole in zip(cross_check(rows, kept).shifts,
                             cross_check(rows, night(1, (1.0, 2.0))).shifts):
        assert change.incremental == pytest.approx(whole.incremental, abs=1e-12)
        assert change.pull == pytest.approx(whole.pull, abs=1e-6)
        assert change.alarm == whole.alarm


def test_polaris_goes_round():
    # 300" of collimation make some arcsec between two places of Polaris on its circle
    model = mount(CA=300.0)
    before, now = night(1, model=model), night(2, model=model, hour=np.pi)
    with_model = cross_check(now, before, model=model)
    assert with_model.alarms == [] and max(abs(c.pull) for c in with_model.shifts) < 3.0
    wide = cross_check(now, before, budget=Budget(term=300.0 * ARCSEC))
    assert max(abs(c.pull) for c in wide.shifts) < 3.0
    assert wide.shifts[0].absolute_sigma > 2.0 * with_model.shifts[0].absolute_sigma
    assert max(abs(c.pull) for c in
               cross_check(now, before, budget=Budget(term=1.0 * ARCSEC)).shifts) > 4.0


def test_a_wrong_star_is_no_alarm():
    rows = night(2, (12.0, -7.0))
    for name in ('az_enc', 'az_abs', 'el_enc', 'el_abs'):
        rows[name][[5, 30, 70]] += 300.0 * ARCSEC
    rows['az_abs'][60] += 1200.0 * ARCSEC
    assert cross_check(rows, night(1)).alarms == []


def test_polaris_alone_will_do():
    report = cross_check(night(2, (5.0, 5.0), (0.0, 7.0), stars=0), night(1, stars=0))
    assert len(report.alarms) == 1 and report.alarms[0].startswith('elevation: ')
    assert report.shifts[1].absolute / ARCSEC == pytest.approx(7.0, abs=1.2)
    # one star cannot tell a slip from a lean
    assert report.shifts[1].moved['absolute encoder'] == pytest.approx(0.5, abs=0.1)
    assert 'Polaris alone' in report.notes[0]


def test_quiet_nights_are_quiet():
    reports = [cross_check(night(1000 + s, (9.0, 4.0)), night(5000 + s, start=-DAY))
               for s in range(15)]
    assert sum(bool(report.alarms) for report in reports) <= 1
    pulls = np.array([[c.absolute / c.absolute_sigma for c in r.shifts] for r in reports])
    assert 0.75 < pulls.std() < 1.25 and abs(pulls.mean()) < 0.4


def test_without_any_noise_nothing_is_seen_in_rounding():
    assert cross_check(night(2, noise=0.0), night(1, noise=0.0)).alarms == []
    rows = night(2, noise=0.0)
    rows['az_enc'][:] = np.floor(rows['az_enc'] / (0.0686 * ARCSEC)) * 0.0686 * ARCSEC
    assert cross_check(rows).alarms == []
    assert len(cross_check(moved(rows, 'az_enc', 0.2)).alarms) == 1


def test_few_rows_are_no_error():
    latest = cross_check(night(1)).latest
    for stars, polaris in ((0, 2), (1, 1), (2, 0), (3, 3), (6, 2), (12, 0)):
        rows = night(2, (12.0, -7.0), stars=stars, polaris=polaris)
        for reference in (None, latest) if stars else (None, latest, night(1, stars=0)):
            report = cross_check(rows, reference)
            assert report.alarms == []
    empty = night(2).select(slice(0, 0))
    assert cross_check(empty).latest is None
    assert cross_check(empty, night(1)).alarms == []


def test_a_missing_column_is_named():
    columns = {name: value for name, value in night(1).columns.items() if name != 'el_abs'}
    with pytest.raises(ValueError, match='column el_abs'):
        cross_check(PointingRun(columns))


def test_without_a_second_encoder_the_marks_are_judged_all_the_same():
    columns = {name: value for name, value in night(1).columns.items() if name[3:] != 'abs'}
    alone = PointingRun(columns)
    lost = Homing(1, 'azimuth', True, 'below', 0, 900.0, 0.0686 * ARCSEC)
    report = cross_check(alone, homings=[lost])
    assert len(report.alarms) == 1 and '900 counts' in report.alarms[0]
    assert report.notes == ['no second encoder: nothing to compare with']
    assert MARKS_UNKNOWN in cross_check(alone, homings=None).notes
