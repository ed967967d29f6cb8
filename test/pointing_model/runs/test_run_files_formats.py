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

"""Pointing runs of other programs: TPOINT, the MMT, the IRAM 30 m; measured nights."""

import re

import numpy as np
import pytest
from places import ROOT

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.runs.columns.run_table import NoObservations
from pointing_model.runs.run_reader import read_run

MMT_CSV = ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv'
SHARED = ROOT.parent / 'shared' / 'data'


def needs(relative):
    path = SHARED / relative
    return pytest.mark.skipif(not path.exists(), reason=f'measured data {relative} not here')


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


@pytest.mark.parametrize('latitude, degrees', [('-30 14', -30.0 - 14.0 / 60.0), ('48.9', 48.9)])
def test_a_latitude_of_tpoint_without_seconds(read, latitude, degrees):
    run = read(TPOINT.replace('-30 14 26.4 2021 8 21 13.0 741 2608.0 0.75', latitude))
    assert run.meta['site']['latitude'] / DEG == pytest.approx(degrees)


def test_rejected_observations_of_a_tpoint_file_are_no_error(read):
    text = TPOINT.replace('END', '# 20.0 30.0 20.1 30.2 -5.0 ! cloud\n# wind from here on\n# 1 2\n'
                          ' 30.0 40.0 30.1 40.1 0.0\nEND')
    run = read(text)
    assert run['az'] / DEG == pytest.approx([10, 350, 30])
    assert run.meta['excluded'][-1] == {'row': 9, 'reason': 'rejected by the observers (#)'}
    # the mount was there all the same
    assert run['approach_az'].tolist() == [0, -1, 1]
    assert run.meta['lines'].tolist() == [7, 8, 12]


def test_tpoint_short_form(read):
    run = read('8m altazimuth\nA\n-30.25\n264.5 28.1 264.4 28.2\n259.6 29.8 259.6 29.9\n')
    assert run.meta['site']['latitude'] == pytest.approx(-30.25 * DEG)
    assert run.offsets()[1] / DEG == pytest.approx([0.1, 0.1])
    run = read('a 1 m\nE\n-30.25\n64.5 28.1 64.4 28.2\n')
    assert run.mount.kind == 'equatorial' and run['az'] / DEG == pytest.approx([64.5])


def test_tpoint_says_what_it_does_not_read(read):
    text = TPOINT.replace('END', '!  20.0 30.0 20.1 30.2 -5.0  ! entry 25\n! 20 30\nEND')
    run = read('! 1 2 3 4 5\n' + text.replace('! 99', '! 98 98 98 98 0\n! 99'))
    assert run.meta['excluded'] == [{'row': n, 'reason': 'commented out'} for n in (7, 8, 11)]
    assert run.meta['lines'].tolist() == [9, 10]
    assert any('1 lines after END not read' in note for note in run.meta['notes'])
    with pytest.raises(NoObservations):
        read(TPOINT[:TPOINT.index('! 99')])


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
    assert any('the file declares' in note for note in forced.meta['notes'])


@pytest.mark.parametrize('comment, expected, said', [
    ('! azimuth S=0, W=90', [190, 170], 'south through west, as the file says'),
    ('! azimuth N=0, W=90.0', [350, 10], 'north through west, as the file says'),
    ('! counts to West = 90', [350, 10], 'north through west, as the file says'),
    ('! seeing S = 0.35 arcsec', [10, 350], 'the file does not say')])
def test_the_sense_of_azimuth_is_read_from_a_comment(read, comment, expected, said):
    run = read(comment + '\n' + TPOINT)
    assert wrap(run['az'] - np.array(expected) * DEG) == pytest.approx([0, 0], abs=1e-12)
    east = read(TPOINT)
    assert run.offsets()[0] == pytest.approx(
        east.offsets()[0] * (-1.0 if 'north through west' in said else 1.0))
    assert any(said in note for note in run.meta['notes'])


@pytest.mark.parametrize('text, words', [
    (TPOINT.replace(': ALTAZ\n', ''), ['ALTAZ', 'EQUAT']),
    (TPOINT.replace('-30 14', 'latitude 14'), ['row 5', 'latitude']),
    (TPOINT.replace('-30 14', '-95 14'), ['row 5', '90 degrees']),
    (TPOINT.replace('-30 14', '-30 64'), ['row 5', 'outside 0 to 60']),
    (TPOINT.replace('-30 14', 'nan 14'), ['row 5', 'not finite']),
    (TPOINT[:TPOINT.index('! 99')], ['no observations']),
    (TPOINT[:TPOINT.index('-30')], ['latitude']),
    ('cap\n: ALTAZ\n30 0 0\n21 43 6.4 72 29 8.3 0 0 2000 1 2\n', ['row 4', 'format 4']),
])
def test_tpoint_refused(read, text, words, refuse):
    refuse(text, *words)


