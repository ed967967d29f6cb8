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

"""Pointing runs from files: what is read, what is refused, what comes back."""

import re

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.runs.columns.row_checks import NoUsableRow
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site

HEADER = 'az_deg,el_deg,az_enc_deg,el_enc_deg'
GOOD = f'{HEADER}\n10,20,10.1,20.1\n350,40,350.2,40.2\n100,60,100.3,60.3\n'


# ----------------------------------------------------------------------------------------- CSV

def test_columns_in_any_order_with_units(read):
    run = read('\ufeff# a comment\n'
               'el_enc_deg,star,az_deg,temperature_c,sigma_az_arcsec,el_deg,az_enc_deg,humidity\n'
               '20.5,HIP 1,10,-3.5,2,20,10.25,0.5\n'
               '\n'
               '30.5,"a, b",200,,3,30,200.25,0.25\n')
    assert len(run) == 2
    assert run['az'] == pytest.approx([10 * DEG, 200 * DEG], abs=1e-15)
    x, y = run.offsets()
    assert y == pytest.approx([0.5 * DEG] * 2)
    assert x == pytest.approx(0.25 * DEG * np.cos(run['el']))
    assert run['sigma_x'] == pytest.approx([2 * ARCSEC, 3 * ARCSEC])
    assert run['star'].tolist() == ['HIP 1', 'a, b']
    assert run['temperature'][0] == -3.5 and np.isnan(run['temperature'][1])
    assert run['humidity'].tolist() == [0.5, 0.25]
    assert any('temperature_c is empty in 1' in note for note in run.meta['notes'])


@pytest.mark.parametrize('delimiter', [';', '\t'])
def test_other_delimiters(read, delimiter):
    assert read(GOOD.replace(',', delimiter))['el'][2] == pytest.approx(60 * DEG)


def test_times(read):
    def times(*cells):
        rows = [f'{cell},{10 + i},30,10,30' for i, cell in enumerate(cells)]
        return read('time,' + HEADER + '\n' + '\n'.join(rows))['time']
    assert times('1629520561.25', '0').tolist() == [1629520561.25, 0.0]
    got = times('2021-08-21T04:36:01.25Z', '2021-08-21 04:36:01.250',
                '2021-08-21T12:36:01.25+08:00', '2021-08-20T20:06:01.250000-0830', '')
    assert got[:4].tolist() == [1629520561.25] * 4 and np.isnan(got[4])
    for bad in ('yesterday', '2021-13-01T00:00:00Z', '21/08/2021', 'now', '2021-08',
                '2021-08-21T04:36:61Z', '2021-08-21T24:00:01Z', '2021-02-30'):
        with pytest.raises(ValueError, match=f'row 2, column time: .*{bad[:4]}.* ISO 8601'):
            times(bad, '', bad)


def test_times_that_are_no_utc(read, refuse):
    text = f'time,{HEADER}\n59447.1,10,30,10,30\n59447.2,12,30,12,30\n'
    run = read(text)
    assert run['time'].tolist() == [59447.1, 59447.2] and run.meta['time_is_utc'] is False
    assert any('arbitrary start' in note for note in run.meta['notes'])
    refuse(text.replace('59447.2', '2021-08-21'), 'mixes seconds (row 2)', '(row 3)')
    refuse(text.replace('59447.1', '1899-12-31').replace('59447.2', ''), 'row 2', '1900')


def test_round_trip(tmp_path):
    rng = np.random.default_rng(3)
    n = 500
    columns = {
        'time': 1.75e9 + rng.uniform(0, 1e8, n),
        'star': rng.integers(1, 118000, n),
        'az': rng.uniform(-2 * np.pi, 4 * np.pi, n), 'el': rng.uniform(0.1, 1.57, n),
        'az_enc': rng.uniform(-7, 7, n), 'el_enc': rng.uniform(0.1, 1.57, n),
        'sigma_x': rng.uniform(0.5, 2, n) * ARCSEC, 'miss_x': rng.normal(size=n) * ARCSEC,
        'approach_az': rng.choice([-1.0, 1.0], n), 'approach_el': rng.choice([-1.0, 1.0], n),
        'temperature': rng.normal(size=n), 'my_driver': rng.normal(size=n) * 1e-30,
    }
    columns['temperature'][7] = np.nan
    write_csv(PointingRun(dict(columns)), tmp_path / 'run.csv')
    run = read_run(tmp_path / 'run.csv')
    assert set(run.columns) == set(columns)
    for name, values in columns.items():
        error = np.abs(run[name] - values)
        assert np.array_equal(np.isnan(error), np.isnan(values)), name
        assert np.nanmax(error) < 1e-9 * ARCSEC, name
    assert np.array_equal(run['time'], columns['time'])
    assert run['star'].dtype.kind == 'i'
    header = (tmp_path / 'run.csv').read_text().splitlines()[0]
    assert header.startswith('time,star,az_deg,el_deg,az_enc_deg') and header.endswith('my_driver')


