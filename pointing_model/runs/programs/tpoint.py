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

"""TPOINT's model files (OUTMOD) and plain lists of its terms.

A file has a caption, a line ``T observations rms refraction refraction``, rows ``flags name value
sigma`` in arcseconds, and END. ``&`` chains a row to the one before, ``=`` marks a fixed term.
Public examples are telmod.dat of the ARC and SDSS telescopes, and a reader, RTS2's
lib/rts2tel/tpointmodel.cpp.

TPOINT's corrections are from encoder to star. Its azimuth A' is 180 deg - A: zero in the south, 90
degrees in the east. Its geometric terms are rotations (P. T. Wallace 2002, SPIE 4848, 125). Generic
names give the corrected angle, then the functions: HASA2 is sin 2A' in azimuth, HSCACE4 is cos A'
cos 4E left-right, HVSA2 is sin 2A' sin E left-right, PZZ1 is a correction of the zenith distance
proportional to itself.
"""

import re
from math import comb

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import terms_of

from ..model_files.program import (
    ModelFile,
    Program,
    first_order_at_encoder,
    for_celestial,
    number_of,
    refuse_equatorial,
    rotations,
)
from ..model_files.term_columns import TERM_KEYS, column, summed
from . import spk

#: terms with a name of their own -> our coefficient for a unit of TPOINT's
_NAMED = {'IA': 1, 'IE': -1, 'CA': 1, 'NPAE': 1, 'AN': 1, 'AW': 1, 'TF': 1, 'TX': 1, 'ECES': -1,
          'ACES': 1, 'ACEC': -1}
_RESULT = {'A': ('az', 1), 'S': ('lr', 1), 'V': ('np', 1), 'E': ('el', -1), 'Z': ('el', 1)}
_LETTER = {'az': 'A', 'lr': 'S', 'np': 'V', 'el': 'E'}
_HARMONIC = re.compile(r'H([AESVZ])([SC])([AEZ])(\d?)(?:([SC])([AEZ])(\d?))?', re.ASCII)
_POLYNOMIAL = re.compile(r'P([AESZ])([AEZ])(\d)', re.ASCII)
_HALF = 0.5 * np.pi
_WIDTH = 10  # characters of a value, for readers with fixed columns


def _wave(function, angle, k):
    """(sign, factor) of sin or cos of k times A', E or Z = 90 deg - E, in terms of A and E."""
    if angle == 'E':
        return 1, (function, 'E', k)
    if angle == 'A':
        even = 1 if k % 2 == 0 else -1
        return (even if function == 'cos' else -even), (function, 'A', k)
    # sin or cos of k (90 deg - E) is plus or minus the sine or the cosine of k E
    sin_k, cos_k = ((0, 1), (1, 0), (0, -1), (-1, 0))[k % 4]
    if function == 'sin':
        return (sin_k, ('cos', 'E', k)) if sin_k else (-cos_k, ('sin', 'E', k))
    return (cos_k, ('cos', 'E', k)) if cos_k else (sin_k, ('sin', 'E', k))


def columns_of(name):
    """List of (column, our value for a unit of TPOINT's coefficient) of a term, or None.

    Parameters
    ----------
    name : str
        In TPOINT.

    Returns
    -------
    list of (tuple, float) or None
    """
    if name in _NAMED:
        return [(TERM_KEYS[name], float(_NAMED[name]))]
    if name == 'ECEC':  # the opposite of TF
        return [(TERM_KEYS['TF'], -1.0)]
    match = _HARMONIC.fullmatch(name)
    if match:
        result, sign = _RESULT[match[1]]
        factors = []
        for function, angle, k in (match.groups()[1:4], match.groups()[4:]):
            if function and k != '0':
                turned, factor = _wave('sin' if function == 'S' else 'cos', angle, int(k or 1))
                sign *= turned
                factors.append(factor)
        return [(column(result, *factors), float(sign))]
    match = _POLYNOMIAL.fullmatch(name)
    if not match:
        return None
    (result, sign), angle, n = _RESULT[match[1]], match[2], int(match[3])
    if angle == 'E' or n == 0:
        return [(column(result, *([('power', 'E', n)] if n else [])), float(sign))]
    # (c - u)^n, u = A or E
    c, u = (np.pi, 'A') if angle == 'A' else (_HALF, 'E')
    return [(column(result, *([('power', u, j)] if j else [])),
             sign * comb(n, j) * (-1.0)**j * c**(n - j)) for j in range(n + 1)]


def _own(key):
    """[(TPOINT's name, its coefficient for a unit of ours)], or None."""
    result, factors = key
    for name in _NAMED:
        if TERM_KEYS[name] == key:
            return [(name, float(_NAMED[name]))]
    if result not in _LETTER or not 1 <= len(factors) <= 2:
        return None
    if factors[0][0] == 'power' and len(factors) == 1:
        angle, n = factors[0][1:]
        if angle == 'E':
            return [(f'P{_LETTER[result]}E{n:g}', -1.0 if result == 'el' else 1.0)]
        if result == 'az' and n == 1:  # A = 180 deg - A'
            return [('PAA1', -1.0), ('IA', np.pi)]
        return None
    name = f'H{_LETTER[result]}'
    for function, angle, k in factors:
        if function not in ('sin', 'cos') or k != int(k) or not 1 <= k <= 9:
            return None
        name += f'{function[0].upper()}{angle}{int(k) if k > 1 else ""}'
    (made, share), = columns_of(name)
    return [(name, share)] if made == key else None


