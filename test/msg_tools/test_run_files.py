"""Pointing runs from files: what is read, what is refused, what comes back."""

from pathlib import Path

import numpy as np
import pytest

from msg_tools.run_files import read_run, write_csv
from pointing_model.run import PointingRun
from pointing_model.units import ARCSEC, DEG, wrap

ROOT = Path(__file__).resolve().parents[2]
MMT_CSV = ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv'
SHARED = ROOT.parent / 'shared' / 'data'

HEADER = 'az_deg,el_deg,az_enc_deg,el_enc_deg'
GOOD = f'{HEADER}\n10,20,10.1,20.1\n350,40,350.2,40.2\n100,60,100.3,60.3\n'


def needs(relative):
    path = SHARED / relative
    return pytest.mark.skipif(not path.exists(), reason=f'measured data {relative} not here')


@pytest.fixture
def read(tmp_path):
    """Read a text as a run."""
    def read(text, **options):
        path = tmp_path / 'run.txt'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_run(path, **options)
    return read


def refuse(read, text, *words, **options):
    """`text` is refused in one line that names the file and holds `words`."""
    with pytest.raises(ValueError) as error:
        read(text, **options)
    message = str(error.value)
    assert '\n' not in message and 'run.txt' in message
    for word in words:
        assert word in message, message
    return message


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
    for bad in ('yesterday', '2021-13-01T00:00:00Z', '21/08/2021'):
        with pytest.raises(ValueError, match=f'row 3, column time: .*{bad[:4]}.* ISO 8601'):
            times('2021-08-21T04:36:01Z', bad)


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


def test_text_with_commas_comes_back(tmp_path):
    run = PointingRun({'az': [0.1, 3.0], 'el': [0.5, 1.0], 'az_enc': [0.1, 3.0],
                       'el_enc': [0.5, 1.0], 'star': ['alpha, "A"', 'b']})
    write_csv(run, tmp_path / 'run.csv')
    assert read_run(tmp_path / 'run.csv')['star'].tolist() == ['alpha, "A"', 'b']


def test_a_missing_column_is_named_with_the_closest(read):
    message = refuse(read, GOOD.replace('az_enc_deg', 'az_encoder_deg'), 'az_enc_deg',
                     'closest: az_encoder_deg', 'el_enc_deg')
    assert 'no column az_enc_deg (closest' in message


@pytest.mark.parametrize('text, words', [
    ('', ['empty']),
    ('\n  \n', ['empty']),
    (HEADER + '\n', ['no observations']),
    (HEADER, ['no observations']),
    (GOOD.replace('40.2', '4o.2'), ['row 3', 'el_enc_deg', '4o.2']),
    (GOOD.replace('100,60,', '100,'), ['row 4', '3 cells', '4']),
    (GOOD.replace('el_deg,', 'az_deg,', 1), ['az_deg', 'twice']),
    (b'\x7fELF\0\0\1', ['binary']),
    (bytes(range(256)) * 9, ['binary']),
    (b'\x89MCAP0\r\n' + b'x' * 50, ['MCAP']),
    ('Dear diary, it rained.\nNo stars.\n', ['not a pointing run']),
    ('1,2,3,4\n5,6,7,8\n', ['not a pointing run']),
    (HEADER + '\nnan,1,2,3\n5,95,7,8\n', ['none of 2 rows', 'row 2']),
])
def test_refused(read, text, words):
    refuse(read, text, *words)


def test_folder_and_missing_file(tmp_path):
    with pytest.raises(ValueError, match='folder'):
        read_run(tmp_path)
    with pytest.raises(OSError):
        read_run(tmp_path / 'missing.csv')


@pytest.mark.parametrize('columns', [('az', 'el', 'az_enc', 'el_enc'), ('az_enc', 'el_enc')])
def test_radians_are_noticed(read, columns):
    rows = [[10.0, 20.0, 10.1, 20.1], [350.0, 40.0, 350.2, 40.2]]
    names = ('az', 'el', 'az_enc', 'el_enc')
    scaled = [[v * DEG if n in columns else v for n, v in zip(names, row)] for row in rows]
    text = HEADER + '\n' + '\n'.join(','.join(map(str, row)) for row in scaled)
    refuse(read, text, 'radians', 'give degrees', 'az_enc_deg' if len(columns) == 2 else 'az_deg')


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
    assert excluded[8] == 'the same as row 2'
    assert 'positive' in excluded[9] and 'extra' in excluded[10]


