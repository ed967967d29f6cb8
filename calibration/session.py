"""What the calibration knows of a night: its observations, the zeros, the models, the report."""

from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.row_retention import kept_words
from pointing_model.zero import NO_ZERO, Zeros, zeros_in_force
from pointing_model.zero_drift import KEY as FOLLOWS
from pointing_model.zero_drift import Following
from pointing_model.zero_exposures import is_for_zero

from .analysis.encoders.count_drift import followed
from .analysis.encoders.cross_check import check_witnesses
from .analysis.external_check import power_on_check, split_half, ways
from .analysis.fit_result import named
from .analysis.harmonic_fit import HarmonicChoice, Recipe, fit_chosen, rows_of_terms
from .analysis.held_out import held_out_steps
from .analysis.sky_model import origin_of_night
from .analysis.zero.stars_zero import zero_from_exposures
from .analysis.zero.zero_changes import zero_change, zero_changes, zeros_of_night
from .distrust import notes_of, reasons
from .estimation.comparison import FEWEST, judge
from .night_rows import NightRows
from .power_on_cache import Finished, Packed
from .publication import Candidate, Published
from .report.fit_wording import origin_sentence
from .report.wording import wording
from .rows import counts, for_fitting

REPORT_FORMAT = 'telescope_mount/calibration_report'
REPORT_VERSION = 1

#: the first coefficients, with correlations in the report: of all they grow with the square
CORRELATED = 40
NO_HARMONICS = HarmonicChoice()


