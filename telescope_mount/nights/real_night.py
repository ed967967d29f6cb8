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

"""A night on a real mount: the graph besides drivers, on wall time."""

from functools import partial
from pathlib import Path

from telescope_mount.observing.night_file import NightFile
from telescope_mount.observing.plan import BLOCK_STARS, parse_plan, real_plan

from ..graph import real_graph
from ..input_files import parameter_file
from ..processes import domain
from . import whole_night as night
from .night_files import diagnosing, write_page, write_results
from .whole_night import STATE

#: wall seconds without progress after which a night is given up: a slow mount's slew through half a
#: turn, and some clouds
STALL = 1800.0


def run_real_night(out, *, plan='', stars=BLOCK_STARS, drivers=(), domain_number=None,
                   params_file=None, progress=None, hold_up=None, note=print, reference=None,
                   anew=False, **graph):
    """Observe with the drivers of a real mount.

    An interrupted night in `out` is resumed where it stopped, with a new log.

    Parameters
    ----------
    out : Path
        Folder for all output.
    plan : str
        Steps of the observer; empty for `real_plan` with this number of `stars`.
    drivers : sequence of Path
        Python files to start besides the nodes; drivers that already run are found in the domain.
    domain_number : int, optional
        ROS domain; that of the environment by default.
    reference : Path, optional
        Initial model.
    anew : bool
        Restart an interrupted night from its beginning.
    note : callable
        Called with the step where an interrupted night is resumed; see also `night.observe`.
    params_file, progress, hold_up
        See `night.observe`.
    **graph
        See `graph.real_graph`: ``mount``, ``sky``, ``absolute_encoder``, ``inclinometer``,
        ``exposure``.

    Returns
    -------
    dict
        The calibration report, with the ``files`` written and the ``checks``.

    Raises
    ------
    ValueError, OSError
        Bad input.
    whole_night.NightFailed
        A node ended, or the plan could not be carried out.
    """
    plan = plan or real_plan(stars)
    verbs = {step.verb for step in parse_plan(plan)}
    if 'fit' not in verbs and not (reference and 'track' in verbs):
        raise ValueError(f'--plan {plan!r} would give no result: add the step fit, or track and '
                         'a --reference')
    _check_files(drivers, reference)

    def nodes(folder, **common):
        if 'diagnose' in verbs:
            graph['calibration'] = diagnosing(folder, graph.get('calibration'))
        return real_graph(**common, **graph)

    return _carry_out(out, plan, graph.get('mount', 'altaz'), nodes, reference, anew, drivers,
                      domain_number=domain_number, params_file=params_file, progress=progress,
                      hold_up=hold_up, note=note, claim=domain.join)


def run_server_night(out, mount, *, stars=BLOCK_STARS, reference=None, camera='', drivers=(),
                     domain_number=None, params_file=None, progress=None, hold_up=None, note=print,
                     anew=False, sky=None, track='', discrimination='', **graph):
    """A night on a mount of an INDI or Alpaca server, on this machine's clock.

    Parameters
    ----------
    out, reference, drivers, domain_number, params_file, progress, hold_up, note, anew
        See `run_real_night`.
    mount, sky
        See `server_night.ask_server`.
    camera : str
        See `server_night.parse_camera`; empty: a driver observes the sky, or a simulator reports.
    stars : int
        Number of stars for the fit.
    track, discrimination : str
        See `server_night.server_plan`.
    **graph
        See `server_night.nodes_of`: ``exposure``, ``seed``, ``calibration``.

    Returns, Raises
        See `run_real_night`.
    """
    from .server_night import ask_server, nodes_of, parse_camera, server_plan
    _check_files(drivers, reference)
    if camera:
        parse_camera(camera)
    plan = server_plan(stars, track, discrimination)
    if camera and any(step.verb == 'pass' for step in parse_plan(plan)):
        raise ValueError(f'--camera {camera}: it measures stars only, and a pass needs the '
                         'satellite measured; give a driver that does so with --driver')
    found = ask_server(mount, sky, bool(camera or drivers))
    return _carry_out(
        out, plan, found.kind, lambda _, **common: nodes_of(
            found, camera=camera, drivers=drivers, **common, **graph),
        reference, anew, drivers, domain_number=domain_number, params_file=params_file,
        progress=progress, hold_up=hold_up, note=note)


def _carry_out(out, plan, kind, nodes, reference, anew, drivers, *, note, params_file=None,
               **options):
    """Observe in a folder, with the nodes that `nodes` returns for it; the report."""
    folder = Path(out)
    bag = _free(folder / 'bag')
    specs = nodes(folder, plan=plan, bag=str(bag), state_file=str(folder / STATE),
                  model_file=str(reference.resolve()) if reference else '')
    for text in parameter_file.check(specs, params_file, drivers):
        note(text)
    folder, again = _folder(folder, plan, kind, anew, note)
    written = night.observe(
        folder, specs, plan, partial(write_results, folder, bag=bag), drivers=drivers, stall=STALL,
        note=note, again=again, params_file=params_file, **options)
    write_page(folder, written, bag)
    return written.report


def _check_files(drivers, reference):
    for path in map(Path, drivers):
        if not path.is_file():
            raise ValueError(f'{path} is no file; give a driver in Python with --driver')
    if reference is not None:
        from pointing_model.model import PointingModel
        PointingModel.load(reference)


def _folder(out, plan, mount, anew, note):
    """The output folder, and whether an interrupted night is resumed in it."""
    if not (out / STATE).is_file():
        return night.prepare_folder(out), False
    file = NightFile(out / STATE, mount)
    left = file.kept.left
    if left is not None and left.state == 'done':
        return night.prepare_folder(out), False  # refuses it: there are files
    if anew:
        file.forget()
    elif left is not None and left.plan != plan:
        raise ValueError(f'{out} has an interrupted night with the plan {left.plan!r}: give '
                         'that plan to resume it, --anew to restart it, or another --out')
    elif left is not None:
        note(f'the night in {out} was interrupted after {len(file.kept.rows)} observations: '
             f'resuming at step {left.block + 1}, {left.step}')
    return out, True


def _free(path):
    """`path`, or the first free variant of it with _2, _3, ..."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f'{path.name}_{number}')
    return free
