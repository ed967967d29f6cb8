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

"""Loads satellite tracks from files, with their orbits and the star runs to fit with them."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.analysis.satellites.track_faults import elements_age
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import centred, is_beyond, parse_mount, through_pole
from pointing_model.runs.columns.pier_side import sides_of
from pointing_model.runs.copies import written_twice
from pointing_model.runs.run import column_name, known_site
from pointing_model.runs.satellite_tracks import STARS, satellite_tracks
from pointing_model.runs.track_reader import read_track
from pointing_model.sky.orbits.orbit_files import Orbits
from pointing_model.sky.places import icrs_to_observed
from pointing_model.sky.refraction import Weather, air_at, air_of_rows
from pointing_model.sky.site import SITE, Site
from telescope_mount.nights.night_files import is_log, log_of

from .run_loader import load_run

_AIR = ('pressure', 'pressure_hpa'), ('temperature', 'temperature_c')


@dataclass
class MeasuredTracks:
    """n rows of track files, and what is needed to make `SatelliteTracks` of them.

    Attributes
    ----------
    columns : dict of str to ndarray, shape (n,)
        ``time``, ``az_enc``, ``el_enc``; for stars ``az``, ``el``.
    names : ndarray of str, shape (n,)
        Names of the satellites; `STARS` for stars.
    orbits : dict of str to orbit
    site : Site
    weather : Weather
        Pressure and temperature of each row.
    mount : Mount
    notes : list of str or Finding
    """

    columns: dict
    names: np.ndarray
    orbits: dict
    site: Site
    weather: Weather
    mount: object
    notes: list

    def tracks(self, shift=0.0, rows=slice(None)):
        """`SatelliteTracks` of some rows, with time stamps shifted later by `shift` seconds."""
        columns = {name: value[rows] for name, value in self.columns.items()}
        columns['time'] = columns['time'] + shift
        chosen = np.arange(len(self.names))[rows]

        def air(of):
            rows = chosen[of]
            return replace(self.weather, pressure_hpa=self.weather.pressure_hpa[rows],
                           temperature_c=self.weather.temperature_c[rows])
        return satellite_tracks(columns, self.names[rows], self.orbits, self.site, air, self.mount,
                                {'notes': list(self.notes)})


def load_tracks(paths, orbit_paths, name=None, stars=(), *, site=None, weather=None, mount=None):
    """Read track files, orbits, and pointing runs of stars.

    Parameters
    ----------
    paths : sequence of Path
        CSV with ``time``, the readings (``az_enc_deg``, ``el_enc_deg``, or the names of the
        mount) and the camera's miss distance (``miss_x_arcsec``, ``miss_y_arcsec``) if any; or
        without readings the observed place of the satellite from stars in the field, ``az_deg``,
        ``el_deg`` or ``ra_deg``, ``dec_deg`` (J2000). A column ``satellite`` names it. Or logs,
        whose stars are used, too.
    orbit_paths : sequence of Path
    name : str, optional
        The satellite of rows without a name.
    stars : sequence of Path
        Pointing runs of stars.
    site, weather, mount
        See `run_loader.load_run`.

    Returns
    -------
    MeasuredTracks

    Raises
    ------
    ValueError
        One line that says what is wrong with a file.
    """
    orbits, parts, notes = Orbits(orbit_paths), [], []
    weather = vars(weather) if isinstance(weather, Weather) else weather
    paths = [log_of(path) for path in paths]
    logs = [path for path in paths if is_log(path)]
    for path in [path for path in paths if path not in logs]:
        part = read_track(path, mount)
        notes += part.notes
        parts.append(part)
    runs = [load_run(path, satellites=True) for path in logs]
    site = _site_of(parts, runs, paths[0], site)
    frame = next((part.mount for part in parts if part.mount is not None), None)
    frame = runs[0].mount if runs and not parts else parse_mount(
        mount or frame or 'altaz', site.latitude)
    found, columns, names = {}, [], []
    for part in parts:
        label = np.array([str(_orbit(orbits, found, one or name)) for one in part.names.tolist()],
                         dtype=object)
        columns.append(_measured(part, site, weather, frame, notes))
        names.append(label)
    for run in runs:
        columns.append(_star_columns(run, frame))
        names.append(_names_of(run, orbits, found))
    for path in stars:
        run = load_run(path, site=vars(site), mount=mount,
                       **({'weather': weather} if weather else {}))
        if 'star' in run and run['star'].dtype.kind in 'if':
            run = run.select(run['star'] >= 0)
        columns.append(_star_columns(run, frame))
        names.append(np.full(len(run), STARS, dtype=object))
    joined, names = _joined(columns), np.concatenate(names)
    copied = np.ones(len(names), bool)
    copied[np.unique([joined[key] for key in ('time', 'az_enc', 'el_enc')], axis=1,
                     return_index=True)[1]] = False
    if copied.any():
        notes.append(written_twice(copied))
        joined, names = {key: of[~copied] for key, of in joined.items()}, names[~copied]
    if 'run' in joined:
        unknown = np.isnan(joined['run'])
        joined['run'][unknown] = min(set(range(len(unknown) + 1)) - set(joined['run'].tolist()))
    base, unknown = air_at(site.height, weather), np.full(len(joined['time']), np.nan)
    own = {key: joined.get(name, unknown) for name, key in _AIR}
    air = replace(base, **{key: np.where(np.isfinite(of), of, getattr(base, key))
                           for key, of in own.items()})
    notes += orbits.notes + [elements_age(orbit, joined['time'][names == one])
                             for one, orbit in found.items() if not orbit.precise]
    return MeasuredTracks(joined, names, found, site, air, frame, notes)


def _site_of(parts, runs, path, given):
    """The site. Its height must be known, too: 500 m are 13" for a LAGEOS satellite."""
    known = {}
    for one in (*(part.site for part in parts), *(known_site(run.meta) for run in runs)):
        known |= one
    known |= given or {}
    missing = [key for key, one in SITE.items() if one.field not in known]
    if missing:
        what = 'the height of the site' if missing == ['height_m'] else 'the site'
        asked = ' and '.join(f'--{SITE[key].field}' for key in missing)
        lines = ', '.join(f'"# {key}: ..."' for key in missing)
        raise ValueError(f'{path}: {what} is not known; give {asked}, or lines {lines} before the '
                         'header')
    return Site(**{one.field: known[one.field] for one in SITE.values()})


