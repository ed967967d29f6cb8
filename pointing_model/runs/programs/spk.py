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

"""The pointing model of SPK, the kernel of INDI's SPK plug-in (indilib libs/alignment/spk).

It has the seven coefficients of `spkPM`, exact rotations (P. T. Wallace 2002, SPIE 4848, 125). They
are written as the C assignments of its demonstrations, converted to radians by AS2R. INDI's plug-in
has no file for them: it fits six (no NP) to its synchronisation points. There VD is multiplied by
cos E, like TF; in SPK as published VD is an angle, to be given as TF cos E for each target.
"""

import re

import erfa
import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.mounts import ALTAZ, is_beyond

from ..model_files.program import ModelFile, Program, for_celestial, number_of
from ..model_files.term_columns import TERM_KEYS

#: member of spkPM -> our term and SPK's coefficient for a unit of ours
_MEMBERS = {'pia': ('IA', 1), 'pib': ('IE', -1), 'pvd': ('TF', 1), 'pca': ('CA', 1),
            'pnp': ('NPAE', 1), 'paw': ('AW', 1), 'pan': ('AN', 1)}
#: the same for an equatorial mount, whose roll is minus the hour angle
_EQUATORIAL = {'pia': ('IH', 1), 'pib': ('ID', -1), 'pvd': ('TF', 1), 'pca': ('CH', 1),
               'pnp': ('NP', 1), 'paw': ('MA', 1), 'pan': ('ME', -1)}
_OWN = {TERM_KEYS[name]: [(own, float(sign))] for own, (name, sign) in _MEMBERS.items()}
_PASSES = 4  # each reduces the error of the place of the droop by a factor of the terms' size


def _attitude(mount, an, aw):
    """Rotation from (south, east, up) to the mount: colatitude, then -AN about y, AW about x."""
    plain = np.eye(3)
    nominal = plain if mount.vertical else erfa.ufunc.ry(mount.latitude - 0.5 * np.pi, plain)
    return erfa.ufunc.rx(aw, plain) @ erfa.ufunc.ry(-an, plain) @ nominal


def _vector(roll, pitch):
    return np.stack([np.cos(pitch) * np.cos(roll), np.cos(pitch) * np.sin(roll), np.sin(pitch)])


def _angles(v):
    return np.arctan2(v[1], v[0]), np.arctan2(v[2], np.hypot(v[0], v[1]))


def _posture(aim, tel, sn, cn, side=1.0):
    """Roll and pitch that bring the telescope vector onto the aim; side -1: through the pole."""
    lean = np.arctan2(tel[2], tel[0])
    s = aim[2] + sn * tel[1]
    with np.errstate(invalid='ignore'):  # NaN where the axes cannot point, near the pole
        c = np.sqrt(aim[0]**2 + aim[1]**2 - tel[1] * (2.0 * aim[2] * sn + tel[1]) - sn**2)
    pitch = np.arctan2(s, side * c) - lean
    sb, cb = np.sin(pitch), np.cos(pitch)
    x = cb * tel[0] - sb * tel[2]
    y = sn * sb * tel[0] + cn * tel[1] + sn * cb * tel[2]
    return np.arctan2(aim[1] * x - aim[0] * y, x * aim[0] + y * aim[1]), pitch


def _drooped(roll, pitch, mount, tel, p, sn, cn, side=1.0):
    """The telescope vector with the droop at this roll and pitch."""
    az, el = _angles(mount.T @ _vector(roll, pitch))
    raised = mount @ _vector(az, el + p['pvd'] * np.cos(el))
    a, b = _posture(raised, tel, sn, cn, side)
    sa, ca, sb, cb = np.sin(a), np.cos(a), np.sin(b), np.cos(b)
    # the drooped direction in the frame of the telescope: rotate back by roll, NP and pitch
    v = _vector(roll, pitch)
    x, y, z = ca * v[0] + sa * v[1], -sa * v[0] + ca * v[1], v[2]
    y, z = cn * y - sn * z, sn * y + cn * z
    return np.stack([cb * x + sb * z, y, -sb * x + cb * z])


