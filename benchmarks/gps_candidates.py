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

"""Candidate causes for the errors in the paper's satellite check: table and two figures.

    python benchmarks/gps_candidates.py [--samples N] [--on-sky] [--json FILE] [--figures FOLDER]
"""

import argparse
import json
import time
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from satellite_candidates import Assumptions, track_effects
from satellite_search import candidate_report, report_rows

from calibration.analysis.external_check import PAPER
from calibration.report.terminal_tables import new_table
from msg_tools.units import DEG
from pointing_model.sky.elements import GPS_26690, parse_elements
from pointing_model.sky.satellite_passes import passes
from pointing_model.sky.satellite_place import satellite_place

NOISE = 1.0  # arcsec on each axis, of the curves drawn


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--samples', type=int, default=10, help='independent samples in a curve')
    parser.add_argument('--on-sky', action='store_true', help='printed azimuth is on the sky')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--figures', type=Path)
    args = parser.parse_args()

    satellite = parse_elements(GPS_26690)
    assumptions = Assumptions(samples=args.samples, on_sky=args.on_sky)
    start = time.process_time()
    results = candidate_report(satellite, assumptions=assumptions)
    spent = time.process_time() - start

    from rich.console import Console
    console = Console(width=200)
    header, rows = report_rows(results)
    table = new_table(f'Causes and sizes, {args.samples} independent samples a curve', *header)
    for row in rows:
        table.add_row(*row)
    console.print(table)
    best = new_table('Best arcs', 'candidate', 'size', 'after: min', 'el', 'az mean std',
                     'el mean std', 'before: min', 'el', 'az std, el std', 'zero needed')
    for r in results:
        if r.best:
            best.add_row(*_best_row(r))
    console.print(best)
    print(f'{spent:.1f} s of CPU')
    if args.json:
        args.json.write_text(json.dumps([r.to_dict() for r in results], indent=1))
    if args.figures:
        args.figures.mkdir(parents=True, exist_ok=True)
        _curves(satellite, next(r for r in results if r.name == 'time error'),
                args.figures / 'gps_time_error.png')
        _shapes(satellite, args.figures / 'gps_shapes.png')


def _best_row(r):
    a, b = r.best['after'], r.best['before']
    cells = [r.name, ', '.join(f'{s:.3g} {u}' for s, u in zip(r.best['size'], r.units)),
             f'{a["minutes"]:.0f}', '{:.0f} to {:.0f}'.format(*a['el_deg']),
             f'{a["az_mean_arcsec"]:.2f} {a["az_std_arcsec"]:.2f}',
             f'{a["el_mean_arcsec"]:.2f} {a["el_std_arcsec"]:.2f}']
    if b is None:
        return [*cells, '', '', '', '']
    return [*cells, f'{b["minutes"]:.0f}', '{:.0f} to {:.0f}'.format(*b['el_deg']),
            f'{b["az_std_arcsec"]:.2f} {b["el_std_arcsec"]:.2f}',
            f'{b["zero_az_arcsec"]:.1f} {b["zero_el_arcsec"]:.1f}']


def _curves(satellite, result, path):
    """The paper's figures from a time error and a zero offset, with noise."""
    rng = np.random.default_rng(1)
    figure = _figure(8.0)
    panels = figure.subplots(2, 2)
    for key, row in zip(('before', 'after'), panels):
        arc = result.best[key]
        moments = arc['start'] + np.arange(0.0, 60.0 * arc['minutes'], 15.0)
        errors = np.array(track_effects(satellite, moments)['rate']) * result.best['size'][0]
        errors += rng.normal(0.0, NOISE, errors.shape)
        if key == 'before':
            errors += [[arc['zero_az_arcsec']], [arc['zero_el_arcsec']]]
        for axes, values, name in zip(row, errors, ('azimuth', 'elevation')):
            axes.plot((moments - moments[0]) / 60.0, values, '.-', lw=0.6, ms=3)
            axes.set(title=f'{name}, {key} the zero', xlabel='min', ylabel='arcsec')
        print(key, datetime.fromtimestamp(arc['start'], timezone.utc).isoformat('T', 'seconds'),
              [f'{e.mean():.2f} ± {e.std(ddof=1):.2f}' for e in errors], PAPER[key])
    figure.savefig(path, dpi=110)


def _figure(height):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    figure = Figure(figsize=(9.0, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def _shapes(satellite, path):
    """What some causes do along the whole pass."""
    one = passes(satellite, satellite.epoch, 24.0)[0]
    moments = np.arange(one.start, one.end, 30.0)
    effects = track_effects(satellite, moments)
    hours = (moments - moments[0]) / 3600.0
    figure = _figure(8.0)
    place, *panels = figure.subplots(3, 1, sharex=True)
    place.plot(hours, satellite_place(satellite, moments)[1] / DEG)
    place.set_ylabel('elevation [°]')
    for name, size, label in (
            ('rate', 0.15, 'time error 0.15 s'), ('light_time', 1.0, 'light time ignored'),
            ('annual', 1.0, 'annual aberration applied'), ('AW', 4.0, 'axis leans west 4″'),
            ('CA', 4.0, 'collimation 4″'), ('parallactic', 1.0, 'refraction as of a star')):
        for axes, value in zip(panels, effects[name]):
            axes.plot(hours, size * value, label=label)
    for axes, axis, name in zip(panels, ('az', 'el'), ('azimuth', 'elevation')):
        four = PAPER['after']
        axes.axhline(four[f'{axis}_mean_arcsec'], color='0.5', ls='--', lw=1.0,
                     label='paper, mean after')
        axes.set_ylabel(f'{name} [arcsec]')
    panels[0].legend(fontsize=8, ncols=2)
    panels[1].set_xlabel('time since 20° of elevation [h]')
    figure.savefig(path, dpi=110)


if __name__ == '__main__':
    main()