@pytest.mark.parametrize('text, line, reason', [
    (TPOINT.replace('20.2', 'x'), 7, "mount elevation 'x' is not a number"),
    (TPOINT.replace(' -6.0', ''), 8, '4 numbers, but 5 in most rows')])
def test_a_bad_row_of_tpoint_is_left_out(read, text, line, reason):
    whole, run = read(TPOINT), read(text)
    assert len(run) == len(whole) - 1
    assert {'row': line, 'reason': reason} in run.meta['excluded']


def test_site_is_kept_and_compared(read):
    class Site:
        latitude = 34.3 * DEG

    site = Site()
    run = read(TPOINT, site=site)
    assert run.meta['site'] is site
    assert any('declares -30.24' in note for note in run.meta['notes'])


# ---------------------------------------------------------------------------------------- IRAM

IRAM = """# id\tobject\tproject\tUTh(f2)\tTamb(f1)\tAZd(f0) ELd(f0)\t\
pnt.dAZ(f1) pnt.dEL(f1)\tpnt.X(f1) pnt.Y(f1)\tsrc.peak(s3)
2012-04-16.8\t1253-055\ttest\t23.50\t-8.1\t161 45\t-1.8 -2.3\t2.9 -47.3\t11.0
#2012-04-16.9\t1253-055\ttest\t23.60\t-8.3\t100 50\t-14.0 7.3\t-9.0 -37.2\t9.7E-3
# Tue Apr 17 00:09:59 UTC 2012 - Some stronger wind
2012-04-17.1\tW3(OH)\t250-11\t0.25\t-8.2\t-76 46\t-0.3 1.4\t4.9 -43.3\t---
2012-04-17.2\tW3(OH)\ttest\t0.35\t-8.2\t-75 46\t--- ---\t--- ---\t---
2012-04-17.3\tMars\ttest\t12.00\t-1.5\t90 30\t0 0\t5.0 -60\t2
"""


def test_iram(read):
    run = read(IRAM)
    assert len(run) == 3 and run.meta['format'] == 'iram'
    assert {e['row']: e['reason'] for e in run.meta['excluded']} == {
        3: 'rejected by the observers (#)', 6: 'pnt.X was not measured'}
    assert run['az'] / DEG == pytest.approx([161, -76, 90])
    x, y = run.offsets()
    assert x / ARCSEC == pytest.approx([2.9, 4.9, 5.0])
    assert y / ARCSEC == pytest.approx([-47.3, -43.3, -60.0])
    assert np.diff(run['time']) == pytest.approx([0.75 * 3600, 11.75 * 3600])
    assert run['time'][0] == 1334534400 + 23.5 * 3600
    assert run['temperature'].tolist() == [-8.1, -8.2, -1.5]
    assert run['star'].tolist() == ['1253-055', 'W3(OH)', 'Mars']
    # from 100 deg, where the rejected row was; unknown after half a day
    assert run['approach_az'].tolist() == [0, -1, 0]
    assert 'src.peak' in run and 'UTh' in run
    # parts of the offset itself, and no driver
    assert not any('pnt' in name for name in run.columns)
    assert any('encoder' not in note and 'added to the place' in note for note in run.meta['notes'])


@pytest.mark.parametrize('text, words', [
    (IRAM.replace('pnt.X(f1) ', '').replace('pnt.dAZ', 'pnt.Z'), ['no column pnt.X']),
    (IRAM[:IRAM.index('2012')], ['no observations']),
])
def test_iram_refused(read, text, words, refuse):
    refuse(text, *words)


@pytest.mark.parametrize('text, line, reason', [
    (IRAM.replace('\t11.0', ''), 2, '11 values, but the header names 12 columns'),
    (IRAM.replace('23.50', 'x'), 2, "UTh 'x' is not a number"),
    (IRAM.replace('2012-04-17.3', '2012-13-17.3'), 7, "id '2012-13-17' is neither ISO 8601"),
    (IRAM.replace('2012-04-17.3', 'scan'), 7, "id 'scan' does not begin with an id such as")])
def test_a_bad_row_of_iram_is_left_out(read, text, line, reason):
    whole, run = read(IRAM), read(text)
    assert len(run) == len(whole) - 1
    (told,) = (one['reason'] for one in run.meta['excluded'] if one['row'] == line)
    assert told.startswith(reason)


