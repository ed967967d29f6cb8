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

"""Speed of star places: ours, the full computation, astropy (interpolating) and katpoint 0.10.3.

    OMP_NUM_THREADS=1 python benchmarks/places_speed.py [--rounds N]

Without refraction, with the same site; astropy with ErfaAstromInterpolator of 300 s and IERS tables
from the same package. Each first place is for another night, so that no cache helps.
Peers: .venv/bin/pip install astropy katpoint.
"""

import itertools

import erfa
import numpy as np
from race import Row, peer, race, show_rows

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.frame import full_frame
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import load_catalogue

EPOCHS = 10_000
BEGIN = 1.6e9
SLOW = ('full', 'katpoint')  # of so many of the epochs, as each costs the same
SOME = 300
AIRLESS = Weather(pressure_hpa=0.0)
BOUND = 0.001  # arcsec
#: what is timed -> times as fast as the full computation, at least
LEAST = {'one star at many epochs of a new day, each': 20.0,
         'first place of a night': 0.7,
         'each further place of the night': 8.0}


def fully(star, time):
    """Azimuth and elevation with everything computed for each time."""
    astrom = full_frame(time, DEFAULT_SITE)
    az, distance, *_ = erfa.ufunc.atioq(*erfa.ufunc.atciq(*star.at_j2000, astrom), astrom)
    return az, np.pi / 2.0 - distance


def _astropy(star):
    if peer('astropy') is None:
        return None
    from astropy import units
    from astropy.coordinates import AltAz, EarthLocation, SkyCoord
    from astropy.coordinates.erfa_astrom import ErfaAstromInterpolator, erfa_astrom
    from astropy.time import Time
    from astropy.utils import iers

    iers.conf.auto_download = False
    site = EarthLocation.from_geodetic(DEFAULT_SITE.longitude / DEG, DEFAULT_SITE.latitude / DEG,
                                       DEFAULT_SITE.height)
    ra, dec, *_ = (v[0] for v in star.at_j2000)
    place = SkyCoord(ra, dec, unit=units.rad, frame='icrs')

    def places(time):
        with erfa_astrom.set(ErfaAstromInterpolator(300 * units.s)):
            there = place.transform_to(AltAz(obstime=Time(time, format='unix'), location=site))
            return there.az.rad, there.alt.rad
    return places


def _katpoint(star):
    katpoint = peer('katpoint')
    if katpoint is None:
        return None
    import ephem
    ra, dec, *_ = (v[0] for v in star.at_j2000)
    antenna = katpoint.Antenna(
        f'site, {ephem.degrees(DEFAULT_SITE.latitude)}, {ephem.degrees(DEFAULT_SITE.longitude)}, '
        f'{DEFAULT_SITE.height}, 1.0')
    target = katpoint.Target(f'star, radec, {ephem.hours(ra)}, {ephem.degrees(dec)}')
    return lambda time: target.azel(time, antenna)


def rows(rounds=5):
    """`race.Row`, seconds a place, of many epochs, of the first and of further places."""
    star = load_catalogue(hip=[32349])
    peers = {'full': lambda time: fully(star, time), 'astropy': _astropy(star),
             'katpoint': _katpoint(star)}
    peers = {name: call for name, call in peers.items() if call}

    def ours(time):
        return observed_place(star, time, DEFAULT_SITE, AIRLESS)

    time = np.linspace(BEGIN, BEGIN + 86400.0, EPOCHS)
    az, el = ours(time)
    full = peers['full'](time)
    off = np.hypot(wrap(az - full[0]) * np.cos(el), el - full[1]).max() / ARCSEC
    print(f'{EPOCHS} epochs differ from the full computation by {off:.1e}" at most '
          f'({"within" if off <= BOUND else "BEYOND"} {BOUND:g}")')
    out = []
    days = itertools.count(1)
    other_days = {name: itertools.count(1) for name in ('ours', *peers)}

    def add(what, size, times):
        out.extend(Row('sky', what, str(size), times['ours'], name, times[name],
                       LEAST[what] if name == 'full' else None) for name in peers)

    def batch(call, name):
        # ours on a day that it does not know yet
        part = time[:SOME] if name in SLOW else time
        return lambda: call(part + 86400.0 * 2 * next(other_days[name]))
    many, first, further = LEAST
    every = {'ours': ours, **peers}
    times = race({name: batch(call, name) for name, call in every.items()}, rounds)
    add(many, EPOCHS,
        {name: value / (SOME if name in SLOW else EPOCHS) for name, value in times.items()})
    night = {name: itertools.count(-1, -1) for name in every}
    add(first, 1, race({name: lambda call=call, n=night[name]: call(BEGIN + 86400.0 * next(n))
                        for name, call in every.items()}, 2 * rounds))
    add(further, 1, race({name: lambda call=call: call(BEGIN + 3.0 * next(days))
                          for name, call in every.items()}, rounds))
    return out


if __name__ == '__main__':
    show_rows(__doc__, rows)
