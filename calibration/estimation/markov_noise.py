"""Noise of which each row has a part of the row before, and a walk that adds to it."""

import numpy as np

from .correlated_noise import AxisLikelihood, AxisNoise, CorrelatedNoise, Sequence

#: correlations with the row before that `neighbour_noise` tries
_CORRELATIONS = np.arange(0.05, 0.96, 0.05)
#: 2 ln of the likelihood ratio from which rows are correlated (5 %, one-sided), and within which a
#: correlation is one of the 90 % that are likeliest
_CLAIMED = 2.71
#: a memory that ends with no run, in its length; variances that a random walk adds in a row that
#: are tried, over that of the white noise
_ENDLESS, _WALKS = 1e4, np.geomspace(1e-4, 1e3, 57)
#: 1 sigma of the white noise beside a process that is to be all the noise
_NO_WHITE = 1e-5


def neighbour_noise(design, y, run, most=1.0):
    """Noise of which each row has a part of the row before, whatever the time between them: AR(1).

    Its correlation is, of those that are likely, the largest: what it is estimated beside was
    chosen because it takes some of it away. What cannot be told from white noise counts as white.

    Parameters
    ----------
    design : GroupColumns
        All that is fitted. The rows of a run are of one group.
    y : ndarray, shape (axes * n,)
        Without outliers.
    run : ndarray, shape (n,)
        Of rows in order: the first row of one has no row before it.
    most : float
        Correlation at most.

    Returns
    -------
    CorrelatedNoise
        Of variance 1; of each axis by itself.
    """
    n, axes = len(run), max(len(y) // max(len(run), 1), 1)
    sequence = Sequence(np.arange(float(n)), run, np.ones(n))
    memories, out = -1.0 / np.log(_CORRELATIONS[most + 1e-9 > _CORRELATIONS]), []
    for axis in range(axes):
        likelihood = AxisLikelihood(sequence, axis, False, np.ones(len(y)), np.ones(axes),
                                     design.rest.T, y, design.own[None])
        gain = np.zeros(1) if likelihood.few else np.array([one.gain for one in likelihood.at(
            memories, np.full(len(memories), _NO_WHITE**-2))])
        best = float(gain.max())
        likely = memories[np.flatnonzero(gain > best - _CLAIMED)[-1]]
        out.append(AxisNoise(1.0, float(likely), gain=best) if best > _CLAIMED else AxisNoise())
    white = [_NO_WHITE if one.variance > 0.0 else 1.0 for one in out]
    return CorrelatedNoise(np.repeat(1.0 / np.array(white), n), sequence, tuple(out))


def random_walk(design, y, position, run):
    """White noise and a random walk along the position, by restricted likelihood.

    Parameters
    ----------
    design, y, run
        As of `neighbour_noise`, of one axis.
    position : ndarray, shape (n,)
        Rising; of the unit that a row takes usually.

    Returns
    -------
    CorrelatedNoise
        Of no variance where white noise is as likely.
    """
    n = len(y)
    sequence = Sequence(position, run, np.ones(n))
    likelihood = AxisLikelihood(sequence, 0, False, np.ones(n), np.ones(1), design.rest.T, y,
                                 design.own[None])
    memory, best = _ENDLESS * max(sequence.span, 1.0), AxisNoise()
    if not likelihood.few:
        best = max([best, *likelihood.at(np.full(len(_WALKS), memory), _WALKS * memory / 2.0)],
                   key=lambda one: one.gain)
    return CorrelatedNoise(np.full(n, 1.0 / best.scale), sequence, (best,))
