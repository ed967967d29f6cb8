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

"""The command ``apply``: columns in, columns out."""

import csv
import io

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.mounts import Mount, through_pole

TERMS = {'IA': 412.0 * ARCSEC, 'CA': 25.0 * ARCSEC, 'AN': 30.0 * ARCSEC, 'TF': 15.0 * ARCSEC}
ZEROS = [{'run': 1, 'az_arcsec': 100.0, 'el_arcsec': -50.0},
         {'run': 2, 'az_arcsec': 110.0, 'el_arcsec': -40.0}]


@pytest.fixture
def model(tmp_path):
    drift = FittedEffect(effect('drift', of='IA', driver='temperature', origin=4.0, scale=1.0,
                                within=[0.0, 8.0]), [5.0 * ARCSEC])
    made = PointingModel(TERMS, effects=[drift], provenance={'zeros_in_force': ZEROS})
    made.save(tmp_path / 'model.json')
    return tmp_path / 'model.json', made


def table(text):
    return list(csv.DictReader(io.TextIOWrapper(io.BytesIO((text).encode()))))


def test_there_and_back_with_the_columns_of_the_file(ended, model, tmp_path):
    path, made = model
    given = tmp_path / 'in.csv'
    given.write_text('# asked tonight\nname,az_deg,el_deg,temperature_c\n'
                     'Vega,120.5,45.25,6\nDeneb,300,70,4\n')
    code, out, err = ended('apply', path, given)
    assert code == 0
    rows = table(out)
    assert list(rows[0]) == ['name', 'az_deg', 'el_deg', 'temperature_c', 'az_enc_deg',
                             'el_enc_deg']
    assert rows[0]['name'] == 'Vega' and rows[0]['az_deg'] == '120.5'
    az, el = made.sky_to_encoder(np.array([120.5, 300.0]) * DEG, np.array([45.25, 70.0]) * DEG,
                                 {'temperature': np.array([6.0, 4.0])})
    got = np.array([[float(r['az_enc_deg']), float(r['el_enc_deg'])] for r in rows])
    np.testing.assert_allclose(got[:, 0], az / DEG + 110.0 / 3600.0, atol=1e-12)
    np.testing.assert_allclose(got[:, 1], el / DEG - 40.0 / 3600.0, atol=1e-12)
    assert err == ('note: zero applied, run 2: azimuth +110.00, elevation -40.00 arcsec\n')
    there = tmp_path / 'there.csv'
    there.write_text(out)
    assert ended('apply', path, '--reverse', there, '--out', tmp_path / 'back.csv')[:2] == (0, '')
    back = table((tmp_path / 'back.csv').read_text())
    for one, row in zip(back, rows):
        assert float(one['az_model_deg']) == pytest.approx(float(row['az_deg']), abs=1e-9 / 3600)
        assert float(one['el_model_deg']) == pytest.approx(float(row['el_deg']), abs=1e-9 / 3600)


def test_rows_where_the_model_rests_on_what_its_stars_did_not_determine_are_named(ended, tmp_path):
    PointingModel({'IE': -134.0 * ARCSEC, 'TF': 0.0}, undetermined=('IE', 'TF'),
                  directions=[{'TF': 1.0, 'IE': -np.cos(50 * DEG)}]).save(tmp_path / 'model.json')
    given = tmp_path / 'in.csv'
    given.write_text('az_deg,el_deg\n10,20\n10,50\n10,80\n')
    code, _, err = ended('apply', tmp_path / 'model.json', given)
    assert code == 0
    assert ' '.join(err.split()) == (
        'note: prediction error unknown in rows 2, 4: the stars of the fit do not determine the '
        'terms IE, TF')


def test_what_is_not_known_is_said_once(ended, model, tmp_path):
    given = tmp_path / 'in.csv'
    given.write_text('az_deg;el_deg;run;temperature_c\n10;45;1;\n20;50;2;5\n30;60;2;\n')
    code, out, err = ended('apply', model[0], given)
    assert code == 0 and len(out.splitlines()) == 4 and ';' in out
    assert 'run 1: azimuth +100.00' in err and 'run 2: azimuth +110.00' in err
    (line,) = [line for line in err.splitlines() if 'counts as zero' in line]
    assert 'in 2 of 3 rows: temperature is not known' in line
    code, out, err = ended('apply', model[0], given, '--set', 'temperature_c=5', '--zero', 'none')
    assert 'counts as zero' not in err and 'not applied' in err
    late = FittedEffect(effect('lagged', of='TF', tau=3600.0, start=False), [ARCSEC])
    PointingModel(TERMS, effects=[late]).save(tmp_path / 'late.json')
    _, _, err = ended('apply', tmp_path / 'late.json', given, '--time', '2026-01-15T13:00:00Z')
    assert 'in 2 of 3 rows: temperature is not known' in err  # and the time is