def test_approach_from_the_order_of_the_rows(read):
    text = f'{HEADER},run\n' + '\n'.join(
        f'{az},{el},{az},{el},{run}' for az, el, run in
        [(350, 30, 1), (10, 40, 1), (340, 40, 1), (341, 20, 2), (342, 21, 2)])
    run = read(text)
    # the second star is reached over north: that is the positive sense
    assert run['approach_az'].tolist() == [0, 1, -1, 0, 1]
    assert run['approach_el'].tolist() == [0, 1, 0, 0, 1]
    assert any('derived' in note for note in run.meta['notes'])
    given = read(f'{HEADER},approach_az,approach_el\n1,30,1,30,-1,1\n9,20,9,20,-1,1\n')
    assert given['approach_az'].tolist() == [-1, -1]
    assert not given.meta['notes']


def test_columns_that_cannot_be_used_are_told(read):
    run = read(f'{HEADER},az,observer\n10,20,10,20,0.1,Anna\n30,40,30,40,0.2,Bo\n')
    assert 'observer' not in run
    notes = ' '.join(run.meta['notes'])
    assert "'observer' left out" in notes and "'az' left out" in notes
    assert run['az'][0] == pytest.approx(10 * DEG)


def test_second_encoder(read):
    text = 'az_deg,el_deg,az_abs_deg,el_abs_deg\n10,20,11,22\n30,40,31,42\n'
    refuse(read, text, "encoder 'abs'", 'az_enc_deg')
    assert read(text, encoder='abs').offsets()[1] == pytest.approx([2 * DEG] * 2)
    both = read('az_deg,el_deg,az_abs_deg,el_abs_deg,az_enc_deg,el_enc_deg\n'
                '10,20,11,22,10,20.5\n30,40,31,42,30,40.5\n', encoder='abs')
    assert both.offsets('enc')[1] == pytest.approx([2 * DEG] * 2)
    assert both.offsets('abs')[1] == pytest.approx([0.5 * DEG] * 2)
    refuse(read, GOOD, 'az_abs_deg', encoder='abs')


def test_azimuth_from_south(read):
    """South = 0, east = 90: east stays east, a positive error turns negative."""
    text = f'{HEADER},az_rate_arcsec_s\n90,20,90.1,20,5\n0,40,0.1,40,5\n'
    run = read(text, azimuth_origin='S')
    assert wrap(run['az'] - np.array([90, 180]) * DEG) == pytest.approx([0, 0], abs=1e-12)
    assert run.offsets()[0] == pytest.approx(-0.1 * DEG * np.cos(run['el']))
    assert run['az_rate'] == pytest.approx([-5 * ARCSEC] * 2)
    assert read(text)['az'][0] == pytest.approx(90 * DEG)
    with pytest.raises(ValueError, match='neither N nor S'):
        read(text, azimuth_origin='E')


# -------------------------------------------------------------------------------------- TPOINT

TPOINT = """! written by hand
Test run, 4 stars
: ALTAZ
: ROTL
-30 14 26.4 2021 8 21 13.0 741 2608.0 0.75
! 99 99 99 99 0
  10.0 20.0 10.1 20.2 -5.0 ! star one
 350.0 40.0 350.1 40.2 -6.0
END
 1 2 3 4 5
"""


def test_tpoint(read):
    run = read(TPOINT)
    assert len(run) == 2
    assert run['az'] / DEG == pytest.approx([10, 350])
    assert run.offsets()[1] / DEG == pytest.approx([0.2, 0.2])
    assert run['rotator_deg'].tolist() == [-5, -6]
    meta = run.meta
    assert meta['format'] == 'tpoint' and meta['caption'] == 'Test run, 4 stars'
    assert meta['site']['latitude'] == pytest.approx(-(30 + 14 / 60 + 26.4 / 3600) * DEG)
    assert meta['site']['height'] == 2608 and meta['date'] == '2021-08-21'
    assert meta['weather'] == {'temperature_c': 13, 'pressure_hpa': 741, 'humidity': 0.75}
    assert any('file does not say' in note for note in meta['notes'])


