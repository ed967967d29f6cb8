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

"""Columns with awkward names, units or orders: none is taken for another, none vanishes."""

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model import context
from pointing_model.runs.columns.run_table import DERIVED
from pointing_model.runs.run import COLUMNS
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.site import Site

HEADER = 'az_deg,el_deg,az_enc_deg,el_enc_deg'
SITE = Site(31.69 * DEG, -110.88 * DEG, 2608.0)


def table(header, *rows):
    return '\n'.join([header, *(','.join(map(str, row)) for row in rows)]) + '\n'


def noted(run, *words):
    return any(all(word in note for word in words) for note in run.meta['notes'])


# --------------------------------------------------------------------------------------- names

def test_own_columns_do_not_touch_the_offsets(read):
    rows = [(10, 20, 3.5, -2, -20, 7), (30, 60, 3, 4, 5, 8)]
    for header in ('az_deg,el_deg,x_arcsec,y_arcsec,x,y', 'az_deg,el_deg,x_arcsec,y_arcsec,X,Y'):
        run = read(table(header, *rows))
        x, y = run.offsets()
        assert x / ARCSEC == pytest.approx([3.5, 3.0]) and y / ARCSEC == pytest.approx([-2, 4])
        own = header.split(',')[-2:]
        assert run[own[0]].tolist() == [-20, 5] and run[own[1]].tolist() == [7, 8]


def test_own_columns_beside_the_encoders_stay(read):
    run = read(table(HEADER + ',x,dec', (10, 20, 10, 20, 1, 3), (30, 40, 30, 40, 2, 4)))
    assert run['x'].tolist() == [1, 2] and run['column_dec'].tolist() == [3, 4]
    assert not noted(run, 'x_arcsec')


def test_own_columns_do_not_touch_the_icrs_place(read):
    header = 'ra_deg,dec_deg,time,x_arcsec,y_arcsec'
    rows = [(283.8338, 43.94611, '2021-08-21T04:36:01.5Z', 1, 2),
            (10.0, 20.0, '2021-08-21T09:00:00Z', 1, 2)]
    plain = read(table(header, *rows), site=SITE)
    run = read(table(header + ',ra,dec', *((*row, 18.9, 1) for row in rows)), site=SITE)
    assert np.array_equal(run['az'], plain['az']) and np.array_equal(run['el'], plain['el'])
    assert run['column_ra'].tolist() == [18.9] * 2


@pytest.mark.parametrize('name', sorted(DERIVED - {'lst'}))
def test_names_that_the_diagnosis_makes_are_renamed(read, name):
    run = read(table(f'{HEADER},{name}', (10, 20, 10, 20, 1), (30, 40, 30, 40, 2)))
    assert run[f'column_{name}'].tolist() == [1, 2] and name not in run
    assert noted(run, f'{name!r} is kept as', f'column_{name}')
    assert f'column_{name}' in context.Context.from_run(run).own_columns()


@pytest.mark.parametrize('name, cause', [
    ('Tamb', True), ('wind_speed', True), ('foc.dZ', True), ('tubeTempC', True),
    ('humidity_pct', True), ('rotator_deg', True), ('T_amb', True), ('mirror_temp', True),
    ('src.dFWHM', False), ('pnt.asymX', False), ('temp_residual', False), ('NEFD', False),
    ('column7', False), ('rms', False), ('fit_error_mag', False), ('okchannels', False)])
def test_a_column_is_a_driver_if_its_name_is_that_of_a_cause(read, name, cause):
    run = read(table(f'{HEADER},{name}', (10, 20, 10, 20, 1), (30, 40, 30, 40, 2)))
    drivers = context.Context.from_run(run)
    assert (drivers.extra(), drivers.left_out()) == (([name], []) if cause else ([], [name]))
    run.meta['drivers'] = (name,)
    named = context.Context.from_run(run)
    assert named.extra() == [name] == named.select([0]).extra() and not named.left_out()


def test_a_new_name_does_not_meet_another(read):
    run = read(table(f'{HEADER},row,column_row', (10, 20, 10, 20, 1, 5), (30, 40, 30, 40, 2, 6)))
    assert run['column_row'].tolist() == [5, 6] and run['column_column_row'].tolist() == [1, 2]


def test_all_names_that_the_diagnosis_makes_are_known():
    made = {name.removeprefix('_derive_') for name in dir(context.Context)
            if name.startswith('_derive_')}
    of_axis = {'reading', 'unwrapped', 'travel', 'slew', 'before'}
    made = made - of_axis | {f'{name}_{axis}' for name in of_axis for axis in ('az', 'el')}
    made = made - {'pm'} | {'pm_x', 'pm_y'}
    read_from_files = {'pier_side', 'lst_h'}
    assert (made | context._KNOWN) - set(COLUMNS) - read_from_files <= DERIVED


