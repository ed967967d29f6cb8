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

"""What a diagnosis starts from: usable rows, the base model and its columns, decoder slips."""

import re
from dataclasses import dataclass, replace

import numpy as np

from calibration.analysis.finding import Finding
from calibration.analysis.term_fit import fit_terms
from calibration.estimation.correlated_noise import Sequence
from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.robust import GROSS
from calibration.rows import usable
from msg_tools.units import ARCSEC
from pointing_model import geometry as rotation
from pointing_model.context import Context
from pointing_model.effects import period_of
from pointing_model.effects.base import AXES
from pointing_model.harmonics import basis, sky_factor
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import known_terms, stacked_design
from pointing_model.runs.run import PointingRun

#: rows that are looked at of each run at least, where there are more than are looked at
OF_RUN = 30
_FARTHEST = 30  # bars or lines that a slip goes, at most
_DRAWS = 19999  # outliers anywhere, behind the chance of slips
#: rows of one star: so many rows, seconds and radians apart at most, beside the sky's own turning
_LAGS, _MINUTES, _PLACE, _SIDEREAL = 6, 900.0, 60.0 * ARCSEC, 7.3e-5
_SOON = 60.0  # s between two rows of one star, at most, where rows have no times
_SETS = ('physical', 'standard6', 'index')  # of `mount_kinds.MountKind`


@dataclass(frozen=True)
class Base:
    """The declared model.

    Attributes
    ----------
    terms : tuple of str
    degree : int
        Of the spherical harmonics of paper 000; 0: none.
    own : tuple of str
        Terms that each run fits for itself.
    interpretation : {'zenith', 'printed'}
        What the E of the harmonics is, see `pointing_model.harmonics`.
    """

    terms: tuple
    degree: int = 0
    own: tuple = ()
    interpretation: str = 'zenith'

    @classmethod
    def parse(cls, text, own=(), mount=ALTAZ):
        """From ``physical``, ``standard6``, ``index``, ``sh13``, ``sh1``..``sh4``, names of terms.

        Parameters
        ----------
        text : str
            Parts joined by ``+`` or ``,``. sh13 is sh4: degree 4 has 13 coefficients an axis.
            ``sh4p``: with the paper's E as printed, else it is the zenith distance.
        own : sequence of str
            Terms that each run fits for itself.
        mount : Mount, optional
            Whose terms they are.

        Raises
        ------
        ValueError
            An unknown part.
        """
        terms, degree, interpretation = [], 0, 'zenith'
        for part in re.split(r'[+,\s]+', text.strip()):
            harmonics = re.fullmatch(r'sh(13|[1-4])(p?)', part)
            if harmonics:
                interpretation = 'printed' if harmonics.group(2) else 'zenith'
                degree = 4 if harmonics.group(1) == '13' else int(harmonics.group(1))
            else:
                several = getattr(mount.names, part) if part in _SETS else (part,)
                terms += [t for t in several if t not in terms]
        known_terms(terms, mount)
        known_terms(own, mount)
        return cls(tuple(terms), degree, tuple(own), interpretation)

    @property
    def common(self):
        """Terms that all runs share."""
        return tuple(t for t in self.terms if t not in self.own)

    @property
    def harmonic_count(self):
        """Coefficients of the harmonics an axis."""
        return 3 * self.degree + 1 if self.degree else 0

    def names(self):
        """For people and the result."""
        return [*self.terms, *([self._series] if self.degree else [])]

    @property
    def _series(self):
        return f'sh{self.degree}' + 'p' * (self.interpretation == 'printed')

    def columns(self, context, run=None):
        """First-order columns.

        Parameters
        ----------
        context : Context
        run : ndarray of int, shape (n,), optional
            Needed for `own`.

        Returns
        -------
        GroupColumns
        """
        common = self.common
        az, el, mount = context.az, context.el, context.mount
        rows = [stacked_design(common, az, el, mount)]
        count = self.harmonic_count
        if count:
            functions = basis(az, el, self.interpretation)[:, :count].T
            nothing = np.zeros_like(functions)
            rows += [np.hstack((functions * sky_factor(el, self.interpretation), nothing)),
                     np.hstack((nothing, functions))]
        zeros = [common.index(t) for t in mount.names.index if t in common]
        if not self.own:
            return GroupColumns.alone(np.vstack(rows), zeros)
        return GroupColumns.of(np.tile(run, 2), stacked_design(self.own, az, el, mount),
                               np.vstack(rows), zeros)


