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

"""Scaling of the main operations: time and memory at sizes over three decades.

    python benchmarks/curves.py [--only fit,diagnosis]

The exponent is that of the growth between the two largest sizes, after subtracting the cost of the
smallest. None may be worse than n log n, in time or in memory.
"""

import argparse
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from fit_vs_katpoint import TRUTH, make_run
from race import curve
from rich.console import Console
from rich.table import Table

from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.sky.places import icrs_to_observed
from pointing_model.sky.site import Site

ROWS = (1000, 10_000, 100_000, 1_000_000)
START = 1.7e9


def of_fit(size):
    """The default fit."""
    from calibration.analysis.term_fit import fit_terms
    return partial(fit_terms, make_run(size, 1))


def of_diagnosis(most_rows, size):
    """Search for what a model lacks, without cross-validation: of all rows, or of a part."""
    from calibration.analysis.diagnosis.diagnosis import diagnose
    return partial(diagnose, make_run(size, 2), cross_validation=False, flips=99,
                   most_rows=most_rows)


def of_model(back, size):
    """Angles by a model."""
    run, model = make_run(size, 3), PointingModel(TRUTH)
    there = model.sky_to_encoder(run['az'], run['el'])
    return (partial(model.encoder_to_sky, *there) if back
            else partial(model.sky_to_encoder, run['az'], run['el']))


def of_places(size):
    """A star at epochs within a day."""
    times = START + np.linspace(0.0, 86400.0, size)
    return partial(icrs_to_observed, 1.0, 0.3, times, Site(34.0 * DEG, 109.0 * DEG, 500.0))


def of_stars(size):
    """Stars at one epoch."""
    run = make_run(size, 4)
    return partial(icrs_to_observed, run['az'], run['el'] - 0.5, START,
                   Site(34.0 * DEG, 109.0 * DEG, 500.0))


def of_csv(folder, size):
    """A file of a pointing run."""
    from pointing_model.runs.formats.csv import write_csv
    from pointing_model.runs.run_reader import read_run
    path = folder / f'{size}.csv'
    write_csv(make_run(size, 5), path, plain=True)
    return partial(read_run, path, mount='altaz')


def of_log(folder, written, size):
    """A log of joint states."""
    from msg_tools import topics
    from msg_tools.bag import BagReader, BagWriter
    topic, count = topics.OFFSET, iter(range(10**6))
    data = b'\0\1\0\0' + bytes(8) + b'\1\0\0\0' + bytes(28)

    def write(path=None):
        with BagWriter(path or folder / f'log{size}_{next(count)}') as out:
            out.add_topic('/t', topic.type, [topic.qos])
            for i in range(size):
                out.write('/t', data, i * 1000, i * 1000, i)
    if written:
        return write
    write(folder / f'read{size}')

    def read():
        for _ in BagReader(folder / f'read{size}').messages():
            pass
    return read


def of_frames(size):
    """Images of the absolute encoder, in one batch."""
    from absolute_encoder import SCALES
    from encoder_frames import Source

    from encoder_reading.template_reader import TemplateReader
    params = SCALES[min(SCALES)]
    source = Source(params, 1)
    frames = np.concatenate([source.random(min(256, size - i))[1] for i in range(0, size, 256)])
    return partial(TemplateReader(params.design).read, frames)


def of_season(size):
    """Nights of a season: drift of the terms, and its causes."""
    from season import season

    from calibration.analysis.season.season_analysis import analyse_season
    return partial(analyse_season, season(np.random.default_rng(6), 'temperature', size)[0])


def of_tracking(size):
    """Adaptive model, star after star."""
    from calibration.analysis.tracking.tracker import Tracker
    run = make_run(size, 7)
    az, el = run['az'].tolist(), run['el'].tolist()
    x, y = (offset.tolist() for offset in run.offsets())

    def follow():
        tracker = Tracker(PointingModel(TRUTH), 0)
        for i in range(size):
            tracker.star((i + 1) * 60 * 10**9, az[i], el[i], x[i], y[i], ARCSEC)
    return follow


def operations(folder):
    """Name -> (unit, sizes, what prepares it)."""
    folder = Path(folder)
    return {
        'fit': ('rows', ROWS, of_fit),
        'diagnosis': ('rows', (30, 100, 1000, 10_000), partial(of_diagnosis, 10**9)),
        'diagnosis of a part': ('rows', (1000, 10_000, 100_000, 1_000_000),
                                partial(of_diagnosis, 999)),
        'model to the encoder': ('directions', ROWS, partial(of_model, False)),
        'model to the sky': ('directions', ROWS, partial(of_model, True)),
        'places of a star': ('epochs', (100, 1000, 10_000, 100_000), of_places),
        'places of stars': ('stars', (100, 1000, 10_000, 100_000), of_stars),
        'file read': ('rows', (100, 1000, 10_000, 100_000), partial(of_csv, folder)),
        'log written': ('messages', (1000, 10_000, 100_000, 1_000_000),
                        partial(of_log, folder, True)),
        'log read': ('messages', (1000, 10_000, 100_000, 1_000_000),
                     partial(of_log, folder, False)),
        'frames read': ('frames', (10, 100, 1000, 10_000), of_frames),
        'season': ('nights', (12, 40, 120, 400, 1200, 4000), of_season),
        'tracking': ('stars', (30, 300, 3000, 30_000), of_tracking),
    }


def measure_curves(say, only=()):
    """All of them, or `only` some.

    Returns
    -------
    list of race.Curve
    """
    out = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (unit, sizes, prepare) in operations(folder).items():
            if only and name not in only:
                continue
            # a million messages go through in seconds: once is enough, as it is for minutes
            out.append(curve(name, unit, sizes, prepare, 2))
            say(f'{name}: power {out[-1].power:.2f} in time, {out[-1].power_of_memory:.2f} in '
                'memory')
    return out


def show_curves(curves):
    """Print the table."""
    out = Table(title='Cost at the smallest and the largest size, and how fast it grows')
    for name in ('what', 'sizes', 'time', 'power', 'memory', 'power of memory', ''):
        out.add_column(name)
    for one in curves:
        out.add_row(one.what, f'{one.sizes[0]} to {one.sizes[-1]} {one.unit}',
                    f'{one.seconds[0]:.3g} to {one.seconds[-1]:.3g} s', f'{one.power:.2f}',
                    f'{one.bytes[0] / 1e6:.3g} to {one.bytes[-1] / 1e6:.3g} MB',
                    f'{one.power_of_memory:.2f}', '' if one.met else 'WORSE THAN n log n')
    Console(width=None if sys.stdout.isatty() else 150).print(out)


def main():
    """Measure and print; 1 if an operation is worse than n log n."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--only', default='', help='names of operations, by commas')
    args = parser.parse_args()
    found = measure_curves(lambda text: print(f'# {text}', file=sys.stderr, flush=True),
                           [name for name in args.only.split(',') if name])
    show_curves(found)
    return int(not all(one.met for one in found))


if __name__ == '__main__':
    sys.exit(main())
