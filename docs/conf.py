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

"""The site, by docs/make/site.py. Pages as on GitHub; navigation: index.md."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

project = 'telescope_mount'
copyright = 'the telescope_mount developers'
extensions = ['myst_parser']
root_doc = 'docs/index'
include_patterns = ['docs/**', 'README.md', 'CONTRIBUTING.md', 'SECURITY.md',
                    'QUALITY_DECLARATION.md', 'calibration/data/README.md']
exclude_patterns = ['docs/make']
source_suffix = {'.md': 'markdown'}
myst_heading_anchors = 4
html_theme = 'furo'
html_title = 'telescope_mount'
html_static_path = ['site']
html_css_files = ['site.css']
html_copy_source = False
html_show_sphinx = False
# a link that leads nowhere is a warning, and an error of docs/make/site.py
suppress_warnings = ['misc.highlighting_failure', 'toc.not_included']


def navigation(app, name, source):
    """Give the index and the list of nodes the hidden tables of contents that Sphinx wants."""
    if name not in ('docs/index', 'docs/nodes/index'):
        return
    folder = (ROOT / name).parent
    out = []
    for part in re.split(r'^## ', source[0], flags=re.M):
        title, _, body = part.partition('\n')
        entries = []
        for link in re.findall(r'^(?:- |\| )\[[^\]]+\]\(([^)#]+\.md)\)', body, flags=re.M):
            path = (folder / link).resolve().relative_to(ROOT)
            entries.append('/' + str(path.with_suffix('')))
        if entries:
            caption = [f':caption: {title}'] if name == 'docs/index' else []
            out.append('\n'.join(['```{toctree}', ':hidden:', *caption, '', *entries, '```']))
    source[0] += '\n' + '\n\n'.join(out) + '\n'


def front(app, error):
    """A page at the top that leads to the index."""
    if error is None and app.builder.format == 'html':
        (Path(app.outdir) / 'index.html').write_text(
            '<!DOCTYPE html><meta charset="utf-8"><title>telescope_mount</title>'
            '<meta http-equiv="refresh" content="0; url=docs/index.html">'
            '<a href="docs/index.html">telescope_mount</a>\n', encoding='utf-8')


def setup(app):
    """Sphinx calls this."""
    app.connect('source-read', navigation)
    app.connect('build-finished', front)
