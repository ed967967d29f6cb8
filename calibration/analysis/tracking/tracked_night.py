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

"""A night that is tracked: rows as the observer takes them, and the model after each.

The model that it begins with is in the provenance of every model that comes of it, so that
who has the last one and the rows of the night has all: the same rows give the same numbers, here,
after a restart and from the log.
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

#: noise of a star where the model does not tell what it left, rad
NOISE = 1.5 * ARCSEC
#: events and innovations that are kept: the last ones
MOST_EVENTS, MOST_NIS = 50, 500
#: 95 % of chi squared with two degrees of freedom
_BEYOND = -2.0 * np.log(0.05)
#: a model of a file that does not tell when it held is of another night, ns
_A_DAY = 86_400_000_000_000
#: of a model that says of the nights before: just before the first star, ns
_BEFORE = 10**9
#: readings from which the noise of absolute - incremental encoder is found
_FEWEST = 8


class TrackedNight:
    """A tracker that is fed with rows of observations.

    Parameters
    ----------
    model : PointingModel
        To begin with. One that has the nights before (`history`) stands for them: the first
        stars decide what has happened since.
    zero : PowerOnZero
        That goes with it; of another power-on it is widened.
    stamp : int
        When the model held, ns; rows up to then are in it.
    noise : (float, float), optional
        1 sigma of a star along x and y, rad, whose row has no ``sigma_x`` and ``sigma_y``; by
        default what the model left of its own rows. Given ones count times what they were found
        to be too small or too large by when the model was fitted.
    difference, lean : dict, optional
        Absolute - incremental encoder up to then, of `difference_of`, and what the base leans, of
        `lean_of`; None: it is no sensor.
    rates : list of dict, optional
        How fast such nights drift, as of `history.Rates.document`; by default what the model
        says of it.

    Attributes
    ----------
    zero : PowerOnZero
        Taken off all readings. It stays: the index terms follow.
    updates : list of TrackerUpdate
        Of the rows that were taken last.
    measurements : list of Measurement or None
        What the tracker took since `keep`.
    """

    def __init__(self, model, zero, stamp, noise=None, difference=None, lean=None, rates=None):
        # what is written down and read again is the model, here as anywhere else
        self._document = json.loads(model.to_json())
        self._evening = from_document(self._document)
        # as it comes back from the column of times
        self._began, self.zero, self._first_zero = _rounded(stamp * 1e-9), zero, zero
        self._rates = rates or model.provenance.get(RATES)
        noise = noise or _noise_of(model)
        self._ratios = _ratios_of(self._evening)
        self._noise, self._difference, self._lean = tuple(noise), difference, lean
        self._absolute_start = difference and difference['absolute_start']
        self._last, self._taken = [], self._began  # rows; stamp of the last one
        self._events, self._nis = [], []  # what was called; of stars before which nothing happened
        self.updates, self.measurements, self._at_first = [], None, None
        self._sensors = [name for name, known in (
            ('difference', difference), ('inclinometer', lean)) if known]
        self._tracker = self._tracker_of(self._evening, self._began)
        past = Past.from_model(self._evening)
        self._warm_start = None if past is None else WarmStart(self._evening, past)
        self._started = None  # how likely each hypothesis of the warm start was
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
        # one that says of nights is of this one: how far nights differ is in it
        return cls(model, PowerOnZero(0.0, 0.0), first - _BEFORE if PAST in model.provenance
                   else min(held, first - _A_DAY))

    @classmethod
    def from_model(cls, model):
        """The night as it began, from a model that came of it; it has to take its rows again.

        Raises
        ------
        ValueError
            It did not, or what it says of it is damaged.
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
        """Keep measurements from now on, for `smoothed`."""
        self.measurements, self._at_first = [], deepcopy(self._tracker)

    def smoothed(self):
        """The night by all of its measurements since `keep`, a `SmoothedNight`."""
        return smooth(self._at_first, self.measurements)

    @property
    def stars(self):
        """How many were taken."""
        return self._tracker.stars

    def take(self, rows):
        """Take rows of the night; those before the begin are in the model already.

        Parameters
        ----------
        rows : PointingRun
            In order. Rows to judge by, satellites and what is not trusted are left out.

        Returns
        -------
        list of TrackerUpdate
            Of each star that was looked at, and of sensors where they make something known; also
            in `updates`.

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
                continue  # it is known, or in the model of the evening
            self._taken = stamp
            # one that froze is known by the rows before it, never by those after
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
        """To the tracker; one of the first of a night to what it is made of."""
        start = self._warm_start
        if start is None:
            return self._update('star', stamp, values)
        update = self._tracker.star(stamp, *values)  # what was expected before it
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
        """The `PointingModel` by now, with all that is needed to come to it again.

        Parameters
        ----------
        stamp : int
            Of the newest observation, ns.
        """
        model, tracker = self._tracker.model(), self._tracker
        walk = np.sqrt(np.diag(np.tensordot(tracker.rate_weights, tracker.filter.rates, 1)))
        # the nights before are in it by now
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
        """`model`, and the zero that goes with it: all that is not known is in the model."""
        model = self.model(stamp)
        return model, replace(self.zero, covariance=np.zeros((2, 2)),
                              model=identity(model.to_json()))

    def document(self):
        """The last updates and how well the mount is known, for JSON, with findings; arcsec."""
        tracker = self._tracker
        # a ring at middle height stands for the sky
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
        """A reading of a sensor counts among the updates where it makes something known."""
        update = self._update(what, stamp, values)
        if update.events:
            self.updates.append(update)
            self._note(update)

    def _note(self, update):
        self._events = [*self._events, *({'stamp': update.stamp, 'text': finding}
                                         for finding in update.findings)][-MOST_EVENTS:]
        if update.taken and update.what == 'star' and update.chances['nothing'] > 0.5:
            self._nis = [*self._nis, update.nis][-MOST_NIS:]

    def _note_power_on(self, row, stamp):
        run = float(row['run'][0])
        if run == self.zero.run:
            return
        # from night to night they are switched on: that is in what is known of nights before
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
        if start != self._absolute_start:  # its zero is another one too
            self._tracker.reference.clear()
            self._absolute_start = start
        for axis, name in enumerate(('az', 'el')):
            first = self._difference['apart'][axis]
            read = float(row[f'{name}_abs'][0] - row[f'{name}_enc'][0])
            if np.isfinite(read):  # turns that one of them does not count are no matter
                self._take_sensor('difference', stamp, (
                    axis, first + float(wrap(read - first)), self._difference['sigma'][axis]))

    def _given_noise(self, row):
        """Of a row that has its own, (x, y), rad; None of others."""
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
    """Absolute - incremental encoder as it stands, and how much one reading of it scatters.

    Parameters
    ----------
    rows : PointingRun
        In order.

    Returns
    -------
    dict or None
        ``apart`` and ``sigma`` of each axis, rad, and ``absolute_start``; of the newest
        power-on. None: too few readings, or no absolute encoder.
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
    """What the base leans as it stands, and how much one reading of it scatters.

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
    """Median of the last readings (..., n), and 1 sigma of one by the differences of neighbours."""
    return (np.median(read[..., -_FEWEST:], axis=-1).tolist(),
            float(sigma_of(np.diff(read)) / np.sqrt(2.0)))


def _noise_of(model):
    left = model.provenance.get('fitted_rms_arcsec')
    try:
        noise = float(left['x']) * ARCSEC, float(left['y']) * ARCSEC
    except (TypeError, KeyError, ValueError):
        return NOISE, NOISE
    return noise if min(noise) > 0.0 and np.isfinite(noise).all() else (NOISE, NOISE)


def _ratios_of(model):
    """What sigmas that are given are multiplied by, of x and y: as the fit of the model found."""
    ratios = model.provenance.get('sigma_ratios')
    try:
        ratios = tuple(map(float, ratios))
    except (TypeError, ValueError):
        return 1.0, 1.0
    good = len(ratios) == 2 and np.isfinite(ratios).all() and min(ratios) > 0.0
    return ratios if good else (1.0, 1.0)
