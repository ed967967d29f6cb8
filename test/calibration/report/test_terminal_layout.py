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

"""Tables of any width: every number of every cell is there, whole, and no line is too long."""

import io
import re
from types import SimpleNamespace

import pytest
from rich.console import Console

from calibration.report.diagnosis_summary import DiagnosisSummary
from calibration.report.diagnosis_terminal import summary_lines
from calibration.report.error_ranking import ErrorLine
from calibration.report.night_tables import night_tables
from calibration.report.terminal_layout import TerminalTable
from calibration.report.terminal_tables import terms_table

LONG = 'model of power-on 1 on the stars of power-on 2, with the old zero'


def table():
    out = TerminalTable(title='RMS on the sky, arcsec')
    for i, name in enumerate(('correction', 'used: az', 'el', 'radial', 'held out: az', 'why')):
        out.add_column(name, justify='left' if i == 0 else 'right')
    out.add_row(LONG, '272.97', '+345.66 ± 0.42', '326.05', '-1268.32', 'taken back')
    out.add_row('IA[2]', '0.59', '', '0.81', '0.91', '')
    return out


def printed(what, width, encoding='utf-8'):
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    Console(file=file, width=width, markup=False, highlight=False).print(what)
    file.flush()
    return file.buffer.getvalue().decode(encoding)


@pytest.mark.parametrize('width', [200, 100, 80, 60, 40, 30])
def test_no_number_is_cut_and_no_line_too_long(width):
    text = printed(table(), width)
    words = ' '.join(text.split())
    for number in ('272.97', '+345.66 ± 0.42', '326.05', '-1268.32', '0.59', '0.81', '0.91'):
        assert number in words
    assert not re.search('…', text)
    assert max(map(len, text.splitlines())) <= width
    assert all(line == line.rstrip() for line in text.splitlines()) or width < 60
    assert 'IA[2]' in text
    for word in (*LONG.split(), 'held', 'out:', 'taken', 'back'):
        assert word in words


def test_what_has_room_is_one_line_a_row():
    lines = printed(table(), 200).splitlines()
    assert len(lines) == 7 and LONG in lines[4] and lines[4].index('272.97') > len(LONG)
    # numbers below their header, at its right end
    assert lines[2].index('radial') + 6 == lines[4].index('326.05') + 6


def test_where_nothing_else_helps_a_row_is_a_paragraph():
    text = printed(table(), 40)
    assert LONG in ' '.join(text.split()) and 'used: az 272.97' in text
    assert 'held out: az -1268.32' in text
    assert 'why' not in text.split('IA[2]')[1]  # an empty cell needs no name


def test_an_old_terminal_gets_signs_that_it_has():
    text = printed(table(), 200, 'ascii')
    assert '+345.66 +- 0.42' in text
    header, row = text.splitlines()[2], text.splitlines()[4]
    assert header.index('radial') == row.index('326.05')


def test_a_night_at_any_width():
    rms = {'x': 268.96, 'y': 182.36, 'radial': 324.95}
    report = {'zeros': [{'run': 1, 'az_arcsec': 345.17, 'el_arcsec': -140.17, 'exposures': 16,
                         'sigma_az_arcsec': 0.24, 'sigma_el_arcsec': 0.14}], 'changes': [],
              'steps': [{'step': '13 harmonics, E read as zenith distance', 'used': rms,
                         'held_out': rms}],
              'external_check': [{'check': LONG, 'n': 30, **rms}],
              'terms': [{'name': 'IA', 'value_arcsec': 1209.15, 'sigma_arcsec': 0.82}]}
    for width in (120, 80, 60, 40):
        text = ''.join(printed(one, width) for one in (
            *night_tables(report), terms_table(report['terms'])))
        assert text.count('268.96') == 3 and text.count('324.95') == 3
        assert '+1209.15' in text and '…' not in text
        assert max(map(len, text.splitlines())) <= width


def test_the_first_layer_of_a_diagnosis_has_24_lines():
    long = 'a cause that takes so many words that it has more than one line of eighty columns'
    effects = [ErrorLine(f'Effect {i} with a name of some words', 12.0, 3.0, [long] * 3, long)
               for i in range(5)]
    view = SimpleNamespace(used='90 of 98 rows used; 8 more', summary=DiagnosisSummary(
        'A headline that says what is wrong, how large that is and how sure. ' * 2,
        [('190.2″', 'raw'), ('6.45″', 'with 7 terms'), ('5.29″', 'with 5 effects')],
        'cross-validated', effects, ['A caution of more than eighty columns, which is much for '
                                     'one line of a terminal.'] * 6, 'To do.'))
    console = Console(file=io.StringIO(), width=80, markup=False)
    for part in summary_lines(view):
        console.print(part)
    lines = console.file.getvalue().splitlines()
    assert len(lines) <= 21 and sum(line.startswith('caution') for line in lines) == 4
    assert [line[:9] for line in lines if line[1:3] == '. '] == ['1. Effect', '2. Effect',
                                                                 '3. Effect']
    # what is left out first is said of the smaller ones
    assert any('cause: ' in line for line in lines) and '2 smaller effects' in lines
