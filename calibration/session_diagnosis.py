"""A night's model, diagnosed on the night's own rows, with the effects found and the zeros to go
with it.
"""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.context import Context
from pointing_model.effects import effect
from pointing_model.model import PointingModel
from pointing_model.rms import rms_arcsec
from pointing_model.run import PointingRun
from pointing_model.star_catalogue import POLARIS_HIP
from pointing_model.zero import NO_ZERO, Zeros

from .diagnosis import Diagnosis, diagnose
from .rows import for_fitting, is_kept_out

FORMAT = 'telescope_mount/diagnosis'
VERSION = 1
_RANKED = 20
_RATE_NOISE = 2.0 * ARCSEC  # a second; stars go 15, satellites 30 and more


@dataclass
class Amended:
    """A model with what it lacked.

    Attributes
    ----------
    model : PointingModel
        For pointing with `zeros`.
    zeros : Zeros
        Of the power-ons.
    document : dict
        JSON-ready: the keys of `Diagnosis.to_dict`, and ``applied`` (names of the effects in
        `model`), ``aliases`` of each effect, ``kept_out`` (how many rows were there to judge by),
        ``ranking``, ``zeros_in_force``, ``notes``, and what it was made with: ``alpha``,
        ``site_deg``, ``graduation`` (of the encoder, as it was declared).
    diagnosis : Diagnosis
    """

    model: PointingModel
    zeros: Zeros
    document: dict
    diagnosis: Diagnosis


def amend(rows, zeros, fitted=None, provenance=None, alpha=0.01, site=None):
    """Diagnose a night, and add what is found.

    Stars alone are diagnosed, without the exposures of Polaris: many rows in one direction would
    make one small misfit there look like an effect. Rows kept out (`rows`) are used for
    nothing but ``holdout_rms_arcsec``, with nothing refitted.

    Parameters
    ----------
    rows : PointingRun
        All rows of the night, with columns `star` and `run`.
    zeros : Zeros
        That belong to `fitted`; a power-on without one has that before it.
    fitted : PointingModel, optional
        The model in force. With the verdict ``none`` it stays as it is.
    provenance : dict, optional
        Of the new model.
    alpha : float
        Chance that a clean night gets any effect.
    site : dict, optional
        ``latitude``, ``longitude``, rad; without it what follows the stars cannot be told.

    Returns
    -------
    Amended
        An ambiguous verdict is applied with the best member of each set: all members predict
        nearly the same where the night has observed, and the others are in ``alternatives``. A
        linear drift in time goes on for as long again as the night has lasted, then holds.

    Raises
    ------
    ValueError
        Too few stars.
    """
    seen = for_fitting(rows)
    stars = _at_zero(seen.select(seen['star'] != POLARIS_HIP), zeros, site)
    if len(stars) == 0:
        raise ValueError('no star to diagnose has come yet; observe first')
    result = diagnose(stars, alpha=alpha, sessions=0.0)
    base, base_zeros = fitted, zeros
    if fitted is None:
        base, base_zeros = result.base_model, _shifted(zeros, result, result.base_model)
    model, new_zeros = base, base_zeros
    if result.effects:
        model = _going_on(result.model, stars)
        new_zeros = _shifted(zeros, result, model)
    in_force = Zeros(new_zeros[number] for number in sorted(new_zeros)).to_list()
    model = replace(model, provenance={
        **model.provenance, **(provenance or {}), 'verdict': result.verdict,
        'zeros_in_force': in_force})
    kept = rows.select(is_kept_out(rows) & (rows['star'] >= 0))
    _judge(result, kept, (base, base_zeros), (model, new_zeros))
    document = _document(result, model, kept, in_force)
    document['alpha'] = alpha
    document['site_deg'] = None if site is None else [
        float(np.degrees(site[name])) for name in ('latitude', 'longitude')]
    return Amended(model, new_zeros, document, result)


