"""The zeros of a night by the exposures for them alone, and how they have changed."""

from contextlib import nullcontext, suppress

import numpy as np

from pointing_model.model import PointingModel
from pointing_model.zero_exposures import is_for_zero, is_marked

from ...rows import by_run, zero_exposures_by_run
from ..fit import fit_terms
from .stars_zero import is_alone, zero_from_exposures, zeros_of_power_ons


def zeros_of_night(rows, reference, needed=None):
    """The zero of each power-on that has enough exposures for one.

    Parameters
    ----------
    rows : PointingRun
        All of the night.
    reference : PointingModel or None
        Of an earlier night.
    needed : int, optional
        A power-on that must have enough, if it has any.

    Returns
    -------
    zeros : dict of int to MeasuredZero
    parts : dict of int to PointingRun
        The exposures.

    Raises
    ------
    ValueError
        `needed` has too few.
    """
    reference = reference or PointingModel({}, mount=rows.mount)
    zeros, parts = {}, {}
    for number, part in zero_exposures_by_run(rows):
        with nullcontext() if number == needed else suppress(ValueError):
            zeros[number] = zeros_of_power_ons({number: part}, reference)[number]
            parts[number] = part
    if not is_alone(parts, reference):
        zeros = zeros_of_power_ons(parts, reference)
    return zeros, parts


def zero_changes(rows, numbers, model):
    """Change of the zero from each power-on to the next.

    Parameters
    ----------
    rows : PointingRun
        That were fitted, exposures for zeros among them.
    numbers : sequence of int
        Power-ons with such exposures.
    model : PointingModel
        Of the fit.

    Returns
    -------
    list of dict
        ``from``, ``to``, and `polaris_zero.MeasuredZero.to_dict`.
    """
    if is_marked(rows).any():
        model = _by_stars_alone(rows)
    parts, means = by_run(rows.select(is_for_zero(rows))), {}
    return [{'from': before, 'to': after, **_change(parts, before, after, model, means).to_dict()}
            for before, after in zip(numbers, numbers[1:])]


def zero_change(rows, before, after, model):
    """Between two power-ons; `model` says how the offset differs between the places exposed.

    Returns
    -------
    MeasuredZero
    """
    return _change(by_run(rows.select(is_for_zero(rows))), before, after, model)


def _change(parts, before, after, model, means=None):
    return zero_from_exposures(parts[after], parts[before], model=model, means=means,
                               reference_name=f'power-on {before:.0f}')


def _by_stars_alone(rows):
    """The terms without the exposures: what is held may not rest on these themselves.

    None where the stars are too few.
    """
    with suppress(ValueError, np.linalg.LinAlgError):
        return fit_terms(rows.select(~is_for_zero(rows)), run_zeros=True).model
    return None
