"""How much rows resemble their neighbours: what wanders on each axis, by restricted likelihood."""

import numpy as np

from ...estimation.restricted_likelihood import restricted
from .constants import EIGEN
from .correlated_noise import STEP, AxisWander, Part, factored, solved

#: sizes (variance over that of the white noise) that are tried first; then half a step about the
#: best of them and of the memories
_SIZE_STEP = 10.0
_SIZES = _SIZE_STEP ** np.arange(-1.0, 3.0)
_FINER = _SIZE_STEP ** np.arange(-1.5, 3.0, 0.5)
#: half a step of memory and of size about the best
_ABOUT = np.array([(longer, larger) for longer in (-0.5, 0.0, 0.5) for larger in (-0.5, 0.0, 0.5)
                   if longer or larger])
#: numbers in the columns of the tries that are made at a time
_AT_ONCE = 200_000


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
            tried = _at(*prepared, *_grid(sequence.memories(), _FINER), scale[axis], null,
                        wander[axis].angle)
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
    return float(_likelihood(columns / np.sqrt(part.white)[:, None],
                             np.log(part.white).sum() - part.log_scale, part, 1)[0][0])


def _grid(memories, sizes):
    """All pairs, each shape (m s,)."""
    return np.repeat(memories, len(sizes)), np.tile(sizes, len(memories))


def _at(part, columns, memories, sizes, scale, null, angle):
    """`AxisWander` of each memory and size (over the variance of the white noise), in pairs."""
    out, n = [], len(columns)
    step = max(1, _AT_ONCE // max(columns.size, 1))
    typical = sizes * float(np.median(part.white))
    for i in range(0, len(memories), step):
        # the tries are as runs one after the other, that know nothing of each other
        memory, size = memories[i:i + step], typical[i:i + step]
        tries = len(memory)
        phi = np.exp(-part.gap / memory[:, None]).ravel()
        diagonal, lower = factored(phi, np.tile(part.white, tries), np.repeat(size, n))
        white = solved(phi, diagonal, lower, np.tile(columns, (tries, 1)))
        log_det = np.log(diagonal).reshape(tries, n).sum(axis=1) - part.log_scale
        out += [AxisWander(float(s * variance), float(m), angle, scale * float(np.sqrt(variance)),
                           float(null - value)) for m, s, value, variance in zip(
                               memory, size, *_likelihood(white, log_det, part, tries))]
    return out


def _likelihood(white, log_det, part, tries):
    """-2 ln L restricted (but for a constant) of each try, and the variance of its whitened rows.

    What each run fits for itself comes first in the columns: no row of one run has to do with
    those of another, so it is taken out run by run.
    """
    taken, fitted = 0, 0.0
    if part.own:
        n = len(white) // tries
        starts = (part.starts + n * np.arange(tries)[:, None]).ravel()
        own, rest = white[:, :part.own], white[:, part.own:]
        gram = np.add.reduceat(own[:, :, None] * own[:, None, :], starts)
        values, vectors = np.linalg.eigh(gram)
        live = values > EIGEN * np.maximum(values[:, -1:], 1e-300)
        inverse = vectors * np.where(live, 1.0 / np.where(live, values, 1.0), 0.0)[:, None, :]
        p = inverse @ (vectors.transpose(0, 2, 1) @ np.add.reduceat(
            own[:, :, None] * rest[:, None, :], starts))
        taken = live.reshape(tries, -1).sum(axis=1)
        fitted = np.log(np.where(live, values, 1.0)).reshape(tries, -1).sum(axis=1)
        white = rest - np.einsum('nj,njk->nk', own,
                                 np.repeat(p, np.tile(part.lengths, tries), axis=0))
    return restricted(white.reshape(tries, -1, white.shape[1]), log_det + fitted, taken=taken)


def _climb(part, columns, memories, sizes, scale, null, angle, best):
    """The best of a grid, and then of a finer one about it."""
    grid = _grid(memories, sizes)
    tried = _at(part, columns, *grid, scale, null, angle)
    if tried:
        first = int(np.argmax([one.gain for one in tried]))
        if tried[first].gain > 0.0:
            tried += _at(part, columns, grid[0][first] * STEP**_ABOUT[:, 0],
                         grid[1][first] * _SIZE_STEP**_ABOUT[:, 1], scale, null, angle)
    return max([best, *tried], key=lambda one: one.gain)
