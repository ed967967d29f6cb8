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

"""Detection limits: the smallest effects that these observations would have shown.

"Nothing found" means little without a detection limit. It follows from the directions, the times
and the noise of a run: an effect of amplitude a has the noncentrality lambda = a |(1 - P) s| /
sigma, where (1 - P) s is its unit signal beyond what the model fits. It is found if its score, a
noncentral F, exceeds the largest score of all candidates by chance.
"""

import numpy as np

from calibration.estimation.chance import ChanceTest, normal_score
from calibration.estimation.false_alarms import SHARES
from calibration.estimation.linear_model import LIVE
from msg_tools.units import ARCSEC
from pointing_model.mount_kinds import KINDS

#: probability of detecting an effect of the reported size
POWER = 0.9


def _of_axes(first, second):
    """Effects with a reported limit: name, amplitude / norm of the coefficients, unit."""
    return (
        (f'{first}_encoder_1', 1.0, 'arcsec'), ('line_of_sight_2', 1.0, 'arcsec'),
        (f'{second}_nod_2', 1.0, 'arcsec'), ('refraction', 1.0, 'arcsec'),
        *((f'{axis}_zero_with_{driver}', 1.0, f'arcsec{unit}')
          for driver, unit in (('time', '/h'), ('run_hours', '/h'), ('order', '/run'))
          for axis in (first, second)),
        # the coefficient is half the difference of both sides
        (f'{first}_hysteresis_cosE', 2.0, 'arcsec'), (f'{second}_hysteresis', 2.0, 'arcsec'),
        (f'{first}_encoder_2', 1.0, 'arcsec'), (f'{second}_encoder_2', 1.0, 'arcsec'),
        *((f'{axis}_zero_with_temperature', 1.0, 'arcsec/K') for axis in (first, second)))


#: effects of all kinds of mounts, distinguished by the names of the axes
_ROWS = dict.fromkeys(row for names in KINDS.values() for row in _of_axes(*names.keys))
#: phases of effects with two columns (cosine and sine), shape (k, 2)
_PHASES = np.array([[np.cos(a), np.sin(a)] for a in (np.arange(48) + 0.5) * np.pi / 48])
_SURE = 1e4  # lambda^2 above which detection is certain


def detectable(problem, chance, alpha):
    """Amplitudes that a run detects with 90 % probability, averaged over phase and sign.

    Parameters
    ----------
    problem : SelectionProblem
        The base alone is fitted, without effects.
    chance : Chance
    alpha : float
        Family-wise error of the search.

    Returns
    -------
    list of dict
        ``name``, ``amplitude_arcsec``, ``unit`` (of the amplitude; per hour for a drift) and
        ``rms_arcsec`` of that effect on the sky over the rows. Effects indistinguishable from the
        base or from another driver of the run are omitted.
    """
    fit = problem.plain.fit([])
    bank = problem.dictionary
    scores = bank.score(fit)
    if not np.isfinite(scores.delta_bic).any():
        return []
    best = int(np.argmax(scores.delta_bic))
    # all effects with a reported limit are in the dictionary itself
    flipped = ChanceTest(fit, scores, best, bank.shares['dictionary']).flipped_max(chance.signs)
    limit = float(np.quantile(flipped, 1.0 - alpha * SHARES['dictionary']))
    live = max(np.count_nonzero(fit.weights > LIVE), 2)
    free = max(live - len(fit.basis) / 2, 4)  # the noise of each axis is estimated separately
    names = {e.name: g for g, e in reversed(list(enumerate(bank.effects)))}
    out = []
    for name, factor, unit in _ROWS:
        g = names.get(name)
        if g is None or scores.dof[g] < len(bank.of(g)):
            continue
        dof = int(scores.dof[g])
        white = fit.noise.whiten(bank.of(g))
        # signal beyond the base in units of the noise, for each phase at unit amplitude
        phases = _PHASES if dof == 2 else np.ones((1, 1))
        unit_lambda = np.sqrt(np.square(phases @ (white @ scores.basis(g).T)).sum(axis=1))
        size = _amplitude(unit_lambda, dof, free, _gain(dof, free, limit, dof * np.log(live)))
        rms = np.sqrt(np.square(phases @ bank.of(g)).sum() / len(phases) / problem.n)
        out.append({'name': name, 'amplitude_arcsec': factor * size / ARCSEC, 'unit': unit,
                     'rms_arcsec': float(size * rms / ARCSEC)})
    return out


def _gain(dof, free, limit, cost):
    """Chi^2 gain needed for significance and for a gain by BIC.

    Parameters
    ----------
    dof : int
        Number of columns of the effect.
    free : int
        Degrees of freedom of the noise estimate.
    limit : float
        Critical normal score of the best of all candidates.
    cost : float
        BIC penalty of the effect.
    """
    return max(_bisect(lambda v: normal_score(v, dof, free) < limit, 0.1, 1e5), cost)


def _amplitude(unit_lambda, dof, free, gain):
    """Amplitude detected with probability `POWER`, averaged over uniform phases."""
    from scipy.special import ncfdtr
    return _bisect(lambda a: np.mean(1.0 - ncfdtr(
        dof, free, np.minimum(np.square(a * unit_lambda), _SURE), gain / dof)) < POWER,
        0.0, 1e4 / np.sqrt(np.square(unit_lambda).mean()))


def _bisect(below, low, high):
    """Bisection: the point where `below` turns from true to false."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if below(middle) else (low, middle)
    return float(high)
