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

"""How large an effect would have been, for these observations to show it.

"Nothing found" is worth what could have been found. The directions, the times and the noise of a
run say it beforehand: an effect of amplitude a has lambda = a |(1 - P) s| / sigma, its unit signal
s beyond what the model fits, in units of the noise; it is found where the noncentral F of its
score passes what chance gives to the best of all candidates.
"""

import numpy as np

from calibration.estimation.chance import ChanceTest, normal_score
from calibration.estimation.false_alarms import SHARES
from calibration.estimation.linear_model import LIVE
from msg_tools.units import ARCSEC
from pointing_model.mount_kinds import KINDS

#: how often an effect of the size that is told would have been found
POWER = 0.9


def _of_axes(first, second):
    """Effects of which it is told: name, factor on the coefficient's length, unit."""
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


#: the names of the axes say of which mount an effect is
_ROWS = dict.fromkeys(row for names in KINDS.values() for row in _of_axes(*names.keys))
#: phases of two columns that belong together, shape (k, 2)
_PHASES = np.array([[np.cos(a), np.sin(a)] for a in (np.arange(48) + 0.5) * np.pi / 48])
_SURE = 1e4  # lambda^2 of what no run overlooks


def detectable(problem, chance, alpha):
    """Amplitudes that a run would have shown in 9 of 10 cases, whatever their phase or sign.

    Parameters
    ----------
    problem : SelectionProblem
        Nothing is chosen: the base alone is fitted.
    chance : Chance
    alpha : float
        Family-wise error of the search.

    Returns
    -------
    list of dict
        ``name``, ``amplitude_arcsec``, ``unit`` (of the amplitude: a drift's is an hour's) and
        ``rms_arcsec`` of that effect on the rows, on the sky. Effects that the base or another
        driver of the run hides are not in it.
    """
    fit = problem.plain.fit([])
    bank = problem.dictionary
    scores = bank.score(fit)
    if not np.isfinite(scores.delta_bic).any():
        return []
    best = int(np.argmax(scores.delta_bic))
    # all that it is told of is of the dictionary itself
    flipped = ChanceTest(fit, scores, best, bank.shares['dictionary']).flipped_max(chance.signs)
    limit = float(np.quantile(flipped, 1.0 - alpha * SHARES['dictionary']))
    live = max(np.count_nonzero(fit.weights > LIVE), 2)
    free = max(live - len(fit.basis) / 2, 4)  # each axis has noise of its own
    names = {e.name: g for g, e in reversed(list(enumerate(bank.effects)))}
    out = []
    for name, factor, unit in _ROWS:
        g = names.get(name)
        if g is None or scores.dof[g] < len(bank.of(g)):
            continue
        dof = int(scores.dof[g])
        white = fit.noise.whiten(bank.of(g))
        # signal beyond the base in units of the noise, of each phase at unit amplitude
        phases = _PHASES if dof == 2 else np.ones((1, 1))
        unit_lambda = np.sqrt(np.square(phases @ (white @ scores.basis(g).T)).sum(axis=1))
        size = _amplitude(unit_lambda, dof, free, _gain(dof, free, limit, dof * np.log(live)))
        rms = np.sqrt(np.square(phases @ bank.of(g)).sum() / len(phases) / problem.n)
        out.append({'name': name, 'amplitude_arcsec': factor * size / ARCSEC, 'unit': unit,
                     'rms_arcsec': float(size * rms / ARCSEC)})
    return out


def _gain(dof, free, limit, cost):
    """Gain, in chi^2, beyond chance and beyond what BIC asks for.

    Parameters
    ----------
    dof : int
        Columns of the effect.
    free : int
        Degrees of freedom that the noise is known by.
    limit : float
        Normal score that chance gives to the best of all candidates.
    cost : float
    """
    return max(_bisect(lambda v: normal_score(v, dof, free) < limit, 0.1, 1e5), cost)


def _amplitude(unit_lambda, dof, free, gain):
    """Amplitude that is found in `POWER` of all cases, any phase being as likely."""
    from scipy.special import ncfdtr
    return _bisect(lambda a: np.mean(1.0 - ncfdtr(
        dof, free, np.minimum(np.square(a * unit_lambda), _SURE), gain / dof)) < POWER,
        0.0, 1e4 / np.sqrt(np.square(unit_lambda).mean()))


def _bisect(below, low, high):
    """Where `below` turns from true to false."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if below(middle) else (low, middle)
    return float(high)
