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

"""Diagnosis of a night's model on the night's rows, and the model amended with what is found."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.rms import rms_arcsec
from pointing_model.zero import NO_ZERO
from pointing_model.zero_drift import KEY as FOLLOWS

from .analysis.diagnosis.diagnosis import diagnose
from .analysis.diagnosis.diagnosis_result import Diagnosis
from .estimation.comparison import FEWEST
from .estimation.false_alarms import ALPHA
from .publication import (
    NOT_COMPARED,
    AmendmentComparison,
    BlindStars,
    ModelWithZeros,
    carried_on,
    publishable,
)
from .report.documents import diagnosis_document
from .report.encoder_wording import count_drift_line
from .report.fit_wording import comparison_sentence
from .report.wording import wording
from .rows import stars_without_zeros

FORMAT = 'telescope_mount/diagnosis'
VERSION = 1
#: verdict if effects were found, but none is confirmed on held-out rows
WITHHELD = 'withheld'
#: verdict if the amended model is worse than the earlier one on new blind stars
TAKEN_BACK = 'taken_back'
_WITHHELD_WORDS = 'Not published, since it does not hold on rows that it has not seen: {}.'
_RANKED = 20


@dataclass
class NightDiagnosis:
    """Diagnosis of a night, and the amended model.

    Attributes
    ----------
    start : ModelWithZeros
        The diagnosed model, without the effects; its model is None if nothing was fitted.
    chosen : ModelWithZeros
        The model for pointing; `start` if nothing is added.
    model : PointingModel
        Model of `chosen`, with its provenance for publication.
    document : dict
        JSON-ready: the keys of `Diagnosis.to_dict`, and ``applied`` (names of the effects in
        `model`), ``aliases`` of each effect, ``kept_out`` (number of held-out rows),
        ``published`` (whether the model was changed), ``judgement`` (comparison of the change on
        held-out rows), ``refused`` (``effects``, ``why``, ``judgement``, and ``found``: their
        entries), ``ranking``, ``zeros_in_force``, ``notes``, and the options ``alpha``,
        ``site_deg``, ``graduation`` (of the encoder, as declared).
    diagnosis : Diagnosis
    """

    start: ModelWithZeros
    chosen: ModelWithZeros
    model: PointingModel
    document: dict
    diagnosis: Diagnosis


def diagnose_night(rows, start, provenance=None, alpha=ALPHA, site=None, base='physical',
                   progress=None):
    """Diagnose a night, and add the effects found to its model.

    Only stars are diagnosed, not the exposures for a zero: with many rows in one direction a small
    misfit there would look like an effect. The effects are tested on held-out rows (`rows`),
    without refitting; effects that fail are not published.

    Parameters
    ----------
    rows : PointingRun
        All rows of the night, with columns `star` and `run`.
    start : ModelWithZeros
        The fit; a power-on without a zero has the zero of the one before. With the verdict ``none``
        it is unchanged. If it has no model, the base is fitted.
    provenance : dict, optional
        Provenance of the new model.
    alpha : float
        Family-wise error rate: probability of any effect on a night without any.
    site : dict, optional
        ``latitude``, ``longitude``, rad; without it effects that depend on hour angle or
        declination cannot be determined.
    base : str
        The declared model, that of `start` (`diagnosis.base.Base.parse`). Its terms and
        harmonics are refitted with the effects, so that an effect is only what harmonics cannot
        fit. With a base of harmonics alone the physical terms are candidate effects.
    progress : callable, optional
        See `diagnosis.diagnose`.

    Returns
    -------
    NightDiagnosis
        With an ambiguous verdict the best member of each set is applied: all members predict
        nearly the same where the night has observed, and the others are in ``alternatives``. A
        linear drift in time is extrapolated as far as `carried_on` allows, then held. With the
        verdict ``withheld`` the model of `start` stays.

    Raises
    ------
    ValueError
        Too few stars.
    """
    _, zeros, follows = start
    stars = stars_without_zeros(rows, zeros, site, follows)
    if len(stars) == 0:
        raise ValueError('no star to diagnose has come yet; observe first')
    # one partition only, for a service must answer soon; held-out rows add a comparison
    search = partial(diagnose, base=base, alpha=alpha, sessions=0.0, partitions=1)
    result = search(stars, progress=progress)
    old = start if start.model is not None else ModelWithZeros(
        result.base_model, _shifted(zeros, result, result.base_model), follows)
    chosen, compared, refused = old, None, []
    blind = BlindStars(rows, site)
    if result.model.effects:
        whole = carried_on(result.model, stars)
        chosen, compared, refused = publishable(
            old, ModelWithZeros(whole, _shifted(zeros, result, whole), follows),
            {e.fitted.effect.name: e.delta_bic or 0.0 for e in result.effects}, stars, zeros,
            AmendmentComparison(blind, stars, old, search))
        if compared is None:
            result.notes.append(NOT_COMPARED)
    if len(blind):
        for entry, candidate in ((result.before, old), (result.after, chosen)):
            entry['holdout_rms_arcsec'] = rms_arcsec(*blind.residuals(candidate)).radial
        result.notes.append(f'held out: {len(blind)} rows of the same night that no fit and no '
                            'choice has seen, nothing refitted')
    document = _document(result, chosen is not old, len(blind), compared, refused)
    document['applied'], document['zeros_in_force'] = chosen.effect_names, chosen.zeros_document
    if refused:
        # the expected error is that of the active model
        document['expected'] = chosen.model.provenance.get('expected')
        document['after'] = {**document['before'], 'holdout_rms_arcsec': None}
        if chosen is not old:
            fitted_rows = rms_arcsec(*chosen.model.residuals(
                stars_without_zeros(rows, chosen.zeros, site, follows)))
            document['after'].update(rms_arcsec=fitted_rows.radial, rms_x_arcsec=fitted_rows.x,
                                     rms_y_arcsec=fitted_rows.y, cv_rms_arcsec=None)
        document['after']['holdout_rms_arcsec'] = result.after['holdout_rms_arcsec']
    if follows:
        document[FOLLOWS] = follows.document()
        document['notes'] = [*map(count_drift_line, document[FOLLOWS]), *document['notes']]
    translate = rows.mount.names.translate
    document['notes'] = list(map(translate, document['notes']))
    for entry in document['refused']:
        entry['why'] = translate(entry['why'])
    model = chosen.published(**(provenance or {}), verdict=document['verdict'], **{
        name: document[name] for name in ('wander', 'expected') if document[name]})
    document['alpha'] = alpha
    document['site_deg'] = None if site is None else [
        float(np.degrees(site[name])) for name in ('latitude', 'longitude')]
    return NightDiagnosis(start, chosen._replace(model=model), model, document, result)


def check_on_blind_stars(found, active, replaced, blind, stamp):
    """Test a diagnosis on blind stars observed after its model was published.

    Parameters
    ----------
    found : NightDiagnosis
        The verdict of its `diagnosis` is updated.
    active : ModelWithZeros
    replaced : ModelWithZeros or None
        The model active before.
    blind : BlindStars
        Those observed since `active` was published.
    stamp : int
        Stamp of the newest row, ns.

    Returns
    -------
    NightDiagnosis
        With the model active from now on: `replaced` if `active` is worse. Its document has
        ``judged``: ``rows``, ``radial``, ``az``, ``el`` and ``worse`` of the comparison,
        ``taken_back`` and ``why``. Effects taken back are in ``refused``, and in the verdict.
    """
    # single axes were compared before publication; here only the radial error decides
    compared = replaced and blind.compare(replaced, active)
    document, chosen = {**found.document, 'last_judged_ns': stamp}, active
    if compared is None:
        why = ('the model is the one of before: nothing to take back' if replaced is None else
               f'not judged: {len(blind)} blind stars since the diagnosis; at least {FEWEST} do')
        document['judged'] = {'rows': len(blind), 'taken_back': False, 'why': why}
    else:
        why = ('holds: ' if compared.holds else 'taken back: ') + comparison_sentence(
            compared, active.model.mount.names.axes)
        document['judged'] = {**compared.to_dict(), 'taken_back': not compared.holds, 'why': why}
        if not compared.holds:
            chosen = replaced
            document |= _without_effects(document, active, replaced, compared, why)
            found.diagnosis.verdict, found.diagnosis.cautions = TAKEN_BACK, [why]
    model = chosen.published(
        verdict=document['verdict'],
        judged='holds' if chosen is active else 'taken back', last_stamp_ns=stamp)
    return NightDiagnosis(found.start, chosen, model, document, found.diagnosis)


def _without_effects(document, active, replaced, compared, why):
    """Entries of a document that change if its effects are taken back."""
    names = active.effect_names or [FOLLOWS]
    return {
        'verdict': TAKEN_BACK, 'effects': [], 'published': False,
        'applied': replaced.effect_names,
        'expected': replaced.model.provenance.get('expected'),
        'after': {**document['before']}, 'zeros_in_force': replaced.zeros_document,
        'refused': [*document['refused'], {
            'effects': names, 'why': why, 'judgement': compared.to_dict(),
            'found': document['effects']}],
        'notes': [*document['notes'], f'{", ".join(names)} {why}']}


def _shifted(zeros, result, model):
    """Zeros that belong to `model`, whose index terms are the medians of the power-ons."""
    terms = {int(float(name)): values for name, values in result.run_terms.items()}
    out = zeros.filled(terms, NO_ZERO)
    for number, own in terms.items():
        first, second = model.mount.names.index
        out[number] = out[number].plus(own[first] * ARCSEC, own[second] * ARCSEC).plus(
            -model.terms[first], -model.terms[second])
    return out


def _document(result, published, kept, compared, refused):
    """Document of a `NightDiagnosis`; refused effects are moved from ``effects`` to ``refused``."""
    for entry in refused:
        result.notes.append('not published: ' + entry['why'])
    if refused:
        result.cautions = [*result.cautions, _WITHHELD_WORDS.format(
            ', '.join(name for entry in refused for name in entry['effects']))]
    document = diagnosis_document(result)
    for entry, found in zip(document['effects'], result.effects):
        entry['aliases'] = list(found.aliases)
    away = {name for entry in refused for name in entry['effects']}
    document['refused'] = [{**entry, 'found': [
        e for e in document['effects'] if e['name'] in entry['effects']]} for entry in refused]
    document['effects'] = [e for e in document['effects'] if e['name'] not in away]
    if away and not document['effects']:
        document['verdict'] = result.verdict = WITHHELD
    names = ('name', 'driver', 'axes', 'delta_bic', 'p_family', 'in_set')
    return {
        'format': FORMAT, 'version': VERSION, **document, 'kept_out': kept,
        'published': published, 'judgement': compared and compared.to_dict(),
        'ranking': [{n: line[n] for n in names} for line in result.ranking[:_RANKED]],
        'graduation': result.observations.context.graduation,
        'notes': list(dict.fromkeys(map(wording, result.notes))),
    }
