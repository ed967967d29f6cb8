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

"""Numbers of fixed width: as `float` reads them, to the bit."""

import numpy as np
import pytest

from pointing_model.sky.iers_tables import fixed_width
from pointing_model.sky.star_catalogue import _BYTES, _RECORD, catalog_path


def lines_of(*texts):
    return np.array([list(text.encode()) for text in texts], np.uint8)


def test_a_catalogue_is_read_as_its_text():
    data = np.fromfile(catalog_path(), np.uint8).reshape(-1, _RECORD)[::97]
    for first, last in _BYTES.values():
        text = [bytes(line[first - 1:last]) for line in data]
        found = fixed_width(data, first, last)
        assert found.tobytes() == np.array([float(value) for value in text]).tobytes()


@pytest.mark.parametrize('texts', [
    (' 1.25', '-0.50', '  .75'), ('  12', ' -45'), ('1.5e3', '2.5e3'), ('+1.25', '-1.25'),
    ('1.20 ', '3.4  '), ('12.5', '1.25'), ('   7', '  -7'), ('-0.00', ' 0.00'),
    ('123456789.1234567', '  3456789.7654321')])
def test_all_that_float_reads_is_read(texts):
    found = fixed_width(lines_of(*texts), 1, len(texts[0]))
    assert found.tobytes() == np.array([float(text) for text in texts]).tobytes()


@pytest.mark.parametrize('text', ['1 2', '- 1', '   ', '  .', '1-2', '1.x', '--1', '1.-', '-  '])
def test_what_is_no_number_is_refused(text):
    with pytest.raises(ValueError, match='could not convert'):
        fixed_width(lines_of('  1', text), 1, 3)
