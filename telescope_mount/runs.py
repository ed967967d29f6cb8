"""One way to load a pointing run, whatever it is kept in."""

from pathlib import Path

from msg_tools.bag import BagReader
from msg_tools.run_files import read_run


def load_run(path, azimuth_origin=None):
    """Read a pointing run from a CSV, a TPOINT file, a raw MMT night, or a log.

    Parameters
    ----------
    path : Path
        A file, or the folder of a log.
    azimuth_origin : {'N', 'S'}, optional
        Where azimuth 0 is in a TPOINT file.

    Returns
    -------
    PointingRun

    Raises
    ------
    ValueError
        Not a run, or a log of the simulator's truth.
    OSError
        It cannot be read.
    """
    path = Path(path)
    if path.is_dir() or path.suffix == '.mcap':
        return run_of_log(path)
    return read_run(path, azimuth_origin=azimuth_origin)


def run_of_log(path):
    """The observations in a log, with the newest zero of each power-on taken off.

    Raises
    ------
    ValueError
        No observation in it, or it holds the simulator's truth.
    """
    from msg_tools.convert import cloud_to_run, read_joints
    from pointing_model.catalogue import POLARIS_HIP
    from pointing_model.run import PointingRun
    from pointing_model.units import wrap

    bag = BagReader(path)
    if bag.has_truth:
        raise ValueError(f'{path} holds the truth of the simulator; fit the log beside it')
    by_end = {topic.name.rsplit('/', 1)[-1]: topic.name for topic in bag.topics}
    if 'observation' not in by_end:
        raise ValueError(f'{path} has no topic observation; it is no log of a night')
    parts, zeros = [], {}
    names = [by_end['observation'], *([by_end['zero']] if 'zero' in by_end else [])]
    for message in bag.messages(names, decode=True):
        if message.topic == names[0]:
            parts.append(cloud_to_run(message.data))
        elif parts:
            zeros[float(parts[-1]['run'][-1])] = read_joints(message.data)[1]
    if not parts:
        raise ValueError(f'{path} has no observation in it')
    run = PointingRun.concatenate(parts)
    notes = []
    columns = dict(run.columns)
    for number, (az, el) in zeros.items():
        rows = run['run'] == number
        columns['az_enc'] = columns['az_enc'] - az * rows
        columns['el_enc'] = columns['el_enc'] - el * rows
    columns['az_enc'] = run['az'] + wrap(columns['az_enc'] - run['az'])
    if zeros:
        notes.append(f'the zeros that the night set on {len(zeros)} power-ons are taken off')
    stars = columns['star'] != POLARIS_HIP
    notes.append(f'{int((~stars).sum())} exposures of Polaris left out')
    return PointingRun({n: v[stars] for n, v in columns.items()},
                       {'source': str(path), 'notes': notes + bag.problems, 'excluded': []})
