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
    None, '', [], page.Section('A', [None, page.SentenceList(['', ''])], 'a note'),
    page.FoldedSection('B', [page.Table(['x'], []), page.Definitions([])], 'a note'),
    page.Subsection('C', page.Folded('more', [])), page.Paragraph(''), page.Cards([(None, 'c')]),
    page.BarChart([('d', [(None, 'before', '')]), ('e', [(float('nan'), 'after', '')])])])
def test_what_has_nothing_in_it_is_left_out_with_its_heading(part):
    assert drawn(part) == ''


def test_text_is_escaped_wherever_it_stands():
    evil = '<script>"'
    text = drawn([evil, page.Section(evil, page.Paragraph([evil, page.Code(evil)]), evil),
                  page.Table([evil, page.Column(evil)], [(evil, page.Link(evil, evil))], 'stack',
                             evil, groups=[evil]),
                  page.Figure(page.Markup('<svg/>'), (evil, page.Size(1.0, 'after')))])
    assert evil not in text and '<svg/>' in text and '<span data-rms="after">1.00″</span>' in text


def test_a_cell_of_which_nothing_is_known_is_a_dash():
    rows = [(None, page.Number(None), page.Number(-0.001), page.Number(1.5, 1, True))]
    assert '<td>–</td><td>–</td><td>0.00</td><td>+1.5</td>' in drawn(page.Table('abcd', rows))


def test_the_parts_of_a_page_stand_on_lines_of_their_own():
    text = whole('T', [page.Heading('T'), None, page.Section('S', []), page.Footer('F')])
    assert '<main>\n<h1>T</h1>\n<footer>F</footer>\n</main>' in text
