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

"""Tables as people and spreadsheets write them: a bad cell costs its row, a bad column the file."""

import csv
import io

import numpy as np
import pytest
from places import CASES

from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.columns.cells import plain_text, safe_text, write_rows
from pointing_model.runs.formats.csv import write_csv
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

TRUE = {'IA': 120, 'IE': -40, 'CA': 15, 'NPAE': -8, 'AN': 20, 'AW': 12, 'TF': 25}
HEADER = 'time,az_deg,el_deg,az_enc_deg,el_enc_deg'
ROWS = [(f'2026-03-03T12:0{i}:00Z', *(f'{v:.7f}' for v in (
    40 + 31 * i, 25 + 6 * i, 40.01 + 31 * i, 25.02 + 6 * i))) for i in range(8)]


def text_of(rows=ROWS, header=HEADER):
    return '\n'.join([header, *map(','.join, rows)]) + '\n'


PLAIN = text_of()
COMMAS = [(time, *(cell.replace('.', ',') for cell in cells)) for time, *cells in ROWS]


@pytest.mark.parametrize('text', [
    '\n'.join([HEADER.replace(',', ';'), *map(';'.join, COMMAS)]),
    '\n'.join([HEADER, *(','.join([row[0], *(f'"{c}"' for c in row[1:])]) for row in COMMAS)]),
    '\n'.join([HEADER.replace(',', '\t'), *map('\t'.join, COMMAS)]),
    'sep=;\r\n' + '\r\n'.join([HEADER.replace(',', ';'), *map(';'.join, COMMAS)]),
    ('\ufeff' + PLAIN).encode('utf-16-le'), ('\ufeff' + PLAIN).encode('utf-16-be'),
    '\ufeff' + PLAIN, PLAIN.replace('\n', ',,\n').replace(HEADER + ',,', HEADER),
    PLAIN.replace('Z,', ',').replace('T', ' '),
    '\n'.join([f'"{HEADER.replace(",", chr(34) + ";" + chr(34))}"', *map(';'.join, COMMAS)]),
    '\n'.join([HEADER.replace(',', ' '), *(f' {"   ".join(row)} ' for row in ROWS)]),
], ids=['semicolons', 'quoted', 'tabs', 'sep', 'utf-16-le', 'utf-16-be', 'bom', 'commas at the end',
        'blank in time', 'quoted names', 'blanks'])
def test_one_run_in_any_spreadsheets_dialect(read, text):
    run, plain = read(text), read(PLAIN)
    assert len(run) == 8 and not run.meta['excluded']
    for name in plain.columns:
        assert np.array_equal(run[name], plain[name]), name


@pytest.mark.parametrize('spoil, reason', [
    (lambda r: (r[0], '71.x', *r[2:]), "az_deg '71.x' is not a number"),
    (lambda r: (r[0], '"71,0"', *r[2:]), "az_deg '71,0' is not a number; other cells"),
    (lambda r: (r[0], '71', '0000000', *r[2:]), '6 cells, but the header has 5'),
    (lambda r: r[:4], '4 cells, but the header has 5'),
    (lambda r: (*r, '7'), '6 cells, but the header has 5'),
    (lambda r: (*r[:4], '"31.02'), 'a quoted cell does not end on its line'),
    (lambda r: ('2026-03-03T25:00:00Z', *r[1:]), "time '2026-03-03T25:00:00Z' is neither ISO"),
    (lambda r: ('1e9', *r[1:]), "time '1e9' is neither ISO"),
    (lambda r: ('1026-03-03', *r[1:]), "time '1026-03-03' is outside 1900 to 2100"),
    (lambda r: (r[0], 'nan', *r[2:]), 'az_deg is not a number'),
    (lambda r: (r[0], 'n/a', *r[2:]), 'az_deg is not a number')])
def test_a_bad_cell_costs_its_row(read, spoil, reason):
    run = read(text_of([spoil(row) if i == 1 else row for i, row in enumerate(ROWS)]))
    (left,) = run.meta['excluded']
    assert left['row'] == 3 and left['reason'].startswith(reason) and len(run) == 7
    assert run['az'] / DEG == pytest.approx([40 + 31 * i for i in range(8) if i != 1])


def test_a_bad_column_costs_the_file(refuse):
    for i, word in ((0, 'time'), (1, 'az_deg')):
        bad = [(*row[:i], 'here', *row[i + 1:]) for row in ROWS[:5]]
        refuse(text_of([*bad, *ROWS[5:]]), f"row 2, column {word}: 'here'")
    refuse(text_of(COMMAS), 'row 2: 9 cells, but the header has 5', 'decimal commas')
    refuse(text_of(header=HEADER.replace('el_enc_deg', 'az_deg')), "'az_deg' is there twice")


def test_unknown_is_unknown_in_any_word(read):
    cells = ['4.5', 'n/a', 'NA', '-', '', 'null', '5.5', 'nan']
    run = read(text_of([(*row, cell) for row, cell in zip(ROWS, cells)], HEADER + ',magnitude'))
    assert len(run) == 8 and np.nansum(run['magnitude']) == 10.0
    assert np.isnan(run['magnitude']).sum() == 6


