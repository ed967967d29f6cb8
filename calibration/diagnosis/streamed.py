"""Diagnosis of very long runs in chunks: memory does not grow with the number of rows.

The same search on sums: one pass accumulates the normal matrix of base and candidates and the
sums of squares, a second one the variance of each candidate's score with the noise of every row
as it is (what sign flips of the residual pairs would give; of many rows the flipped scores are
Gaussian with that covariance, so they are drawn from it).
"""

from dataclasses import dataclass

import numpy as np

from calibration.fit import fit_terms
from msg_tools.units import ARCSEC
from pointing_model import geometry as rotation
from pointing_model.context import Context
from pointing_model.effects import Effect, dictionary
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.terms import stacked_design

from .base import Base
from .chance import normal_score
from .constants import DISTINCT, SET_WIDTH

_SAMPLE = 5000  # rows of the first fit and of the robust scale
_CUT = 7.0  # rows further out than so many robust standard deviations are set aside
_DRAWS = 1999


@dataclass
class StreamedDiagnosis:
    """Result of `diagnose_streamed`.

    Attributes
    ----------
    model : PointingModel
        Base and effects.
    effects : list of dict
        ``name``, ``p_family``, ``delta_bic``, ``alternatives``.
    rows, set_aside : int
    before_rms_arcsec, after_rms_arcsec : float
        Radial, of the rows that were used.
    """

    model: PointingModel
    effects: list
    rows: int
    set_aside: int
    before_rms_arcsec: float
    after_rms_arcsec: float


def diagnose_streamed(chunks, base='physical', alpha=0.01, *, effects=None, encoder='enc',
                      seed=0, max_effects=20):
    """Search for effects in more rows than fit the memory.

    Least squares with the noise of each axis from a sample of the first chunk; rows beyond 7 of
    its standard deviations from the first fit are set aside. No scans (steps), no curves, no
    cross-validation: with so many rows chance is not what misleads.

    Parameters
    ----------
    chunks : callable
        ``chunks()`` gives an iterator of PointingRun; it is called twice.
    base : str
        Terms, see `diagnosis_base.Base.parse`; no harmonics.
    alpha : float
        Family-wise error.
    effects : list of Effect, optional
        Candidates; by default the dictionary for the first chunk.
    encoder : {'enc', 'abs'}
    seed : int
    max_effects : int

    Returns
    -------
    StreamedDiagnosis

    Raises
    ------
    ValueError
        No row, or a base with harmonics.
    """
    base = Base.parse(base)
    if base.degree:
        raise ValueError('a streamed diagnosis has no harmonics in its base; name terms')
    first = next(iter(chunks()), None)
    if first is None or not len(first):
        raise ValueError('no observation in the stream')
    start, scale = _first_fit(first, base, encoder)
    if effects is None:
        # a chunk does not know when its run began
        effects = [e for e in dictionary(Context.of_run(first, encoder))[0]
                   if e.driver != 'run_hours']
    layout = _Layout(base.terms, effects)
    sums = _Sums(layout)
    for run in chunks():
        sums.add(*_chunk(run, layout, start, scale, encoder))
    steps = _Steps(layout, sums)
    full = steps.everything()
    for run in chunks():
        steps.add_variance(*_chunk(run, layout, start, scale, encoder)[:3], full)
    found = _forward(steps, alpha, np.random.default_rng(seed), max_effects)
    return _result(layout, sums, steps, start, scale, found)


def _first_fit(run, base, encoder):
    sample = run.select(np.linspace(0, len(run) - 1, min(len(run), _SAMPLE)).astype(int))
    fit = fit_terms(sample, base.terms, encoder=encoder)
    ok = np.isfinite(fit.residual_x)
    scale = [1.4826 * float(np.median(np.abs(r[ok]))) for r in (fit.residual_x, fit.residual_y)]
    return fit.model.terms, np.maximum(scale, 1e-9 * ARCSEC)


