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

"""A night's model, diagnosed on the night's own rows, with the effects found and the zeros to go
with it.
"""

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
#: verdict where effects were found, and none of them holds before rows that nothing has seen
WITHHELD = 'withheld'
#: verdict where blind stars found the amended model worse than the one before
TAKEN_BACK = 'taken_back'
_WITHHELD_WORDS = 'Not published, since it does not hold on rows that it has not seen: {}.'
_RANKED = 20


@dataclass
class NightDiagnosis:
    """What a model lacked, and the model with it.

    Attributes
    ----------
    start : ModelWithZeros
        That was diagnosed, without the effects; its model is None where nothing was fitted.
    chosen : ModelWithZeros
        For pointing; `start` where nothing is to be added.
    model : PointingModel
        That of `chosen`, with the provenance with which it is published.
    document : dict
        JSON-ready: the keys of `Diagnosis.to_dict`, and ``applied`` (names of the effects in
        `model`), ``aliases`` of each effect, ``kept_out`` (how many rows were there to judge by),
        ``published`` (whether the model was changed), ``judgement`` (of the change, by rows that
        nothing has seen), ``refused`` (``effects``, ``why``, ``judgement``, and ``found``: their
        entries), ``ranking``, ``zeros_in_force``, ``notes``, and what it was made with:
        ``alpha``, ``site_deg``, ``graduation`` (of the encoder, as it was declared).
    diagnosis : Diagnosis
    """

    start: ModelWithZeros
    chosen: ModelWithZeros
    model: PointingModel
    document: dict
    diagnosis: Diagnosis


def diagnose_night(rows, start, provenance=None, alpha=ALPHA, site=None, base='physical',
                   progress=None):
    """Diagnose a night, and add what is found.

    Stars alone are diagnosed, without the exposures for a zero: many rows in one direction would
    make one small misfit there look like an effect. Rows kept out (`rows`) compare, with nothing
    refitted: what does not hold before them is not published.

    Parameters
    ----------
    rows : PointingRun
        All rows of the night, with columns `star` and `run`.
    start : ModelWithZeros
        The fit; a power-on without a zero has that before it. With the verdict ``none`` it stays
        as it is. Without a model the base that is diagnosed is fitted.
    provenance : dict, optional
        Of the new model.
    alpha : float
        Chance that a clean night gets any effect.
    site : dict, optional
        ``latitude``, ``longitude``, rad; without it what follows the stars cannot be determined.
    base : str
        The declared model, that of `start` (`diagnosis.base.Base.parse`). Its terms and
        harmonics are fitted with the effects, so that what harmonics can hold is no effect; to
        harmonics alone the physical terms are effects that may lack.
    progress : callable, optional
        As of `diagnosis.diagnose`.

    Returns
    -------
    NightDiagnosis
        An ambiguous verdict is applied with the best member of each set: all members predict
        nearly the same where the night has observed, and the others are in ``alternatives``. A
        linear drift in time goes on as far as `carried_on` allows, then holds. With the verdict
        ``withheld`` the model of `start` stays.

    Raises
    ------
    ValueError
        Too few stars.
    """
    _, zeros, follows = start
    stars = stars_without_zeros(rows, zeros, site, follows)
    if len(stars) == 0:
        raise ValueError('no star to diagnose has come yet; observe first')
    # a service must answer soon: rows kept out compare beside the cross-validation
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
        # that of the active model
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
    """A diagnosis tested by blind stars that came after its model was published.

    Parameters
    ----------
    found : NightDiagnosis
        The verdict of its `diagnosis` changes with the comparison.
    active : ModelWithZeros
    replaced : ModelWithZeros or None
        What was active before.
    blind : BlindStars
        Since `active` was published.
    stamp : int
        Of the newest row, ns.

    Returns
    -------
    NightDiagnosis
        With what is active from now on: where `active` is worse, `replaced`. In its document
        ``judged``: ``rows``, ``radial``, ``az``, ``el`` and ``worse`` of the comparison,
        ``taken_back`` and ``why``. What is taken back is among ``refused``, and the verdict
        says so.
    """
    # by axis the change was tested before it was published; here it stands or falls
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
    """What of a document is another where its effects are taken back."""
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
    """Zeros that go with `model`, whose index terms are the medians of the power-ons."""
    terms = {int(float(name)): values for name, values in result.run_terms.items()}
    out = zeros.filled(terms, NO_ZERO)
    for number, own in terms.items():
        first, second = model.mount.names.index
        out[number] = out[number].plus(own[first] * ARCSEC, own[second] * ARCSEC).plus(
            -model.terms[first], -model.terms[second])
    return out


def _document(result, published, kept, compared, refused):
    """See `NightDiagnosis`; what was refused is no effect of it, and the verdict says so."""
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
