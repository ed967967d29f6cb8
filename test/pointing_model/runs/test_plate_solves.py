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

"""Frames of right ascension, declared comments, and observed directions both ways."""

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.runs.columns.declarations import declarations
from pointing_model.runs.plate_solves.frames import ICRS, KNOWN, parse_frame, to_icrs
from pointing_model.sky.places import icrs_to_observed, observed_directions, observed_to_icrs
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import DEFAULT_SITE

T = 1_795_000_000.0


@pytest.fixture
def places():
    rng = np.random.default_rng(2)
    return rng.uniform(0, 2 * np.pi, 50), rng.uniform(0.3, 1.5, 50), T + rng.uniform(0, 3e4, 50)


def test_observed_and_icrs_are_inverse(places):
    az, el, time = places
    air = Weather(np.full(50, 900.0), np.linspace(-5, 20, 50), 0.4, 0.6)
    ra, dec = observed_to_icrs(az, el, time, weather=air)
    back = icrs_to_observed(ra, dec, time, weather=air)
    assert np.abs(wrap(back[0] - az) * np.cos(el)).max() < 0.003 * ARCSEC
    assert np.abs(back[1] - el).max() < 0.003 * ARCSEC


def test_hour_angle_and_declination_are_those_of_the_direction(places):
    az, el, time = places
    seen = observed_directions(*observed_to_icrs(az, el, time), time)
    ha, dec = erfa.ae2hd(seen.az, seen.el, DEFAULT_SITE.latitude)
    assert np.abs(wrap(seen.ha - ha)).max() < 1e-9 and np.abs(seen.dec - dec).max() < 1e-9
    assert np.array_equal(seen[:2], icrs_to_observed(*observed_to_icrs(az, el, time), time))


@pytest.mark.parametrize('text, said', [
    ('ICRS', 'ICRS'), ('j2000', 'ICRS'), ('FK5', 'ICRS'), ('2000.0', 'ICRS'), ('J2000.0', 'ICRS'),
    ('FK5 J2024.5', 'J2024.5'), ('2015.5', 'J2015.5'), ('1950', 'B1950'), ('FK4', 'B1950'),
    ('of  date', 'of date'), ('JNow', 'of date'), ('mean of date', 'mean of date')])
def test_names_of_frames(text, said):
    assert parse_frame(text).text == said and parse_frame(said) == parse_frame(text)


@pytest.mark.parametrize('text, words', [
    ('galactic', KNOWN), ('', 'unknown'), ('nan', 'unknown'), ('J1875', 'outside 1900 to 2100'),
    ('20000', 'outside'), ('B1875', 'only B1950'), ('FK4 J1975', 'only B1950')])
def test_other_frames_are_refused(text, words):
    with pytest.raises(ValueError, match=words.replace('(', r'\(').replace(')', r'\)')):
        parse_frame(text)


def test_frames_against_their_definition():
    ra, dec, time = np.array([0.3, 4.0]), np.array([0.2, 1.1]), np.array([T, T + 9e3])
    assert np.array_equal(to_icrs(ra, dec, ICRS, time), (ra, dec))
    # precession of right ascension near the equator, 46.1" a year and 20.0" sin ra tan dec
    moved = to_icrs(np.zeros(1), np.zeros(1), parse_frame('J2010'), time[:1])
    assert wrap(moved[0])[0] / ARCSEC == pytest.approx(-461.2, abs=0.5)
    assert moved[1][0] / ARCSEC == pytest.approx(-200.4, abs=0.5)
    # 3C 273, which does not move: B1950 12 26 33.246 +02 19 43.47, ICRS 12 29 06.6997 +02 03 08.598
    quasar = to_icrs(np.array([186.638525 * DEG]), np.array([2.3287417 * DEG]),
                     parse_frame('B1950'), np.array([0.0]))
    assert quasar[0][0] / DEG == pytest.approx(187.2779154, abs=1e-4)
    assert quasar[1][0] / DEG == pytest.approx(2.0523883, abs=1e-4)
    # an apparent place: back through ERFA's own way forward
    tt = 2400000.5, 61362.0
    rc, dc, eo = erfa.atci13(ra, dec, 0, 0, 0, 0, *tt)
    time = (61362.0 - 40587.0) * 86400.0 - 69.184
    back = to_icrs(rc - eo, dc, parse_frame('of date'), np.full(2, time))
    assert np.abs(np.array(back) - (ra, dec)).max() < 1e-4 * ARCSEC


def test_comments_declare():
    told = declarations('run.csv', ['# my night', '', '# Frame = J2000', '# latitude_deg:  -30.5',
                                    '# longitud_deg: 20', '# pressure_hpa: 0', 'time,ra_deg',
                                    '# frame: FK4'])
    assert told['sky_frame'] == ICRS and told['site'] == {'latitude': -30.5 * DEG}
    assert told['weather'] == {'pressure_hpa': 0.0}
    assert told['notes'] == ["row 5: comment 'longitud_deg' not read; did you mean longitude_deg?"]
    below = ['# height_m 500', 'time,ra_deg', '# temperature_c: 4', '1,2', '# humidity: 0.1']
    told = declarations('run.csv', below, header=True)
    assert told['site'] == {'height': 500.0} and told['weather'] == {'temperature_c': 4.0}
    assert 'weather' not in declarations('run.csv', below)


ROWS = ('time,ra_deg,dec_deg,az_enc_deg,el_enc_deg\n'
        '2026-11-18T12:00:00Z,300.0,40.0,100.0,50.0\n2026-11-18T12:10:00Z,310.0,45.0,90.0,60.0\n')
SITE = '# latitude_deg: 34.3\n# longitude_deg: 109\n'


def test_the_air_of_a_file_is_that_of_rows_without_their_own(read):
    bare = read(SITE + '# pressure_hpa: 0\n# frame: ICRS\n' + ROWS)
    thick = read(SITE + '# pressure_hpa: 1013\n# temperature_c: 0\n# frame: ICRS\n' + ROWS)
    lift = (thick['el'] - bare['el']) / ARCSEC
    assert lift == pytest.approx(60.4 / np.tan(thick['el']), rel=0.02)
    own = ROWS.replace('el_enc_deg', 'el_enc_deg,pressure_hpa').replace('50.0\n', '50.0,990\n') \
        .replace('60.0\n', '60.0,\n')
    mixed = read(SITE + '# pressure_hpa: 1013\n# temperature_c: 0\n# frame: ICRS\n' + own)
    assert (mixed['el'] - bare['el']) / (thick['el'] - bare['el']) == pytest.approx(
        [990 / 1013, 1.0], abs=1e-4)


def test_declared_comments_that_are_spoiled_are_one_line(read):
    rng = np.random.default_rng(11)
    sound = SITE + '# frame: J2000\n' + ROWS
    bits = ['nan', 'inf', '1e400', '', '#', ':', '=', '\n', 'B1950', 'of date', '-', '9' * 30, '²']
    for _ in range(200):
        i = int(rng.integers(len(sound)))
        text = sound[:i] + bits[rng.integers(len(bits))] + sound[i + int(rng.integers(0, 4)):]
        try:
            run = read(text)
        except ValueError as error:
            assert 'run.txt' in str(error) and '\n' not in str(error)
            continue
        assert np.isfinite(run['az']).all() and np.isfinite(run['el']).all()
