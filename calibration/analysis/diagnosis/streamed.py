"""Diagnosis of very long runs from sums over chunks: memory hardly grows with the rows.

The same search on sums: one pass accumulates the normal matrix of base and candidates and the
sums of squares, a second one the variance of each candidate's score with the noise of every row
as it is (what sign flips of the residual pairs would give; of many rows the flipped scores are
Gaussian with that covariance, so they are drawn from it).
"""

import numpy as np

from calibration.estimation.robust import GROSS
from msg_tools.units import ARCSEC
from pointing_model.effects import dictionary

from .chance import normal_score
from .constants import ALIAS, DISTINCT, EIGEN, FLIPS, MOST_EFFECTS
from .diagnosis_base import after_rotation, linearised
from .diagnosis_result import concluded, diagnosed, hidden, lines_of, ranking_of
from .linear_model import fit_state
from .scores import agrees
from .working_run import Fitted, made_model

_CHUNK = 10000  # rows
_SAMPLE = 5000  # rows of the first fit and of the robust scale
_OF_RUN = 30  # of these at least from each run
_OWN = 300  # terms of single runs, at most: each is a row and a column of the normal matrix
_NOTE = ('{} rows are more than {}: the diagnosis went through them in chunks. So it tried no '
         'steps at unknown times and no curves, looked for no whole bars or lines among the '
         'outliers, and did not cross-validate; --holdout judges it')


def diagnose_streamed(obs, base, alpha, rng, limit):
    """Search for effects in more rows than the search in memory can take.

    Least squares with the noise of each axis from a sample; rows beyond 7 of its standard
    deviations from the first fit are set aside.

    Parameters
    ----------
    obs : Observations
    base : Base
    alpha : float
        Family-wise error.
    rng : numpy.random.Generator
    limit : int
        Rows from which this way is taken, for the note.

    Returns
    -------
    Diagnosis
        ``cv_rms_arcsec`` is None, ``next_observations`` and ``cv_contiguous`` are empty.

    Raises
    ------
    ValueError
        Too many runs with terms of their own.
    """
    runs = np.unique(obs.label)
    if len(base.own) * len(runs) > _OWN:
        raise ValueError(f'{len(obs)} rows are too many to fit {", ".join(base.own)} in each of '
                         f'{len(runs)} runs; diagnose fewer runs, or none with terms of its own '
                         "(--own '')")
    effects, untestable = dictionary(
        obs.context, [t for t in obs.run.mount.names.physical if t not in base.terms], base.own)
    effects = [e for e in effects if e.form != 'run_zero' or not base.own]
    data = _Data(obs, base, runs, effects)
    sums = data.sums()
    for columns, b in data.chunks():
        sums.add_variance(columns, b)
    chosen, first = _search(sums, alpha, rng)
    stands = _settle(sums, chosen, alpha, rng)
    fits = data.exact_fit([]), data.exact_fit(chosen)
    made = (made_model(obs, base, fits[0], []),
            made_model(obs, base, fits[1], [effects[g] for g in chosen]))
    found = [_diagnosed(sums, g, s, fitted, obs)
             for g, s, fitted in zip(chosen, stands, made[1][0].effects)]
    ranking = ranking_of(effects, first.delta_bic, first.p_of(first.z, rng))
    return concluded(
        obs, base, fits, made, found, data.weights, len(fits[1].p),
        f'outlier: more than {GROSS:g} times the noise from the base', ranking,
        untestable + hidden(effects, first.dof), [*obs.notes, _NOTE.format(len(obs), limit)])


