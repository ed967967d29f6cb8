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

"""Runs of mounts that are no alt-azimuth ones, from files."""


import numpy as np
import pytest
from places import DATA

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.context import Context
from pointing_model.effects import dictionary
from pointing_model.mounts import Mount, is_beyond, through_pole
from pointing_model.pointing_terms import stacked_design
from pointing_model.runs.columns import equinox
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.places import icrs_to_observed, moment_of, observed_to_icrs, sidereal_time
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site

SITE = Site(31.0455305556 * DEG, -115.4669 * DEG, 2790.0)
GERMAN = Mount.equatorial(SITE.latitude, 'german')


def measured(*parts):
    path = DATA.joinpath(*parts)
    if not path.is_file():
        pytest.skip(f'no measured run {path.name} beside the project')
    return path


@pytest.fixture
def read(tmp_path):
    def work(text, **options):
        path = tmp_path / 'run.csv'
        path.write_text(text)
        return read_run(path, **options)
    return work


HEAD = '# mount: german\n# latitude_deg: 31\n'


def german_run(n=40, seed=1):
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0.0, 6.0, n), rng.uniform(0.4, 1.4, n)
    first, second = GERMAN.axes_of(az, el, np.arange(n) % 3 == 0)
    terms = dict(zip(GERMAN.names.physical, np.array([200, -100, 60, 40, 30, -80, 20]) * ARCSEC))
    reading = geometry.sky_to_encoder(first, second, terms, GERMAN)
    return PointingRun({'az': first, 'el': second, 'az_enc': reading[0], 'el_enc': reading[1],
                        'time': 1.7e9 + 60.0 * np.arange(n), 'miss_x': rng.normal(size=n) * ARCSEC,
                        'miss_y': rng.normal(size=n) * ARCSEC}, {'mount': GERMAN})


def same_place(run, other):
    for az, el in (('az', 'el'), ('az_enc', 'el_enc')):
        away = np.hypot(wrap(run[az] - other[az]) * np.cos(other[el]),
                        wrap(run[el] - other[el])) / ARCSEC
        assert away.max() < 1e-6


def test_written_and_read_again(tmp_path):
    run = german_run()
    write_csv(run, tmp_path / 'run.csv')
    text = (tmp_path / 'run.csv').read_text()
    assert text.startswith('# mount: german\n# latitude_deg: 31.0455')
    assert 'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg' in text
    back = read_run(tmp_path / 'run.csv')
    assert back.mount == GERMAN
    same_place(back, run)
    np.testing.assert_allclose(back['miss_x'], run['miss_x'], atol=1e-15)
    np.testing.assert_allclose(back.offsets(), run.offsets(), atol=1e-12)


def test_catalogue_on_the_sky_and_readings_beyond_the_pole(read):
    run = read(HEAD + 'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n'
               '-30,20,150.1,160.2\n-14,-20,166.1,200.2\n30,20,30.1,10.2\n')
    assert is_beyond(run['el']).tolist() == [True, True, False]
    x, y = run.offsets()
    # through the pole both offsets are those of the axes
    np.testing.assert_allclose(np.array(y) / DEG, [0.2, 0.2, -9.8], atol=1e-9)
    np.testing.assert_allclose(np.array(x) / DEG, np.array([-0.1, -0.1, 0.1]) * np.cos(20 * DEG),
                               atol=1e-9)
    assert any('2 of 3 rows are through the pole' in note for note in run.meta['notes'])
    # the second axis came back from 200 to 10 degrees through the pole, all the way
    assert run['approach_el'].tolist() == [0, 1, -1]
    way = Context.from_run(run).get('travel_el')
    np.testing.assert_allclose(way[1:] / DEG, [40.0, 190.0], atol=1e-9)


@pytest.mark.parametrize('side', [('west', 'east'), ('-1', '1'), ('1', '0')])
def test_side_of_the_pier_by_a_column(read, side):
    folded = HEAD + 'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg,pier_side\n' \
        f'-30,20,-29.9,19.8,{side[0]}\n30,20,30.1,20.2,{side[1]}\n'
    run = read(folded)
    same_place(run, read(HEAD + 'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n'
                         '-30,20,150.1,160.2\n30,20,30.1,20.2\n'))


