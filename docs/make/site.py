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

"""Builds the documentation site, with search: `build/site/index.html`.

    .venv/bin/python docs/make/site.py [FOLDER]      # warnings are errors
    .venv/bin/python docs/make/site.py --external    # also checks external links

Links to files that are not pages, such as modules, are left unchanged.
"""

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def build(folder, builder='html'):
    """Run Sphinx; return its exit code."""
    return subprocess.run([
        sys.executable, '-m', 'sphinx', '-q', '-W', '--keep-going', '-b', builder,
        '-c', str(ROOT / 'docs'), str(ROOT), str(folder)], check=False).returncode


def main():
    """Run; return the exit code."""
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
