"""Nights in a row: the zero and the stars of each are judged by the model of an earlier one.

Paper 000, section 2: coefficients of two nights before correct the stars of tonight, before and
after the zero calibration. Each power-on is a night here.
"""

from contextlib import suppress

import numpy as np

from msg_tools.status import Taken
from msg_tools.units import ARCSEC
from pointing_model.mounts import ALTAZ
from pointing_model.rms import rms
from pointing_model.row_retention import first_of_last, kept_words
from pointing_model.runs.run import PointingRun
from pointing_model.terms import mean_columns
from pointing_model.zero import NO_ZERO, Zeros, is_for_zero, is_marked, zero_in_force

from .analysis.fit import fit_harmonics
from .analysis.satellite_check import tracking_errors
from .analysis.zero.stars_zero import zero_from_exposures
from .analysis.zero.zero_causes import zero_causes
from .analysis.zero.zero_season import SeasonLog, season_rows
from .row_store import missing
from .rows import for_fitting, is_kept_out, zero_exposures_by_run
from .session import NO_HARMONICS, CalibrationSession

#: the kinds of model, in the order of the report; the last where the model that is published, to
#: which zeros are relative, has harmonics
PHYSICAL_TERMS, HARMONICS_ONLY, PUBLISHED = 'physical', 'harmonics', 'published'


