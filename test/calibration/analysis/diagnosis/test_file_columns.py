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

"""Files whose columns are not what they are named are told as their owner wrote them."""

from itertools import product
from warnings import catch_warnings, simplefilter

import numpy as np
import pytest
from places import CASES

from calibration.analysis.diagnosis.mistaken_columns import MistakenColumns, check_columns
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.mounts import ALTAZ, Mount, is_beyond, through_pole
from pointing_model.runs.plate_solves.frames import OF_DATE, to_icrs
from pointing_model.sky.places import observed_to_icrs, sidereal_time
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site
from telescope_mount.input_files.run_loader import load_run

LATITUDE = 48.0 * DEG
TERMS = dict(zip(('IH', 'ID', 'CH', 'NP', 'MA', 'ME', 'TF'), (60, -40, 35, -20, 45, -70, 20)))


def written(path, kind='german', pier=True, through=True, n=60, seed=1, places=None,
            readings=None, latitude=LATITUDE):
    """A file of a mount with `TERMS`: hour angles and declinations, degrees.

    `places`, `readings`: what is written in place of ha, dec of catalogue and encoders; with a
    column of the side of the pier readings are places of the sky, else through the pole.
    """
    mount, rng = Mount.equatorial(LATITUDE, kind), np.random.default_rng(seed)
    h, d = rng.uniform(-75.0, 75.0, 4 * n) * DEG, np.arcsin(rng.uniform(-0.3, 0.98, 4 * n))
    h, d = (v[mount.horizon_of(h, d)[1] > 15.0 * DEG][:n] for v in (h, d))
    beyond = (h < 0.0) & (kind == 'german') & through
    a, e = sky_to_encoder(*through_pole(h, d, beyond),
                          {k: v * ARCSEC for k, v in TERMS.items()}, mount)
    a, e = (v + ARCSEC * rng.normal(size=n) for v in (a, e))
    if pier:
        a, e = through_pole(a, e, beyond)
    h, d, a, e = (v / DEG for v in (h, d, wrap(a), e))
    h, d = (places or (lambda x, y: (x, y)))(h, d)
    a, e = (readings or (lambda x, y: (x, y)))(a, e)
    rows = [f'# mount: {kind}', f'# latitude_deg: {latitude / DEG}',
            'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg' + ',pier_side' * pier]
    rows += [f'{w:.7f},{x:.7f},{y:.7f},{z:.7f}' + (',' + ('west' if b else 'east')) * pier
             for w, x, y, z, b in zip(h, d, a, e, beyond)]
    path.write_text('\n'.join(rows) + '\n')
    return path


def checked(path, **options):
    """What the check of a file says; raises MistakenColumns."""
    return check_columns(load_run(path, **options))


def hours(x, y):
    return x / 15.0, y


def gradians(x, y):
    return x / 0.9, y / 0.9


@pytest.mark.parametrize('kind, pier, through', [
    ('german', True, True), ('german', True, False), ('german', False, True),
    ('german', False, False), ('equatorial', False, False)])
def test_units_are_named_whatever_side_of_the_pier(tmp_path, kind, pier, through):
    path = tmp_path / 'run.csv'
    assert checked(written(path, kind, pier, through)).findings == []
    for (write, said), where in product(
            ((hours, 'hour angle {} in hours'),
             (gradians, 'hour angle and declination {} in gradians')),
            ('of the catalogue', 'of the encoders', 'of catalogue and encoders')):
        written(path, kind, pier, through, places='catalogue' in where and write,
                readings='encoders' in where and write)
        with pytest.raises(MistakenColumns, match='fit: ' + said.format(where)):
            checked(path)


@pytest.mark.parametrize('name', ['ger_hours', 'fork_hours'])
def test_hours_of_both_pairs_are_named_on_the_small_input(name):
    path = CASES / f'{name}.csv'
    if not path.is_file():
        pytest.skip(f'no small inputs in {CASES}')
    with pytest.raises(MistakenColumns, match='hour angle of catalogue and encoders in hours'):
        checked(path)