def test_a_bad_cell_of_a_column_of_ones_own_is_unknown(read):
    cells = ['1', '2', 'x', '4', '5', '6', '7', '8']
    run = read(text_of([(*row, cell) for row, cell in zip(ROWS, cells)], HEADER + ',note'))
    assert len(run) == 8 and np.flatnonzero(np.isnan(run['note'])).tolist() == [2]
    assert any("'note' is not a number in 1 of 8 rows: unknown there (row 4: 'x')" in note
               for note in run.meta['notes'])


@pytest.mark.parametrize('name, fill', [
    ('humidity', '-999'), ('humidity', '999.9'), ('temperature_c', '-99'),
    ('temperature_c', '85'), ('pressure_hpa', '999')])
def test_a_number_that_stands_for_none_is_interpolated(read, name, fill):
    first = {'pressure_hpa': 700}.get(name, 11)
    measured = [f'{first + 0.5 * i}' for i in range(8)]
    cells = [fill if i in (2, 5) else cell for i, cell in enumerate(measured)]
    run = read(text_of([(*row, cell) for row, cell in zip(ROWS, cells)], f'{HEADER},{name}'))
    key = name.split('_')[0]
    assert run[key] == pytest.approx([float(cell) for cell in measured])
    assert any(f'{fill}' in note and 'in 2 of 8 rows' in note for note in run.meta['notes'])
    assert any('interpolated in time' in note for note in run.meta['notes'])
    # where there is nothing else, only a number below zero is none
    lone = read(text_of([(*row, fill) for row in ROWS], f'{HEADER},{name}'))
    assert (key in lone) == fill.startswith('999')
    # one of a few kinds is one
    kinds = [('9' if i in (2, 5) else '1') for i in range(8)]
    run = read(text_of([(*row, cell) for row, cell in zip(ROWS, kinds)], f'{HEADER},filter'))
    assert run['filter'].tolist() == [float(kind) for kind in kinds]


@pytest.mark.skipif(not CASES.is_dir(), reason='the small inputs are not there')
@pytest.mark.parametrize('name, rows, lines', [
    ('quoted_comma', 60, []), ('time_leap60', 60, []), ('dup_reformatted', 60, range(62, 122)),
    ('base', 60, [])])
def test_small_inputs_of_others_give_the_true_terms(name, rows, lines):
    run = read_run(CASES / f'{name}.csv')
    assert len(run) == rows and [one['row'] for one in run.meta['excluded']] == list(lines)
    fit = fit_terms(run)
    sigma = np.sqrt(np.diag(fit.model.covariance)) / ARCSEC
    for (term, value), error in zip(fit.model.terms.items(), sigma):
        assert abs(value / ARCSEC - TRUE[term]) < 3.0 * error + 0.3, term


# ------------------------------------------------------------------------------------- writing

@pytest.mark.parametrize('text', [
    '=HYPERLINK("http://a")', '+1+cmd', '-2+3', '@SUM(A1)', '\t=1', '\r=1', ' =1', "'=1", "''=1",
    '＝1', '-', '+'])
def test_a_text_that_a_spreadsheet_would_run_has_an_apostrophe(text):
    safe = safe_text(text)
    assert safe == f"'{text}" and plain_text(safe) == text


@pytest.mark.parametrize('text', ['HIP 1', "'tis", '', '-1.5e-3', '+5', 'a=b', 'a-b', '{"a": -1}',
                                  'two\nlines', 'é'])
def test_other_texts_and_numbers_are_as_they_are(text):
    assert safe_text(text) == text == plain_text(text)


def test_a_terminal_is_told_nothing():
    assert safe_text('a\x1b[31m\x07\x7f\x9b\u202eb') == r'a\x1b[31m\x07\x7f\x9b\u202eb'
    out = io.StringIO()
    write_rows(out, [['name', 'n'], ['=1+1', -1.5], ['\x1b]0;x', '-2']])
    assert list(csv.reader(io.StringIO(out.getvalue()))) == [
        ['name', 'n'], ["'=1+1", '-1.5'], [r'\x1b]0;x', '-2']]


def test_hostile_names_of_a_run_come_back(tmp_path):
    names = ['=cmd|calc!A1', '@x', '-7 Cam', 'plain']
    run = PointingRun({'az': np.arange(4.0), 'el': np.full(4, 0.5), 'az_enc': np.arange(4.0),
                       'el_enc': np.full(4, 0.6), 'star': names, '=driver': np.arange(4.0)})
    write_csv(run, tmp_path / 'run.csv')
    cells = list(csv.reader((tmp_path / 'run.csv').open()))
    assert "'=driver" in cells[0] and "'=cmd|calc!A1" in cells[1]
    back = read_run(tmp_path / 'run.csv')
    assert back['star'].tolist() == names and back['=driver'].tolist() == [0, 1, 2, 3]