def test_plain_numbers_are_those_of_people(tmp_path):
    rng = np.random.default_rng(4)
    az, el = rng.uniform(0, 7, 50), rng.uniform(0.1, 1.5, 50)
    time = 1.75e9 + rng.uniform(0, 1e5, 50)
    run = PointingRun({
        'time': time, 'run': np.ones(50), 'az': az, 'el': el, 'az_enc': az + 1e-4,
        'el_enc': el - 1e-4, 'miss_x': np.r_[-1e-9 * ARCSEC, rng.normal(size=49) * ARCSEC],
        'approach_az': np.tile([-1.0, 1.0], 25), 'temperature': np.r_[np.nan, np.full(49, 4.25)],
        'encoder_start': np.full(50, 1768482003.866)})
    write_csv(run, tmp_path / 'run.csv', plain=True)
    header, first, second = (line.split(',') for line in
                             (tmp_path / 'run.csv').read_text().splitlines()[:3])
    told = dict(zip(header, zip(first, second)))
    assert re.fullmatch(r'2025-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z', told['time'][0])
    assert told['run'] == ('1', '1') and told['approach_az'] == ('-1', '1')
    assert all(re.fullmatch(r'\d+\.\d{10}', cell) for cell in told['az_enc_deg'])
    assert told['miss_x_arcsec'][0] == '0.000000' and told['temperature_c'] == ('', '4.25')
    back = read_run(tmp_path / 'run.csv')
    assert np.abs(back['time'] - time).max() < 1e-6
    assert np.array_equal(back['encoder_start'], run['encoder_start'])
    for name in ('az', 'el', 'az_enc', 'el_enc'):
        assert np.abs(back[name] - run[name]).max() < 2e-7 * ARCSEC


def test_text_with_commas_comes_back(tmp_path):
    run = PointingRun({'az': [0.1, 3.0], 'el': [0.5, 1.0], 'az_enc': [0.1, 3.0],
                       'el_enc': [0.5, 1.0], 'star': ['alpha, "A"', 'b']})
    write_csv(run, tmp_path / 'run.csv')
    assert read_run(tmp_path / 'run.csv')['star'].tolist() == ['alpha, "A"', 'b']


def test_a_missing_column_is_named_with_the_closest(read, refuse):
    message = refuse(GOOD.replace('az_enc_deg', 'az_encoder_deg'), 'az_enc_deg',
                     'closest: az_encoder_deg', 'el_enc_deg')
    assert 'no column az_enc_deg (closest' in message


@pytest.mark.parametrize('text, words', [
    ('', ['empty']),
    ('\n  \n', ['empty']),
    (HEADER + '\n', ['no observations']),
    (HEADER, ['no observations']),
    (GOOD.replace('20.1', '2o.1').replace('40.2', '4o.2'), ['row 2', 'el_enc_deg', '2o.1']),
    (GOOD.replace('100,60,', '100,').replace('10,20,', '10,'), ['row 2', '3 cells', '4']),
    (GOOD.replace('el_deg,', 'az_deg,', 1), ['az_deg', 'twice']),
    (b'\x7fELF\0\0\1', ['binary']),
    (bytes(range(256)) * 9, ['binary']),
    (b'\x89MCAP0\r\n' + b'x' * 50, ['MCAP']),
    ('Dear diary, it rained.\nNo stars.\n', ['not a pointing run']),
    ('1,2,3,4\n5,6,7,8\n', ['not a pointing run']),
    (HEADER + '\nnan,1,2,3\n5,95,7,8\n', ['none of 2 rows', 'row 2']),
])
def test_refused(read, text, words, refuse):
    refuse(text, *words)


