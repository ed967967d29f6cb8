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

"""Builds the site of the documentation, with search: `build/site/index.html`.

    .venv/bin/python docs/make/site.py [FOLDER]      # a warning is an error
    .venv/bin/python docs/make/site.py --external    # looks whether links elsewhere answer, too

A link to a file that is no page, such as a module, stays as it is.
"""

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def build(folder, builder='html'):
    """The exit code of Sphinx."""
    return subprocess.run([
        sys.executable, '-m', 'sphinx', '-q', '-W', '--keep-going', '-b', builder,
        '-c', str(ROOT / 'docs'), str(ROOT), str(folder)], check=False).returncode


def main():
    """The exit code."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', nargs='?', type=Path, default=ROOT / 'build' / 'site')
    parser.add_argument('--external', action='store_true')
    args = parser.parse_args()
    code = build(args.folder)
    if not code and args.external:
        code = build(args.folder.with_name('links'), 'linkcheck')
    return code


if __name__ == '__main__':
    sys.exit(main())