@dataclass
class Observations:
    """The usable rows of one or several runs.

    Attributes
    ----------
    run : PointingRun
        All of them, in order.
    encoder : {'enc', 'abs'}
        Its columns that are diagnosed.
    label : ndarray of int, shape (n,)
        Number of the run, 0, 1, ...
    runs : list
        What the numbers stand for.
    context : Context
    observed : ndarray, shape (2n,)
        Offsets, x then y, radians.
    inverse_sigma : ndarray, shape (2n,), or None
    excluded : list of dict
        ``row``, ``reason`` and ``source``: the line in the file, or the row of a run without one.
    notes : list of Finding or str
    lines : ndarray of int, shape (n,)
        Line of each row in its file, or its row in a run without one.
    sources : ndarray of object, shape (n,)
        That file, or None.
    whole : Observations or None
        All usable rows, of which these are a part.
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

    def select(self, rows):
        """Some of them (indices or a slice)."""
        n = len(self)
        where = np.arange(n)[rows]
        both = np.concatenate((where, where + n))
        return Observations(
            self.run.select(rows), self.encoder, self.label[rows], self.runs,
            self.context.select(rows), self.observed[both],
            None if self.inverse_sigma is None else self.inverse_sigma[both], [], [],
            self.lines[rows], self.sources[rows])

    def thinned(self, most, rng):
        """A part of them, spread evenly over each run: one row, drawn, of every so many.

        Parameters
        ----------
        most : int
            Rows, about; runs of fewer than `OF_RUN` are whole.
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
        out = self.select(np.sort(np.concatenate(rows)))
        return replace(out, excluded=self.excluded, notes=self.notes, whole=self)

    def excluding(self, i, reason):
        """Entry of `excluded` for row `i`."""
        return {'row': int(self.lines[i]), 'source': self.sources[i], 'reason': reason}


def mount_of(runs):
    """The mount of a run, or of the first of several."""
    return (runs if isinstance(runs, PointingRun) else runs[0]).mount