def test_folder_and_missing_file(tmp_path):
    with pytest.raises(ValueError, match='folder'):
        read_run(tmp_path)
    with pytest.raises(OSError):
        read_run(tmp_path / 'missing.csv')


@pytest.mark.parametrize('columns', [('az', 'el', 'az_enc', 'el_enc'), ('az_enc', 'el_enc')])
def test_radians_are_noticed(read, columns, refuse):
    rows = [[10.0, 20.0, 10.1, 20.1], [350.0, 40.0, 350.2, 40.2]]
    names = ('az', 'el', 'az_enc', 'el_enc')
    scaled = [[v * DEG if n in columns else v for n, v in zip(names, row)] for row in rows]
    text = HEADER + '\n' + '\n'.join(','.join(map(str, row)) for row in scaled)
    refuse(text, 'radians', 'give degrees', 'az_enc_deg' if len(columns) == 2 else 'az_deg')


def test_unusable_rows_are_left_out_and_listed(read):
    run = read(
        f'{HEADER},sigma_el_arcsec,extra\n'
        '10,20,10,20,1,0\n'
        'nan,20,10,20,1,0\n'
        '11,,10,20,1,0\n'
        '12,20,inf,20,1,0\n'
        '13,91,13,91,1,0\n'
        '14,-6,14,-6,1,0\n'
        '10,20,10,20,1,0\n'
        '15,20,15,20,0,0\n'
        '16,20,16,20,1,inf\n'
        '17,90.05,17,90,1,0\n')
    assert run['az'] / DEG == pytest.approx([10, 17])
    excluded = {e['row']: e['reason'] for e in run.meta['excluded']}
    assert sorted(excluded) == [3, 4, 5, 6, 7, 8, 9, 10]
    assert 'az_deg is not a number' in excluded[3] and 'el_deg' in excluded[4]
    assert 'infinite' in excluded[5] and 'elevation' in excluded[6]
    assert excluded[8] == 'the same as line 2'
    assert 'positive' in excluded[9] and 'extra' in excluded[10]


def test_approach_from_the_order_of_the_rows(read):
    text = f'{HEADER},run\n' + '\n'.join(
        f'{az},{el},{az},{el},{run}' for az, el, run in
        [(350, 30, 1), (10, 40, 1), (340, 40, 1), (341, 20, 2), (342, 21, 2)])
    run = read(text)
    # the second star is reached over north: that is the positive sense
    assert run['approach_az'].tolist() == [0, 1, -1, 0, 1]
    # an axis that stands still was last moved as before
    assert run['approach_el'].tolist() == [0, 1, 1, 0, 1]
    assert any('derived' in note for note in run.meta['notes'])
    given = read(f'{HEADER},approach_az,approach_el\n1,30,1,30,-1,1\n9,20,9,20,-1,1\n')
    assert given['approach_az'].tolist() == [-1, -1]
    assert not given.meta['notes']


def test_exposures_of_one_star_keep_the_direction_by_which_the_axes_came(read):
    """The sign of what they differ by is that of the error itself, and no direction."""
    rng = np.random.default_rng(4)
    az, el = (np.repeat(rng.uniform(20, 80, 30), 3) for _ in range(2))
    noise = rng.normal(size=(2, 90)) * 5.0 / 3600.0
    run = read(f'{HEADER}\n' + '\n'.join(
        f'{a:.6f},{e:.6f},{a + x:.7f},{e + y:.7f}' for a, e, x, y in zip(az, el, *noise)))
    for axis, angle in (('az', az), ('el', el)):
        way = np.sign(np.diff(angle[::3], prepend=angle[0]))
        assert run[f'approach_{axis}'].tolist() == np.repeat(way, 3).tolist()


def test_columns_that_cannot_be_used_are_told(read):
    run = read(f'{HEADER},az,observer\n10,20,10,20,0.1,Anna\n30,40,30,40,0.2,Bo\n')
    assert 'observer' not in run
    notes = ' '.join(run.meta['notes'])
    assert "'observer' left out" in notes and "'az' left out" in notes
    assert run['az'][0] == pytest.approx(10 * DEG)


