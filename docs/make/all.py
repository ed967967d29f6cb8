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

"""Generates all generated documentation, or checks whether it is up to date.

    .venv/bin/python docs/make/all.py            # some ten minutes, most of them for the tables
    .venv/bin/python docs/make/all.py --check    # lists outdated parts; code 1 if there are any

`screenshots.py` and the tables of nodes need chromium and rclpy; `site.py` builds the site.
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import drawings
import effects
import nodes
import tables

DOCS = tables.DOCS


def pages():
    """Text of all pages and pictures that are generated quickly, by path."""
    with tempfile.TemporaryDirectory() as folder:
        found = nodes.pages(nodes.declared(Path(folder)))
    return {**{DOCS / path: text for path, text in found.items()}, effects.PAGE: effects.page(),
            **{drawings.PICTURES / name: text for name, text in drawings.pages().items()}}


def main():
    """Run; return the exit code."""
    made = pages()
    if '--check' in sys.argv[1:]:
        old = [path for path, text in made.items()
               if not path.is_file() or path.read_text(encoding='utf-8') != text]
        for path in old:
            print(f'{path.relative_to(DOCS)} is not as it would be made')
        sys.argv[1:] = ['--check']
        return tables.main() or int(bool(old))
    for path, text in made.items():
        path.write_text(text, encoding='utf-8')
    return tables.main()


if __name__ == '__main__':
    sys.exit(main())
