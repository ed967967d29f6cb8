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

"""Replaces characters that a terminal or file cannot encode."""

import codecs
import unicodedata

#: replacements of characters
SPELLED = {
    '″': '"', '′': "'", '°': ' deg', 'σ': 'sigma', 'µ': 'u', 'μ': 'u', '±': '+-', '−': '-',
    '–': '-', '—': '-', '…': '...', 'Δ': 'd', 'δ': 'declination', 'φ': 'latitude', 'χ': 'chi',
    'ρ': 'rho', '×': 'x', '·': '*', '≤': '<=', '≥': '>=', '→': '->', '←': '<-', '≈': '~', '²': '2',
    '³': '3', '√': 'root ', '“': '"', '”': '"', '’': "'", '‘': "'", '•': '*', '─': '-', '━': '-',
    '│': '|', '\u202f': ' ',
}


def spelled(text, encoding):
    """A text as `encoding` can write it: ″ as ", σ as sigma; characters without replacement as ?.

    Parameters
    ----------
    text : str
    encoding : str
        Encoding of a terminal or file, for instance ``ascii``.
    """
    return text.encode(encoding, _HANDLER).decode(encoding)


def spell_out(stream):
    """Make a text stream replace characters that it cannot encode, if it can be reconfigured."""
    if hasattr(stream, 'reconfigure'):
        stream.reconfigure(errors=_HANDLER)


def _spell(error):
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return ''.join(_sign(sign, error.encoding)
                   for sign in error.object[error.start:error.end]), error.end


def _sign(sign, encoding):
    plain = ''.join(part for part in unicodedata.normalize('NFKD', sign)
                    if not unicodedata.combining(part))
    for way in (SPELLED.get(sign), plain):
        if way:
            try:
                way.encode(encoding)
                return way
            except UnicodeEncodeError:
                pass
    return '?'


_HANDLER = 'telescope_mount.spelled'
codecs.register_error(_HANDLER, _spell)