def test_a_column_whose_name_is_near_one_that_is_read_is_noted(read):
    for name, meant in (('sigma_x_arcsec', 'sigma_az_arcsec'), ('sigma_el', 'sigma_el_arcsec'),
                        ('sigma_arcsec', 'sigma_az_arcsec'), ('Az_Sigma_arcsec', 'sigma_az_arcsec'),
                        ('temperatur_c', 'temperature_c'), ('Time', 'time')):
        run = read(table(f'{HEADER},{name}', (10, 20, 10, 20, 1), (30, 40, 30, 40, 2)))
        assert noted(run, repr(name), 'is not read', meant), name
    german = read('# mount: german\n# latitude_deg: 40\n' + table(
        'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg,sigma_y_arcsec,pierside',
        (10, 20, 10, 20, 1, 'east'), (30, 40, 30, 40, 2, 'west')))
    assert noted(german, "'sigma_y_arcsec'", 'is not read', 'sigma_dec_arcsec')
    assert noted(german, "'pierside'", 'is not read', 'pier_side')
    for name in ('az_err_deg', 'temperature_dome_c', 'rotator_deg', 'az_model_deg', 'rms_arcsec'):
        assert not noted(read(table(f'{HEADER},{name}', (10, 20, 10, 20, 1))), 'is not read')


def test_names_of_an_iram_log_meet_no_other(read):
    text = ('# id\tobject\tUTh(f2)\tAZd(f0) ELd(f0)\tpnt.X(f1) pnt.Y(f1)\tx(f1)\ttime(f1)\n'
            '2012-04-16.8\t1253\t23.50\t161 45\t2.9 -47.3\t100\t7\n'
            '2012-04-17.1\tW3\t0.25\t-76 46\t4.9 -43.3\t200\t8\n')
    run = read(text)
    assert run.offsets()[0] / ARCSEC == pytest.approx([2.9, 4.9])
    assert run['x'].tolist() == [100, 200] and run['column_time'].tolist() == [7, 8]
    assert noted(run, 'column_time')


@pytest.mark.parametrize('values, name, word', [
    ((18.5, 23.9), 'lst_h', 'hours'), ((1.5, 6.2), 'lst', 'radians'),
    ((120.0, 350.0), 'column_lst', 'lst_h'), ((-2.0, 12.0), 'column_lst', 'lst_h')])
def test_sidereal_time_by_its_unit(read, values, name, word):
    run = read(table(HEADER + ',lst', (10, 20, 10, 20, values[0]), (30, 40, 30, 40, values[1])))
    assert run[name].tolist() == list(values) and noted(run, 'lst', word)
    assert {'lst', 'lst_h', 'column_lst'} & set(run.columns) == {name}


def test_sidereal_time_twice(read):
    run = read(table(HEADER + ',lst,lst_h', (10, 20, 10, 20, 8, 9), (30, 40, 30, 40, 8.5, 9.5)))
    assert run['lst_h'].tolist() == [9, 9.5] and run['column_lst'].tolist() == [8, 8.5]


# ------------------------------------------------------------------------------------ approach

def night(seed=1, n=40):
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 360, n).round(3), rng.uniform(20, 80, n).round(3)
    time = 1.7e9 + np.cumsum(rng.uniform(60, 120, n)).round(1)
    return [(t, a, e, a, e) for t, a, e in zip(time, az, el)]


def test_approach_follows_the_time(read):
    rows, rng = night(), np.random.default_rng(2)
    run = read(table('time,' + HEADER, *rows))
    assert noted(run, 'from the order in time')
    for order in (np.arange(len(rows))[::-1], rng.permutation(len(rows))):
        mixed = read(table('time,' + HEADER, *(rows[i] for i in order)))
        for name in ('time', 'az', 'approach_az', 'approach_el'):
            assert np.array_equal(mixed[name], run[name][order]), name


def test_approach_follows_the_time_within_each_run(read):
    """Each clock begins anew: the time alone would mix the runs."""
    rows = [(0, 10, 30, 10, 30, 1), (200, 30, 40, 30, 40, 1), (100, 50, 50, 50, 50, 1),
            (150, 20, 60, 20, 60, 2), (50, 40, 70, 40, 70, 2)]
    run = read(table(f'time,{HEADER},run', *rows))
    assert run['approach_az'].tolist() == [0, -1, 1, -1, 0]
    assert run['approach_el'].tolist() == [0, -1, 1, -1, 0]


