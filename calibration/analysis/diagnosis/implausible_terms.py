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

"""Terms with a sign or size implausible for any mount, and possible reasons in the data."""

from dataclasses import replace

import numpy as np

from calibration.analysis.harmonic_fit import rows_of_terms
from calibration.estimation.correlated_noise import WhiteNoise
from msg_tools.units import ARCSEC, DEG
from pointing_model.mount_kinds import KINDS

#: standard errors from which a value is significant
_SURE = 3.0
#: arcsec of cot E: a third of the refraction of 58" at sea level. Pressure and temperature change
#: it by a tenth only
_WRONG_AIR = 20.0
#: arcsec: axes are built square, and tubes stiff, to minutes of arc
_SQUARE = DEG / ARCSEC
_OF_SHAPE = {kind.named(name) for kind in KINDS.values() for name in ('TF', 'CA', 'NPAE')}


def suspicious(terms):
    """Terms with a sign or size implausible for any mount.

    Parameters
    ----------
    terms : iterable of dict
        ``name``, ``value_arcsec``, ``sigma_arcsec``.

    Returns
    -------
    list of dict
        The same keys, and ``what``: ``sign`` or ``size``.
    """
    out = []
    for row in terms:
        name, value, sigma = row['name'], row['value_arcsec'], row.get('sigma_arcsec')
        if not sigma:
            continue
        what = ''
        if name == 'TF' and value < -_SURE * sigma:
            what = 'sign'
        elif abs(value) > _SURE * sigma + {
                'TX': _WRONG_AIR, **dict.fromkeys(_OF_SHAPE, _SQUARE)}.get(name, np.inf):
            what = 'size'
        if what:
            out.append({'name': name, 'value_arcsec': float(value), 'sigma_arcsec': float(sigma),
                        'what': what})
    return out


def implausible_terms(result):
    """Facts about each implausible term, declared or found.

    Parameters
    ----------
    result : Diagnosis

    Returns
    -------
    list of dict
        The keys of `suspicious`, and ``altaz`` (whether the mount is one); ``alone_arcsec``, the
        value without the effects; for a negative TF ``refraction`` (see `refraction_in_place`) and,
        if it is negative with the effects, ``sound_with`` (see `sound_with`). If a wrong sign is
        significant only without the effects, the value is the one without them, and
        ``beside_effects_arcsec`` the one with them.
    """
    rows = rows_of_terms(result.model)
    rows += [{'name': 'TX', 'value_arcsec': float(one.fitted.coefficients[0]) / ARCSEC,
              'sigma_arcsec': float(one.fitted.sigma[0]) / ARCSEC} for one in result.effects
             if one.fitted.effect.coefficient_names == ('TX',)]
    out = suspicious(rows) + _in_doubt(result, rows)
    for one in out:
        one['altaz'] = result.observations.run.mount.vertical
        if result.effects and one['name'] in result.base_model.terms and (
                'beside_effects_arcsec' not in one):
            one['alone_arcsec'] = result.base_model.terms[one['name']] / ARCSEC
        if one['name'] == 'TF':
            one['refraction'] = refraction_in_place(result)
            one['sound_with'] = [] if 'beside_effects_arcsec' in one else sound_with(
                result.effects, 'TF')
    return out


def _in_doubt(result, rows):
    """Terms with a wrong sign that is significant only without the effects, but present in both."""
    if not result.effects:
        return []
    known = {row['name'] for row in suspicious(rows)}
    beside = {row['name']: row['value_arcsec'] for row in rows}
    return [{**one, 'beside_effects_arcsec': beside[one['name']]} for one in suspicious(
        rows_of_terms(result.base_model))
        if one['what'] == 'sign' and one['name'] not in known
        and beside.get(one['name'], 0.0) * one['value_arcsec'] > 0.0]


def refraction_in_place(result):
    """Fit a refraction error, cot E, in place of TF and together with it, without the effects.

    Parameters
    ----------
    result : Diagnosis

    Returns
    -------
    dict or None
        ``value_arcsec`` of TX, fitted in place of TF with the other declared terms;
        ``delta_bic``, the gain of that fit; and ``beside_arcsec``, TF fitted together with TX.
        None if TX is declared, or TF is fitted to each run.
    """
    base, obs = result.base, result.observations
    if 'TF' not in base.terms or 'TF' in base.own or 'TX' in base.terms:
        return None
    rows = np.flatnonzero(result.weights > 0.0)
    both = np.concatenate((rows, rows + len(obs)))
    other = replace(base, terms=tuple('TX' if t == 'TF' else t for t in base.terms))
    with_tf, with_tx = (one.columns(obs.context, obs.label).rows(both) for one in (base, other))
    at = [t for t in base.terms if t not in base.own].index('TF')
    scale = [max(float(np.sqrt(np.mean(np.square(r[rows])))), 1e-15)
             for r in result.residual_before]
    noise = WhiteNoise(np.concatenate([np.sqrt(result.weights[rows]) / s for s in scale]))
    # the other terms are in both models, so the residuals with only TF added back are enough
    b = result.residual_before.reshape(-1)[both] + (
        result.base_model.terms['TF'] * with_tf.common[at])
    left = [float(np.square(noise.whiten(one.left_of(b, noise))).sum())
            for one in (with_tf, with_tx)]
    return {'value_arcsec': _coefficient(with_tx, at, b, noise),
            'delta_bic': float(len(both) * np.log(max(left[0], 1e-300) / max(left[1], 1e-300))),
            'beside_arcsec': _coefficient(with_tf.beside(with_tx.common[at]), at, b, noise)}


def _coefficient(columns, at, b, noise):
    """Common coefficient `at` of a fit to `b`, arcsec."""
    return float(columns.solver(noise)(b)[0][at]) / ARCSEC


def sound_with(effects, name):
    """Alternative causes with which a term has a plausible value, and that value.

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
        for cause in effect.causes:
            if not cause.get('fitted') or effect.fitted.effect.name in cause['effects']:
                continue
            one = cause['fitted']['terms'].get(name)
            if one is not None and not suspicious([{'name': name, **one}]):
                out.append({'cause': cause['cause'], **one})
    return out
