"""A night's model, diagnosed on the night's own rows, with the effects found and the zeros to go
with it.
"""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.context import Context
from pointing_model.model import PointingModel
from pointing_model.rms import rms_arcsec
from pointing_model.runs.run import PointingRun
from pointing_model.zero import NO_ZERO, Zeros
from pointing_model.zero_drift import KEY as FOLLOWS
from pointing_model.zero_drift import Following
from pointing_model.zero_exposures import is_for_zero

from .analysis.diagnosis import Diagnosis, diagnose
from .analysis.diagnosis.expected_error import expected_error_of_terms
from .analysis.encoders.count_drift import follow_line
from .analysis.refit import going_on, held_within, is_drift, left_out, refitted
from .estimation.comparison import FEWEST, judge
from .publication import UNJUDGED, Candidate, publishable
from .report.fit_wording import comparison_sentence
from .report.wording import wording
from .rows import for_fitting, is_kept_out

FORMAT = 'telescope_mount/diagnosis'
VERSION = 1
#: verdict where effects were found, and none of them holds before rows that nothing has seen
WITHHELD = 'withheld'
#: verdict where blind stars found the amended model worse than the one before
TAKEN_BACK = 'taken_back'
_WITHHELD_WORDS = 'Not published, since it does not hold on rows that it has not seen: {}.'
_RANKED = 20
NOTHING_FOLLOWS = Following()
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
        ``published`` (whether the model was changed), ``judgement`` (of the change, by rows that
        nothing has seen), ``refused`` (``effects``, ``why``, ``judgement``, and ``found``: their
        entries), ``ranking``, ``zeros_in_force``, ``notes``, and what it was made with:
        ``alpha``, ``site_deg``, ``graduation`` (of the encoder, as it was declared).
    diagnosis : Diagnosis
    """

    model: PointingModel
    zeros: Zeros
    document: dict
    diagnosis: Diagnosis


def amend(rows, zeros, fitted=None, provenance=None, alpha=0.01, site=None,
          follows=NOTHING_FOLLOWS, base='physical', progress=None):
    """Diagnose a night, and add what is found.

    Stars alone are diagnosed, without the exposures for a zero: many rows in one direction would
    make one small misfit there look like an effect. Rows kept out (`rows`) judge, with nothing
    refitted: what does not hold before them is not published.

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
    follows : Following
        Zeros that follow the absolute encoder: `zeros` and `fitted` go with it.
    base : str
        The declared model, that `fitted` has (`diagnosis.base.Base.parse`). Its terms and
        harmonics are fitted with the effects, so that what harmonics can hold is no effect; to
        harmonics alone the physical terms are effects that may lack.
    progress : callable, optional
        As of `diagnosis.diagnose`.

    Returns
    -------
    Amended
        An ambiguous verdict is applied with the best member of each set: all members predict
        nearly the same where the night has observed, and the others are in ``alternatives``. A
        linear drift in time goes on as far as `carried_on` allows, then holds. With the verdict
        ``withheld`` the model in force stays.

    Raises
    ------
    ValueError
        Too few stars.
    """
    seen = for_fitting(follows.corrected(rows))
    stars = stars_of(rows, zeros, site, follows)
    if len(stars) == 0:
        raise ValueError('no star to diagnose has come yet; observe first')
    # a service must answer soon: rows kept out judge beside the cross-validation
    result = diagnose(stars, base, alpha, sessions=0.0, partitions=1, progress=progress)
    old = Candidate(fitted, zeros, follows)
    if fitted is None:
        old = Candidate(result.base_model, _shifted(zeros, result, result.base_model), follows)
    chosen, judged, refused = old, None, []
    court = Court(rows, stars, site, old, alpha, base)
    if result.model.effects:
        whole = carried_on(result.model, stars)
        chosen, judged, refused = publishable(
            old, Candidate(whole, _shifted(zeros, result, whole), follows),
            {e.fitted.effect.name: e.delta_bic or 0.0 for e in result.effects}, stars, zeros,
            court)
        if judged is None:
            result.notes.append(UNJUDGED)
    if court.kept:
        for entry, candidate in ((result.before, old), (result.after, chosen)):
            entry['holdout_rms_arcsec'] = rms_arcsec(*court.left(candidate)).radial
        result.notes.append(f'held out: {court.kept} rows of the same night that no fit and no '
                            'choice has seen, nothing refitted')
    document = _document(result, chosen is not old, court.kept, judged, refused)
    document['applied'], document['zeros_in_force'] = chosen.names, chosen.in_force
    if refused:
        # that of the model in force
        document['expected'] = chosen.model.provenance.get('expected')
        document['after'] = {**document['before'], 'holdout_rms_arcsec': None}
        if chosen is not old:
            fitted_rows = rms_arcsec(*chosen.model.residuals(_at_zero(
                seen.select(~is_for_zero(seen)), chosen.zeros, site)))
            document['after'].update(rms_arcsec=fitted_rows.radial, rms_x_arcsec=fitted_rows.x,
                                     rms_y_arcsec=fitted_rows.y, cv_rms_arcsec=None)
        document['after']['holdout_rms_arcsec'] = result.after['holdout_rms_arcsec']
    if follows:
        document[FOLLOWS] = follows.document()
        document['notes'] = [*map(follow_line, document[FOLLOWS]), *document['notes']]
    say = rows.mount.names.say
    document['notes'] = list(map(say, document['notes']))
    for entry in document['refused']:
        entry['why'] = say(entry['why'])
    model = chosen.published(**(provenance or {}), verdict=document['verdict'], **{
        name: document[name] for name in ('wander', 'expected') if document[name]})
    document['alpha'] = alpha
    document['site_deg'] = None if site is None else [
        float(np.degrees(site[name])) for name in ('latitude', 'longitude')]
    return Amended(model, chosen.zeros, document, result)


def stars_of(rows, zeros, site, follows):
    """The rows that are diagnosed: the stars, with the zeros taken off.

    Parameters
    ----------
    rows, zeros, site, follows
        As of `amend`.

    Returns
    -------
    PointingRun
    """
    seen = for_fitting(follows.corrected(rows))
    return _at_zero(seen.select(~is_for_zero(seen)), zeros, site)


def replaces(old, new, rows, report):
    """Whether a fit is not worse than what is in force, before the rows kept out.

    Parameters
    ----------
    old, new : publication.Candidate
    rows : PointingRun
        All of the night.
    report : dict
        Of the fit; gets ``judgement``, and where it is worse ``refused``, a note, and the zeros
        that stay.

    Returns
    -------
    bool
        True too where there are too few such rows.
    """
    judges = Judges(rows, None)
    if len(judges) < FEWEST:
        return True
    found = judge(judges.left(old), judges.left(new), axes=())
    report['judgement'] = found.to_dict()
    if not found.holds:
        report['refused'] = 'this fit is not published: ' + comparison_sentence(
            found, rows.mount.names.axes)
        report['notes'].append(report['refused'])
        report['zeros_in_force'] = old.in_force
    return found.holds


def judge_again(rows, published, document, since, site=None):
    """Old and new model before blind stars that came after the new one was published.

    Parameters
    ----------
    rows : PointingRun
        All of the night.
    published : publication.Published
    document : dict
        Of the diagnosis, see `Amended`.
    since : int
        Rows before this one were known when the model was made.
    site : dict, optional

    Returns
    -------
    chosen : publication.Candidate
        What is in force from now on: where the new one is worse, the old one.
    document : dict
        With ``judged``: ``rows``, ``radial``, ``az``, ``el`` and ``worse`` of the judgement,
        ``taken_back`` and ``why``. What is taken back is among ``refused``, and the verdict
        says so.
    """
    now, before = published.now, published.before
    judges = Judges(rows, site, since)
    if before is None or len(judges) < FEWEST:
        why = ('the model is the one of before: nothing to take back' if before is None else
               f'not judged: {len(judges)} blind stars since the diagnosis; at least {FEWEST} do')
        return now, {**document, 'judged': {'rows': len(judges), 'taken_back': False, 'why': why}}
    # by axis the change was judged before it was published; here it stands or falls
    found = judge(judges.left(before), judges.left(now), axes=())
    why = ('taken back: ' if not found.holds else 'holds: ') + comparison_sentence(
        found, rows.mount.names.axes)
    document = {**document, 'judged': {**found.to_dict(), 'taken_back': not found.holds,
                                       'why': why}}
    if found.holds:
        return now, document
    document.update(
        verdict=TAKEN_BACK, effects=[], published=False, applied=before.names,
        expected=before.model.provenance.get('expected'),
        after={**document['before']}, zeros_in_force=before.in_force,
        refused=[*document['refused'], {
            'effects': now.names or [FOLLOWS], 'why': why, 'judgement': found.to_dict(),
            'found': document['effects']}],
        notes=[*document['notes'], f'{", ".join(now.names or [FOLLOWS])} {why}'])
    return before, document


def carried_on(model, stars):
    """The model with its drifts in time going on as far as the night has shown.

    `diagnose` holds a driver at its value soon after the last row. The stars of tonight come
    after it: a linear drift goes on for as long as stretches left out at the end were predicted
    better with it, and is held from the last row on where they were not. One with the square of
    time would run away, and is always held.
    """
    if 'time' not in stars or not any(map(is_drift, model.effects)):
        return model
    first, last = np.nanmin(stars['time']), np.nanmax(stars['time'])
    on = [share * (last - first) for share in going_on(model, stars)]
    return replace(model, effects=[
        held_within(e, first - more, last + more) if is_drift(e) else e
        for e, more in zip(model.effects, on)])


class Judges:
    """The rows that were kept out, in order of time.

    Parameters
    ----------
    rows : PointingRun
        All of the night.
    site : dict or None
    since : int
        Rows before this one are no judges.
    """

    def __init__(self, rows, site, since=0):
        mask = is_kept_out(rows) & (rows['star'] >= 0) & (np.arange(len(rows)) >= since)
        order = np.argsort(rows['time'], kind='stable') if 'time' in rows else slice(None)
        self._rows, self._mask, self._site = rows.select(order), mask[order], site

    def __len__(self):
        return int(np.count_nonzero(self._mask))

    def left(self, candidate):
        """What a Candidate leaves of them with nothing refitted, shape (2, n), rad."""
        # what a row inherits from the one before it needs all rows
        rows = candidate.follows.corrected(self._rows)
        rows = _at_zero(rows, candidate.zeros, self._site)
        return np.array(candidate.model.residuals(rows))[:, self._mask]


class Court:
    """Judges models on rows that neither fit nor choice has seen, with nothing refitted.

    The rows that were kept out, where there are enough of them. Otherwise some of the rows of
    the night are left out, and fit and search are repeated without them.
    """

    def __init__(self, rows, stars, site, base, alpha, declared='physical'):
        self._judges = Judges(rows, site)
        self._stars, self._base, self._alpha = stars, base, alpha
        self._declared = declared
        self.kept = len(self._judges)
        self._trial = None

    def left(self, candidate):
        """What a model leaves of the rows kept out, shape (2, n), rad."""
        return self._judges.left(candidate)

    def __call__(self, candidate):
        """Judgement of a candidate against the base; None where nothing is there to judge by."""
        try:
            if self.kept >= FEWEST:
                return judge(self.left(self._base), self.left(candidate), candidate.axes)
            return self._without(candidate)
        except ValueError:  # too few rows, of those kept or those to be left out
            return None

    def _without(self, candidate):
        hidden = left_out(self._stars)
        if not hidden.any():
            return None
        seen = self._stars.select(~hidden)
        if self._trial is None:
            self._trial = diagnose(seen, self._declared, self._alpha, sessions=0.0, partitions=1)
        # what is not found without these rows is at least fitted without them
        effects = [e for e in self._trial.model.effects if e.effect.name in candidate.names] \
            or candidate.model.effects
        models = [refitted(self._trial.base_model, self._stars, own, ~hidden)[0]
                  for own in ((), effects)]
        models[1] = carried_on(models[1], seen)
        return judge(*(np.array(m.residuals(self._stars))[:, hidden] for m in models),
                     candidate.axes)


def expected_of_fit(rows, zeros, base='physical'):
    """Error to be expected of a fit on fresh stars, as `Diagnosis.expected`, or None.

    Parameters
    ----------
    rows : PointingRun
        That were fitted, with columns `star` and `run`.
    zeros : Zeros
        That belong to the fit.
    base : str
        What was fitted, see `diagnosis.base.Base.parse`.
    """
    stars = rows.select(~is_for_zero(rows))
    return expected_error_of_terms(_at_zero(stars, zeros, None), base) if len(stars) else None


def with_zero(expected, zero, rows):
    """The error to be expected where the zero is as uncertain as a few stars leave it.

    Parameters
    ----------
    expected : dict or None
        As of `expected_of_fit`.
    zero : RunZero
        Of the power-on in which is pointed, with its covariance.
    rows : PointingRun
        Where: as these lie on the sky.

    Returns
    -------
    dict or None
        With the variance of the zero; the upper limit with three times as much, which it exceeds
        in one case of twenty where both axes are as uncertain, in one of twelve where one is alone.
    """
    if expected is None or not np.isfinite(zero.sigma).all():
        return expected
    more = float(np.mean(np.cos(rows['el'])**2) * zero.sigma[0]**2 + zero.sigma[1]**2) / ARCSEC**2
    return {**expected, 'rms_arcsec': float(np.sqrt(expected['rms_arcsec']**2 + more)),
            'high_arcsec': float(np.sqrt(expected['high_arcsec']**2 + 3.0 * more))}


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
    """Zeros that go with `model`, whose index terms are the medians of the power-ons."""
    terms = {int(float(name)): values for name, values in result.run_terms.items()}
    out = zeros.filled(terms, NO_ZERO)
    for number, own in terms.items():
        first, second = model.mount.names.index
        out[number] = out[number].plus(own[first] * ARCSEC, own[second] * ARCSEC).plus(
            -model.terms[first], -model.terms[second])
    return out


def _document(result, published, kept, judged, refused):
    """See `Amended`; what was refused is no effect of it, and the verdict says so."""
    for entry in refused:
        result.notes.append('not published: ' + entry['why'])
    if refused:
        result.caution = ' '.join(filter(None, [result.caution, _WITHHELD_WORDS.format(
            ', '.join(name for entry in refused for name in entry['effects']))]))
    document = result.to_dict()
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
        'published': published, 'judgement': judged and judged.to_dict(),
        'ranking': [{n: line[n] for n in names} for line in result.ranking[:_RANKED]],
        'graduation': result.observations.context.graduation,
        'notes': list(dict.fromkeys(map(wording, result.notes))),
    }