def test_the_standard_input_and_models_of_other_programs(ended, tmp_path, monkeypatch):
    path = tmp_path / 'tcs.model'
    path.write_text('RTS2_ALTAZ -36" 0 0 0 0 18" 0\n')
    monkeypatch.setattr('sys.stdin', io.TextIOWrapper(io.BytesIO(b'az_deg,el_deg\n10,45\n')))
    code, out, err = ended('apply', path)
    assert code == 0 and err == ''
    row, = table(out)
    assert float(row['az_enc_deg']) == pytest.approx(10.01)
    assert float(row['el_enc_deg']) == pytest.approx(44.995)


@pytest.mark.parametrize('text, options, words', [
    ('az_deg,el\n1,2\n', [], 'no column el_deg; the file has az_deg, el'),
    ('az_deg,el_deg\n1,x\n', [], "row 2, column el_deg: 'x' is not a number"),
    ('az_deg,el_deg\n3,nan\n', [], "row 2, column el_deg: 'nan' is no angle"),
    ('az_deg,el_deg\n1,\n', [], "column el_deg: 'empty' is no angle"),
    ('az_deg,el_deg\n1,195\n', [], "'195' is no such angle"),
    ('az_deg,el_deg\n1,0.2\n2,0.5\n3,1.2\n', [], 'look like radians'),
    ('az_deg,el_deg\n1,2,3\n', [], 'row 2: 3 cells, but the header has 2'),
    ('az_deg,az_deg,el_deg\n1,2,3\n', [], "'az_deg' is there twice"),
    ('', [], 'is empty'),
    ('az_deg,el_deg\n1,2\n', ['--zero', '7'], 'no zero of run 7; it has: 1, 2'),
    ('az_deg,el_deg\n1,2\n', ['--zero', 'last'], 'write newest, none or the number'),
    ('az_deg,el_deg\n1,2\n', ['--set', 'temperature_c'], 'write COLUMN=VALUE'),
    ('az_deg,el_deg\n1,2\n', ['--time', 'soon'], 'neither ISO 8601'),
    ('az_deg,el_deg,run\n1,2,5\n', [], 'no zero of run 5'),
])
def test_bad_input_is_one_line(refused, model, tmp_path, text, options, words):
    given = tmp_path / 'in.csv'
    given.write_text(text)
    assert words in refused('apply', model[0], given, *options)


def test_directions_out_of_reach_are_said(ended, tmp_path):
    PointingModel({'CA': 3600.0 * ARCSEC}).save(tmp_path / 'm.yaml')
    given = tmp_path / 'in.csv'
    given.write_text('az_deg,el_deg\n1,45\n2,89.9\n')
    code, out, err = ended('apply', tmp_path / 'm.yaml', given)
    assert code == 0 and out.splitlines()[2] == '2,89.9,,'
    assert 'cells left empty in row 3' in err


def test_a_german_mount_with_its_counterweight_up_is_told(ended, tmp_path):
    path, given = tmp_path / 'german.json', tmp_path / 'there.csv'
    PointingModel({'IH': 1e-4}, mount=Mount.equatorial(0.54, 'german')).save(path)
    given.write_text('ha_deg,dec_deg\n20,30\n-20,30\n160,150\n')
    code, out, err = ended('apply', path, given)
    assert code == 0 and len(out.splitlines()) == 4
    assert 'counterweight up in row 3; ' in ' '.join(err.split())
    given.write_text('ha_deg,dec_deg\n20,30\n160,150\n')
    assert ended('apply', path, given)[2] == ''


@pytest.mark.parametrize('mount, names', [
    (Mount.equatorial(0.54, 'german'), ('ha', 'dec')),
    (Mount.equatorial(-0.54, 'german'), ('ha', 'dec')), (Mount.free(0.3, 0.2), ('axis1', 'axis2'))])