def test_second_encoder(read, refuse):
    text = 'az_deg,el_deg,az_abs_deg,el_abs_deg\n10,20,11,22\n30,40,31,42\n'
    refuse(text, "encoder 'abs'", 'az_enc_deg')
    assert read(text, encoder='abs').offsets()[1] == pytest.approx([2 * DEG] * 2)
    both = read('az_deg,el_deg,az_abs_deg,el_abs_deg,az_enc_deg,el_enc_deg\n'
                '10,20,11,22,10,20.5\n30,40,31,42,30,40.5\n', encoder='abs')
    assert both.offsets('enc')[1] == pytest.approx([2 * DEG] * 2)
    assert both.offsets('abs')[1] == pytest.approx([0.5 * DEG] * 2)
    refuse(GOOD, 'az_abs_deg', encoder='abs')


def test_azimuth_from_south(read):
    """South = 0, east = 90: east stays east, a positive error turns negative."""
    text = f'{HEADER},az_rate_arcsec_s\n90,20,90.1,20,5\n0,40,0.1,40,5\n'
    run = read(text, azimuth_origin='S')
    assert wrap(run['az'] - np.array([90, 180]) * DEG) == pytest.approx([0, 0], abs=1e-12)
    assert run.offsets()[0] == pytest.approx(-0.1 * DEG * np.cos(run['el']))
    assert run['az_rate'] == pytest.approx([-5 * ARCSEC] * 2)
    # azimuths from the south through west would be mirrored without a word
    assert 'azimuth read from south through east, as requested' in run.meta['notes']
    turned = read('ha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n10,20,10,20\n30,40,30,40\n',
                  azimuth_origin='S', mount='equatorial', site={'latitude': 0.5})
    assert 'azimuth origin S changes nothing: this mount has no azimuth' in turned.meta['notes']
    assert read(text)['az'][0] == pytest.approx(90 * DEG)
    with pytest.raises(ValueError, match='neither N nor S'):
        read(text, azimuth_origin='E')


def test_rows_that_are_left_out_count_for_the_approach(read):
    """The mount was at the rejected star too."""
    rows = ['10,30,10,30,1', '50,60,50,60,0', '20,40,20,40,1', 'nan,1,nan,1,1', '30,50,30,50,1']
    run = read(f'{HEADER},sigma_az_arcsec\n' + '\n'.join(rows))
    assert len(run) == 3
    assert run['approach_az'].tolist() == [0, -1, 0]
    assert run['approach_el'].tolist() == [0, -1, 1]


def test_azimuths_that_tell_the_turn_give_the_way_as_it_was(read):
    text = f'{HEADER}\n350,30,350,30\n10,40,{{}},40\n200,40,200,40\n330,40,-30,40\n'
    assert read(text.format(10))['approach_az'].tolist() == [0, -1, 1, -1]
    # 0.1 deg of offset across north tells no turn
    near = text.replace('-30', '330').format(-0.1).replace('10,40', '0.05,40')
    assert read(near)['approach_az'].tolist() == [0, 1, -1, 1]


@pytest.mark.parametrize('cell', ['2', '0.5', 'inf', 'east'])
def test_an_approach_is_a_sign(read, cell, refuse):
    text = f'{HEADER},approach_el\n9,20,9,20,{cell}\n'
    refuse(text, 'row 2', 'approach_el', cell)
    run = read(text + '1,30,1,30,-1\n')
    assert run['approach_el'].tolist() == [-1.0]
    assert f'approach_el {cell!r} is not' in run.meta['excluded'][0]['reason']


def test_runs_by_name_are_numbered(read):
    run = read(f'{HEADER},run\n1,30,1,30,b\n9,20,9,20,a\n5,20,5,20,b\n')
    assert run['run'].tolist() == [1, 2, 1]
    assert any("1 'b', 2 'a'" in note for note in run.meta['notes'])


def test_rows_behind_a_comment_sign_are_counted(read):
    run = read(GOOD + '#7,20,7.1,20.1\n# 7, as the 3rd, was cloudy, I think\n')
    assert len(run) == 3
    assert run.meta['excluded'] == [{'row': 5, 'reason': 'commented out'}]