def test_tpoint_short_form(read):
    run = read('8m altazimuth\nA\n-30.25\n264.5 28.1 264.4 28.2\n259.6 29.8 259.6 29.9\n')
    assert run.meta['site']['latitude'] == pytest.approx(-30.25 * DEG)
    assert run.offsets()[1] / DEG == pytest.approx([0.1, 0.1])
    refuse(read, 'a 1 m\nE\n-30.25\n264.5 28.1 264.4 28.2\n', 'equatorial')


@pytest.mark.parametrize('comment, origin', [
    ('! Azimuth uses the convention: N=0, E=90 (unlike the TCC, which uses S=0, E=90)', 'N'),
    ('! transformed AZ into tpoint convention (South = 0, East=90)', 'S'),
])
def test_tpoint_azimuth_origin_from_a_comment(read, comment, origin):
    run = read(comment + '\n' + TPOINT)
    assert run.meta['azimuth_origin'] == origin
    expected = [10, 350] if origin == 'N' else [170, 190]
    assert wrap(run['az'] - np.array(expected) * DEG) == pytest.approx([0, 0], abs=1e-12)
    other = 'S' if origin == 'N' else 'N'
    forced = read(comment + '\n' + TPOINT, azimuth_origin=other)
    assert forced.meta['azimuth_origin'] == other
    assert any('the file says' in note for note in forced.meta['notes'])


@pytest.mark.parametrize('text, words', [
    (TPOINT.replace('20.2', 'x'), ['row 7', 'mount elevation', "'x'"]),
    (TPOINT.replace(' -6.0', ''), ['row 8', '4 numbers', '5 in the first']),
    (TPOINT.replace(': ALTAZ\n', ''), ['ALTAZ', 'equatorial']),
    (TPOINT.replace('-30 14', 'latitude 14'), ['row 5', 'latitude']),
    (TPOINT.replace('-30 14', '-95 14'), ['row 5', '90 degrees']),
    (TPOINT[:TPOINT.index('! 99')], ['no observations']),
    (TPOINT[:TPOINT.index('-30')], ['latitude']),
    ('cap\n: ALTAZ\n30 0 0\n21 43 6.4 72 29 8.3 0 0 2000 1 2\n', ['row 4', 'format 4']),
])
def test_tpoint_refused(read, text, words):
    refuse(read, text, *words)


def test_site_is_kept_and_compared(read):
    class Site:
        latitude = 34.3 * DEG

    site = Site()
    run = read(TPOINT, site=site)
    assert run.meta['site'] is site
    assert any('latitude -30.24' in note for note in run.meta['notes'])


# ------------------------------------------------------------------------------ measured nights

def seven_terms(run, encoder='enc'):
    """First-order least squares: terms and RMS (arcsec) of the fitted data and in 10 folds."""
    a, e = run['az'], run['el']
    x, y = (v / ARCSEC for v in run.offsets(encoder))
    s, c, o = np.sin, np.cos, np.zeros(len(run))
    design = np.concatenate([
        np.stack([c(e), o, o + 1, s(e), s(a) * s(e), c(a) * s(e), o], axis=1),
        np.stack([o, o + 1, o, o, c(a), -s(a), c(e)], axis=1)])
    data = np.concatenate([x, y])
    terms = np.linalg.lstsq(design, data, rcond=None)[0]
    held_out = np.empty((20, 2, len(run)))
    for seed in range(20):
        fold = np.tile(np.random.default_rng(seed).permutation(len(run)) % 10, 2)
        left = np.empty_like(data)
        for k in range(10):
            use = fold != k
            fit = np.linalg.lstsq(design[use], data[use], rcond=None)[0]
            left[~use] = data[~use] - design[~use] @ fit
        held_out[seed] = left.reshape(2, -1)
    fitted = (data - design @ terms).reshape(2, -1)
    return terms, np.sqrt(np.mean(fitted**2, axis=1)), np.sqrt(np.mean(held_out**2, axis=(0, 2)))


