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

"""Where a server is, from the text of an option."""

import pytest

from telescope_mount.bridges.server_address import parse_address


def test_an_address_is_read_and_another_text_refused():
    assert parse_address('indi:localhost:7624') == ('localhost', 7624)
    assert parse_address('indi:dome') == ('dome', 7624)
    for text in ('indi:', 'indi:host:port', 'german', 'indi:host:0'):
        with pytest.raises(ValueError, match='is no INDI server; write indi:HOST'):
            parse_address(text)
