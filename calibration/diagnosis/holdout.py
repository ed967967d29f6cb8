"""Judging a model on runs that were left out: a new night of the same mount."""

from dataclasses import replace
from pathlib import PurePath

import numpy as np

from pointing_model.fitted_effects import total
from pointing_model.terms import stacked_design

from .base import observations
from .linear import Columns, fit_state
from .resampling import radial_arcsec


def judge_on(runs, result, own_terms, encoder='enc'):
    """Put the radial RMS on left-out runs, without and with the effects, into a result.

    The model stays as it is but for `own_terms`, which each run refits robustly on its own rows:
    so does an observer on a new night.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
    result : Diagnosis
    own_terms : sequence of str
    encoder : {'enc', 'abs'}
    """
    obs = observations(runs, encoder)
    left, kept = [], np.ones(len(obs), bool)
    for model in (result.base_model, result.model):
        state = _refit(obs, model, own_terms)
        left.append(state.raw.reshape(2, -1))
        kept &= state.weights > 0.0
    for entry, residual in zip((result.before, result.after), left):
        entry['holdout_rms_arcsec'] = radial_arcsec(residual, kept)
    notes = [f'held out: {note}' for note in _left_out(obs)]
    for found in result.model.effects:
        lost = np.count_nonzero(found.unknown(obs.context))
        if lost:
            notes.append(f'held out: {found.effect.name} counts as zero in {lost} of {len(obs)} '
                         f'rows, where {found.effect.driver} is not known')
    note = (f'held out: {len(obs)} observations of {len(obs.runs)} runs, '
            f'{", ".join(own_terms)} refitted in each, nothing else; '
            f'{int(np.sum(~kept))} outliers set aside')
    result.notes += [note, *notes]


def _left_out(obs):
    reasons = {}
    for e in obs.excluded:
        place = f'{PurePath(str(e.get("source") or "run")).name}:{e["row"]}'
        reasons.setdefault(e['reason'], []).append(place)
    return [*obs.notes, *(f'{", ".join(places)} left out: {reason}'
                          for reason, places in reasons.items())]


def _refit(obs, model, own_terms):
    az, el = obs.context.az, obs.context.el
    # the effects by the drivers of the whole run: a row may have one from the row before
    b = obs.observed - np.nan_to_num(np.concatenate(replace(model, effects=()).offsets(az, el))) \
        - np.concatenate(total(model.effects, obs.context))
    own = stacked_design(tuple(own_terms), az, el)
    columns = Columns(own[:0], own, obs.label)
    return fit_state(columns, b, obs.inverse_sigma, final=True)