def test_rows_are_numbered_as_an_editor_does(read):
    text = '# one\r\n\x0c# two\u2028\r\n' + GOOD.replace('\n', '\r\n').replace('60.3', 'x')
    assert read(text).meta['excluded'] == [
        {'row': 6, 'reason': "el_enc_deg 'x' is not a number"}]


def test_names_that_look_like_comments_come_back(tmp_path):
    run = PointingRun({'az': [0.1, 3.0], 'el': [0.5, 1.0], 'az_enc': [0.1, 3.0],
                       'el_enc': [0.5, 1.0], 'star': ['#1', '2']})
    write_csv(run, tmp_path / 'run.csv')
    assert read_run(tmp_path / 'run.csv')['star'].tolist() == ['#1', '2']
    run.columns['star'] = np.array(['a\nb', '2'])
    with pytest.raises(ValueError, match='spans lines'):
        write_csv(run, tmp_path / 'run.csv')


def test_some_rows_in_radians_are_left_out(read):
    rows = [[120, 50], [2.0944, 0.8727], [33, 20], [250, 70]]
    run = read(HEADER + '\n' + '\n'.join(f'{a},{e},{a},{e}' for a, e in rows))
    assert run['az'] / DEG == pytest.approx([120, 33, 250])
    assert run.meta['excluded'] == [
        {'row': 3, 'reason': 'all angles below 2 pi: they look like radians'}]


@pytest.mark.parametrize('az, el, name', [(1, DEG, 'el_deg'), (DEG, 1, 'az_deg')])
def test_one_angle_in_radians_is_noticed(read, az, el, name, refuse):
    rows = [(36 * i * az, (20 + 6 * i) * el) for i in range(10)]
    text = HEADER + '\n' + '\n'.join(f'{a},{e},{a},{e}' for a, e in rows)
    refuse(text, f'{name} never', 'radians')


def test_polaris_alone_is_not_taken_for_radians(read):
    rows = [(0.6 + 0.1 * i, 34 + 0.05 * i) for i in range(10)]
    assert len(read(HEADER + '\n' + '\n'.join(f'{a},{e},{a},{e}' for a, e in rows))) == 10


# ------------------------------------------------------------------- offsets, ICRS directions

def test_offsets_in_place_of_the_encoders(read):
    """x is on the sky: at 60 degrees of elevation 3 arcsec are 6 of azimuth."""
    run = read('az_deg,el_deg,x_arcsec,y_arcsec\n10,20,3.5,-2\n359.9999,60,3,4\n'
               '50,90,1,1\n60,30,nan,1\n')
    assert len(run) == 2
    assert (run['az_enc'] - run['az'])[1] / ARCSEC == pytest.approx(6.0)
    x, y = run.offsets()
    assert x / ARCSEC == pytest.approx([3.5, 3.0]) and y / ARCSEC == pytest.approx([-2.0, 4.0])
    assert [e['row'] for e in run.meta['excluded']] == [4, 5]
    assert 'near the zenith' in run.meta['excluded'][0]['reason']
    assert 'x_arcsec is not a number' in run.meta['excluded'][1]['reason']
    assert run.meta['raw_reading'] is False and 'x' not in run and 'y' not in run
    rows = '10,20,{0},{0}\n30,60,{0},{0}\n50,60,{0},{0}\n'
    for size, said in (0.001, True), (0.0, True), (1.0, False):
        run = read('az_deg,el_deg,x_arcsec,y_arcsec\n' + rows.format(size))
        assert any('less than on any mount' in note for note in run.meta['notes']) == said
    south = read('az_deg,el_deg,x_arcsec,y_arcsec\n10,20,3.5,-2\n300,20,3.5,-2\n',
                 azimuth_origin='S')
    assert south.offsets()[0] / ARCSEC == pytest.approx([-3.5] * 2)


