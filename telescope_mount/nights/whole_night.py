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

"""A whole night: start the graph, watch it, and collect its results in one folder."""

import json
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path

from msg_tools import NAMESPACE, topics
from msg_tools.convert import from_stamp
from msg_tools.status_rows import Progress
from pointing_model.runs.run_messages import cloud_to_run, run_to_cloud
from telescope_mount.observing.plan import BLOCK_STARS, ZERO_EXPOSURES, night_plan, parse_plan

from ..graph import NODES, night_graph
from ..input_files import parameter_file
from ..processes import domain
from ..processes.interrupt import noted, raise_noted
from ..running_graph.graph_end import come_to_rest
from ..simulation import kind_of_mount
from .night_files import add_truth, diagnosing, write_page, write_results

#: wall seconds without progress after which a night is given up
STALL = 60.0
#: the same for a diagnosis, which for a two-sided mount may be silent for minutes
THINKING = 1800.0
#: s; messages are handled in batches of this length while nothing is urgent
LEISURE = 0.02
#: wall seconds after which a wait is reported
REPORTED_AFTER = 1.5
#: s within which even a busy node reports again
ANSWERED_IN = 10.0
#: s that homing may take before it is reported as a delay
HOMES_IN = 30.0
#: file in the folder of a real mount's night with the state of its plan
STATE = 'plan_state.jsonl'


class NightFailed(RuntimeError):
    """The night could not be finished; the text is one line for the user."""


