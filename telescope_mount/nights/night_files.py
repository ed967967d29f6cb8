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

"""The folder of a night: its log, rows, model, report and page."""

import json
from functools import partial
from pathlib import Path
from typing import NamedTuple

from msg_tools.whole_files import reason, tried, write_text

#: suffixes of the files of logs
LOGS = ('.mcap', '.db3')


class Written(NamedTuple):
    """The files of a night.

    Attributes
    ----------
    report : dict
        ``incomplete`` has a line for each file that could not be written.
    run : PointingRun
        All rows.
    model : PointingModel or None
    """

    report: dict
    run: object
    model: object = None


def log_of(path):
    """The log at a path: `bag` in the folder of a night, else the path itself.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Path
    """
    path = Path(path)
    if (path / 'bag').is_dir() and not (path / 'metadata.yaml').is_file() and not holds_log(path):
        return path / 'bag'
    return path


def holds_log(path):
    """Whether a folder has files of a log."""
    return any(any(path.glob(f'*{suffix}')) for suffix in LOGS)


def is_log(path):
    """Whether a path is read as a log: any folder, or a file of a log."""
    return path.is_dir() or path.suffix in LOGS


def model_of(path):
    """The model at a path: `model.json` in the folder of a night, else the path itself.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Path
    """
    path = Path(path)
    return path / 'model.json' if (path / 'model.json').is_file() else path


def add_truth(bag, report):
    """Add the simulated change of the zero to the measured one, for information only."""
    from msg_tools.bag import BagReader
    from msg_tools.units import ARCSEC
    drifts = [message.data.position for message in BagReader(bag).messages(decode=True)
              if message.topic.endswith('truth/incremental_zero')]
    runs = [zero['run'] for zero in report['zeros']]
    if len(drifts) != len(runs):
        return
    by_power_on = dict(zip(runs, drifts))
    for change in report['changes']:
        az, el = (after - before for before, after in zip(
            by_power_on[change['from']], by_power_on[change['to']]))
        change['simulated'] = {'az_arcsec': az / ARCSEC, 'el_arcsec': el / ARCSEC}


def diagnosing(folder, calibration=None):
    """Parameters of a calibration that writes the page of its diagnosis to the folder."""
    return {**(calibration or {}), 'diagnosis_page': str((folder / 'diagnosis.html').resolve())}


def write_page(folder, written, log=None):
    """Write the page of the night, after its log is complete; `written`: see `write_results`."""
    from calibration.report.night_page import night_page
    try:
        write_text(folder / 'page.html', night_page(
            written.run, written.model, written.report, log or folder / 'bag'))
    except OSError as err:
        written.report['incomplete'].append(f'{folder / "page.html"}: {reason(err)}')
    except Exception as err:  # any error: a night must not be lost because of its page
        written.report['notes'].append(f'the page was not written: {type(err).__name__}: {err}')
    else:
        written.report['files']['page'] = str(folder / 'page.html')


def write_files(folder, run, documents):
    """Write observations.csv, and texts by file name.

    Returns
    -------
    list of str
        A line for each file that cannot be written.
    """
    from pointing_model.runs.formats.csv import write_csv
    incomplete = []
    tried(incomplete, folder / 'observations.csv', partial(write_csv, run, plain=True))
    for name, text in documents.items():
        tried(incomplete, folder / name, partial(write_text, text=text + '\n'))
    return incomplete


def write_results(folder, results, bag=None):
    """Write observations.csv, model.json, report.json from the last messages; `Written`.

    The report has the log (`bag`, by default that in the folder) and the blind checks.
    """
    from msg_tools import topics
    from msg_tools.units import ARCSEC
    from pointing_model.model import PointingModel
    from pointing_model.runs.run_messages import cloud_to_run
    from pointing_model.sky.earth import earth_orientation
    from telescope_mount.observing.camera_delay import sentence

    run = cloud_to_run(results[topics.OBSERVATIONS.name])
    fitted = results.get(topics.CALIBRATION_REPORT.name)
    report = json.loads(fitted.data) if fitted else {'notes': []}
    model = PointingModel.from_json(results[topics.MODEL.name].data)
    orientation = earth_orientation(float(run['time'][0]))
    if orientation.sigma > 0.1 * ARCSEC:
        report['notes'].append(orientation.statement())
    if topics.TRACKING.name in results:
        report['tracking'] = json.loads(results[topics.TRACKING.name].data)
    incomplete = write_files(folder, run, {
        'model.json': results[topics.MODEL.name].data, 'report.json': json.dumps(report, indent=1)})
    report['files'] = {'log': str(bag or folder / 'bag'), 'model': str(folder / 'model.json'),
                       'observations': str(folder / 'observations.csv')}
    report['incomplete'] = incomplete
    if topics.CHECKS.name in results:
        document = json.loads(results[topics.CHECKS.name].data)
        report['checks'] = document['checks']
        if found := document.get('clocks'):
            report['notes'].append(sentence(found['found'], found['camera_late_s'],
                                            found['absolute']))
    return Written(report, run, model)
