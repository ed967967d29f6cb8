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

"""The state of a calibration: rows, zeros, the active model, and updates with each star."""

from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.model_document import KEY as TRACKED
from pointing_model.runs.run import kept_words
from pointing_model.zero import Zeros, active_zeros
from pointing_model.zero_drift import KEY as FOLLOWS
from pointing_model.zero_drift import Following

from .analysis.encoders.cross_check import cross_check
from .analysis.encoders.zero_following import zero_following
from .analysis.harmonic_fit import HarmonicChoice
from .analysis.sky_model import origin_of_night, with_errors
from .analysis.tracking import BATCH, TRACK
from .analysis.tracking.history import RATES
from .analysis.tracking.tracked_night import TrackedNight, difference_of, lean_of
from .analysis.zero.power_on_zeros import night_zeros, zero_from_exposures
from .distrust import contradiction, notes_of, reasons
from .estimation.false_alarms import ALPHA
from .night_fit import (
    expected_error,
    first_zeros,
    fit_night,
    fit_terms_of,
    recipe_of,
    report_of,
)
from .publication import BlindStars, ModelWithZeros
from .report.encoder_wording import cross_check_texts
from .report.fit_wording import comparison_sentence, origin_sentence
from .row_table import RowTable
from .rows import check_mount, for_fitting
from .star_requests import StarRequests

NO_HARMONICS = HarmonicChoice()


class Contradiction(ValueError):
    """Reason why a model is not published, a sentence; and the `report` of its fit, if any."""

    def __init__(self, why, report=None):
        super().__init__(why)
        self.report = report