def test_offsets_beside_the_encoders_are_no_driver(read, refuse):
    run = read(f'{HEADER},x_arcsec,y_arcsec\n10,20,10,20,1,2\n30,40,30,40,1,2\n')
    assert 'x' not in run and 'x_arcsec' not in run and run.offsets()[0].tolist() == [0, 0]
    assert sum('left out: the encoder' in note for note in run.meta['notes']) == 2
    refuse('az_deg,el_deg,x_arcsec\n1,2,3\n4,50,6\n', 'no column y_arcsec')


SITE = Site(31.69 * DEG, -110.88 * DEG, 2608.0)
ICRS = ('ra_deg,dec_deg,time,x_arcsec,y_arcsec\n'
        '283.8338,43.94611,2021-08-21T04:36:01.5Z,1,2\n'
        '10.0,20.0,2021-08-21T09:00:00Z,1,2\n'
        '10.0,20.0,,1,2\n'
        '10.0,95.0,2021-08-21T09:00:00Z,1,2\n')


def test_places_from_icrs(read):
    run = read(ICRS, site=SITE, weather=Weather(741.0, 13.0, 0.75, 0.55))
    # the first is FK5 711 in the carried night of the MMT
    assert run['az'][0] / DEG == pytest.approx(347.278, abs=0.02)
    assert run['el'][0] / DEG == pytest.approx(77.35, abs=0.02)
    assert {e['row']: e['reason'] for e in run.meta['excluded']} == {
        4: 'time is not a number', 5: 'dec_deg is beyond 90'}
    assert run.offsets()[0] / ARCSEC == pytest.approx([1, 1]) and 'ra' not in run
    bare = read(ICRS, site=SITE)
    assert any('standard atmosphere' in note for note in bare.meta['notes'])
    assert bare['el'] / DEG == pytest.approx(run['el'] / DEG, abs=1e-3)
    none = read(ICRS, site=SITE, weather=Weather(0.0, 13.0, 0.75, 0.55))
    assert (run['el'] - none['el'])[0] / ARCSEC == pytest.approx(
        58.3 * 741 / 1010 / np.tan(none['el'][0]), rel=0.05)
    own = ICRS.replace('time,', 'time,pressure_hpa,', 1).replace('Z,', 'Z,{},').replace(
        ',,1', ',,,1')
    assert np.all(read(own.format(780, 741, 741), site=SITE)['el'] > run['el'])


def test_places_from_icrs_with_azimuth_from_south(read):
    north = read(ICRS, site=SITE)
    text = ICRS.replace('x_arcsec,y_arcsec', 'az_enc_deg,el_enc_deg')
    for row, (az, el) in enumerate(zip(north['az'] / DEG, north['el'] / DEG), 1):
        lines = text.split('\n')
        lines[row] = lines[row].replace(',1,2', f',{180 - az},{el}')
        text = '\n'.join(lines)
    south = read(text, site=SITE, azimuth_origin='S')
    assert np.abs(south.offsets()[0]).max() < 1e-9


@pytest.mark.parametrize('text, options, words', [
    (ICRS, {}, ['need the site']),
    (ICRS.replace('time', 'when'), {'site': SITE}, ['no column time']),
    (ICRS.replace('2021-08-21T09:00:00Z', '32400').replace('2021-08-21T04:36:01.5Z', '1'),
     {'site': SITE}, ['time in UTC']),
    (ICRS, {'site': SITE, 'weather': {'pressure_hpa': 29.9}}, ['pressure 29.9 is no pressure']),
])
def test_icrs_refused(read, text, options, words, refuse):
    refuse(text, *words, **options)


def test_a_site_given_in_place_of_another_is_said(read):
    declared = '# latitude_deg: 31.69\n# longitude_deg: 249.12\n# height_m: 2608\n' + ICRS
    assert not any('declares' in note for note in read(declared, site=SITE).meta['notes'])
    for name, value, size in ('longitude', 110.88, DEG), ('height', 100.0, 1.0):
        notes = read(declared, site={name: value * size}).meta['notes']
        assert any(f'{name} {value:g} ' in note and 'declares' in note for note in notes)
    # places of the horizon are refracted already
    places = 'az_deg,el_deg,az_enc_deg,el_enc_deg\n10,40,10,40\n'
    assert any('change nothing' in note
               for note in read(places, weather={'pressure_hpa': 700.0}).meta['notes'])


