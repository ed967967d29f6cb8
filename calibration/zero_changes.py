"""How the zeros have changed from power-on to power-on, by the exposures for them alone."""

from contextlib import suppress

import numpy as np

from pointing_model.zero_exposures import is_for_zero, is_marked

from .fit import fit_terms
from .stars_zero import zero_from_exposures


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
    return [{'from': before, 'to': after, **zero_change(rows, before, after, model).to_dict()}
            for before, after in zip(numbers, numbers[1:])]


def zero_change(rows, before, after, model):
    """Between two power-ons; `model` says how the offset differs between the places exposed.

    Returns
    -------
    MeasuredZero
    """
    exposures = rows.select(is_for_zero(rows))
    then, now = (exposures.select(exposures['run'] == number) for number in (before, after))
    return zero_from_exposures(now, then, model=model, reference_name=f'power-on {before:.0f}')


def _by_stars_alone(rows):
    """The terms without the exposures: what is held may not rest on these themselves.

    None where the stars are too few.
    """
    with suppress(ValueError, np.linalg.LinAlgError):
        return fit_terms(rows.select(~is_for_zero(rows)), run_zeros=True).model
    return None