class CalibrationSession(NightRows):
    """Collects observations and computes from them alone; the same rows give the same numbers.

    Parameters
    ----------
    reference : PointingModel, optional
        Model of an earlier night. The zero is then the change since that night. Without it the
        zero is the whole offset at Polaris, in which IA and IE cannot be told from the other
        terms; what changed shows between two power-ons.
    split_seed : int
        Of the choice of the stars that are held out.
    yesterday : witnesses.Witness, optional
        How Polaris and the encoders stood to each other the night before.
    harmonics : HarmonicChoice
        Of the model that is published; by default none.
    power_ons : int
        As of `NightRows`: what is older has no part in anything any more.
    """

    #: of the last fit, judged again with the model that came after it, dict; None before
    report = Packed()

    def __init__(self, reference=None, split_seed=1, yesterday=None, harmonics=NO_HARMONICS,
                 power_ons=0):
        super().__init__(reference, power_ons)
        self._harmonics = harmonics
        self._degree = None  # of the harmonics of the last fit
        #: the terms alone, as `fit` found them last, and the zeros that belong to them
        self.terms_alone = None
        self._split_seed = split_seed
        self._yesterday = yesterday
        #: how Polaris and the encoders stand to each other tonight, from `fit` on
        self.witness = None
        self._finished = Finished()
        #: that `fit` made last, PointingModel
        self.model = None
        #: that was published last, PointingModel: a zero that is calibrated goes with it
        self.in_force = None
        #: by its exposures alone, a MeasuredZero of each power-on that has some
        self.zeros = Zeros()
        #: that belong to the fitted model
        self.zeros_in_force = Zeros()
        self._fitted_zeros = Zeros()  # those of the last fit, with covariances
        self._published = Published()
        self._follows = Following()
        self._homings = ()
        self._diagnosis = self._result = None

    @property
    def mount(self):
        """That of the observations, else of the model in force or the reference, `Mount`."""
        return self._rows.mount or (self.in_force or self.reference or PointingModel({})).mount

    @property
    def names(self):
        """Of its axes and terms, `mounts.Names`."""
        return self.mount.names

    def _forget(self, rows):
        """As of `NightRows`: what was made of them is gone too."""
        kept = set(self.observations()['run'].astype(int).tolist())
        self._finished.forget(kept)
        self._published.since = max(0, self._published.since - rows)
        for number in [number for number in self.zeros if number not in kept]:
            del self.zeros[number]

    def zeros_again(self):
        """For who has lost the zeros: from the rows that are there; numbers of their power-ons."""
        rows = self.observations()
        self.zeros.update(zeros_of_night(rows, self.reference, finished=self._finished)[0])
        return sorted(self.zeros)

    def calibrate_zero(self):
        """Zeros of all power-ons in which Polaris, or stars for a zero, were observed.

        Returns
        -------
        run : int
            The newest of them.
        zero : MeasuredZero
            Its zero, for pointing with the model in force, else relative to the reference.

        Raises
        ------
        ValueError
            No usable exposure for a zero in the newest power-on.
        """
        newest = self.newest
        zeros, parts = zeros_of_night(self.observations(), self.reference, newest, self._finished)
        self.zeros.update(zeros)
        if newest not in parts:
            self.zeros.pop(newest, None)  # of exposures that are not trusted any more
            raise ValueError('; '.join([
                f'Polaris was not observed since power-on {newest}, nor stars for its zero; point '
                'at them first', *reasons(self.observations())]))
        if self.in_force is None:
            return newest, self.zeros[newest]
        part = self._follows.corrected(parts[newest])
        return newest, zero_from_exposures(part, self.in_force, run=newest)

    @property
    def zero_of_model(self):
        """The newest of `zeros_in_force`, as well known as its exposures, or else its stars, say.

        Returns
        -------
        RunZero
            Where the power-on has no exposures for its zero, the covariance is that which the fit
            gives to the change since the first power-on; None of the first.
        """
        newest = self.zeros_in_force.newest
        measured = self.zeros.get(newest.run)
        if measured is not None:
            return replace(newest, by=measured.by, covariance=measured.with_fitted_terms)
        fitted = self._fitted_zeros.get(newest.run)
        return newest if fitted is None else replace(newest, covariance=fitted.covariance)

    def take_up(self, model):
        """`model` is in force: a calibration before this one has published it.

        The next fit is judged against it where it tells which zeros it went with.

        Parameters
        ----------
        model : PointingModel

        Raises
        ------
        ValueError
            What it says of its zeros is damaged.
        """
        zeros, follows = zeros_in_force(model), Following.of(model)
        self.in_force, self._errors = model, model.mount.errors
        if zeros:
            self._published.replace(Candidate(model, zeros, follows), len(self))

    def fit(self, homings=(), check=lambda report: None):
        """Fit all stars, and judge each kind of model on stars that it did not see.

        Rows with ``check`` 1 are left out: see `rows`.

        The terms are fitted together with the change of the zero from power-on to power-on, to
        stars and exposures for the zero alike: these fix most of the change, the stars help.

        Parameters
        ----------
        homings : iterable of witnesses.Homing
            What the incremental encoders say of themselves.
        check : callable
            Called with the report before anything of the fit is in force: where it raises
            ValueError, nothing will be.

        Returns
        -------
        model : PointingModel
            The physical terms, or the harmonics that were asked for, for pointing with
            `zeros_in_force`.
        report : dict
            See `REPORT_FORMAT`; JSON-ready.

        Raises
        ------
        ValueError
            Too few stars, or what `check` says.
        """
        origin = origin_of_night(for_fitting(self.observations()))
        self._errors = (origin and origin.holds) or self._errors
        observed = for_fitting(self.observations())
        follows = followed(observed)
        rows = follows.corrected(observed)
        stars = rows.select(~is_for_zero(rows))
        notes = notes_of(self.observations())
        if kept := kept_words(self.observations()['run'], self.power_ons):
            notes.append(f'the fit is {kept}')
        fitted = self._fit_terms(rows)
        self.terms_alone, section, misfits = Candidate(fitted.model, fitted.zeros), None, 0
        by_terms = fitted.weights
        if self._harmonics:
            fitted, section, findings = fit_chosen(rows, self._harmonics, self._recipe(rows),
                                                   fitted, self._split_seed)
            self._degree = section['degree']
            misfits = int(np.count_nonzero(fitted.weights[by_terms > 0.0] == 0.0))
            if misfits:
                notes.append(f'{misfits} rows are outliers to the harmonics, and not to the terms: '
                             'how wrong they are on fresh stars is not said')
            notes += map(wording, findings)
        model, zeros = fitted.model, fitted.zeros
        published = self._published_kind()
        notes += map(wording, () if section else fitted.open_directions)
        notes += [f'row {row["row"]} left out: {row["reason"]}' for row in fitted.excluded]
        rejected = fitted.rejected_stars(rows)
        notes += map(wording, [*named(rejected), *fitted.freedom_findings])
        report = {
            'format': REPORT_FORMAT, 'version': REPORT_VERSION,
            'last_stamp_ns': self.last_stamp, **rows.mount.entries(),
            **counts(rows),
            'zeros': self.zeros.to_list(),
            'changes': zero_changes(observed, sorted(self.zeros), model),
            'zeros_in_force': zeros.to_list(),
            'terms': fitted.term_rows() if not section else rows_of_terms(model),
            'correlations': fitted.correlations[:CORRELATED, :CORRELATED].tolist(),
            'condition': fitted.condition,
            'rejected': len(fitted.rejected),
            **({'outliers': [one.evidence for one in rejected]} if rejected else {}),
            **({'degrees_of_freedom': fitted.degrees_of_freedom} if fitted.few else {}),
            'steps': held_out_steps(
                rows, self._recipe, split_half(stars, self._split_seed),
                self.reference, self._first_zeros(rows), ways(self.zeros.values()), notes,
                published),
            'external_check': power_on_check(
                rows, self.reference, self._first_zeros(rows) if self.zeros else {},
                self.zeros, zero_change, notes, self._finished,
                published and ('harmonics of', *published)),
            'noise_arcsec': [s / ARCSEC for s in fitted.scatter],
            'witnesses': self._witnesses(observed, model, homings),
            'notes': notes,
        }
        if section:
            report['harmonics'] = section
        if origin is not None:
            report['origin_of_errors'] = origin.document()
            notes.append(origin_sentence(origin))
        from .session_diagnosis import expected_of_fit, replaces, with_zero
        expected = expected_of_fit(
            rows, zeros, self._harmonics.base(self._degree)) if not misfits else None
        if zeros.newest.run not in self.zeros:
            expected = with_zero(expected, zeros.newest, stars)
        report['expected'] = expected
        if follows:
            report[FOLLOWS] = follows.document()
        new = Candidate(
            PointingModel(model.terms, model.covariance, model.harmonics, {
                **model.provenance, 'last_stamp_ns': self.last_stamp,
                'reference': self._source(), **({'expected': expected} if expected else {}),
            }, model.geometry, mount=model.mount), zeros, follows)
        notes[:] = map(rows.mount.names.say, notes)
        check(report)
        self._homings, self.zeros_in_force, self._fitted_zeros = homings, zeros, zeros
        old = self._published.now
        kept = old is not None and not replaces(old, new, self.observations(), report)
        self.report = report
        if kept:
            self.zeros_in_force = old.zeros
            return old.published(refit='refused', last_stamp_ns=self.last_stamp), report
        self._published.replace(new, len(self))
        self.model, self._follows = new.model, follows
        return new.published(), report

    def diagnose(self, alpha=0.01, site=None, until=0, progress=None):
        """What the fitted model lacks, and the model with it; see `session_diagnosis`.

        Parameters
        ----------
        alpha, site, progress
            As of `session_diagnosis.amend`.
        until : int
            Rows after this stamp (ns) were not known then; 0: all are. For replays.

        Returns
        -------
        session_diagnosis.Amended
            Its zeros are `zeros_in_force` from now on. `report` is that of the fit, with the
            witnesses judged again by the amended model.

        Raises
        ------
        ValueError
            Too few stars.
        """
        from .session_diagnosis import amend
        rows = self.observations(until)
        changed = self._follow(rows)
        zeros = self._first_zeros(rows) if self.model is None else self.zeros_in_force
        provenance = {'last_stamp_ns': self.last_stamp, 'reference': self._source()}
        amended = amend(rows, zeros, self.model, provenance, alpha, site, self._follows,
                        self._harmonics.base(self._degree), progress)
        amended.document['last_stamp_ns'] = until or self.last_stamp
        amended.document['published'] |= changed
        self.zeros_in_force = amended.zeros
        self._published.replace(Candidate(amended.model, amended.zeros, self._follows),
                                len(rows))
        self._diagnosis, self._result = amended.document, amended.diagnosis
        self._judge_witnesses(rows, amended.model)
        return amended

    def _follow(self, rows):
        """Follow what wanders by now: blind stars have seen more of it than those of the fit.

        Whether that changes the model in force: only where they do not find it worse.
        """
        from .session_diagnosis import Judges
        follows = followed(rows.select(rows['star'] >= 0))
        if self.model is None:
            self._follows = follows
        if not set(follows.axes) > set(self._follows.axes):
            return False
        rows_of_fit = for_fitting(follows.corrected(rows))
        fitted = self._fit_terms(rows_of_fit)
        if self._harmonics:
            fitted = self._recipe(rows_of_fit).fit(rows_of_fit, self._harmonics, self._degree)
        found, zeros = fitted.model, fitted.zeros
        model = replace(self.model, terms=found.terms, covariance=found.covariance,
                        harmonics=found.harmonics)
        judges, new = Judges(rows, None), Candidate(model, zeros, follows)
        old = Candidate(self.model, self.zeros_in_force, self._follows)
        if len(judges) >= FEWEST and not judge(judges.left(old), judges.left(new), ()).holds:
            return False
        self.model, self.zeros_in_force, self._follows = new
        self._fitted_zeros = zeros
        return True

    def judge(self, site=None):
        """What was published last, before blind stars that came after it; see `judge_again`.

        Parameters
        ----------
        site : dict, optional
            As of `diagnose`.

        Returns
        -------
        session_diagnosis.Amended
            What is in force from now on: the model before, where the amended one is worse.

        Raises
        ------
        ValueError
            Nothing was diagnosed.
        """
        from .session_diagnosis import Amended, judge_again
        if self._diagnosis is None:
            raise ValueError('nothing was diagnosed that could be judged; diagnose first')
        rows = self.observations()
        chosen, self._diagnosis = judge_again(
            rows, self._published, self._diagnosis, self._published.since, site)
        self._diagnosis['last_judged_ns'] = self.last_stamp
        taken_back = self._diagnosis['judged']['taken_back']
        if taken_back:
            self._published.take_back()
            self._result.verdict = self._diagnosis['verdict']
            self._result.caution = self._diagnosis['judged']['why']
            self.zeros_in_force = chosen.zeros
        self._judge_witnesses(rows, chosen.model)
        model = chosen.published(verdict=self._diagnosis['verdict'],
                                 judged='taken back' if taken_back else 'holds',
                                 last_stamp_ns=self.last_stamp)
        return Amended(model, chosen.zeros, self._diagnosis, self._result)

    def _judge_witnesses(self, rows, model):
        """What the model explains is no alarm any more."""
        if self.report is not None:
            self.report = {
                **self.report, 'verdict': self._diagnosis['verdict'],
                'witnesses': self._witnesses(for_fitting(rows), model, self._homings)}

    def _witnesses(self, rows, model, homings):
        found = check_witnesses(rows, self._yesterday, model=model, homings=homings,
                                finished=self._finished)
        self.witness = found.latest
        return {'alarms': found.alarms, 'notes': found.notes}

    def _fit_terms(self, rows):
        """Terms, and the zero of each power-on that belongs to them, a FitResult."""
        from .analysis.diagnosis import check_columns
        check_columns(rows.select(~is_for_zero(rows)))
        return self._recipe(rows).terms(rows)

    def _recipe(self, rows):
        """The zero of the first power-on by its exposures, those after it from there on."""
        return Recipe(self._first_zeros(rows)[rows['run'].min()])

    def _published_kind(self):
        """What the harmonics that are published are called, and ``fit(rows, recipe)`` of them."""
        if not self._harmonics:
            return None
        return self._harmonics.label(self._degree), lambda rows, recipe: recipe.fit(
            rows, self._harmonics, self._degree)

    def _first_zeros(self, rows):
        """Zero of each power-on by its exposures; where there is none, the one before it."""
        return self.zeros.carried(map(int, np.unique(rows['run'])), first=NO_ZERO)

    def _source(self):
        if self.reference is None:
            return None
        return self.reference.provenance.get('source', 'a model of an earlier night')
