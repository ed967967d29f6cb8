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

"""Adaptive pointing model: a filter updated by stars and other sensors, one at a time.

    tracker = Tracker(model, stamp)                  # of a file or a fit, with its covariance
    update = tracker.star(stamp, az, el, x, y, sigma)
    tracker.model(), tracker.expected(az, el, seconds_ahead=600.0), update.events

`x, y` is encoder - catalogue on the sky with the star centred, see `PointingRun.offsets` (zero
subtracted). If you pointed through a model and measured a miss distance, it is
``model.offsets(az, el) + miss``. The state of a tracker depends on its measurements and their order
only, bit for bit: a copy or a pickled tracker continues from the same state.
"""

from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import design
from pointing_model.zero_held_terms import BROAD

from ...estimation.gaussian_sum import GaussianSum
from ..finding import Finding
from .innovations import ExpectedError, FilterConsistency, TrackerUpdate
from .motion_causes import (
    ABSOLUTE,
    INCREMENTAL,
    SENSORS,
    TrackingSettings,
    jumps_of,
    night_to_night,
    power_on_change,
    rate_hypotheses,
    states_of,
)

#: probability from which an event is reported
SURE = 0.65
#: deviation of a term from which the model is linearised anew (columns are first order), and
#: largest number of iterations
_FAR, _ROUNDS = 30.0 * ARCSEC, 3
#: smallest sigma of a term if the covariance is singular, rad
_FLOOR = 0.5 * ARCSEC
HOUR = 3.6e12  # ns
WRONG = 'wrong star'


