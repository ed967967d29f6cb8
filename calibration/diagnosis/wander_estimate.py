"""How much rows resemble their neighbours: what wanders on each axis, by restricted likelihood."""

import numpy as np

from ..restricted import restricted
from .constants import EIGEN
from .wander import STEP, AxisWander, Part, factored, solved

#: sizes (variance over that of the white noise) that are tried first; then half a step about the
#: best of them and of the memories
_SIZE_STEP = 10.0
_SIZES = _SIZE_STEP ** np.arange(-1.0, 3.0)
_FINER = _SIZE_STEP ** np.arange(-1.5, 3.0, 0.5)


def estimate(sequence, root, scale, rows, b, own=None):
    """What wanders on each axis beside white noise, by restricted likelihood.

    Parameters
    ----------
    sequence : Sequence
    root : ndarray, shape (2n,)
        Weights, with all noise taken as white.
    scale : ndarray, shape (2,)
        That noise, as `State.scale`.
    rows : ndarray, shape (k, 2n)
        Design of what is fitted to all rows.
    b : ndarray, shape (2n,)
    own : ndarray, shape (j, 2n), optional
        Of what each run fits for itself.

    Returns
    -------
    tuple of AxisWander
        Of x and y.
    """
    n = len(b) // 2
    memories = sequence.memories()
    own = rows[:0] if own is None else own
    return tuple(
        _estimate_axis(sequence, root[part], scale[axis], rows[:, part], own[:, part], b[part],
                       memories,
                       (False, True) if axis == 0 else (False,))
        for axis, part in enumerate((slice(0, n), slice(n, 2 * n))))


def _estimate_axis(sequence, root, scale, rows, own, b, memories, angles):
    best, null = AxisWander(scale=scale), None
    for angle in angles:
        prepared = _prepared(sequence, root, angle, rows, own, b)
        if prepared is None:
            break
        part, columns = prepared
        if null is None:
            null = _none(part, columns)
            best = _climb(part, columns, memories, _SIZES, scale, null, angle, best)
        elif best.gain > 0.0:
            # nearly the same curve: near the best of the other
            size = best.variance / (best.scale / scale)**2 / float(np.median(part.white))
            best = _climb(part, columns, [best.memory], [size], scale, null, angle, best)
    return best


def likely(sequence, root, wander, scale, rows, b, own=None):
    """What may wander on each axis, and how likely it is: the estimate alone claims too much.

    Half of the prior is that nothing does, the other half is even over the logarithms of memory
    and size.

    Parameters
    ----------
    sequence, root, scale, rows, b, own
        As of `estimate`.
    wander : tuple of AxisWander
        The estimate.

    Returns
    -------
    list of (list of AxisWander, ndarray)
        Of x and y: wanders, the first of them none, and their chances.
    """
    n, out = len(b) // 2, []
    own = rows[:0] if own is None else own
    for axis, part in enumerate((slice(0, n), slice(n, 2 * n))):
        tried = []
        prepared = _prepared(sequence, root[part], wander[axis].angle, rows[:, part],
                             own[:, part], b[part])
        if prepared is not None:
            null = _none(*prepared)
            tried = [_at(*prepared, memory, size, scale[axis], null, wander[axis].angle)
                     for memory in sequence.memories() for size in _FINER]
        every = [AxisWander(scale=scale[axis]), *tried]
        gain = np.array([one.gain for one in every])
        chance = np.exp(0.5 * (gain - gain.max()))
        chance[1:] /= max(len(tried), 1)
        out.append((every, chance / chance.sum()))
    return out


def _prepared(sequence, root, angle, rows, own, b):
    """The rows with weight of an axis, and its columns in their units; None if there are few."""
    rows = rows[np.abs(rows).max(axis=1, initial=0.0) > 0.0]
    own = own[np.abs(own).max(axis=1, initial=0.0) > 0.0]
    part = Part(root, sequence, angle)
    columns = part.scaled(np.vstack((own, rows, b))).T
    part.own = len(own)
    few = len(columns) < len(rows) + len(own) * len(part.starts) + 3
    return None if few else (part, columns)


def _none(part, columns):
    """-2 ln L if nothing wanders."""
    return _likelihood(columns / np.sqrt(part.white)[:, None],
                       float(np.log(part.white).sum()) - part.log_scale, part)[0]


def _at(part, columns, memory, size, scale, null, angle):
    """`AxisWander` of one memory and one size (over the variance of the white noise)."""
    typical = size * float(np.median(part.white))
    phi = part.phi(memory)
    diagonal, lower = factored(phi, part.white, typical)
    value, variance = _likelihood(solved(phi, diagonal, lower, columns),
                                  float(np.log(diagonal).sum()) - part.log_scale, part)
    return AxisWander(typical * variance, memory, angle, scale * np.sqrt(variance), null - value)


def _likelihood(white, log_det, part):
    """-2 ln L restricted (but for a constant), and the variance of the whitened rows.

    What each run fits for itself comes first in the columns: no row of one run has to do with
    those of another, so it is taken out run by run.
    """
    taken, fitted = 0, 0.0
    if part.own:
        own, rest = white[:, :part.own], white[:, part.own:]
        gram = np.add.reduceat(own[:, :, None] * own[:, None, :], part.starts)
        values, vectors = np.linalg.eigh(gram)
        live = values > EIGEN * np.maximum(values[:, -1:], 1e-300)
        inverse = vectors * np.where(live, 1.0 / np.where(live, values, 1.0), 0.0)[:, None, :]
        p = inverse @ (vectors.transpose(0, 2, 1) @ np.add.reduceat(
            own[:, :, None] * rest[:, None, :], part.starts))
        taken, fitted = int(live.sum()), float(np.log(values[live]).sum())
        white = rest - np.einsum('nj,njk->nk', own, np.repeat(p, part.lengths, axis=0))
    return restricted(white, log_det + fitted, taken=taken)


def _climb(part, columns, memories, sizes, scale, null, angle, best):
    """The best of a grid, and then of a finer one about it."""
    tried = []

    def at(memory, size):
        nonlocal best
        one = _at(part, columns, memory, size, scale, null, angle)
        tried.append((one.gain, memory, size))
        if one.gain > best.gain:
            best = one

    for memory in memories:
        for size in sizes:
            at(memory, size)
    if tried and max(tried)[0] > 0.0:
        _, memory, size = max(tried)
        for longer in (-0.5, 0.0, 0.5):
            for larger in (-0.5, 0.0, 0.5):
                if longer or larger:
                    at(memory * STEP**longer, size * _SIZE_STEP**larger)
    return best
