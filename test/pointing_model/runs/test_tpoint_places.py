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

"""TPOINT files with places among the stars: alt-azimuth mounts, proper motions, options."""


import erfa
import numpy as np
import pytest
from places import CASES

from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.places import icrs_to_observed, sidereal_time
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site

DAY = 1772496000.0  # 2026-03-03


def sexagesimal(value, places):
    sign, value = '-' if value < 0.0 else '+', abs(value)
    whole = round(value * 3600.0 * 10**places)
    minutes, seconds = divmod(whole, 60 * 10**places)
    return (f'{sign}{minutes // 60:02d} {minutes % 60:02d} '
            f'{seconds / 10**places:0{places + 3}.{places}f}')


def hours(angle, places=5):
    return sexagesimal(np.mod(angle, 2.0 * np.pi) / (15.0 * DEG), places)[1:]


def observatory(mount, latitude, terms, n=40, seed=1, moved=None, lst_decimals=6):
    """Rows: J2000 place (at the epoch 2000, with proper motion), apparent place, telescope, LST."""
    rng = np.random.default_rng(seed)
    site, air = Site(latitude, 0.0, 2282.0), Weather(777.0, 13.0, 0.06)
    time = DAY + 3600.0 * np.sort(rng.uniform(0.0, 6.0, n))
    lst = sidereal_time(time, site)
    dec = np.clip(rng.uniform(-0.9, 0.9, n) + latitude, -1.3, 1.3)
    ra = lst + rng.uniform(-0.9, 0.9, n)
    motion = rng.normal(0.0, [[0.02], [0.3]], (2, n)) if moved else np.zeros((2, n))
    years = 26.17
    now = ra + 15.0 * motion[0] * years * ARCSEC, dec + motion[1] * years * ARCSEC
    az, el = icrs_to_observed(*now, time, site, air)
    first, second = mount.axes_of(az, el)
    reading = geometry.sky_to_encoder(first, second,
                                      {k: v * ARCSEC for k, v in terms.items()}, mount)
    at = (Mount.equatorial(latitude).axes_of(*mount.horizon_of(*reading)) if mount.vertical
          else reading)
    tt = time / 86400.0 + 40587.0 + 69.184 / 86400.0
    cirs = erfa.ufunc.atci13(*now, 0.0, 0.0, 0.0, 0.0, 2400000.5, tt)
    apparent = cirs[0] - cirs[2], cirs[1]
    clock = [divmod(v, 60.0) for v in np.mod(lst, 2.0 * np.pi) / (15.0 * DEG) * 60.0]
    return {'j2000': (ra, dec), 'apparent': apparent, 'motion': motion,
            'telescope': (lst - at[0], at[1]),
            'lst': [f'{h:.0f} {m:.{lst_decimals}f}' for h, m in clock]}


def written(rows, options, latitude, star='apparent', motion=False, after=''):
    """A file of such rows."""
    said = ['Pointing test', *(f': {option}' for option in options),
            f'{sexagesimal(latitude / DEG, 2)} 2026 03 03 13 777 2282.0 0.06']
    for i in range(len(rows['lst'])):
        place = [f'{hours(rows[name][0][i])} {sexagesimal(rows[name][1][i] / DEG, 4)}'
                 for name in (star, 'telescope')]
        moves = f' {rows["motion"][0][i]:.6f} {rows["motion"][1][i]:.6f} 2000.0' if motion else ''
        said.append(f'{place[0]}{moves} {place[1]} {rows["lst"][i]} {after}')
    return '\n'.join(said) + '\n'


@pytest.fixture
def read(tmp_path):
    def work(text, **options):
        path = tmp_path / 'run.dat'
        path.write_text(text)
        return read_run(path, **options)
    return work


LATITUDE = -29.0074 * DEG
EQUATORIAL = Mount.equatorial(LATITUDE)
TERMS = dict(zip(EQUATORIAL.names.physical, (60.0, -40.0, 35.0, -20.0, 45.0, -70.0, 20.0)))
OF_ALTAZ = dict(zip(ALTAZ.names.physical, (120.0, -40.0, 15.0, -8.0, 20.0, 12.0, 25.0)))


def off(run, terms):
    return max(abs(fit_terms(run).model.terms[name] / ARCSEC - value)
               for name, value in terms.items())


