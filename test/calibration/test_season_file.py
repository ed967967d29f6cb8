import numpy as np
import pytest

from calibration.season_file import judge_zeros, read_zeros
from msg_tools.units import ARCSEC

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
    assert 'the zero follows the temperature' in out and 'tonight, foretold' in out
    assert 'not tried: supply voltage: constant' in out and (tmp_path / 'out.json').is_file()
    judged = judge_zeros(file)
    for axis in ('azimuth', 'elevation'):
        cause, = judged['causes']['axes'][axis]['causes']
        assert cause['driver'] == 'temperature'
        assert cause['slope_arcsec'] == pytest.approx(3.0, abs=4 * cause['sigma_arcsec'])
        tonight = judged['tonight'][axis]
        assert tonight['expected_arcsec'] == pytest.approx(30.0, abs=4 * tonight['sigma_arcsec'])


def test_zeros_that_follow_nothing(tmp_path):
    judged = judge_zeros(written(tmp_path / 'zeros.csv', slope=0.0))
    assert judged['causes']['verdict'] == 'nothing' and judged['tonight'] is None


def test_columns_of_each_axis_and_the_order_of_time(tmp_path):
    file = tmp_path / 'zeros.csv'
    file.write_text('run,time,zero_az_arcsec,zero_el_arcsec,temperature_az_c,temperature_el_c,side\n'
                    '8,2000,2,20,5,6,above\n7,1000,1,10,3,4,below\n9,3000,,10,3,4,1\n')
    season, tonight, notes = read_zeros(file)
    assert notes == [f'{file}, line 4 left out: one of zero_az_arcsec and zero_el_arcsec is empty; '
                     'a power-on counts with both']
    assert season.run.tolist() == [7, 8] and tonight is None
    np.testing.assert_allclose(season.zeros / ARCSEC, [[1, 10], [2, 20]])
    np.testing.assert_allclose(season.drivers['temperature'], [[3, 4], [5, 6]])
    np.testing.assert_allclose(season.drivers['side'], [[1, 1], [-1, -1]])
    assert np.isnan(season.drivers['supply']).all()


@pytest.mark.parametrize('text, words', [
    ('time,zero_az_arcsec,zero_el_arcsec\n1,2,3\n', 'give temperature_c'),
    ('temperature_c,zero_az_arcsec\n1,2\n', 'no column zero_el_arcsec'),
    (HEADER + '1,2,3,warm,5\n', "line 2: temperature_c is no number: 'warm'"),
    (HEADER + 'noon,2,3,4,5\n', "line 2: time is neither seconds nor a date: 'noon'"),
    (HEADER + '1,2,3,4,5\n2,3,4,5,6\n', '2 power-ons with a zero: too few to name a cause'),
    (HEADER.replace('supply_v', 'supplyv') + '1,2,3,4,5\n2,,4,5,6\n',
     'line 3 left out: one of zero_az_arcsec'),
    ('time,zero_az_arcsec,zero_el_arcsec,Temprature_C\n1,2,3,4\n', 'did you mean temperature_c?'),
    (HEADER, 'has a header and no row: write a row'), ('', 'is empty: give a header row'),
    ('\n\n', 'is empty: give'),
    ('\0\1', 'no column zero_az_arcsec'), (None, 'zeros.csv')])
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
    code, out, err = ended('zeros', file)
    out = ' '.join(out.split())
    assert (code, err) == (0, '') and 'tonight, foretold' in out
    assert 'lines 15-16 left out: one of' in out and 'line 14 left out: no zero' in out
    assert 'column suply_v is not used: did you mean supply_v?' in out
