"""The page of a night that is over, from its log alone."""

import json
from pathlib import Path

from msg_tools.bag.names import prefix_of
from msg_tools.bag.sqlite import open_bag
from msg_tools.output import write_text
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import cloud_to_run

from .night_page import FILES, render_night, told_of

#: ends of the topics that a page is made of: rows one by one, all of them, and what came of them
_ENDS = ('observation', 'observations', 'calibration/report', 'model', 'tracking',
         'observer/checks')


def write_page_of_log(log, path):
    """Write the page of a night from its log.

    Parameters
    ----------
    log : Path
        Folder or file.
    path : str or Path
        HTML file to write. A diagnosis whose page lies beside the log becomes a part of it.

    Raises
    ------
    ValueError
        It is no log of a night, or that of the simulator's truth.
    OSError
        It cannot be read, or the page not be written.
    """
    log = Path(log)
    bag = open_bag(log)
    if bag.has_truth:
        raise ValueError(f'{log} holds the truth of the simulator; give the log beside it')
    rows, last = [], {}
    prefix = prefix_of(bag)
    ends = {f'{prefix}{end}': end for end in _ENDS}
    for message in bag.messages(list(ends), decode=True):
        end = ends[message.topic]
        if end == 'observation':
            rows.append(cloud_to_run(message.data))
        else:
            last[end] = message.data
    if not rows and 'observations' not in last:
        raise ValueError(f'{log} has no observation in it; it is no log of a night')
    run = cloud_to_run(last['observations']) if 'observations' in last else None
    if run is None or len(run) < sum(map(len, rows)):
        run = PointingRun.concatenate(rows)  # it was interrupted
    report = _json(last.get('calibration/report')) or {'notes': []}
    tracking, checks = _json(last.get('tracking')), _json(last.get('observer/checks'))
    if tracking:
        report['tracking'] = tracking
    report['checks'] = (checks or {}).get('checks', [])
    model = PointingModel.from_json(last['model'].data) if 'model' in last \
        else PointingModel({}, mount=run.mount)
    diagnosed = log.parent / 'diagnosis.html'
    write_text(path, render_night(
        run, model, report, told_of(log), 'Night',
        diagnosed.read_text(encoding='utf-8') if diagnosed.is_file() else '',
        [log, *(log.parent / name for name in FILES)] if log.is_dir() else [log]))


def _json(message):
    return None if message is None else json.loads(message.data)
