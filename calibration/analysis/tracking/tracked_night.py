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

"""A tracked night: rows from the observer, and the model after each.

The initial model is in the provenance of every later model. So the last model and the rows of the
night are sufficient: the same rows give the same numbers live, after a restart and from the log.
"""

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.model_document import KEY, from_document, identity
from pointing_model.rms import rms, sigma_of
from pointing_model.runs.run import PointingRun
from pointing_model.zero import PowerOnZero
from pointing_model.zero_held_terms import BROAD

from ...distrust import distrusted
from ...rows import LEAST_SIGMA, is_kept_out
from ..camera_faults import SAME_ROWS
from .history import PAST, RATES, Past, rate_weights_of
from .innovations import Measurement
from .smoother import smooth
from .tracker import Tracker
from .warm_start import WarmStart

#: noise of a star if the model has no RMS of its fit, rad
NOISE = 1.5 * ARCSEC
#: largest number of last events and innovations kept
MOST_EVENTS, MOST_NIS = 50, 500
#: 95 % of chi squared with two degrees of freedom
_BEYOND = -2.0 * np.log(0.05)
#: smallest assumed age of a model from another night, ns
_A_DAY = 86_400_000_000_000
#: age of a model with a record of earlier nights: just before the first star, ns
_BEFORE = 10**9
#: fewest readings to estimate the noise of a sensor
_FEWEST = 8


