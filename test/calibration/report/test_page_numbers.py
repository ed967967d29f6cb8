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

"""Numbers on pages: no more digits than their errors carry."""

import pytest

from calibration.report.number_wording import value_and_error
from calibration.report.page_html import drawn
from calibration.report.terms_section import terms_page_table


@pytest.mark.parametrize('value, sigma, texts', [
    (-7282.527, 85.977, ('−7283', '86')), (1.23456, 0.0456, ('+1.235', '0.046')),
    (0.5, 9.96, ('0', '10')), (12.0, 0.995, ('+12.00', '0.99')), (3.14159, None, ('+3.1416', '–')),
    (4000.0, 0.0, ('+4000.0', '0.000')), (float('nan'), 1.0, ('–', '1.0'))])
def test_a_value_has_the_digits_of_its_error(value, sigma, texts):
    assert value_and_error(value, sigma) == texts


def test_a_table_of_terms_has_what_they_are_without_the_effects():
    terms = [{'name': 'CH', 'value': 1046.3, 'sigma': 44.2, 'unit': 'arcsec', 'alone': 1283.9},
             {'name': 'DAF', 'value': -320.1, 'sigma': 46.4, 'unit': 'arcsec'}]
    text = drawn(terms_page_table(terms))
    assert 'without the effects' in text and '<td>+1284</td>' in text
    assert text.count('<td>–</td>') == 1
    assert 'without the effects' not in drawn(terms_page_table(terms[1:]))
