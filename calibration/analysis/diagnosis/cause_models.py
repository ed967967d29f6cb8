"""What the model is with each of the causes that explain an effect as well."""

from dataclasses import replace

import numpy as np

from calibration.analysis.term_notes import suspicious
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
    return {
        'coefficients': [
            {'name': name, 'word': coefficient_word(one.effect, name), 'unit': one.effect.unit,
             'value_arcsec': float(value / ARCSEC), 'sigma_arcsec': float(s / ARCSEC)}
            for name, value, s in zip(one.effect.coefficient_names, one.coefficients, one.sigma)],
        'terms': {name: {'value_arcsec': float(value / ARCSEC), 'sigma_arcsec': float(s / ARCSEC)}
                  for (name, value), s in zip(model.terms.items(), model.sigmas)
                  if np.isfinite(s)}}


def sound_with(effects, name):
    """With which other causes a term is as mounts have it, and what it is beside them.

    Parameters
    ----------
    effects : list of DiagnosedEffect
    name : str

    Returns
    -------
    list of dict
        ``cause``, ``value_arcsec``, ``sigma_arcsec``.
    """
    out = []
    for effect in effects:
        for told in effect.causes:
            if not told.get('fitted') or effect.fitted.effect.name in told['effects']:
                continue
            one = told['fitted']['terms'].get(name)
            if one is not None and not suspicious([{'name': name, **one}]):
                out.append({'cause': told['cause'], **one})
    return out


def by_any_cause(choices, effects):
    """How often the effects that were found are chosen again, each by one of its causes.

    Parameters
    ----------
    choices : list of list of Effect
        Repeated without a part of the rows.
    effects : list of DiagnosedEffect

    Returns
    -------
    dict
        ``same_set``: how many choices are these and no other; ``chosen_set``: name of each effect
        and how many choices have it.
    """
    sets = {one.fitted.effect.name: ({one.fitted.effect.name, *one.alternatives}.union(
        *(told['effects'] for told in one.causes)), one.fitted.effect.line) for one in effects}

    def of(chosen):
        """Found effects that a choice has, and whether it has these and no other."""
        left, others = dict(sets), 0
        for effect in chosen:
            mine = next((name for name, (names, line) in left.items()
                         if effect.name in names or effect.line == line), None)
            others += mine is None
            left.pop(mine, None)
        return set(sets) - set(left), not left and not others
    told = [of(chosen) for chosen in choices]
    return {'same_set': sum(same for _, same in told),
            'chosen_set': {name: sum(name in found for found, _ in told) for name in sets}}
