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


"""Sessions in one file: which rows form a session, and which terms are fitted to each session.

Between two nights a zero is reset, a receiver is remounted, the structure settles: one file need
not have one set of terms. Rows before and after a gap of hours, or before and after a step seen in
repeated visits to the same places (`residual_patterns`), are sessions with separate zeros unless a
common zero explains them as well. Other terms that vary between sessions are selected by BIC, too.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calibration.estimation.correlated_noise import EIGEN, WhiteNoise
from calibration.estimation.group_columns import inverse_root
from calibration.estimation.linear_model import DISTINCT, LIVE, weighted_fit
from calibration.estimation.robust import GROSS
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun
from pointing_model.zero import OF_RUNS, PowerOnZero, Zeros, carried_zeros

from ..finding import Finding
from ..term_fit import fit_terms, rotation_start
from .base_terms import Base
from .observations import mount_of, observations, run_labels
from .residual_patterns import MOST_ROWS, ResidualRows, step_finding

#: gaps that may end a session, h: a break, the day between two nights, a day without observing
GAPS = (3.0, 6.0, 12.0)
_STEPS = 5  # largest number of steps in a run
#: used in place of hours: sessions begin where repeated visits to the same places disagree
AT_STEPS = 'steps'
_ROWS = 10000  # largest number of rows used to choose the sessions
#: groups of terms that may vary between sessions in addition to the zeros: collimation, tilt of
#: the first axis, tube flexure, non-perpendicular axes
_MOVING = (('CA',), ('AN', 'AW'), ('TF',), ('NPAE',))
#: number of contiguous cross-validation folds of each session, and fewest rows of a session in them
_PARTS, _LONG_ENOUGH = 3, 9


class Sessions(NamedTuple):
    """Runs with their sessions numbered.

    Attributes
    ----------
    runs : list of PointingRun
        Their notes report the sessions.
    own_terms : tuple of str
        Terms fitted separately to each session (or run).
    hours : float or None
        A gap longer than this begins a session; None: the runs are unchanged.
    """

    runs: list
    own_terms: tuple
    hours: float | None = None


def arrange(runs, base=None, own_terms=None, sessions=None, encoder='enc',
            least_step=GROSS):
    """Number the sessions, and choose the terms fitted to each of them.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
    base : Base, optional
        The declared model; by default the physical terms of the mount.
    own_terms : sequence of str, optional
        Terms fitted separately to each session. By default the zeros, and those of CA, AN with AW,
        TF and NPAE that gain by BIC.
    sessions : float, optional
        A gap longer than this many hours ends a session. By default the division with the lowest
        BIC: at one of `GAPS`, at steps seen in repeated visits, or none. 0: no sessions, and only
        the zeros are fitted to each run.
    encoder : {'enc', 'abs'}
    least_step : float
        See `split_at_steps`. By default a step that makes all later rows outliers; smaller ones
        are left to the search, which can test and name them.

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
    # more sessions than given must also predict held-out stretches of time better
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


def median_findings(run, model):
    """A Finding: terms fitted to each run are medians in the model, so it fits no single run.

    Parameters
    ----------
    run : RunProblem
    model : PointingModel

    Returns
    -------
    list of Finding
    """
    own, count = run.base.own, len(run.obs.runs)
    if not own or count < 2:
        return []
    zeros = carried_zeros(model)
    return [Finding('medians of the runs', evidence={
        'runs': count, 'terms': {name: model.terms[name] / ARCSEC for name in own},
        'newest': zeros.newest.run if zeros else None})]


def with_zeros(model, zeros, before, after):
    """Add the zeros of the runs of a file to a model.

    Parameters
    ----------
    model : PointingModel
    zeros : iterable of PowerOnZero
    before, after : PointingRun
        The run as read, and with its sessions numbered.

    Returns
    -------
    PointingModel
        Unchanged if sessions renumbered the runs, or if index terms act on the sky and are no
        encoder zeros.
    """
    if model.mount.on_sky or 'run' in before and not np.array_equal(before['run'], after['run']):
        return model
    return replace(model, provenance={**model.provenance, OF_RUNS: Zeros(zeros).to_list()})


