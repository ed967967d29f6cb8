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

"""Alternative causes that explain a run as well as the one found, within `SET_WIDTH` of BIC."""

import numpy as np

from .candidate_scores import TIE
from .linear_model import DISTINCT

#: candidates within this BIC of the best cannot be distinguished from it: from 6 on the evidence is
#: "strong" (Kass and Raftery 1995, section 3.2)
SET_WIDTH = 6.0
#: members of scans this much BIC below the set are first refined between their grid points, as the
#: found effect was: on the grid they do not fit best
_NEARLY = 3.0
#: squared cosine above which two groups are the same curve: their difference is then below
#: SET_WIDTH, 0.02 lambda^2 < 6, up to an effect of lambda = 17 times its noise
ALIAS = 0.98


def equal_causes(problem, choice, i, scores):
    """Alternatives to one selected group.

    Parameters
    ----------
    problem : SelectionProblem
    choice : ModelChoice
    i : int
        Index in `choice.chosen`.
    scores : Scores
        Scores of its bank, with the other selected groups in the model.

    Returns
    -------
    gains : ndarray, shape (G,)
        Gain of each candidate in its place; near-equal members of scans at their best place.
    equals : list of int
        Groups of other lines of the ranking within `SET_WIDTH` of the best.
    same : list of int
        Those of `equals` that are the same curve in this run (aliases).
    """
    bank, g = choice.chosen[i].family(problem, choice.chosen)
    every = _refined(problem, g, scores) if choice.chosen[i].plain else scores.delta_bic
    equals, same = _equals(problem, choice, i, bank, g, every), []
    if equals:
        own = scores.basis(g)
        # not those orthogonal to it, such as on the other axis: they explain something else
        equals = [k for k in equals if overlap(own, scores.basis(k))[1] > DISTINCT
                  # nor those of the same driver that contain it and fit no better; the scanned
                  # parameters count as directions
                  and (every[k] > every[g] or bank.effects[k].driver != bank.effects[g].driver
                       or scores.dof[k] <= scores.dof[g] + bank.scan_cost[g]
                       or contained(own, scores.basis(k)) <= ALIAS)]
        same = [k for k in equals if overlap(own, scores.basis(k))[0] > ALIAS]
    return every, equals, same


def overlap(a, b):
    """Overlap of two spans: smallest and largest squared cosine of their principal angles.

    Parameters
    ----------
    a, b : ndarray, shape (d, 2n)
        Orthonormal rows (zero rows are ignored).
    """
    values, (m, k) = _cosines(a, b)
    return (float(values[-1]) if m == k else 0.0, float(values[0])) if m and k else (0.0, 0.0)


def contained(small, large):
    """Smallest squared cosine of a span to a larger one; 0 if that has no more directions.

    Parameters
    ----------
    small, large : ndarray, shape (d, 2n)
        Orthonormal rows (zero rows are ignored).
    """
    values, (m, k) = _cosines(small, large)
    return float(values[-1]) if 0 < m < k else 0.0


def _cosines(a, b):
    """Squared cosines between two spans, largest first, and the number of directions of each."""
    a, b = (one[np.einsum('ij,ij->i', one, one) > 0.5] for one in (a, b))
    return np.square(np.linalg.svd(a @ b.T, compute_uv=False)), (len(a), len(b))


def _refined(problem, g, scores):
    """Gains, (G,), with near-equal members of scans refined to their best place."""
    bank, gains = scores.bank, scores.delta_bic
    out, limit = gains.copy(), gains.max() - SET_WIDTH
    # a line already in the set needs no refinement
    lines = {int(bank.line[g]), *bank.line[gains >= limit].tolist()}
    near = np.flatnonzero((gains < limit) & (gains > max(limit - _NEARLY, 0.0)))
    for k in near[np.argsort(-gains[near], kind='stable')]:
        if bank.effects[k].scan is not None and int(bank.line[k]) not in lines:
            out[k] = max(gains[k], problem.finer(int(k)).score(scores.fit).delta_bic.max())
        lines.add(int(bank.line[k]))
    return out


def _equals(problem, choice, i, bank, g, gains):
    """Groups of other lines that gain as much in place of one selected group."""
    one = choice.chosen[i]
    others = {c.family(problem, choice.chosen)[1] for j, c in enumerate(choice.chosen)
              if j != i and (c.curve, c.period, c.of is None) == (
                  one.curve, one.period, one.of is None)}
    limit, lines, near = gains.max() - SET_WIDTH, {int(bank.line[g])}, []
    # of two names of one curve take the first, whatever the rounding
    for other in np.argsort(-np.round(gains / TIE), kind='stable'):
        if gains[other] < max(limit, 0.0):
            break
        if other != g and other not in others and int(bank.line[other]) not in lines:
            lines.add(int(bank.line[other]))
            near.append(int(other))
    return near
