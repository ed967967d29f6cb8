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

"""A series of nights: the zero and the stars of each are tested with the model of an earlier night.

Paper 000, section 2: coefficients from two nights before correct tonight's stars, before and after
the zero calibration. Each power-on is a night here.
"""

from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.pointing_terms import mean_columns
from pointing_model.rms import rms
from pointing_model.runs.run import kept_words
from pointing_model.zero import NO_ZERO, active_zero, is_for_zero, is_marked

from .analysis.external_check import tracking_errors
from .analysis.harmonic_fit import choice_of
from .analysis.term_fit import fit_harmonics
from .analysis.tracking import BATCH, TRACK
from .analysis.zero.power_on_zeros import zero_from_exposures
from .analysis.zero.zero_causes import zero_causes
from .analysis.zero.zero_season import SeasonLog, season_rows
from .calibration_state import NO_HARMONICS, CalibrationState
from .report.wording import worded
from .rows import for_fitting, is_kept_out, zero_exposures_by_power_on

#: kinds of model, in the order of the report; the last if the published model, to which zeros are
#: relative, has harmonics
PHYSICAL_TERMS, HARMONICS_ONLY, PUBLISHED = 'physical', 'harmonics', 'published'


def state_of(parameters, reference=None):
    """The state of a calibration with given parameters.

    Parameters
    ----------
    parameters : dict
        Parameters of the node, or some of them.
    reference : PointingModel, optional
        Model of an earlier night.

    Returns
    -------
    CalibrationState or NightSeries

    Raises
    ------
    ValueError
        Parameters contradict each other.
    """
    age, mode = parameters.get('reference_age', 0), parameters.get('mode', BATCH)
    common = (reference, parameters.get('split_seed', 1), choice_of(parameters),
              parameters.get('kept_power_ons', 0))
    if not age:
        return CalibrationState(*common, mode)
    if mode == TRACK:
        raise ValueError('mode track follows one night after the other by itself: leave out '
                         'reference_age')
    return NightSeries(age, *common)


@dataclass
class _Night:
    """Results of a night that later nights refer to."""

    models: dict = field(default_factory=dict)  # kind -> (PointingModel, its active zero)
    row: dict | None = None  # entry in the report's `nights`
    encoder_zeros: object = None  # see `CalibrationState`


