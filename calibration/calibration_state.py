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

"""The state of a calibration: rows, zeros, the active model, and what follows with each star."""

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
    """Why a model is not published, a sentence; and the `report` of its fit, where there is one."""

    def __init__(self, why, report=None):
        super().__init__(why)
        self.report = report


class CalibrationState:
    """Takes observations and computes from them alone; the same rows give the same numbers.

    Parameters
    ----------
    reference : PointingModel, optional
        Model of an earlier night. The zero is then the change since that night. Without it the
        zero is the whole offset at Polaris, in which IA and IE cannot be separated from the other
        terms; what changed shows between two power-ons.
    split_seed : int
        Of the choice of the stars that are held out.
    harmonics : HarmonicChoice
        Of the model that is published; by default none.
    power_ons : int
        So many have their rows kept, the last ones; 0: all.
    mode : {'batch', 'track'}
        track: a model after each star too.

    Attributes
    ----------
    rows : RowTable
    number : int or None
        Of the power-on that is calibrated by itself, see `NightSeries`; None: all of them together.
    zeros : Zeros
        By their exposures alone, a MeasuredZero of each power-on that has some.
    season : SeasonLog or None
        Of a `NightSeries`, what the zeros of all nights have followed.
    fitted : ModelWithZeros or None
        Of the last fit that was published, with the covariances of its zeros.
    active, replaced : ModelWithZeros or None
        What was published last, and what that replaced; no `replaced` where that is the same.
    since : int
        How many rows were known when `active` was published, of those that are still here.
    model : PointingModel or None
        That was published last: of `active`, with all that whoever points with it must know.
    terms : ModelWithZeros or None
        The terms alone, as the last fit found them.
    contradiction : Contradiction or None
        Why the last fit or diagnosis has given no model.
    report : dict or None
        Of the last fit, the encoders checked again with the model that came after it.
    encoder_zeros : EncoderZeros, StarOffsets or None
        Zeros of the encoders tonight by the sky, from `fit` on.
    tracks : bool
        Whether it follows the mount with each star.
    tracked : TrackedNight or None
        That of mode track; None: there is no model to begin with.
    requests : StarRequests
    """

    def __init__(self, reference=None, split_seed=1, harmonics=NO_HARMONICS, power_ons=0,
                 mode=BATCH):
        self.rows, self.zeros, self.season = RowTable(power_ons), Zeros(), None
        self._split_seed, self._harmonics = split_seed, harmonics
        self.tracks, self.tracked = mode == TRACK, None
        self._begin(reference)

    def _begin(self, reference, yesterday=None, number=None):
        """A night that has no model yet.

        Parameters
        ----------
        reference : PointingModel or None
        yesterday : encoder_zeros.EncoderZeros or StarOffsets, optional
            How Polaris and the encoders stood to each other the night before.
        number : int, optional
            See the class.
        """
        self.reference, self._yesterday, self.number = reference, yesterday, number
        #: whose the errors of the mount are, as the last fit found or an earlier model has it
        self._errors = None if reference is None else reference.mount.errors
        self.terms = self._degree = self._diagnosis = None
        self.fitted = self.active = self.replaced = self.model = None
        self.report = self.encoder_zeros = self.contradiction = None
        self._homings, self.since, self.requests = (), 0, StarRequests()

    # --- rows -------------------------------------------------------------------------------------

    @property
    def mount(self):
        """That of the rows, else of the active model or the reference, `Mount`."""
        return self.rows.mount or (self.model or self.reference or PointingModel({})).mount

    @property
    def last_stamp(self):
        """Of the newest row, ns; 0 before the first."""
        return self.rows.last_stamp

    def observations(self, until=0):
        """All rows so far that are calibrated together, a PointingRun.

        With `until`, those that had come by that stamp.

        Raises
        ------
        ValueError
            There is none.
        """
        run = self.rows.all(until, self.number)
        return with_errors(run, self._errors) if self._errors else run

    def add(self, run, stamp):
        """Take rows, as `RowTable.add`, and let `tracked` and `requests` follow.

        Returns
        -------
        bool
            Whether there is another tracked model.
        """
        self._take(self.rows.add, run, stamp)
        self.requests.update(self)
        if self.tracks and self.tracked is None and self.reference is not None:
            self.tracked = TrackedNight.from_reference(self.reference, run['time'][0])
        return self.tracked is not None and any(one.taken for one in self.tracked.take(run))

    def add_table(self, run, stamp):
        """Take the table of all rows so far; how many were not here, as `RowTable.add_table`."""
        count = self._take(self.rows.add_table, run, stamp)
        if count > 1:  # of a night under way, and no row that a table has overtaken
            self.zeros.update(night_zeros(self.observations(), self.reference)[0])
            self._track_rows()
        return count

    def _track_rows(self):
        """All that are here, after a start in the middle of a night."""
        if self.tracked is not None and len(self.rows):
            self.tracked.take(self.observations())

    def _take(self, take, run, stamp):
        """What `take` of the rows gives; what was made of rows that it lets go is gone too."""
        check_mount(run.mount, {'the reference model': self.reference and self.reference.mount})
        before = self.rows.forgotten
        out = take(run, stamp)
        if self.rows.forgotten > before:
            self.since = max(0, self.since - (self.rows.forgotten - before))
            for number in [n for n in self.zeros if n not in self.rows.power_on_numbers]:
                del self.zeros[number]
        return out

    def started(self, number):
        """When a power-on began, UTC s; None where its rows do not decide."""
        rows = self.observations()
        own = rows.get('encoder_start')[rows['run'] == number]
        own = own[np.isfinite(own)]
        return float(own[-1]) if len(own) else None

    # --- zeros ------------------------------------------------------------------------------------

    def _zeros_of(self, rows):
        """Of `zeros` those of the power-ons in some rows."""
        return Zeros(zero for number, zero in self.zeros.items() if number in rows['run'])

    @property
    def active_zeros(self):
        """Those that belong to the active model."""
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
            self.zeros.pop(newest, None)  # of exposures that are not trusted any more
            raise ValueError('; '.join([
                f'Polaris was not observed since power-on {newest}, nor stars for its zero; point '
                'at them first', *reasons(rows)]))
        if self.model is None or self.number is not None:
            return newest, self.zeros[newest]
        follows = self.active.follows if self.active is not None else Following()
        return newest, zero_from_exposures(
            follows.corrected(exposures[newest]), self.model, run=newest)

    def zero_of_model(self):
        """The newest active zero, as well known as its exposures, or else its stars, say.

        Returns
        -------
        PowerOnZero
            Where the power-on has no exposures for its zero, the covariance is that which the fit
            gives to the change since the first power-on; None of the first.
        """
        newest = self.active_zeros.newest
        measured = self.zeros.get(newest.run)
        if measured is not None:
            return replace(newest, by=measured.by, covariance=measured.with_fitted_terms)
        fitted = self.fitted and self.fitted.zeros.get(newest.run)
        return replace(newest, covariance=fitted.covariance) if fitted else newest

    # --- the active model -------------------------------------------------------------------------

    def take_up(self, model):
        """`model` is active: a calibration before this one has published it.

        The next fit is judged against it where it tells which zeros it went with.

        Parameters
        ----------
        model : PointingModel

        Raises
        ------
        ValueError
            What it says of its zeros is damaged.
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
        """`new` is active, published as `model`; what it replaced can come back."""
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
        """Fit all stars, and test each kind of model on stars that it did not see.

        Rows with ``check`` 1 are left out: see `rows`.

        Parameters
        ----------
        homings : iterable of cross_check.Homing
            What the incremental encoders say of themselves.

        Returns
        -------
        model : PointingModel
            The physical terms, or the harmonics that were asked for, for pointing with
            `active_zeros`; where a fit is worse on blind stars, the model that was active.
        report : dict
            See `report.night_document`; JSON-ready.

        Raises
        ------
        ValueError
            Too few stars.
        Contradiction
            What is known speaks against a model of these rows: nothing has become active.
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
        """`Contradiction` where what is known speaks against a model of these rows."""
        if why := contradiction(self.observations(), report):
            self.contradiction = Contradiction(why, report)
            raise self.contradiction

    @property
    def dated_reference(self):
        """The model of an earlier night, as it is published with a zero relative to it."""
        return replace(self.reference, provenance={
            **self.reference.provenance, 'last_stamp_ns': self.last_stamp})

    @property
    def alarms(self):
        """Of the last report, what the encoders and the sky disagree on; sentences."""
        refused = self.contradiction and self.contradiction.report
        report = refused or self.report
        return report['witnesses']['alarms'] if report else []

    def _source(self):
        """What the provenance of every model of these rows gives."""
        reference = None
        if self.reference is not None:
            reference = self.reference.provenance.get('source', 'a model of an earlier night')
        return {'last_stamp_ns': self.last_stamp, 'reference': reference}

    def _replaces(self, new, report):
        """Whether a fit is not worse than the active model on blind stars; told in its report."""
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
        """`find_effects`, and `apply` what is found, a NightDiagnosis."""
        found = self.find_effects(alpha, site, until, progress)
        self.apply(found, site, until)
        return found

    def find_effects(self, alpha=ALPHA, site=None, until=0, progress=None):
        """What the fitted model lacks; nothing of the state changes: see `apply`.

        Parameters
        ----------
        alpha, site, progress
            As of `night_diagnosis.diagnose_night`.
        until : int
            Rows after this stamp (ns) were not known then; 0: all are. For replays.

        Returns
        -------
        NightDiagnosis

        Raises
        ------
        ValueError
            Too few stars.
        Contradiction
            As of `fit`.
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
        """The model of a diagnosis is active; `report` and `requests` go with it.

        Parameters
        ----------
        found : NightDiagnosis
        site, until
            With which it was found.
        """
        rows = self.observations(until)
        if found.start.model is not None:
            self.fitted = found.start
        self._diagnosis, self.contradiction = found, None
        self._activate(found.chosen, found.model, len(rows))
        self._check_encoders_again(rows)
        self.requests.begin(self, found, site, until)

    def _start_of_diagnosis(self, rows):
        """The fit, following what drifts by now, where that does not make blind stars worse.

        Blind stars have seen more of it than those of the fit.

        Returns
        -------
        ModelWithZeros
            Without a model where nothing was fitted.
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
        """The active model before blind stars that came after the diagnosis that has made it.

        Parameters
        ----------
        site : dict, optional
            As of `find_effects`.

        Returns
        -------
        NightDiagnosis
            Of what is active from now on: the model before, where the new one is worse.

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
        """What the model explains is no alarm any more."""
        if self.report is not None:
            self.report = {
                **self.report, 'verdict': self._diagnosis.document['verdict'],
                'witnesses': self._cross_check(for_fitting(rows), self.model, self._homings)}
