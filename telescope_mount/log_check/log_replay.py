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

"""Replay of a log into a fresh calibration."""

import json
import tempfile
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

from calibration.analysis.harmonic_fit import choice_of_report
from calibration.estimation.false_alarms import ALPHA
from msg_tools import topics
from msg_tools.bag.bag_pair import parameters_of
from msg_tools.bag.sqlite import open_bag
from msg_tools.bag.topic_names import prefix_of
from msg_tools.convert import from_stamp
from msg_tools.status_rows import Taken
from msg_tools.whole_files import write_text
from pointing_model.effects.base import AXES

from ..graph import replay_graph
from ..processes import domain
from ..processes.interrupt import noted


def replay_log(log, *, reference=None, seed=1, out=None, domain_number=None, harmonics=None,
               progress=None):
    """Publish the observations of a log to a new calibration node, and fit.

    If the night was diagnosed, so is the replay; the model is then the amended one.

    Parameters
    ----------
    log : Path
        Bag folder or .mcap file of a night.
    reference : Path, optional
        The reference model of the night.
    seed : int
        Seed of the choice of held-out stars.
    out : Path, optional
        File for the model.
    domain_number : int, optional
        ROS domain; a free one by default.
    harmonics : dict, optional
        Parameters ``harmonics...`` of the calibration; by default those of the night.
    progress : callable, optional
        Called with (text, done, total) for progress.

    Returns
    -------
    dict
        The calibration report; ``diagnosis`` is that of the replay or None; ``problems`` lists
        problems of the log.

    Raises
    ------
    ValueError, OSError
        The log cannot be used, or the domain is in use.
    RuntimeError
        A node ended or did not answer.
    """
    bag, progress = open_bag(log), progress or (lambda *_: None)
    prefix = prefix_of(bag)
    counts = Counter({t.name: t.count for t in bag.topics})
    observation = f'{prefix}{topics.OBSERVATION.name}'
    count = counts[observation]
    if count == 0:
        raise ValueError(f'{log} has no observation in it; it is no log of a night')
    newer = _newer(bag, observation)
    notes = [f'{count - newer} of {count} observations are duplicates: each counts once'
             ] if newer < count else []
    had_zero = bool(counts[f'{prefix}{topics.ZERO.name}']) and _has_exposures(bag, observation)
    diagnosed = _last(bag, f'{prefix}{topics.DIAGNOSIS.name}')
    # parameters of the calibration for fit and diagnosis in the night
    as_then = harmonics if harmonics is not None else choice_of_report(
        _last(bag, f'{prefix}{topics.CALIBRATION_REPORT.name}')).parameters()
    if diagnosed:
        lines_of = diagnosed.get('graduation') or {}
        as_then |= {'alpha': diagnosed.get('alpha', ALPHA),
                   'site': ', '.join(map(repr, diagnosed.get('site_deg') or ())),
                   'diagnosed_at': diagnosed.get('last_stamp_ns', 0),
                   'graduation': ', '.join(
                       f'{column}.{kind}={lines}' for column, axis in zip(
                           next(_runs(bag, observation)).mount.names.columns, AXES)
                       for kind, lines in lines_of.get(axis, {}).items())}
    as_then['kept_power_ons'] = (parameters_of(bag.metadata, f'{prefix}calibration') or {}).get(
        'kept_power_ons', 0)
    played = [name for name in (observation, f'{prefix}{topics.HOMING.name}') if counts[name]]
    lock = domain.claim(domain_number)
    from ..processes.node_processes import Processes
    from ..running_graph.watcher import Watcher
    with noted(), tempfile.TemporaryDirectory(prefix='telescope_mount_') as scratch, (
            ExitStack()) as ends:
        ends.callback(lock.release)
        nodes = Processes(scratch, lock.number)
        ends.callback(nodes.stop)
        nodes.start_all(replay_graph(str(Path(log).resolve()), prefix, played, seed,
                                     reference, as_then))
        watcher = Watcher('replay', lock.number, nodes.environment, nodes.check)
        ends.callback(watcher.close)
        watcher.keep_results()

        def taken():
            status = Taken.read(watcher.latest.get(topics.CALIBRATION_STATUS.name))
            done = status.kept + status.forgotten
            progress('observing again', done, newer)
            return done

        if not watcher.spin_until(lambda: taken() >= newer, 60.0):
            raise RuntimeError(f'only {taken()} of {newer} observations arrived')
        if had_zero:
            watcher.call('calibrate_zero')
        progress('fitting')
        watcher.call('fit')
        there = [topics.MODEL.name, topics.CALIBRATION_REPORT.name]
        if diagnosed:
            progress('diagnosing')
            watcher.call('diagnose', timeout=120.0)
            there.append(topics.DIAGNOSIS.name)
        blind_checked = bool(diagnosed) and 'judged' in diagnosed
        if blind_checked:
            watcher.call('judge')

        def complete():
            # the last model received may still be that of the fit
            if not all(name in watcher.latest for name in there):
                return False
            model, *rest = (json.loads(watcher.latest[name].data) for name in there)
            return (not diagnosed or 'verdict' in model['provenance']) and (
                not blind_checked or 'judged' in model['provenance'] and 'judged' in rest[-1])
        if not watcher.spin_until(complete, 15.0):
            raise RuntimeError('the calibration fitted but published no model')
        model, *documents = (watcher.latest[name].data for name in there)
    if out is not None:
        write_text(out, model + '\n')
    report = json.loads(documents[0])
    report['diagnosis'] = json.loads(documents[1]) if diagnosed else None
    report['problems'] = bag.problems + notes
    return report


def _newer(bag, topic):
    """Number of observations that a calibration accepts: those newer than all before them."""
    newest = count = 0
    for message in bag.messages([topic], decode=True):
        stamp = from_stamp(message.data.header.stamp)
        count += stamp > newest
        newest = max(newest, stamp)
    return count


def _has_exposures(bag, topic):
    """Whether a zero can be set; a logged zero may come from a model instead of exposures."""
    from pointing_model.zero import is_for_zero
    return any('star' in run and is_for_zero(run).any() for run in _runs(bag, topic))


def _runs(bag, topic):
    """The `PointingRun` of each message with observations in a log."""
    from pointing_model.runs.run_messages import cloud_to_run
    return (cloud_to_run(message.data) for message in bag.messages([topic], decode=True))


def _last(bag, name):
    """The last document on a topic, or None."""
    documents = [message.data.data for message in bag.messages([name], decode=True)]
    return json.loads(documents[-1]) if documents else None