def test_catalogue_by_azimuth_or_by_the_stars(read):
    run = german_run(12)
    place = GERMAN.horizon_of(run['az'], run['el'])
    rows = [','.join(repr(float(v / DEG)) for v in row)
            for row in zip(*place, run['az_enc'], run['el_enc'])]
    by_azimuth = read('# mount: german\n# latitude_deg: 31.0455305556\n'
                      'az_deg,el_deg,ha_enc_deg,dec_enc_deg\n' + '\n'.join(rows))
    same_place(by_azimuth, run)
    dec, time = np.array([0.3, 0.8]), np.array([1.7e9, 1.7e9 + 600.0])
    ra = np.mod(sidereal_time(time, SITE) - [0.5, -0.7], 2 * np.pi)
    air = Weather(720.0, 8.0)
    at = GERMAN.axes_of(*icrs_to_observed(ra, dec, time, SITE, air))
    text = 'ra_deg,dec_deg,time,ha_enc_deg,dec_enc_deg\n' + '\n'.join(
        ','.join(repr(float(v)) for v in row)
        for row in zip(ra / DEG, dec / DEG, time, at[0] / DEG, at[1] / DEG))
    run = read('# mount: equatorial\n' + text, site=SITE, weather=air)
    assert np.hypot(*run.offsets()).max() / ARCSEC < 1e-5


@pytest.mark.parametrize('text, words', [
    ('# mount: german\nha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n1,20,1,20\n', 'latitude'),
    ('# mount: dobson\n# latitude_deg: 31\nha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n1,2,1,2\n',
     'dobson'),
    (HEAD + 'az_deg,el_deg,az_enc_deg,el_enc_deg\n10,20,10,20\n', 'ha_enc_deg'),
    ('# latitude_deg: 31\naxis1_deg,axis2_deg,axis1_enc_deg,axis2_enc_deg\n10,20,10,20\n',
     'free:AZ,EL'),
    (HEAD + 'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg,pier_side\n10,20,10,20,up\n', 'pier_side'),
    ('# latitude_deg: north\nha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n1,2,1,2\n', 'latitude_deg'),
    (HEAD + 'ha_deg,dec_deg,ha_enc_deg\n10,20,10\n', 'dec_enc_deg'),
])
def test_refused_in_one_line(read, text, words):
    with pytest.raises(ValueError, match=words) as caught:
        read(text)
    assert '\n' not in str(caught.value)


def test_an_alt_alt_mount(read, tmp_path):
    mount = Mount.free(0.0, 0.0)
    run = read('# mount: free:0,0\naxis1_deg,axis2_deg,axis1_enc_deg,axis2_enc_deg\n'
               '10,-5,10.1,-5.2\n-20,15,-20.1,15.1\n')
    assert run.mount == mount
    np.testing.assert_allclose(run.offsets()[1] / DEG, [-0.2, 0.1], atol=1e-9)
    turned = Mount.free(0.7, 0.1, 0.2)
    write_csv(PointingRun(run.columns, {'mount': turned}), tmp_path / 'free.csv')
    np.testing.assert_allclose(read_run(tmp_path / 'free.csv').mount.frame, turned.frame,
                               atol=1e-12)


def test_sidereal_clock_tells_the_moment():
    time = 1.7e9 + np.array([0.0, 1000.0, 40000.0])
    lst = sidereal_time(time, SITE)
    assert np.abs(moment_of(lst, time + 7.0, SITE) - time).max() < 1e-4
    assert np.abs(wrap(np.diff(lst)[:1] - 1000.0 * 2 * np.pi / 86164.0905)).max() < 1e-7


EXPORT = """!TheSky
mount
:NODA
:EQUAT
+39 00 26 2026 4 21 20.55 761.74 228.00 0.60 0.5500 0.0065
14 36 55.4451 +72 03 24.120 02 50 45.3800 +105 57 19.273  10 22.219
05 38 55.5074 +79 14 20.514 05 40 49.7057 +77 16 22.670  10 24.698
13 09 54.1067 -02 29 58.054 01 20 42.9578 -179 35 24.588  11 30.611
08 40 12.7451 +01 36 46.380 08 48 18.3774 -00 21 46.814  10 58.004
"""


