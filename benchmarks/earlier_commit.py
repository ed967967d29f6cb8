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

"""The project at an earlier commit, to be run and compared with today's at the same time."""

import os
import subprocess
import tarfile
import tempfile
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

#: what nights, recording and delays are measured against
COMMIT = '2a7b06e6'
BESIDE = f'commit {COMMIT}'
#: times as fast as that, at least
LEAST = 1.0 / 1.3


@contextmanager
def earlier_tree(commit=COMMIT):
    """Folder with the files of a commit, of the repository that this file is in.

    Programs run there by `run_options` take its packages, and what is installed of others.
    """
    packed = subprocess.run(['git', 'archive', commit], check=True, capture_output=True,
                            cwd=Path(__file__).parent.parent).stdout
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=BytesIO(packed)) as files:
            files.extractall(folder, filter='data')
        yield Path(folder)


def run_options(tree):
    """For `subprocess.run`: folder and environment in which the packages of a tree come first."""
    return {'cwd': tree, 'env': {**os.environ, 'PYTHONPATH': str(tree)}}