SITE = Site(34.3 * DEG, 64.3 * DEG, 500.0)
#: what is wrong: hours of the clock, the site that the file has, what is said
ELSEWHERE = {
    '+08:00': (8.0, SITE, 'the times are not UTC: .* fit: a clock 8 hours ahead of UTC .*08:00'),
    '-03:30': (-3.5, SITE, 'a clock 3.5 hours behind UTC .* with their zone, -03:30'),
    '+01:00': (1.0, SITE, 'a clock 1 hour ahead of UTC'),
    'longitude': (0.0, Site(34.3 * DEG, -64.3 * DEG, 500.0),
                  'the site is wrong: .* fit: the longitude with the other sign'),
    'longitude to 360': (0.0, Site(34.3 * DEG, 295.7 * DEG, 500.0),
                         'the longitude with the other sign'),
    'latitude': (0.0, Site(-34.3 * DEG, 64.3 * DEG, 500.0),
                 'the site is wrong: .* fit: the latitude with the other sign'),
    'exchanged': (0.0, Site(64.3 * DEG, 34.3 * DEG, 500.0), 'latitude and longitude exchanged')}


def of_stars(path, kind, hours=0.0, site=SITE, n=40, ascension=False, seed=4, frame='of date'):
    """A file with right ascensions, of `TERMS`; written with another clock or site.

    `ascension`: with that of the mount in place of its hour angle, in a frame.
    """
    rng = np.random.default_rng(seed)
    mount = ALTAZ if kind == 'altaz' else Mount.equatorial(SITE.latitude, kind)
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.98, n))
    moment = 1772539200.0 + np.sort(rng.uniform(0.0, 6.0, n)) * 3600.0
    ra, dec = observed_to_icrs(az, el, moment, SITE, Weather(955.0, 8.0))
    h, d = mount.axes_of(az, el)
    beyond = (h < 0.0) & (kind == 'german')
    names = mount.names.physical
    terms = {name: v * ARCSEC for name, v in zip(names, TERMS.values())}
    a, e = sky_to_encoder(*through_pole(h, d, beyond), terms, mount)
    a, e = (v + ARCSEC * rng.normal(size=n) for v in (a, e))
    first, second = mount.names.columns
    rows = [f'# mount: {kind}', '# frame: ICRS', '# pressure_hpa: 955', '# temperature_c: 8',
            f'# latitude_deg: {site.latitude / DEG:.6f}', '# height_m: 500',
            f'# longitude_deg: {site.longitude / DEG:.6f}',
            f'time,ra_deg,dec_deg,{"ra" if ascension else first}_enc_deg,{second}_enc_deg']
    if ascension:
        a = np.mod([sidereal_time(t, SITE) for t in moment] - a, 2.0 * np.pi)
        if frame == 'J2000':
            a, e = to_icrs(a, e, OF_DATE, moment)
    stamps = np.datetime_as_string(((moment + 3600.0 * hours) * 1e3).astype('datetime64[ms]'))
    rows += [f'{t},{w:.7f},{x:.7f},{y:.7f},{z:.7f}' for t, w, x, y, z in zip(
        stamps, *(v / DEG for v in (ra, dec, a, e)))]
    path.write_text('\n'.join(rows) + '\n')
    return path


@pytest.mark.parametrize('kind', ['altaz', 'equatorial', 'german'])
def test_a_clock_that_is_not_utc_and_a_wrong_site_are_named(tmp_path, kind):
    path = tmp_path / 'run.csv'
    assert check_columns(load_run(of_stars(path, kind))).findings == []
    for hours, site, said in ELSEWHERE.values():
        of_stars(path, kind, hours, site)
        with pytest.raises(MistakenColumns, match=said), catch_warnings():
            simplefilter('error')  # numpy's are faults of the fit
            check_columns(load_run(path))


def test_a_clock_that_right_ascensions_of_the_mount_were_turned_by_is_named(tmp_path):
    path = tmp_path / 'run.csv'
    assert check_columns(load_run(of_stars(path, 'german', ascension=True))).findings == []
    of_stars(path, 'german', 8.0, ascension=True)
    with pytest.raises(MistakenColumns, match='a clock 8 hours ahead of UTC'):
        check_columns(load_run(path))


def test_a_frame_of_right_ascensions_of_the_mount_is_named(tmp_path):
    path = of_stars(tmp_path / 'run.csv', 'equatorial', ascension=True, frame='J2000')
    with pytest.raises(ValueError, match=r'the file says ICRS, .* as J2000 the readings leave 1\.\d'
                       ' arcsec.* Nothing was concluded; declare "# readings: J2000"'):
        load_run(path)
    for frame in ('J2000', 'of date'):
        of_stars(path, 'equatorial', ascension=True, frame=frame)
        path.write_text('# readings: J2000\n' + path.read_text())
        if frame == 'J2000':
            assert check_columns(load_run(path)).findings == []
    with pytest.raises(ValueError, match='declare "# readings: of date"'):
        load_run(path)


