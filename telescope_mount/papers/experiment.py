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

"""Paper 000's experiment through the graph: eleven nights, and a GPS satellite on one of them."""

import json
from functools import partial

from msg_tools.whole_files import beside, tried, write_text
from telescope_mount.observing.plan import BLOCK_STARS, ZERO_EXPOSURES, parse_plan

from ..graph import night_graph
from ..nights.night_files import Written
from ..nights.whole_night import observe, prepare_folder
from .experiment_page import render_experiment

#: choice of zero changes at power-ons -> scenario
DRIFTS = {'paper': 'eleven_nights', 'random': 'eleven_random_nights'}
#: each night uses the night so many before as reference
REFERENCE_AGE = 2
NIGHTS = 11
#: night whose drift is closest to the satellite's error before calibration in the paper
SATELLITE_NIGHT = 4
#: first night, -1: the satellite of paper 000 (elements of 2013 day 264) is up in its evenings
START = '2013-09-20T13:00:00'
#: files written next to log and page
FILES = ('table1.csv', 'zeros.csv', 'gps.json', 'report.json', 'observations.csv')
#: longest wait: with a real telescope so many nights would take an hour of commands
_HOURS = 24


def experiment_plan(stars, polaris, satellite, extra=False, nights=NIGHTS):
    """The plan of all nights.

    Parameters
    ----------
    stars : int
        Stars in each of the two blocks of a night.
    polaris : int
        Exposures for a zero.
    satellite : int
        Exposures of the satellite before and after the zero calibration of its night.
    extra : bool
        Add a power-on: the case of the paper's section 1.1, or the night whose zero is
        predicted.
    nights : int
        Nights of table 1, 11 in the paper.

    Returns
    -------
    str
    """
    parts = []
    for night in range(1 - REFERENCE_AGE, nights + extra + 1):
        if night < 1:  # for its coefficients only
            start = f'wait {_HOURS}, power_cycle, home' if parts else 'home'
            parts.append(f'{start}, stars {stars}, zero {polaris}, calibrate_zero, fit')
            continue
        track = f'satellite {satellite}, ' if night == SATELLITE_NIGHT else ''
        parts.append(f'wait {_HOURS}, power_cycle, home, {track}stars {stars}, '
                     f'zero {polaris}, calibrate_zero, {track}stars {stars}, fit')
    return ', '.join(parts)


def run_experiment(out, *, seed=1, drifts='paper', stars=BLOCK_STARS, polaris=ZERO_EXPOSURES,
                   satellite=20, nights=NIGHTS, scenario=None, domain_number=None, progress=None):
    """Observe all nights in one graph of processes.

    Parameters
    ----------
    out : Path
        Folder for all output.
    drifts : str
        One of `DRIFTS`.
    nights : int
        Nights of table 1; more of them show better what the zeros follow.
    scenario : str, optional
        Errors of the simulated mount, instead of `drifts`: a season whose zeros follow
        something, such as ``season_temperature``. The zero of the last power-on is predicted.
    seed, stars, polaris, satellite, domain_number
        See `night.run_night` and `experiment_plan`.
    progress : callable, optional
        Called with (text, done, total).

    Returns
    -------
    dict
        Results of `telescope_mount.papers.table_1`, with the ``files`` that were written.

    Raises
    ------
    ValueError, OSError
        Invalid input.
    NightFailed
        A node ended, or the plan could not be carried out.
    """
    extra = scenario is not None or drifts == 'paper'
    plan = experiment_plan(stars, polaris, satellite, extra, nights)
    parse_plan(plan)
    folder = prepare_folder(out)
    origin = {'seed': seed, **({'scenario': scenario} if scenario else {'drifts': drifts})}
    specs = night_graph(
        bag=str(folder / 'bag'), scenario=scenario or DRIFTS[drifts], seed=seed,
        start_time=START, plan=plan, first_run=1 - REFERENCE_AGE, reference_age=REFERENCE_AGE,
        satellite='gps-26690', sample_rate_hz=1.0, kept_power_ons=0)
    report, run, _ = observe(
        folder, specs, plan, partial(_write, folder, nights, origin), progress, domain_number)
    page = folder / 'page.html'
    files = [folder / 'bag', *(folder / name for name in FILES)]
    tried(report['incomplete'], page,
          lambda path: write_text(path, render_experiment(report, run, files)))
    report['files']['page'] = str(page)
    return report


def _write(folder, nights, origin, latest):
    """Write table1.csv, zeros.csv, gps.json, report.json, observations.csv; return `Written`."""
    from calibration.report.zero_season_report import write_season, zero_season
    from msg_tools import topics
    from pointing_model.runs.columns.cells import write_rows
    from pointing_model.runs.formats.csv import write_csv
    from pointing_model.runs.run_messages import cloud_to_run
    from telescope_mount.papers.table_1 import COLUMNS, compare_with_paper

    run = cloud_to_run(latest[topics.OBSERVATIONS.name])
    calibrated = json.loads(latest[topics.CALIBRATION_REPORT.name].data)
    report = compare_with_paper(calibrated['nights'], nights)
    report.update(origin)
    report['zeros'] = zero_season(calibrated['power_ons'], calibrated['zero_expected'])
    files, incomplete = {name: folder / name for name in FILES}, []

    def write_table(path):
        with beside(path) as part, open(part, 'w', newline='', encoding='utf-8') as file:
            write_rows(file, [COLUMNS, *([row[name] for name in COLUMNS]
                                         for row in report['table1'])])
    for name, write in (
            ('table1.csv', write_table),
            ('gps.json', partial(write_text, text=json.dumps(report['gps'], indent=1) + '\n')),
            ('report.json', partial(write_text, text=json.dumps(report, indent=1) + '\n')),
            ('observations.csv', partial(write_csv, run, plain=True)),
            ('zeros.csv', partial(write_season, calibrated['power_ons']))):
        tried(incomplete, files[name], write)
    report['incomplete'] = incomplete
    report['files'] = {'log': str(folder / 'bag'),
                       **{name: str(path) for name, path in files.items()}}
    return Written(report, run)
