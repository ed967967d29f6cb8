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

"""A page as one self-contained file."""

import re
from base64 import b64encode
from hashlib import sha256
from importlib.resources import files

from .page_parts import Markup, clean, drawn

#: style: colours distinguishable by the colour-blind; light, dark and print. Scripts: highlighting
#: of rows in all plots, sorting of tables, filtering of nights; zooming and saving of plots;
#: exclusion of rows. The page is complete without scripts
CSS, *_SCRIPTS = ('\n' + files(__package__).joinpath(f'page{name}').read_text(encoding='utf-8')
                  for name in ('.css', '.js', '_plots.js', '_refit.js'))
#: the scripts, wrapped for a page that is also XML
SCRIPT = '//<![CDATA[' + re.sub('\n +', '\n', ''.join(_SCRIPTS)) + '//]]>'
_BODY = re.compile('<main>\n(.*)\n</main>', re.DOTALL)
#: parts removed when a page is included in another: control bar and refit data
_ALONE = re.compile('<div (?:class="controls"|id="refit").*?</div>', re.DOTALL)
#: an injected script cannot run: only the page's own script has this hash
_POLICY = ("default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-"
           + b64encode(sha256(SCRIPT.encode()).digest()).decode() + "'")


def whole(title, parts, kind=''):
    """A page: one self-contained file, also well-formed XML.

    Parameters
    ----------
    title : str
    parts : list
        See `page_parts`.
    kind : str
        Description in the head of the page.

    Returns
    -------
    str
    """
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"/>'
            '<meta name="viewport" content="width=device-width, initial-scale=1"/>'
            f'<meta http-equiv="Content-Security-Policy" content="{clean(_POLICY)}"/>'
            + (f'<meta name="description" content="{clean(kind)}"/>' if kind else '')
            + f'<title>{clean(title)}</title><style>{CSS}</style></head><body><main>\n'
            + '\n'.join(filter(None, map(drawn, parts)))
            + f'\n</main><script>{SCRIPT}</script></body></html>\n')


def body_of(text):
    """The body of a page made by `whole`, for inclusion in another page.

    Parameters
    ----------
    text : str

    Returns
    -------
    Markup
        '' if it is no such page.
    """
    found = _BODY.search(text)
    # a page has one main heading and one control bar only
    return Markup(_ALONE.sub('', found[1]).replace('<h1>', '<h2 class="part">').replace(
        '</h1>', '</h2>') if found else '')