class TrackedNight:
    """A tracker fed with rows of observations.

    Parameters
    ----------
    model : PointingModel
        Initial model. If it has a record of earlier nights (`history`), the first stars decide
        what has changed since.
    zero : PowerOnZero
        Zero used with it; widened if it is of another power-on.
    stamp : int
        Time at which the model was valid, ns; earlier rows are in the model already.
    noise : (float, float), optional
        1 sigma of a star along x and y, rad, for rows without ``sigma_x`` and ``sigma_y``; by
        default the fit RMS of the model. Given sigmas are multiplied by the ratios found in the fit
        of the model.
    difference, lean : dict, optional
        Absolute - incremental encoder until then, see `difference_of`, and tilt of the base, see
        `lean_of`; None: not used as a sensor.
    rates : list of dict, optional
        Drift rates of such nights, see `history.Rates.document`; by default those in the model.

    Attributes
    ----------
    zero : PowerOnZero
        Subtracted from all readings. It stays fixed: changes go to the index terms.
    updates : list of TrackerUpdate
        Updates from the rows taken last.
    measurements : list of Measurement or None
        Measurements of the tracker since `keep`.
    """

    def __init__(self, model, zero, stamp, noise=None, difference=None, lean=None, rates=None):
        # use the model as written to JSON and read again, as everywhere else
        self._document = json.loads(model.to_json())
        self._evening = from_document(self._document)
        # rounded like stamps that come back from the column of times
        self._began, self.zero, self._first_zero = _rounded(stamp * 1e-9), zero, zero
        self._rates = rates or model.provenance.get(RATES)
        noise = noise or _noise_of(model)
        # factors of given sigmas, as found in the fit of the model
        self._ratios = _pair(self._evening.provenance.get('sigma_ratios'), 1.0)
        self._noise, self._difference, self._lean = tuple(noise), difference, lean
        self._absolute_start = difference and difference['absolute_start']
        self._last, self._taken = [], self._began  # rows; stamp of the last one
        # findings; NIS of stars without an event, at the star before neither
        self._events, self._nis, self._calm = [], [], True
        self.updates, self.measurements, self._at_first = [], None, None
        self._sensors = [name for name, known in (
            ('difference', difference), ('inclinometer', lean)) if known]
        self._tracker = self._tracker_of(self._evening, self._began)
        past = Past.from_model(self._evening)
        self._warm_start = None if past is None else WarmStart(self._evening, past)
        self._started = None  # probabilities of the hypotheses of the warm start
        for axis in (0, 1) if difference else ():
            self._tracker.difference(self._began, axis, difference['apart'][axis],
                                     difference['sigma'][axis])
        if lean:
            self._tracker.inclinometer(self._began, *lean['lean'], lean['sigma'])

    def _tracker_of(self, model, stamp):
        tracker = Tracker(model, stamp, sensors=self._sensors)
        weights = rate_weights_of(self._rates, tracker.facts)
        return tracker if weights is None else Tracker(
            model, stamp, sensors=self._sensors, rate_weights=weights)

    @classmethod
    def from_reference(cls, model, first):
        """A night that begins with the model of an earlier one.

        Parameters
        ----------
        model : PointingModel
        first : float
            UTC of the first row, s.
        """
        first = int(first * 1e9)
        held = model.provenance.get('last_stamp_ns')
        held = held if isinstance(held, int) else first
        # a model with earlier nights is a prediction for this one: the scatter of nights is in it
        return cls(model, PowerOnZero(0.0, 0.0), first - _BEFORE if PAST in model.provenance
                   else min(held, first - _A_DAY))

    @classmethod
    def from_model(cls, model):
        """The beginning of a night from a later model of it; the rows must be taken again.

        Raises
        ------
        ValueError
            The model was not tracked, or its record of the evening is damaged.
        """
        kept = model.provenance.get(KEY)
        if not isinstance(kept, dict) or 'evening' not in kept:
            raise ValueError('a model that was not tracked')
        begun = kept['evening']
        try:
            zero = PowerOnZero(*begun['zero_rad'], run=begun['run'], started=begun['encoder_start'])
            return cls(from_document(begun['model']), zero, begun['stamp'], begun['noise'],
                       begun['difference'], begun['lean'], begun.get('rates'))
        except (KeyError, TypeError) as err:
            raise ValueError(f'the evening of a tracked model is damaged: {err}') from None

    def keep(self):
        """Store measurements from now on, for `smoothed`."""
        self.measurements, self._at_first = [], deepcopy(self._tracker)

    def smoothed(self):
        """The night smoothed with all measurements since `keep`, a `SmoothedNight`."""
        return smooth(self._at_first, self.measurements)

    @property
    def stars(self):
        """Number of stars taken."""
        return self._tracker.stars

    def take(self, rows):
        """Take rows of the night; earlier ones are in the model already.

        Parameters
        ----------
        rows : PointingRun
            In order. Validation rows, satellites and distrusted rows are skipped.

        Returns
        -------
        list of TrackerUpdate
            One for each star considered, and for sensor readings that reveal an event; also in
            `updates`.

        Raises
        ------
        ValueError
            The rows have no time.
        """
        if 'time' not in rows:
            raise ValueError('observation without column time')
        self.updates = []
        for i in range(len(rows)):
            own = rows.select([i])
            stamp = _rounded(own['time'][0])
            if stamp <= self._taken:
                continue  # taken already, or in the model of the evening
            self._taken = stamp
            # a frozen camera is detected from the rows before, never from later ones
            self._last = [*self._last[1 - SAME_ROWS:], own]
            if own['star'][0] < 0 or is_kept_out(own)[0] or distrusted(
                    PointingRun.concatenate(self._last))[-1]:
                continue
            self._note_power_on(own, stamp)
            if self._difference:
                self._take_difference(own, stamp)
            if self._lean and 'lean_north' in own and np.isfinite(own['lean_north'][0]):
                self._take_sensor('inclinometer', stamp, (
                    float(own['lean_north'][0]), float(own['lean_west'][0]), self._lean['sigma']))
            given = self._given_noise(own)
            update = self._take_star(stamp, (
                float(own['az'][0]), float(own['el'][0]), *self._offsets(own),
                given or self._noise, f'{own["star"][0]:.0f}',
                Context.from_run(own) if self._evening.effects else None), given)
            self.updates.append(update)
            self._note(update)
        return self.updates

    def _take_star(self, stamp, values, given):
        """Pass a star to the tracker, or, for the first ones of a night, to the warm start."""
        start = self._warm_start
        if start is None:
            return self._update('star', stamp, values)
        update = self._tracker.star(stamp, *values)  # for the prediction before this star
        if not update.taken:
            return update
        *place_and_offset, _, _, context = values
        start.take(*place_and_offset, context, given)
        self._tracker = self._tracker_of(start.model(), stamp)
        self._tracker.filter.count = start.stars
        self._started = start.document()
        update = replace(update, chances=dict.fromkeys(update.chances, 0.0), events=(),
                         consistency=None)
        if start.over:
            self._end_warm_start()
            update = replace(update, events=(start.finding(),))
        return update

    def _end_warm_start(self):
        self._warm_start = None
        if self.measurements is not None:
            self.keep()

    def model(self, stamp):
        """The current `PointingModel`, with all data needed to reproduce it.

        Parameters
        ----------
        stamp : int
            Time of the newest observation, ns.
        """
        model, tracker = self._tracker.model(), self._tracker
        walk = np.sqrt(np.diag(np.tensordot(tracker.rate_weights, tracker.filter.rates, 1)))
        # drop the record of earlier nights, which has been used
        kept = {key: value for key, value in self._evening.provenance.items() if key != PAST}
        return replace(model, provenance={
            **kept, 'last_stamp_ns': stamp, KEY: {
                'stars': tracker.stars,
                'walk_arcsec_per_root_hour': dict(zip(model.terms, (walk / ARCSEC).tolist())),
                'jumps_per_hour': sum(jump.per_hour for jump in tracker.filter.jumps),
                'evening': {
                    'model': self._document, 'stamp': self._began,
                    'zero_rad': self._first_zero.angles.tolist(), 'run': self._first_zero.run,
                    'encoder_start': self._first_zero.started, 'noise': list(self._noise),
                    'difference': self._difference, 'lean': self._lean,
                    'rates': self._rates}}})

    def pair(self, stamp):
        """`model`, and the zero used with it: all uncertainty is in the model."""
        model = self.model(stamp)
        return model, replace(self.zero, covariance=np.zeros((2, 2)),
                              model=identity(model.to_json()))

    def document(self):
        """The last updates and the expected errors, for JSON, with findings; arcsec."""
        tracker = self._tracker
        # a ring at 45 deg elevation represents the sky
        az, el = np.arange(0.0, 2.0 * np.pi, np.pi / 4.0), np.full(8, np.pi / 4.0)
        expected = [tracker.expected(az, el, 60.0 * minutes) for minutes in (0.0, 10.0, 60.0)]
        return {
            'stars': tracker.stars, 'stamp': tracker.stamp,
            'expected_arcsec': {name: rms(one.radial) / ARCSEC
                                for name, one in zip(('now', '10 min', '1 h'), expected)},
            'chance_of_a_jump_in_1_h': expected[-1].jump, 'rates_arcsec_per_root_hour': {
                name: value / ARCSEC if name != 'who' else value
                for name, value in tracker.rates().items()},
            'confidence': tracker.consistency.verdict,
            'confidence_sentence': tracker.consistency.finding(),
            'noise_factor': tracker.consistency.noise,
            'walk_factor': tracker.consistency.walk, 'notes': tracker.notes,
            'innovations': {'stars': len(self._nis), 'mean_square': (
                float(np.mean(self._nis)) / 2.0 if self._nis else None),
                'beyond_95': int(np.count_nonzero(np.array(self._nis) > _BEYOND)),
                'squares': [round(float(v), 4) for v in self._nis]},
            'events': self._events, **({'opening': self._started} if self._started else {}),
            'heard': [one.document() for one in self.updates]}

    def _update(self, what, stamp, values):
        measurement = Measurement(what, stamp, values)
        if self.measurements is not None:
            self.measurements.append(measurement)
        return self._tracker.update(measurement)

    def _take_sensor(self, what, stamp, values):
        """Pass a sensor reading to the tracker; record the update if it reveals an event."""
        update = self._update(what, stamp, values)
        if update.events:
            self.updates.append(update)
            self._note(update)

    def _note(self, update):
        self._events = [*self._events, *({'stamp': update.stamp, 'text': finding}
                                         for finding in update.findings)][-MOST_EVENTS:]
        if update.taken and update.what == 'star':
            calm, self._calm = self._calm, update.chances['nothing'] > 0.5
            if calm and self._calm:
                self._nis = [*self._nis, update.nis][-MOST_NIS:]

    def _note_power_on(self, row, stamp):
        run = float(row['run'][0])
        if run == self.zero.run:
            return
        # before the first star a power-on is already in the scatter of earlier nights
        if self._warm_start is None or self._warm_start.stars:
            self._update('power_on', stamp, ((0, 1), BROAD))
            if self._warm_start is not None:
                self._end_warm_start()
        started = float(row['encoder_start'][0]) if 'encoder_start' in row else None
        self.zero = replace(self.zero, run=run, started=started)

    def _take_difference(self, row, stamp):
        if 'az_abs' not in row:
            return
        start = float(row['absolute_start'][0]) if 'absolute_start' in row else None
        if start != self._absolute_start:  # the zero of the absolute encoder has changed, too
            self._tracker.reference.clear()
            self._absolute_start = start
        for axis, name in enumerate(('az', 'el')):
            first = self._difference['apart'][axis]
            read = float(row[f'{name}_abs'][0] - row[f'{name}_enc'][0])
            if np.isfinite(read):  # whole turns, which one of them may not count, are ignored
                self._take_sensor('difference', stamp, (
                    axis, first + float(wrap(read - first)), self._difference['sigma'][axis]))

    def _given_noise(self, row):
        """Noise given in a row, (x, y), rad; None if it has none."""
        given = [float(row.get(f'sigma_{axis}', [np.nan])[0]) for axis in 'xy']
        if not all(np.isfinite(one) and one > LEAST_SIGMA for one in given):
            return None
        return tuple(one * ratio for one, ratio in zip(given, self._ratios))

    def _offsets(self, row):
        x, y = PointingRun({**row.columns, **{
            f'{axis}_enc': row[f'{axis}_enc'] - angle
            for axis, angle in zip(('az', 'el'), self.zero.angles)}}, row.meta).offsets()
        return float(x[0]), float(y[0])


