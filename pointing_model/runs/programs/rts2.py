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

"""RTS2's gpoint models of alt-azimuth mounts (lib/rts2tel/gpointmodel.cpp, python/rts2/gpoint.py).

A line ``RTS2_ALTAZ ia tn te npae npoa ie tf`` and lines ``axis coefficient function angle;angle
number;number``; angles in radians, or with the units d, m or ', s or ". The terms are added to the
target to get the mount's angles, to first order at the target. The azimuth is that of libnova: 0
south, 90 degrees west (shown by the example in its manual), A - 180 degrees.
"""

import re

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ

from ..model_files.program import ModelFile, Program, first_order, for_celestial, number_of
from ..model_files.term_columns import TERM_KEYS, column

#: coefficients in the order of the line -> our term, and RTS2's coefficient for a unit of ours
_LINE = {'ia': ('IA', -1), 'tn': ('AN', -1), 'te': ('AW', 1), 'npae': ('NPAE', -1),
         'npoa': ('CA', 1), 'ie': ('IE', -1), 'tf': ('TF', 1)}
_NAMES = {TERM_KEYS[name]: (own, sign) for own, (name, sign) in _LINE.items()}
#: the same for an equatorial mount, RTS2_GEM (RTS2_MODEL in its C++); declinations beyond 90
#: degrees are through the pole
_GEM = {'id': ('ID', 1), 'me': ('ME', 1), 'ma': ('MA', 1), 'tf': ('TF', -1), 'ih': ('IH', 1),
        'ch': ('CH', 1), 'np': ('NP', 1), 'daf': ('DAF', -1), 'fo': ('FO', 1)}
_AXES = {'az': 'az', 'el': 'el', 'alt': 'el'}
_PAIRS = {'sincos': ('sin', 'cos'), 'coscos': ('cos', 'cos'), 'sinsin': ('sin', 'sin')}
_SINGLE = ('sin', 'cos', 'tan', 'cot', 'abssin', 'abscos', 'sinh', 'cosh', 'tanh')
#: functions that RTS2's C++ and Python compute differently
_DISPUTED = {'sinsin': 'the C++ leaves its coefficient out', 'csc': 'the C++ takes it for sec',
             'sec': 'the C++ takes it for csc', 'sech': 'the C++ takes it for csch',
             'csch': 'the C++ takes it for sech', 'coth': 'C++ and Python differ in its argument',
             'offset': 'the Python gives 0 where its angle is not that of its axis'}
_UNITS = {'d': DEG, "'": DEG / 60.0, 'm': DEG / 60.0, '"': ARCSEC, 's': ARCSEC}


def _factor(function, angle, k):
    """(sign, factor) of a function of k times RTS2's angle; None if it is not one factor."""
    if angle == 'el':
        return 1, (function, 'E', k)
    if angle == 'zd':
        # 90 deg - E
        turn = {1: {'sin': (1, 'cos'), 'cos': (1, 'sin'), 'tan': (1, 'cot'), 'cot': (1, 'tan')},
                }.get(k, {}).get(function)
        return None if turn is None else (turn[0], (turn[1], 'E', k))
    if angle != 'az':
        return None
    if function in ('tan', 'cot', 'abssin', 'abscos') and k == int(k):
        return 1, (function, 'A', k)
    if function in ('sin', 'cos') and k == int(k):
        return (1 if int(k) % 2 == 0 else -1), (function, 'A', k)
    return None


def _key(name):
    """(column, sign) of an extra line from its name, as ``az sincos az;el 2;1``, or None."""
    axis, function, angles, numbers = name.split(' ')
    angles, numbers = angles.split(';'), [float(n) for n in numbers.split(';')]
    functions = _PAIRS.get(function, (function,))
    if len(angles) < len(functions) or len(numbers) < len(functions):
        return None
    sign, factors = 1, []
    for made in map(_factor, functions, angles, (int(n) if n == int(n) else n for n in numbers)):
        if made is None:
            return None
        sign *= made[0]
        factors.append(made[1])
    return column(_AXES[axis], *factors), sign


def _own(key):
    if key in _NAMES:
        return [(_NAMES[key][0], float(_NAMES[key][1]))]
    result, factors = key
    if result not in ('az', 'el') or not 1 <= len(factors) <= 2:
        return None
    # sine first: RTS2 has sincos but no cossin
    factors = sorted(factors, key=lambda f: f[0] != 'sin')
    function = ''.join(f for f, _, _ in factors)
    if function not in (*_PAIRS, *_SINGLE) or function in _DISPUTED:
        return None
    angles = ';'.join('az' if a == 'A' else 'el' for _, a, _ in factors)
    name = f'{result} {function} {angles} ' + ';'.join(f'{k:.1f}' for _, _, k in factors)
    made = _key(name)
    return [(name, float(made[1]))] if made and made[0] == key else None


def _column(name):
    if name in _LINE:
        own, sign = _LINE[name]
        return [(TERM_KEYS[own], float(sign))]
    key, sign = _key(name)
    return [(key, float(sign))]


