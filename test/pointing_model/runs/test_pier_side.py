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

"""The column of the side of the pier: its cells, sides that are not known, the other convention."""


import numpy as np
import pytest
from places import CASES

from calibration.analysis.diagnosis.mistaken_columns import MistakenColumns, check_columns
from calibration.analysis.sky_model import origin_of_errors
from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.mounts import Mount, is_beyond, through_pole
from pointing_model.runs.run_reader import read_run

GERMAN = Mount.equatorial(48.0 * DEG, 'german')
TRUE = dict(zip(GERMAN.names.physical, (60.0, -40.0, 35.0, -20.0, 45.0, -70.0, 20.0)))
HEAD = ('# mount: german\n# latitude_deg: 48\n'
        'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg,pier_side\n')


def case(name):
    path = CASES / name
    if not path.is_file():
        pytest.skip(f'no {name} beside the project')
    return path


@pytest.fixture
def read(tmp_path):
    def work(sides):
        path = tmp_path / 'run.csv'
        rows = [','.join(f'{v:.8f}' for v in row) for row in folded(len(sides))[0]]
        path.write_text(HEAD + '\n'.join(f'{row},{side}' for row, side in zip(rows, sides)))
        return read_run(path)
    return work


def folded(n=60, seed=1, noise=1.0):
    """Rows of hour angles and declinations as on the sky, and the sides they were read on."""
    rng = np.random.default_rng(seed)
    ha, dec = rng.uniform(-70.0, 70.0, n) * DEG, rng.uniform(-5.0, 80.0, n) * DEG
    ha[:2] = -0.5, 0.6  # on both sides
    beyond = ha < 0.0
    at = through_pole(ha, dec, beyond)
    az, el = geometry.sky_to_encoder(*at, {k: v * ARCSEC for k, v in TRUE.items()}, GERMAN)
    az = az + rng.normal(0.0, noise, n) * ARCSEC / np.abs(np.cos(el))
    el = el + rng.normal(0.0, noise, n) * ARCSEC
    return np.array([ha, dec, *through_pole(az, el, beyond)]).T / DEG, beyond


def right(run):
    """Whether the terms of a fit are the true ones within 4 sigma."""
    result = fit_terms(run)
    off = [(result.model.terms[name] / ARCSEC - TRUE[name]) for name in TRUE]
    return bool(np.all(np.abs(off) < 4.0 * result.sigma / ARCSEC))


@pytest.mark.parametrize('west, east', [
    ('west', 'east'), ('W', 'E'), ('pierWest', 'pierEast'), ('PIERWEST', 'Pier East'),
    (' West ', 'east '), ('1', '0'), ('1.0', '0.0'), ('-1', '1')])
def test_words_and_numbers_of_the_side_are_read(read, west, east):
    beyond = folded()[1]
    run = read([west if b else east for b in beyond])
    assert np.array_equal(is_beyond(run['el']), beyond) and right(run)


@pytest.mark.parametrize('west, east, unknown', [
    ('pierWest', 'pierEast', 'pierUnknown'), ('west', 'east', 'unknown'), ('w', 'e', ''),
    ('1', '0', '-1'), ('pierWest', 'pierEast', '-1'), ('-1', '1', '')])
def test_rows_of_an_unknown_side_are_placed_as_the_others_are(read, west, east, unknown):
    beyond = folded()[1]
    sides = [west if b else east for b in beyond]
    sides[5::7] = [unknown] * len(sides[5::7])
    run = read(sides)
    assert np.array_equal(is_beyond(run['el']), beyond) and right(run)
    assert any('8 of 60 rows: set by the hour angle in 8' in note for note in run.meta['notes'])


@pytest.mark.parametrize('head, refused', [
    ('', True), ('# mount: german\n', True), ('# mount: equatorial\n', False)])
def test_a_german_mount_folded_without_sides_is_not_taken_for_a_fork(tmp_path, head, refused):
    """Refused, unless the file says that it is a fork: it may flop at the meridian."""
    path = tmp_path / 'run.csv'
    path.write_text(f'{head}# latitude_deg: 48\nha_deg,dec_deg,ha_enc_deg,dec_enc_deg\n' + ''.join(
        ','.join(f'{v:.8f}' for v in row) + '\n' for row in folded()[0]))
    run = read_run(path)
    if refused:
        with pytest.raises(MistakenColumns, match='a German mount, .*give --mount german'):
            check_columns(run)
        return
    assert not check_columns(run).findings