def test_export_of_thesky(read):
    run = read(EXPORT)
    assert run.mount.two_sided
    assert run.mount.latitude / DEG == pytest.approx(39.0 + 26.0 / 3600.0)
    assert is_beyond(run['el']).tolist() == [True, False, True, False]
    # the mount is two degrees off in declination, on both sides of the pole the same way
    assert np.all(np.abs(run.offsets()[1] / DEG + 2.0) < 0.3)
    notes = ' '.join(run.meta['notes'])
    # 761.74 mm of mercury: at 228 m that is no pressure in hPa
    assert 'no equinox in the file' in notes and 'refraction for 986.2 hPa' in notes
    assert 'pressure 761.74 of the file is no pressure in hPa' in notes
    for spoiled, reason in ((('36 55.4451', '66 55.4451'), 'has minutes or seconds beyond 60'),
                            (('10 22.219', ''), '12 numbers, but 14 in most rows')):
        left = read(EXPORT.replace(*spoiled)).meta['excluded']
        assert len(left) == 1 and left[0]['reason'].endswith(reason)
    with pytest.raises(ValueError, match='date'):
        read(EXPORT.replace('26 2026 4 21 20.55 761.74 228.00 0.60 0.5500 0.0065', '26'))


def test_short_form_whose_fields_touch(read):
    run = read('5m\nE\n+33.356111\n  6.330566 +30.152204  6.340084 +30.170576\n'
               '-29.393268 -35.193621-29.385345 -35.172365\n')
    assert run.mount == Mount.equatorial(33.356111 * DEG)
    np.testing.assert_allclose(run['el_enc'] / DEG, [30.170576, -35.172365], atol=1e-9)
    with pytest.raises(ValueError, match='row 4: 2 numbers, but four are read'):
        read('5m\nE\n+33.356111\n  6.330566 +30.152204\n')


def test_how_the_time_of_a_sidereal_clock_was_made(read):
    def note(run):
        return next(text for text in run.meta['notes'] if text.startswith('time: from'))
    without, given = read(EXPORT), read(EXPORT, site={'longitude': -117.0 * DEG})
    whole = read(EXPORT, site=Site(39.0 * DEG, -117.0 * DEG, 10.0))
    assert 'at longitude 0 (set --longitude)' in note(without)
    assert without.meta['time_is_utc'] is False
    for run in (given, whole):
        assert note(run).endswith('at longitude -117 deg') and run.meta.get('time_is_utc', True)
    # 117 degrees west it is 7.8 h later when the same stars are due south, or a day before that
    hours = (given['time'] - without['time']) / 3600.0 - 117.0 / 15.0 / 1.0027379
    assert np.abs(np.remainder(hours + 1.0, 23.9344696) - 1.0).max() < 1e-3


def test_an_equinox_that_is_given_goes_before_what_fits(read):
    date, j2000 = (read(EXPORT, equinox=name) for name in ('date', 'j2000'))
    apart = np.hypot(wrap(date['az'] - j2000['az']) * np.cos(date['el']),
                     wrap(date['el'] - j2000['el'])) / ARCSEC
    assert 300.0 < apart.max() < 1400.0  # 26 years of precession
    assert np.array_equal(j2000['az'], read(EXPORT)['az'])  # four rows tell nothing: the default
    for run, words in ((date, 'as of date'), (j2000, 'as ICRS')):
        notes = ' '.join(run.meta['notes'])
        assert f'read {words}, as requested' in notes and 'does not say' not in notes
        assert 'equinox_taken' not in run.meta
    with pytest.raises(ValueError, match='this file has none; leave it out'):
        read('# mount: german\n# latitude_deg: 31\nha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n'
             '30,20,30.1,20.2\n', equinox='date')
    with pytest.raises(ValueError, match="'b1950' is none of j2000, date"):
        read(EXPORT, equinox='b1950')


def test_an_equinox_that_the_file_tells_otherwise(read):
    run = read('# frame: J2000\n# mount: german\n# latitude_deg: 31\n# longitude_deg: -115\n'
               'time,ra_deg,dec_deg,ha_enc_deg,dec_enc_deg\n'
               '2026-04-21T04:00:00Z,150,20,30.1,20.2\n', equinox='date')
    assert run.meta['solved'].frame.text == 'of date'
    assert any('places read as of date, although the file declares ICRS' in note
               for note in run.meta['notes'])