def _candidates():
    """Columns that a refit may add: harmonics of either angle, and products of low ones."""
    out = []
    for f in ('cos', 'sin'):
        out += [column(r, (f, 'E', k)) for r in ('el', 'np', 'az') for k in range(1, 6)]
        out += [column(r, (f, 'A', k)) for r in ('el', 'az', 'lr', 'np') for k in range(1, 7)]
        out += [column(r, (f, 'A', i), (g, 'E', j)) for r in ('el', 'lr') for g in ('cos', 'sin')
                for i in range(1, 4) for j in range(1, 4)]
    return (*(TERM_KEYS[name] for name in ('CA', 'NPAE', 'AN', 'AW', 'TX')),
            *(key for key in dict.fromkeys(out) if _own(key)))


def _number(value, width):
    for digits in (6, 5, 4, 3, 2, 1):
        text = f'{value:+.{digits}f}'
        if len(text) <= width:
            break
    return text


def _write(sheet):
    rows = [sheet.caption[:79],
            f'T{sheet.observations:5d}{sheet.rms_arcsec:9.4f}    0.000   0.0000']
    for name, value in sheet.terms.items():
        value, sigma = value / ARCSEC, sheet.sigma.get(name, 0.0) / ARCSEC
        number = _number(value, _WIDTH - (len(name) > 7))
        rows.append(f'  {name:<8}{number:>{_WIDTH}}{sigma:12.5f}')
    return '\n'.join([*rows, 'END']) + '\n'


_ROW = re.compile(r'([&=\s]*)([A-Za-z]\w*)\s+(\S+)(?:\s+(\S+))?')
_METHOD = re.compile(r'[A-Za-z]\s+\d+(\s+[-+.\d]+){1,4}\s*')


def _looks_like(text):
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) >= 2 and _METHOD.fullmatch(lines[1].strip()):
        return True
    words = [line.lstrip('&= \t').split() for line in lines if not line.startswith(('#', '!'))]
    return bool(words) and all(
        word == ['END'] or (2 <= len(word) <= 3 and re.fullmatch(r'[A-Z]\w*', word[0])
                            and re.fullmatch(r'[-+.\deE]+|[-+]?(nan|inf)', word[1], re.IGNORECASE))
        for word in words)


def _read(path, text, of=columns_of, mount=ALTAZ):
    lines = [(i, line.rstrip()) for i, line in enumerate(text.splitlines(), 1)
             if line.strip() and not line.lstrip().startswith(('!', '#'))]
    framed = len(lines) >= 2 and _METHOD.fullmatch(lines[1][1].strip())
    found, ended, fixed, names = ModelFile({}), False, [], {}
    for number, line in lines[2:] if framed else lines:
        if line.strip().upper() == 'END':
            ended = True
            break
        match = _ROW.fullmatch(line)
        if not match:
            raise ValueError(f'{path}, row {number}: {line.strip()[:60]!r} is no term; expected '
                             'name, coefficient in arcsec, sigma')
        flags, name, value, sigma = match.groups()
        name = name.upper()
        if name in names:
            raise ValueError(f'{path}, row {number}: {name} is there twice')
        names[name] = number
        found.terms[name] = number_of(path, number, name, value) * ARCSEC
        if sigma is not None:
            found.sigma[name] = abs(number_of(path, number, f'sigma of {name}', sigma)) * ARCSEC
        if '=' in flags:
            fixed.append(name)
    if mount.vertical:
        refuse_equatorial(path, [name for name in names if of(name) is None])
    unknown = [f'{name} (row {names[name]})' for name in names if of(name) is None]
    if unknown:
        known = f'{", ".join(_NAMED)}, ECEC, harmonics as HASA2, HECA, HVSA2, HESA3CE3 ' \
            'and polynomials as PZZ1' if mount.vertical else ', '.join(_signs(mount))
        raise ValueError(f'{path}: {", ".join(unknown)} is no term that is known here; known are '
                         + known)
    if not names:
        raise ValueError(f'{path} holds no term')
    if framed and not ended:
        raise ValueError(f'{path} ends without END: it is cut short')
    if fixed:
        found.notes.append('held fixed in TPOINT, taken as the others: ' + ', '.join(fixed))
    return found


def _signs(mount):
    """TPOINT's name of each term of another mount -> our coefficient for a unit of TPOINT's."""
    return {name: float(term.tpoint_sign) for name, term in terms_of(mount).items()
            if term.tpoint_sign}


def _for_mount(mount):
    """TPOINT for an equatorial mount, on both pier sides."""
    signs = _signs(mount)
    return for_celestial(
        PROGRAM, mount, {name: (name, sign) for name, sign in signs.items()},
        encoder=lambda values, az, el: rotations(values, az, el, mount),
        read=lambda path, text: _read(path, text, signs.get, mount), otherwise=(
            ('read to first order at the encoder angles',
             lambda values, az, el: first_order_at_encoder(values, az, el, mount)),))


def _kernel(values, az, el):
    """Encoder angles with the geometric terms as SPK's rotations, the others at the target."""
    turned = {key: value for key, value in values.items() if spk.PROGRAM.own(key)}
    a, e = spk.PROGRAM.encoder(turned, az, el)
    x, y = summed({key: value for key, value in values.items() if key not in turned}, az, el)
    return a + x / np.cos(el), e + y


PROGRAM = Program(
    'tpoint', 'TPOINT', _own, columns_of, _candidates(), rotations, _write, _read, _looks_like,
    'rotation', otherwise=(
        ('read to first order at the encoder angles (pytelpoint and others)',
         first_order_at_encoder),
        ('read by the rotations of SPK and TCSpk', _kernel)), for_mount=_for_mount)
