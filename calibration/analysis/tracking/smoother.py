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

"""The terms of a night against time, smoothed with all measurements before and after.

A Kalman smoother with the jumps and wrong stars that are most likely given the whole night,
averaged over the hypotheses on the drift rates.
"""

from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC

from ...estimation.dynamics import Jump, Together
from ...estimation.gaussian_sum import OUTLIER, mixture
from ...estimation.kalman import Rows, forward, smoothed
from .motion_causes import night_to_night, power_on_change
from .tracker import HOUR, WRONG

#: prior sigma of a sensor before its first reading, rad
_ANYTHING = 3600.0 * ARCSEC
#: smallest probability of a rate hypothesis that is used: others cost time and change nothing
_LEAST = 1e-4
_POWER_ON = ((0, 1), 60.0 * ARCSEC)


@dataclass(frozen=True)
class SmoothedNight:
    """Terms of a night, star by star.

    Attributes
    ----------
    stamps : ndarray of int, shape (t,)
        Times of the stars taken, ns.
    names : tuple of str, length k
    terms, sigma : ndarray, shape (t, k)
        rad.
    events : list of dict
        ``stamp``, ``star`` (its number) and ``what`` happened before it, or to it.
    """

    stamps: np.ndarray
    names: tuple
    terms: np.ndarray
    sigma: np.ndarray
    events: list

    def document(self):
        """JSON-ready; angles in arcsec."""
        return {'stamps': self.stamps.tolist(), 'events': self.events,
                'terms': {name: {'value_arcsec': (value / ARCSEC).tolist(),
                                 'sigma_arcsec': (sigma / ARCSEC).tolist()}
                          for name, value, sigma in zip(self.names, self.terms.T, self.sigma.T)}}


def smooth(tracker, night):
    """Smooth the terms of a night.

    Parameters
    ----------
    tracker : Tracker
        In the state at the beginning of the night; it is not changed.
    night : sequence of Measurement
        In order. Measurements that the tracker refuses are skipped.

    Returns
    -------
    SmoothedNight
    """
    live = deepcopy(tracker)
    rows, jumps, decided, k = [], [], {}, len(live.plain.terms)
    for measurement in night:
        number, since = live.stars, live.stamp
        update = live.update(measurement)
        if not update.taken:
            continue
        hours = (measurement.stamp - tracker.stamp) / HOUR
        if (measurement.stamp - since) / HOUR >= live.settings.gap_h:
            jumps.append(Jump(hours, night_to_night(live.states, live.mount, live.settings)))
        if measurement.what == 'power_on':
            values = measurement.values
            jumps.append(Jump(hours, power_on_change(
                live.states, live.mount, *values, *_POWER_ON[len(values):])))
        else:
            columns, value, noise = update.row
            moved = np.zeros(len(live.states))
            moved[:k] = _values(live.plain) - _values(tracker.plain)
            rows.append(_Row(number, update.what == 'star', update.stamp, hours, columns,
                             value + columns @ moved, np.square(noise)))
        first = max(number - live.settings.depth + 1, 0)
        decided |= {k: (live.chances(k), live.filter.chance(k)) for k in range(first, number + 1)}
    events = _events(live, rows, jumps, decided)
    means, covariances = _path(tracker, live, rows, jumps)
    stars = [i for i, row in enumerate(rows) if row.is_star]
    return SmoothedNight(
        np.array([rows[i].stamp for i in stars], dtype=np.int64), tuple(live.plain.terms),
        _values(tracker.plain) + means[stars][:, :k],
        np.sqrt(np.diagonal(covariances[stars], axis1=1, axis2=2)[:, :k]), events)


@dataclass
class _Row:
    """A measurement, linear in the deviations from the terms of the evening.

    Linearised at the terms of the live tracker.
    """

    number: int  # of this star, or of the next star
    is_star: bool
    stamp: int
    hours: float  # since the night began
    columns: np.ndarray
    value: np.ndarray
    variance: np.ndarray


def _values(model):
    return np.array(list(model.terms.values()))


def _events(live, rows, jumps, decided):
    """Events of the night; adds them to `jumps`, and removes the values of wrong stars."""
    events = []
    for number in sorted(decided):
        chances, chance = decided[number]
        what = max(chances, key=chances.get)
        here = [row for row in rows if row.number == number]
        if what == 'nothing' or chances[what] < 0.5 or not here:
            continue
        if what == WRONG:
            star = next((row for row in here if row.is_star), None)
            if star is None:
                continue
            star.columns, star.value, star.variance = star.columns[:0], star.value[:0], []
        else:  # before the first measurement that could show it
            jumps += [Jump(here[0].hours, share / chances[what] * jump.covariance)
                      for jump, share in zip(live.filter.jumps, chance[:OUTLIER])
                      if jump.name == what]
        events.append({'star': number, 'stamp': here[-1].stamp, 'what': what,
                       'chance': chances[what]})
    return events


def _path(tracker, live, rows, jumps):
    """Smoothed means, shape (t, n), and covariances, (t, n, n), of the states at each row."""
    n, weights = len(live.states), live.rate_weights
    if not rows:
        return np.zeros((0, n)), np.zeros((0, n, n))
    kept = np.flatnonzero(weights > _LEAST)
    home = tracker.filter.home
    mean, first = tracker.filter.estimate()
    sensors = np.arange(n) >= len(live.plain.terms)
    dynamics = Together([live.filter.dynamics(live.filter.rates[kept]), *jumps])
    passed = forward(Rows(
        [row.hours for row in rows], [row.columns for row in rows],
        [row.value - row.columns @ home for row in rows],
        [np.diag(row.variance) for row in rows],
        [np.zeros((len(row.value), 0)) for row in rows]),
        dynamics, (mean - home, first + np.diag(sensors * _ANYTHING**2)),
        begin=np.nextafter(0.0, -1.0))  # so that jumps at time 0 are included
    means, covariances = map(np.array, zip(*smoothed(passed)))
    mean, covariance = mixture(weights[kept] / weights[kept].sum(),
                               np.moveaxis(means[..., 0], 1, 0), np.moveaxis(covariances, 1, 0))
    return home + mean, covariance