@pytest.mark.parametrize('unknown', ['1', '-1'])
def test_ones_without_a_zero_are_what_keeps_the_counterweight_down(tmp_path, unknown):
    rows, beyond = folded(120)
    east = rows[beyond]
    sides = ['1'] * len(east)
    sides[3::9] = [unknown] * len(sides[3::9])
    path = tmp_path / 'run.csv'
    path.write_text(HEAD + ''.join(','.join(f'{v:.8f}' for v in row) + f',{side}\n'
                                   for row, side in zip(east, sides)))
    run = read_run(path)  # ASCOM's west
    assert is_beyond(run['el']).all() and right(run)
    assert any('read as in ASCOM' in note for note in run.meta['notes'])
    path.write_text(HEAD + ''.join(','.join(f'{v:.8f}' for v in row) + ',1\n'
                                   for row in rows[~beyond]))
    run = read_run(path)
    assert not is_beyond(run['el']).any() and right(run)
    assert not any('ASCOM' in note for note in run.meta['notes'])


def test_rows_of_an_unknown_side_are_left_out_by_name_where_no_rule_tells_it(read):
    rng = np.random.default_rng(3)
    sides = ['west' if b else 'east' for b in rng.random(60) < 0.5]
    sides[4] = 'unknown'
    run = read(sides)
    assert len(run) == 59
    assert run.meta['excluded'] == [{'row': 8, 'reason': 'pier_side is unknown'}]


def test_near_the_meridian_where_both_sides_are_seen_none_is_guessed(read):
    beyond = folded()[1]
    sides = ['west' if b else 'east' for b in beyond]
    sides[0], sides[1] = 'unknown', 'west'  # half a degree east, and 0.6 west the wrong way
    run = read(sides)
    assert [row['row'] for row in run.meta['excluded']] == [4]


@pytest.mark.parametrize('sides, words', [
    (['unknown', ''], 'unknown in every row'), (['west', 'up'], 'holds up'),
    (['west', '1'], 'holds 1'), (['2', '1'], 'holds 1, 2')])
def test_other_cells_are_refused(read, sides, words):
    with pytest.raises(ValueError, match=words):
        read(sides)


def test_the_other_convention_is_said(read):
    beyond = folded()[1]
    run = read(['east' if b else 'west' for b in beyond])
    assert any('counterweight up in every row' in note for note in run.meta['notes'])
    run = read(['west' if b else 'east' for b in beyond])
    assert not any('counterweight' in note for note in run.meta['notes'])


def test_one_side_in_every_row_on_both_sides_of_the_meridian_is_said(read):
    run = read(['east'] * 60)
    assert run.meta['notes'][0].startswith('pier_side is east in every row')
    assert 'leave the column out' in run.meta['notes'][0]


def test_readings_with_the_counterweight_up_in_every_row_are_said(tmp_path):
    rows, beyond = folded()
    path = tmp_path / 'run.csv'
    for sign in (1.0, -1.0):  # hour angles that count westward, and eastward
        read = np.array(through_pole(rows[:, 2] * DEG, rows[:, 3] * DEG, beyond)).T / DEG
        both = np.column_stack((sign * rows[:, 0], rows[:, 1], sign * read[:, 0], read[:, 1]))
        path.write_text(HEAD.replace(',pier_side', '') + ''.join(
            ','.join(f'{v:.8f}' for v in row) + '\n' for row in both))
        notes = read_run(path).meta['notes']
        assert any('count eastward' in note for note in notes) == (sign < 0.0)


@pytest.mark.parametrize('part', [slice(None), 'beyond'])
def test_offsets_on_the_sky_are_read_on_both_sides_of_the_pier(tmp_path, part):
    rows, beyond = folded(90)
    if part == 'beyond':
        rows, beyond = rows[beyond], beyond[beyond]
    x = (rows[:, 2] - rows[:, 0] + 180.0) % 360.0 - 180.0
    offsets = 3600.0 * x * np.cos(rows[:, 1] * DEG), 3600.0 * (rows[:, 3] - rows[:, 1])
    path = tmp_path / 'run.csv'
    path.write_text(HEAD.replace('ha_enc_deg,dec_enc_deg', 'x_arcsec,y_arcsec') + ''.join(
        f'{ha:.8f},{dec:.8f},{x:.6f},{y:.6f},{"west" if west else "east"}\n'
        for (ha, dec, *_), x, y, west in zip(rows, *offsets, beyond)))
    run = read_run(path)
    assert len(run) == len(rows) and not run.meta.get('excluded') and right(run)


