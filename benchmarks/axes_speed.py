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

"""Speed of sky to encoder and encoder to sky, compared with katpoint 0.10.3.

    OMP_NUM_THREADS=1 python benchmarks/axes_speed.py [--rounds N]

Peer: .venv/bin/pip install katpoint.
"""

import argparse

import numpy as np
from race import Row, peer, race, show

from msg_tools.units import ARCSEC
from pointing_model import geometry
from pointing_model.mounts import ALTAZ, Mount

SIZE = 200_000
#: times as fast as katpoint, which has no exact rotations
LEAST = {'to encoder': 0.5, 'to sky': 0.5}
TERMS = np.array([150.0, -90.0, 60.0, -40.0, 80.0, -50.0, 30.0]) * ARCSEC
MOUNTS = {'altaz': ALTAZ, 'equatorial': Mount.equatorial(0.6)}


def directions(size):
    """Azimuth and elevation, rad."""
    rng = np.random.default_rng(1)
    return rng.uniform(-3.0, 3.0, size), rng.uniform(0.2, 1.3, size)


def calls(name, size):
    """Both ways on a mount, by the packages of this process: calls without arguments."""
    mount, at = MOUNTS[name], directions(size)
    values = dict(zip(mount.names.terms, TERMS))
    there = geometry.sky_to_encoder(*at, values, mount)
    return {'to encoder': lambda: geometry.sky_to_encoder(*at, values, mount),
            'to sky': lambda: geometry.encoder_to_sky(*there, values, mount=mount)}


def katpoint_calls(size):
    """Both ways of katpoint; none where it is not installed."""
    katpoint = peer('katpoint')
    if katpoint is None:
        return {}
    theirs, at = katpoint.PointingModel(), directions(size)
    theirs.fromlist(np.degrees([TERMS[0], 0, TERMS[3], -TERMS[2], TERMS[4], -TERMS[5],
                                TERMS[1], TERMS[6]]).tolist())
    there = theirs.apply(*at)
    return {'katpoint apply': lambda: theirs.apply(*at),
            'katpoint reverse': lambda: theirs.reverse(*there)}


def rows(rounds=5, size=SIZE):
    """`race.Row` of both ways for alt-azimuth and equatorial mounts."""
    theirs, out = race(katpoint_calls(size), rounds), []
    for name in MOUNTS:
        best = race(calls(name, size), rounds)
        for way, kat in (('to encoder', 'katpoint apply'), ('to sky', 'katpoint reverse')):
            out.append(Row('model', f'{name}, {way}', str(size), best[way], kat, theirs.get(kat),
                           LEAST[way] if name == 'altaz' else None))
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--rounds', type=int, default=5)
    args = parser.parse_args()
    result = rows(args.rounds)
    show(result)
    for one in result:
        print(f'{one.what:50} {int(one.size) / one.ours / 1e6:6.2f} million a second')


if __name__ == '__main__':
    main()