def _rounded(seconds):
    return int(np.rint(seconds * 1e9))


def difference_of(rows):
    """Current absolute - incremental encoder, and the scatter of one reading of it.

    Parameters
    ----------
    rows : PointingRun
        In order.

    Returns
    -------
    dict or None
        ``apart`` and ``sigma`` of each axis, rad, and ``absolute_start``, for the newest power-on.
        None: too few readings, or no absolute encoder.
    """
    if 'az_abs' not in rows:
        return None
    own = rows.select(rows['run'] == rows['run'].max())
    start = float(own['absolute_start'][-1]) if 'absolute_start' in own else None
    if start is not None:
        own = own.select(own['absolute_start'] == start)
    out = {'apart': [], 'sigma': [], 'absolute_start': start}
    for name in ('az', 'el'):
        read = own[f'{name}_abs'] - own[f'{name}_enc']
        read = read[np.isfinite(read)]
        if len(read) < _FEWEST:
            return None
        level, sigma = _level(read[-1] + wrap(read - read[-1]))
        out['apart'].append(level)
        out['sigma'].append(sigma)
    return out if min(out['sigma']) > 0.0 else None


def lean_of(rows):
    """Current tilt of the base, and the scatter of one reading of it.

    Parameters
    ----------
    rows : PointingRun
        In order.

    Returns
    -------
    dict or None
        ``lean`` to the north and west and ``sigma``, rad. None: too few readings, or none.
    """
    if 'lean_north' not in rows:
        return None
    read = np.array([rows['lean_north'], rows['lean_west']])
    read = read[:, np.isfinite(read).all(axis=0)]
    if read.shape[1] < _FEWEST:
        return None
    lean, sigma = _level(read)
    return {'lean': lean, 'sigma': sigma} if sigma > 0.0 else None


def _level(read):
    """Median of the last readings (..., n), and 1 sigma of one from successive differences."""
    return (np.median(read[..., -_FEWEST:], axis=-1).tolist(),
            float(sigma_of(np.diff(read)) / np.sqrt(2.0)))


def _noise_of(model):
    left = model.provenance.get('fitted_rms_arcsec')
    left = left if isinstance(left, dict) else {}
    return tuple(one * ARCSEC for one in _pair((left.get('x'), left.get('y')), NOISE / ARCSEC))


def _pair(values, otherwise):
    """Two positive numbers of x and y; `otherwise` for both if `values` are not that."""
    try:
        pair = tuple(map(float, values))
    except (TypeError, ValueError):
        pair = ()
    good = len(pair) == 2 and np.isfinite(pair).all() and min(pair) > 0.0
    return pair if good else (otherwise, otherwise)
