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

"""What a shell completes, asked of the shell itself."""

import os
import shutil
import subprocess
import sys

import pytest
from places import ROOT

pytest.importorskip('argcomplete')


LINES = {
    ('telescope-mount', 'dia'): {'diagnose'},
    ('telescope-mount', 'fit', '--sa'): {'--save'},
    ('telescope-mount', 'fit', '--encoder', ''): {'enc', 'abs'},
    ('telescope-mount', 'night', '--scenario', 'season_'):
        {'season_none', 'season_temperature', 'season_trend'},
}


def test_bash_completes():
    """What bash makes of a line when TAB is pressed behind its last word."""
    bash = shutil.which('bash')
    if bash is None:
        pytest.skip('bash is not installed')
    script = (f'eval "$({sys.executable} -m telescope_mount completion bash)"\n'
              f'telescope-mount() {{ {sys.executable} -m telescope_mount "$@"; }}\n'
              f'export -f telescope-mount\nCOMP_TYPE=9\n')
    for words in LINES:
        line = ' '.join(words)
        script += (f'COMP_LINE={line!r} COMP_POINT={len(line)}\n'
                   f'COMP_WORDS=({line if words[-1] else line + repr("")}) '
                   f'COMP_CWORD={len(words) - 1}\n'
                   '_python_argcomplete telescope-mount\nprintf "%s " "${COMPREPLY[@]}"\necho\n')
    done = subprocess.run([bash, '-c', script], capture_output=True, text=True, check=True,
                          env={**os.environ, 'PYTHONPATH': str(ROOT)})
    assert [set(line.split()) for line in done.stdout.splitlines()] == [*LINES.values()]


def test_every_shell_has_a_script(ended):
    for shell, word in (('bash', 'complete -o'), ('zsh', 'compdef'),
                        ('fish', 'complete --command')):
        code, out, err = ended('completion', shell)
        assert (code, err) == (0, '') and word in out and 'telescope-mount' in out