@pytest.mark.parametrize('time', ['', 5])
def test_approach_without_the_time_of_every_row(read, time):
    rows = [(5, 10, 30, 10, 30), (5, 30, 20, 30, 20), (time, 20, 40, 20, 40)]
    run = read(table('time,' + HEADER, *rows))
    assert run['approach_az'].tolist() == [0, 1, -1]
    assert noted(run, 'from the order of the rows')


def test_an_empty_approach_is_derived(read):
    rows = [(10, 30, 10, 30, '', 'nan'), (30, 20, 30, 20, '', ''), (20, 40, 20, 40, '', '')]
    run = read(table(f'{HEADER},approach_az,approach_el', *rows))
    assert run['approach_az'].tolist() == [0, 1, -1] and run['approach_el'].tolist() == [0, -1, 1]
    assert noted(run, 'direction of approach in azimuth and elevation')
    assert run.meta['approach_from'] == {'axes': ['az', 'el'], 'order': 'rows'}
    rows[1] = (30, 20, 30, 20, -1, '')
    some = read(table(f'{HEADER},approach_az,approach_el', *rows))
    assert some['approach_az'].tolist() == [0, -1, 0]
    assert noted(some, 'approach_az is empty in 2 of 3') and noted(some, 'approach in elevation: ')


# ---------------------------------------------------------------------------------------- time

def with_times(times):
    return table('time,' + HEADER, *((t, *row[1:]) for t, row in zip(times, night())))


@pytest.mark.parametrize('scale, word', [
    (1e3, 'milliseconds'), (1e6, 'microseconds'), (1e9, 'nanoseconds')])
def test_fractions_of_seconds_are_refused(refuse, scale, word):
    text = with_times([f'{row[0] * scale:.0f}' for row in night()])
    refuse(text, 'row 2, column time', '1900 to 2100', word)


@pytest.mark.parametrize('value', ['1e20', '-1e11', '20231114221415', '1e308'])
def test_seconds_outside_1900_to_2100_are_left_out(read, value):
    run = read(with_times([1.7e9, 1.7e9 + 60, value]))
    (left,) = run.meta['excluded']
    assert left['row'] == 4 and left['reason'].startswith(f"time '{value}' is outside 1900 to 2100")


@pytest.mark.parametrize('scale, zero, word', [
    (86400, 40587, 'MJD'), (86400, 2440587.5, 'Julian'), (3600, 20 - 1.7e9 / 3600, 'hours'),
    (86400, 0, 'days')])
def test_days_and_hours_are_refused(refuse, scale, zero, word):
    text = with_times([f'{zero + row[0] / scale:.9f}' for row in night()])
    refuse(text, 'column time, rows 2 to 41', 'apart', 'seconds are expected', word)


def test_times_that_are_close_are_told(read):
    assert noted(read(with_times(np.arange(8) * 0.2)), 'seconds are expected')
    said, = (note for note in read(with_times(np.arange(8) * 0.7)).meta['notes']
             if 'is this minutes?' in note)
    assert said.caution  # in the first lines
    assert not noted(read(with_times(np.arange(8) * 40.0)), 'seconds are expected')
    assert len(read(with_times([60310.1, 60310.2, 60310.3]))) == 3
    assert len(read(with_times([5] * 8))) == 8
    assert len(read(with_times([f'2024-01-01T00:00:00.{i}Z' for i in range(8)]))) == 8
    assert len(read(with_times(['-1e9', '-999999000']))) == 2


# ------------------------------------------------------------------- radians, absurd numbers

def round_the_pole(unit, noise=0.01, n=50, header=HEADER):
    rng = np.random.default_rng(5)
    az, el = rng.uniform(0, 6.1 / unit, n), rng.uniform(20, 80, n)
    az_enc, el_enc = (v + 0.02 + noise * rng.normal(size=n) for v in (az, el))
    return table(header, *zip(az * unit, el, az_enc * unit, el_enc))


def test_a_cut_near_north_is_not_taken_for_radians(read, refuse):
    run = read(round_the_pole(1.0))
    assert len(run) == 50 and noted(run, 'az_deg never exceeds', 'taken as degrees')
    refuse(round_the_pole(DEG), 'az_deg never', 'radians')
    offsets = round_the_pole(1.0, header='az_deg,el_deg,x_arcsec,y_arcsec')
    assert len(read(offsets)) == 50


def test_one_azimuth_in_radians_beside_degrees(refuse):
    rows = [(36 * i * DEG, 20 + 6 * i, 36 * i, 20 + 6 * i) for i in range(10)]
    refuse(table(HEADER, *rows), 'az_deg never', 'radians')