def with_zeros_of_terms(result, before, after):
    """Add the zeros of its runs to the model of a diagnosis, if no other term varies by run.

    Parameters
    ----------
    result : Diagnosis
    before, after : sequence of PointingRun
        See `with_zeros`. The runs of several files are numbered in order of time, or as given if a
        time is unknown. Nothing is added if the files number their runs themselves.
    """
    index, model, own = result.model.mount.names.index, result.model, result.run_terms
    before = [before] if isinstance(before, PointingRun) else before
    numbered = len(before) > 1 and any('run' in run for run in before)
    if numbered or len(own) < 2 or not set(result.base.own) <= set(index):
        return model
    zeros = [PowerOnZero(*(
        own[name][term] * ARCSEC - model.terms[term] if term in own[name] else 0.0
        for term in index), run=float(number))
        for name, number in _run_numbers(result.observations).items()]
    return with_zeros(model, zeros, before[0], after[0])


def _run_numbers(obs):
    """Name of each run in the results -> its number in a model, newest last."""
    names = [*map(str, obs.runs)]
    if not any(isinstance(one, str) for one in obs.runs):  # one file
        return dict(zip(names, obs.runs))
    starts = np.array([np.min(obs.run.get('time')[obs.label == i]) for i in range(len(names))])
    order = np.argsort(starts if np.isfinite(starts).all() else range(len(names)), kind='stable')
    return {names[i]: number for number, i in enumerate(order, 1)}


def divisions(runs, terms, encoder, least_step):
    """The runs as given, and all other ways to divide them into sessions.

    Parameters
    ----------
    runs : list of PointingRun
    terms, encoder, least_step
        See `split_at_steps`.

    Returns
    -------
    list of (float or str or None, list of PointingRun)
        The gap in hours, `AT_STEPS`, or None (as given). Of gaps that give equally many sessions
        only the shortest.
    """
    out = {}
    at_steps = [split_at_steps(run, terms, encoder, least_step) for run in runs]
    for gap, parts in ((None, runs), *((gap, _split(runs, gap)) for gap in GAPS),
                       (AT_STEPS, at_steps)):
        out.setdefault(session_count(parts), (gap, parts))
    return [*out.values()]