def test_the_second_axis_may_have_its_whole_travel(ended, tmp_path, mount, names):
    path, given = tmp_path / 'model.json', tmp_path / 'there.csv'
    made = PointingModel(dict.fromkeys(mount.names.physical, 40.0 * ARCSEC), mount=mount)
    made.save(path)
    pair, read = [f'{name}_deg' for name in names], [f'{name}_enc_deg' for name in names]
    angles = [(30, 190), (70, 230), (120, 269)]
    turned = made.sky_to_encoder(*np.array(angles).T * DEG - [[0.0], [2.0 * np.pi]])
    expected = np.array(turned).T / DEG + [0.0, 360.0]
    for columns, to, rows, back, options in ((pair, read, angles, expected, []), (
            read, pair, expected.tolist(), angles, ['--reverse'])):
        given.write_text(','.join(columns) + '\n' + ''.join(f'{a!r},{b!r}\n' for a, b in rows))
        code, out, _ = ended('apply', path, given, *options)
        got = [[float(row[name]) for name in to] for row in table(out)]
        assert code == 0
        np.testing.assert_allclose(got, back, atol=1e-8)
    given.write_text(','.join(pair) + '\n30,271\n30,60\n30,61\n')
    assert "'271' is no such angle in degrees" in ended('apply', path, given)[2]


PLAIN = 'time,az_deg,el_deg,run\n' + ''.join(
    f'2026-01-15T13:0{i}:00Z,{10.5 + i},{45.25 + i},2\n' for i in range(5))


def test_a_column_run_without_zeros_is_noted(ended, tmp_path):
    given, path = tmp_path / 'in.csv', tmp_path / 'model.json'
    PointingModel(TERMS).save(path)
    given.write_text('az_deg,el_deg,run\n10,45,1\n20,50,2\n')
    code, _, err = ended('apply', path, given)
    assert code == 0 and 'the column run is not used: the model carries no zeros' in err
    assert ended('apply', path, given, '--zero', 'none')[2] == ''
    PointingModel(TERMS, provenance={'zeros_of_runs': [
        {'run': 2, 'az_arcsec': 0.0, 'el_arcsec': 0.0}, {**ZEROS[0]}]}).save(path)
    code, out, err = ended('apply', path, given)
    assert code == 0 and 'run 1: azimuth +100.00, elevation -50.00' in err
    given.write_text('az_deg,el_deg\n20,50\n10,45\n')
    newest, again = table(ended('apply', path, given)[1]), table(out)
    assert newest[0]['az_enc_deg'] == again[1]['az_enc_deg']
    assert float(again[0]['az_enc_deg']) - float(newest[1]['az_enc_deg']) == pytest.approx(
        100.0 / 3600.0, abs=1e-9)
    assert ended('apply', path, given)[2] == ''  # its indices have the newest


@pytest.mark.parametrize('line, said', [
    ('2026-01-15T13:09:00Z,1x,45,2', "az_deg '1x' is not a number"),
    ('2026-01-15T13:09:00Z,,45,2', "az_deg 'empty' is no angle"),
    ('2026-01-15T13:09:00Z,10,5,45,2', '5 cells, but the header has 4'),
    ('2026-01-15T13:09:00Z,10,205,2', "el_deg '205' is no such angle in degrees"),
    ('at nine,10,45,2', "time 'at nine' is neither ISO 8601")])
def test_a_bad_row_of_directions_stays_empty_and_is_named(ended, model, tmp_path, line, said):
    given = tmp_path / 'in.csv'
    given.write_text(PLAIN + line + '\n')
    code, out, err = ended('apply', model[0], given)
    *rows, last = table(out)
    assert code == 0 and f'cells left empty in row 7: {said}' in ' '.join(err.split())
    assert last['az_enc_deg'] == last['el_enc_deg'] == ''
    given.write_text(PLAIN)
    assert rows == table(ended('apply', model[0], given)[1])


def test_directions_with_semicolons_and_decimal_commas_or_in_utf_16(ended, model, tmp_path):
    given, path = tmp_path / 'in.csv', model[0]
    given.write_text(PLAIN)
    _, plain, _ = ended('apply', path, given)
    given.write_bytes(PLAIN.replace(',', ';').replace('.', ',').encode('utf-16'))
    code, out, _ = ended('apply', path, given)
    assert code == 0 and out.replace(',', '.').replace(';', ',') == plain


def test_cells_that_a_spreadsheet_would_run_are_made_harmless(ended, model, tmp_path):
    given = tmp_path / 'in.csv'
    given.write_text('az_deg,el_deg,note\n10,45,=1+1\n20,50,"-2, -3"\n')
    _, out, _ = ended('apply', model[0], given)
    assert [row['note'] for row in table(out)] == ["'=1+1", "'-2, -3"]