class _Layout:
    """Which columns act on x, which on y: most act on one axis only."""

    def __init__(self, terms, effects):
        self.terms, self.effects = terms, effects
        self.base = len(terms)
        sizes = [len(e.coefficient_names) for e in effects]
        self.start = self.base + np.concatenate(([0], np.cumsum(sizes)))
        self.size = int(self.start[-1])
        self.groups = [np.arange(i, j) for i, j in zip(self.start[:-1], self.start[1:])]

    def columns(self, context):
        """Shape (size, 2n)."""
        n = len(context)
        out = np.empty((self.size, 2 * n))
        out[:self.base] = stacked_design(self.terms, context.az, context.el)
        for e, g in zip(self.effects, self.groups):
            out[g] = e.columns(context).reshape(len(g), 2 * n)
        return out


def _chunk(run, layout, start, scale, encoder):
    """Whitened columns and offsets beyond the first fit, and how many rows were set aside."""
    context = Context.of_run(run, encoder)
    x, y = run.offsets(encoder)
    turned = {t: v for t, v in start.items() if t in rotation.GEOMETRIC}
    rx, ry = rotation.offsets(context.az, context.el, turned)
    b = np.stack((x - rx, y - ry))
    others = [t for t in layout.terms if t not in turned]
    columns = layout.columns(context)
    n = len(context)
    if others:
        index = [layout.terms.index(t) for t in others]
        b = b - (np.array([start[t] for t in others]) @ columns[index]).reshape(2, n)
    b /= scale[:, None]
    with np.errstate(invalid='ignore'):
        good = np.hypot(*b) < _CUT * np.sqrt(2.0) + 0.0
    columns[:, :n] /= scale[0]
    columns[:, n:] /= scale[1]
    if not good.all():
        both = np.concatenate((good, good))
        columns, b = columns[:, both], b[:, good]
    return columns, b.ravel(), int(good.sum()), n


class _Sums:
    """Normal matrix, right side and sums of squares of both axes."""

    def __init__(self, layout):
        k = layout.size
        self.normal = np.zeros((2, k, k))
        self.right = np.zeros((2, k))
        self.squares = np.zeros(2)
        self.rows = self.given = 0

    def add(self, columns, b, n, given):
        """Take a chunk."""
        for i, part in enumerate((slice(None, n), slice(n, None))):
            acting = np.flatnonzero(columns[:, part].any(axis=1))
            c = columns[acting, part]
            self.normal[i][np.ix_(acting, acting)] += c @ c.T
            self.right[i][acting] += c @ b[part]
            self.squares[i] += b[part] @ b[part]
        self.rows += n
        self.given += given


class _Steps:
    """Fits of subsets of the columns from the sums."""

    def __init__(self, layout, sums):
        self.layout, self.sums = layout, sums
        self.normal, self.right = sums.normal.sum(axis=0), sums.right.sum(axis=0)
        length = np.sqrt(np.maximum(np.diag(self.normal), 1e-300))
        self.length = length
        self.scaled = self.normal / np.outer(length, length)
        self.variance = np.zeros_like(self.normal)

    def fit(self, index):
        """Coefficients of the columns `index`."""
        values, vectors = np.linalg.eigh(self.scaled[np.ix_(index, index)])
        keep = values > 1e-10 * values[-1]
        half = vectors[:, keep] / np.sqrt(values[keep]) / self.length[index][:, None]
        inverse = half @ half.T
        return inverse @ self.right[index], inverse

    def everything(self):
        """Coefficients of all columns together, shape (size,)."""
        return self.fit(np.arange(self.layout.size))[0]

    def add_variance(self, columns, b, n, p):
        """Take a chunk for the variance of the scores, with the residual of the full fit."""
        r = b - p @ columns
        pairs = columns[:, :n] * r[:n] + columns[:, n:] * r[n:]
        self.variance += pairs @ pairs.T

    def rss(self, index, p):
        """Residual sums of squares of x and y."""
        return np.array([s - 2.0 * p @ right[index] + p @ normal[np.ix_(index, index)] @ p
                         for s, right, normal in zip(
                             self.sums.squares, self.sums.right, self.sums.normal)])

    def scores(self, chosen):
        """Of every group beyond the base and the chosen ones.

        Returns
        -------
        delta_bic : ndarray, shape (G,)
        z : ndarray, shape (G,)
        mapping : ndarray, shape (m, size)
            From all scores to the studentised ones of the groups.
        dof : list of int
        """
        layout = self.layout
        index = np.concatenate([np.arange(layout.base), *(layout.groups[g] for g in chosen)])
        p, inverse = self.fit(index)
        rss = self.rss(index, p)
        score = self.right - self.normal[:, index] @ p
        project = np.eye(layout.size)
        project[:, index] -= self.normal[:, index] @ inverse
        n = self.sums.rows
        dbic, z = np.full(len(layout.groups), -np.inf), np.full(len(layout.groups), -np.inf)
        rows, dofs = [], []
        for g, columns in enumerate(layout.groups):
            if g in chosen:
                continue
            d = 1.0 / self.length[columns]
            part = (project[columns] @ self.normal[:, columns]) * np.outer(d, d)
            values, vectors = np.linalg.eigh(0.5 * (part + part.T))
            keep = values > DISTINCT**2
            if not keep.any():
                continue
            u = (vectors[:, keep] / np.sqrt(values[keep])).T * d  # to orthonormal scores
            s = u @ score[columns]
            together = np.concatenate((index, columns))
            q, _ = self.fit(together)
            dbic[g] = n * np.log(rss / self.rss(together, q)).sum() - keep.sum() * np.log(n)
            to = u @ project[columns]
            v = to @ self.variance @ to.T
            w, q = np.linalg.eigh(v)
            whiten = (q / np.sqrt(np.maximum(w, 1e-12 * w[-1]))) @ q.T
            z[g] = normal_score(float(np.square(whiten @ s).sum()), keep.sum(), n)
            rows.append(whiten @ to)
            dofs.append(int(keep.sum()))
        return dbic, z, np.vstack(rows) if rows else np.zeros((0, layout.size)), dofs