class NightSeries:
    """As `CalibrationSession`, for night after night, each a power-on of its own.

    Parameters
    ----------
    age : int
        The reference of a night is the model of so many power-ons before: 2 in the paper.
    first : PointingModel, optional
        Reference of the nights that have none.
    split_seed : int
        Of the choice of the stars that are held out.
    harmonics : HarmonicChoice
        Of the models that are published; by default none.
    power_ons : int
        Nights that are kept, the last ones; what the zeros of all have followed is kept. 0: all.

    Raises
    ------
    ValueError
        So few that the reference of tonight would be none of them.
    """

    def __init__(self, age, first=None, split_seed=1, harmonics=NO_HARMONICS, power_ons=0):
        if 0 < power_ons <= age:
            raise ValueError(f'kept_power_ons = {power_ons}: the reference of a night is {age} '
                             f'power-ons old, keep {age + 1} or more (0: all)')
        self._age, self._first, self._split_seed = age, first, split_seed
        self.power_ons = power_ons
        self._harmonics = harmonics
        self._own = PUBLISHED if harmonics else PHYSICAL_TERMS
        self._sessions, self._forgotten = {}, 0
        self._models = {}  # run -> {kind: PointingModel}, to go with the zero in force then
        self._zeros = {}  # run -> {kind: that zero}
        self._rows = {}
        self._season = SeasonLog()
        self._expected = {}  # number -> zero expected before Polaris was seen
        self.last_stamp = 0
        #: that was published last; a zero of tonight is relative to an earlier night's all the same
        self.in_force = None

    def __len__(self):
        return sum(len(session) for session in self._sessions.values())

    @property
    def taken(self):
        """As of `CalibrationSession`."""
        return Taken(len(self), self.power_ons, self._forgotten, self.last_stamp)

    def observations(self):
        """All rows so far, a PointingRun; ValueError before the first."""
        if not self._sessions:
            raise ValueError('no observation has come yet; observe first')
        return PointingRun.concatenate(
            [session.observations() for session in self._sessions.values()])

    def zeros_again(self):
        """`take_table` has calibrated the nights that are over; numbers of those with a zero."""
        return sorted(map(int, self.zeros))

    @property
    def names(self):
        """Of the axes and terms of the mount, `mounts.Names`."""
        session = next(iter(self._sessions.values()), None)
        return ALTAZ.names if session is None else session.names

    @property
    def newest(self):
        """Number of the newest power-on; ValueError before the first row."""
        if not self._sessions:
            raise ValueError('no observation has come yet; observe first')
        return max(self._sessions)

    @property
    def zeros(self):
        """By its exposures alone, a MeasuredZero of each night that has some."""
        return Zeros(zero for session in self._sessions.values()
                     for zero in session.zeros.values())

    @property
    def zeros_in_force(self):
        """That belong to the fitted model of each night."""
        return Zeros(zero for session in self._sessions.values()
                     for zero in session.zeros_in_force.values())

    @property
    def zero_of_model(self):
        """As of `CalibrationSession`, of the newest night that is fitted."""
        return self._sessions[self.zeros_in_force.newest.run].zero_of_model

    @property
    def reference(self):
        """The model that the zero of tonight is relative to, or None."""
        return self._reference(self.newest)

    def _reference(self, run, kind=None):
        """Of `run`: the model that was published, or one of another kind."""
        kind = kind or self._own
        old = self._models.get(run - self._age)
        if old is not None:
            return old.get(kind)
        return self._first if kind == self._own else None

    def _zero_then(self, run, kind):
        """The zero that was in force with the reference of `run`."""
        old = self._zeros.get(run - self._age)
        return old[kind] if old else zero_in_force(self._first)

    def add(self, run, stamp):
        """Take rows; see `CalibrationSession.add`."""
        if stamp <= self.last_stamp:
            return
        if 'run' not in run:
            raise ValueError('observation without column run')
        for number in map(int, np.unique(run['run'])):
            if number not in self._sessions:
                yesterday = self._sessions.get(number - 1)
                self._sessions[number] = CalibrationSession(
                    self._reference(number), self._split_seed, yesterday and yesterday.witness,
                    self._harmonics)
            self._sessions[number].add(run.select(run['run'] == number), stamp)
        self.last_stamp = stamp
        if self.power_ons:
            for number in sorted(self._sessions)[:-self.power_ons]:
                self._forgotten += len(self._sessions[number])
                for known in (self._sessions, self._models, self._zeros, self._rows,
                              self._expected):
                    known.pop(number, None)

    def take_table(self, run, stamp):
        """Take the table of all rows so far, if there is more in it than here.

        Where rows are missing that are not the last ones, the nights of the table that are over
        are calibrated and fitted again: their models are the references of those to come.

        Returns
        -------
        int
            As of `CalibrationSession.take_table`.
        """
        if 'run' not in run:
            raise ValueError('observation without column run')
        table = run.select(slice(first_of_last(run['run'], self.power_ons), None))
        numbers = list(map(int, np.unique(table['run'])))
        here = [self._sessions[number].observations() for number in numbers
                if number in self._sessions]
        count, new = missing(table, PointingRun.concatenate(here) if here else None)
        if stamp < self.last_stamp or count <= 0:
            return 0
        if new is not None and here and set(new['run']) <= {self.newest}:
            self.last_stamp = 0
            self.add(new, stamp)
            return count
        calibrated = {number for number, session in self._sessions.items()
                      if number in session.zeros}
        for known in (self._sessions, self._models, self._zeros, self._rows):
            for number in numbers:
                known.pop(number, None)
        self._season.clear_zeros(numbers)
        for number in numbers:
            if number != numbers[0]:
                with suppress(ValueError):
                    self.calibrate_zero()
                with suppress(ValueError):
                    self.fit()
            self.last_stamp = 0
            self.add(table.select(table['run'] == number), stamp)
        # tonight's too, if it had been: a table may overtake the last row before the fit
        if self.newest in calibrated:
            with suppress(ValueError):
                self.calibrate_zero()
        return count

    def calibrate_zero(self):
        """Zero of tonight; see `CalibrationSession.calibrate_zero`."""
        return self._sessions[self.newest].calibrate_zero()

    def fit(self, homings=(), check=lambda report: None):
        """Fit tonight, and judge tonight's stars by the model of the earlier night.

        Parameters
        ----------
        homings : iterable of witnesses.Homing
            What the incremental encoders say of themselves.
        check : callable
            As of `CalibrationSession.fit`.

        Returns
        -------
        model : PointingModel
            Of tonight.
        report : dict
            As of `CalibrationSession.fit`; ``nights`` holds a row for every night so far that
            has a reference and a zero, ``power_ons`` one (of `season.season_rows`) for every
            power-on with a zero, ``zero_causes`` what these follow (`zero_causes.zero_causes`),
            and ``zero_expected`` what was expected of tonight's before (`SeasonLog.expected`).

        Raises
        ------
        ValueError
            Too few stars.
        """
        number = self.newest
        session = self._sessions[number]
        model, report = session.fit(homings, check)
        rows = session.observations()
        zero = session.zeros_in_force.get(number, NO_ZERO)
        stars = for_fitting(rows)
        self._models[number], self._zeros[number] = {self._own: model}, {self._own: zero}
        if self._harmonics:
            terms = session.terms_alone
            zero = terms.zeros.get(number, NO_ZERO)
            self._models[number][PHYSICAL_TERMS] = terms.model
        self._zeros[number].update({PHYSICAL_TERMS: zero, HARMONICS_ONLY: zero})
        with suppress(ValueError):  # too few stars for 13 of them: the report's notes say so
            self._models[number][HARMONICS_ONLY] = fit_harmonics(stars, zero=zero).model
        if number in session.zeros and self._reference(number) is not None:
            self._rows[number] = self._night(number, rows, report['witnesses']['alarms'])
        report['nights'] = [self._rows[n] for n in sorted(self._rows)]
        self._judge_zeros(number, rows, model, report)
        if kept := kept_words(list(self._sessions), self.power_ons):
            report['notes'].append(f'the nights are {kept}')
        return model, report

    def _judge_zeros(self, number, rows, model, report):
        """What the zeros of the season follow, and how well tonight's was expected."""
        self.expect()
        exposures = dict(zero_exposures_by_run(rows))
        if number in exposures:
            with suppress(ValueError):  # too few of them
                self._season.measured(number, exposures[number], model)
        season = self._season.season()
        report['power_ons'] = season_rows(season)
        report['zero_causes'] = zero_causes(season, leave_out=False)
        report['zero_expected'] = self._expected.get(number)

    def hear(self, homings):
        """What the incremental encoders say of their marks; see `season.SeasonLog.hear`."""
        self._season.hear(homings)

    def expect(self):
        """The zero of tonight before Polaris is seen, from the nights before.

        Returns
        -------
        dict or None
            See `season.SeasonLog.expected`; ValueError before the first row of tonight.
        """
        number = self.newest
        self._season.begin(number, self._sessions[number].observations())
        self._expected[number] = self._season.expected(number)
        return self._expected[number]

    def diagnose(self, alpha=0.01, site=None, until=0, progress=None):
        """What tonight's model lacks; see `CalibrationSession.diagnose`.

        Later nights keep the model without the effects as their reference: what follows the time
        of one night says nothing about another.
        """
        return self._sessions[self.newest].diagnose(alpha, site, until, progress)

    def judge(self, site=None):
        """What was published tonight, before blind stars; see `CalibrationSession.judge`."""
        return self._sessions[self.newest].judge(site)

    @property
    def report(self):
        """Of tonight's last fit; see `CalibrationSession.report`."""
        return self._sessions[self.newest].report

    def _night(self, number, rows, alarms):
        exposures = is_for_zero(rows)
        stars = (rows['star'] >= 0) & ~is_kept_out(rows)
        first, last = rows['time'][exposures][[0, -1]]
        parts = {'before': rows.select(stars & ~exposures & (rows['time'] < first)),
                 'after': rows.select(stars & ~exposures & (rows['time'] > last))}
        out = {'night': number, 'reference': number - self._age}
        for kind in (PHYSICAL_TERMS, HARMONICS_ONLY, PUBLISHED):
            reference = self._reference(number, kind)
            if reference is None:
                continue
            then = self._zero_then(number, kind)
            zero = zero_from_exposures(rows.select(exposures), reference)
            out[kind] = {'zero': zero.to_dict(),
                         'change_az_arcsec': (zero.az - then.az) / ARCSEC,
                         'change_el_arcsec': (zero.el - then.el) / ARCSEC}
            for part, in_force in (('before', then), ('after', zero)):
                if len(parts[part]):
                    out[kind][part] = _means(reference, parts[part], in_force)
            if kind == PHYSICAL_TERMS:
                if 'after' in out[kind]:
                    out[kind]['after'].update(
                        _budget(reference, zero, rows.select(exposures), parts['after']))
                track = rows['star'] < 0
                out['satellite'] = None if not track.any() else {
                    'before': tracking_errors(
                        reference, rows.select(track & (rows['time'] < first)), then),
                    'after': tracking_errors(
                        reference, rows.select(track & (rows['time'] > last)), zero)}
        out['alarms'] = alarms
        return out


