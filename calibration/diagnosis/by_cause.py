"""What the model is with each of the causes that explain an effect as well."""

from dataclasses import replace

import numpy as np

from calibration.term_notes import suspicious
from msg_tools.units import ARCSEC
from pointing_model.effects.words import coefficient_word


def fit_causes(work, found, i, standing, causes, fit):
    """Fit the model with each cause of an effect in its place, and write it down there.

    Parameters
    ----------
    work : Work
    found : Found
    i : int
        Of `found.chosen`.
    standing : Standing
        Of that choice.
    causes : list of dict
        Of `DiagnosedEffect`. Each gets ``fitted``: ``coefficients`` (``name``, ``word`` for people,
        ``value_arcsec``, ``sigma_arcsec``, ``unit``) and ``terms`` (name: ``value_arcsec``,
        ``sigma_arcsec``); None for a cause that is tried by its score alone.
    fit : callable
        ``fit(chosen)``: a choice as the found one is fitted.
    """
    choice, problem = found.chosen[i], work.problem
    bank, own = choice.family(problem, found.chosen)
    groups = {} if choice.of is not None else {
        bank.effects[k].name: k for k in (*standing.alternatives, *standing.same, own)}
    others = [one for one in found.chosen if one != choice]
    for told in causes:
        group = next((groups[name] for name in told['effects'] if name in groups), None)
        told['fitted'] = None
        if group is not None:
            mine = replace(choice, group=group)
            told['fitted'] = _fitted(work, [mine, *(
                one for one in standing.companions.get(group, others) if one != mine)], fit)


def _fitted(work, chosen, fit):
    model, _ = work.model(fit(chosen), chosen)
    one = model.effects[0]
    sigma = np.sqrt(np.maximum(np.diag(model.covariance), 0.0))
    return {
        'coefficients': [
            {'name': name, 'word': coefficient_word(one.effect, name), 'unit': one.effect.unit,
             'value_arcsec': float(value / ARCSEC), 'sigma_arcsec': float(s / ARCSEC)}
            for name, value, s in zip(one.effect.coefficient_names, one.coefficients, one.sigma)],
        'terms': {name: {'value_arcsec': float(value / ARCSEC), 'sigma_arcsec': float(s / ARCSEC)}
                  for (name, value), s in zip(model.terms.items(), sigma)}}


def sound_with(effects, name):
    """With which causes a term is not as no mount has it, and what it is with them.

    Parameters
    ----------
    effects : list of DiagnosedEffect
    name : str

    Returns
    -------
    list of dict
        ``cause``, ``value_arcsec``, ``sigma_arcsec``; of the best fit nothing.
    """
    out = []
    for effect in effects:
        for told in effect.causes[1:]:
            one = ((told.get('fitted') or {}).get('terms') or {}).get(name)
            if one is not None and not suspicious([{'name': name, **one}]):
                out.append({'cause': told['cause'], **one})
    return out


def same_set(choices, effects):
    """How many repeated choices are the effects that were found, each by one of its causes.

    Parameters
    ----------
    choices : list of list of Effect
    effects : list of DiagnosedEffect

    Returns
    -------
    int
    """
    sets = [({one.fitted.effect.name, *one.alternatives}.union(
        *(told['effects'] for told in one.causes)), one.fitted.effect.line) for one in effects]

    def same(chosen):
        left = list(sets)
        for effect in chosen:
            mine = next((one for one in left if effect.name in one[0] or effect.line == one[1]),
                        None)
            if mine is None:
                return False
            left.remove(mine)
        return not left
    return sum(map(same, choices))
