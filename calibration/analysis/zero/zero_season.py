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

"""The power-ons of a season: zeros, and what was measured then."""

from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.zero import is_marked

from .power_on_zeros import zero_from_exposures
from .zero_causes import AXES, COVARIATES, Season, zero_causes

_SIDES = {'below': 1.0, 'above': -1.0}


class SeasonLog:
    """Zeros by Polaris (or stars) of power-on after power-on, all since the first.

    One model, that of the first night, takes out how Polaris moved: it is the same for all, so its
    errors drop out of all that is compared. Of stars, which are others each time, they count.
    """

    def __init__(self):
        self._model = None
        self._zeros = {}  # number -> MeasuredZero
        self._covariates = {}  # number -> covariate -> (azimuth, elevation)
        self._start = {}  # number -> UTC s
        self._marks = {axis: {} for axis in AXES}  # axis -> start of a power-on -> Homing

    def clear_zeros(self, numbers):
        """Those of some power-ons will be measured again; what is known of their marks stays."""
        for number in numbers:
            self._zeros.pop(number, None)
        if not self._zeros:
            self._model = None

    def update_marks(self, homings):
        """Reports of the incremental encoders on their marks, in any order.

        Parameters
        ----------
        homings : iterable of cross_check.Homing
            Those without the time at which their power-on began do not count.
        """
        for homing in homings:
            if homing.homed and np.isfinite(homing.started) and homing.axis in self._marks:
                self._marks[homing.axis][homing.started] = homing

    def add_power_on(self, number, rows):
        """What is known of a power-on, before Polaris or after.

        Parameters
        ----------
        number : int
        rows : PointingRun
            Of this power-on, at least one.
        """
        began, first = rows.get('encoder_start')[0], rows.get('time')[0]
        self._start[number] = float(began if np.isfinite(began) else first)
        before = self._start.get(number - 1)
        hours = (self._start[number] - before) / 3600.0 if np.isfinite(began) and before else np.nan
        marks = {}  # the newest power-on of each axis that had begun by then
        for axis, known in self._marks.items():
            begun = [start for start in known if start <= first]
            if begun:
                marks[axis] = known[max(begun)]
        self._covariates[number] = power_on_covariates(marks, rows) | {'hours': (hours, hours)}

    def add_zero(self, number, exposures, model):
        """By the exposures of a power-on that has begun.

        Parameters
        ----------
        number : int
        exposures : PointingRun
        model : PointingModel
            Of this night; that of the first one takes out how Polaris moved.
        """
        if self._model is None:
            self._model = model
        held = self._model
        if not is_marked(exposures).any():
            # common to all zeros: it adds nothing to the error of their differences
            held = replace(held, covariance=np.zeros_like(held.covariance))
        self._zeros[number] = zero_from_exposures(exposures, held, run=number)

    def season(self):
        """The power-ons with a zero, a Season."""
        numbers = sorted(self._zeros)
        return Season(
            np.array(numbers, dtype=int),
            np.array([self._start[n] for n in numbers]),
            np.array([self._zeros[n].angles - self._zeros[numbers[0]].angles
                      for n in numbers]).reshape(-1, 2),
            np.array([self._zeros[n].sigma for n in numbers]).reshape(-1, 2),
            {name: np.array([self._covariates[n][name] for n in numbers]).reshape(-1, 2)
             for name in COVARIATES})

    def expected(self, number):
        """The zero to be expected of a power-on that has begun, from those before it.

        Parameters
        ----------
        number : int

        Returns
        -------
        dict or None
            ``tonight`` of `zero_causes.zero_causes`, with ``change_arcsec`` since the last
            power-on with a zero; None with fewer than two before.
        """
        season = self.season()
        season = season.select(season.run < number)
        if len(season) < 2:
            return None
        found = zero_causes(season, self._covariates[number], leave_out=False)['tonight']
        for axis, name in enumerate(AXES):
            if found is not None:
                found[name]['change_arcsec'] = (
                    found[name]['zero_arcsec'] - season.zeros[-1, axis] / ARCSEC)
        return found


def power_on_covariates(marks, rows):
    """What may move the zero of a power-on, but the time.

    Parameters
    ----------
    marks : dict of str to cross_check.Homing
        Newest report of the incremental encoder on its mark, by axis.
    rows : PointingRun
        Of this power-on: where an encoder has no thermometer, that of the air counts.

    Returns
    -------
    dict of str to tuple of 2 float
        ``temperature``, ``supply`` and ``side`` of azimuth and elevation; NaN where unknown.
    """
    air = rows.get('temperature')
    air = float(air[np.isfinite(air)][0]) if np.isfinite(air).any() else np.nan

    def both(read):
        return tuple(float(read(marks[axis])) if axis in marks else np.nan for axis in AXES)
    warmth = both(lambda mark: mark.temperature)
    return {'temperature': warmth if np.isfinite(warmth).all() else (air, air),
            'supply': both(lambda mark: mark.supply),
            'side': both(lambda mark: _SIDES.get(mark.side, np.nan))}


def season_rows(season):
    """A row for each power-on, JSON-ready, as `season_from_rows` reads it.

    Parameters
    ----------
    season : Season

    Returns
    -------
    list of dict
        ``run``, ``time`` (UTC s), and of each axis, lists of two, ``zero_arcsec``,
        ``sigma_arcsec`` and the covariates in the units of `zero_causes.COVARIATES`; None:
        unknown.
    """
    def pair(values):
        return [float(v) if np.isfinite(v) else None for v in values]
    return [{'run': int(season.run[i]), 'time': float(season.time[i]),
             'zero_arcsec': pair(season.zeros[i] / ARCSEC),
             'sigma_arcsec': pair(season.sigmas[i] / ARCSEC),
             **{name: pair(values[i]) for name, values in season.covariates.items()}}
            for i in range(len(season))]


def season_from_rows(rows):
    """The way back from `season_rows`."""
    def column(name):
        values = [[np.nan if v is None else v for v in row[name]] for row in rows]
        return np.array(values, dtype=float).reshape(-1, 2)
    return Season(np.array([row['run'] for row in rows], dtype=int),
                  np.array([row['time'] for row in rows], dtype=float),
                  column('zero_arcsec') * ARCSEC, column('sigma_arcsec') * ARCSEC,
                  {name: column(name) for name in COVARIATES})
