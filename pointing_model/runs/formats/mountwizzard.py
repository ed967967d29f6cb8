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

"""Model files of MountWizzard4: the solved images of a 10micron mount, as JSON."""

import json
from pathlib import PurePath

import numpy as np

from msg_tools.units import DEG
from pointing_model.mount_kinds import KINDS
from pointing_model.runs.plate_solves.frames import ICRS

from ..columns.cell_values import TextRows
from ..columns.run_table import NoObservations, RunFormat, RunTable

#: keys needed in each point; siderealTime and raJ2000S in hours, the others in degrees
_NUMBERS = ('raJ2000S', 'decJ2000S', 'decJNowS', 'angularPosRA', 'angularPosDEC', 'siderealTime')
_PRECESSED = 1.0  # deg: largest change of a declination between J2000 and now
_SAME_SITE = 0.1  # deg: the first point of a run may carry a rounded latitude


def looks_like(lines):
    """Whether this is a JSON list of MountWizzard4 points."""
    first = next((line.strip() for line in lines if line.strip()), '')
    return first.startswith('[') and any('"raJ2000S"' in line or '"angularPosRA"' in line
                                         for line in lines)


def read(path, lines):
    """Read a MountWizzard4 ``.model``: a list of points, each an image, solved or not.

    The readings are ``angularPosRA`` and ``angularPosDEC``, the mechanical angles of the axes. East
    of the pier they are hour angle and declination - 90, west of it hour angle + 180 and 90 -
    declination: 58 points of such a file agree to 0.0006 deg. So the second plus 90 is the
    declination, beyond 90 through the pole. The place is the J2000 solution, the time that of the
    mount's sidereal clock.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str

    Returns
    -------
    RunTable
        One row per point, numbered from 1; ``meta['row_names']`` has their images.

    Raises
    ------
    ValueError
        The file is not JSON or not a list of points, most times are bad, no point has a latitude,
        or points are of several sites.
    """
    try:
        points = json.loads('\n'.join(lines))
    except (json.JSONDecodeError, RecursionError) as error:
        where = f', row {error.lineno}' if isinstance(error, json.JSONDecodeError) else ''
        raise ValueError(f'{path}{where}: no JSON') from None
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise ValueError(f'{path} is no list of points of MountWizzard4')
    if not points:
        raise NoObservations(f'{path} has no point')
    rows = TextRows(path, range(1, len(points) + 1))
    values = {name: np.array([_number(point.get(name)) for point in points])
              for name in (*_NUMBERS, 'scaleS', 'latitude')}
    names = [PurePath(str(point.get('imagePath') or '')).name for point in points]
    meta = {'format': 'mountwizzard4', 'time_note': "time: of the mount's sidereal clock",
            'notes': [],
            'site': {'latitude': _latitude(path, values['latitude'])}, 'mount_declared': 'german',
            'sidereal_clock': True, 'sky_frame': ICRS,
            'row_names': {int(i): name for i, name in zip(rows.lines, names) if name}}
    if not np.isfinite(values['scaleS']).any():
        del values['scaleS']
    times = [str(point.get('julianDate') or '').strip() for point in points]
    columns = {
        'star': np.array(names), 'time': rows.iso_times('julianDate', times),
        'ra_deg': 15.0 * values['raJ2000S'], 'dec_deg': _declination(values),
        'lst_given': 15.0 * values['siderealTime'], 'az_enc': values['angularPosRA'],
        'el_enc': values['angularPosDEC'] + 90.0}
    if 'scaleS' in values:
        columns['scale_arcsec_px'] = values['scaleS']
    if all(isinstance(point.get('mirroredS'), bool) for point in points):
        columns['parity'] = np.array([1.0 if point['mirroredS'] else -1.0 for point in points])
    table = RunTable(columns, rows.lines, meta, rows.reasons, names=KINDS['equatorial'])
    for i, point in enumerate(points):
        missing = [name for name in _NUMBERS if not np.isfinite(values[name][i])]
        if point.get('success') is False:
            reason = f'not solved ({str(point.get("message") or "no message")[:60]})'
        elif missing:
            reason = f'no {", ".join(missing)}'
        elif not np.isfinite(columns['dec_deg'][i]):
            reason = 'decJ2000S does not belong to decJNowS'
        else:
            continue
        table.exclude_row(i, reason)
    return table


def _number(value):
    """A JSON number as float; NaN if it is not a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return np.nan
    return float(value)


def _declination(values):
    """J2000 declinations, degrees; some versions wrote radians: the declinations of date decide."""
    given, now = values['decJ2000S'], values['decJNowS']
    with np.errstate(invalid='ignore', over='ignore'):
        ways = [np.where(np.abs(given * unit - now) < _PRECESSED, given * unit, np.nan)
                for unit in (1.0, 1.0 / DEG)]
    return max(ways, key=lambda way: np.isfinite(way).sum())


def _latitude(path, values):
    known = values[np.isfinite(values) & (np.abs(values) <= 90.0)]
    if not known.size:
        raise ValueError(f'{path}: no point has the latitude of the site')
    if np.ptp(known) > _SAME_SITE:
        raise ValueError(f'{path}: points of several sites, at latitudes {known.min():.2f} to '
                         f'{known.max():.2f}: a run is of one mount')
    return float(np.median(known)) * DEG


FORMAT = RunFormat('a model of MountWizzard4', looks_like, read,
                   'the keys were taken as this format has them')