def test_an_equinox_that_contradicts_the_rows_of_a_csv_is_named(tmp_path):
    path = of_stars(tmp_path / 'run.csv', 'equatorial')
    with pytest.raises(ValueError, match='--equinox date says of date, .* give --equinox j2000'):
        load_run(path, equinox='date')


@pytest.mark.parametrize('kind', ['german', 'equatorial'])
def test_offsets_without_the_cosine_of_the_declination_are_named(tmp_path, kind):
    path, out = written(tmp_path / 'run.csv', kind), tmp_path / 'offsets.csv'
    run = load_run(path)
    beyond, sign = is_beyond(run['el']), np.where(is_beyond(run['el']), -1.0, 1.0)
    h, d = through_pole(run['az'], run['el'], beyond)
    x, y = (sign * v / ARCSEC for v in run.offsets())

    def offsets(x):
        out.write_text('\n'.join([
            *path.read_text().splitlines()[:2], 'ha_deg,dec_deg,x_arcsec,y_arcsec,pier_side', *(
                f'{a:.7f},{b:.7f},{c:.3f},{e:.3f},{"west" if s else "east"}'
                for a, b, c, e, s in zip(h / DEG, d / DEG, x, y, beyond))]) + '\n')
        return checked(out)
    assert offsets(x).findings == []
    with pytest.raises(MistakenColumns, match=r'fit: column x_arcsec not multiplied by '
                       r'cos\(declination\) \(1\.\d arcsec\)'):
        offsets(x / np.cos(d))


def test_the_sign_of_the_latitude_is_named_where_hour_angles_are_given(tmp_path):
    for kind in ('equatorial', 'german'):
        written(tmp_path / 'run.csv', kind, pier=False, latitude=-LATITUDE)
        with pytest.raises(MistakenColumns, match='fit.*: .*the latitude with the other sign'):
            checked(tmp_path / 'run.csv')


def test_numbers_that_no_terms_explain_are_refused_without_a_proposal(tmp_path):
    path, rng = tmp_path / 'run.csv', np.random.default_rng(7)
    for n in (8, 20, 60):
        rows = rng.uniform(0.0, [360.0, 90.0, 360.0, 90.0], (n, 4))
        path.write_text('az_deg,el_deg,az_enc_deg,el_enc_deg\n' + '\n'.join(
            ','.join(f'{v:.5f}' for v in row) for row in rows) + '\n')
        with pytest.raises(MistakenColumns, match='No other reading that was tried fits'):
            checked(path)


def test_the_small_inputs_of_clocks_and_unrelated_columns():
    if not CASES.is_dir():
        pytest.skip(f'no small inputs in {CASES}')
    with pytest.raises(MistakenColumns, match='a clock 8 hours ahead of UTC'):
        check_columns(load_run(CASES / 'ps_local_time.csv'))
    with pytest.raises(MistakenColumns, match='No other reading that was tried fits'):
        checked(CASES / 'garbage0.csv')


def test_whatever_reads_a_run_judges_its_columns_first(tmp_path, monkeypatch):
    from calibration.analysis.season.season_nights import nights_of
    from calibration.analysis.tracking.run_track import track_run
    from telescope_mount import api
    from telescope_mount.cli import main
    wrong = of_stars(tmp_path / 'wrong.csv', 'altaz', 8.0)
    run = load_run(wrong)
    with pytest.raises(MistakenColumns, match='a clock 8 hours ahead of UTC'):
        track_run(run)
    right = [load_run(of_stars(tmp_path / f'{i}.csv', 'altaz', seed=5 + i)) for i in range(3)]
    (note,) = [note for note in nights_of([*right, run]).notes if 'wrong.csv' in note]
    assert 'a clock 8 hours ahead of UTC' in note and note.endswith('(left out)')

    def late(*args, **options):
        raise AssertionError('the columns come first')
    monkeypatch.setattr('calibration.analysis.sky_model.settled_together', late)
    monkeypatch.setattr(api, 'settled_together', late)
    for judged in (api.fit, api.diagnose):
        with pytest.raises(MistakenColumns, match='a clock 8 hours ahead of UTC'):
            judged(wrong)
    for command in ('fit', 'diagnose', 'track'):
        assert main([command, str(wrong)]) == 2