def test_an_equinox_that_the_rows_contradict_by_far_is_refused(read):
    rng, n, site = np.random.default_rng(6), 30, Site(39.0 * DEG, 0.0, 0.0)
    time = 1776729600.0 + np.sort(rng.uniform(0.0, 3.0, n)) * 3600.0
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.4, 0.9, n))
    lst = np.array([sidereal_time(t, site) for t in time])
    h, d = Mount.equatorial(site.latitude).axes_of(az, el)

    def sexagesimal(angle, unit=1.0, parts=3):
        sign, left, out = '-' if angle < 0.0 else '+', abs(angle) / DEG / unit, []
        for _ in range(parts - 1):
            out.append(f'{int(left)}')
            left = 60.0 * (left % 1.0)
        return sign * (unit == 1.0) + ' '.join([*out, f'{left:.4f}'])
    ra, dec = observed_to_icrs(az, el, time, site, Weather(1013.0, 10.0))
    noise = ARCSEC * rng.normal(size=n)

    def text(size):
        return '\n'.join(['mount', ': NODA', ': EQUAT', '+39 00 00 2026 4 21 10 1013 0 0.6', *(
            ' '.join([sexagesimal(a, 15.0), sexagesimal(b), sexagesimal(c, 15.0), sexagesimal(e),
                      sexagesimal(t, 15.0, 2)]) for a, b, c, e, t in zip(
                ra, dec, np.mod(lst - h + 0.001, 2.0 * np.pi), d + size * noise, lst)), ''])
    given = read(text(1.0), equinox='j2000')
    assert len(given) == n and not any('contradicts' in note for note in given.meta['notes'])
    with pytest.raises(ValueError, match=r'--equinox date contradicts the rows: .* arcsec if of '
                       r'date, \d\.\d if J2000 .* Give --equinox j2000, or leave it out'):
        read(text(1.0), equinox='date')
    noisy = read(text(80.0), equinox='date').meta['notes'][0]  # less sure: a note
    assert noisy.startswith('--equinox date contradicts the rows: ')


def sky_run(rng, mount, drift, n=60, hours=1.5):
    """Places of one precession and another, what was read with the first, and the moments."""
    az = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))  # once round the sky
    el = np.arcsin(rng.uniform(0.35, 0.99, n))
    time = 3600.0 * hours * np.linspace(0.0, 1.0, n)
    h, _ = mount.axes_of(az, el)
    first, second = mount.axes_of(az, el, h < 0.0)
    # a pole 9' from where it is, that goes round with the sky
    turn = 2.0 * np.pi * time / 86164.0
    polar = {'ME': 530.0 * ARCSEC * np.cos(turn), 'MA': 530.0 * ARCSEC * np.sin(turn)}
    columns = stacked_design(tuple(polar), first, second, mount)
    moved = sum(v * column.reshape(2, n) for v, column in zip(polar.values(), columns))
    other = mount.horizon_of(first + moved[0] / np.cos(second), second + moved[1])
    zero = drift * ARCSEC * time / 3600.0
    reading = np.array([first + 0.001 + zero, second + zero]) + 5.0 * ARCSEC * rng.normal(
        size=(2, n))
    return (az, el), other, reading, time


@pytest.mark.parametrize('swapped', [False, True])
def test_the_equinox_is_decided_with_wandering_zeros_in_the_model(swapped):
    right, wrong, reading, time = sky_run(np.random.default_rng(5), GERMAN, 200.0, n=30,
                                         hours=1.0)
    names = ('of date', 'J2000') if swapped else ('J2000', 'of date')
    ways = dict(zip(names, (right, wrong)))
    found = equinox.comparison({name: ways[name] for name in ('J2000', 'of date')}, reading, time,
                           GERMAN)
    assert found['told'] and found['taken'] == names[0] and found['other'] == names[1]
    # to the terms alone the drift looks like the other precession
    assert found['left_arcsec'][names[1]] < 0.8 * found['left_arcsec'][names[0]]
    polar = found['polar_axis_arcsec']
    assert abs(polar[names[1]]['ME'] - polar[names[0]]['ME']) > 300.0
    said = equinox.sentence(found)
    assert f'taken as {names[0]}. ' in said and 'guess' not in said


