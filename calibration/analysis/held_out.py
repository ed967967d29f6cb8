"""RMS of stars that a fit did not see, from no correction to the full model."""

from contextlib import suppress

import numpy as np

from pointing_model.model import PointingModel
from pointing_model.terms import PHYSICAL
from pointing_model.zero import BY_POLARIS, is_for_zero, zero_in_force

from .external_check import rms_of
from .fit import fit_harmonics

RAW = 'as the encoders read'
_ZEROED = 'zero set on {}'
ZEROED = _ZEROED.format(BY_POLARIS)
TERMS = f'{len(PHYSICAL)} physical terms'
BOTH = f'{TERMS}, then 13 harmonics'
PUBLISHED = 'published: '

#: label in the report -> what E is in paper 000's harmonics
HARMONICS = {
    '13 harmonics, E read as zenith distance': 'zenith',
    '13 harmonics, E read as printed': 'printed',
}


def held_out_steps(rows, recipe_of, used, reference, first, way, notes, published=None):
    """Each kind of model on the stars that it was fitted to, and on the others.

    Parameters
    ----------
    rows : PointingRun
        Stars and exposures for zeros, which every fit sees.
    recipe_of : callable
        ``recipe_of(rows)`` gives the `harmonic_fit.Recipe` for them.
    used : ndarray of bool
        Which of the stars are fitted.
    reference : PointingModel or None
        Of an earlier night.
    first : Zeros
        By their exposures alone, of each power-on.
    way : str
        By which way they were set (`check.ways`); '' where none was.
    notes : list of str
        Gets a line where stars are too few for what was asked for.
    published : (str, callable), optional
        Harmonics that are published: their label, and ``fit(rows, recipe)``.

    Returns
    -------
    list of dict
        ``step`` (its label), and ``used`` and ``held_out`` as `check.rms_of` gives them.
    """
    is_star = ~is_for_zero(rows)
    stars = rows.select(is_star)
    halves = {'used': stars.select(used), 'held_out': stars.select(~used)}
    seen = ~is_star  # exposures for the zero, and the stars used
    seen[np.flatnonzero(is_star)[used]] = True
    base = reference or PointingModel({}, mount=rows.mount)
    steps = []

    def judge(label, model, zero):
        steps.append({'step': label, **{
            name: rms_of(model, half, zero) for name, half in halves.items()}})

    judge(RAW if reference is None else 'model of the earlier night', base,
          zero_in_force(reference))
    if way:
        judge(_ZEROED.format(way), base, first)
    # functions of azimuth and elevation, to compare with: nobody has asked for them, and where
    # the stars are too few for them it is no news
    for label, interpretation in HARMONICS.items() if rows.mount.vertical else ():
        with suppress(ValueError):
            judge(label, fit_harmonics(halves['used'], interpretation, zero=first).model, first)
    try:
        part = rows.select(seen)
        fitted = recipe_of(part).terms(part)
        model, zeros = fitted.model, fitted.zeros
        judge(TERMS, model, zeros)
    except ValueError as err:
        notes.append(f'held-out check: {err}')
    else:
        if rows.mount.vertical:
            with suppress(ValueError):
                judge(BOTH, fit_harmonics(halves['used'], held=model, zero=zeros).model, zeros)
    if published is not None:
        label, fit = published
        try:
            fitted = fit(part, recipe_of(part))
            judge(PUBLISHED + label, fitted.model, fitted.zeros)
        except ValueError as err:
            notes.append(f'{label}: {err}')
    return steps


def steps_of(report):
    """The first step, the zero set, and the model that was published; None of what is not there.

    Returns
    -------
    tuple of (dict or None)
    """
    steps = report.get('steps') or []
    first = steps[0] if steps else None
    zeroed = next((step for step in steps if step['step'].startswith('zero set')), None)
    last = next((step for step in reversed(steps) if step['step'].startswith(PUBLISHED)), None) \
        or next((step for step in steps if step['step'] == TERMS), None)
    return first, zeroed, last