def test_mmt_csv_fits_as_its_readme_says():
    run = read_run(MMT_CSV)
    assert len(run) == 80 and run.meta['excluded'] == []
    terms, fitted, held_out = seven_terms(run)
    assert terms == pytest.approx(
        [1209.32, -4.64, -6.01, -3.43, 2.48, 10.41, -13.74], abs=0.006)
    assert fitted == pytest.approx([0.55, 1.25], abs=0.006)
    assert held_out == pytest.approx([0.58, 1.31], abs=0.01)
    assert run['star'][0] == 'FK5-0711' and run['star'][61] == 'unknown'
    assert np.all(np.diff(run['time']) > 0)
    assert (run['time'][-1] - run['time'][0]) / 3600 == pytest.approx(3.07, abs=0.01)


def test_mmt_licence_is_beside_the_data():
    text = (MMT_CSV.parent / 'LICENSE-pytelpoint.rst').read_text()
    assert 'Copyright 2021 T. E. Pickering' in text and 'binary form must reproduce' in text
    assert 'pytelpoint' in (MMT_CSV.parent / 'README.md').read_text()


def test_mmt_catalogue_columns_are_places_of_stars():
    """Only if az, el are the catalogue's do the places move as the sky does, by their times."""
    erfa = pytest.importorskip('erfa')
    run = read_run(MMT_CSV)
    jd = 2440587.5 + run['time'] / 86400.0
    sidereal = erfa.gst06a(2400000.5, jd - 2400000.5, 2400000.5, jd - 2400000.5 + 8e-4)
    latitude, longitude = (31 + 41 / 60 + 19.6 / 3600) * DEG, -110.88456 * DEG
    same_star = np.flatnonzero(run['star'] == 'FK5-0857')
    spread = {}
    for name in ('', '_enc'):
        az, el = run['az' + name][same_star], run['el' + name][same_star]
        hour = np.arctan2(-np.sin(az) * np.cos(el), np.sin(el) * np.cos(latitude)
                          - np.cos(az) * np.cos(el) * np.sin(latitude))
        spread[name] = np.ptp(wrap(sidereal[same_star] + longitude - hour)) / ARCSEC
    assert len(same_star) == 3
    assert spread[''] < 0.2 * spread['_enc']


@needs('mmt/k_and_e.dat')
def test_mmt_csv_holds_the_published_figures():
    """The published file calls the mount's angles observed and the star's raw."""
    run, published = read_run(MMT_CSV), read_run(SHARED / 'mmt/k_and_e.dat')
    assert published.meta['azimuth_origin'] == 'S'
    for mine, theirs in (('az', 'az_enc'), ('el', 'el_enc'), ('az_enc', 'az'), ('el_enc', 'el')):
        assert np.abs(wrap(run[mine] - published[theirs])).max() < 1e-6 * ARCSEC
    terms, _, held_out = seven_terms(published)
    assert terms[0] == pytest.approx(-1209.33, abs=0.01)
    assert held_out == pytest.approx([0.585, 1.311], abs=0.01)


@needs('mmt/point_20210821.dat')
def test_raw_mmt_night():
    raw, run = read_run(SHARED / 'mmt/point_20210821.dat'), read_run(MMT_CSV)
    assert raw.meta['format'] == 'mmt'
    for name in ('az', 'el', 'az_enc', 'az_abs', 'el_abs'):
        assert np.abs(raw[name] - run[name]).max() < 1e-9 * ARCSEC
    assert (raw['el_enc'] - run['el_enc']) / ARCSEC == pytest.approx(np.full(80, 5.9))
    assert raw['lst_h'][0] == pytest.approx(19 + 11 / 60 + 22.95 / 3600)


@needs('spk8m/pmfit_altaz.dat')
def test_spk8m():
    run = read_run(SHARED / 'spk8m/pmfit_altaz.dat')
    assert len(run) == 105
    assert run.meta['site']['latitude'] == pytest.approx(-30.240667 * DEG)
    _, fitted, _ = seven_terms(run)
    assert np.hypot(*fitted) == pytest.approx(8.125, abs=0.01)


@needs('arc35m')
def test_arc35m():
    runs, refused = 0, 0
    for file in sorted((SHARED / 'arc35m').glob('*.dat')):
        try:
            run = read_run(file)
        except ValueError as error:
            assert 'no observations' in str(error)
            refused += 1
            continue
        runs += 1
        assert run.meta['azimuth_origin'] == 'N' and 'rotator_deg' in run
        assert np.abs(run.offsets()[1]).max() < 0.2 * DEG
    assert (runs, refused) == (68, 1)
