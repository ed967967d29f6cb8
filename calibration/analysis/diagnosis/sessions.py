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


"""Days in one file: which rows are a session, and what each session fits for itself.

Between two nights a zero is set anew, a receiver is mounted again, the structure settles: what is
one file need not be one mount. Rows before and after a gap of hours, or a step that places visited
again show (`residual_patterns`), are sessions with zeros of their own unless one zero explains them
as well; what else moves from session to session is chosen the same way, by BIC.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.estimation.robust import GROSS
from pointing_model.runs.run import PointingRun

from ..finding import Finding
from .base_terms import Base
from .observations import mount_of, observations, run_labels
from .session_starts import (
    AT_STEPS,
    add_note,
    divisions,
    session_count,
    session_note,
    split_runs,
)
from .session_trial import SessionTrial

_ROWS = 10000  # that the question is put to, at most


class Sessions(NamedTuple):
    """Runs with their sessions numbered.

    Attributes
    ----------
    runs : list of PointingRun
        Their notes say what was done.
    own_terms : tuple of str
        Terms that each session (or run) fits for itself.
    hours : float or None
        A gap longer than this begins a session; None: the runs are as they were given.
    """

    runs: list
    own_terms: tuple
    hours: float | None = None


def arrange(runs, base=None, own_terms=None, sessions=None, encoder='enc',
            least_step=GROSS):
    """Number the sessions, and choose what each fits for itself.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
    base : Base, optional
        The declared model; by default the physical terms of the mount.
    own_terms : sequence of str, optional
        Terms that each session fits for itself; by default chosen: the zeros, and of CA, AN with
        AW, TF and NPAE what pays by BIC.
    sessions : float, optional
        A gap longer than so many hours ends a session. By default one of `GAPS`, or a step that
        places visited again show, or none of them, whichever BIC likes best. 0: none, and the zeros
        alone are each run's own.
    encoder : {'enc', 'abs'}
    least_step : float
        As of `split_at_steps`. By default what makes outliers of all rows after it; a smaller one
        is left to the search, which can judge and name it.

    Returns
    -------
    Sessions

    Raises
    ------
    ValueError
        See `split_run` and `observations`.
    """
    runs = [runs] if isinstance(runs, PointingRun) else list(runs)
    mount = mount_of(runs)
    base = Base(mount.names.physical) if base is None else replace(base, own=())
    if sessions:
        runs = split_runs(runs, sessions)
    ways = divisions(runs, base.terms, encoder, least_step) if sessions is None else [(None, runs)]
    if len(ways) == 1 and (own_terms is not None or sessions == 0.0 or session_count(runs) < 2):
        zeros = mount.names.index if session_count(runs) > 1 else ()
        return Sessions(runs, zeros if own_terms is None else tuple(own_terms), sessions or None)
    obs = observations(runs, encoder)
    if len(obs) > _ROWS:
        obs = obs.select(np.arange(len(obs))[::-(-len(obs) // _ROWS)])
    rows = obs.run['row']
    labels = [run_labels(parts)[1][rows] for _, parts in ways]
    most = int(np.argmax([session_count(parts) for _, parts in ways]))
    trial = SessionTrial(obs, base, labels[most])
    found = [(*trial.best(label, own_terms), gap, parts)
             for label, (gap, parts) in zip(labels, ways)]
    # more sessions than were given must pay, and predict stretches that are left out
    found = found[:1] + [one for one in found[1:] if one[1] < found[0][1]]
    _, _, own, gap, parts = min(found, key=lambda one: one[0])
    gaps = [gap for gap, _ in ways[1:] if gap != AT_STEPS]
    if gap is None and gaps:
        parts = [session_note(run, 'gaps without sessions', gaps[0]) for run in parts]
    elif gap not in (None, AT_STEPS):
        parts = [session_note(run, 'sessions found', gap) if 'run' in run else run for run in parts]
    if own_terms is None and set(own) - set(mount.names.index):
        parts[0] = add_note(parts[0], Finding('terms of sessions', causes=tuple(own)))
    return Sessions(parts, own, None if gap == AT_STEPS else gap or sessions)