def prepare_folder(folder):
    """Create the output folder, or refuse it.

    Raises
    ------
    ValueError
        It has files already, or is a file.
    OSError
        It cannot be written.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f'{folder} is a file; choose another folder with --out')
    if folder.is_dir() and any(folder.iterdir()):
        raise ValueError(f'{folder} is not empty; choose another folder with --out')
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def run_night(out, *, stars=BLOCK_STARS, polaris=ZERO_EXPOSURES, reference=None,
              cycle='incremental', domain_number=None, params_file=None, progress=None,
              scenario='default', mount='', track='', discrimination='', **graph):
    """Observe a simulated night in a graph of processes.

    Parameters
    ----------
    out : Path
        Folder for all output.
    stars, polaris, cycle
        See `telescope_mount.observing.plan.night_plan`.
    reference : Path, optional
        The model of an earlier night.
    domain_number : int, optional
        ROS domain; a free one by default.
    params_file : Path, optional
        A ROS parameter file, read by every node after the values of the graph.
    progress : callable, optional
        Called with (text, done, total) for progress.
    scenario : str
        Errors of the simulated mount.
    mount : str
        See `graph.night_graph`; empty: the kind of the scenario.
    track : str
        A step of the plan after the fit, such as ``track 1.5arcsec 90``.
    discrimination : str
        A step like `track`, such as ``tell_apart 15``; preceded by a diagnosis.
    **graph
        See `graph.night_graph`: ``seed``, ``time_scale``, ...

    Returns
    -------
    dict
        The calibration report of the night, with the ``files`` written.

    Raises
    ------
    ValueError, OSError
        Bad input.
    NightFailed
        A node ended, or the plan could not be carried out.
    """
    plan = night_plan(stars, polaris, reference is not None, cycle)
    if discrimination:
        plan += f', diagnose, {discrimination}'
    if track:
        plan += f', {track}'
    parse_plan(plan)
    if reference is not None:
        from pointing_model.model import PointingModel
        PointingModel.load(reference)
    folder = Path(out)
    if discrimination:
        graph['calibration'] = diagnosing(folder, graph.get('calibration'))
    specs = night_graph(
        bag=str(folder / 'bag'), plan=plan, scenario=scenario,
        mount=kind_of_mount(scenario, mount),
        model_file=str(reference.resolve()) if reference else '', **graph)
    parameter_file.check(specs, params_file)
    prepare_folder(folder)
    written = observe(folder, specs, plan, partial(write_results, folder), progress, domain_number,
                      params_file)
    write_page(folder, written)  # before the simulator's truth is in the report
    add_truth(folder / 'bag_truth', written.report)
    return written.report


def observe(folder, specs, plan, write, progress=None, domain_number=None, params_file=None, *,
            claim=domain.claim, drivers=(), stall=STALL, hold_up=None, note=None, again=False):
    """Carry out a plan in a graph of processes, and write its results.

    Parameters
    ----------
    folder : Path
        Folder for the logs: `bag`, `bag_truth` and `nodes`.
    specs : list of graph.NodeSpec
        The nodes, including the logger and the observer.
    plan : str
        Plan of the observer.
    write : callable
        ``write(latest)``, with the last message of each topic by name, writes the files and
        returns a `Written`, which is returned.
    progress : callable, optional
        Called with (text, done, total) for progress.
    domain_number : int, optional
        ROS domain; a free one if omitted.
    params_file : Path, optional
        ROS parameter file for all nodes.
    claim : callable
        Returns the domain: `domain.claim`, or `domain.join` if drivers run already.
    drivers : sequence of Path
        Python files to start besides the nodes.
    stall : float
        Wall seconds without progress after which the night is given up.
    hold_up : callable, optional
        Called with a problem or a wait when it changes; '' when the night continues.
    note : callable, optional
        Called with each star that the guard refuses, and with the mount's actions at the end.
    again : bool
        Resume a night whose files are in `folder`.

    Returns
    -------
    night_files.Written
        With a line in ``incomplete`` if the log is not complete.

    Raises
    ------
    ValueError
        The domain is in use.
    NightFailed
        A node ended, or the plan could not be carried out.
    """
    bag = next(spec.parameters['folder'] for spec in specs if spec.name == 'mcap_logger')
    from ..processes.node_processes import Processes
    with noted(), ExitStack() as ends:
        lock = claim(domain_number)
        ends.callback(lock.release)
        # the page of the results needs half of what the calibration imports
        nodes = Processes(folder / 'nodes', lock.number, params_file,
                          ['calibration.report.night_page'])
        ends.callback(nodes.stop)
        watcher = None
        try:
            # these imports take half a second: do them after the cheap checks, and in parallel with
            # those of the nodes
            with ThreadPoolExecutor(1) as pool:
                loading = pool.submit(import_module, 'telescope_mount.running_graph.watcher')
                nodes.start_all(specs)
            for path in drivers:
                nodes.start_script(path)
            raise_noted()
            watcher = loading.result().Watcher('night', lock.number, nodes.environment, nodes.check)
            ends.callback(watcher.close)
            with _at_rest_after(watcher, specs, note or (lambda _: None)):
                watcher.executor.gather = LEISURE
                _watch(watcher, nodes, plan, progress or (lambda *_: None), stall, hold_up, note)
                watcher.executor.gather = 0.0
                if progress:
                    progress('writing the results', 0, None)
                out = _results(watcher, specs, plan, write, bag)
            if nodes.stop().get('mcap_logger'):
                out.report['incomplete'].append(_log_error(watcher, nodes, bag))
            return out
        except RuntimeError as err:
            nodes.stop()
            if again or (watcher is not None and _progress(watcher).observations):
                raise NightFailed(f'{err} (the log so far is {bag})') from None
            _clear(folder)
            raise NightFailed(str(err)) from None
        except (KeyboardInterrupt, OSError):
            nodes.stop()
            if not again and (watcher is None or not _progress(watcher).step):
                _clear(folder)  # it has only waited for drivers
            raise


def _log_error(watcher, nodes, bag):
    """Why the log is incomplete, as far as its logger could report it."""
    error = (watcher.reports.errors_of('mcap_logger')
             or nodes.last_words('mcap_logger').removeprefix('error: ')
             or f'{Path(bag).name}: it could not be closed')
    return str(Path(bag).parent / error)


def _clear(folder):
    """Nothing was observed: free the folder for the next try."""
    for name in ('bag', 'bag_truth', 'nodes'):
        shutil.rmtree(folder / name, ignore_errors=True)
    (folder / STATE).unlink(missing_ok=True)


@contextmanager
def _at_rest_after(watcher, specs, note):
    """Ensure that the mount is at rest before its guard ends; not for a simulated mount."""
    if not any(spec.name == 'mount_guard' and not spec.parameters.get('use_sim_time')
               for spec in specs):
        yield
        return
    watcher.client('abort')
    try:
        yield
    finally:
        come_to_rest(watcher, _progress(watcher).state, note)


def _no_driver(watcher):
    """Hint where to look for drivers if the graph has only its own nodes; otherwise ''."""
    from ..running_graph.graph_client import elsewhere
    spaces = {space for name, space in watcher.node.get_node_names_and_namespaces()
              if space != NAMESPACE or name not in (*NODES, watcher.node.get_name())}
    domain = watcher.node.context.get_domain_id()
    return elsewhere(domain, NAMESPACE, spaces, 'driver', '').removeprefix('; ')


def _refusal(status, count):
    """Which star the guard refused, and why; of several the last."""
    last = next((row.value for row in status.values if row.key == 'refusal'), 'a target')
    return f'refused by the guard: {last}' + (f' (and {count - 1} before)' if count > 1 else '')


def _results(watcher, specs, plan, write, bag):
    """Result of `write`, once the log is complete, too."""
    watcher.keep_results()
    if not watcher.spin_until(lambda: _complete(watcher, plan), 15.0):
        raise NightFailed('the plan is done, but its results were not published')
    with ThreadPoolExecutor(1) as pool:
        # write files and page while the last messages reach the log
        latest, incomplete = dict(watcher.latest), _progress(watcher).forgotten > 0
        written = None if incomplete else pool.submit(write, latest)
        missing = watcher.wait_for_log([spec.full_name for spec in specs], 15.0)
        out = write(_with_all_rows(latest, bag)) if incomplete else written.result()
    if missing:
        raise NightFailed('the logger could not keep up; the log lacks messages of '
                          + ', '.join(missing))
    return out


def _with_all_rows(latest, bag):
    """`latest` with the rows that the observer no longer keeps, from the logs."""
    from ..input_files.run_loader import with_rows_before
    table = latest[topics.OBSERVATIONS.name]
    run = with_rows_before(cloud_to_run(table), Path(bag).parent)
    return {**latest, topics.OBSERVATIONS.name: run_to_cloud(run, from_stamp(table.header.stamp))}


def _progress(watcher):
    """Progress of the observer."""
    return Progress.read(watcher.latest.get(topics.OBSERVER_STATUS.name))


def _watch(watcher, nodes, plan, progress, stall=STALL, hold_up=None, note=None):
    """Watch the observer until the plan is done."""
    from diagnostic_msgs.msg import DiagnosticStatus
    total = sum(step.exposures for step in parse_plan(plan))
    last, since = None, time.monotonic()
    waits, shown, refused, hinted, log = ('', since), '', 0, note is None, ''
    while True:
        watcher.spin(0.2)
        nodes.check()
        status = watcher.latest.get(topics.OBSERVER_STATUS.name)
        at = _progress(watcher)
        now = (status is None, at.observations, at.step, at.lost, len(watcher.reports),
               getattr(watcher.latest.get(topics.CALIBRATION_STATUS.name), 'message', ''))
        if now != last:
            last, since = now, time.monotonic()
        quiet = _without_answer(watcher, nodes)
        stopped = watcher.reports.errors_of('mcap_logger')
        if note is not None and stopped not in ('', log):
            note(f'the log is incomplete: {stopped}')
        log = stopped
        if status is not None:
            if note is not None and at.refused > refused:
                note(_refusal(status, at.refused - refused))
            refused = at.refused
            if at.state == 'cancelled':  # the process ends, so it cannot be resumed
                reason = status.message.removesuffix(': call resume')
                raise NightFailed(f'plan cancelled {reason}')
            if at.state == 'failed':
                raise NightFailed(status.message)
            done = at.observations + at.lost
            # the number of stars for a step `track` is unknown in advance
            progress((at.step or 'connecting the nodes') + (f', {at.lost} lost' if at.lost else '')
                     + quiet, done, max(total, done))
            if at.state == 'done':
                if shown:
                    hold_up('')
                return
            wrong = at.state == 'waiting' or status.level > DiagnosticStatus.OK
            text = status.message if wrong else ''
            if text != waits[0]:
                waits = text, time.monotonic()
            # short waits need not be reported
            patience = HOMES_IN if 'it homes the mount' in text else REPORTED_AFTER
            if hold_up is not None and text != shown and time.monotonic() - waits[1] > patience:
                shown = text
                hold_up(text)
                if not hinted and 'a publisher of' in text:
                    hinted = True
                    if hint := _no_driver(watcher):
                        note(hint)
        if time.monotonic() - since > (max(stall, THINKING) if at.step == 'diagnose' else stall):
            what = status.message if status is not None else 'the star observer'
            raise NightFailed(f'no progress for {time.monotonic() - since:.0f} s: waiting for '
                              f'{what}{quiet}')


def _without_answer(watcher, nodes):
    """Nodes that do not answer, `, ...` to append to a message; '' if all do."""
    if stopped := nodes.stopped():
        return ', ' + ', '.join(f'{name} is stopped (kill -CONT {pid})'
                                for name, pid in stopped.items())
    silent = watcher.reports.silent(ANSWERED_IN)
    return f', no answer from {", ".join(silent)}' if silent else ''


def _complete(watcher, plan):
    """Whether all results have arrived: "done" may overtake them on its own topic."""
    verbs = [step.verb for step in parse_plan(plan)]
    latest = watcher.latest
    table = latest.get(topics.OBSERVATIONS.name)
    progress = _progress(watcher)
    checks = latest.get(topics.CHECKS.name)
    checks = [] if checks is None else json.loads(checks.data)['checks']
    # a restarted observer may lack the first checks, whose rows it no longer keeps
    last = max((number for number, verb in enumerate(verbs) if verb == 'check'), default=None)
    return (table is not None and table.width == progress.observations - progress.forgotten
            and topics.MODEL.name in latest
            and (topics.CALIBRATION_REPORT if 'fit' in verbs else topics.TRACKING).name in latest
            and (last is None or any(check['block'] == last for check in checks))
            and ('diagnose' not in verbs or _diagnosed(latest, 'judge' in verbs))
            and _up_to_date(latest, verbs))


def _diagnosed(latest, compared):
    """Whether the diagnosis has arrived, and its report."""
    if topics.DIAGNOSIS.name not in latest:
        return False
    diagnosis, report = (json.loads(latest[name].data) for name in (
        topics.DIAGNOSIS.name, topics.CALIBRATION_REPORT.name))
    return (report.get('verdict') == diagnosis['verdict']
            and (not compared or 'judged' in diagnosis))


def _up_to_date(latest, verbs):
    """Whether report and model are from the last fit, not from an earlier one."""
    run = cloud_to_run(latest[topics.OBSERVATIONS.name])
    if 'time' not in run:  # a measured run, with one step of each kind
        return True
    if 'fit' not in verbs:  # the step `track` has waited for its last model
        return True
    report = json.loads(latest[topics.CALIBRATION_REPORT.name].data)
    model = json.loads(latest[topics.MODEL.name].data)
    steps = range(len(verbs))
    rests_on = model['provenance'].get('last_stamp_ns', 0)
    for stamp, made_by in ((report['last_stamp_ns'], ('fit',)),
                           (rests_on, ('fit', 'diagnose', 'judge'))):
        last = max((i for i in steps if verbs[i] in made_by), default=0)
        rows = run['time'][run['block'] < last]
        if len(rows) and stamp * 1e-9 < rows.max() - 1e-3:
            return False
    return True