class CalibrationState:
    """State computed from the observations alone: the same rows give the same numbers.

    Parameters
    ----------
    reference : PointingModel, optional
        Model of an earlier night. The zero is then the change since that night. Without it the
        zero is the whole offset at Polaris, in which IA and IE cannot be separated from the other
        terms; only changes between power-ons are then known.
    split_seed : int
        Random seed for the choice of held-out stars.
    harmonics : HarmonicChoice
        Harmonics in the published model; by default none.
    power_ons : int
        Number of power-ons, the last ones, whose rows are kept; 0: all.
    mode : {'batch', 'track'}
        track: the model is also updated after each star.

    Attributes
    ----------
    rows : RowTable
    number : int or None
        The power-on calibrated by itself, see `NightSeries`; None: all are calibrated together.
    zeros : Zeros
        From the exposures for a zero alone: a MeasuredZero for each power-on that has some.
    season : SeasonLog or None
        For a `NightSeries`, the zeros of all nights and their causes.
    fitted : ModelWithZeros or None
        The last published fit, with the covariances of its zeros.
    active, replaced : ModelWithZeros or None
        The active model and the one before it; `replaced` is None where both predict the same.
    since : int
        Number of rows (of those still kept) when `active` was published.
    model : PointingModel or None
        The model of `active` as published, with all that is needed to point with it.
    terms : ModelWithZeros or None
        The terms alone, from the last fit.
    contradiction : Contradiction or None
        Why the last fit or diagnosis has given no model.
    report : dict or None
        Report of the last fit; its encoder cross-check is repeated with a later model.
    encoder_zeros : EncoderZeros, StarOffsets or None
        Tonight's zeros of the encoders measured on the sky, from `fit` on.
    tracks : bool
        Whether the model is updated with each star.
    tracked : TrackedNight or None
        Adaptive model of mode track; None: there is no initial model.
    requests : StarRequests
    """

    def __init__(self, reference=None, split_seed=1, harmonics=NO_HARMONICS, power_ons=0,
                 mode=BATCH):
        self.rows, self.zeros, self.season = RowTable(power_ons), Zeros(), None
        self._split_seed, self._harmonics = split_seed, harmonics
        self.tracks, self.tracked = mode == TRACK, None
        self._begin(reference)

    def _begin(self, reference, yesterday=None, number=None):
        """Start a night without a model.

        Parameters
        ----------
        reference : PointingModel or None
        yesterday : encoder_zeros.EncoderZeros or StarOffsets, optional
            Zeros of the encoders on Polaris the night before.
        number : int, optional
            See the class.
        """
        self.reference, self._yesterday, self.number = reference, yesterday, number
        #: where the errors act (`Mount.errors`), from the last fit or an earlier model
        self._errors = None if reference is None else reference.mount.errors
        self.terms = self._degree = self._diagnosis = None
        self.fitted = self.active = self.replaced = self.model = None
        self.report = self.encoder_zeros = self.contradiction = None
        self._homings, self.since, self.requests = (), 0, StarRequests()

    # --- rows -------------------------------------------------------------------------------------

    @property
    def mount(self):
        """`Mount` of the rows, else of the active model or the reference."""
        return self.rows.mount or (self.model or self.reference or PointingModel({})).mount

    @property
    def last_stamp(self):
        """Stamp of the newest row, ns; 0 before the first."""
        return self.rows.last_stamp

    def observations(self, until=0):
        """All rows so far that are calibrated together, a PointingRun.

        With `until`, those received by that stamp.

        Raises
        ------
        ValueError
            There are none.
        """
        run = self.rows.all(until, self.number)
        return with_errors(run, self._errors) if self._errors else run

    def add(self, run, stamp):
        """Add rows, see `RowTable.add`, and update `tracked` and `requests`.

        Returns
        -------
        bool
            Whether the adaptive model has changed.
        """
        self._take(self.rows.add, run, stamp)
        self.requests.update(self)
        if self.tracks and self.tracked is None and self.reference is not None:
            self.tracked = TrackedNight.from_reference(self.reference, run['time'][0])
        return self.tracked is not None and any(one.taken for one in self.tracked.take(run))

    def add_table(self, run, stamp):
        """Add the table of all rows so far; returns the number of new rows, see `RowTable`."""
        count = self._take(self.rows.add_table, run, stamp)
        if count > 1:  # a night in progress; one row would only be overtaken by its table
            self.zeros.update(night_zeros(self.observations(), self.reference)[0])
            self._track_rows()
        return count

    def _track_rows(self):
        """Update the adaptive model with all rows, after a start in mid-night."""
        if self.tracked is not None and len(self.rows):
            self.tracked.take(self.observations())

    def _take(self, take, run, stamp):
        """Add rows by `take` and return its result; drop what depends on rows it has forgotten."""
        check_mount(run.mount, {'the reference model': self.reference and self.reference.mount})
        before = self.rows.forgotten
        out = take(run, stamp)
        if self.rows.forgotten > before:
            self.since = max(0, self.since - (self.rows.forgotten - before))
            for number in [n for n in self.zeros if n not in self.rows.power_on_numbers]:
                del self.zeros[number]
        return out

    def started(self, number):
        """Time at which a power-on began, UTC s; None where its rows do not give it."""
        rows = self.observations()
        own = rows.get('encoder_start')[rows['run'] == number]
        own = own[np.isfinite(own)]
        return float(own[-1]) if len(own) else None

    # --- zeros ------------------------------------------------------------------------------------

    def _zeros_of(self, rows):
        """Those of `zeros` whose power-ons are in some rows."""
        return Zeros(zero for number, zero in self.zeros.items() if number in rows['run'])

    @property
    def active_zeros(self):
        """Zeros of the active model."""
        return Zeros() if self.active is None else self.active.zeros

    def calibrate_zero(self):
        """Zeros of all power-ons in which Polaris, or stars for a zero, were observed.

        Returns
        -------
        run : int
            The newest of them.
        zero : MeasuredZero
            Its zero, for pointing with the active model; without one, or of a power-on that is
            calibrated by itself, relative to the reference.

        Raises
        ------
        ValueError
            No usable exposure for a zero in the newest power-on.
        """
        rows = self.observations()
        newest = self.rows.newest if self.number is None else self.number
        zeros, exposures = night_zeros(rows, self.reference, newest)
        self.zeros.update(zeros)
        if newest not in exposures:
            self.zeros.pop(newest, None)  # its exposures are no longer trusted
            raise ValueError('; '.join([
                f'Polaris was not observed since power-on {newest}, nor stars for its zero; point '
                'at them first', *reasons(rows)]))
        if self.model is None or self.number is not None:
            return newest, self.zeros[newest]
        follows = self.active.follows if self.active is not None else Following()
        return newest, zero_from_exposures(
            follows.corrected(exposures[newest]), self.model, run=newest)

    def zero_of_model(self):
        """The newest active zero, with the covariance from its exposures, or else from its stars.

        Returns
        -------
        PowerOnZero
            If the power-on has no exposures for its zero, the covariance is that of the fitted
            change since the first power-on; None for the first.
        """
        newest = self.active_zeros.newest
        measured = self.zeros.get(newest.run)
        if measured is not None:
            return replace(newest, by=measured.by, covariance=measured.with_fitted_terms)
        fitted = self.fitted and self.fitted.zeros.get(newest.run)
        return replace(newest, covariance=fitted.covariance) if fitted else newest

    # --- the active model -------------------------------------------------------------------------

    def take_up(self, model):
        """Make `model` active, which an earlier calibration process has published.

        The next fit is compared with it if it contains its zeros.

        Parameters
        ----------
        model : PointingModel

        Raises
        ------
        ValueError
            The zeros in its provenance are damaged.
        """
        if self.tracks and TRACKED in model.provenance:
            self.tracked = TrackedNight.from_model(model)
            self._track_rows()
            return
        zeros, follows = active_zeros(model), Following.from_model(model)
        self.model, self._errors = model, model.mount.errors
        if zeros:
            self.active, self.since = ModelWithZeros(model, zeros, follows), len(self.rows)

    def _activate(self, new, model, since):
        """Make `new` active, published as `model`; the replaced one is kept to be restored."""
        same = self.active is not None and new.predicts_as(self.active)
        self.replaced = None if same else self.active
        self.active, self.since = new, since
        self._publish(model)

    def _publish(self, model):
        self.model = model
        if not self.tracks:
            return
        rows, noise = self.observations(), (self.report or {}).get('noise_arcsec')
        self.tracked = TrackedNight(
            model, self.active_zeros.newest, self.last_stamp,
            noise and tuple(float(v) * ARCSEC for v in noise), difference_of(rows), lean_of(rows),
            self.reference and self.reference.provenance.get(RATES))

    # --- fit --------------------------------------------------------------------------------------

    def fit(self, homings=()):
        """Fit all stars, and test each kind of model on held-out stars.

        Rows with ``check`` 1 are excluded: see `rows`.

        Parameters
        ----------
        homings : iterable of cross_check.Homing
            Reported by the incremental encoders.

        Returns
        -------
        model : PointingModel
            The physical terms, or the requested harmonics, for pointing with `active_zeros`. If
            the fit is worse on blind stars, the active model is kept.
        report : dict
            See `report.night_document`; JSON-ready.

        Raises
        ------
        ValueError
            Too few stars.
        Contradiction
            There is evidence against any model of these rows; the active model stays.
        """
        self._refuse_contradicted()
        origin = origin_of_night(for_fitting(self.observations()))
        self._errors = (origin and origin.holds) or self._errors
        rows, how = self.observations(), (self._harmonics, self._split_seed)
        notes, zeros = notes_of(rows), self._zeros_of(rows)
        kept = kept_words(self.rows.power_on_numbers, self.rows.power_ons)
        if kept and self.number is None:
            notes.append(f'the fit is {kept}')
        night = fit_night(rows, zeros, *how)
        self.terms = ModelWithZeros(night.terms.model, night.terms.zeros)
        self._degree = night.harmonics and night.harmonics['degree']
        report = report_of(night, zeros, self.reference, *how, notes)
        report |= {'last_stamp_ns': self.last_stamp,
                   'witnesses': self._cross_check(night.observed, night.chosen.model, homings),
                   'expected': expected_error(night, zeros, self._harmonics)}
        if origin is not None:
            report['origin_of_errors'] = origin.document()
            report['notes'].append(origin_sentence(origin))
        if night.follows:
            report[FOLLOWS] = night.follows.document()
        report['notes'] = list(map(self.mount.names.translate, report['notes']))
        self._refuse_contradicted(report)
        self.contradiction, self._homings = None, homings
        model, expected = night.chosen.model, report['expected']
        new = ModelWithZeros(PointingModel(model.terms, model.covariance, model.harmonics, {
            **model.provenance, **self._source(), **({'expected': expected} if expected else {})},
            model.geometry, mount=model.mount), night.chosen.zeros, night.follows)
        kept = self.active is not None and not self._replaces(new, report)
        self.report = report
        if kept:
            self._publish(self.active.published(refit='refused', last_stamp_ns=self.last_stamp))
        else:
            self.fitted = new
            self._activate(new, new.published(), len(rows))
        return self.model, report

    def _refuse_contradicted(self, report=None):
        """Raise `Contradiction` where there is evidence against any model of these rows."""
        if why := contradiction(self.observations(), report):
            self.contradiction = Contradiction(why, report)
            raise self.contradiction

    @property
    def dated_reference(self):
        """The reference model as published with a zero relative to it."""
        return replace(self.reference, provenance={
            **self.reference.provenance, 'last_stamp_ns': self.last_stamp})

    @property
    def alarms(self):
        """Disagreements of encoders and sky in the last report; sentences."""
        refused = self.contradiction and self.contradiction.report
        report = refused or self.report
        return report['witnesses']['alarms'] if report else []

    def _source(self):
        """Provenance common to all models of these rows."""
        reference = None
        if self.reference is not None:
            reference = self.reference.provenance.get('source', 'a model of an earlier night')
        return {'last_stamp_ns': self.last_stamp, 'reference': reference}

    def _replaces(self, new, report):
        """Whether a fit is not worse than the active model on blind stars; noted in its report."""
        compared = BlindStars(self.observations()).compare(self.active, new)
        if compared is None:
            return True
        report['judgement'] = compared.to_dict()
        if not compared.holds:
            report['refused'] = 'this fit is not published: ' + comparison_sentence(
                compared, self.mount.names.axes)
            report['notes'].append(report['refused'])
            report['zeros_in_force'] = self.active.zeros_document
        return compared.holds

    def _cross_check(self, rows, model, homings):
        found = cross_check(rows, self._yesterday, model=model, homings=homings)
        self.encoder_zeros = found.latest
        return {key: cross_check_texts(findings, self.mount.names) for key, findings in (
            ('alarms', found.alarms), ('notes', found.notes))}

    # --- diagnosis --------------------------------------------------------------------------------

    def diagnose(self, alpha=ALPHA, site=None, until=0, progress=None):
        """`find_effects`, then `apply` the result, a NightDiagnosis."""
        found = self.find_effects(alpha, site, until, progress)
        self.apply(found, site, until)
        return found

    def find_effects(self, alpha=ALPHA, site=None, until=0, progress=None):
        """Diagnose which effects the fitted model lacks, without changing the state (see `apply`).

        Parameters
        ----------
        alpha, site, progress
            See `night_diagnosis.diagnose_night`.
        until : int
            Ignore rows after this stamp (ns), for replays; 0: use all.

        Returns
        -------
        NightDiagnosis

        Raises
        ------
        ValueError
            Too few stars.
        Contradiction
            See `fit`.
        """
        from .night_diagnosis import diagnose_night
        self._refuse_contradicted()
        rows = self.observations(until)
        start = self._start_of_diagnosis(rows)
        found = diagnose_night(rows, start, self._source(), alpha, site,
                               self._harmonics.base(self._degree), progress)
        found.document['last_stamp_ns'] = until or self.last_stamp
        found.document['published'] |= self.fitted is not None and start is not self.fitted
        return found

    def apply(self, found, site=None, until=0):
        """Make the model of a diagnosis active, and update `report` and `requests`.

        Parameters
        ----------
        found : NightDiagnosis
        site, until
            Arguments of the `find_effects` that found it.
        """
        rows = self.observations(until)
        if found.start.model is not None:
            self.fitted = found.start
        self._diagnosis, self.contradiction = found, None
        self._activate(found.chosen, found.model, len(rows))
        self._check_encoders_again(rows)
        self.requests.begin(self, found, site, until)

    def _start_of_diagnosis(self, rows):
        """The fit to diagnose: refitted for count drifts found since, unless worse on blind stars.

        Blind stars have seen more of a drift than the stars of the fit.

        Returns
        -------
        ModelWithZeros
            Without a model if nothing was fitted.
        """
        follows, old = zero_following(rows.select(rows['star'] >= 0)), self.fitted
        zeros = self._zeros_of(rows)
        if old is None:
            return ModelWithZeros(None, first_zeros(zeros, rows), follows)
        if not set(follows.axes) > set(old.follows.axes):
            return old
        rows_of_fit = for_fitting(follows.corrected(rows))
        fitted = fit_terms_of(zeros, rows_of_fit)
        if self._harmonics:
            fitted = recipe_of(zeros, rows_of_fit).fit(
                rows_of_fit, self._harmonics, self._degree)
        new = ModelWithZeros(replace(
            old.model, terms=fitted.model.terms, covariance=fitted.model.covariance,
            harmonics=fitted.model.harmonics), fitted.zeros, follows)
        compared = BlindStars(rows).compare(old, new)
        return new if compared is None or compared.holds else old

    def check_on_blind_stars(self, site=None):
        """Test the active model on blind stars observed after its diagnosis.

        Parameters
        ----------
        site : dict, optional
            See `find_effects`.

        Returns
        -------
        NightDiagnosis
            With the model that is active from now on: the earlier one if the new one is worse.

        Raises
        ------
        ValueError
            Nothing was diagnosed.
        """
        if self._diagnosis is None:
            raise ValueError('nothing was diagnosed that could be judged; diagnose first')
        from .night_diagnosis import check_on_blind_stars
        rows = self.observations()
        found = self._diagnosis = check_on_blind_stars(
            self._diagnosis, self.active, self.replaced, BlindStars(rows, site, self.since),
            self.last_stamp)
        if found.chosen is not self.active:
            self.active, self.replaced = self.replaced, None
        self._publish(found.model)
        self._check_encoders_again(rows)
        return found

    def _check_encoders_again(self, rows):
        """Repeat the encoder cross-check: errors that the model explains are no alarms any more."""
        if self.report is not None:
            self.report = {
                **self.report, 'verdict': self._diagnosis.document['verdict'],
                'witnesses': self._cross_check(for_fitting(rows), self.model, self._homings)}
