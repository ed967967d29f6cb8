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
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calibration.estimation.correlated_noise import EIGEN, WhiteNoise
from calibration.estimation.group_columns import inverse_root
from calibration.estimation.linear_model import DISTINCT, LIVE, weighted_fit
from calibration.estimation.robust import GROSS
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun
from pointing_model.zero import OF_RUNS, PowerOnZero, Zeros

from ..finding import Finding
from ..term_fit import fit_terms, rotation_start
from .base_terms import Base
from .observations import mount_of, observations, run_labels
from .residual_patterns import MOST_ROWS, ResidualRows, step_finding

#: gaps that may end a session, h: a break, the day between two nights, a day without observing
GAPS = (3.0, 6.0, 12.0)
_STEPS = 5  # in a run, at most
#: in the place of hours: sessions begin where places visited again disagree
AT_STEPS = 'steps'
_ROWS = 10000  # that the question is put to, at most
#: what is tried beside the zeros, together: where the camera sits, how the axis leans, how the
#: tube and the axes stand
_MOVING = (('CA',), ('AN', 'AW'), ('TF',), ('NPAE',))
#: stretches that each session is divided in, to leave one out; a shorter session is not compared
_PARTS, _LONG_ENOUGH = 3, 9


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


def median_findings(run, model):
    """That the model has the medians of what each run fits for itself: none of them points by it.

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
    return [Finding('medians of the runs', evidence={
        'runs': count, 'terms': {name: model.terms[name] / ARCSEC for name in own}})]


def with_zeros(model, zeros, before, after):
    """The model with the zeros of the runs of a file, beside its indices.

    Parameters
    ----------
    model : PointingModel
    zeros : iterable of PowerOnZero
    before, after : PointingRun
        As it was read, and with its sessions numbered.

    Returns
    -------
    PointingModel
        As it was where a number would be that of another run, or index terms act on the sky and
        are no zeros of encoders.
    """
    if model.mount.on_sky or 'run' in before and not np.array_equal(before['run'], after['run']):
        return model
    return replace(model, provenance={**model.provenance, OF_RUNS: Zeros(zeros).to_list()})


def with_zeros_of_terms(result, before, after):
    """The model of a diagnosis with the zeros of its runs, where no other term is their own.

    Parameters
    ----------
    result : Diagnosis
    before, after : sequence of PointingRun
        As of `with_zeros`; numbers of several files cannot be distinguished: those carry none.
    """
    index, model, own = result.model.mount.names.index, result.model, result.run_terms
    before = [before] if isinstance(before, PointingRun) else before
    if len(before) > 1 or len(own) < 2 or not set(result.base.own) <= set(index):
        return model
    zeros = [PowerOnZero(*(
        terms[name] * ARCSEC - model.terms[name] if name in terms else 0.0 for name in index
    ), run=float(number)) for number, terms in own.items()]
    return with_zeros(model, zeros, before[0], after[0])


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
    time = np.asarray(run.get('time'), float)
    when = time if np.isfinite(time).all() else np.arange(len(run))
    for _ in range(_STEPS):
        part, own = run if step < 2 else run.select(slice(None, None, step)), 'run' in run
        try:
            fitted = fit_terms(part, terms, encoder=encoder, run_zeros=own)
        except ValueError:  # whoever fits them says why
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
        if label.max() == session_count([run]):  # it is where a session begins anyway
            break
        run = add_note(PointingRun({**run.columns, 'run': label}, run.meta),
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


class SessionTrial:
    """Fits with terms of each session's own, all with the weights of one robust fit.

    A fit that may call rows outliers that another has explained would win by it.

    Parameters
    ----------
    obs : Observations
    base : Base
        Without own terms.
    session : ndarray of int, shape (n,)
        Of each row, where the sessions have the most freedom.
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
        """Score of some sessions, and the own terms that reach it.

        Parameters
        ----------
        session : ndarray of int, shape (n,)
            Of each row.
        own_terms : sequence of str or None
            None: to be chosen.

        Returns
        -------
        tuple
            (BIC, RMS of stretches left out, own terms).
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
        """k ln n - 2 ln L, with noise of its own for each axis, and the RMS of rows left out."""
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
        """What is left of all rows, shape (2n,), and how many coefficients were determined."""
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
            # what the rows of a session hardly determine is taken as zero
            known = inverse_root(columns.own_normal(root**2), DISTINCT**2)
            out -= columns.spread(columns.share(out[None], root**2, known))[0]
        return out, len(groups) + np.count_nonzero(white.any(axis=1))