class NightSeries(CalibrationState):
    """State of a series of nights, one power-on each.

    Parameters
    ----------
    age : int
        The reference of a night is the model of this number of power-ons before: 2 in the paper.
    first : PointingModel, optional
        Reference of nights that have none in the series.
    split_seed : int
        Random seed for the choice of held-out stars.
    harmonics : HarmonicChoice
        Harmonics in the published models; by default none.
    power_ons : int
        Number of nights, the last ones, that are kept; 0: all. The log of all zeros and their
        causes is always kept.

    Raises
    ------
    ValueError
        `power_ons` is so small that the reference of a night would not be kept.
    """

    def __init__(self, age, first=None, split_seed=1, harmonics=NO_HARMONICS, power_ons=0):
        if 0 < power_ons <= age:
            raise ValueError(f'kept_power_ons = {power_ons}: the reference of a night is {age} '
                             f'power-ons old, keep {age + 1} or more (0: all)')
        super().__init__(first, split_seed, harmonics, power_ons)
        self._age, self._first = age, first
        self._own = PUBLISHED if harmonics else PHYSICAL_TERMS
        self._nights, self.season = {}, SeasonLog()  # number -> _Night

    def _take(self, take, run, stamp):
        out = super()._take(take, run, stamp)
        for number in [n for n in self._nights if n not in self.rows.power_on_numbers]:
            del self._nights[number]
        if len(self.rows) and self.rows.newest != self.number:
            self._begin_night(self.rows.newest)
        return out

    def _begin_night(self, number):
        if self.number in self._nights:
            self._nights[self.number].encoder_zeros = self.encoder_zeros
        yesterday = self._nights.get(number - 1)
        self._nights[number] = _Night()
        reference, _ = self._then(number, self._own)
        self._begin(reference, yesterday and yesterday.encoder_zeros, number)

    def _then(self, number, kind):
        """The reference model of a kind for night `number`, and its zero; None if there is none."""
        old = self._nights.get(number - self._age)
        if old is not None and old.models:
            return old.models.get(kind, (None, None))
        return (self._first if kind == self._own else None), active_zero(self._first)

    def add_table(self, run, stamp):
        """Add the table of all rows so far, if it has more rows.

        If rows other than the last ones were missing, the past nights of the table are calibrated
        and fitted again, for their models are the references of later nights.

        Returns
        -------
        int
            See `CalibrationState.add_table`.
        """
        known, (_, new) = len(self.rows), self.rows.missing(run)
        count = self._take(self.rows.add_table, run, stamp)
        if not count or known and new is not None and np.all(new['run'] == self.number):
            return count
        numbers = [n for n in self.rows.power_on_numbers if n in run['run']]
        calibrated = {n for n in numbers if self.zeros.pop(n, None)}
        for number in numbers:
            self._nights.pop(number, None)
        self.season.clear_zeros(numbers)
        for number in numbers:
            self._begin_night(number)
            # tonight's zero too if it was known: a table may overtake the last row before the fit
            if number != numbers[-1] or number in calibrated:
                with suppress(ValueError):
                    self.calibrate_zero()
            if number != numbers[-1]:
                with suppress(ValueError):
                    self.fit()
        return count

    def fit(self, homings=()):
        """Fit tonight's rows, and test tonight's stars with the model of the earlier night.

        Parameters
        ----------
        homings : iterable of cross_check.Homing
            Reported by the incremental encoders.

        Returns
        -------
        model : PointingModel
            Tonight's model. Later nights use it as reference without the effects that a diagnosis
            adds: a dependence on time in one night does not carry over to another.
        report : dict
            See `CalibrationState.fit`; in addition ``nights``, a row for every night so far with
            a reference and a zero; ``power_ons``, a row (of `season.season_rows`) for every
            power-on with a zero; ``zero_causes``, the causes of these zeros
            (`zero_causes.zero_causes`); and ``zero_expected``, the prediction of tonight's zero
            (`SeasonLog.expected`).

        Raises
        ------
        ValueError
            Too few stars.
        Contradiction
            See `CalibrationState.fit`.
        """
        model, report = super().fit(homings)
        number, night, rows = self.number, self._nights[self.number], self.observations()
        night.models = {self._own: (model, self.active_zeros.get(number, NO_ZERO))}
        if self._harmonics:
            night.models[PHYSICAL_TERMS] = self.terms.model, self.terms.zeros.get(number, NO_ZERO)
        zero = night.models[PHYSICAL_TERMS][1]
        with suppress(ValueError):  # too few stars for 13 of them: the report's notes say so
            night.models[HARMONICS_ONLY] = fit_harmonics(for_fitting(rows), zero=zero).model, zero
        if number in self.zeros and self.reference is not None:
            night.row = self._row(number, rows, report['witnesses']['alarms'])
        kept = kept_words(list(self._nights), self.rows.power_ons)
        return model, {
            **report, 'nights': [self._nights[n].row for n in sorted(self._nights)
                                 if self._nights[n].row],
            **self._season_of(number, rows, model),
            'notes': [*report['notes'], *([f'the nights are {kept}'] if kept else [])]}

    def _season_of(self, number, rows, model):
        """Causes of the zeros of the season, and the prediction of tonight's zero."""
        expected = self.expect()
        exposures = dict(zero_exposures_by_power_on(rows))
        if number in exposures:
            with suppress(ValueError):  # too few of them
                self.season.add_zero(number, exposures[number], model)
        season = self.season.season()
        return {'power_ons': season_rows(season),
                'zero_causes': worded(zero_causes(season, leave_out=False)),
                'zero_expected': expected}

    def expect(self):
        """Predict tonight's zero from earlier nights, before Polaris is observed.

        Returns
        -------
        dict or None
            See `zero_season.SeasonLog.expected`; ValueError before the first row of tonight.
        """
        self.season.add_power_on(self.number, self.observations())
        return self.season.expected(self.number)

    def _row(self, number, rows, alarms):
        exposures = is_for_zero(rows)
        stars = (rows['star'] >= 0) & ~is_kept_out(rows)
        first, last = rows['time'][exposures][[0, -1]]
        parts = {'before': rows.select(stars & ~exposures & (rows['time'] < first)),
                 'after': rows.select(stars & ~exposures & (rows['time'] > last))}
        out = {'night': number, 'reference': number - self._age}
        for kind in (PHYSICAL_TERMS, HARMONICS_ONLY, PUBLISHED):
            reference, then = self._then(number, kind)
            if reference is None:
                continue
            zero = zero_from_exposures(rows.select(exposures), reference)
            out[kind] = {'zero': zero.to_dict(),
                         'change_az_arcsec': (zero.az - then.az) / ARCSEC,
                         'change_el_arcsec': (zero.el - then.el) / ARCSEC}
            for part, active in (('before', then), ('after', zero)):
                if len(parts[part]):
                    out[kind][part] = _means(reference, parts[part], active)
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

    ``az`` is the encoder angle (our reading of the paper's table 1); ``x`` the same on the sky.
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
    """1-sigma of the two means after calibration, predicted from the error budget.

    Contributions: the exposures for the zero, the scatter of the stars, and the covariance of the
    reference model for the difference between the place of Polaris (or of the stars for the zero)
    and the mean of the stars.
    """
    names = tuple(model.terms)
    at_stars, at_zero = (mean_columns(names, run['az'], run['el'], run.mount)
                         for run in (stars, exposed))
    if is_marked(exposed).any():
        at_zero = zero.contained(names)
    change = at_stars - at_zero
    # the zero's covariance includes that of the model there, which cancels but for `change`
    exposures = zero.covariance - at_zero @ model.covariance @ at_zero.T
    x, y = model.residuals(stars, zero=zero)
    az = x / np.cos(stars['el'])
    n = len(stars)
    scatter = np.array([np.var(az, ddof=1), np.var(y, ddof=1)]) / n
    variance = np.diag(exposures) + np.diag(change @ model.covariance @ change.T) + scatter
    sigma = np.sqrt(np.maximum(variance, 0.0)) / ARCSEC
    return {'az_sigma_arcsec': float(sigma[0]), 'el_sigma_arcsec': float(sigma[1])}
