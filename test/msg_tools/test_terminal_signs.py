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

"""Signs that an encoding cannot write."""

import io

import pytest

from msg_tools.terminal_signs import spell_out, spelled


@pytest.mark.parametrize('text, encoding, out', [
    ('1.5″ σ ± 3 µm − Δ', 'ascii', '1.5" sigma +- 3 um - d'),
    ('1.5° ± 3 µm', 'latin-1', '1.5° ± 3 µm'),
    ('5″', 'latin-1', '5"'),
    ('Müller, Å', 'ascii', 'Muller, A'),
    ('星', 'ascii', '?'),
    ('5″ 星', 'utf-8', '5″ 星'),
    ('\udcff', 'utf-8', '?'),
])
def test_what_cannot_be_written_is_spelled(text, encoding, out):
    assert spelled(text, encoding) == out


def test_a_stream_spells():
    stream = io.TextIOWrapper(io.BytesIO(), encoding='ascii')
    spell_out(stream)
    stream.write('σ = 3″')
    stream.flush()
    assert stream.buffer.getvalue() == b'sigma = 3"'
    spell_out(io.StringIO())  # which has no bytes
