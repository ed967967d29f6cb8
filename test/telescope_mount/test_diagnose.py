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

"""The command `diagnose` on files."""

import json
from pathlib import Path

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run
from telescope_mount.cli import main

KEYS = {'observations', 'runs', 'base_terms', 'verdict', 'before', 'after', 'noise_floor_arcsec',
        'effects', 'excluded', 'next_observations', 'wander', 'detectable', 'expected',
        'rows_read', 'rows_used', 'outliers', 'rms_with_outliers_arcsec', 'columns_alike',
        'readings', 'as_read_rms_arcsec', 'unequal_scatter', 'worst_rows', 'held_out', 'no_star',
        'unequal_axes',
        'unphysical', 'approach_from', 'rows_are', 'rows_taken_back', 'rows_not_drawn',
        'detection_factor', 'as_read_terms', 'south',
        'equinox', 'cv_contiguous', 'notes'}
RMS = {'rms_arcsec', 'rms_x_arcsec', 'rms_y_arcsec', 'cv_rms_arcsec', 'cv_rms_x_arcsec',
       'cv_rms_y_arcsec', 'cv_spread', 'holdout_rms_arcsec'}
EFFECT = {'name', 'tpoint', 'driver', 'axes', 'coefficients_arcsec', 'sigma_arcsec', 'p_family',
          'delta_bic', 'alternatives', 'cv_gain_arcsec', 'causes', 'contenders',
          'removes_rms_arcsec'}


