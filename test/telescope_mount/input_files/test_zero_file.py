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

from msg_tools.units import ARCSEC
from telescope_mount.input_files.zero_file import read_zeros, zero_file_causes

HEADER = 'time,zero_az_arcsec,zero_el_arcsec,temperature_c,supply_v\n'


def written(path, n=12, slope=3.0, warmth=None, more='', seed=1):
    rng = np.random.default_rng(seed)
    warmth = rng.uniform(-4.0, 16.0, n) if warmth is None else np.full(n, warmth)
    zeros = slope * warmth[:, None] + 2.0 * rng.normal(size=(n, 2))
    path.write_text(HEADER + ''.join(
        f'2026-01-{k + 1:02d}T18:00:00,{az:.3f},{el:.3f},{celsius:.2f},{5.0:.3f}\n'
        for k, ((az, el), celsius) in enumerate(zip(zeros, warmth))) + more)
    return path


def test_zeros_that_follow_the_temperature(tmp_path, ended):
    file = written(tmp_path / 'zeros.csv', more='2026-02-01T18:00:00,,,10.0,5.0\n')
    code, out, err = ended('zeros', file, '--json', tmp_path / 'out.json')
    assert (code, err) == (0, '')
    assert 'the zero changes with the temperature' in out and 'tonight, predicted' in out
    assert 'not tried: supply voltage: constant' in out and (tmp_path / 'out.json').is_file()
    judged = zero_file_causes(file)
    for axis in ('azimuth', 'elevation'):
        cause, = judged['causes']['axes'][axis]['causes']
        assert cause['driver'] == 'temperature'
        assert cause['slope_arcsec'] == pytest.approx(3.0, abs=4 * cause['sigma_arcsec'])
        tonight = judged['tonight'][axis]
        assert tonight['expected_arcsec'] == pytest.approx(30.0, abs=4 * tonight['sigma_arcsec'])


def test_zeros_that_follow_nothing(tmp_path):
    judged = zero_file_causes(written(tmp_path / 'zeros.csv', slope=0.0))
    assert judged['causes']['verdict'] == 'nothing' and judged['tonight'] is None


def test_columns_of_each_axis_and_the_order_of_time(tmp_path):
    file = tmp_path / 'zeros.csv'
    file.write_text('run,time,zero_az_arcsec,zero_el_arcsec,temperature_az_c,temperature_el_c,'
                    'side\n8,2000,2,20,5,6,above\n7,1000,1,10,3,4,below\n9,3000,,10,3,4,1\n')
    season, tonight, notes = read_zeros(file)
    assert notes == [f'{file}, line 4 left out: one of zero_az_arcsec and zero_el_arcsec is empty; '
                     'a power-on needs both']
    assert season.run.tolist() == [7, 8] and tonight is None
    np.testing.assert_allclose(season.zeros / ARCSEC, [[1, 10], [2, 20]])
    np.testing.assert_allclose(season.covariates['temperature'], [[3, 4], [5, 6]])
    np.testing.assert_allclose(season.covariates['side'], [[1, 1], [-1, -1]])
    assert np.isnan(season.covariates['supply']).all()


@pytest.mark.parametrize('text, words', [
    ('time,zero_az_arcsec,zero_el_arcsec\n1,2,3\n', 'give temperature_c'),
    ('temperature_c,zero_az_arcsec\n1,2\n', 'no column zero_el_arcsec'),
    (HEADER + '1,2,3,warm,5\n', "row 2, column temperature_c: 'warm' is not a number"),
    (HEADER + 'noon,2,3,4,5\n', "row 2, column time: 'noon' is neither ISO 8601"),
    (HEADER + '1,2,3,4\n', 'row 2: 4 cells, but the header has 5'),
    (HEADER + '1,1,5,2,5,3,5\n', 'are there decimal commas?'),
    (HEADER.replace('supply_v', 'temperature_c'), "column 'temperature_c' is there twice"),
    (HEADER + '1,2,3,4,5\n2,3,4,5,6\n', '2 power-ons with a zero: too few to name a cause'),
    (HEADER.replace('supply_v', 'supplyv') + '1,2,3,4,5\n2,,4,5,6\n',
     'line 3 left out: one of zero_az_arcsec'),
    ('time,zero_az_arcsec,zero_el_arcsec,Temprature_C\n1,2,3,4\n', 'did you mean temperature_c?'),
    (HEADER, 'has a header and no row: write a row'), ('', 'is empty: give a header row'),
    ('\n\n', 'is empty: give'),
    ('\0\1', 'is a binary file'), (None, 'zeros.csv')])
def test_what_cannot_be_judged_is_one_line(tmp_path, refused, text, words):
    file = tmp_path / 'zeros.csv'
    if text is not None:
        file.write_text(text)
    assert words in refused('zeros', file)


def test_a_temperature_that_did_not_change(tmp_path, refused):
    line = refused('zeros', written(tmp_path / 'zeros.csv', warmth=8.0))
    assert 'no cause can be looked for: temperature: constant' in line


def test_a_verdict_that_could_not_be_written_is_refused_before_the_work(tmp_path, ended):
    file = written(tmp_path / 'zeros.csv')
    code, out, err = ended('zeros', file, '--json', tmp_path / 'no' / 'out.json')
    assert (code, out) == (2, '') and 'there is no such folder' in err


