"""The error to be expected of the declared terms alone, before anything is looked for."""

import numpy as np

from .constants import FOLDS
from .correlated_noise import Sequence
from .diagnosis_base import Base, linearised, observations
from .excess import ahead
from .expected_error import expected_error
from .folds import cross_validate
from .problem import Problem
from .scores import Bank
from .validation import partitions_of


def expected_of_terms(run, base='physical', seed=0):
    """As `Diagnosis.expected`, for a model without effects.

    Parameters
    ----------
    run : PointingRun
    base : str
        See `Base.parse`.
    seed : int

    Returns
    -------
    dict or None
        None where the rows do not determine the terms and a residual.
    """
    rng, base = np.random.default_rng(seed), Base.parse(base, (), run.mount)
    try:
        obs = observations(run)
    except ValueError:  # too few rows, or what is in them
        return None
    columns = base.columns(obs.context, obs.label)
    if 2 * len(obs) < len(columns) + 4:
        return None
    _, left, _ = linearised(obs, base)
    none = Bank([], None, np.empty((0, 2 * len(obs))))
    problem = Problem(columns, left, obs.inverse_sigma, none, none,
                      Sequence.of(obs.context, obs.label))
    keep = problem.plain.state([], final=True).weights > 0.0
    residual = cross_validate(problem.plain, [], partitions_of(problem, FOLDS, rng)[0])
    return expected_error(residual, keep, problem.sequence.order, rng, *ahead(problem, [], rng))
