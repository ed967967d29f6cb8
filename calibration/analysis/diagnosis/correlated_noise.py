"""Rows that resemble their neighbours in time: a zero that wanders beside white noise.

The offsets of an axis are taken as white noise plus a stationary process with the correlation
exp(-dt / tau) (Ornstein and Uhlenbeck; a random walk where tau is far longer than the run). How
large it is and how long it remembers is the maximum of the restricted likelihood (Patterson and
Thompson 1971, Biometrika 58, 545; REML) over a grid. In the order of time, differences
e_i - phi_i e_(i-1) of such rows have a tridiagonal covariance: rows are whitened in O(n).
"""

from dataclasses import dataclass

import numpy as np

from .repeats import repeats

#: between memories that are tried
STEP = 4.0


class Sequence:
    """The order in which rows were observed, and how far apart they are.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Time (s), or the place in the order.
    run : ndarray of int, shape (n,)
        A run remembers nothing of the one before.
    cos_el : ndarray, shape (n,)
        What an angle of the azimuth axis is on the sky.
    timed : bool
        Whether the position is a time.
    group : ndarray of int, shape (n,), optional
        Rows of one star within minutes share a number: what is left out is left out together.
    """

    def __init__(self, position, run, cos_el, timed=True, group=None):
        self.position, self.run, self.cos_el, self.timed = position, run, cos_el, timed
        self.group = np.arange(len(run)) if group is None else group
        self.order = np.lexsort((position, run))
        gap = np.diff(position[self.order], prepend=-np.inf)
        gap[np.diff(run[self.order], prepend=run[self.order[:1]]) != 0] = np.inf
        #: to the row before in `order`; infinite where a run begins
        self.gap = gap

    @classmethod
    def of(cls, context, label):
        """Of the rows of a run.

        Parameters
        ----------
        context : Context
        label : ndarray of int, shape (n,)
            Number of the run of each row.

        Returns
        -------
        Sequence
        """
        time = context.get('time')
        timed = time is not None and np.isfinite(time).all()
        if not timed:
            time = np.arange(len(label), dtype=float)
        return cls(np.asarray(time, float), label, context.trig.cos_el, timed,
                   repeats(context, np.asarray(time, float), label, timed))

    def rows(self, rows):
        """Of some rows (indices)."""
        return Sequence(self.position[rows], self.run[rows], self.cos_el[rows], self.timed,
                        self.group[rows])

    @property
    def span(self):
        """Length of the longest run, in units of the position."""
        ordered, begins = self.position[self.order], np.flatnonzero(np.isinf(self.gap))
        ends = np.append(begins[1:], len(ordered)) - 1
        return float(np.max(ordered[ends] - ordered[begins]))

    def memories(self):
        """Correlation times to be tried, from the shortest gap that counts to far beyond the run.

        Returns
        -------
        ndarray
            Ascending; empty where no row has a row before it.
        """
        gap = self.gap[np.isfinite(self.gap) & (self.gap > 0.0)]
        if not len(gap):
            return gap
        first = np.quantile(gap, 0.1)
        count = int(np.ceil(np.log(4.0 * self.span / first) / np.log(STEP))) + 1
        return first * STEP ** np.arange(max(count, 1))


@dataclass(frozen=True)
class AxisWander:
    """What wanders on an axis.

    Attributes
    ----------
    variance : float
        Of the process, rad^2; 0: the noise is white.
    memory : float
        Correlation time, in units of the sequence's position.
    angle : bool
        It is an angle of the azimuth axis: on the sky it has the factor cos E.
    scale : float
        Of the white noise beside it, as `State.scale`.
    gain : float
        2 ln of the restricted likelihood ratio against white noise alone.
    """

    variance: float = 0.0
    memory: float = np.inf
    angle: bool = False
    scale: float = 1.0
    gain: float = 0.0


class White:
    """Weights alone: noise without memory.

    Parameters
    ----------
    root : ndarray, shape (2n,)
        1 / sigma of each value, 0 for rows set aside.
    """

    def __init__(self, root):
        self.root = root

    def __call__(self, values):
        """Whitened values, shape (..., 2n)."""
        return values * self.root

    def without(self, rows):
        """The same with some rows (indices of n) set aside."""
        return White(_set_aside(self.root, rows))

    def rows(self, rows):
        """Of some rows (indices of n)."""
        return White(self.root.reshape(2, -1)[:, rows].ravel())


class Whitened:
    """Weights, and differences that take out what a row has from the rows before.

    Parameters
    ----------
    root : ndarray, shape (2n,)
        1 / sigma of the white part, 0 for rows set aside.
    sequence : Sequence
    wander : tuple of AxisWander
        Of x and y.
    """

    def __init__(self, root, sequence, wander):
        n = len(root) // 2
        self.root, self._sequence, self._wander = root, sequence, wander
        self._axes = [(part, _Axis(root[part], sequence, one)) for one, part in zip(
            wander, (slice(0, n), slice(n, 2 * n))) if one.variance > 0.0]

    def __call__(self, values):
        """Whitened values, shape (..., 2n): of rows set aside 0."""
        return self._each(values, self.root, _Axis.whitened)

    def spread(self, values):
        """`values` (..., 2n) such that their squares sum to the variance of values @ noise."""
        return self._each(values, self._sigma, _Axis.spread)

    def coloured(self, values):
        """The way back: white noise (..., 2n) as this noise; 0 in rows set aside."""
        return self._each(values, self._sigma, _Axis.coloured)

    @property
    def _sigma(self):
        return 1.0 / np.where(self.root > 0.0, self.root, np.inf)

    def _each(self, values, factor, of_axis):
        out = values * factor
        for part, axis in self._axes:
            here = values[..., part]
            out[..., part] = of_axis(axis, here.reshape(-1, here.shape[-1])).reshape(here.shape)
        return out

    @property
    def log_det(self):
        """Of the covariance of the rows with weight."""
        plain = self.root.copy()
        for part, _ in self._axes:
            plain[part] = 0.0
        return float(-2.0 * np.log(plain[plain > 0.0]).sum()
                     + sum(axis.log_det for _, axis in self._axes))

    def without(self, rows):
        """The same with some rows (indices of n) set aside."""
        return Whitened(_set_aside(self.root, rows), self._sequence, self._wander)

    def rows(self, rows):
        """Of some rows (indices of n)."""
        return Whitened(self.root.reshape(2, -1)[:, rows].ravel(), self._sequence.rows(rows),
                        self._wander)


