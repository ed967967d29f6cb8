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

"""Tracks of made-up satellites over a site, with what the encoders of a mount would read."""

import numpy as np
from kepler_orbit import START, terrestrial

from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.runs.satellite_tracks import STARS, satellite_tracks
from pointing_model.sky.orbits.ephemeris import Arc, Orbit
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.satellite_place import satellite_place
from pointing_model.sky.site import Site

SITE = Site(34.3 * DEG, 109.0 * DEG, 500.0)
TRUTH = {'IA': 120.0, 'IE': -80.0, 'CA': 30.0, 'NPAE': -20.0, 'AN': 40.0, 'AW': -25.0, 'TF': 15.0}
#: name -> what of `kepler_orbit.inertial` it is
ORBITS = {'A01': {'axis': 12.27e6, 'tilt': 0.92}, 'B02': {'axis': 14.5e6, 'tilt': 1.9},
          'C03': {'axis': 19.0e6, 'tilt': 1.1}, 'D04': {'axis': 25.5e6, 'tilt': 2.2}}
STEP = 40.0


def made_orbit(name, hours=30.0, sigma=0.05):
    """A precise orbit of `ORBITS`."""
    seconds = 120.0 * np.arange(int(hours * 30.0))
    place, _ = terrestrial(seconds, **ORBITS[name])
    return Orbit(name, (Arc(START + 37.0, seconds, place, None, np.full(len(place), sigma), ''),))


def passes(orbit, count, least=900.0, low=25.0 * DEG, longest=2400.0):
    """Times of the first passes above `low`, at most so long."""
    time = np.arange(orbit.begin + 60.0, orbit.end - 60.0, STEP)
    up = satellite_place(orbit, time, SITE)[1] > low
    runs = np.split(time, np.flatnonzero(np.diff(up)) + 1)
    found = [run for run, there in zip(runs, np.split(up, np.flatnonzero(np.diff(up)) + 1))
             if there[0] and len(run) * STEP >= least]
    return [run[:int(longest / STEP)] for run in found[:count]]


def made_tracks(rng, arcs, stars=0, clock=0.0, ahead=None, noise=1.0 * ARCSEC, sigma=0.05,
                truth=TRUTH):
    """Rows of satellites, so many arcs of each, and stars, as encoders read them.

    Parameters
    ----------
    arcs : dict of str to int
    clock : float
        s that the stamps are late.
    ahead : dict of str to float, optional
        s.
    """
    orbits = {name: made_orbit(name, sigma=sigma) for name in arcs}
    time, names = [], []
    for name, count in arcs.items():
        for one in passes(orbits[name], count):
            time.append(one)
            names += [name] * len(one)
    az, el = (np.full(sum(map(len, time)), np.nan) for _ in range(2))
    if stars:
        el = np.append(el, np.arcsin(rng.uniform(0.4, 0.98, stars)))
        az = np.append(az, rng.uniform(0.0, 2.0 * np.pi, stars))
        time.append(START + 60.0 * np.arange(stars))
        names += [STARS] * stars
    time = np.concatenate(time)
    zero = np.zeros(len(time))
    tracks = satellite_tracks({'time': time, 'az': az, 'el': el, 'az_enc': zero, 'el_enc': zero},
                              names, orbits, SITE, DEFAULT_WEATHER)
    run = tracks.run
    x, y = noise * rng.normal(size=(2, len(run))) - clock * tracks.clock
    for name, late in (ahead or {}).items():
        rows = tracks.object == tracks.objects.index(name)
        x, y = x + late * tracks.ahead[0] * rows, y + late * tracks.ahead[1] * rows
    model = PointingModel({name: value * ARCSEC for name, value in truth.items()})
    a, e = model.sky_to_encoder(run['az'], run['el'])
    tracks.run = PointingRun({**run.columns, 'az_enc': a + x / np.cos(run['el']),
                              'el_enc': e + y}, run.meta)
    return tracks


def write_track(path, tracks, names=True, shift=0.0, angles='enc'):
    """A track file of the satellites' rows; `angles`: enc, or seen (az_deg, el_deg)."""
    from pointing_model.runs.formats.csv import iso_utc
    run = tracks.run
    rows = ~tracks.is_star
    columns = ('az_enc_deg', 'el_enc_deg') if angles == 'enc' else ('az_deg', 'el_deg')
    lines = ['# latitude_deg: 34.3', '# longitude_deg: 109', '# height_m: 500',
             ','.join(['time', *(['satellite'] if names else []), *columns])]
    cells = [iso_utc(run['time'][rows] + shift), *([run['star'][rows]] if names else []),
             *(np.mod(run[one][rows] / DEG, turn) for one, turn in (('az_enc', 360.0),
                                                                    ('el_enc', 361.0)))]
    lines += [','.join(cell if isinstance(cell, str) else f'{cell:.8f}' for cell in row)
              for row in zip(*cells)]
    path.write_text('\n'.join(lines) + '\n')
    return path