def test_low_places_near_north_are_no_radians(read):
    assert len(read(table(HEADER, (1, 3, 1, 3), (2, 4, 2, 4), (3, 5, 3, 5)))) == 3


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name, cells, kept', [
    ('temperature_c', (12, '1e308', '-1e308', -300, 20), [12, 20]),
    ('pressure_hpa', (740, 0, 101325, 741, '-5'), [740, 741]),
    ('humidity', (0.5, '1e308', '-1e200', 0.25, 1e20), [0.5, 0.25, 1e20])])
def test_absurd_numbers_count_as_not_measured(read, name, cells, kept):
    rows = [(10 * i, 20 + 9 * i, 10 * i, 20 + 9 * i, cell) for i, cell in enumerate(cells)]
    run = read(table(f'{HEADER},{name}', *rows))
    values = run[{'temperature_c': 'temperature', 'pressure_hpa': 'pressure'}.get(name, name)]
    assert len(run) == 5 and values[np.isfinite(values)].tolist() == kept
    assert noted(run, name, f'in {5 - len(kept)} of 5 rows', 'treated as missing')


def test_absurd_numbers_that_are_needed_leave_their_row_out(read):
    run = read(table('az_deg,el_deg,x_arcsec,y_arcsec,sigma_az_arcsec', (10, 20, 1, 1, 1),
                     (20, 30, 1, '1e308', 1), (30, 40, 1, 1, '1e308')))
    assert [e['row'] for e in run.meta['excluded']] == [3, 4]
    assert 'y_arcsec is outside' in run.meta['excluded'][0]['reason']


@pytest.mark.parametrize('given, other', [('az', 'el'), ('el', 'az')])
def test_sigmas_of_one_axis_alone_are_said_not_to_be_used(read, given, other):
    said = f'sigma_{given}_arcsec without sigma_{other}_arcsec is not used: give both'
    rows = [(10, 20, 10, 20, 1, 3), (30, 40, 30, 40, 2, 3)]
    lone = read(table(f'{HEADER},sigma_{given}_arcsec', *(row[:5] for row in rows)))
    assert said in lone.meta['notes']
    header = f'{HEADER},sigma_{given}_arcsec,sigma_{other}_arcsec'
    assert not noted(read(table(header, *rows)), 'without')


def test_a_measured_file_reads_as_before(tmp_path):
    path = tmp_path / 'run.csv'
    path.write_text(table('time,' + HEADER + ',temperature_c,pier_side,lst_h',
                          *((*row, 10, 1, 5) for row in night())))
    run = read_run(path)
    assert {'temperature', 'pier_side', 'lst_h'} <= set(run.columns)
    assert 'derived' in run.meta['notes'][-1] and len(run.meta['notes']) == 2  # it never errs


def test_blocks_of_a_long_file_are_one_table(read, monkeypatch):
    rows = [(f'2021-08-21T04:{i:02d}:01.5Z', 10 + i, 20 + i, 10 + i, 20 + i, f'é {i % 3}', i)
            for i in range(40)]
    rows[30] = rows[4]
    text = table(f'time,{HEADER},star,fan', *rows)
    whole = read(text)
    for module in ('cells', 'cell_values'):
        monkeypatch.setattr(f'pointing_model.runs.columns.{module}._BLOCK', 7)
    run = read(text)
    assert whole.meta['notes'] == run.meta['notes'] and len(run) == 39
    np.testing.assert_array_equal(whole.meta['lines'], run.meta['lines'])
    assert [(e['row'], e['reason']) for e in run.meta['excluded']] == [(32, 'the same as line 6')]
    for name in whole.columns:
        assert run[name].dtype == whole[name].dtype
        np.testing.assert_array_equal(run[name], whole[name])
    for row, said in ((rows[23][:6], '6 cells, but the header has 7'),
                      ((*rows[23][:6], '"'), 'a quoted cell does not end on its line')):
        spoiled = read(table(f'time,{HEADER},star,fan', *rows[:23], row, *rows[24:]))
        assert len(spoiled) == 38
        assert spoiled.meta['excluded'][0] == {'row': 25, 'reason': said}


def test_a_table_of_many_columns_is_refused_at_once(read):
    with pytest.raises(ValueError, match='100004 columns, at most 1000 are read'):
        read(table(HEADER + ''.join(f',c{i}' for i in range(100_000)), (0, 45, 0, 45)))


def test_columns_that_are_left_out_are_said_by_the_axes_of_the_mount(tmp_path):
    path = tmp_path / 'german.csv'
    path.write_text('# mount: german\n# latitude_deg: 48\n'
                    'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg,sigma_y\n10,20,10.1,20.1,1\n')
    said = ' '.join(read_run(path).meta['notes'])
    assert "'sigma_y' left out: its unit is unknown, the name is sigma_dec_arcsec" in said
    assert 'sigma_el' not in said
