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

"""The command `satellite` on files."""

import json

import numpy as np
import pytest
from kepler_orbit import sp3
from made_tracks import ORBITS, TRUTH, made_tracks, write_track

from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun

EPOCHS = 120.0 * np.arange(900)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Tracks of three satellites, their orbits, and stars."""
    out = tmp_path_factory.mktemp('satellite')
    tracks = made_tracks(np.random.default_rng(1), {'A01': 1, 'B02': 1, 'C03': 1}, 40, 0.02)
    for name in ('A01', 'B02', 'C03'):
        (out / f'{name}.sp3').write_text(sp3(EPOCHS, name=name, velocities=False, code=5,
                                             **ORBITS[name]))
    write_track(out / 'tracks.csv', tracks)
    write_track(out / 'late.csv', tracks, shift=18.0)
    write_track(out / 'seen.csv', tracks.select(tracks.object == 1), names=False, angles='seen')
    run = tracks.run
    stars = {name: run[name][tracks.is_star] for name in ('time', 'az', 'el', 'az_enc', 'el_enc')}
    write_csv(PointingRun(stars), out / 'stars.csv')
    return out


def orbits(folder):
    return [part for name in ('A01', 'B02', 'C03')
            for part in ('--orbit', folder / f'{name}.sp3')]


def test_tracks_become_a_model_a_page_and_a_result(ended, folder):
    page, result, model = (folder / name for name in ('s.html', 's.json', 'm.json'))
    code, out, err = ended('satellite', folder / 'tracks.csv', *orbits(folder), '--star-run',
                           folder / 'stars.csv', '--no-diagnosis', '--report', page, '--json',
                           result, '--save', model, '--verbose')
    assert (code, err) == (0, '')
    assert 'left along' in out and "The station's clock is" in ' '.join(out.split())
    document = json.loads(result.read_text())
    assert document['determined'] and document['clock']['late_s'] == pytest.approx(0.02, abs=0.01)
    assert {one['name'] for one in document['satellites']} == {'A01', 'B02', 'C03'}
    terms = PointingModel.load(model).terms
    assert terms['AN'] / ARCSEC == pytest.approx(TRUTH['AN'], abs=2.0)
    assert 'along the track' in page.read_text()


def test_where_a_satellite_was_seen_needs_no_encoder(ended, folder):
    code, out, _ = ended('satellite', folder / 'seen.csv', '--object', 'A01', *orbits(folder))
    assert code == 0 and 'do not determine the terms' in ' '.join(out.split())


def test_stamps_of_another_scale_or_time_zone_are_named(refused, folder):
    line = refused('satellite', folder / 'late.csv', *orbits(folder))
    assert 'the time stamps are 18 s late, as if in GPS time' in line
    tracks = made_tracks(np.random.default_rng(1), {'A01': 1, 'B02': 1})
    path = write_track(folder / 'zone.csv', tracks, shift=5.5 * 3600.0)
    assert 'the time stamps are 5.5 h late' in refused('satellite', path, *orbits(folder))


@pytest.mark.parametrize(('text', 'more', 'message'), [
    ('time,satellite,az_enc_deg,el_enc_deg\n' + ''.join(
        f'2017-12-03T{h:02d}:{m}:00Z,A01,{20 * h},{20 + m}\n' for h in (1, 2)
        for m in (10, 30, 50)), (), 'degrees from the orbits'),
    ('time,az_enc_deg,el_enc_deg\n2017-12-03T01:00:00Z,1,45\n', (),
     '3 satellites; name one with --object: A01, B02, C03'),
    ('time,az_enc_deg,el_enc_deg\n2017-12-03T01:00:00Z,1,45\n', ('--object', 'Z9'),
     'no satellite Z9; there are A01, B02, C03'),
    ('time,satellite,az_enc_deg,el_enc_deg\n2017-12-30T01:00:00Z,A01,1,45\n', (),
     'A01: no position at 2017-12-30 01:00:00 UTC; the files cover 2017-12-03 00:00:00 to'),
    ('time,satellite\n2017-12-03T01:00:00Z,A01\n', (),
     'a track needs time and az_enc_deg, el_enc_deg'),
    ('time,satellite,az_enc_deg,el_enc_deg\n2017-12-03T01:00:00Z,A01,,45\n', (),
     'no row has time, az_enc_deg, el_enc_deg'),
    *[('time,satellite,az_enc_deg,el_enc_deg\n' + ''.join(
        f'{start + step},A01,1,45\n' for step in (0.0, 0.25)), (), message)
      for start, message in (
          (2458090.25, '2458090.25 to 2458090.5 are no seconds since 1970: is this Julian days? '
           'Give seconds since 1970 (UTC) or ISO 8601'),
          (58089.5, '58089.5 to 58089.75 are no seconds since 1970: is this days (MJD)? Give'),
          (20.0, 'they count from an arbitrary start. Give seconds since 1970'))],
])
def test_bad_input_is_one_line(refused, folder, tmp_path, text, more, message):
    path = tmp_path / 'track.csv'
    path.write_text(text)
    place = ('--latitude', '34.3', '--longitude', '109', '--height', '500')
    assert message in refused('satellite', path, *orbits(folder), *place, *more)


def test_a_track_without_a_site_asks_for_it(refused, folder, tmp_path):
    path = tmp_path / 'track.csv'
    path.write_text('time,az_enc_deg,el_enc_deg\n2017-12-03T01:00:00Z,1,45\n')
    common = ('satellite', path, '--object', 'A01', *orbits(folder))
    assert 'the site is not known; give --latitude and --longitude and --height' in refused(*common)
    assert 'the height of the site is not known; give --height, or lines "# height_m: ..."' in \
        refused(*common, '--latitude', '34.3', '--longitude', '109')


def test_a_few_wild_rows_and_a_pass_under_another_name_refuse_no_file(ended, folder, tmp_path):
    lines = (folder / 'tracks.csv').read_text().splitlines()
    rows = [line.split(',') for line in lines[4:]]
    wild = [','.join([*row[:2], '0', '0'] if i % 12 == 5 else row) for i, row in enumerate(rows)]
    named = [','.join([row[0], row[1].replace('A01', 'C03'), *row[2:]]) for row in rows]
    for name, changed, said in (('wild', wild, 'rows are excluded as outliers, the first at 2017'),
                                ('named', named, 'The pass of C03 that begins 2017')):
        path = tmp_path / f'{name}.csv'
        path.write_text('\n'.join([*lines[:4], *changed]) + '\n')
        code, out, err = ended('satellite', path, *orbits(folder), '--no-diagnosis', '--star-run',
                               folder / 'stars.csv', '--verbose')
        assert (code, err) == (0, '') and said in ' '.join(out.split())


def test_the_air_and_the_side_that_a_track_gives_are_taken(folder, tmp_path):
    from pointing_model.mounts import through_pole
    from telescope_mount.input_files.track_loader import load_tracks
    path = tmp_path / 'track.csv'
    head = ('# mount: german\n# latitude_deg: 34.3\n# longitude_deg: 109\n# height_m: 500\n'
            '{}time,ha_enc_deg,dec_enc_deg{}\n')
    rows = ['2017-12-03T01:00:00Z,-40,20', '2017-12-03T01:01:00Z,30,-25']

    def read(declared='', sides=None, **given):
        path.write_text(head.format(declared, '' if sides is None else ',pier_side') + '\n'.join(
            row + ('' if sides is None else f',{side}')
            for row, side in zip(rows, sides or rows)))
        return load_tracks([path], [folder / 'A01.sp3'], **given)
    plain = read()
    assert plain.weather.pressure_hpa == pytest.approx([954.6] * 2, abs=0.1)
    assert any('refraction for 954.6 hPa' in note for note in plain.notes)
    air = '# pressure_hpa: 0\n# temperature_c: -7\n'
    for given, pressure in ((None, 0.0), ({'pressure_hpa': 940.0}, 940.0)):
        weather = read(air, weather=given).weather
        assert weather.pressure_hpa.tolist() == [pressure] * 2
        assert weather.temperature_c.tolist() == [-7.0] * 2
    beyond = np.array([True, True])
    sides = read(sides=['west', 'pierWest']).columns
    wanted = through_pole(plain.columns['az_enc'], plain.columns['el_enc'], beyond)
    assert np.allclose(np.exp(1j * np.array([sides['az_enc'], sides['el_enc']])),
                       np.exp(1j * np.array(wanted)), atol=1e-12)
    assert read(sides=['pierEast', 'e']).columns['el_enc'] == pytest.approx(
        plain.columns['el_enc'])
    with pytest.raises(ValueError, match='pier_side is unknown in 1 of 2 rows'):
        read(sides=['west', 'unknown'])


def test_rows_of_a_log_find_their_orbits_by_number(folder, tmp_path, monkeypatch):
    from telescope_mount.input_files import track_loader
    paths = [folder / f'{name}.sp3' for name in ('A01', 'B02', 'C03')]
    number = -track_loader.Orbits(paths).orbit('B02').number
    rows = track_loader.load_tracks([folder / 'tracks.csv'], paths)
    first = np.flatnonzero(rows.names == 'B02')[:3]
    run = PointingRun({'time': rows.columns['time'][first], 'star': np.array([number, 5, number]),
                       **{name: rows.columns[name][first] for name in ('az_enc', 'el_enc')},
                       'az': np.zeros(3), 'el': np.ones(3)}, {'source': 'night'})
    monkeypatch.setattr(track_loader, 'load_run', lambda *_, **__: run)
    site = {'latitude': 0.6, 'longitude': 1.9, 'height': 500.0}
    found = track_loader.load_tracks([tmp_path], paths, site=site)
    assert found.names.tolist() == ['B02', '', 'B02'] and list(found.orbits) == ['B02']
    with pytest.raises(ValueError, match='night: no orbit of satellite'):
        track_loader.load_tracks([tmp_path], paths[:1], site=site)


def test_a_camera_that_missed_is_taken_into_account(folder, tmp_path):
    from telescope_mount.input_files.track_loader import load_tracks
    lines = (folder / 'tracks.csv').read_text().splitlines()
    head, rows = lines[:4], lines[4:24]
    (tmp_path / 'twice.csv').write_text('\n'.join(head + rows + rows[:5]))
    twice = load_tracks([tmp_path / 'twice.csv'], [folder / 'A01.sp3'], 'A01')
    assert len(twice.names) == 20 and '5 of 25 rows are duplicates' in ' '.join(twice.notes)
    az = [float(row.split(',')[2]) for row in rows]
    el = [float(row.split(',')[3]) for row in rows]
    (tmp_path / 'plain.csv').write_text('\n'.join(head + rows))
    moved = [f'{row.rsplit(",", 2)[0]},{a - 30.0 / 3600.0 / np.cos(e * DEG):.9f},'
             f'{e + 20.0 / 3600.0:.9f},30,-20' for row, a, e in zip(rows, az, el)]
    (tmp_path / 'missed.csv').write_text('\n'.join(
        [*head[:3], f'{head[3]},miss_x_arcsec,miss_y_arcsec', *moved]))
    paths = [folder / f'{name}.sp3' for name in ('A01', 'B02', 'C03')]
    plain, missed = (load_tracks([tmp_path / name], paths).columns
                     for name in ('plain.csv', 'missed.csv'))
    np.testing.assert_allclose(missed['az_enc'], plain['az_enc'], atol=0.05 * ARCSEC)
    np.testing.assert_allclose(missed['el_enc'], plain['el_enc'], atol=0.05 * ARCSEC)
    np.testing.assert_allclose([missed['miss_x'], missed['miss_y']], np.multiply(
        [[30.0], [-20.0]], ARCSEC * np.ones(20)), atol=0.05 * ARCSEC)