def observers_model(path, run):
    """Correction by the terms in a ``.model`` file of the IRAM 30 m, arcsec."""
    terms = {name: float(value) for name, value in re.findall(
        r'^(\w+)\s*=\s*([-+.\d]+)', path.read_text(), re.MULTILINE)}
    p = [0.0, *(terms.get(f'P{i}', 0.0) for i in range(1, 12))]
    a, e, air = run['az'], run['el'], run['temperature']
    s, c = np.sin, np.cos
    x = (p[1] * c(e) + p[2] + p[3] * s(e) + (p[4] * c(a) + p[5] * s(a)) * s(e)
         - p[10] * c(e) - p[11] * s(e) + terms['TX' if 'TX' in terms else 'P6'] * air)
    y = (-p[4] * s(a) + p[5] * c(a) + p[7] + p[8] * c(e) + p[9] * s(e)
         + p[10] * s(e) - p[11] * c(e) + terms['TY'] * air)
    return x, y


@needs('iram30m')
@pytest.mark.parametrize('name, rows, rejected, left', [
    ('pointing-2012-04B', 287, 30, (2.86, 3.29)), ('pointing-2014-04', 384, 16, (2.36, 4.74))])
def test_iram_offsets_have_the_sign_of_the_observers_models(name, rows, rejected, left):
    run = read_run(SHARED / f'iram30m/{name}.log')
    assert len(run) == rows
    reasons = [e['reason'] for e in run.meta['excluded']]
    assert sum('rejected by the observers' in r for r in reasons) == rejected
    offsets = [v / ARCSEC for v in run.offsets()]
    model = observers_model(SHARED / f'iram30m/{name}.model', run)
    assert [np.std(v - m) for v, m in zip(offsets, model)] == pytest.approx(left, abs=0.02)
    assert all(np.std(v + m) > 15.0 for v, m in zip(offsets, model))


@needs('iram30m')
def test_iram_azimuth_and_time():
    """Sidereal time and place give the right ascension in the log, so A is N to E and t is UTC."""
    erfa = pytest.importorskip('erfa')
    run = read_run(SHARED / 'iram30m/pointing-2014-04.log')
    jd = 2440587.5 + run['time'] / 86400.0 - 2400000.5
    sidereal = erfa.gmst06(2400000.5, jd, 2400000.5, jd + 8e-4) - 3.3928 * DEG
    a, e, latitude = run['az'], run['el'], 37.0661 * DEG
    hour = np.arctan2(-np.sin(a) * np.cos(e), np.sin(e) * np.cos(latitude)
                      - np.cos(a) * np.cos(e) * np.sin(latitude))
    off = wrap(sidereal - hour - run['RAh'] * 15.0 * DEG)[e < 70 * DEG] / DEG
    # RAh is rounded to 1.5 deg, places to 1 deg; a day wrong is 0.99 deg, precession 0.18
    assert off.mean() == pytest.approx(0.18, abs=0.15) and off.std() < 1.5


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
    assert raw.meta['time_is_utc'] is False
    assert np.diff(raw['time']) == pytest.approx(np.diff(run['time']), abs=0.01)
    assert any('in time, as the azimuth reads' in note for note in raw.meta['notes'])
    swapped = read_run(SHARED / 'mmt/point_20210821.dat', encoder='abs')
    assert np.array_equal(swapped['az_enc'], raw['az_abs'])


@needs('spk8m/pmfit_altaz.dat')
def test_spk8m():
    run = read_run(SHARED / 'spk8m/pmfit_altaz.dat')
    assert len(run) == 105
    assert run.meta['site']['latitude'] == pytest.approx(-30.240667 * DEG)
    _, fitted, _ = seven_terms(run)
    assert np.hypot(*fitted) == pytest.approx(8.125, abs=0.01)


@needs('arc35m')
def test_arc35m():
    runs, refused, rows, commented = 0, 0, 0, 0
    for file in sorted((SHARED / 'arc35m').glob('*.dat')):
        try:
            run = read_run(file)
        except NoObservations:
            refused += 1
            continue
        runs += 1
        assert run.meta['azimuth_origin'] == 'N' and 'rotator_deg' in run
        assert np.abs(run.offsets()[1]).max() < 0.2 * DEG
        assert run.meta['date'] == file.name[7:17]
        commented += len(run.meta['excluded'])
        rows += len(run)
    assert (runs, refused, rows, commented) == (68, 1, 4399, 183)
