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


"""The usable rows of the diagnosed runs, joined, and their order in time."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePath

import numpy as np

from calibration.estimation.correlated_noise import Sequence
from calibration.rows import usable
from msg_tools.units import ARCSEC
from pointing_model.context import Context
from pointing_model.runs.run import PointingRun

from ..finding import Finding

#: fewest rows sampled from each run (all rows of a shorter run)
OF_RUN = 30
#: rows of one star: largest distance in rows, seconds and radians, plus sidereal motion, rad/s
_LAGS, _MINUTES, _PLACE, _SIDEREAL = 6, 900.0, 60.0 * ARCSEC, 7.3e-5
_SOON = 60.0  # s, assumed interval between two rows of one star where rows have no times


@dataclass
class Observations:
    """The usable rows of one or several runs.

    Attributes
    ----------
    run : PointingRun
        All usable rows, in order.
    encoder : {'enc', 'abs'}
        Encoder whose columns are diagnosed.
    label : ndarray of int, shape (n,)
        Run index, 0, 1, ...
    runs : list
        Names of the runs by index.
    context : Context
    observed : ndarray, shape (2n,)
        Offsets, x then y, radians.
    inverse_sigma : ndarray, shape (2n,), or None
    excluded : list of dict
        ``row``, ``reason`` and ``source``: the line in the file, or the row of a run without one.
    notes : list of Finding or str
    lines : ndarray of int, shape (n,)
        Line of each row in its file, or its row in a run without a file.
    sources : ndarray of object, shape (n,)
        File of each row, or None.
    whole : Observations or None
        All usable rows, if these are a sample of them.
    """

    run: PointingRun
    encoder: str
    label: np.ndarray
    runs: list
    context: Context
    observed: np.ndarray
    inverse_sigma: np.ndarray | None
    excluded: list
    notes: list
    lines: np.ndarray
    sources: np.ndarray
    whole: object = None

    def __len__(self):
        return len(self.run)

    @cached_property
    def sequence(self):
        """`Sequence` of the rows."""
        return sequence_of(self.context, self.label)

    @cached_property
    def places(self):
        """Label of each row for users, shape (n,): its line, with the file if there are several."""
        if len(set(self.sources)) < 2:
            return self.lines
        return np.array([f'{PurePath(str(source or "run")).name}:{line}'
                         for source, line in zip(self.sources, self.lines)], object)

    def select(self, rows):
        """Select rows (indices or a slice)."""
        n = len(self)
        where = np.arange(n)[rows]
        both = np.hstack((where, where + n))
        return Observations(
            self.run.select(rows), self.encoder, self.label[rows], self.runs,
            self.context.select(rows), self.observed[both],
            None if self.inverse_sigma is None else self.inverse_sigma[both], [], [],
            self.lines[rows], self.sources[rows])

    def thinned(self, most, rng):
        """A stratified random sample: one row from each of many equal intervals of each run.

        Parameters
        ----------
        most : int
            Approximate number of rows; at least `OF_RUN` are kept of each run.
        rng : numpy.random.Generator

        Returns
        -------
        Observations
        """
        part, rows = most / len(self), []
        for run in range(len(self.runs)):
            own = np.flatnonzero(self.label == run)
            count = min(len(own), max(OF_RUN, round(part * len(own))))
            ends = np.linspace(0, len(own), count + 1).astype(int)
            rows.append(own[rng.integers(ends[:-1], ends[1:])])
        out = self.select(np.sort(np.hstack(rows)))
        return replace(out, excluded=self.excluded, notes=self.notes, whole=self)

    def excluding(self, i, reason):
        """Entry of `excluded` for row `i`."""
        return {'row': int(self.lines[i]), 'source': self.sources[i], 'reason': reason}


def mount_of(runs):
    """The mount of a run, or of the first of several."""
    return (runs if isinstance(runs, PointingRun) else runs[0]).mount


def observations(runs, encoder='enc'):
    """Join runs and exclude unusable rows, with the reason.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
    encoder : {'enc', 'abs'}

    Returns
    -------
    Observations

    Raises
    ------
    ValueError
        No usable row, or no such encoder.
    """
    runs = [runs] if isinstance(runs, PointingRun) else list(runs)
    if not runs:
        raise ValueError('no pointing run to diagnose; give at least one')
    if not all(r.mount.agrees(runs[0].mount) for r in runs[1:]):
        raise ValueError('the runs are of different mounts ('
                         + ', '.join(sorted({r.mount.kind for r in runs}))
                         + '; or of one kind at two latitudes): diagnose each mount alone')
    notes = [note for r in runs for note in r.meta.get('notes', ())]
    excluded = [{**e, 'source': r.meta.get('source')} for r in runs
                for e in r.meta.get('excluded', ())]
    names, label = run_labels(runs)
    guessed = next((r.meta['equinox_taken'] for r in runs
                    if not r.meta.get('equinox_taken', {}).get('told', True)), None)
    runs = _one_clock(runs, notes)
    lines = np.hstack([r.lines for r in runs])
    sources = np.repeat(np.array([r.meta.get('source') for r in runs], object), [*map(len, runs)])
    run = runs[0] if len(runs) == 1 else PointingRun.concatenate(runs)
    lost = sorted({n for r in runs for n in r.columns} - set(run.columns))
    if lost:
        notes.append(Finding('columns of some runs', evidence={'columns': lost}))
    columns = dict(run.columns)
    if len(runs) > 1 or 'run' not in columns or columns['run'].dtype.kind not in 'fiu':
        columns['run'] = label
    columns['row'] = np.arange(len(run))
    run = PointingRun(columns, {**run.meta, 'equinox_taken': guessed} if guessed else run.meta)
    good = usable(run, encoder)
    bad = [{'row': int(lines[e['row']]), 'source': sources[e['row']], 'reason': e['reason']}
           for e in good.excluded]
    inverse, rows = None if good.sigmas is None else 1.0 / good.sigmas, good.rows
    if not len(rows):
        raise ValueError(f'none of {len(run)} observations can be used'
                         + (f' (row {bad[0]["row"]}: {bad[0]["reason"]})' if bad else ''))
    # context before selection: values derived from the previous row would be lost
    context = Context.from_run(run, encoder)
    if bad:
        context, run = context.select(rows), run.select(rows)
    return Observations(run, encoder, label[rows], names, context,
                        np.hstack(run.offsets(encoder)), inverse, excluded + bad, notes,
                        lines[rows], sources[rows])


def run_labels(runs):
    """Names of the runs, list, and the run index of each row, shape (n,)."""
    names, labels = [], []
    for i, r in enumerate(runs):
        own = np.asarray(r['run']) if 'run' in r else np.zeros(len(r))
        for value in np.unique(own):
            names.append((i, value.item()))
        values = np.unique(own)
        labels.append(len(names) - len(values) + np.searchsorted(values, own))
    several = len(runs) > 1
    texts = [f'{runs[i].meta.get("source") or i}:{v:g}' if several and not isinstance(v, str)
             else v for i, v in names]
    return texts, np.hstack(labels)


def run_name(obs, rows):
    """Name of the run of some rows: its file, and its number if the file has several runs.

    Parameters
    ----------
    obs : Observations
    rows : ndarray of bool, shape (n,)

    Returns
    -------
    str
    """
    run = obs.runs[int(obs.label[rows][0])]
    if isinstance(run, str) and ':' in run:
        path, _, number = run.rpartition(':')
        name = PurePath(path).name
        several = sum(isinstance(r, str) and r.rpartition(':')[0] == path for r in obs.runs) > 1
        return f'{name}, run {number}' if several else name
    source = PurePath(str(obs.sources[np.flatnonzero(rows)[0]] or 'run')).name
    return source if len(obs.runs) == 1 else f'{source}, run {run:g}' \
        if isinstance(run, (int, float)) else str(run)


def _one_clock(runs, notes):
    """Drop the times if they count from different epochs."""
    clocks = {r.meta.get('time_is_utc', True) for r in runs if 'time' in r}
    if len(clocks) < 2:
        return runs
    notes.append(Finding('two clocks'))
    return [PointingRun({k: v for k, v in r.columns.items() if k != 'time'}, r.meta) for r in runs]


def sequence_of(context, label):
    """The `Sequence` of the rows of a context; `label`: run index of each row, shape (n,)."""
    time = context.get('time')
    timed = time is not None and np.isfinite(time).all()
    position = np.asarray(time if timed else np.arange(len(label)), float)
    stars = star_groups(context, position, label, timed)
    return Sequence(position, label, context.trig.cos_el, timed, stars)


def star_groups(context, position, run, timed):
    """Star index of each row; rows of one star within minutes share an index."""
    order = np.lexsort((position, run))
    place = context.direction()[:, order]
    position, run = position[order], run[order]
    first = np.arange(len(order))
    for lag in range(1, min(_LAGS, len(order) - 1) + 1):
        passed = position[lag:] - position[:-lag] if timed else np.full(len(order) - lag, _SOON)
        distance = np.linalg.norm(place[:, lag:] - place[:, :-lag], axis=0)
        same = (run[lag:] == run[:-lag]) & (passed < _MINUTES) & (
            distance < _PLACE + _SIDEREAL * passed)
        first[lag:] = np.where(same, np.minimum(first[lag:], first[:-lag]), first[lag:])
    out = np.empty(len(order), int)
    out[order] = first
    return out
