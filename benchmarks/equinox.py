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

"""Exports of TheSky with a catalogue of J2000 or of date: how often is the equinox recognised?

    python benchmarks/equinox.py [--runs N] [--seed N] [--verbose] [--file RUN ...]

Simulated mounts (forks and German ones, 15 to 60 degrees north or south, 12 to 120 rows in 20
minutes to six hours, in random order or sweeping over the sky) have terms of up to half a degree,
none to three direction-dependent effects with the formulas of `equatorial.py`, zeros that drift as
a random walk or jump, and noise. Each run is written once with each equinox, and read back.
`--file` prints the decision for measured runs.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from equatorial_runs import BY_SIDE, EFFECTS

from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.mounts import Mount
from pointing_model.runs.run_reader import read_run
from pointing_model.sky.earth import terrestrial
from pointing_model.sky.places import observed_to_icrs, sidereal_time
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site

START = 1.777e9  # 2026-04-24
EQUINOXES = ('J2000', 'of date')
#: effects by rules of the direction alone
OF_DIRECTION = [name for name in EFFECTS if '_with_' not in name and name not in (
    'camera_rotation', 'magnitude_equation_el', 'hour_angle_hysteresis_cosE',
    'declination_hysteresis')]


def night(rng):
    """Places, what was read, and the moments of a run of some mount.

    Returns
    -------
    mount : Mount
    site : Site
    c : dict
        `az`, `el` by the axes, `time`.
    reading : list of ndarray, shape (n,)
        Hour angle and declination of the encoders, radians.
    """
    kind = rng.choice(['equatorial', 'german'])
    latitude = rng.choice([-1.0, 1.0]) * rng.uniform(15.0, 60.0) * DEG
    mount, site = Mount.equatorial(latitude, str(kind)), Site(latitude, rng.uniform(-3.0, 3.0), 0.0)
    n, hours = int(10**rng.uniform(np.log10(12), np.log10(120))), 10**rng.uniform(-0.5, 0.8)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
    if rng.random() < 0.5:  # it goes round the sky, as programs do
        order = np.argsort(az + rng.normal(scale=0.3, size=n))
        az, el = az[order], el[order]
    h, _ = mount.axes_of(az, el)
    a, e = mount.axes_of(az, el, (h < 0.0) & (kind == 'german'))
    gaps = rng.uniform(0.5, 1.5, n)
    c = {'az': a, 'el': e, 'time': START + rng.uniform(0.0, 86400.0)
         + 3600.0 * hours * np.cumsum(gaps) / gaps.sum()}
    sizes = 10**rng.uniform(1.0, 3.3, 7) * rng.choice([-1.0, 1.0], 7) * ARCSEC
    first, second = geometry.sky_to_encoder(a, e, dict(zip(mount.names.physical, sizes)), mount)
    off = 10**rng.uniform(0.0, 1.5) * ARCSEC * rng.normal(size=(2, n))
    dictionary = {name: EFFECTS[name] for name in OF_DIRECTION}
    if kind == 'german':
        dictionary |= BY_SIDE
    for name in rng.choice(list(dictionary), rng.integers(0, 4), replace=False):
        s = dictionary[name](c, mount, rng)
        off += s * (10**rng.uniform(0.5, 2.5) * ARCSEC / np.sqrt((s**2).sum(axis=0).mean()))
    reach = np.array([np.cos(e), np.ones(n)])
    for axis in range(2):
        walk = np.cumsum(rng.normal(size=n) * np.sqrt(gaps / gaps.sum()))
        if rng.random() < 0.3:  # it jumps
            walk = 0.3 * walk + (np.arange(n) >= rng.integers(1, n))
        off[axis] += 10**rng.uniform(0.0, 2.7) * ARCSEC * walk * reach[axis]
    return mount, site, c, [first + off[0] / reach[0], second + off[1]]


def places(c, mount, site, weather, equinox):
    """Right ascension and declination as a catalogue of that equinox has them, radians."""
    import erfa
    ra, dec = observed_to_icrs(*mount.horizon_of(c['az'], c['el']), c['time'], site, weather)
    if equinox == 'J2000':
        return ra, dec
    moments = terrestrial(c['time'])
    ra, dec, origins = erfa.atci13(ra, dec, 0.0, 0.0, 0.0, 0.0, *moments)
    return np.mod(ra - origins, 2.0 * np.pi), dec


def written(path, made, equinox):
    """A run as TheSky exports it."""
    mount, site, c, (first, second) = made
    weather = Weather(1000.0, 10.0)
    lst = sidereal_time(c['time'], site)
    ra, dec = places(c, mount, site, weather, equinox)
    day = np.datetime64(int(c['time'][0]), 's').item()
    head = f'{_base60(site.latitude / DEG)} {day:%Y %m %d} 10.0 1000.0 0.0 0.5 0.55 0.0065'
    rows = [f'{_base60(np.mod(r / DEG, 360) / 15)[1:]} {_base60(d / DEG)} '
            f'{_base60(np.mod((t - h) / DEG, 360) / 15)[1:]} {_base60(k / DEG)} '
            f'{_hours(t)}' for r, d, h, k, t in zip(ra, dec, first, second, lst)]
    path.write_text('\n'.join(['!TheSky', 'mount', ':NODA', ':EQUAT', head, *rows]) + '\n')
    return path


def _base60(value):
    total = round(abs(value) * 3600e5)
    whole, left = divmod(total, 3600 * 10**5)
    minutes, left = divmod(left, 60 * 10**5)
    return f'{"-" if value < 0 else "+"}{whole:02d} {minutes:02d} {left / 1e5:08.5f}'


def _hours(angle):
    hours = np.mod(angle / DEG, 360.0) / 15.0
    return f'{int(hours):02d} {60.0 * (hours % 1.0):.6f}'


def told_by_terms(run_ways):
    """The equinox that the physical terms alone would have, None where they are within 2 %."""
    left = run_ways['left_arcsec']
    best = min(left, key=left.get)
    return best if max(left.values()) >= 1.02 * min(left.values()) else None


def counted(outcomes):
    """Right, wrong, not told."""
    return (f'{sum(o is True for o in outcomes)} right, {sum(o is False for o in outcomes)} wrong, '
            f'{sum(o is None for o in outcomes)} not told')


def main():
    """Simulate, read, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--runs', type=int, default=100, help='each written with both equinoxes')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--verbose', action='store_true')
    parser.add_argument('--file', type=Path, nargs='+', default=[], help='measured runs instead')
    args = parser.parse_args()
    for path in args.file:
        print(path, *(note for note in read_run(path).meta['notes'] if 'equinox' in note))
    if args.file:
        return
    now, before = [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.seed, args.seed + args.runs):
            made = night(np.random.default_rng(seed))
            for equinox in EQUINOXES:
                path = written(Path(folder) / 'run.dat', made, equinox)
                found = read_run(path, mount=made[0].kind,
                                 site={'longitude': made[1].longitude}).meta['equinox_taken']
                now.append(found['taken'] == equinox if found['told'] else None)
                alone = told_by_terms(found)
                before.append(None if alone is None else alone == equinox)
                if args.verbose:
                    print(f'seed {seed}, {equinox}: {found["likelier"]} by '
                          f'{found["log_likelihood"]:.1f}; by the terms alone {alone}')
    print(f'{2 * args.runs} runs: {counted(now)}; by the physical terms alone {counted(before)}')


if __name__ == '__main__':
    main()