def _going_on(model, stars):
    """The model with its linear drifts in time going on for as long again as was observed.

    `diagnose` holds a driver at its value soon after the last row. The stars of tonight come
    after it, though, and a drift of which the rate is known to 1 in 20 is better followed than
    stopped; one with the square of time would run away, and is held from the last row on.
    """
    if 'time' not in stars:
        return model
    first, last = np.nanmin(stars['time']), np.nanmax(stars['time'])
    within = {1: [float(2.0 * first - last), float(2.0 * last - first)],
              2: [float(first), float(last)]}
    effects = []
    for fitted in model.effects:
        e = fitted.effect
        if e.form == 'drift' and e.driver == 'time' and e.parameters.get('within'):
            fitted = replace(fitted, effect=effect(
                e.form, **{**e.parameters, 'within': within[e.parameters['power']]}))
        effects.append(fitted)
    return replace(model, effects=effects)


def _at_zero(rows, zeros, site):
    """The rows with the zeros taken off, as `diagnose` wants them."""
    columns = dict(rows.columns)
    az, el = zeros.carried(np.unique(rows['run'])).of_rows(rows)
    # readings are what the encoders read: the zero and the star's place are no part of them
    for axis, zero, factor, miss in (('az', az, np.cos(rows['el']), 'miss_x'),
                                     ('el', el, 1.0, 'miss_y')):
        if f'{axis}_raw' not in columns:
            columns[f'{axis}_raw'] = rows[f'{axis}_enc'] - np.nan_to_num(rows.get(miss)) / factor
        columns[f'{axis}_enc'] = rows[f'{axis}_enc'] - zero
    if site and _sidereal(rows, site):
        # what differs from the stars' own rates is noise of the encoder, and no latency
        for name in ('az_rate', 'el_rate'):
            columns.pop(name, None)
    if np.all(columns['star'] == np.floor(columns['star'])):
        columns['star'] = columns['star'].astype(np.int64)
    return PointingRun(columns, {**rows.meta, **({'site': site} if site else {})})


def _sidereal(rows, site):
    """Whether the rates of the rows are those of stars, but for the noise of two readings."""
    alone = Context(rows['az'], rows['el'], None, site['latitude'])
    off = np.hypot((rows.get('az_rate') - alone.get('az_rate')) * np.cos(rows['el']),
                   rows.get('el_rate') - alone.get('el_rate'))
    return bool(np.nanmedian(off) < _RATE_NOISE) if np.isfinite(off).any() else False


def _shifted(zeros, result, model):
    """Zeros that go with `model`, whose IA and IE are the medians of the power-ons."""
    terms = {int(float(name)): values for name, values in result.run_terms.items()}
    out = zeros.filled(terms, NO_ZERO)
    for number, own in terms.items():
        out[number] = out[number].plus(own['IA'] * ARCSEC, own['IE'] * ARCSEC).plus(
            -model.terms['IA'], -model.terms['IE'])
    return out


def _judge(result, kept, before, after):
    """RMS on the rows that nothing has seen, with the model before and after."""
    if len(kept) == 0:
        return
    for entry, (model, zeros) in ((result.before, before), (result.after, after)):
        x, y = model.residuals(kept, zero=zeros.carried(np.unique(kept['run'])))
        entry['holdout_rms_arcsec'] = rms_arcsec(x, y).radial
    result.notes.append(f'held out: {len(kept)} rows of the same night that no fit and no choice '
                        'has seen, nothing refitted')


def _document(result, model, kept, in_force):
    document = result.to_dict()
    for entry, found in zip(document['effects'], result.effects):
        entry['aliases'] = list(found.aliases)
    names = ('name', 'driver', 'axes', 'delta_bic', 'p_family', 'in_set')
    return {
        'format': FORMAT, 'version': VERSION, **document,
        'applied': [e.effect.name for e in model.effects], 'kept_out': len(kept),
        'ranking': [{n: line[n] for n in names} for line in result.ranking[:_RANKED]],
        'zeros_in_force': in_force, 'graduation': result.observations.context.graduation,
        'notes': list(dict.fromkeys(result.notes)),
    }