@pytest.mark.parametrize('kind', ['altaz', 'german'])
def test_places_of_the_sky_with_and_without_the_model(ended, tmp_path, kind):
    from msg_tools.iso_time import iso_seconds
    from pointing_model.mounts import ALTAZ
    from pointing_model.sky.places import icrs_to_observed
    from pointing_model.sky.refraction import Weather
    from pointing_model.sky.site import Site
    mount = ALTAZ if kind == 'altaz' else Mount.equatorial(34.3 * DEG, 'german')
    made = PointingModel({mount.names.index[0]: 412.0 * ARCSEC, mount.names.named('CA'): 1e-4},
                         mount=mount)
    made.save(tmp_path / 'm.json')
    given = tmp_path / 'in.csv'
    given.write_text('name,time,ra_deg,dec_deg,temperature_c\n'
                     'Vega,2026-07-15T13:00:00Z,279.2347,38.7837,20\n'
                     'Arcturus,2026-07-15T13:30:00Z,213.9153,19.1824,\n')
    code, out, err = ended('apply', tmp_path / 'm.json', given, '--latitude', '34.3',
                           '--longitude', '109', '--pressure', '900')
    assert code == 0 and err == ('note: refraction for 900 hPa, 10 C, or temperature_c of the row '
                                 'where the file has it\n')
    rows = table(out)
    weather = Weather(900.0, np.array([20.0, 10.0]))
    az, el = icrs_to_observed(
        np.array([279.2347, 213.9153]) * DEG, np.array([38.7837, 19.1824]) * DEG,
        np.array([iso_seconds('2026-07-15T13:00:00Z'), iso_seconds('2026-07-15T13:30:00Z')]),
        Site(34.3 * DEG, 109.0 * DEG, 0.0), weather)
    first, second = (az, el) if kind == 'altaz' else mount.axes_of(az, el)
    if kind == 'german':  # the counterweight is down: Vega is in the east
        assert first[0] < 0.0 < first[1]
        first, second = mount.on_travel(*mount.axes_of(az, el, first < 0.0))
        assert [float(row['dec_observed_deg']) > 90.0 for row in rows] == [True, False]
    one, other = mount.names.columns
    reading = made.sky_to_encoder(first, second)
    for got, wanted in ((f'{one}_observed_deg', first), (f'{other}_observed_deg', second),
                        (f'{one}_enc_deg', reading[0]), (f'{other}_enc_deg', reading[1])):
        np.testing.assert_allclose([float(row[got]) for row in rows], wanted / DEG, atol=1e-9)
    if kind == 'german':  # on the side that the file says
        given.write_text('time,ra_deg,dec_deg,pier_side\n'
                         '2026-07-15T13:00:00Z,279.2347,38.7837,east\n')
        row, = table(ended('apply', tmp_path / 'm.json', given, '--longitude', '109')[1])
        assert float(row['dec_observed_deg']) < 90.0
        given.write_text('time,ra_deg,dec_deg,pier_side\n' + ''.join(
            f'2026-07-15T13:00:00Z,279.2347,38.7837,{side}\n' for side in (0, 1, -1, '')))
        sides = table(ended('apply', tmp_path / 'm.json', given, '--longitude', '109')[1])
        assert [float(row['dec_observed_deg']) > 90.0 for row in sides] == [
            False, True, True, True]  # unknown: with the counterweight down


def test_a_table_of_the_axes_is_on_the_side_that_it_says(ended, tmp_path):
    """Places and readings are then those of the sky, as in a run; through the pole and back."""
    mount = Mount.equatorial(48.0 * DEG, 'german')
    values = dict(zip(mount.names.physical, np.array([60, -40, 35, -20, 45, -70, 20]) * ARCSEC))
    made = PointingModel(values, mount=mount)
    made.save(tmp_path / 'm.json')
    given, back = tmp_path / 'in.csv', tmp_path / 'back.csv'
    given.write_text('ha_deg,dec_deg,pier_side\n30,20,west\n30,20,east\n-30,20,pierWest\n'
                     '-30,20,\n210,160,west\n')
    code, out, err = ended('apply', tmp_path / 'm.json', given)
    assert code == 0 and '2 of 5 rows are through the pole (pier_side)' in err
    rows = table(out)
    read = np.array([[float(row[f'{axis}_enc_deg']) for axis in ('ha', 'dec')] for row in rows])
    at = np.array([(210, 160), (30, 20), (150, 160), (-30, 20), (210, 160)]) * DEG
    wanted = np.array(made.sky_to_encoder(*at.T))
    folded = np.array(through_pole(*wanted, [True, False, True, False, False])).T / DEG
    assert np.abs(wrap((read - folded) * DEG)).max() < 1e-12
    back.write_text('ha_enc_deg,dec_enc_deg,pier_side\n' + ''.join(
        f'{one!r},{other!r},{row["pier_side"]}\n' for (one, other), row in zip(
            read.tolist(), rows)))
    again = table(ended('apply', tmp_path / 'm.json', back, '--reverse')[1])
    for row, first in zip(again, rows):
        assert [float(row[f'{axis}_deg']) for axis in ('ha', 'dec')] == pytest.approx(
            [float(first[f'{axis}_deg']) for axis in ('ha', 'dec')], abs=1e-9)


