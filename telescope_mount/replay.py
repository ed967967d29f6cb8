"""Replay of a log into a fresh calibration."""

import json
import tempfile
from pathlib import Path

from msg_tools.bag import BagReader

from . import domain
from .graph import replay_graph


def replay_log(log, *, reference=None, seed=1, out=None, domain_number=None):
    """Publish the observations of a log to a new calibration node, and let it fit.

    Parameters
    ----------
    log : Path
        Bag folder or .mcap file of a night.
    reference : Path, optional
        The reference model that the night had.
    seed : int
        Of the choice of held-out stars.
    out : Path, optional
        File for the model.
    domain_number : int, optional
        ROS domain; a free one by default.

    Returns
    -------
    dict
        The calibration report.

    Raises
    ------
    ValueError, OSError
        The log cannot be used, or the domain is in use.
    RuntimeError
        A node ended or did not answer.
    """
    bag = BagReader(log)
    if bag.has_truth:
        raise ValueError(f'{log} holds the truth of the simulator; replay the log beside it')
    topic = next((t for t in bag.topics if t.name.endswith('/observation')), None)
    if topic is None or topic.count == 0:
        raise ValueError(f'{log} has no observation in it; it is no log of a night')
    had_zero = any(t.name.endswith('/zero') and t.count for t in bag.topics)
    lock = domain.claim(domain_number)
    from msg_tools import topics

    from .processes import Processes
    from .watcher import Watcher
    with tempfile.TemporaryDirectory(prefix='telescope_mount_') as scratch:
        nodes = Processes(scratch, lock.number)
        watcher = None
        try:
            for spec in replay_graph(str(Path(log).resolve()), topic.name, seed, reference):
                nodes.start(spec)
            watcher = Watcher('replay', lock.number, nodes.environment)

            def taken():
                return int(watcher.values(topics.CALIBRATION_STATUS).get('observations', 0))

            if not watcher.spin_until(lambda: taken() >= topic.count, 60.0, nodes.check):
                raise RuntimeError(f'only {taken()} of {topic.count} observations arrived')
            if had_zero:
                watcher.call('calibrate_zero', each=nodes.check)
            watcher.call('fit', each=nodes.check)
            there = [topics.MODEL.name, topics.CALIBRATION_REPORT.name]
            if not watcher.spin_until(
                    lambda: all(name in watcher.latest for name in there), 15.0, nodes.check):
                raise RuntimeError('the calibration fitted but published no model')
            model, report = (watcher.latest[name].data for name in there)
        finally:
            if watcher is not None:
                watcher.close()
            nodes.stop()
            lock.release()
    if out is not None:
        Path(out).write_text(model + '\n')
    return json.loads(report)
