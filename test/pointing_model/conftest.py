"""Shared by the tests: runs from texts."""

import pytest

from pointing_model.runs.formats import read_run


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