def split_at_steps(run, terms=(), encoder='enc', least_step=0.0):
    """Split a run into sessions at sudden steps between repeated visits to the same places.

    Parameters
    ----------
    run : PointingRun
    terms : sequence of str
        Terms fitted before residuals are compared; by default the physical ones.
    encoder : {'enc', 'abs'}
    least_step : float
        Smallest step that begins a session, in units of the noise of one visit.

    Returns
    -------
    PointingRun
        With a Finding for each step; unchanged if there is none.
    """
    terms = tuple(terms) or run.mount.names.physical
    step = -(-len(run) // MOST_ROWS)
    time = np.asarray(run.get('time'), float)
    when = time if np.isfinite(time).all() else np.arange(len(run))
    for _ in range(_STEPS):
        part, own = run if step < 2 else run.select(slice(None, None, step)), 'run' in run
        try:
            fitted = fit_terms(part, terms, encoder=encoder, run_zeros=own)
        except ValueError:  # the fit of the terms will report the reason
            break
        rows = ResidualRows.from_fit(part, fitted, encoder)
        if step > 1:
            rows = rows._replace(lines=run.lines[::step][rows.lines])
        found = step_finding(rows, rows.visits(terms, own), least_step)
        if found is None:
            break
        label = np.asarray(run.get('run', np.ones(len(run))))
        first = int(np.flatnonzero(run.lines == found['after'])[0])
        later = (label == label[first]) & (when >= when[first])
        label = 1 + np.unique(2.0 * label + later, return_inverse=True)[1]
        if label.max() == session_count([run]):  # the step is where a session begins already
            break
        run = add_note(PointingRun({**run.columns, 'run': label}, run.meta),
                       replace(found, todo='own zeros'))
    return run


def split_run(run, hours):
    """Number the sessions of a run, and add a note of how many there are.

    Raises
    ------
    ValueError
        `hours` is not positive, or some row has no time (the message names the file).
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
    """Split runs at gaps; runs with missing times are unchanged."""
    return [run.split_sessions(hours) if np.isfinite(np.asarray(run.get('time'), float)).all()
            else run for run in runs]


def session_count(runs):
    """Total number of runs, by files and their column ``run``."""
    return sum(len(np.unique(run['run'])) if 'run' in run else 1 for run in runs)


def session_note(run, kind, hours):
    """Add a Finding on its sessions to a run."""
    return add_note(run, Finding(kind, hours, unit='h', evidence={
        'source': Path(run.meta.get('source', 'run')).name,
        'sessions': len(np.unique(run['run'])) if 'run' in run else 1}))


def add_note(run, found):
    """Add a Finding to the notes of a run."""
    return PointingRun(run.columns, {
        **run.meta, 'notes': [*run.meta.get('notes', ()), found]})


class SessionTrial:
    """Fits with terms that vary by session, all with the weights of one robust fit.

    With separate weights, a fit could win by rejecting as outliers rows that another one explains.

    Parameters
    ----------
    obs : Observations
    base : Base
        Without own terms.
    session : ndarray of int, shape (n,)
        Session of each row, in the division with most sessions.
    """

    def __init__(self, obs, base, session):
        self._context, self._n, self._base = obs.context, len(obs), base
        self._order = np.arange(self._n) if obs.context.get('time') is None \
            else np.argsort(np.argsort(obs.context.get('time'), kind='stable'))
        self._left = rotation_start(obs, base.terms)[1]
        zeros = replace(base, own=obs.run.mount.names.index)
        columns = zeros.columns(obs.context, session)
        fit = weighted_fit(columns, self._left, obs.inverse_sigma)
        given = 1.0 if obs.inverse_sigma is None else obs.inverse_sigma
        self._root = given * np.hstack([np.sqrt(fit.weights) / s for s in fit.scale])
        self._live = fit.weights > LIVE

    def best(self, session, own_terms):
        """Score a division into sessions, with the best terms that vary by session.

        Parameters
        ----------
        session : ndarray of int, shape (n,)
            Session of each row.
        own_terms : sequence of str or None
            Terms that vary by session; None: forward selection.

        Returns
        -------
        tuple
            (BIC, cross-validated RMS on contiguous folds, own terms).
        """
        label = np.unique(session, return_inverse=True)[1]
        if label.max() == 0:
            return (*self._score((), label), own_terms or ())
        if own_terms is not None:
            return (*self._score(tuple(own_terms), label), tuple(own_terms))
        names = self._context.mount.names
        own = names.index
        groups = [g for g in (tuple(map(names.named, group)) for group in _MOVING)
                  if set(g) <= set(self._base.terms)]
        bic, left_out = self._score(own, label)
        while groups:
            tried = [(*self._score(own + group, label), group) for group in groups]
            tried = [one for one in tried if one[0] < bic and one[1] < left_out]
            if not tried:
                break
            bic, left_out, group = min(tried)
            own += group
            groups.remove(group)
        return bic, left_out, own

    def _score(self, own, label):
        """BIC, k ln n - 2 ln L, with separate noise for each axis, and the cross-validated RMS."""
        columns = replace(self._base, own=own).columns(self._context, label)
        live = int(self._live.sum())
        residual, count = self._fit(columns, self._root)
        if 2 * live < count + 4:
            return np.inf, np.inf
        rss = np.square(residual * self._root).reshape(2, -1).sum(axis=1) + 1e-30
        bic = live * float(np.log(rss / live).sum()) + count * np.log(live)
        place, size = np.empty(self._n, int), np.empty(self._n, int)
        for session in range(label.max() + 1):
            rows = np.flatnonzero(label == session)
            place[rows[np.argsort(self._order[rows])]] = np.arange(len(rows))
            size[rows] = len(rows)
        long_enough = self._live & (size >= _LONG_ENOUGH)
        total = 0.0
        for part in range(_PARTS):
            out = np.tile(place * _PARTS // size == part, 2)
            left, _ = self._fit(columns, np.where(out, 0.0, self._root))
            total += np.square((left * self._root)[out & np.tile(long_enough, 2)]).sum()
        return bic, np.sqrt(total / max(long_enough.sum(), 1))

    def _fit(self, columns, root):
        """Residuals of all rows, shape (2n,), and number of determined coefficients."""
        common, b, noise = columns.common, self._left, WhiteNoise(root)
        groups = columns.whitened(noise).orthonormal_groups()
        white, left = noise.whiten(common), groups.off(noise.whiten(b))
        length = np.sqrt(np.square(white).sum(axis=1))
        white = groups.off(white)
        white[np.sqrt(np.square(white).sum(axis=1)) < DISTINCT * length] = 0.0
        scale = np.where(white.any(axis=1), length, 1.0)[:, None]
        p = np.linalg.lstsq((white / scale).T, left, rcond=EIGEN)[0] / scale[:, 0]
        out = b - p @ common
        if columns.groups:
            # terms that the rows of a session hardly determine are set to zero
            known = inverse_root(columns.own_normal(root**2), DISTINCT**2)
            out -= columns.spread(columns.share(out[None], root**2, known))[0]
        return out, len(groups) + np.count_nonzero(white.any(axis=1))