class Tracker:
    """The current terms, starting from a model of the evening.

    Parameters
    ----------
    model : PointingModel
        With the covariance of its terms. Missing zeros are added with sigma
        `zero_held_terms.BROAD`. Harmonics and effects stay fixed.
    stamp : int
        Time at which the model was valid, ns.
    sensors : sequence of str
        ``difference``: absolute - incremental encoder of each axis; ``inclinometer``.
    settings : TrackingSettings, optional
    rate_weights : ndarray, shape (r,), optional
        Prior probabilities of `facts`, see `history.rates_of_nights`.

    Attributes
    ----------
    notes : list of Finding
        How the covariance of the model was widened.
    facts : list of dict
        The hypotheses on the drift rates.
    states : tuple of str
        Names of the states of `filter`: the terms, then the readings of sensors.
    filter : GaussianSum
        Filter of the states, as deviations from the terms of `plain`.
    plain : PointingModel
        Model at which the filter is linearised.
    stamp : int
        Time of the last measurement taken, ns.
    consistency : FilterConsistency

    Raises
    ------
    ValueError
        An invalid covariance, or an unknown sensor.
    """

    def __init__(self, model, stamp, *, sensors=(), settings=None, rate_weights=None):
        settings = settings or TrackingSettings()
        unknown = [name for name in sensors if name not in SENSORS]
        if unknown:
            raise ValueError(f'unknown sensor {unknown[0]!r}; choose from {", ".join(SENSORS)}')
        terms, covariance, self.notes = _complete(model)
        unknown = [name for name in (*settings.walks, *settings.memory_h) if name not in terms]
        if unknown:
            raise ValueError(f'tracking: no term {unknown[0]} in the model; choose from '
                             f'{", ".join(terms)}')
        self._names, self.mount = tuple(terms), model.mount
        self.plain = replace(model, terms=terms, covariance=covariance, undetermined=(),
                             directions=(), sides=None)
        self.sensors, self.settings = tuple(sensors), settings
        self.states = states_of(self._names, sensors)
        n, k = len(self.states), len(terms)
        self._rates, self.facts = rate_hypotheses(self._names, self.mount, sensors, settings)
        whole = np.zeros((n, n))
        whole[:k, :k] = covariance
        self.filter = GaussianSum(
            np.zeros(n), whole, self._rates, rate_weights,
            jumps=jumps_of(self._names, self.mount, sensors, settings), outliers=settings.wrong,
            outlier_sigma=settings.wrong_sigma, turn_h=settings.turn_h, most=settings.most,
            depth=settings.depth,
            memory_h=[settings.memory_h.get(s, np.inf) for s in self.states])
        self._fastest = np.array([fact['zero'] == max(settings.zeros) for fact in self.facts],
                                 dtype=float)
        self.stamp, self._last_star = int(stamp), None
        self.reference = {}  # state of a sensor -> its first reading
        self.consistency = FilterConsistency()
        self._pending, self._reported = [], []  # (number, innovation), (number, name)
        self._calm = True  # nothing happened at the last star tested

    # --- what is known ------------------------------------------------------------------------

    @property
    def stars(self):
        """Number of stars taken."""
        return self.filter.count

    def terms(self):
        """Current terms, rad, and their covariance, shape (k, k)."""
        mean, covariance = self.filter.estimate()
        k = len(self._names)
        values = {name: value + float(off) for (name, value), off
                  in zip(self.plain.terms.items(), mean)}
        return values, covariance[:k, :k]

    def model(self):
        """The current `PointingModel`."""
        terms, covariance = self.terms()
        return replace(self.plain, terms=terms, covariance=covariance, provenance={
            **self.plain.provenance, 'tracked': {'stars': self.stars, 'stamp': self.stamp}})

    def expected(self, az, el, seconds_ahead=0.0):
        """Expected error of the current model, including the drift until then.

        Parameters
        ----------
        az, el : float or ndarray, shape (p,)
            Positions as angles of the mount axes, rad.
        seconds_ahead : float
            Time since the last measurement.

        Returns
        -------
        ExpectedError
            Shape (p, 2, 2). Without errors of the effects, and without jumps, for which only the
            probability is given.
        """
        az, el = np.broadcast_arrays(*np.atleast_1d(az, el))
        columns, covariance = self.columns(az, el), self.ahead(seconds_ahead)
        out = columns @ covariance @ columns.swapaxes(-1, -2)
        series = self.plain.harmonics
        if series is not None:
            out = out + np.array(series.variance(az, el)).T[:, :, None] * np.eye(2)
        often = sum(jump.per_hour for jump in self.filter.jumps)
        return ExpectedError(out, float(-np.expm1(-often * seconds_ahead / 3600.0)))

    def ahead(self, seconds):
        """`GaussianSum.ahead` for a time after the last measurement."""
        return self.filter.ahead(seconds / 3600.0)

    def rates(self):
        """Current estimates of the drift rates of zeros and tilt, rad/sqrt(h), and what drifts.

        Returns
        -------
        dict
            ``zero`` and ``tilt`` (RMS over the hypotheses) and, with both encoders, ``who``: the
            probability that each part is the drifting one.
        """
        weights = self.rate_weights
        out = {name: float(np.sqrt(weights @ [fact[name] ** 2 for fact in self.facts]))
               for name in ('zero', 'tilt')}
        if self.facts[0]['who']:
            out['who'] = {who: float(sum(w for w, f in zip(weights, self.facts)
                                         if f['who'] == who))
                          for who in dict.fromkeys(fact['who'] for fact in self.facts)}
        return out

    @property
    def rate_weights(self):
        """Current probabilities of `facts`, shape (r,)."""
        return self.filter.rate_weights()

    def chances(self, number):
        """Probabilities of events before a star, by name; see `TrackerUpdate.chances`.

        Parameters
        ----------
        number : int
            Number of the star, from 0.
        """
        chance = self.filter.chance(number)
        out = {}
        for jump, value in zip(self.filter.jumps, chance):
            out[jump.name] = out.get(jump.name, 0.0) + float(value)
        out[WRONG] = float(chance[-1])
        return {'nothing': max(0.0, 1.0 - sum(out.values())), **out}

    def columns(self, az, el):
        """Effect of unit states on stars on the sky, shape (p, 2, n)."""
        out = np.zeros((len(az), 2, len(self.states)))
        out[:, 0, :len(self._names)], out[:, 1, :len(self._names)] = design(
            self._names, az, el, self.mount)
        return out

    # --- measurements -------------------------------------------------------------------------

    def update(self, measurement):
        """Take a `Measurement` of any kind."""
        return getattr(self, measurement.what)(measurement.stamp, *measurement.values)

    def star(self, stamp, az, el, x, y, sigma, name='', context=None):
        """Take a star, or Polaris.

        Parameters
        ----------
        stamp : int
            ns.
        az, el : float
            Catalogue position as angles of the mount axes, rad.
        x, y : float
            Encoder - catalogue, on the sky, with the star centred, rad.
        sigma : float or (float, float)
            1 sigma noise of each, rad.
        name : str
        context : Context or dict, optional
            Drivers of the model's effects.

        Returns
        -------
        TrackerUpdate
        """
        sigma = np.broadcast_to(np.asarray(sigma, float), (2,))
        stamp, why = self._refused(stamp, (az, el, x, y), sigma)
        value = np.zeros(2)
        if why is None and stamp == self._last_star:
            why = Finding('star twice', evidence={'star': name})
        elif why is None:
            value = np.array([x, y]) - self.plain.offsets(az, el, context)
        if not np.isfinite(value).all():
            why = Finding('star out of reach', evidence={'star': name})
        if why is not None:
            return TrackerUpdate(stamp, 'star', False, why)
        why = self._wait(stamp)
        columns = self.columns(np.atleast_1d(az), np.atleast_1d(el))[0]
        noise, number = sigma * self.consistency.noise, self.stars
        innovation, spread = self.filter.expected(columns, value, noise)
        for _ in range(_ROUNDS):  # if terms change much, linearise at the new terms and repeat
            before = self.filter.copy()
            self.filter.observe(columns, value, noise)
            far = self.filter.estimate()[0]
            if np.abs(far[:len(self._names)]).max() < _FAR:
                break
            self.filter = before
            self._move(far)
            value = np.array([x, y]) - self.plain.offsets(az, el, context)
        else:
            self.filter.observe(columns, value, noise)
        self._last_star = stamp
        self._pending.append((number, np.linalg.solve(
            np.linalg.cholesky(spread), innovation).tolist()))
        events, consistency = self._decided(number), self._tested(number)
        return TrackerUpdate(stamp, 'star', True, why, innovation, spread, self.chances(number),
                             events, consistency, (columns, value, noise))

    def difference(self, stamp, axis, value, sigma):
        """Take absolute - incremental encoder of an axis; the first value is the reference.

        Parameters
        ----------
        stamp : int
            ns.
        axis : int
            0 or 1.
        value, sigma : float
            rad.

        Returns
        -------
        TrackerUpdate
        """
        return self._sensor(stamp, 'difference', {f'difference_{axis + 1}': value}, sigma)

    def inclinometer(self, stamp, north, west, sigma):
        """Take the tilt of the base to the north and west; the first values are the reference.

        Parameters
        ----------
        stamp : int
            ns.
        north, west, sigma : float
            rad.

        Returns
        -------
        TrackerUpdate
        """
        return self._sensor(stamp, 'inclinometer', {'lean_north': north, 'lean_west': west},
                            sigma)

    def _sensor(self, stamp, what, values, sigma):
        if not set(values) <= set(self.states):
            return TrackerUpdate(int(stamp), what, False,
                                 Finding('unknown sensor', evidence={'sensor': what}))
        stamp, why = self._refused(stamp, values.values(), [sigma])
        if why is not None:
            return TrackerUpdate(stamp, what, False, why)
        why = self._wait(stamp)
        places = [self.states.index(name) for name in values]
        for place, (name, value) in zip(places, values.items()):
            if name not in self.reference:
                self.reference[name] = float(value)
                self.filter.set(place, float(sigma))
        columns = np.eye(len(self.states))[places]
        value = np.array([value - self.reference[name] for name, value in values.items()])
        noise = np.full(len(places), float(sigma))
        innovation, spread = self.filter.expected(columns, value, noise)
        number = self.stars
        self.filter.observe(columns, value, noise, is_star=False)
        return TrackerUpdate(stamp, what, True, why, innovation, spread, self.chances(number),
                             self._decided(number), row=(columns, value, noise))

    def power_on(self, stamp, axes=(0, 1), sigma=60.0 * ARCSEC):
        """The incremental encoder was switched on, or homed: its zero has changed.

        Parameters
        ----------
        stamp : int
            ns.
        axes : sequence of int
        sigma : float
            1 sigma of the change, rad.

        Returns
        -------
        TrackerUpdate
        """
        stamp, why = self._refused(stamp, (), [sigma])
        if why is not None:
            return TrackerUpdate(stamp, 'power_on', False, why)
        why = self._wait(stamp)
        self.filter.widen(power_on_change(self.states, self.mount, axes, sigma))
        return TrackerUpdate(stamp, 'power_on', True, why, np.zeros(0), np.zeros((0, 0)), {})

    # --- inside -------------------------------------------------------------------------------

    def _refused(self, stamp, values, sigmas):
        """The stamp, and the reason why a measurement is refused, or None."""
        if not np.isfinite(stamp):
            return 0, Finding('no stamp')
        stamp = int(stamp)
        if stamp < self.stamp:
            return stamp, Finding('late measurement', (self.stamp - stamp) * 1e-9, unit='s')
        if not np.isfinite(list(values)).all():
            return stamp, Finding('no number')
        if not all(np.isfinite(s) and s > 0.0 for s in sigmas):
            return stamp, Finding('no sigma')
        return stamp, None

    def _wait(self, stamp):
        """Propagate to the time of a measurement; returns a Finding after a long gap."""
        hours = (stamp - self.stamp) / HOUR
        self.filter.wait(hours)
        self.stamp = stamp
        if hours < self.settings.gap_h:
            return None
        self.filter.widen(night_to_night(self.states, self.mount, self.settings))
        return Finding('long gap', hours, unit='h')

    def _decided(self, number):
        """Findings on events before the last stars that have just been decided."""
        out = []
        first = number - self.settings.depth
        self._reported = [one for one in self._reported if one[0] > first]
        for before in range(max(first + 1, 0), number + 1):
            for name, chance in self.chances(before).items():
                if name == 'nothing' or chance < SURE or (before, name) in self._reported:
                    continue
                # one star cannot distinguish a jump from a wrong star; the encoders can
                if before < number or name.startswith((INCREMENTAL, ABSOLUTE)):
                    self._reported.append((before, name))
                    out.append(Finding(WRONG if name == WRONG else 'jump', chance, unit='',
                                       causes=(name,), evidence={'star': before}))
        return tuple(out)

    def _tested(self, number):
        """Test `consistency` with the stars that are decided by now."""
        out = None
        while self._pending and self._pending[0][0] <= number - self.settings.depth + 1:
            before, off = self._pending.pop(0)
            calm, self._calm = self._calm, self.chances(before)['nothing'] > 0.5
            if calm and self._calm:  # the star after an event was predicted undecided
                out = self.consistency.add(off, self._fastest @ self.rate_weights) or out
        self.filter.rates = self._rates * self.consistency.walk**2
        return out

    def _move(self, far):
        """Move the linearisation point by `far`, shape (n,)."""
        before = self.plain.terms
        self.plain = replace(self.plain, terms={
            name: value + float(off) for (name, value), off in zip(before.items(), far)})
        moved = np.zeros(len(far))
        moved[:len(before)] = [self.plain.terms[name] - value for name, value in before.items()]
        self.filter.shift(moved)