def _encoder(values, az, el, mount=ALTAZ, own=_OWN.get):
    p = dict.fromkeys(_MEMBERS, 0.0)
    for key, value in values.items():
        for name, share in own(key):
            p[name] += share * value
    attitude = _attitude(mount, p['pan'], p['paw'])
    sn, cn = np.sin(p['pnp']), np.cos(p['pnp'])
    plain = np.array([np.cos(p['pca']), np.sin(p['pca']), 0.0])
    az, el = np.asarray(az, float), np.asarray(el, float)
    azimuth, elevation = mount.horizon_of(az, el)
    aim = attitude @ _vector(np.pi - azimuth, elevation)
    side = np.where(is_beyond(el), -1.0, 1.0)
    turn = np.pi if mount.vertical else 0.0  # roll is this minus the azimuth or the hour angle
    roll, pitch = turn - az, el
    for _ in range(_PASSES):
        tel = _drooped(roll, pitch, attitude, plain, p, sn, cn, side)
        roll, pitch = _posture(aim, tel, sn, cn, side)
    out = turn - roll + p['pia']
    pitch = el + np.mod(pitch - el + np.pi, 2.0 * np.pi) - np.pi
    return az + np.mod(out - az + np.pi, 2.0 * np.pi) - np.pi, pitch - p['pib']


def _write(sheet):
    rows = [f'/* {sheet.caption.replace("*/", "* /")} */', '/* spkPM pm; arcseconds by AS2R */']
    for name, (meaning, _) in _MEMBERS.items():
        rows.append(f'   pm.{name} = {sheet.terms.get(name, 0.0) / ARCSEC:14.7f} * AS2R;'
                    f'  /* {meaning}{": times cos E" * (meaning == "TF")} */')
    return '\n'.join([*rows, '   pm.ga = 0.0;', '   pm.gb = 0.0;']) + '\n'


_ROW = re.compile(r'\s*pm(?:\.|->)(\w+)\s*=\s*([^;*\s]+)\s*(\*\s*AS2R)?\s*(\*[^;]*)?;.*')


def _read(path, text):
    found = ModelFile({})
    for number, line in enumerate(text.splitlines(), 1):
        match = _ROW.fullmatch(line)
        if not match:
            if re.match(r'\s*pm(\.|->)', line):
                raise ValueError(f'{path}, row {number}: {line.strip()[:60]!r} is no assignment of '
                                 'a number')
            continue
        name, value, arcsec, more = match.groups()
        value = number_of(path, number, name, value) * (ARCSEC if arcsec else 1.0)
        if name in ('ga', 'gb'):
            if value:
                found.notes.append(f'{name} is of the guider: left out')
            continue
        if name not in _MEMBERS:
            raise ValueError(f'{path}, row {number}: {name} is no member of spkPM; known are '
                             f'{", ".join(_MEMBERS)}')
        if more:
            raise ValueError(f'{path}, row {number}: {line.strip()[:60]!r} follows the target; '
                             'give the coefficient alone (TF for pvd)')
        if name in found.terms:
            raise ValueError(f'{path}, row {number}: {name} is there twice')
        found.terms[name] = value
    if not found.terms:
        raise ValueError(f'{path} holds no coefficient of spkPM')
    return found


def _for_mount(mount):
    """SPK for an equatorial mount, on both pier sides."""
    made = for_celestial(
        PROGRAM, mount, _EQUATORIAL,
        encoder=lambda values, az, el: _encoder(values, az, el, mount, made.own))
    return made


_looks_like = re.compile(r'^\s*pm(\.|->)p\w\w\s*=', re.MULTILINE).search
PROGRAM = Program(
    'spk', 'SPK (INDI)', _OWN.get,
    lambda name: [(TERM_KEYS[_MEMBERS[name][0]], float(_MEMBERS[name][1]))],
    tuple(_OWN), _encoder, _write, _read, _looks_like, None, for_mount=_for_mount)
