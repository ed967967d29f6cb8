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

"""Shared by the tests: runs from texts."""

import pytest

from pointing_model.runs.run_reader import read_run


@pytest.fixture
def read(tmp_path):
    """Read a text as a run."""
    def read(text, **options):
        path = tmp_path / 'run.txt'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_run(path, **options)
    return read


@pytest.fixture
def refuse(read):
    """Check that a text is refused in one line that names the file and holds `words`."""
    def refuse(text, *words, **options):
        with pytest.raises(ValueError) as error:
            read(text, **options)
        message = str(error.value)
        assert '\n' not in message and 'run.txt' in message
        for word in words:
            assert word in message, message
        return message
    return refuse
