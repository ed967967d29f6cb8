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


"""Where sessions may begin: at gaps of hours, and at steps that places visited again show."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pointing_model.runs.run import PointingRun

from ..finding import Finding
from ..term_fit import fit_terms
from .residual_patterns import MOST_ROWS, ResidualRows, step_of

#: gaps that may end a session, h: a break, the day between two nights, a day without observing
GAPS = (3.0, 6.0, 12.0)
_STEPS = 5  # in a run, at most
#: in the place of hours: sessions begin where places visited again disagree
AT_STEPS = 'steps'


def divisions(runs, terms, encoder, least_step):
    """Runs as they are given, and every other way to divide them into sessions.

    Parameters
    ----------
    runs : list of PointingRun
    terms, encoder, least_step
        As of `split_at_steps`.

    Returns
    -------
    list of (float or str or None, list of PointingRun)
        The gap in hours, `AT_STEPS`, or None: as they are given. Of two gaps that make the same
        sessions the shorter one.
    """
    out = {}
    at_steps = [split_at_steps(run, terms, encoder, least_step) for run in runs]
    for gap, parts in ((None, runs), *((gap, _split(runs, gap)) for gap in GAPS),
                       (AT_STEPS, at_steps)):
        out.setdefault(session_count(parts), (gap, parts))
    return [*out.values()]


def split_at_steps(run, terms=(), encoder='enc', least_step=0.0):
    """A run with sessions that begin where places visited again disagree at once.

    Parameters
    ----------
    run : PointingRun
    terms : sequence of str
        That are fitted and leave the residuals which are compared; without any the physical ones.
    encoder : {'enc', 'abs'}
    least_step : float
        Times the noise of one visit, from where a step begins a session.

    Returns
    -------
    PointingRun
        With a Finding for each step; as it was where there is none.
    """
    terms = tuple(terms) or run.mount.names.physical
    step = -(-len(run) // MOST_ROWS)
    for _ in range(_STEPS):
        part = run if step < 2 else run.select(slice(None, None, step))
        try:
            fitted = fit_terms(part, terms, encoder=encoder, run_zeros='run' in run)
        except ValueError:  # whoever fits them says why
            break
        rows = ResidualRows.from_fit(part, fitted, encoder)
        if step > 1:
            rows = rows._replace(lines=run.lines[::step][rows.lines])
        position, found = step_of(rows, terms, least_step)
        if found is None:
            break
        time = np.asarray(run.get('time'), float)
        when = time if np.isfinite(time).all() else np.arange(len(run)) / step
        own = run.get('run', 1.0) * 2.0 + (when > position)
        run = add_note(PointingRun({
            **run.columns, 'run': 1 + np.unique(own, return_inverse=True)[1]}, run.meta),
            replace(found, todo='own zeros'))
    return run


def split_run(run, hours):
    """A run with its sessions numbered, and a note of how many there are.

    Raises
    ------
    ValueError
        No number of hours above 0, or no time in some row: with the file.
    """
    if not hours > 0.0:
        raise ValueError(f'sessions at gaps of {hours:g} h: give a number of hours above 0')
    source = run.meta.get('source', 'run')
    try:
        out = run.split_sessions(hours)
    except ValueError as err:
        raise ValueError(f'{source}: {err}') from None
    return session_note(out, 'sessions', hours)


def split_runs(runs, hours):
    """`split_run` of a run, or of each of several."""
    return [split_run(run, hours) for run in
            ([runs] if isinstance(runs, PointingRun) else runs)]


def _split(runs, hours):
    """Runs split at gaps; as it is what has no time in some row."""
    return [run.split_sessions(hours) if np.isfinite(np.asarray(run.get('time'), float)).all()
            else run for run in runs]


def session_count(runs):
    """Runs in `runs`, by file and column."""
    return sum(len(np.unique(run['run'])) if 'run' in run else 1 for run in runs)


def session_note(run, kind, hours):
    """The run with a Finding on its sessions."""
    return add_note(run, Finding(kind, hours, unit='h', evidence={
        'source': Path(run.meta.get('source', 'run')).name,
        'sessions': len(np.unique(run['run'])) if 'run' in run else 1}))


def add_note(run, found):
    """The run with a Finding more among its notes."""
    return PointingRun(run.columns, {
        **run.meta, 'notes': [*run.meta.get('notes', ()), found]})