def test_right_ascensions_that_may_be_hours_are_named(ended, model, tmp_path):
    given = tmp_path / 'in.csv'
    given.write_text('time,ra_deg,dec_deg\n' + ''.join(
        f'2026-07-15T13:00:00Z,{hours},60\n' for hours in range(0, 24, 3)))
    place = ('--latitude', '70', '--longitude', '109')
    assert 'never exceeds 21: taken as degrees; are these hours?' in ended(
        'apply', model[0], given, *place)[2]


def test_the_air_of_places_of_the_sky_is_that_of_the_height(ended, model, tmp_path):
    given = tmp_path / 'in.csv'
    given.write_text('time,ra_deg,dec_deg\n2026-07-15T13:00:00Z,279.2347,38.7837\n')
    place = ('--latitude', '34.3', '--longitude', '109')

    def elevation(*options):
        code, out, err = ended('apply', model[0], given, *place, *options)
        assert code == 0 and 'refraction for' in err
        return float(table(out)[0]['el_observed_deg'])
    assert elevation('--height', '2400') == pytest.approx(
        elevation('--height', '2400', '--pressure', '756.26'), abs=1e-6)
    assert elevation() > elevation('--height', '2400') + 1e-3


def test_comments_above_a_table_of_directions_declare(ended, model, tmp_path):
    given, row = tmp_path / 'in.csv', '2026-07-15T13:00:00Z 279.2347  38.7837\n'

    def place(comments, *options):
        given.write_text(f'{comments}time ra_deg dec_deg\n{row}')
        code, out, err = ended('apply', model[0], given, *options)
        assert code == 0
        return [float(word) for word in out.splitlines()[-1].split()[3:5]], err
    site = ('--latitude', '34.3', '--longitude', '109', '--height', '2400')
    declared = '# latitude_deg: 34.3\n# longitude_deg: 109\n# height_m: 2400\n'
    wanted, err = place('', *site, '--equinox', 'date', '--pressure', '700')
    assert 'the table declares' not in err and wanted == place(
        f'{declared}# frame: of date\n# pressure_hpa: 700\n')[0]
    other, err = place(f'{declared}# frame: of date\n', '--equinox', 'j2000', '--longitude', '110')
    assert 'places read as ICRS, although the table declares of date' in err
    assert 'longitude 110 degrees used, although the file declares 109' in err
    assert abs(other[0] - wanted[0]) > 0.01


@pytest.mark.parametrize('text, options, words', [
    ('ra_deg,dec_deg\n1,2\n', ['--latitude', '5', '--longitude', '5'], 'need the time'),
    ('ra_deg,dec_deg\n1,2\n', ['--time', '2026-01-15T13:00:00Z'], 'need the site'),
    ('ra_deg,dec_deg\n1,95\n', ['--time', '2026-01-15T13:00:00Z'], "'95' is no such angle"),
    ('az_deg,el_deg\n1,2\n', ['--equinox', 'date'], 'apply to ra_deg'),
    ('az_deg,el_deg\n1,2\n', ['--pressure', '700'], 'apply to ra_deg'),
    ('# mount: german\naz_deg,el_deg\n1,2\n', [], 'is a model of an alt-azimuth mount'),
    ('# frame: tomorrow\naz_deg,el_deg\n1,2\n', [], "row 1: frame 'tomorrow' is unknown"),
])
def test_places_of_the_sky_need_time_and_site(refused, model, tmp_path, text, options, words):
    given = tmp_path / 'in.csv'
    given.write_text(text)
    assert words in refused('apply', model[0], given, *options)