def observations(runs, encoder='enc'):
    """Join runs and leave out what cannot be used, with the reason.

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
    names, label = _labels(runs)
    guessed = next((r.meta['equinox_taken'] for r in runs
                    if not r.meta.get('equinox_taken', {}).get('told', True)), None)
    runs = _one_clock(runs, notes)
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
    lines, sources = _places(runs)
    bad = [{'row': int(lines[e['row']]), 'source': sources[e['row']], 'reason': e['reason']}
           for e in good.excluded]
    inverse, rows = None if good.sigmas is None else 1.0 / good.sigmas, good.rows
    if not len(rows):
        raise ValueError(f'none of {len(run)} observations can be used'
                         + (f' (row {bad[0]["row"]}: {bad[0]["reason"]})' if bad else ''))
    # the context first: what a row inherits from the one before is lost with the selection
    context = Context.from_run(run, encoder)
    if bad:
        context, run = context.select(rows), run.select(rows)
    return Observations(run, encoder, label[rows], names, context,
                        np.concatenate(run.offsets(encoder)), inverse, excluded + bad, notes,
                        lines[rows], sources[rows])


def _one_clock(runs, notes):
    """Leave out the times where they count from different starts."""
    clocks = {r.meta.get('time_is_utc', True) for r in runs if 'time' in r}
    if len(clocks) < 2:
        return runs
    notes.append(Finding('two clocks'))
    return [PointingRun({k: v for k, v in r.columns.items() if k != 'time'}, r.meta) for r in runs]


def _places(runs):
    """Line and file of each row of the joined runs."""
    sources = np.array([r.meta.get('source') for r in runs], object)
    return np.concatenate([r.lines for r in runs]), np.repeat(sources, [len(r) for r in runs])


def _labels(runs):
    """Names of the runs, and the number of the run of each row."""
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
    return texts, np.concatenate(labels)


def linearised(obs, base):
    """Start of the exact rotations, and the offsets that they leave.

    Parameters
    ----------
    obs : Observations
    base : Base

    Returns
    -------
    start : dict of str to float
        Coefficients of the geometric terms, radians.
    left : ndarray, shape (2n,)
        Radians.
    feasible : ndarray of bool, shape (n,)
    """
    names = obs.run.mount.names
    geometric = tuple(t for t in base.terms if t in names.terms)
    if not geometric:
        return {}, obs.observed, np.ones(len(obs), bool)
    start = dict.fromkeys(geometric, 0.0)
    try:
        start.update(fit_terms(obs.run, geometric, encoder=obs.encoder).model.terms)
    except ValueError:
        # directions that do not determine the rotations: from the indices alone
        obs.notes.append(Finding('undetermined base'))
        few = tuple(t for t in names.index if t in geometric)
        if few:
            start.update(fit_terms(obs.run, few, encoder=obs.encoder).model.terms)
    left, feasible = after_rotation(obs, start)
    return start, left, feasible


def after_rotation(obs, start):
    """Offsets beyond the exact rotations, shape (2n,), and where the mount can look."""
    x, y = rotation.offsets(obs.context.az, obs.context.el, start, obs.context.mount)
    feasible = np.isfinite(x) & np.isfinite(y)
    left = obs.observed - np.nan_to_num(np.concatenate((x, y)))
    return left, feasible


def decode_slips(obs, fit, alpha):
    """Gross outliers that are whole bars of the disc or lines of the grating off.

    Looked for where the graduation is declared and the encoder's own reading is known. A gross
    outlier can be near a multiple of a line by chance, and the finer the lines the sooner: the
    likelihood ratio of "each other outlier of this axis is a slip" to "they lie anywhere between
    two lines" is compared with what outliers anywhere give. Those that miss count against it.

    Parameters
    ----------
    obs : Observations
    fit : WeightedFit
        Of the base.
    alpha : float
        Chance of any slip among outliers that are none, over all graduations and axes.

    Returns
    -------
    list of (str, str, ndarray of int, ndarray of int, float)
        Axis, graduation, rows (places in `obs`), multiples, chance.
    """
    graduation = obs.context.graduation
    tests = [(kind, axis, i) for kind in ('bars', 'grating') for i, axis in enumerate(AXES)
             if kind in graduation.get(axis, ()) and obs.context.get(f'reading_{axis}') is not None]
    n = len(obs)
    raw = fit.raw.reshape(2, n).copy()
    given = np.ones((2, n)) if obs.inverse_sigma is None else obs.inverse_sigma.reshape(2, n)
    noise = fit.scale[:, None] / given
    gross = np.abs(raw / noise) > GROSS
    raw[0] /= obs.context.trig.cos_el
    noise[0] /= np.abs(obs.context.trig.cos_el)
    noise = np.hypot(noise, 0.2 * ARCSEC)
    out, taken = [], np.zeros((2, n), bool)
    for kind, axis, i in tests:
        period = period_of(kind, graduation[axis][kind])
        multiple = np.rint(raw[i] / period)
        tried = gross[i] & ~taken[i] & (multiple != 0) & (np.abs(multiple) <= _FARTHEST)
        if not tried.any():
            continue
        off = np.abs(raw[i] - multiple * period)
        # a slip of this axis leaves the other one where it was, unless that has slipped too
        clean = ~gross[1 - i] | taken[1 - i]
        chance = min(len(tests) * _chance_of_slips(
            np.where(clean, off, 0.5 * period)[tried], noise[i][tried], period), 1.0)
        hit = tried & clean & (off < np.minimum(4.0 * noise[i], period / 12.0))
        if hit.any() and chance <= alpha:
            taken[i] |= hit
            rows = np.flatnonzero(hit)
            out.append((axis, kind, rows, multiple[rows].astype(int), chance))
    return out


def _chance_of_slips(off, noise, period):
    """How often outliers anywhere between two lines are so near to lines.

    Parameters
    ----------
    off, noise : ndarray, shape (k,)
        Distance from the nearest line, and its standard deviation, radians.
    period : float
    """
    def ratio(distance):
        # of densities, half of the outliers being slips; noise beyond a line tells nothing
        slip = period / (np.sqrt(2.0 * np.pi) * noise) * np.exp(-0.5 * (distance / noise)**2)
        return np.log(0.5 + 0.5 * slip).sum(axis=-1)

    rng = np.random.default_rng(0)  # the same rows give the same chance
    anywhere = rng.uniform(0.0, 0.5 * period, (_DRAWS, len(off)))
    return (int(np.count_nonzero(ratio(anywhere) >= ratio(off))) + 1) / (_DRAWS + 1)


def sequence_of(context, label):
    """The `Sequence` of the rows of a context; `label`: number of the run of each, (n,)."""
    time = context.get('time')
    timed = time is not None and np.isfinite(time).all()
    position = np.asarray(time if timed else np.arange(len(label)), float)
    return Sequence(position, label, context.trig.cos_el, timed,
                    star_groups(context, position, label, timed))


def star_groups(context, position, run, timed):
    """Number of the star of each row; the same again within minutes."""
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


def determined_base(obs, base):
    """The base without the terms that the stars do not determine and that are held at zero.

    Parameters
    ----------
    obs : Observations
    base : Base

    Returns
    -------
    base : Base
    fit : FitResult or None
        That says so; None where nothing is undetermined.
    """
    if base.degree or not base.terms:
        return base, None
    try:
        fit = fit_terms(obs.run, base.terms, encoder=obs.encoder, run_zeros=bool(base.own))
    except ValueError:  # whoever fits them says why
        return base, None
    if not fit.undetermined:
        return base, None
    held = fit.model.held
    return replace(base, terms=tuple(t for t in base.terms if t not in held),
                   own=tuple(t for t in base.own if t not in held)), fit


def with_held_terms(result, fit):
    """A `Diagnosis` whose models have the held terms, and know which are undetermined."""
    for attribute in ('model', 'base_model'):
        model = getattr(result, attribute)
        terms = model.terms | {t: 0.0 for t in fit.model.terms if t not in model.terms}
        covariance = np.zeros((len(terms),) * 2)
        covariance[:len(model.terms), :len(model.terms)] = model.covariance
        setattr(result, attribute, replace(
            model, terms=terms, covariance=covariance, undetermined=fit.model.undetermined,
            directions=fit.model.directions))
    result.notes += [found for found in fit.findings(result.observations.run)
                     if found.kind == 'undetermined terms']
    return result