@pytest.mark.parametrize('column, value', [
    ('pressure_hpa', 0), ('pressure_hpa', -999), ('pressure_hpa', 22.2), ('pressure_hpa', 75.2),
    ('pressure_hpa', 564.0), ('temperature_c', 283.15), ('temperature_c', -999)])
def test_air_that_cannot_be_is_not_measured(read, column, value):
    text = ICRS.replace('time,', f'time,{column},', 1).replace('Z,', f'Z,{value},').replace(
        ',,1', ',,,1')
    run, bare = read(text, site=SITE), read(ICRS, site=SITE)
    assert run['el'] == pytest.approx(bare['el'], abs=1e-12)
    assert any(f'{value:g}' in note and 'treated as missing' in note
               for note in run.meta['notes'])
    if value < 1:
        return
    # where the height is not known the air may be that of any telescope
    run = read(text, site={'latitude': SITE.latitude, 'longitude': SITE.longitude})
    assert any('missing' in note for note in run.meta['notes']) == (value != 564.0)


def test_one_number_of_the_air_leaves_the_others_as_they_are(read):
    head = '# pressure_hpa: 741\n# temperature_c: 2\n'
    whole = read(head + ICRS, site=SITE)
    for given, same in (({'temperature_c': 2.0}, True), ({'pressure_hpa': 741.0}, True),
                        ({'temperature_c': 12.0}, False)):
        run = read(head + ICRS, site=SITE, weather=given)
        assert np.allclose(run['el'], whole['el'], rtol=0.0, atol=1e-12) == same
    high = read(ICRS, site=SITE, weather={'temperature_c': 10.0})
    assert high['el'] == pytest.approx(read(ICRS, site=SITE)['el'], abs=1e-12)
    notes = read(ICRS, site=SITE, weather={'pressure_hpa': 1013.0}).meta['notes']
    assert any('737 hPa is usual at a height of 2608 m' in note for note in notes)


def test_places_and_readings_are_kept_as_they_were_written(read):
    run = read('az_deg,el_deg,az_enc_deg,el_enc_deg\n10,40,10.1,40.1\n20,140,20.1,140.1\n'
               '30,50,30.1,50.1\n40,60,40.1,nan\n')
    written = run.meta['as_written']
    assert {name: np.asarray(v).tolist() for name, v in written.items()} == {
        'line': [2, 3, 4], 'misplaced': [False, True, False], 'misplaced_rows': 1,
        'az': [10 * DEG, 20 * DEG, 30 * DEG], 'el': [40 * DEG, 140 * DEG, 50 * DEG],
        'az_enc': [10.1 * DEG, 20.1 * DEG, 30.1 * DEG],
        'el_enc': [40.1 * DEG, 140.1 * DEG, 50.1 * DEG]}
    german = read('# mount: german\n# latitude_deg: 48\n'
                  'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg,pier_side\n300,40,300.1,40.1,west\n'
                  '30,50,30.1,50.1,east\n')
    assert german['el_enc'][0] == pytest.approx(139.9 * DEG)
    written = german.meta['as_written']
    assert written['beyond'].tolist() == [True, False]
    assert written['az_enc'].tolist() == [300.1 * DEG, 30.1 * DEG]
    assert written['el_enc'].tolist() == [40.1 * DEG, 50.1 * DEG]


def test_a_file_without_a_usable_row_has_its_places(tmp_path):
    path = tmp_path / 'run.csv'
    path.write_text('az_deg,el_deg,az_enc_deg,el_enc_deg\n' + ''.join(
        f'{3600 * a},{3600 * e},{3600 * a},{3600 * e}\n' for a, e in ((100, 40), (200, 50))))
    with pytest.raises(NoUsableRow, match='none of 2 rows') as refused:
        read_run(path)
    assert len(refused.value.run) == 0
    assert refused.value.run.meta['as_written']['misplaced'].all()


def test_small_offsets_are_not_taken_for_radians(read):
    text = 'az_deg,el_deg,az_enc_deg,el_enc_deg\n' + ''.join(
        f'{37 * i % 360},{20 + 7 * i % 60},{0.3 + 0.001 * i},{-0.02 + 0.002 * i}\n'
        for i in range(20))
    assert len(read(text)) == 20
