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

"""Design columns for tracks of satellites and stars: terms, clock, errors of each orbit."""

from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.pointing_terms import stacked_design

#: name of the coefficient of the station's clock: delay of its stamps, s
CLOCK = 'clock'
#: smallest sigma of an orbit, m, whatever a file says
_LEAST = 0.01
#: orbit drifting along its track: distance of the knots, and correlation time, s
_KNOTS, _DRIFT_MEMORY = 900.0, 7200.0
#: error common to all rows -> its 1 sigma (m, rad, share of the refraction of ordinary air, s)
COMMON_SIZES = {'height': 3000.0, 'height and air': 3000.0, 'latitude': 0.1 * DEG,
                'longitude': 0.1 * DEG, 'refraction': 0.3, 'clock': 10.0}


@dataclass
class TrackColumns:
    """Coefficients in the order of their columns.

    Attributes
    ----------
    names : tuple of str, length k
        Terms, ``IA[1]`` (zero of power-on 1 relative to the newest), `CLOCK`, ``ahead L52`` (time
        error of a satellite along its orbit, s), and for each arc ``along``, ``across``, ``out``
        with its number (m); ``common height`` and others of `COMMON_SIZES`.
    columns : ndarray, shape (k, 2n)
        On the sky, rad per unit.
    variance : ndarray, shape (k,)
        Prior variance; infinite: no prior.
    terms : int
        Number of terms among them.
    drifts : dict of str to (slice, ndarray)
        For satellites: coefficients of an orbit drifting along the track (s at each knot), and
        their covariance for an RMS error of one radian.
    """

    names: tuple
    columns: np.ndarray
    variance: np.ndarray
    terms: int
    drifts: dict = field(default_factory=dict)

    def precision(self, size=20.0 * ARCSEC):
        """Prior precision, shape (k, k), with orbits that drift by `size` RMS, rad."""
        out = np.diag(np.where(np.isinf(self.variance), 0.0, 1.0 / self.variance))
        for part, covariance in self.drifts.values():
            out[part, part] = np.linalg.inv(covariance) / size**2
        return out

    def orbits(self, values):
        """Offsets of the rows due to clock and orbits for some coefficients, shape (2, n)."""
        values = values.copy()
        values[:self.terms] = 0.0
        return (values @ self.columns).reshape(2, -1)

    def place(self, name):
        """Index of a coefficient."""
        return self.names.index(name)


def track_columns(tracks, terms, clock_sigma=np.inf, bias_free=(), wrong=()):
    """Design columns of tracks.

    Parameters
    ----------
    tracks : SatelliteTracks
    terms : sequence of str
    clock_sigma : float
        Prior sigma of the station's clock, s; infinite: unknown, 0: exact.
    bias_free : collection of str
        Satellites with unknown time along the orbit, whatever the sigma of the orbit.
    wrong : collection of str
        Satellites whose orbit may drift along the track by more than its sigma, and possible
        errors common to all rows, of `COMMON_SIZES`.

    Returns
    -------
    TrackColumns
    """
    run, n = tracks.run, len(tracks)
    names = list(terms)
    columns = list(stacked_design(terms, run['az'], run['el'], run.mount))
    variance = [np.inf] * len(names)

    def add(name, move, rows, sigma):
        column = np.zeros((2, n))
        column[:, rows] = move[:, rows]
        names.append(name)
        columns.append(column.ravel())
        variance.append(float(sigma) ** 2)

    zeros = [name for name in run.mount.names.index if name in terms]
    moves = stacked_design(zeros, run['az'], run['el'], run.mount).reshape(len(zeros), 2, n)
    for number in power_ons(run)[:-1]:
        for name, move in zip(zeros, moves):
            add(f'{name}[{number:g}]', move, np.flatnonzero(run['run'] == number), np.inf)
    # with a stamp late by c the encoders were read c before: they lag behind the orbit
    if clock_sigma > 0.0 and tracks.satellites:
        add(CLOCK, -tracks.clock, np.arange(n), clock_sigma)
    for i, name in enumerate(tracks.objects):
        rows = np.flatnonzero(tracks.object == i)
        if name not in tracks.satellites or not len(rows):
            continue
        sigma = max(float(np.sqrt(np.mean(tracks.orbit_sigma[rows] ** 2))), _LEAST)
        speed = float(np.mean(tracks.speed[rows]))
        arcs = np.unique(tracks.arc[rows])
        add(f'ahead {name}', tracks.ahead, rows,
            np.inf if name in bias_free else sigma / speed)
        for arc in arcs:
            mine = rows[tracks.arc[rows] == arc]
            if len(arcs) > 1:
                add(f'along {arc}', tracks.ahead / speed, mine, sigma)
            add(f'across {arc}', tracks.across, mine, sigma)
            add(f'out {arc}', tracks.out, mine, sigma)
    parts = {}
    for name in wrong:
        if name in COMMON_SIZES:
            move = -tracks.clock if name == CLOCK else tracks.common[name]
            add(f'common {name}', move, np.arange(n), COMMON_SIZES[name])
            continue
        knots, covariance = _knots(tracks, tracks.objects.index(name))
        parts[name] = slice(len(names), len(names) + len(knots)), covariance
        names += [f'drift {name} {i}' for i in range(len(knots))]
        columns += list(knots)
        variance += [1.0] * len(knots)
    return TrackColumns(tuple(names), np.array(columns), np.array(variance), len(terms), parts)


def power_ons(run):
    """Numbers of the power-ons of a run, newest last; empty if it has none."""
    if 'run' not in run:
        return []
    numbers = np.unique(run['run'])
    last = [float(np.max(run['time'][run['run'] == number])) for number in numbers]
    return numbers[np.argsort(last, kind='stable')].tolist()


def _knots(tracks, number):
    """Columns of a satellite's error along its track, linear between knots, and their covariance.

    Half of the variance is constant in time, the other half has the correlation time
    `_DRIFT_MEMORY`.
    """
    time, columns, moments = np.asarray(tracks.run['time'], float), [], []
    mine = tracks.object == number
    for arc in np.unique(tracks.arc[mine]):
        rows = np.flatnonzero(mine & (tracks.arc == arc))
        begin, end = time[rows].min(), time[rows].max()
        knots = np.linspace(begin, end, int(np.ceil((end - begin) / _KNOTS)) + 1)
        hats = np.zeros((len(knots), 1, len(time)))
        hats[:, 0, rows] = [np.interp(time[rows], knots, one) for one in np.eye(len(knots))]
        columns += list((hats * tracks.ahead).reshape(len(knots), -1))
        moments += knots.tolist()
    rate = np.sqrt(np.mean(np.sum(tracks.ahead[:, mine] ** 2, axis=0)))
    lag = np.abs(np.subtract.outer(moments, moments)) / _DRIFT_MEMORY
    return columns, (0.5 + 0.5 * np.exp(-lag)) / rate**2
