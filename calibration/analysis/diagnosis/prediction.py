"""A model chosen to predict: no claim of causes, only that stars left out are nearer with it.

The same dictionary as the diagnosis, but single coefficients, added by BIC while they pay and
with the diagnosis' second look at each; chance is not asked for. Only effects of the direction are
tried: what follows the clock of one night says nothing of another. Its figure is that of rows left
out with the whole choice repeated without them.
"""

from dataclasses import dataclass

import numpy as np

from calibration.estimation.candidates import CandidateGroup, best_of
from calibration.estimation.folds import predicted, random_folds
from calibration.estimation.select import affordable, second_look
from calibration.estimation.selection_problem import ModelChoice
from pointing_model.effects import direct
from pointing_model.effects.part import parts
from pointing_model.model import PointingModel
from pointing_model.rms import Rms, rms_arcsec

from .diagnosis_base import Base, mount_of, observations
from .run_problem import RunProblem, effect_bank

_MOST = 40  # coefficients
FOLDS = 10
#: rows from which on one way to leave rows out does: each takes long, and they differ little
_MANY, _FEW_WAYS = 100, 5


@dataclass
class PredictiveModel:
    """A model chosen to predict, and how well it does.

    Attributes
    ----------
    model, base_model : PointingModel
        With and without what was chosen.
    fitted : Rms
        arcsec, of all rows of the run, outliers too.
    before, after : list of Rms
        arcsec, of all rows left out, the choice repeated: of each way to leave them out.
    counts : list of int
        Coefficients chosen in each fold.
    rows : int
    """

    model: PointingModel
    base_model: PointingModel
    fitted: Rms
    before: list
    after: list
    counts: list
    rows: int

    def coefficients(self):
        """``name``, ``tpoint``, ``value_arcsec``, ``sigma_arcsec`` of what was chosen."""
        from msg_tools.units import ARCSEC
        return [{'name': e.effect.name, 'tpoint': e.effect.tpoint,
                 'value_arcsec': float(e.coefficients[0] / ARCSEC),
                 'sigma_arcsec': float(e.sigma[0] / ARCSEC)} for e in self.model.effects]


def predictive_model(runs, base='physical', *, encoder='enc', seed=0, folds=FOLDS, ways=None):
    """Choose effects of the direction so that other stars of the mount are predicted.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
    base : str
        What the model has anyway, see `Base.parse`.
    encoder : {'enc', 'abs'}
    seed : int
        Of the folds: that of each way is one more.
    folds : int
    ways : int, optional
        Ways to leave rows out; 0: none.

    Returns
    -------
    PredictiveModel

    Raises
    ------
    ValueError
        Too few rows for the base.
    """
    obs = observations(runs, encoder)
    run = RunProblem(obs, Base.parse(base, (), mount_of(runs)), alpha=0.01, curves=False)
    problem = run.problem
    effects = [part for e in problem.dictionary.effects if direct(e) for part in parts(e)]
    problem.dictionary = effect_bank(effects, obs.context, sizes=False)
    chosen = _forward(problem)
    plain = problem.plain
    fits = [run.exact_fit(some, plain.fit(some, final=True)) for some in ([], chosen)]
    if ways is None:
        ways = 1 if len(obs) > _MANY else _FEW_WAYS
    before, after, counts = [], [], []
    for way in range(ways):
        sets = random_folds(problem.sequence.group, folds, np.random.default_rng(seed + way))
        left, found = nested(problem, sets)
        before.append(rms_arcsec(*left[0]))
        after.append(rms_arcsec(*left[1]))
        counts += found
    base_model, model = (run.model(fit, choice)[0] for fit, choice in zip(fits, ([], chosen)))
    return PredictiveModel(model, base_model, rms_arcsec(*fits[1].residual.reshape(2, -1)), before,
                           after, counts, len(obs))


def nested(problem, folds):
    """Residuals of rows left out without and with a choice that has not seen them.

    Returns
    -------
    residual : ndarray, shape (2, 2, n)
        Radians.
    counts : list of int
        Coefficients chosen without each fold.
    """
    out, counts, every = np.empty((2, 2, problem.n)), [], np.arange(problem.n)
    for fold in folds:
        part = problem.rows(np.setdiff1d(every, fold)).plain
        chosen = _forward(part)
        counts.append(len(chosen))
        for k, some in enumerate(([], chosen)):
            out[k][:, fold] = predicted(problem, part, some, part.fit(some, final=True).noise,
                                        fold)
    return out, counts


def _forward(problem):
    """Choices added while they pay by BIC."""
    plain = problem.plain
    choice, seen = ModelChoice([], plain.fit([])), set()
    while len(choice.chosen) < _MOST:
        g, gain = best_of(plain.dictionary.score(choice.fit),
                          [c.group for c in choice.chosen])
        if gain <= 0.0 or not affordable(plain, choice.fit, len(plain.dictionary.of(g))):
            break
        choice.chosen.append(CandidateGroup(g))
        choice.fit = plain.fit(choice.chosen, choice.fit.weights)
        second_look(plain, choice)
        if frozenset(choice.chosen) in seen:  # what it takes back would go on for ever
            break
        seen.add(frozenset(choice.chosen))
    return list(dict.fromkeys(choice.chosen))
