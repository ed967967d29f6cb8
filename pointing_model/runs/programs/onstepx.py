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

"""The align model of OnStepX (hjd1964/OnStepX, src/telescope/mount/coordinates/Align.hs.cpp).

Set by the commands ``:SX0n,value#`` in whole arcseconds (phases in whole degrees) and made active
by ``:SX09,2#`` (src/telescope/mount/goto/Goto.command.cpp); ``:AW#`` saves it. For an alt-azimuth
mount it is encoder - catalogue, azimuth from north through east, to first order at the mount's
angles without the zeros.
"""

import re

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ

from ..model_files.program import ModelFile, Program, for_celestial, number_of
from ..model_files.term_columns import KEY_TERMS, TERM_KEYS, column, summed

_WAVES = {'hca': ('az', 'A'), 'dca': ('el', 'E')}
#: number of the command -> OnStepX's name
_COMMANDS = {'0': 'ax1Cor', '1': 'ax2Cor', '2': 'altCor', '3': 'azmCor', '4': 'doCor',
             '5': 'pdCor', '6': 'dfCor', '8': 'tfCor', 'a': 'hcp', 'b': 'hca', 'c': 'dcp',
             'd': 'dca'}
#: name -> our column, and its coefficient for a unit of ours
_TERMS = {'ax1Cor': (TERM_KEYS['IA'], -1), 'ax2Cor': (TERM_KEYS['IE'], 1),
          'altCor': (TERM_KEYS['AN'], 1), 'azmCor': (TERM_KEYS['AW'], -1),
          'doCor': (TERM_KEYS['CA'], 1), 'pdCor': (TERM_KEYS['NPAE'], -1),
          'dfCor': (TERM_KEYS['HECA'], 1), 'tfCor': (TERM_KEYS['TF'], -1)}
_OWN = {key: [(name, float(sign))] for name, (key, sign) in _TERMS.items()}
# waves are kept as cosine and sine, written as amplitude and phase; cos E in elevation is tfCor
for _name, (_result, _angle) in _WAVES.items():
    for _f in ('cos', 'sin'):
        _OWN.setdefault(column(_result, (_f, _angle, 1)), [(f'{_name} {_f}', 1.0)])
_COLUMNS = {name: [(key, sign)] for key, [(name, sign)] in _OWN.items()}
#: the same for an equatorial mount. dfCor is for a fork; on a German mount it is flexure of the
#: declination axis that changes the declination, for which there is no term here
_EQUATORIAL = {'ax1Cor': ('IH', -1), 'ax2Cor': ('ID', 1), 'altCor': ('ME', 1), 'azmCor': ('MA', 1),
               'doCor': ('CH', 1), 'pdCor': ('NP', -1), 'dfCor': ('FO', 1), 'tfCor': ('TF', -1)}
_INDEX = tuple(TERM_KEYS[name] for name in ('IA', 'IE'))


def _encoder(values, az, el, mount=ALTAZ, index=_INDEX):
    moved = {key: value for key, value in values.items() if key not in index}
    a, e = np.asarray(az, float), np.asarray(el, float)
    for _ in range(3):  # as in OnStepX
        x, y = summed(moved, a, e, mount)
        a, e = az + x / np.cos(e), el + y
    return a + values.get(index[0], 0.0), e + values.get(index[1], 0.0)


def _write(sheet):
    terms = dict(sheet.terms)
    rows = [f'# {sheet.caption}']
    numbers = {name: n for n, name in _COMMANDS.items()}
    for wave, phase in (('hca', 'hcp'), ('dca', 'dcp')):
        cos, sin = (terms.pop(f'{wave} {f}', 0.0) for f in ('cos', 'sin'))
        # c cos u + s sin u = size cos(u + phase)
        terms[wave], terms[phase] = np.hypot(cos, sin), np.arctan2(-sin, cos) if cos or sin else 0.0
    for name, number in numbers.items():
        unit = DEG if name in ('hcp', 'dcp') else ARCSEC
        value = int(np.rint(terms.get(name, 0.0) / unit))
        rows.append(f':SX0{number},{value}#')
    return '\n'.join([*rows, ':SX09,2#']) + '\n'


_ROW = re.compile(r':SX0(\w),([^#]*)#')


def _read(path, text):
    given = {}
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if not line.startswith(':'):
            continue
        match = _ROW.fullmatch(line)
        if not match:
            raise ValueError(f'{path}, row {number}: {line[:40]!r} is no command :SX0n,value#')
        if match[1] == '9' or match[1] == '7' and not number_of(path, number, 'dfCor', match[2]):
            continue
        if match[1] not in _COMMANDS:
            raise ValueError(f'{path}, row {number}: :SX0{match[1]} sets no coefficient that is '
                             'read (7: flexure of the declination axis of an equatorial mount)')
        name = _COMMANDS[match[1]]
        if name in given:
            raise ValueError(f'{path}, row {number}: {name} is there twice')
        given[name] = number_of(path, number, name, match[2])
    if not given:
        raise ValueError(f'{path} holds no command :SX0n,value#')
    out = {name: value * ARCSEC for name, value in given.items() if name in _TERMS}
    for wave, phase in (('hca', 'hcp'), ('dca', 'dcp')):
        size, angle = given.get(wave, 0.0) * ARCSEC, given.get(phase, 0.0) * DEG
        if size:
            for f, value in (('cos', size * np.cos(angle)), ('sin', -size * np.sin(angle))):
                key = column(_WAVES[wave][0], (f, _WAVES[wave][1], 1))
                for name, share in _OWN[key]:
                    out[name] = out.get(name, 0.0) + share * value
    return ModelFile(out)


def _for_mount(mount):
    """OnStepX for an equatorial mount, on both pier sides."""
    terms = {name: row for name, row in _EQUATORIAL.items()
             if name != 'dfCor' or not mount.two_sided}
    index = tuple((name, ()) for name in mount.names.index)

    def read(path, text):
        found = _read(path, text)
        unknown = [name for name, value in found.terms.items() if value and name not in terms]
        if unknown:
            raise ValueError(f'{path}: {", ".join(unknown)} is not read of {mount.names.words}')
        found.terms = {name: value for name, value in found.terms.items() if name in terms}
        return found
    return for_celestial(
        PROGRAM, mount, terms, read=read,
        encoder=lambda values, az, el: _encoder(values, az, el, mount, index))


_looks_like = re.compile(r'^:SX0\w,', re.MULTILINE).search
PROGRAM = Program(
    'onstepx', 'OnStepX', _OWN.get, _COLUMNS.get, tuple(key for key in _OWN if key in KEY_TERMS),
    _encoder, _write, _read, _looks_like, None, whole=ARCSEC, for_mount=_for_mount)
