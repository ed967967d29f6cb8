"""A night on a real mount: the graph beside drivers, on the time of the wall."""

import json
from functools import partial
from pathlib import Path

from pointing_model.observing.plan import parse_plan, real_plan

from . import domain, night
from .graph import real_graph

#: wall seconds without any progress after which it is given up: a slew through half a turn of a
#: slow mount, and some clouds
STALL = 1800.0


def run_real_night(out, *, plan='', stars=30, drivers=(), domain_number=None, params_file=None,
                   progress=None, say=None, reference=None, **graph):
    """Observe with the drivers of a real mount.

    Parameters
    ----------
    out : Path
        Folder for all that is written.
    plan : str
        Steps of the observer; empty for `real_plan` of so many `stars`.
    drivers : sequence of Path
        Python files to start beside the nodes; those that run already are found in the domain.
    domain_number : int, optional
        ROS domain; that of the environment by default.
    reference : Path, optional
        A model to begin with.
    params_file, progress, say
        As of `night.observe`.
    **graph
        As of `graph.real_graph`: ``mount``, ``sky``, ``absolute_encoder``, ``exposure``.

    Returns
    -------
    dict
        The calibration report, with the ``files`` that were written and the ``checks``.

    Raises
    ------
    ValueError, OSError
        Bad input.
    night.NightFailed
        A node ended, or the plan could not be carried out.
    """
    plan = plan or real_plan(stars)
    verbs = {step.verb for step in parse_plan(plan)}
    if 'fit' not in verbs:
        raise ValueError(f'--plan {plan!r} has no fit: nothing would be told')
    for path in map(Path, drivers):
        if not path.is_file():
            raise ValueError(f'{path} is no file; give a driver in Python with --driver')
    if reference is not None:
        from pointing_model.model import PointingModel
        PointingModel.load(reference)
    folder = night.prepare_folder(out)
    specs = real_graph(bag=str(folder / 'bag'), plan=plan,
                       model_file=str(reference.resolve()) if reference else '', **graph)
    return night.observe(
        folder, specs, plan, partial(write_with_checks, folder), progress, domain_number,
        params_file, claim=domain.join, drivers=drivers, stall=STALL, say=say)


def write_with_checks(folder, results):
    """As `night.write_results`, with the blind checks in the report."""
    from msg_tools import topics
    report = night.write_results(folder, results)
    if topics.CHECKS.name in results:
        report['checks'] = json.loads(results[topics.CHECKS.name].data)['checks']
    return report
