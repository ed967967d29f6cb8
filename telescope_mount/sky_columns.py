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

"""Right ascensions and declinations of a table, as the angles of a perfect mount at their times."""

import numpy as np

from msg_tools.units import DEG
from pointing_model.model_application import axis_angles
from pointing_model.mounts import is_beyond
from pointing_model.sky.air import DEFAULT_WEATHER

#: columns of such a table
SKY = ('ra_deg', 'dec_deg')
#: words of a side of the pier -> through the pole
_SIDES = {'east': False, 'e': False, 'west': True, 'w': True}


def is_sky(cells, places):
    """Whether a table gives places of the sky, and not those of the axes."""
    return set(SKY) <= set(cells) and places[0] not in cells


def check_sky(table, ra, dec, cells):
    """Refuse what is no right ascension and declination in degrees."""
    with np.errstate(invalid='ignore'):
        for name, bad in zip(SKY, ((ra < 0.0) | (ra > 360.0), np.abs(dec) > 90.0)):
            table.refuse(name, cells[name], {
                int(i): 'is no such angle in degrees' for i in np.flatnonzero(bad)})


def observed(model, ra, dec, columns, cells, used, args):
    """The angles that a perfect mount of this kind reads there.

    Parameters
    ----------
    model : PointingModel
    ra, dec : ndarray, shape (n,)
        Degrees: ICRS, or apparent places of date with ``args.equinox``.
    columns : dict of str to ndarray
        Drivers in SI: ``time``, and the air where it is given.
    cells : dict
        Of the table, for ``pier_side``.
    used : ndarray of bool, shape (n,)
        Rows that are not left out.
    args : argparse.Namespace
        Of the command: site, air, equinox.

    Returns
    -------
    first, second : ndarray, shape (n,)
        Degrees, on the side of the pier that the table gives, else with the counterweight down.
    height : ndarray, shape (n,)
        Above the horizon, degrees.

    Raises
    ------
    ValueError
        No time or site, or another latitude than the mount's.
    """
    if 'time' not in columns:
        raise ValueError('ra_deg, dec_deg need the time: a column time, or --time UTC')
    if args.longitude is None or (args.latitude is None and not model.mount.celestial):
        raise ValueError('ra_deg, dec_deg need the site: --latitude and --longitude')
    time = columns['time']
    if not np.isfinite(time[used]).all():
        raise ValueError('ra_deg, dec_deg need the time of every row')
    how = {'longitude_deg': args.longitude, 'latitude_deg': args.latitude,
           'height_m': args.height or 0.0, 'of_date': args.equinox == 'date',
           'pressure_hpa': _air(columns, 'pressure', args.pressure, DEFAULT_WEATHER.pressure_hpa),
           'temperature_c': _air(columns, 'temperature', args.temperature,
                                 DEFAULT_WEATHER.temperature_c)}
    time = np.where(used, time, time[used][0] if used.any() else 0.0)
    found = axis_angles(model, ra, dec, time, **how)
    if not (model.mount.two_sided and 'pier_side' in cells):
        return found
    sides = [_SIDES.get(str(cell).strip().lower().removeprefix('pier').lstrip(' _'), down)
             for cell, down in zip(cells['pier_side'], is_beyond(found[1] * DEG))]
    return axis_angles(model, ra, dec, time, beyond=np.array(sides), **how)


def _air(columns, name, given, usual):
    usual = usual if given is None else given
    if name not in columns:
        return usual
    return np.where(np.isfinite(columns[name]), columns[name], usual)
