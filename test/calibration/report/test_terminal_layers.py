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

from calibration.report.terminal_layout import LINES, height_of, layered
from calibration.report.terminal_tables import new_table, terms_table

LONG = 'a note of some words ' * 8  # three lines


def rows(n):
    out = new_table('', 'name', 'value')
    for i in range(n):
        out.add_row(f'row {i}', str(i))
    return out


def test_heights():
    assert height_of('one line') == 1 and height_of(LONG) == 3 and height_of('') == 1
    assert height_of(rows(5)) == 5 + 3  # head, rule and a blank


def test_what_has_no_room_is_counted():
    shown = layered([rows(10)], [LONG] * 10, files=2)
    assert shown[1:] == [LONG, LONG, '8 more: --verbose']
    assert sum(map(height_of, shown)) + 2 <= LINES
    assert layered([rows(10)], [LONG] * 10, verbose=True)[1:] == [LONG] * 10


def test_a_short_line_behind_a_long_one_has_room():
    shown = layered([rows(17)], [LONG, 'short'], rest=[rows(40)])
    assert shown[1:] == [LONG, '2 more: --verbose']
    shown = layered([rows(18)], [LONG, 'short'], rest=[rows(40)])
    assert shown[1:] == ['short', '2 more: --verbose']
    assert layered(['all'], ['of it']) == ['all', 'of it']


def test_empty_parts_are_none():
    assert layered(['', 'one', None], [None, 'two'], rest=['']) == ['one', 'two']


def test_many_terms_stand_in_two_columns():
    terms = [{'name': f'T{i}', 'value_arcsec': i, 'sigma_arcsec': 0.5} for i in range(21)]
    assert height_of(terms_table(terms)) == 11 + 3
    assert height_of(terms_table(terms[:8])) == 8 + 3