def test_what_is_not_used_of_a_file_is_said(tmp_path, ended):
    file = written(tmp_path / 'zeros.csv', more='2026-02-01T18:00:00,,,9,5\n'
                   '2026-02-02T18:00:00,1,,9,5\n2026-02-03T18:00:00,,2,9,5\n'
                   '2026-02-04T18:00:00,,,10.0,5.0\n')
    file.write_text(file.read_text().replace('supply_v', 'suply_v'))
    code, out, err = ended('zeros', file, '--verbose')
    out = ' '.join(out.split())
    assert (code, err) == (0, '') and 'tonight, predicted' in out
    assert 'lines 15-16 left out: one of' in out and 'line 14 left out: no zero' in out
    assert 'column suply_v is not used: did you mean supply_v?' in out


def rows_of_nights(n=12, seed=5):
    rng = np.random.default_rng(seed)
    return [[f'2026-01-{i + 1:02d}T18:00:00Z', f'{3 * i + rng.normal():.3f}',
             f'{2 * i + rng.normal():.3f}', f'{i:.1f}', '5.0', '1.5', '1.5'] for i in range(n)]


WITH_SIGMA = HEADER.strip() + ',sigma_az_arcsec,sigma_el_arcsec'


@pytest.mark.parametrize('spoil, reason', [
    (lambda r: [*r[:1], '3', '4', *r[2:]], '8 cells, but the header has 7'),
    (lambda r: [*r, 'x'], '8 cells, but the header has 7'),
    (lambda r: [*r[:5], '0', '1.5'], 'sigma_az_arcsec is not positive'),
    (lambda r: [*r[:6], '-1'], 'sigma_el_arcsec is not positive'),
    (lambda r: [*r[:3], 'inf', *r[4:]], 'temperature_c is infinite'),
    (lambda r: [*r[:4], '1e308', *r[5:]], 'supply_v is beyond 1e+50'),
    (lambda r: [r[0], '1.2.3', *r[2:]], "zero_az_arcsec '1.2.3' is not a number"),
    (lambda r: ['2026-01-01T18:00:00Z', *rows_of_nights()[0][1:4], '7', *r[5:]],
     'the same as line 2')])
def test_a_bad_row_of_zeros_is_left_out_by_name(tmp_path, spoil, reason):
    rows, file = rows_of_nights(), tmp_path / 'zeros.csv'
    file.write_text('\n'.join([WITH_SIGMA, *map(','.join, rows)]))
    whole = read_zeros(file)[0]
    rows[4] = spoil(rows[4])
    file.write_text('\n'.join([WITH_SIGMA, *map(','.join, rows)]))
    season, _, notes = read_zeros(file)
    assert notes == [f'{file}, line 6 left out: {reason}']
    kept = np.arange(12) != 4
    np.testing.assert_array_equal(season.zeros, whole.zeros[kept])
    np.testing.assert_array_equal(season.covariates['temperature'],
                                  whole.covariates['temperature'][kept])


def test_what_was_not_measured_hides_no_cause(tmp_path, ended):
    file, fill = tmp_path / 'zeros.csv', '2026-02-01T18:00:00,{},{},-999,5.0\n'
    written(file, more=fill.format(1, 2) + fill.format(-999, -999))
    code, out, err = ended('zeros', file, '--verbose')
    out = ' '.join(out.split())
    assert (code, err) == (0, '') and 'the zero changes with the temperature' in out
    assert 'temperature_c is -999 (the others ' in out and 'in 2 of 14 rows: not measured' in out
    assert 'caution: temperature is not known tonight: the prediction of azimuth is' in out
    written(file, more='2026-02-01T18:00:00,,,283,5\n')
    assert 'temperature (azimuth) of 283 is far outside what was measured' in ' '.join(
        ended('zeros', file)[1].split())
    written(file, slope=0.0)
    rows = [line.split(',') for line in file.read_text().splitlines()[1:]]
    file.write_text(HEADER + ''.join(
        f'{row[0]},{float(row[1]) / 3600},{float(row[2]) / 3600},{row[3]},5\n' for row in rows))
    assert 'arcsec: are they degrees?' in read_zeros(file)[2][0]


def test_zeros_with_decimal_commas_are_the_same(tmp_path):
    plain, other = tmp_path / 'plain.csv', tmp_path / 'other.csv'
    plain.write_text('\n'.join([WITH_SIGMA, *map(','.join, rows_of_nights())]))
    other.write_bytes(plain.read_text().replace(',', ';').replace('.', ',').encode('utf-16'))
    a, b = read_zeros(plain)[0], read_zeros(other)[0]
    np.testing.assert_array_equal(a.zeros, b.zeros)
    np.testing.assert_array_equal(a.time, b.time)
    assert np.isfinite(a.time).all() and len(a) == 12


def test_zeros_on_either_side_of_a_turn_are_as_near_as_they_are(tmp_path):
    lines = written(tmp_path / 'zeros.csv').read_text().splitlines()
    rows = [line.split(',') for line in lines[1:]]
    around = tmp_path / 'around.csv'
    around.write_text(HEADER + ''.join(
        f'{time},{(float(az) - 20.0) % 1296000.0:.3f},{",".join(rest)}\n'
        for time, az, *rest in rows))
    (one, *_), (other, *_) = (read_zeros(tmp_path / name) for name in ('zeros.csv', 'around.csv'))
    assert np.ptp(other.zeros[:, 0] - one.zeros[:, 0]) < 1e-3 * ARCSEC
    assert np.array_equal(one.zeros[:, 1], other.zeros[:, 1])
