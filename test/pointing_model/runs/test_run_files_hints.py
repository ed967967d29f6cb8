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

"""What is said of a table that cannot be read as it is, and the mount's right ascension."""

import numpy as np
import pytest

from calibration.analysis.diagnosis.diagnosis_result import not_taken
from calibration.analysis.diagnosis.readings import Reading
from calibration.analysis.term_fit import fit_terms
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.context import Context
from pointing_model.mounts import Mount
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.places import icrs_to_observed, sidereal_time
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site

GERMAN = Mount.equatorial(48.0 * DEG, 'german')


@pytest.fixture
def read(tmp_path):
    def work(text, **options):
        path = tmp_path / 'run.csv'
        path.write_text(text)
        return read_run(path, **options)
    return work


def refused(read, text):
    with pytest.raises(ValueError) as caught:
        read(text)
    assert '\n' not in str(caught.value)
    return str(caught.value)


def rows(kind, n=20, seed=1):
    rng = np.random.default_rng(seed)
    if kind == 'altaz':
        place = np.array([rng.uniform(0.0, 360.0, n), rng.uniform(20.0, 85.0, n)])
    else:
        place = np.array([rng.uniform(-70.0, 70.0, n), rng.uniform(-20.0, 80.0, n)])
    return np.array([*place, *(place + rng.uniform(0.1, 0.2, (2, n)))]).T


@pytest.mark.parametrize('kind, before, after, line', [
    ('altaz', '', '', 'az_deg,el_deg,az_enc_deg,el_enc_deg'),
    ('altaz', '2026-03-03T12:09:55Z', '', 'time,az_deg,el_deg,az_enc_deg,el_enc_deg'),
    ('altaz', 'M31', '4.5', 'star,az_deg,el_deg,az_enc_deg,el_enc_deg,column_6'),
    ('german', '', 'pierEast', 'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg,pier_side')])
@pytest.mark.parametrize('delimiter', [',', ';', '\t', ' '])
def test_a_file_without_a_header_is_told_the_line_that_makes_it_one(read, kind, before, after,
                                                                    line, delimiter):
    text = '\n'.join(delimiter.join(filter(None, [before, *(f'{v:.4f}' for v in row), after]))
                     for row in rows(kind)) + '\n'
    said, line = refused(read, text), line.replace(',', delimiter.replace('\t', ' '))
    assert 'write above the numbers' in said and f'"{line}"' in said
    assert 'assumed from their ranges: places, then what the encoders read' in said
    assert ('# mount: german' in said) == (kind == 'german')
    head = '# mount: german\n# latitude_deg: 48\n' if kind == 'german' else ''
    assert len(read(f'{head}{line}\n{text}')) == 20


def test_numbers_that_are_no_readings_are_told_as_offsets(read):
    table = rows('altaz')
    table[:, 2:] = np.random.default_rng(2).normal(0.0, 60.0, (20, 2))
    text = '\n'.join(','.join(f'{v:.3f}' for v in row) for row in table)
    said = refused(read, text)
    assert '"az_deg,el_deg,x_arcsec,y_arcsec"' in said and 'then offsets in arcsec' in said


def test_columns_of_offsets_are_told_what_to_be_called(read):
    said = refused(read, 'azimuth,elevation,offset_az,offset_el,map_id\n10,40,1,2,7\n')
    assert 'az_deg (closest: azimuth), el_deg (closest: elevation), az_enc_deg, el_enc_deg;' in said
    assert 'call them x_arcsec and y_arcsec: encoder - catalogue on the sky, in arcsec' in said
    assert 'closest: map_id' not in said


@pytest.mark.parametrize('header, words', [
    ('AzMount,AltMount,AzTrue,AltTrue', ['az_enc_deg (closest: AzMount)',
                                         'el_deg (closest: AltTrue)']),
    ('azi,alt,enc_az,enc_alt', ['az_deg (closest: azi)', 'el_enc_deg (closest: enc_alt)']),
    ('foo,bar,baz,qux', ['no column az_deg, el_deg, az_enc_deg, el_enc_deg;'])])
def test_the_closest_column_is_one_of_the_same_meaning(read, header, words):
    said = refused(read, f'{header}\n10,40,10.1,40.1\n')
    assert all(word in said for word in words)


def test_the_right_ascension_of_the_mount_becomes_its_hour_angle(read):
    """With the time and the longitude, or with the sidereal time."""
    rng = np.random.default_rng(3)
    site, air = Site(48.0 * DEG, 11.0 * DEG), Weather(1013.0, 10.0)
    time = 1.77e9 + np.sort(rng.uniform(0.0, 2e4, 40))
    lst = sidereal_time(time, site)
    ra, dec = lst + rng.uniform(-1.0, 1.0, 40), rng.uniform(-0.1, 1.3, 40)
    az, el = icrs_to_observed(ra, dec, time, site, air)
    first, second = GERMAN.axes_of(az, el)
    first, second = GERMAN.axes_of(az, el, first < 0.0)
    true = dict(zip(GERMAN.names.physical, (60.0, -40.0, 35.0, -20.0, 45.0, -70.0, 20.0)))
    terms = {name: value * ARCSEC for name, value in true.items()}
    ha, de = geometry.sky_to_encoder(first, second, terms, GERMAN)
    columns = np.array([time, ra / DEG, dec / DEG, np.mod(lst - ha, 2 * np.pi) / DEG, de / DEG,
                        np.mod(lst, 2 * np.pi) / DEG / 15.0]).T
    head = '# mount: german\n# latitude_deg: 48\n# pressure_hpa: 1013\n# temperature_c: 10\n'
    names = 'time,ra_deg,dec_deg,ra_enc_deg,dec_enc_deg,lst_h'

    def text(width):
        return ','.join(names.split(',')[:width]) + '\n' + '\n'.join(
            ','.join(f'{v:.9f}' for v in row[:width]) for row in columns)
    for run in (read(head + '# longitude_deg: 11\n' + text(5)),
                read(head + '# longitude_deg: 11\n' + text(6))):
        terms = fit_terms(run).model.terms
        assert max(abs(terms[name] / ARCSEC - value) for name, value in true.items()) < 0.05
        assert any('ha_enc_deg computed from ra_enc_deg' in note for note in run.meta['notes'])
    assert 'longitude' in refused(read, head + text(5))
    assert 'no column time' in refused(
        read, head + 'ha_deg,dec_deg,ra_enc_deg,dec_enc_deg\n1,2,3,4')


def test_a_right_ascension_in_place_of_the_hour_angle_is_told_how_it_is_read():
    said = Reading((), ('ascension',)).text(names=GERMAN.names)
    assert 'right ascension in place of the hour angle of the encoders' in said
    assert 'call the column ra_enc_deg' in said
    assert 'ra_enc_deg' not in Reading(('ascension',)).text(names=GERMAN.names)


def test_auxiliary_readings_that_are_a_temperature_are_told_how_to_be_used():
    def note(name):
        (found,) = not_taken(Context(np.zeros(3), np.ones(3), {name: np.arange(3.0)}))
        return wording(found)
    assert 'auxiliary_1' in note('auxiliary_1') and 'name the column temperature_c' in note(
        'auxiliary_1')
    assert 'temperature_c' not in note('fwhm') and '--cause COLUMN' in note('fwhm')