def _chance(steps, mapping, dofs, z, rng):
    """Family-wise p: the largest score of Gaussian draws with the variance of the scores."""
    covariance = mapping @ steps.variance @ mapping.T
    values, vectors = np.linalg.eigh(covariance)
    draws = rng.normal(size=(_DRAWS, len(values))) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    gain = np.add.reduceat(np.square(draws), np.cumsum([0, *dofs[:-1]]), axis=1)
    best = normal_score(gain, np.array(dofs), float(steps.sums.rows)).max(axis=1)
    return float((np.sum(best >= z) + 1) / (_DRAWS + 1))


def _forward(steps, alpha, rng, max_effects):
    chosen, lines = [], []
    while len(chosen) < max_effects:
        dbic, z, mapping, dofs = steps.scores(chosen)
        g = int(np.argmax(dbic))
        if not dbic[g] > 0.0:
            break
        p = _chance(steps, mapping, dofs, z[g], rng)
        if p > alpha:
            break
        near = [i for i in np.argsort(-dbic) if i != g and dbic[i] >= dbic[g] - SET_WIDTH]
        names = [e.name for e in steps.layout.effects]
        lines.append({'name': names[g], 'p_family': p, 'delta_bic': float(dbic[g]),
                      'alternatives': [names[i] for i in near]})
        chosen.append(g)
    return chosen, lines


def _result(layout, sums, steps, start, scale, found):
    chosen, lines = found
    base = np.arange(layout.base)
    index = np.concatenate([base, *(layout.groups[g] for g in chosen)])
    before = steps.rss(base, steps.fit(base)[0])
    p, inverse = steps.fit(index)
    after = steps.rss(index, p)
    sigma = np.sqrt(np.diag(inverse))
    terms = {t: start[t] + v for t, v in zip(layout.terms, p)}
    effects, at = [], layout.base
    for g in chosen:
        e: Effect = layout.effects[g]
        d = len(layout.groups[g])
        effects.append(FittedEffect(e, p[at:at + d], sigma[at:at + d]))
        at += d
    k = layout.base
    model = PointingModel(terms, inverse[:k, :k], None,
                          {'method': 'diagnosis, streamed', 'rows': sums.rows}, 'rotation',
                          effects)
    rms = [float(np.sqrt(np.sum(r * scale**2) / max(sums.rows, 1))) / ARCSEC
           for r in (before, after)]
    return StreamedDiagnosis(model, lines, sums.rows, sums.given - sums.rows, *rms)