def test_rows_with_the_side_of_before_do_not_judge_whose_the_errors_are(read):
    beyond = folded()[1]
    sides = np.where(beyond, 'west', 'east')
    stale = np.arange(60) % 10 == 3
    sides[stale] = np.where(beyond[stale], 'east', 'west')
    origin = origin_of_errors(read(sides))
    assert origin.holds == 'mount' and origin.rows == 54
    assert origin.left_out['mount'] < 2.0 * ARCSEC < 20.0 * ARCSEC < origin.left_out['sky']


def near_the_pole(kind, latitude=48.0, index=4000.0, sides=(False,)):
    """Rows of angles of the axes, five of them so near to the pole that most read beyond it."""
    rng, mount = np.random.default_rng(5), Mount.equatorial(latitude * DEG, kind)
    ha, dec = rng.uniform(-70.0, 70.0, 45) * DEG, rng.uniform(-5.0, 80.0, 45) * DEG
    ha[:5] = np.array([-100.0, -30.0, 20.0, 90.0, 150.0]) * DEG
    dec[:5] = np.array([89.3, 88.95, 89.27, 89.2, 89.5]) * DEG
    dec *= np.sign(latitude)
    beyond = np.resize(sides, 45)
    at = np.array(through_pole(ha, dec, beyond))
    terms = {**TRUE, 'ID': index}
    reads = np.array(geometry.sky_to_encoder(*at, {k: v * ARCSEC for k, v in terms.items()}, mount))
    return np.array([ha, dec, *reads]).T / DEG, beyond, terms


def terms_are(run, terms):
    result = fit_terms(run)
    return not len(result.rejected) and np.allclose(
        [result.model.terms[name] / ARCSEC for name in terms], list(terms.values()), atol=0.2)


@pytest.mark.parametrize('kind, latitude, index, sides', [
    ('equatorial', 48.0, 4000.0, [False]), ('equatorial', -33.0, -4000.0, [False]),
    ('german', 48.0, 4000.0, [False]), ('german', 48.0, -4000.0, [True]),
    ('german', 48.0, 4000.0, [True, False]), ('german', -33.0, -4000.0, [False, True])])
def test_near_the_pole_an_index_error_puts_no_reading_beyond_it(
        tmp_path, kind, latitude, index, sides):
    rows, beyond, terms = near_the_pole(kind, latitude, index, sides)
    assert (is_beyond(rows[:, 3] * DEG) != beyond).sum() > 1
    path = tmp_path / 'run.csv'
    path.write_text(HEAD.replace('german', kind).replace('48', str(latitude)).replace(
        ',pier_side', '') + ''.join(','.join(f'{v:.8f}' for v in row) + '\n' for row in rows))
    run = read_run(path)
    assert np.array_equal(is_beyond(run['el']), beyond) and terms_are(run, terms)


def test_of_a_file_of_spk_too(tmp_path):
    rows, _, terms = near_the_pole('equatorial')
    path = tmp_path / 'run.dat'
    path.write_text('caption\nE\n48\n' + ''.join(
        ' '.join(f'{v:.8f}' for v in row) + '\n' for row in rows))
    run = read_run(path)
    assert run.mount.kind == 'equatorial' and terms_are(run, terms)
    rows, beyond, terms = near_the_pole('german', sides=[True, False])
    path.write_text('caption\nE\n48\n' + ''.join(
        ' '.join(f'{v:.8f}' for v in row) + '\n' for row in rows))
    run = read_run(path)
    assert run.mount.kind == 'german' and terms_are(run, terms)
    assert np.array_equal(is_beyond(run['el']), beyond)


def test_one_reading_a_little_beyond_the_pole_is_no_reason_to_leave_the_column_out(tmp_path):
    rows, beyond = folded()
    path = tmp_path / 'run.csv'
    path.write_text(HEAD + ''.join(
        ','.join(f'{v:.8f}' for v in row) + f',{"west" if west else "east"}\n'
        for row, west in zip(rows, beyond)) + '30,89.985,30.5,90.002,east\n')
    run = read_run(path)
    assert np.array_equal(is_beyond(run['el']), np.append(beyond, False)) and right(run)


def test_sides_unknown_and_stale_in_files():
    run = read_run(case('ger_pier_unknown.csv'))
    assert len(run) == 80 and right(run)
    run = read_run(case('ger_pier_stale6.csv'))
    result, origin = fit_terms(run), origin_of_errors(run)
    assert right(run)
    assert {12, 35, 46, 59, 62} < set(run.meta['lines'][result.rejected]) and len(
        result.rejected) == 6
    assert origin.rows == 74 and origin.left_out['mount'] < 1.6 * ARCSEC