def _means(model, stars, zero):
    """Mean, scatter and RMS of the stars' residuals, arcsec.

    ``az`` is the coordinate angle, as the paper's table 1 is read here; ``x`` is it on the sky.
    """
    x, y = (v / ARCSEC for v in model.residuals(stars, zero=zero))
    az = x / np.cos(stars['el'])
    out = {'stars': len(stars)}
    for name, values in (('az', az), ('x', x), ('el', y)):
        out[f'{name}_mean_arcsec'] = float(np.mean(values))
        out[f'{name}_std_arcsec'] = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
        out[f'{name}_rms_arcsec'] = rms(values)
    out['radial_max_arcsec'] = float(np.max(np.hypot(x, y)))
    out['radial_rms_arcsec'] = rms(x, y)
    return out


def _budget(model, zero, exposed, stars):
    """1-sigma of the two means after calibration, as the errors of all that went in predict it.

    The exposures for the zero, the scatter of the stars, and what the reference model's covariance
    leaves between the place of Polaris (or of the stars for the zero) and the mean of the stars.
    """
    names = tuple(model.terms)
    at_stars, at_zero = (mean_columns(names, run['az'], run['el'], run.mount)
                         for run in (stars, exposed))
    if is_marked(exposed).any():
        at_zero = zero.contained(names)
    apart = at_stars - at_zero
    # the zero's covariance has that of the model there, which cancels but for `apart`
    exposures = zero.covariance - at_zero @ model.covariance @ at_zero.T
    x, y = model.residuals(stars, zero=zero)
    az = x / np.cos(stars['el'])
    n = len(stars)
    scatter = np.array([np.var(az, ddof=1), np.var(y, ddof=1)]) / n
    variance = np.diag(exposures) + np.diag(apart @ model.covariance @ apart.T) + scatter
    sigma = np.sqrt(np.maximum(variance, 0.0)) / ARCSEC
    return {'az_sigma_arcsec': float(sigma[0]), 'el_sigma_arcsec': float(sigma[1])}