def _set_aside(root, rows):
    root = root.copy()
    root.reshape(2, -1)[:, rows] = 0.0
    return root


class _Axis:
    """Whitening of one axis, shape (n,) each."""

    def __init__(self, root, sequence, wander):
        self._part, self._n = Part(root, sequence, wander.angle), len(root)
        self._phi = self._part.phi(wander.memory)
        self._diagonal, self._lower = factored(self._phi, self._part.white, wander.variance)

    def whitened(self, values):
        """Values (k, n) whitened."""
        return self._placed(solved(self._phi, self._diagonal, self._lower,
                                    self._part.scaled(values).T))

    def spread(self, values):
        """Inverse of the transposed whitening."""
        u = _bidiagonal(self._back, self._part.unscaled(values[:, self._part.rows]).T, 'T')
        u = np.append(u[:-1] + self._lower[:, None] * u[1:], u[-1:], axis=0)
        return self._placed(u * self._root[:, None])

    def coloured(self, values):
        """Inverse of the whitening."""
        noise = values[:, self._part.rows].T * self._root[:, None]
        noise = np.append(noise[:1], noise[1:] + self._lower[:, None] * noise[:-1], axis=0)
        return self._placed(self._part.unscaled(_bidiagonal(self._back, noise).T).T)

    @property
    def _root(self):
        return np.sqrt(self._diagonal)

    @property
    def _back(self):
        """Band of the differences of neighbours."""
        return np.vstack((np.ones(len(self._phi)), np.append(-self._phi[1:], 0.0)))

    def _placed(self, columns):
        """Columns (m, k) of the rows with weight, as (k, n)."""
        out = np.zeros((columns.shape[1], self._n))
        out[:, self._part.rows] = columns.T
        return out

    @property
    def log_det(self):
        """Of the covariance of the rows with weight."""
        return float(np.log(self._diagonal).sum()) - self._part.log_scale


class Part:
    """The rows with weight of one axis, in order.

    `white` is their variance beside the wander; the factor of this is taken out of all.
    """

    def __init__(self, root, sequence, angle):
        keep = root[sequence.order] > 0.0
        self.rows = sequence.order[keep]
        # over rows that are left out the gaps add up
        since = np.cumsum(np.where(np.isfinite(sequence.gap), sequence.gap, 0.0))[keep]
        gap = np.diff(since, prepend=-np.inf)
        run = sequence.run[self.rows]
        first = np.diff(run, prepend=run[:1]) != 0
        gap[first] = np.inf
        #: where each run begins, and how many of the columns each run fits for itself
        self.starts, self.own = np.append(0, np.flatnonzero(first)), 0
        self.lengths = np.diff(np.append(self.starts, len(run)))
        self.gap = gap
        self._scale = 1.0 / sequence.cos_el[self.rows] if angle else np.ones(len(self.rows))
        self.white = np.square(self._scale / root[self.rows])
        # (of either sign: beyond the pole an angle moves a star the other way)
        self.log_scale = 2.0 * float(np.log(np.abs(self._scale)).sum())

    def phi(self, memory):
        """Correlation with the row before."""
        return np.exp(-self.gap / memory)

    def scaled(self, values):
        """Values (..., n) of these rows in units of the wander."""
        return values[..., self.rows] * self._scale

    def unscaled(self, values):
        """The way back, of values of these rows only."""
        return values / self._scale


def factored(phi, white, variance):
    """LDL^T of the covariance of the differences: D (n,) and the lower diagonal of L (n-1,)."""
    before = np.concatenate(([0.0], white[:-1]))
    diagonal = variance * (1.0 - phi * phi) + white + phi * phi * before
    if len(diagonal) < 2:  # as of `_bidiagonal`
        return diagonal, diagonal[:0]
    from scipy.linalg.lapack import dpttrf  # slow to import
    d, lower, info = dpttrf(diagonal, -phi[1:] * white[:-1])
    if info:
        raise np.linalg.LinAlgError('covariance of a wander is not positive definite')
    return d, lower


def _bidiagonal(band, columns, trans='N'):
    """Solution with a unit lower bidiagonal matrix; (n, k)."""
    if not columns.size:  # LAPACK's routine writes beyond an empty array
        return columns
    from scipy.linalg.lapack import dtbtrs
    return dtbtrs(band, columns, uplo='L', trans=trans, diag='U')[0]


def solved(phi, diagonal, lower, columns):
    """Columns (n, k) of scaled rows, whitened."""
    columns = columns - np.concatenate((np.zeros_like(columns[:1]),
                                        phi[1:, None] * columns[:-1]))
    band = np.vstack((np.ones(len(phi)), np.append(lower, 0.0)))
    out = _bidiagonal(band, columns)
    return out / np.sqrt(diagonal)[:, None]
