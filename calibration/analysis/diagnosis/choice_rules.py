"""The rules by which effects are chosen: the search, the tests of each, rows left out.

The same rules choose in a whole run and in each fold of its cross-validation.
"""

from dataclasses import dataclass, field

import numpy as np

from .constants import LIVE, ROUNDS
from .folds import left_out, radial_arcsec
from .problem import Found
from .search import search
from .significance import standing


@dataclass
class Chosen:
    """A choice that all rules let stand.

    Attributes
    ----------
    found : Found
    stands : list of Standing
    gains : list of float
        What each choice takes off the RMS of rows left out, arcsec: the least of all partitions.
    replaced : bool
        Whether it is the model of a rival, see `rechosen`.
    """

    found: Found
    stands: list = field(default_factory=list)
    gains: list = field(default_factory=list)
    replaced: bool = False


def choose(problem, alpha, chance, partitions=()):
    """Search, and let stand what holds.

    Each choice must be beyond chance with all others in the model, and gain on rows left out, of
    every partition: at random, in stretches of time, or whole runs. What does not is given up,
    and the search goes on without it.

    Parameters
    ----------
    problem : Problem
    alpha : float
        Family-wise error of the first choice of a clean run.
    chance : Chance
    partitions : sequence of list of ndarray of int
        Folds.

    Returns
    -------
    Chosen
    """
    given_up = []
    for _ in range(ROUNDS):
        found = search(problem, alpha, chance, given_up)
        out = settled(problem, found, alpha, chance, partitions)
        lost = [c for c in found.dropped_by_cv if c not in given_up]
        if not lost:
            break
        given_up += lost
    found.dropped_by_cv = list(dict.fromkeys([*given_up, *found.dropped_by_cv]))
    return out


def settled(problem, found, alpha, chance, partitions):
    """Test each choice with all others in the model, and drop until all of them hold.

    Parameters
    ----------
    problem, found, alpha, chance, partitions
        As of `choose`; `found` is changed.

    Returns
    -------
    Chosen
    """
    while True:
        stands = [standing(problem, found, i, chance, alpha) for i in range(len(found.chosen))]
        # an effect stays while it changes: in the middle of the night it may be small
        kept = [c.changes(found.chosen) for c in found.chosen]
        weak = [(s.p, i) for i, s in enumerate(stands)
                if (s.p > alpha or s.delta_bic <= 0.0) and not kept[i]]
        if weak:
            found.dropped.append(found.chosen.pop(max(weak)[1]))
        else:
            gains = np.min([_gains(problem, found, folds) for folds in partitions], axis=0,
                           initial=np.inf) if partitions and found.chosen else []
            if min(gains, default=1.0) > 0.0:
                return Chosen(found, stands, list(gains))
            worst = int(np.argmin(gains))
            found.dropped_by_cv.append(found.chosen[worst])
            found.chosen = found.without(worst)
        found.state = problem.plain.state(found.chosen)


def _gains(problem, found, folds):
    """What each choice takes off the RMS of rows left out, the others being in the model.

    Of an effect of one axis the RMS of that axis counts: what it does there must hold there.

    Returns
    -------
    ndarray, shape (k,)
        arcsec.
    """
    keep = found.state.weights > LIVE
    whole = left_out(problem, found.chosen, found.state, folds)
    out = []
    for i, choice in enumerate(found.chosen):
        others = found.without(i)
        less = left_out(problem, others, found.state, folds)
        axes = {'az': [0], 'el': [1]}.get(choice.effect(problem).axes, [0, 1])
        out.append(radial_arcsec(less[axes], keep) - radial_arcsec(whole[axes], keep))
    return np.array(out)
