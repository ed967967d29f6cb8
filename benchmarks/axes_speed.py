"""Model to encoder and encoder to sky: an earlier commit, and katpoint 0.10.3.

    OMP_NUM_THREADS=1 python benchmarks/axes_speed.py [--commit COMMIT] [--rounds N]

The module of the rotations of that commit (by default the last before they went without arctan2)
is taken from git and runs in the same process, in turn. Peers: .venv/bin/pip install katpoint.
"""

import argparse
import importlib.util
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from race import Row, peer, race, show

from msg_tools.units import ARCSEC, wrap
from pointing_model import geometry
from pointing_model.mounts import ALTAZ, Mount

BEFORE = '0de8ea8'
SIZE = 200_000
#: to encoder, times as fast as before; back, directions a second of a core
AS_FAST, BACK = 1.3, 6e6
TERMS = np.array([150.0, -90.0, 60.0, -40.0, 80.0, -50.0, 30.0]) * ARCSEC


def geometry_of(commit):
    """`pointing_model.geometry` as of a commit, beside today's."""
    text = subprocess.run(['git', 'show', f'{commit}:pointing_model/geometry.py'], check=True,
                          capture_output=True, cwd=Path(__file__).parent).stdout
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'earlier.py'
        path.write_bytes(text)
        spec = importlib.util.spec_from_file_location('pointing_model.earlier_geometry', path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return module


def rows(rounds=5, commit=BEFORE, size=SIZE):
    """`race.Row` of both ways for alt-azimuth and equatorial mounts."""
    earlier = geometry_of(commit)
    rng = np.random.default_rng(1)
    az, el = rng.uniform(-3.0, 3.0, size), rng.uniform(0.2, 1.3, size)
    out, before = [], f'commit {commit}'
    for mount in (ALTAZ, Mount.equatorial(0.6)):
        values = dict(zip(mount.names.terms, TERMS))
        at = geometry.sky_to_encoder(az, el, values, mount)
        there = earlier.encoder_to_sky(*at, values, mount=mount)
        back = geometry.encoder_to_sky(*at, values, mount=mount)
        off = np.hypot(wrap(back[0] - there[0]) * np.cos(el), back[1] - there[1]).max() / ARCSEC
        print(f'{mount.kind}: encoder to sky differs from {before} by {off:.1e}" at most')
        candidates = {
            'to encoder': lambda m=mount, v=values: geometry.sky_to_encoder(az, el, v, m),
            'to encoder before': lambda m=mount, v=values: earlier.sky_to_encoder(az, el, v, m),
            'to sky': lambda m=mount, v=values, r=at: geometry.encoder_to_sky(*r, v, mount=m),
            'to sky before': lambda m=mount, v=values, r=at: earlier.encoder_to_sky(
                *r, v, mount=m)}
        katpoint = peer('katpoint') if mount.vertical else None
        if katpoint is not None:
            theirs = katpoint.PointingModel()
            theirs.fromlist(np.degrees([TERMS[0], 0, TERMS[3], -TERMS[2], TERMS[4], -TERMS[5],
                                        TERMS[1], TERMS[6]]).tolist())
            candidates['katpoint apply'] = lambda t=theirs: t.apply(az, el)
            candidates['katpoint reverse'] = lambda t=theirs, r=at: t.reverse(*r)
        times = race(candidates, rounds)

        def add(what, ours, theirs, name, least=None, m=mount, t=times):
            out.append(Row('model', f'{m.kind}, {what}', str(size), t[ours], name, t.get(theirs),
                           least))
        for way, kat in (('to encoder', 'apply'), ('to sky', 'reverse')):
            add(way, way, f'{way} before', before,
                AS_FAST if mount.vertical and way == 'to encoder' else None)
            if mount.vertical:
                add(way, way, f'katpoint {kat}', f'katpoint {kat}')
        if mount.vertical:
            out.append(Row('model', 'altaz, to sky', str(size), times['to sky'],
                           f'limit {BACK / 1e6:g} million a second', size / BACK, 1.0))
        add('to sky against to encoder of then', 'to sky', 'to encoder before', before)
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--commit', default=BEFORE, help=f'to compare with (default {BEFORE})')
    parser.add_argument('--rounds', type=int, default=5)
    args = parser.parse_args()
    result = rows(args.rounds, args.commit)
    show(result)
    for one in result:
        print(f'{one.what:50} {int(one.size) / one.ours / 1e6:6.2f} million a second')


if __name__ == '__main__':
    main()
