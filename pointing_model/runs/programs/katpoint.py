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

"""katpoint's `PointingModel` (ska-sa/katpoint, katpoint/pointing.py): P1 to P22 of an alt-az dish.

Its offset is added to the requested angles, so it is encoder - catalogue, to first order at the
catalogue place, azimuth from north through east. P2 and P10 have no effect. Its remarks on TPOINT's
signs are for the opposite correction, except for AN and AW.
"""

import configparser
import re

import numpy as np

from msg_tools.units import DEG

from ..columns.cell_values import sexagesimal
from ..model_files.program import ModelFile, Program, number_of
from ..model_files.term_columns import column, summed

_A, _E = (lambda f, k=1: (f, 'A', k)), (lambda f, k=1: (f, 'E', k))
#: name -> (column, sign, katpoint's description)
TERMS = {
    'P1': (column('az'), 1, 'az offset'),
    'P3': (column('np'), 1, 'non-perpendicularity of az/el axes'),
    'P4': (column('lr'), -1, 'az box offset / collimation'),
    'P5': (('AN', ()), 1, 'az ring tilted towards north'),
    'P6': (('AW', ()), -1, 'az ring tilted towards east'),
    'P7': (column('el'), 1, 'el offset'),
    'P8': (column('el', _E('cos')), 1, 'gravity sag'),
    'P9': (column('el', ('power', 'E', 1)), 1, 'el excess scale factor'),
    'P11': (column('el', _E('sin')), 1, 'asymmetric sag'),
    'P12': (column('az', ('power', 'A', 1)), 1, 'az excess scale factor'),
    'P13': (column('az', _A('cos')), 1, 'az centering error'),
    'P14': (column('az', _A('sin')), 1, 'az centering error'),
    'P15': (column('el', _A('cos', 2)), 1, 'elevation nod twice per az revolution'),
    'P16': (column('el', _A('sin', 2)), 1, 'elevation nod twice per az revolution'),
    'P17': (column('az', _A('cos', 2)), 1, 'az encoder tilt'),
    'P18': (column('az', _A('sin', 2)), 1, 'az encoder tilt'),
    'P19': (column('el', _E('cos', 8)), 1, 'high-order el encoder scale'),
    'P20': (column('el', _E('sin', 8)), 1, 'high-order el encoder scale'),
    'P21': (column('el', _A('cos')), 1, 'elevation nod once per az revolution'),
    'P22': (column('el', _A('sin')), 1, 'elevation nod once per az revolution'),
}
#: parameters that are not angles
SCALES = ('P9', 'P12')
_OWN = {key: [(name, float(sign))] for name, (key, sign, _) in TERMS.items()}
_COUNT = 22
_NEAREST = np.radians(0.1)  # nearer to the zenith katpoint uses sec E at this distance


def _encoder(values, az, el):
    x, y = summed(values, az, el)
    return az + x / np.maximum(np.cos(el), _NEAREST), el + y


def _value_text(name, value):
    # decimal degrees: katpoint's sexagesimal text is rounded to 0.1 arcsec
    return f'{value:.15g}' if name in SCALES else f'{value / DEG:.12f}'


def description(terms):
    """katpoint's one-line form: P1 to the last parameter that is not zero."""
    last = max((int(name[1:]) for name, value in terms.items() if value), default=0)
    return ' '.join(_value_text(f'P{i}', terms.get(f'P{i}', 0.0)) if terms.get(f'P{i}') else '0'
                    for i in range(1, last + 1))


def _write(sheet):
    caption = sheet.caption.replace('%', '%%')
    rows = ['[header]', f'source = {caption}', '', '[params]']
    for name, (_, _, doc) in TERMS.items():
        if sheet.terms.get(name):
            unit = '' if name in SCALES else 'deg'
            rows.append(f'{name} = {_value_text(name, sheet.terms[name])} ; {unit} ({doc})')
    return '\n'.join(rows) + '\n'


def _looks_like(text):
    if re.search(r'^\s*\[params\]', text, re.MULTILINE):
        return True
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith('#')]
    return len(lines) == 1 and len(_words(lines[0])) >= 2 and all(
        re.fullmatch(r'[-+\d.:eE]+|[-+]?(nan|inf)', word, re.IGNORECASE)
        for word in _words(lines[0]))


def _words(line):
    return [word.strip() for word in line.split(',')] if ',' in line else line.split()


def _read(path, text):
    given = _ini(path, text) if '[params]' in text else _line(path, text)
    found = ModelFile({})
    unknown = [name for name in given if not re.fullmatch(r'P([1-9]|1\d|2[0-2])', name)]
    if unknown:
        raise ValueError(f'{path}: {", ".join(unknown)} is no parameter of katpoint\'s pointing '
                         f'model; it has P1 to P{_COUNT}')
    for name, (line, word) in given.items():
        if name in SCALES:
            value = number_of(path, line, name, word)
        else:
            value = _angle(path, line, name, word)
        if name in TERMS:
            found.terms[name] = value
        elif value:
            found.notes.append(f'{name} of the file does nothing in katpoint: left out')
    return found


def _ini(path, text):
    reader = configparser.ConfigParser(inline_comment_prefixes=(';', '#'), interpolation=None)
    try:
        reader.read_string(text)
    except configparser.Error as error:
        wording = ' '.join(str(error).split()).replace("'<string>'", 'it')
        raise ValueError(f'{path} is no model file of katpoint: {wording}') from None
    lines = {m[1].upper(): i for i, line in enumerate(text.splitlines(), 1)
             if (m := re.match(r'\s*(\w+)\s*[=:]', line))}
    return {name.upper(): (lines.get(name.upper(), 0), value)
            for name, value in reader['params'].items()}


def _line(path, text):
    number, line = next((i, line) for i, line in enumerate(text.splitlines(), 1)
                        if line.strip() and not line.startswith('#'))
    words = _words(line)
    if len(words) > _COUNT:
        raise ValueError(f"{path}, row {number}: {len(words)} numbers; katpoint's pointing model "
                         f'has {_COUNT}')
    return {f'P{i}': (number, word) for i, word in enumerate(words, 1)}


def _angle(path, line, name, word):
    """Decimal degrees or d:m:s, as radians."""
    parts = word.split(':')
    if len(parts) > 3:
        number_of(path, line, name, word)
    for part in parts:
        number_of(path, line, name, part)
    return sexagesimal(parts) * DEG


PROGRAM = Program(
    'katpoint', 'katpoint (VLBI Field System)', _OWN.get,
    lambda name: [(TERMS[name][0], float(TERMS[name][1]))],
    tuple(key for key in _OWN if 'power' not in str(key)), _encoder, _write, _read, _looks_like,
    'first_order', SCALES)