def _candidates():
    out = []
    for f in ('cos', 'sin'):
        out += [column('el', (f, a, k)) for a in 'AE' for k in range(1, 6)]
        out += [column('az', (f, 'A', k)) for k in range(1, 5)]
        out += [column('az', (f, 'E', k)) for k in range(1, 4)]
        out += [column(r, (f, 'A', i), (g, 'E', j)) for r in ('el', 'az') for g in ('cos', 'sin')
                for i in range(1, 4) for j in range(1, 4)]
    return (*_NAMES, column('el', ('cot', 'E', 1)),
            *(key for key in dict.fromkeys(out) if _own(key)))


def _write(sheet, head='RTS2_ALTAZ', line=_LINE):
    rows = [f'# {sheet.caption}', f'{head} ' + ' '.join(
        f'{sheet.terms.get(name, 0.0) / ARCSEC:.7f}"' for name in line)]
    for name, value in sheet.terms.items():
        if name not in line:
            axis, *rest = name.split(' ')
            rows.append('\t'.join([axis.upper(), f'{value / ARCSEC:.7f}"', *rest]))
    return '\n'.join(rows) + '\n'


def _for_mount(mount):
    """gpoint for an equatorial mount: nine terms, to first order."""
    return for_celestial(
        # RTS2's C++ accepts any name but RTS2_ALTAZ, its Python accepts both
        PROGRAM, mount, _GEM, write=lambda sheet: _write(sheet, 'RTS2_MODEL', _GEM),
        encoder=lambda values, az, el: first_order(values, az, el, mount),
        read=lambda path, text: _read(path, text, mount))


_looks_like = re.compile(r'^\s*RTS2_(ALTAZ|MODEL|GEM)\b', re.MULTILINE).search


def _angle(path, line, name, word):
    unit = _UNITS.get(word[-1:], 1.0)
    return number_of(path, line, name, word if unit == 1.0 else word[:-1]) * unit


def _read(path, text, mount=ALTAZ):
    found, head = ModelFile({}), None
    line_of = _LINE if mount.vertical else _GEM
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if not words or line.startswith('#'):
            continue
        if head is None:
            head = words[0]
            gem = head in ('RTS2_MODEL', 'RTS2_GEM')
            if gem and mount.vertical:
                raise ValueError(f'{path} is a model of an equatorial mount ({head}), and not of '
                                 'an alt-azimuth one; if the mount is one, say so (--mount, '
                                 '--latitude)')
            if head == 'RTS2_ALTAZ' and not mount.vertical:
                raise ValueError(f'{path} is a model of an alt-azimuth mount, and the mount is '
                                 f'{mount.kind}')
            if not (gem or head == 'RTS2_ALTAZ') or len(words) != 1 + len(line_of):
                raise ValueError(f'{path}, row {number}: expected RTS2_ALTAZ and seven numbers, or '
                                 f'RTS2_MODEL and nine, found {line[:60]!r}')
            for name, word in zip(line_of, words[1:]):
                found.terms[name] = _angle(path, number, name, word)
            continue
        if not mount.vertical:
            raise ValueError(f'{path}, row {number}: extra terms of equatorial mounts are not read')
        name, value = _extra(path, number, words)
        if name in found.terms:
            raise ValueError(f'{path}, row {number}: {name} is there twice')
        found.terms[name] = value
    if head is None:
        raise ValueError(f'{path} holds no line RTS2_ALTAZ')
    return found


def _extra(path, number, words):
    if len(words) == 4:
        words = [*words, ';'.join('1' for _ in words[3].split(';'))]
    if len(words) != 5:
        raise ValueError(f'{path}, row {number}: {len(words)} words; expected axis, coefficient, '
                         'function, angles, numbers')
    axis, value, function, angles, numbers = words
    axis, function, angles = axis.lower(), function.lower(), angles.lower()
    if axis not in _AXES:
        raise ValueError(f'{path}, row {number}: axis {axis!r} is none of an alt-azimuth mount '
                         '(az, el)')
    if function in _DISPUTED:
        raise ValueError(f'{path}, row {number}: function {function} is not read: '
                         f'{_DISPUTED[function]}')
    if function not in (*_PAIRS, *_SINGLE):
        raise ValueError(f'{path}, row {number}: function {function!r} is not known here')
    for k in numbers.split(';'):
        number_of(path, number, 'the number', k)
    name = f'{_AXES[axis]} {function} {angles} ' + ';'.join(
        f'{float(k):.1f}' if float(k) == round(float(k), 1) else k for k in numbers.split(';'))
    if _key(name) is None:
        raise ValueError(f'{path}, row {number}: {function} of {angles} x {numbers} cannot be held '
                         'here (whole numbers of az and el can)')
    return name, _angle(path, number, name, value)


PROGRAM = Program(
    'rts2', 'RTS2 gpoint', _own, _column, _candidates(), first_order, _write, _read, _looks_like,
    'first_order', for_mount=_for_mount)
