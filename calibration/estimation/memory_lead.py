"""Is a group of columns likelier than noise that remembers? Two models of one run, by likelihood.

The tests of `memory_test` ask whether a group is beyond the noise that was estimated without it,
which has swallowed most of what goes slowly or happens at once. Here the two explanations are
compared: the group beside noise without memory, and noise with memory alone, both at their best.
A slip leaves white noise on either side of it, a zero that wanders does not; and a temperature
bends where the air does.
"""

import numpy as np

from .linear_model import LIVE

#: moments beside the one that is asked for: a zero that has slipped once may slip again
_MORE_MOMENTS = 3
#: numbers that a memory has: its length and its size
_OF_MEMORY = 2


def lead_over_memory(problem, fit, memory, bank, g, rows=1.0):
    """2 ln of the likelihood ratio of a group to noise with memory, each number paid by ln n.

    Of a scan the member that fits best counts, also between those that are tried; of one of moments
    (``at``) further ones on the same axis may stand beside it, each at its price.

    Parameters
    ----------
    problem : SelectionProblem
    fit : WeightedFit
        Without the group, and without memory.
    memory : tuple of AxisNoise
        That its noise has, by restricted likelihood.
    bank : CandidateBank
    g : int
    rows : float
        Part of the rows that the memory was estimated from.

    Returns
    -------
    float
        Negative where memory is the likelier explanation.
    """
    live = max(np.count_nonzero(fit.weights > LIVE), 2)
    price, effect = np.log(live), bank.effects[g]
    acts = np.abs(bank.of(g)).reshape(-1, 2, fit.n).max(axis=(0, 2)) > 0.0
    gain, left = _best(fit, problem.finer(g) if bank is problem.dictionary else bank.only([g]),
                       fit.residual, acts, live)
    numbers = len(bank.of(g)) + bank.scan_cost[g]
    if effect.searched == ('at',):
        scan = bank.only(np.flatnonzero(bank.line == bank.line[g]))
        for _ in range(_MORE_MOMENTS):
            more, rest = _best(fit, scan, left, acts, live)
            if more <= _OF_MEMORY * numbers * price:
                break
            gain, left, numbers = gain + more, rest, numbers + 1 + bank.scan_cost[g]
    of = [one for one, on in zip(memory, acts) if on and one.variance > 0.0]
    against = rows * sum(one.gain for one in of)
    return float(gain - against - max(numbers - _OF_MEMORY * len(of), 0) * price)


def _best(fit, bank, residual, acts, live):
    """Largest gain of a group on the axes where it acts, and what it leaves of whitened rows."""
    before = np.square(residual.reshape(2, -1)).sum(axis=1) + 1e-30
    gain, left = -np.inf, residual
    for _, basis, dof in bank.bases(fit):
        rest = residual - np.einsum('gdi,gd->gi', basis, basis @ residual)
        after = np.square(rest.reshape(len(rest), 2, -1)).sum(axis=2) + 1e-30
        gains = np.where(dof > 0, live * (np.log(before / after) * acts).sum(axis=1), -np.inf)
        k = int(np.argmax(gains))
        if gains[k] > gain:
            gain, left = float(gains[k]), rest[k]
    return gain, left
