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

"""Raw pointing nights of the MMT."""

import numpy as np

from ..columns.cell_values import is_number, sexagesimal
from ..columns.run_table import RunFormat, RunTable

_SIDEREAL_HOUR = 3600.0 / 1.00273790935  # s of UT
_WANTED = {'RAA': ('az', 'el'), 'TAA': ('az_enc', 'el_enc'), 'ABS_AA': ('az_abs', 'el_abs')}


def looks_like(lines):
    """Whether one of the first lines starts the record of a star."""
    return any(line.startswith('CAT:') for line in lines[:50])


def read(path, lines):
    """Read a raw MMT night: for each star a CAT: line, then pairs of elevation and azimuth.

    RAA is the refracted place of the catalogue star (within 0.3" of the place computed with ERFA
    for the coordinates and the sidereal time of the record), AA the same with the telescope's own
    pointing model, TAA the mount angles with the star centred, ABS_AA the absolute encoder. All
    azimuths are from north through east; those of the mount include the cable wrap.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str

    Returns
    -------
    RunTable
        With both encoders and the sidereal time. ``time`` is the sidereal time in seconds of UT,
        from an arbitrary start (``meta['time_is_utc']`` is False).

    Raises
    ------
    ValueError
        Most records lack an angle; single ones are excluded.
    """
    starts = [i for i, line in enumerate(lines) if line.startswith('CAT:')]
    values = {name: [] for pair in _WANTED.values() for name in pair}
    stars, magnitudes, sidereal = [], [], []
    reasons = np.zeros(len(starts), dtype=object)
    for i, (start, stop) in enumerate(zip(starts, [*starts[1:], len(lines)])):
        fields = {}
        for line in lines[start:stop]:
            tag, _, rest = line.partition(':')
            fields[tag.strip()] = rest.split()
        for tag, (az, el) in _WANTED.items():
            cells = fields.get(tag, [])
            if len(cells) != 2 or not all(map(is_number, cells)):
                reasons[i] = reasons[i] or ('the record of this star has no '
                                            f'"{tag}:" with elevation and azimuth')
                cells = ['nan'] * 2
            values[el].append(float(cells[0]))
            values[az].append(float(cells[1]))
        catalogue = fields.get('CAT', [])
        stars.append(catalogue[0] if catalogue else '')
        magnitude = catalogue[5] if len(catalogue) > 5 else ''
        magnitudes.append(float(magnitude) if is_number(magnitude) else np.nan)
        sidereal.append(_hours((fields.get('LST') or [''])[0]))
    bad = np.flatnonzero(reasons != 0)
    if 2 * len(bad) > len(starts):
        raise ValueError(f'{path}, row {starts[bad[0]] + 1}: {reasons[bad[0]]}')
    columns = {name: np.array(v) for name, v in values.items()}
    columns.update(star=np.array(stars), magnitude=np.array(magnitudes))
    meta = {'format': 'mmt', 'notes': [
        'az, el are RAA (refracted place), az_enc, el_enc TAA (mount with the star centred), '
        'az_abs, el_abs ABS_AA; lst_h is the local sidereal time in hours']}
    known = np.isfinite(sidereal)
    if known.any():
        hours = np.array(sidereal)
        hours[known] = np.unwrap(hours[known], period=24.0)
        columns['lst_h'] = hours
        columns['time'] = (hours - hours[known][0]) * _SIDEREAL_HOUR
        meta['time_is_utc'] = False
        meta['notes'].append('time: seconds since the first star, made from the sidereal times')
    else:
        meta['notes'].append('no time: no record has an LST')
    return RunTable(columns, np.array(starts) + 1, meta, reasons)


def _hours(clock):
    parts = clock.split(':')
    if len(parts) != 3 or not all(map(is_number, parts)):
        return np.nan
    hours = sexagesimal(parts)
    return hours if 0.0 <= hours < 24.0 else np.nan


FORMAT = RunFormat('a raw MMT night (CAT:, RAA:, TAA:)', looks_like, read, (
    'RAA, with the refraction in it, was taken for the catalogue and TAA for the mount'))