def model_of_fit(fit):
    """The model of a batch fit, with undetermined directions added to its covariance.

    Parameters
    ----------
    fit : FitResult
        Dropped directions are missing in its covariance; they get sigma `BROAD` here.

    Returns
    -------
    PointingModel
    """
    model, names = fit.model, list(fit.model.terms)
    covariance = np.array(model.covariance)
    for dropped in fit.dropped:
        way = np.zeros(len(names))
        for name, value in dropped['direction'].items():
            if name in names:
                way[names.index(name)] = value
        covariance += BROAD**2 * np.outer(way, way)
    return PointingModel(model.terms, covariance, model.harmonics, model.provenance,
                         model.geometry, model.effects, model.mount)


def _complete(model):
    """Terms including the zeros of both axes, their covariance, and notes on its widening.

    Returns
    -------
    terms : dict of str to float
        rad.
    covariance : ndarray, shape (k, k)
        rad^2.
    notes : list of Finding

    Raises
    ------
    ValueError
        The covariance is not symmetric, or negative in a direction.
    """
    terms, covariance, notes = dict(model.terms), np.array(model.covariance), []
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    values = np.linalg.eigvalsh(0.5 * (covariance + covariance.T)) if terms else np.zeros(0)
    if terms and values.min() < -1e-9 * max(values.max(), 0.0) or not np.allclose(
            covariance, covariance.T, rtol=1e-6, atol=1e-9 * np.max(size**2, initial=0.0)):
        raise ValueError('tracking: the covariance of the model is none (not symmetric, or '
                         'negative in a direction); fit it again')
    if terms and values.min() <= 1e-9 * values.max():
        covariance = covariance + _FLOOR**2 * np.eye(len(terms))
        notes.append(Finding('singular covariance', _FLOOR / ARCSEC))
    missing = [name for name in model.mount.names.index if name not in terms]
    if missing:
        k = len(terms)
        whole = np.diag(np.full(k + len(missing), BROAD**2))
        whole[:k, :k] = covariance
        covariance = whole
        terms |= dict.fromkeys(missing, 0.0)
        notes.append(Finding('missing zeros', BROAD / ARCSEC, causes=tuple(missing)))
    return terms, covariance, notes