def night(path, seed, effect=0.0, n=60):
    """A run whose azimuth reads `effect` arcsec differently by the side it came from."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    model = PointingModel({'IA': 80 * ARCSEC, 'IE': 30 * ARCSEC, 'CA': 20 * ARCSEC})
    az_enc, el_enc = model.sky_to_encoder(az, el)
    side = rng.choice([-1.0, 1.0], n)
    x, y = rng.normal(size=(2, n)) * ARCSEC
    write_csv(PointingRun({
        'az': az, 'el': el, 'az_enc': az_enc + effect * side * ARCSEC + x / np.cos(el),
        'el_enc': el_enc + y, 'approach_az': side, 'approach_el': np.ones(n),
        'time': 1.7e9 + 60.0 * np.arange(n)}), path)
    return str(path)


@pytest.fixture(scope='module')
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp('diagnose')
    run, later = night(folder / 'a.csv', 1, 8.0), night(folder / 'b.csv', 2, 8.0)
    code = main(['diagnose', run, '--holdout', later, '--json', str(folder / 'd.json'),
                 '--report', str(folder / 'd.html'), '--save', str(folder / 'm.json')])
    assert code == 0
    return folder


def test_the_result_has_its_keys_and_the_effect(found):
    result = json.loads((found / 'd.json').read_text())
    assert set(result) == KEYS
    assert set(result['before']) == set(result['after']) == RMS
    assert result['verdict'] == 'identified'
    assert set(result['effects'][0]) == EFFECT
    first = result['effects'][0]
    assert any('azimuth_hysteresis' in name for name in (first['name'], *first['alternatives']))
    held = [result[part]['holdout_rms_arcsec'] for part in ('after', 'before')]
    assert held[0] < 1.7 < 3.0 < held[1]


def test_the_page_and_the_model_are_written(found):
    page = (found / 'd.html').read_text()
    assert page.lstrip().lower().startswith('<!doctype html') and '://' not in page
    model = PointingModel.load(found / 'm.json')
    here = model.offsets(1.0, 0.7, context={'approach_az': 1.0})[0]
    there = model.offsets(1.0, 0.7, context={'approach_az': -1.0})[0]
    assert float(here - there) / ARCSEC == pytest.approx(16.0 * np.cos(0.7), abs=2.5)


def test_a_clean_run_is_left_alone(tmp_path, capsys):
    assert main(['diagnose', night(tmp_path / 'clean.csv', 5)]) == 0
    out = capsys.readouterr().out
    assert 'No significant error beyond the 7-term model of an alt-azimuth mount.' in out
    assert 'No significant error beyond the seven terms' not in out


def test_a_column_that_is_left_out_whole_is_a_caution(tmp_path, capsys):
    run = tmp_path / 'clean.csv'
    night(run, 5)
    head, *rows = run.read_text().split()
    run.write_text('\n'.join([f'{head},temperature_c', *(
        f'{row},{288.0 + 0.01 * k:.2f}' for k, row in enumerate(rows))]))
    for command in 'diagnose', 'fit':
        assert main([command, str(run)]) == 0
        text = ' '.join(capsys.readouterr().out.split())
        assert 'caution: temperature_c is outside -90 to 60 degrees Celsius in all rows' in text
        assert 'looks like kelvin (subtract 273.15): the whole column is' in text
        assert 'it is empty' not in text


def test_rows_left_out_and_every_judgement_are_printed(tmp_path, capsys):
    path = Path(night(tmp_path / 'run.csv', 3, 8.0))
    lines = path.read_text().splitlines()
    column = lines[0].split(',').index('az_enc_deg')
    for k in (5, 6, 7, 20):  # numbers in the file are one more
        cells = lines[k].split(',')
        lines[k] = ','.join([*cells[:column], 'nan', *cells[column + 1:]])
    path.write_text('\n'.join(lines) + '\n')
    assert main(['diagnose', str(path), '--verbose']) == 0
    out = capsys.readouterr().out
    assert 'lines 6-8, 21 left out: ' in out and out.count('left out: ') == 2
    assert 'cross-validated, effects re-selected per fold' in out
    assert 'cross-validated in blocks of time' in out and 'fit residuals' in out
    # nothing is cut short, whatever the width
    assert '…' not in out


@pytest.mark.usefixtures('short_diagnosis')
def test_days_in_one_file_are_told_apart(tmp_path, capsys):
    path = night(tmp_path / 'days.csv', 4, n=80)
    run = read_run(path)
    run.columns['time'] = run['time'] + 86400.0 * (np.arange(80) // 20)
    run.columns['az_enc'] = run['az_enc'] + 30.0 * ARCSEC * np.array([0, 1, -2, 3])[
        np.arange(80) // 20]
    write_csv(run, path)
    for option in ([], ['--sessions', '3']):
        assert main(['diagnose', path, *option, '--json', str(tmp_path / 'd.json'),
                     '--overwrite', '--verbose']) == 0
        out = capsys.readouterr().out
        assert 'No significant error beyond the seven terms of' in ' '.join(out.split())
        assert 'days.csv: 4 sessions, at gaps of more than 3 h' in out
        result = json.loads((tmp_path / 'd.json').read_text())
        assert result['runs'] == 4 and result['before']['rms_arcsec'] < 1.6


def rewritten(path, change, names=('az_deg', 'el_deg', 'az_enc_deg', 'el_enc_deg')):
    """The file with the cells of some columns changed: row number, numbers -> numbers."""
    path = Path(path)
    lines = [line.split(',') for line in path.read_text().splitlines()]
    places = [lines[0].index(name) for name in names]
    for i, cells in enumerate(lines[1:]):
        for place, value in zip(places, change(i, *(float(cells[p]) for p in places))):
            cells[place] = repr(value)
    path.write_text('\n'.join(map(','.join, lines)) + '\n')
    return str(path)


@pytest.mark.parametrize('change, said', [
    (lambda i, a, e, a_enc, e_enc: (e, a % 360.0, e_enc, a_enc % 360.0),
     'azimuth and elevation of catalogue and encoders exchanged (5.'),
    (lambda i, a, e, a_enc, e_enc: (3600 * a, 3600 * e, 3600 * a_enc, 3600 * e_enc),
     '0 of 60 rows can be used as written, and do not fit. Read otherwise they fit: azimuth and '
     'elevation of catalogue and encoders in arcseconds (5.'),
    (lambda i, a, e, a_enc, e_enc: (a, e, (a_enc - a + 180.0) % 360.0 - 180.0, e_enc - e),
     "offsets in place of the encoders' readings, in degrees, encoder - catalogue (5."),
])
def test_mistaken_columns_are_one_line_and_a_result_without_effects(
        tmp_path, capsys, change, said):
    run = rewritten(night(tmp_path / 'run.csv', 1, 8.0), change)
    for command in (['diagnose', run, '--json', str(tmp_path / 'd.json')], ['fit', run]):
        assert main(command) == 2
        out, err = capsys.readouterr()
        assert out == '' and err.startswith('error: run.csv: the columns are not what')
        assert said in err and err.count('\n') == 1
    result = json.loads((tmp_path / 'd.json').read_text())
    assert set(result) == KEYS and set(result['before']) == RMS
    assert result['verdict'] == 'refused' and result['effects'] == []
    assert result['readings'][0]['rms_arcsec'] < 6.0 and result['rows_read'] == 60


def test_an_outlier_is_named_by_its_line_and_does_not_set_the_headline(tmp_path, capsys):
    run = rewritten(night(tmp_path / 'run.csv', 1), lambda i, e: (e + 0.47 * (i == 28),),
                    ['el_enc_deg'])
    for command in (['diagnose', run], ['fit', run]):
        assert main(command) == 0
        out = capsys.readouterr().out
        first = out.startswith('first answer, not yet validated: no effect found; fit RMS')
        assert first == (command[0] == 'diagnose') and '59 of 60 rows used' in out
        assert '1 outlier excluded: line 30 (169' in out
        assert '218.' not in out.replace('with it 218.', '')


@pytest.mark.usefixtures('short_diagnosis')
def test_above_a_third_left_out_is_no_result(tmp_path, capsys):
    run = rewritten(night(tmp_path / 'run.csv', 1, 8.0),
                    lambda i, e: (float('nan') if i % 5 < 2 else e,), ['el_enc_deg'])
    assert main(['diagnose', run, '--json', str(tmp_path / 'd.json'),
                 '--report', str(tmp_path / 'd.html')]) == 2
    out = capsys.readouterr().out
    assert '\n36 of 60 rows used; ' in out and 'no effect is claimed' in out
    result = json.loads((tmp_path / 'd.json').read_text())
    assert (result['verdict'], result['effects']) == ('refused', [])
    assert (result['rows_used'], result['rows_read']) == (36, 60)
    assert '36 of 60 rows used' in (tmp_path / 'd.html').read_text()
    assert main(['fit', run]) == 0
    assert 'more than a third of the rows is left out' in capsys.readouterr().out


@pytest.mark.parametrize('arguments, text', [
    (['{run}', '--sessions', '-1'], 'gaps of -1 h'),
    (['{run}', '--graduation', 'grating=27.5'], 'number of lines'),
    (['{run}', '--worm', 'ha=180'], 'no axis ha; its axes are az (azimuth)'),
    (['{run}', '--graduation', 'dec.grating=47200'], 'no axis dec; its axes are az (azimuth)'),
    (['{run}', '--cause', 'wind'], 'no column wind'),
    (['nowhere.csv'], 'No such file'),
    (['{run}', '--base', 'magic'], 'magic'),
    (['{run}', '--report', 'page.txt'], 'must end in .html'),
    (['{run}', '--json', '/nowhere/at/all.json'], 'no such folder'),
    (['{bad}'], 'bad.csv'),
])
def test_bad_input_is_one_line_and_code_2(tmp_path, capsys, arguments, text):
    run = night(tmp_path / 'run.csv', 1, n=20)
    (tmp_path / 'bad.csv').write_text('az_deg,el_deg,az_enc_deg,el_enc_deg\n1,2,x,4\n')
    places = {'run': run, 'bad': str(tmp_path / 'bad.csv')}
    assert main(['diagnose', *(word.format(**places) for word in arguments)]) == 2
    err = capsys.readouterr().err
    assert err.startswith('error: ') and err.count('\n') == 1 and text in err