def _names_of(run, orbits, found):
    """Satellites of the rows of a log, by number; ValueError if an orbit is missing."""
    by_number = {}
    for name in orbits.names:
        orbit = orbits.orbit(name)
        by_number[int(orbit.number)] = orbit
    out = np.full(len(run), STARS, dtype=object)
    for number in np.unique(run['star'][run['star'] < 0]):
        orbit = by_number.get(int(-number))
        if orbit is None:
            raise ValueError(f'{run.meta["source"]}: no orbit of satellite {-int(number)}; there '
                             f'are {", ".join(by_number[one].name for one in by_number)}')
        found[orbit.name] = orbit
        out[run['star'] == number] = orbit.name
    return out


def _orbit(orbits, found, name):
    orbit = orbits.orbit(name)
    found[orbit.name] = orbit
    return orbit.name


def _measured(part, site, weather, mount, notes):
    """Readings with the satellite centred, or its observed place, in the axes of the mount."""
    cells, out = part.cells, {'time': part.cells['time']}
    try:
        air, said = air_of_rows(site.height, cells.get('pressure_hpa'), cells.get('temperature_c'),
                                part.weather, weather)
    except ValueError as error:
        raise ValueError(f'{part.path}: {error}') from None
    notes += said
    out |= {name: np.broadcast_to(getattr(air, key), len(out['time'])) for name, key in _AIR}
    if 'run' in cells:
        out['run'] = cells['run']
    if set(part.keys) <= set(cells):
        keys = tuple(column_name(axis, mount.names) for axis in ('az_enc', 'el_enc'))
        if part.keys != keys:
            raise ValueError(f'{part.path}: the columns {", ".join(part.keys)} are not of a mount '
                             f'that is {mount.kind}, which has {", ".join(keys)}')
        az, el = (cells[key] * DEG for key in part.keys)
        if mount.two_sided and 'pier_side' in cells and not is_beyond(el).any():
            side, said = sides_of(part.path, cells['pier_side'], az, np.isfinite(az))
            if not np.isfinite(side).all():
                raise ValueError(f'{part.path}: pier_side is unknown in '
                                 f'{int((~np.isfinite(side)).sum())} of {len(side)} rows; give '
                                 'east or west in every row of a track, or readings beyond 90 deg')
            az, el = mount.on_travel(*through_pole(az, el, side == 1.0))
            notes += said
        miss = [np.nan_to_num(cells[one]) * ARCSEC if one in cells else np.zeros(len(az))
                for one in ('miss_x_arcsec', 'miss_y_arcsec')]
        out['az_enc'], out['el_enc'] = centred(az, el, *miss, np.cos(el) < 0.0)
        if any(one.any() for one in miss):  # on the sky, as applied
            out['miss_x'] = wrap(out['az_enc'] - az) * np.cos(el)
            out['miss_y'] = wrap(out['el_enc'] - el)
    elif 'az_deg' in cells:
        out['az_enc'], out['el_enc'] = mount.axes_of(cells['az_deg'] * DEG, cells['el_deg'] * DEG)
    else:
        out['az_enc'], out['el_enc'] = mount.axes_of(*icrs_to_observed(
            cells['ra_deg'] * DEG, cells['dec_deg'] * DEG, cells['time'], site, air))
    return out


def _star_columns(run, mount):
    if not run.mount.agrees(mount):
        raise ValueError(f'{run.meta.get("source")}: a run of {run.mount.names.words}; '
                         f'the tracks are of one that is {mount.kind}')
    time = np.asarray(run.get('time'), float)
    if not np.isfinite(time).all():
        raise ValueError(f'{run.meta.get("source")}: stars fitted with tracks need the time of '
                         'every row (column time)')
    # the zeros of a log's power-ons are already subtracted
    names = ('az', 'el', 'az_enc', 'el_enc', 'temperature', 'pressure',
             *([] if 'az_raw' in run else ['run']))
    return {name: np.asarray(run[name], float) for name in names if name in run} | {'time': time}


def _joined(parts):
    every = sorted({name for part in parts for name in part})
    return {name: np.concatenate([part.get(name, np.full(len(part['time']), np.nan))
                                  for part in parts]) for name in every}
