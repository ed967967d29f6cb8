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


"""Terms other than the zeros that are fitted to each session: their variation and its driver."""

import numpy as np

from calibration.estimation.group_columns import inverse_root
from calibration.estimation.step_scan import two_sided
from msg_tools.units import ARCSEC

from ..finding import Finding

#: a term varies if its extremes differ by more than this many standard errors of the difference:
#: for a constant term and white noise, the extremes of 67 sessions differ by 3.4
_APART = 4.0
#: fewest sessions, and largest p-value over all columns and terms, to name a driver
_FEWEST, _BY_CHANCE = 4, 0.01


def moving_findings(run, choice, fit, run_terms):
    """A Finding for each term other than the zeros that varies from session to session.

    Parameters
    ----------
    run : RunProblem
    choice : ModelChoice
    fit : Estimate
        Fit with the effects of the choice.
    run_terms : dict
        Run -> terms fitted to that run alone, arcsec.

    Returns
    -------
    list of Finding
    """
    own, names = run.base.own, run.obs.run.mount.names
    moving = [name for name in own if name not in names.index]
    if not moving or len(run_terms) < 2:
        return []
    sigmas, drivers, out = _sigmas(run, choice, fit), _drivers(run.obs), []
    for name in moving:
        sigma = sigmas[:, own.index(name)]
        values = np.array([terms[name] for terms in run_terms.values()])
        known = sigma > 0.0
        if known.sum() < 2:
            continue
        values, sigma = values[known], sigma[known]
        low, high = int(np.argmin(values)), int(np.argmax(values))
        if values[high] - values[low] > _APART * np.hypot(sigma[high], sigma[low]):
            follows = _follows(values, {key: of[known] for key, of in drivers.items()},
                               len(moving))
            out.append(Finding('term of each session', causes=(name,), caution=True, evidence={
                'low': (values[low], sigma[low]), 'high': (values[high], sigma[high]),
                'sessions': len(values), 'follows': follows}))
    return out


def _sigmas(run, choice, fit):
    """Standard errors of the terms of each session, shape (sessions, terms), arcsec; 0: unknown."""
    design, weights = run.problem.design(choice.chosen), np.square(choice.fit.noise.root)
    root = inverse_root(design.own_normal(weights))
    covariance = root @ root.transpose(0, 2, 1)
    across = design.share(design.common, weights, root)
    of_common = across @ fit.covariance @ across.transpose(0, 2, 1)
    alone, both = (np.diagonal(one, axis1=1, axis2=2)
                   for one in (covariance, covariance + of_common))
    return np.where(alone > 0.0, np.sqrt(np.maximum(both, 0.0)), 0.0) / ARCSEC


def _drivers(obs):
    """Mean of each possible driver in each session, if all sessions have it."""
    out, labels = {}, np.unique(obs.label)
    for name in ('temperature', 'time', *obs.context.extra()):
        value = obs.context.get(name)
        if value is None:
            continue
        known = np.isfinite(value)
        count = np.bincount(obs.label[known], minlength=labels[-1] + 1)[labels]
        if (count > 0).all():
            out[name] = np.bincount(obs.label[known], value[known],
                                    labels[-1] + 1)[labels] / count
    return out


def _follows(values, drivers, terms):
    """Driver most correlated with a term: driver, r, slope in arcsec per unit; or None."""
    count, best = len(values), None
    if count < _FEWEST:
        return None
    for name, driver in drivers.items():
        if np.ptp(driver) <= 1e-9 * np.abs(driver).max():
            continue
        r = float(np.corrcoef(driver, values)[0, 1])
        p = float(two_sided(r * np.sqrt((count - 2) / max(1.0 - r * r, 1e-12)), count - 2))
        if p * len(drivers) * terms < _BY_CHANCE and (best is None or abs(r) > abs(best['r'])):
            slope = np.polyfit(driver - driver.mean(), values, 1)[0]
            best = {'driver': name, 'r': r, 'slope': float(slope)}
    return best
