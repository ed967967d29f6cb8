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

"""Models exported to other programs: round trips and losses, in arcseconds on the sky.

    python benchmarks/model_files.py [--full]

For every program that `telescope-mount export --to` writes:

- round trip: a model that the program can represent (katpoint, RTS2: first order; TPOINT:
  rotations; SPK, INDI and OnStepX: a model of theirs), written, read and compared; the largest
  difference over random models. Target 0.001 arcsec.
- loss: the seven terms (INDI: six, without NPAE) as exact rotations, refitted to the program, RMS
  and largest over a uniform sky above 20 degrees, for terms of a well aligned mount (10 arcsec), an
  ordinary one (60) and a bad one (300); and with the measured night of the MMT, its terms on its
  own sky.
- peer: our model file read by the program itself, if installed (katpoint), or by an equivalent one
  (pytelpoint for TPOINT's names, to first order): the largest difference from our computation.

``--full`` takes 200 random models instead of 20.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.model_files.transfer import export, uniform_sky
from pointing_model.runs.model_reader import read_model
from pointing_model.runs.programs import PROGRAMS

TARGET = 1e-3
MORE = ('ECES', 'ACES', 'ACEC', 'HECA2', 'HESA2', 'HACA2', 'HASA2')
SITE = {'site': tuple(np.radians((31.7, -110.9)))}
HELD = {'tpoint': ('rotation', MORE), 'katpoint': ('first_order', MORE),
        'rts2': ('first_order', MORE), 'spk': ('rotation', ()), 'indi': ('rotation', ()),
        'onstepx': ('rotation', ())}


def seven(name):
    """The geometric terms; INDI fits no NPAE."""
    return tuple(n for n in PHYSICAL if name != 'indi' or n != 'NPAE')


def apart(one, other, el):
    """RMS and largest difference on the sky, arcsec."""
    away = np.hypot(wrap(one[0] - other[0]) * np.cos(el), one[1] - other[1]) / ARCSEC
    away = away[np.isfinite(away)]
    return float(np.sqrt(np.mean(away**2))), float(away.max())


def back(exported, folder):
    """The model read from the exported file."""
    path = Path(folder) / f'model.{exported.program.name}'
    path.write_text(exported.text)
    return read_model(path).model


def round_trip(name, count, folder, sky):
    """Largest difference after writing and reading models that the program can represent."""
    geometry, more = HELD[name]
    worst = 0.0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        names = (*seven(name), *more)
        size = np.where([n in ('IA', 'IE') for n in names], 600.0, 30.0)
        model = PointingModel(dict(zip(names, rng.normal(size=len(names)) * size * ARCSEC)),
                              geometry=geometry)
        exported = export(model, PROGRAMS[name], facts=SITE)
        if name in ('spk', 'indi', 'onstepx'):  # their geometry is another: a model of theirs
            model = back(exported, folder)
            exported = export(model, PROGRAMS[name], facts=SITE)
        there, here = (m.sky_to_encoder(sky.az, sky.el) for m in (model, back(exported, folder)))
        worst = max(worst, apart(there, here, sky.el)[1])
    return worst


def losses(name, size, count):
    """Mean RMS and mean largest loss of seven terms of a size, as rotations."""
    out = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        values = dict(zip(PHYSICAL, rng.normal(size=7) * size * ARCSEC))
        model = PointingModel({n: values[n] for n in seven(name)})
        exported = export(model, PROGRAMS[name], facts=SITE)
        out.append((exported.direct.rms, exported.loss.rms, exported.loss.largest))
    return np.mean(out, axis=0)


def mmt_losses():
    """The loss of the measured night's terms on its sky, by program."""
    from calibration.analysis.term_fit import fit_terms
    from pointing_model.context import Context
    from pointing_model.runs.run_reader import read_run
    folder = Path(__file__).resolve().parents[1] / 'calibration' / 'data'
    run = read_run(folder / 'mmt_2021-08-21.csv')
    model, sky = fit_terms(run).model, Context.from_run(run)
    return {name: export(model, PROGRAMS[name], sky, 'the night', SITE).loss for name in HELD}


def peers(folder, sky):
    """(program, peer, largest difference) of those that are installed."""
    rng = np.random.default_rng(1)
    names = (*PHYSICAL, *MORE)
    values = dict(zip(names, rng.normal(size=len(names)) * 30.0 * ARCSEC))
    out = []
    try:
        import katpoint
        model = PointingModel(values, geometry='first_order')
        path = Path(folder) / 'peer.ini'
        path.write_text(export(model, PROGRAMS['katpoint']).text)
        theirs = katpoint.PointingModel()
        with open(path) as stream:
            theirs.fromfile(stream)
        out.append(('katpoint', f'katpoint {katpoint.__version__}', apart(
            theirs.apply(sky.az, sky.el), model.sky_to_encoder(sky.az, sky.el), sky.el)[1]))
    except ImportError:
        out.append(('katpoint', 'katpoint is not installed', np.nan))
    try:
        import astropy.units as u
        from astropy.coordinates import SkyCoord
        from pytelpoint.transform import azel_model

        from pointing_model.runs.model_files.program import first_order_at_encoder
        values = {n: values[n] for n in PHYSICAL}
        exported = export(PointingModel(values), PROGRAMS['tpoint'])
        columns = {}
        for name, value in exported.terms.items():
            for key, share in PROGRAMS['tpoint'].column(name):
                columns[key] = columns.get(key, 0.0) + share * value
        az, el = first_order_at_encoder(columns, sky.az, sky.el)
        got = azel_model(SkyCoord(az * u.rad, el * u.rad, frame='altaz'),
                         **{n.lower(): v / ARCSEC for n, v in exported.terms.items()})
        out.append(('tpoint', 'pytelpoint, first order', apart(
            (got.az.rad, got.alt.rad), (sky.az, sky.el), sky.el)[1]))
    except ImportError:
        out.append(('tpoint', 'pytelpoint is not installed', np.nan))
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--full', action='store_true', help='200 random models in place of 20')
    count = 200 if parser.parse_args().full else 20
    sky = uniform_sky()
    with tempfile.TemporaryDirectory() as folder:
        print(f'Round trip of {count} models that the program holds, largest of {len(sky)} '
              f'directions, arcsec (target {TARGET:g})')
        for name in HELD:
            worst = round_trip(name, count, folder, sky)
            note = '' if worst <= TARGET else '  MISSED'
            print(f'  {name:10} {worst:12.2e}{note}')
        print(f'\nSeven terms as rotations, mean of {count} models: by name alone (RMS), refitted '
              '(RMS), refitted (largest), arcsec')
        for name in HELD:
            cells = ['  '.join(f'{v:8.4f}' for v in losses(name, size, count))
                     for size in (10.0, 60.0, 300.0)]
            print(f'  {name:10} 10": {cells[0]}   60": {cells[1]}   300": {cells[2]}')
        print('\nThe seven terms of the MMT night on its own 80 directions, refitted, arcsec')
        for name, loss in mmt_losses().items():
            print(f'  {name:10} {loss.rms:8.4f} RMS {loss.largest:8.4f} largest')
        print('\nOur file read by a peer, largest difference, arcsec')
        for name, peer, worst in peers(folder, sky):
            print(f'  {name:10} {worst:12.2e}  {peer}')


if __name__ == '__main__':
    main()
