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

"""A satellite on an orbit of Kepler's, at epochs, and the files that archives would have of it.

Written by the specifications of the formats, by nothing of the readers.
"""

from datetime import datetime, timedelta, timezone

import numpy as np

GM, TURN = 3.986004418e14, 7.292115e-5
#: UTC of the first epoch; TAI - UTC is 37 s from 2017 on
BEGIN = datetime(2017, 12, 3, tzinfo=timezone.utc)
START = BEGIN.timestamp()


def inertial(seconds, axis=12.27e6, eccentricity=0.0135, tilt=0.92):
    """Positions and velocities, m and m/s, shape (n, 3), `seconds` after the first epoch."""
    rate = np.sqrt(GM / axis**3)
    mean = rate * np.asarray(seconds) + 0.7
    at = mean.copy()
    for _ in range(30):
        at = mean + eccentricity * np.sin(at)
    b, down = axis * np.sqrt(1.0 - eccentricity**2), 1.0 - eccentricity * np.cos(at)
    x, y = axis * (np.cos(at) - eccentricity), b * np.sin(at)
    vx, vy = -axis * np.sin(at) * rate / down, b * np.cos(at) * rate / down
    c, s = np.cos(tilt), np.sin(tilt)
    return np.stack((x, c * y, s * y), 1), np.stack((vx, c * vy, s * vy), 1)


def terrestrial(seconds, **orbit):
    """The same in axes that turn with the Earth."""
    place, rate = inertial(seconds, **orbit)
    angle = TURN * np.asarray(seconds)
    c, s = np.cos(angle), np.sin(angle)

    def turned(v):
        return np.stack((c * v[:, 0] + s * v[:, 1], c * v[:, 1] - s * v[:, 0], v[:, 2]), 1)
    place, rate = turned(place), turned(rate)
    return place, rate - TURN * np.stack((-place[:, 1], place[:, 0], 0.0 * angle), 1)


def sp3(seconds, scale='UTC', name='L52', version='c', velocities=True, frame='SLR08',
        shift=0.0, agency='ILRS', code=0, end=True, **orbit):
    """An SP3 file; `shift` is the scale less UTC, s."""
    place, rate = terrestrial(seconds, **orbit)
    first = BEGIN + timedelta(seconds=shift)
    lines = [f'#{version}{"V" if velocities else "P"}{first:%Y %m %d %H %M} '
             f'{first.second:11.8f} {len(place):7d} {"ORBIT":5} {frame:5} FIT {agency:>4}',
             '## 1978      0.00000000   120.00000000 58090 0.0000000000000',
             f'+    1   {name:>3}' + '  0' * 16, f'++       {code:3d}' + '  0' * 16,
             f'%c L  cc {scale} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc',
             '%f  0.0000000  0.000000000  0.00000000000  0.000000000000000', '/* a comment',
             '%/* another']
    for second, p, v in zip(seconds, place / 1e3, rate * 10.0):
        at = first + timedelta(seconds=float(second))
        lines.append(f'*  {at.year:4d} {at.month:2d} {at.day:2d} {at.hour:2d} {at.minute:2d} '
                     f'{at.second + 1e-6 * at.microsecond:11.8f}')
        lines.append(f'P{name:>3}{p[0]:14.6f}{p[1]:14.6f}{p[2]:14.6f} 999999.999999')
        if velocities:
            lines.append(f'V{name:>3}{v[0]:14.6f}{v[1]:14.6f}{v[2]:14.6f} 999999.999999')
    return '\n'.join(lines + ['EOF'] * end) + '\n'


def cpf(seconds, version=2, frame=0, velocities=True):
    """A CPF file of the ILRS."""
    place, rate = terrestrial(seconds)
    sub = ' 01' if version == 2 else ''
    last = BEGIN + timedelta(seconds=float(seconds[-1]))
    lines = [f'H1 CPF  {version}  HTS {BEGIN:%Y %m %d} 00  8371{sub} lageos2    NONE',
             f'H2  9207002 5986    22195 {BEGIN:%Y %m %d %H %M %S} {last:%Y %m %d %H %M %S} '
             f'  240 1 1 {frame:2d} 0 0' + ' 1' * (version == 2), 'H9']
    for second, p, v in zip(seconds, place, rate):
        day, rest = divmod(float(second), 86400.0)
        lines.append(f'10 0 {58090 + int(day)} {rest:13.6f} 0 {p[0]:17.3f} {p[1]:17.3f} '
                     f'{p[2]:17.3f}')
        if velocities:
            lines.append(f'20 0 {v[0]:19.6f} {v[1]:19.6f} {v[2]:19.6f}')
    return '\n'.join([*lines, '99']) + '\n'


def oem(seconds, frame='ITRF2014', scale='UTC', states=terrestrial, sigma=None, shift=0.0,
        by_day=False):
    """An orbit ephemeris message in keywords."""
    place, rate = states(seconds)
    lines = ['CCSDS_OEM_VERS = 2.0', 'CREATION_DATE = 2017-12-04T00:00:00', 'ORIGINATOR = TEST',
             'META_START', 'OBJECT_NAME = LAGEOS-2', 'OBJECT_ID = 1992-070B',
             'CENTER_NAME = EARTH', f'REF_FRAME = {frame}', f'TIME_SYSTEM = {scale}', 'META_STOP',
             'COMMENT a comment']
    for second, p, v in zip(seconds, place / 1e3, rate / 1e3):
        at = BEGIN + timedelta(seconds=float(second) + shift)
        date = f'{at:%Y-%jT%H:%M:%S.%f}' if by_day else f'{at:%Y-%m-%dT%H:%M:%S.%f}'
        lines.append(date + ''.join(f' {x:.9f}' for x in (*p, *v)))
    if sigma is not None:
        lines += ['COVARIANCE_START', f'EPOCH = {BEGIN:%Y-%m-%dT%H:%M:%S}']
        for i in range(6):
            lines.append(' '.join(f'{(sigma / 1e3)**2 if i == j else 0.0:.9e}'
                                  for j in range(i + 1)))
        lines.append('COVARIANCE_STOP')
    return '\n'.join(lines) + '\n'