def test_rows_that_cannot_tell_the_equinox_say_so():
    right, wrong, reading, time = sky_run(np.random.default_rng(4), GERMAN, 200.0, n=12, hours=0.3)
    found = equinox.comparison({'J2000': wrong, 'of date': right}, reading, time, GERMAN)
    assert not found['told'] and found['taken'] == 'J2000' and found['log_likelihood'] < 10.0
    said = equinox.sentence(found)
    assert 'taken as J2000, a guess; the data do not decide: ' in said
    assert 'Of date would change ME by' in said and '--equinox j2000 or date' in said
    few = equinox.comparison({'J2000': tuple(v[:5] for v in right), 'of date': tuple(
        v[:5] for v in wrong)}, reading[:, :5], time[:5], GERMAN)
    assert not few['told'] and 'too few' in equinox.sentence(few)


def test_equinox_of_a_measured_run_is_not_told():
    run = read_run(measured('warp_astron', 'warp-astron.dat'))
    found = run.meta['equinox_taken']
    assert not found['told'] and found['taken'] == 'J2000' and len(run) == 98
    polar = found['polar_axis_arcsec']
    assert polar['J2000']['ME'] - polar['of date']['ME'] == pytest.approx(486.0, abs=30.0)
    assert int(is_beyond(run['el']).sum()) == 37


def test_log_of_the_unam(read):
    run = read_run(measured('coatli', '20211103b.txt'), site=SITE, weather=Weather(720.0, 8.0))
    assert len(run) == 260 and run.mount == GERMAN
    assert [row['row'] for row in run.meta['excluded'] if row['reason'] == 'commented out'] == [
        27, 54, 95, 145, 154, 238]
    assert int(is_beyond(run['el']).sum()) == 139
    # rotation 180 is beyond the pole: declination of the mount 85 is then 95
    assert run['el_enc'][0] / DEG == pytest.approx(180.0 - 85.05369, abs=1e-4)
    with pytest.raises(ValueError, match='latitude'):
        read_run(measured('coatli', '20211103b.txt'))


@pytest.mark.parametrize('name', ['20210409T034536.834', '20210409T034536', 'C1-20210409T034536o'])
@pytest.mark.parametrize('end', ['', ' 2000.0'])
def test_logs_of_the_unam_without_an_equinox_and_with_other_names(read, name, end):
    row = f'{name} 207.6 35.1 207.8 35.0 -69.10708 207.64833 35.13391'
    run = read(f'# {name} did not solve.\n{row} 0.0 207.74189 +35.14780{end}\n'
               f'{name} 207.6 25.1 207.8 25.0 -69.1 207.6 25.13391 180.0 -152.25 25.1478{end}\n'
               f'# {row} 0.0 207.7 35.1{end}\n'
               f'{row} 90.0 207.74189 +35.14780{end}\n', site=SITE)
    assert run.mount.two_sided and is_beyond(run['el']).tolist() == [False, True]
    assert run.meta['excluded'] == [{'row': 4, 'reason': 'commented out'},
                                    {'row': 5, 'reason': 'rotation: 90 is not 0 or 180'}]
    assert np.abs(run.offsets()).max() < 1.0 * DEG  # a right ascension of -152 is one of 208
    assert any('no column of the equinox' in note for note in run.meta['notes']) == (not end)


def test_a_catalogue_written_as_angles_of_the_mount(read):
    rows = 'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n150,160,150.1,160.2\n30,20,30.1,20.2\n'
    run = read(HEAD + rows)
    first, second = through_pole(np.array([-30.0, 30.0]) * DEG, np.array([20.0, 20.0]) * DEG,
                                 np.array([True, False]))
    np.testing.assert_allclose(run['el'], second, atol=1e-12)
    np.testing.assert_allclose(wrap(run['az'] - first), 0.0, atol=1e-12)
    assert any('through the pole' in note and 'dec_deg' in note for note in run.meta['notes'])


def test_notes_and_reasons_are_in_the_words_of_the_mount(read, tmp_path):
    write_csv(german_run(), tmp_path / 'german.csv')
    run = read_run(tmp_path / 'german.csv')
    text = ' '.join(run.meta['notes'])
    assert 'direction of approach in hour angle and declination' in text and 'approach_' not in text
    reasons = ' '.join(reason for _, reason in dictionary(Context.from_run(run))[1])
    assert not set(reasons.split()) & {'az_rate', 'approach_az', 'azimuth', 'elevation'}
