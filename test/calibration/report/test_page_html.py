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

"""Parts of a page as HTML: nothing is drawn of nothing, and no text can do harm."""

import pytest

from calibration.report import page_parts as page
from calibration.report.page_html import drawn, whole


@pytest.mark.parametrize('part', [
    None, '', [], page.section('A', [None, page.sentence_list(['', ''])], 'a note'),
    page.folded_section('B', [page.table(['x'], []), page.definitions([])], 'a note'),
    page.subsection('C', page.folded('more', [])), page.paragraph(''), page.cards([(None, 'c')]),
    page.bar_chart([('d', [(None, 'before', '')]), ('e', [(float('nan'), 'after', '')])])])
def test_what_has_nothing_in_it_is_left_out_with_its_heading(part):
    assert drawn(part) == ''


def test_text_is_escaped_wherever_it_stands():
    evil = '<script>"'
    text = drawn([evil, page.section(evil, page.paragraph([evil, page.code(evil)]), evil),
                  page.table([evil, page.column(evil)], [(evil, page.link(evil, evil))], 'stack',
                             evil, groups=[evil]),
                  page.figure(page.Markup('<svg/>'), (evil, page.size(1.0, 'after')))])
    assert evil not in text and '<svg/>' in text and '<span data-rms="after">1.00″</span>' in text


def test_a_cell_of_which_nothing_is_known_is_a_dash():
    rows = [(None, page.number(None), page.number(-0.001), page.number(1.5, 1, True))]
    assert '<td>–</td><td>–</td><td>0.00</td><td>+1.5</td>' in drawn(page.table('abcd', rows))


def test_the_parts_of_a_page_stand_on_lines_of_their_own():
    text = whole('T', [page.heading('T'), None, page.section('S', []), page.footer('F')])
    assert '<main>\n<h1>T</h1>\n<footer>F</footer>\n</main>' in text