def test_an_alt_azimuth_mount_with_places_among_the_stars(read):
    """As the JCMT writes: ``ALTAZ``, apparent places, sidereal time, readings and words after."""
    latitude = 19.8228 * DEG
    rows = observatory(ALTAZ, latitude, OF_ALTAZ)
    text = written(rows, ['ALTAZ'], latitude, after='-1.4 105.9 HARPB 0.00')
    run = read(text, equinox='date')
    assert run.mount.vertical and len(run) == 40 and off(run, OF_ALTAZ) < 0.1
    assert run['auxiliary_1'][0] == -1.4 and run['auxiliary_4'][0] == 0.0
    notes = ' '.join(run.meta['notes'])
    assert 'HARPB' in notes and 'computed from its right ascension' in notes
    assert 'azimuth read from' not in notes


@pytest.mark.parametrize('options', [['J2000', 'EQUAT', 'NODA', 'ALLSKY'], ['EQUAT']])
def test_rows_with_proper_motion(read, options):
    rows = observatory(EQUATORIAL, LATITUDE, TERMS, moved=True)
    run = read(written(rows, options, LATITUDE, 'j2000', motion=True))
    assert len(run) == 40 and off(run, TERMS) < 0.1
    notes = ' '.join(run.meta['notes'])
    assert 'proper motion applied, from 2000' in notes and 'no equinox in the file' not in notes
    assert ('NODA ignored' in notes) == ('NODA' in options)


def test_proper_motion_of_an_alt_azimuth_mount_and_rejected_rows(read):
    rows = observatory(ALTAZ, LATITUDE, OF_ALTAZ, moved=True)
    text = written(rows, ['ALTAZ', 'J2000'], LATITUDE, 'j2000', motion=True).splitlines()
    text[8] = '# ' + text[8]
    run = read('\n'.join(text))
    assert len(run) == 39 and off(run, OF_ALTAZ) < 0.1
    assert run.meta['excluded'] == [{'row': 9, 'reason': 'rejected by the observers (#)'}]


def test_the_epoch_is_of_the_place_alone_only_with_the_option(read):
    rows = observatory(EQUATORIAL, LATITUDE, TERMS, moved=True)
    text = written(rows, ['EQUAT'], LATITUDE, 'j2000', motion=True).replace(' 2000.0 ', ' 1991.25 ')
    with pytest.raises(ValueError, match="year after the proper motions: '1991.25' is not 2000"):
        read(text)
    assert len(read(text.replace(': EQUAT', ': EQUAT\n: J2000'))) == 40


def test_places_of_the_telescope_of_j2000_are_refused_by_name(read):
    rows = observatory(EQUATORIAL, LATITUDE, {})
    rows['telescope'] = rows['j2000']
    with pytest.raises(ValueError, match="the telescope's places look like J2000"):
        read(written(rows, ['J2000', 'EQUAT'], LATITUDE, 'j2000', motion=True))


@pytest.mark.parametrize('options, words', [
    (['GIMBAL 0 0 0'], 'GIMBAL is not read'), (['ALTAZ', 'EQUAT'], 'contradict each other'),
    (['ALLSKY'], 'says which mount')])
def test_options_of_other_mounts_are_refused_by_name(read, options, words):
    rows = observatory(EQUATORIAL, LATITUDE, TERMS, n=3)
    with pytest.raises(ValueError, match=words):
        read(written(rows, options, LATITUDE))


def test_an_option_that_is_not_known_is_said(read):
    rows = observatory(EQUATORIAL, LATITUDE, TERMS, n=12)
    run = read(written(rows, ['EQUAT', 'FOO'], LATITUDE), equinox='date')
    assert 'option FOO is not known: ignored' in run.meta['notes']


def test_the_run_of_an_observatory_with_proper_motion():
    path = CASES / 'tpoint_proper_motion.dat'
    if not path.is_file():
        pytest.skip(f'no {path.name} beside the project')
    run = read_run(path)
    result = fit_terms(run)
    away = np.array([result.model.terms[name] / ARCSEC - value for name, value in TERMS.items()])
    assert len(run) == 50 and run.meta['site']['latitude'] / DEG == pytest.approx(-29.007444)
    assert np.all(np.abs(away) < 3.0 * result.sigma / ARCSEC)
    assert result.rms_arcsec().radial < 1.5
    assert any('777 hPa, 13 C, as the file says' in note for note in run.meta['notes'])