class _Data:
    """The rows in chunks, beyond a first robust fit of a sample, in units of its noise.

    Columns are the base's common ones, those of each run, and the candidates.
    """

    def __init__(self, obs, base, runs, effects):
        self.obs, self.base, self.runs, self.effects = obs, base, runs, effects
        each = max(_OF_RUN, _SAMPLE // len(runs))
        rows = [np.flatnonzero(obs.label == r) for r in runs]
        sample = obs.select(np.concatenate([
            k[np.linspace(0, len(k) - 1, min(len(k), each)).astype(int)] for k in rows]))
        self.start, left, _ = linearised(sample, base)
        columns = base.columns(sample.context, sample.label)
        state = fit_state(columns, left, sample.inverse_sigma, final=True)
        self.scale = state.scale
        self._first = np.concatenate([p.ravel() for p in columns.solver(state.white)(left)])
        obs.notes += [note for note in sample.notes if note not in obs.notes]
        self.weights = np.ones(len(obs))

        self.common = [t for t in base.terms if t not in base.own]

    def layout(self, effects):
        """Places of the base's columns, and of each effect's; those of single runs come last."""
        first = len(self.common) + 2 * self.base.harmonic_count
        ends = first + np.cumsum([0, *(len(e.coefficient_names) for e in effects)])
        own = ends[-1] + np.arange(len(self.base.own) * len(self.runs))
        return (np.concatenate((np.arange(first), own)),
                [np.arange(i, j) for i, j in zip(ends[:-1], ends[1:])])

    def _chunk(self, rows, start, effects):
        """Columns of some rows, what the rotations leave, and weights of the values (roots)."""
        part = self.obs.select(rows)
        n = len(part)
        columns = self.base.columns(part.context, part.label)
        base, groups = self.layout(effects)
        out = np.zeros((len(base) + sum(map(len, groups)), 2 * n))
        at = len(columns.common)
        out[:at] = columns.common
        for e in effects:
            k = len(e.coefficient_names)
            out[at:at + k] = e.columns(part.context).reshape(k, 2 * n)
            at += k
        for r in self.runs if columns.own is not None else ():
            here = np.tile(part.label == r, 2)
            out[at:at + len(columns.own), here] = columns.own[:, here]
            at += len(columns.own)
        given = 1.0 if part.inverse_sigma is None else part.inverse_sigma
        return out, after_rotation(part, start)[0], given / np.repeat(self.scale, n)

    def _rows(self):
        for i in range(0, len(self.obs), _CHUNK):
            yield slice(i, min(i + _CHUNK, len(self.obs)))

    def chunks(self):
        """Whitened columns and offsets beyond the first fit, without what was set aside."""
        base, _ = self.layout(self.effects)
        for rows in self._rows():
            columns, left, root = self._chunk(rows, self.start, self.effects)
            b = (left - self._first @ columns[base]) * root
            good = np.hypot(*b.reshape(2, -1)) < GROSS
            self.weights[rows] = good
            both = np.concatenate((good, good))
            columns *= root
            yield (columns, b) if good.all() else (columns[:, both], b[both])

    def sums(self):
        """The normal matrix of everything."""
        return _Sums(self.effects, *self.layout(self.effects), self.chunks())

    def exact_fit(self, chosen):
        """Exact rotations with the effects, as `Work.fit`."""
        effects = [self.effects[g] for g in chosen]
        common, start = self.common, dict(self.start)
        geometric = [i for i, t in enumerate(common) if t in start]

        def whitened():
            for rows in self._rows():
                columns, left, root = self._chunk(rows, start, effects)
                root = root * np.tile(self.weights[rows], 2)
                columns *= root
                yield columns, left * root

        for _ in range(4):
            p, inverse = _Sums(effects, *self.layout(effects), whitened()).balanced()
            # what the first order leaves of such a step
            if not geometric or np.square(p[geometric]).max() < 1e-5 * ARCSEC:
                break
            for i in geometric:
                start[common[i]] += p[i]
        residual = np.empty((2, len(self.obs)))
        for rows in self._rows():
            columns, left, _ = self._chunk(rows, start, effects)
            residual[:, rows] = (left - p @ columns).reshape(2, -1)
        p[geometric] += [start[common[i]] for i in geometric]
        return Fitted(p, inverse, start, residual, common)


def _inverse(normal, length):
    """Inverse of a normal matrix, in the directions that the rows determine."""
    values, vectors = np.linalg.eigh(normal / np.outer(length, length))
    keep = values > EIGEN * values[-1]
    half = vectors[:, keep] / np.sqrt(values[keep]) / length[:, None]
    return half @ half.T


class _Sums:
    """Normal matrix, right side and sums of squares of both axes; fits of subsets from them."""

    def __init__(self, effects, base, groups, chunks):
        self.effects, self.base, self.groups = effects, base, groups
        self.size = len(base) + sum(map(len, groups))
        self._normals = np.zeros((2, self.size, self.size))
        self._rights, self._squares, self.rows = np.zeros((2, self.size)), np.zeros(2), 0
        for columns, b in chunks:
            n = len(b) // 2
            for i, part in enumerate((slice(None, n), slice(n, None))):
                # most columns act on one axis only, those of a run in few chunks
                acting = np.flatnonzero(columns[:, part].any(axis=1))
                c = columns[acting, part]
                self._normals[i][np.ix_(acting, acting)] += c @ c.T
                self._rights[i][acting] += c @ b[part]
                self._squares[i] += b[part] @ b[part]
            self.rows += n
        self._normal, self._right = self._normals.sum(axis=0), self._rights.sum(axis=0)
        self._length = np.sqrt(np.maximum(np.diag(self._normal), 1e-300))
        self._variance = np.zeros_like(self._normal)
        self._everything = self._fit(np.arange(self.size))[0]

    def _fit(self, index):
        """Coefficients of the columns `index`, and the inverse of their normal matrix."""
        inverse = _inverse(self._normal[np.ix_(index, index)], self._length[index])
        return inverse @ self._right[index], inverse

    def balanced(self):
        """Coefficients of all columns and their covariance, each axis with its own noise."""
        each = np.ones(2)
        for _ in range(3):
            normal = np.tensordot(each, self._normals, 1)
            inverse = _inverse(normal, np.sqrt(np.maximum(np.diag(normal), 1e-300)))
            p = inverse @ (each @ self._rights)
            free = max(self.rows - 0.5 * self.size, 1.0)
            each = free / np.maximum(self._rss(np.arange(self.size), p), 1e-300)
        return p, inverse

    def add_variance(self, columns, b):
        """Take a chunk for the variance of the scores, with the residual of the full fit."""
        n, r = len(b) // 2, b - self._everything @ columns
        pairs = columns[:, :n] * r[:n] + columns[:, n:] * r[n:]
        self._variance += pairs @ pairs.T

    def _rss(self, index, p):
        """Residual sums of squares of x and y."""
        return np.array([s - 2.0 * p @ right[index] + p @ normal[np.ix_(index, index)] @ p
                         for s, right, normal in zip(self._squares, self._rights, self._normals)])

    def scores(self, chosen):
        """Of every group beyond the base and the chosen ones.

        Returns
        -------
        _Scores
        """
        index = np.concatenate([self.base, *(self.groups[g] for g in chosen)])
        p, inverse = self._fit(index)
        rss = self._rss(index, p)
        score = self._right - self._normal[:, index] @ p
        project = np.eye(self.size)
        project[:, index] -= self._normal[:, index] @ inverse
        n, count = self.rows, len(self.groups)
        out = _Scores(np.full(count, -np.inf), np.full(count, -np.inf), np.zeros(count, int),
                      {}, project @ self._normal, project @ self._variance @ project.T, n)
        for g, columns in enumerate(self.groups):
            if g in chosen:
                out.dof[g] = -1  # in the model
                continue
            d = 1.0 / self._length[columns]
            part = out.left[np.ix_(columns, columns)] * np.outer(d, d)
            values, vectors = np.linalg.eigh(0.5 * (part + part.T))
            keep = values > DISTINCT**2
            if not keep.any():
                continue
            u = (vectors[:, keep] / np.sqrt(values[keep])).T * d  # to orthonormal scores
            together = np.concatenate((index, columns))
            q, beside = self._fit(together)
            e = self.effects[g]
            out.dof[g] = keep.sum()
            out.delta_bic[g] = n * np.log(rss / self._rss(together, q)).sum() - np.log(n) * (
                keep.sum() + (0 if e.scan is None else e.scanned))
            new, noise = slice(len(index), None), self._rss(together, q).sum() / max(
                2 * n - len(together), 1)
            if e.size is not None and not agrees(e.size, q[new], beside[new, new] * noise):
                out.delta_bic[g] = -np.inf
            w, q = np.linalg.eigh(u @ out.variance[np.ix_(columns, columns)] @ u.T)
            whiten = (q / np.sqrt(np.maximum(w, 1e-12 * w[-1]))) @ q.T
            out.z[g] = normal_score(float(np.square(whiten @ (u @ score[columns])).sum()),
                                    keep.sum(), n)
            out.to[g] = columns, u, whiten @ u
        return out


class _Scores:
    """Of all groups beyond one model: `delta_bic`, `z` and `dof` (-1: in the model), shape (G,)."""

    def __init__(self, delta_bic, z, dof, to, left, variance, n):
        self.delta_bic, self.z, self.dof = delta_bic, z, dof
        self.to, self.left, self.variance, self._n = to, left, variance, n

    def p_of(self, z, rng):
        """Family-wise p of scores: the largest of Gaussian draws with the variance of all."""
        if not self.to:
            return np.ones_like(z)
        groups = sorted(self.to)
        mapping = np.zeros((sum(self.dof[g] for g in groups), len(self.left)))
        dofs, at = self.dof[groups], 0
        for g in groups:
            columns, _, whiten = self.to[g]
            mapping[at:at + self.dof[g], columns] = whiten
            at += self.dof[g]
        values, vectors = np.linalg.eigh(mapping @ self.variance @ mapping.T)
        draws = rng.normal(size=(FLIPS, len(values))) * np.sqrt(np.maximum(values, 0.0)) \
            @ vectors.T
        gain = np.add.reduceat(np.square(draws), np.cumsum([0, *dofs[:-1]]), axis=1)
        best = np.sort(normal_score(gain, dofs, float(self._n)).max(axis=1))
        return (len(best) - np.searchsorted(best, z, side='left') + 1.0) / (len(best) + 1.0)

    def alias(self, a, b):
        """Whether two groups are the same curve in these rows."""
        (ca, ua, _), (cb, ub, _) = self.to[a], self.to[b]
        cosines = np.linalg.svd(ua @ self.left[np.ix_(ca, cb)] @ ub.T, compute_uv=False)
        return len(ua) == len(ub) and bool(cosines[-1]**2 > ALIAS)


def _search(sums, alpha, rng):
    """Add groups while the best is beyond chance.

    Returns
    -------
    chosen : list of int
    first : _Scores
        On what the base leaves.
    """
    chosen, first = [], sums.scores([])
    scores = first
    while sums.effects and len(chosen) < MOST_EFFECTS:
        g = int(np.argmax(scores.delta_bic))
        if not scores.delta_bic[g] > 0.0 or scores.p_of(scores.z[g], rng) > alpha:
            break
        chosen.append(g)
        scores = sums.scores(chosen)
    return chosen, first


def _settle(sums, chosen, alpha, rng):
    """Test each choice with all others in the model; drop until all of them hold.

    Returns
    -------
    list of (float, _Scores)
        p, and the scores without it.
    """
    while True:
        stands = []
        for g in chosen:
            scores = sums.scores([c for c in chosen if c != g])
            stands.append((float(scores.p_of(scores.z[g], rng)), scores))
        weak = [(p, i) for i, (p, s) in enumerate(stands)
                if p > alpha or s.delta_bic[chosen[i]] <= 0.0]
        if not weak:
            return stands
        chosen.pop(max(weak)[1])


def _diagnosed(sums, g, stand, fitted, obs):
    p, scores = stand
    effect, effects = sums.effects[g], sums.effects
    near = [line['group'] for line in lines_of(effects, scores.delta_bic)
            if line['in_set'] and effects[line['group']].line != effect.line]
    same = [k for k in near if scores.alias(g, k)]
    return diagnosed(fitted, p, effect.columns(obs.context), effects, scores.delta_bic, g, near,
                     same)
