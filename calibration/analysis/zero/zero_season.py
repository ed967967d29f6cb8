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

"""The power-ons of a season: their zeros and covariates."""

from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.zero import is_marked

from .power_on_zeros import zero_from_exposures
from .zero_causes import AXES, COVARIATES, Season, zero_causes

SIDES = {'below': 1.0, 'above': -1.0}


class SeasonLog:
    """Zeros of successive power-ons from Polaris (or stars), relative to the first.

    The model of the first night corrects for the motion of Polaris in all of them, so its errors
    cancel in the comparison. With stars, which differ each time, they do not cancel.
    """

    def __init__(self):
        self._model = None
        self._zeros = {}  # number -> MeasuredZero
        self._covariates = {}  # number -> covariate -> (azimuth, elevation)
        self._start = {}  # number -> UTC s
        self._marks = {axis: {} for axis in AXES}  # axis -> start of a power-on -> Homing

    def clear_zeros(self, numbers):
        """Remove zeros that will be measured again; their covariates are kept."""
        for number in numbers:
            self._zeros.pop(number, None)
        if not self._zeros:
            self._model = None

    def update_marks(self, homings):
        """Add reports of the incremental encoders on their marks, in any order.

        Parameters
        ----------
        homings : iterable of cross_check.Homing
            Reports without the start time of their power-on are ignored.
        """
        for homing in homings:
            if homing.homed and np.isfinite(homing.started) and homing.axis in self._marks:
                self._marks[homing.axis][homing.started] = homing

    def add_power_on(self, number, rows):
        """Add the covariates of a power-on, before or after Polaris is measured.

        Parameters
        ----------
        number : int
        rows : PointingRun
            Rows of this power-on, at least one.
        """
        began, first = rows.get('encoder_start')[0], rows.get('time')[0]
        self._start[number] = float(began if np.isfinite(began) else first)
        before = self._start.get(number - 1)
        hours = (self._start[number] - before) / 3600.0 if np.isfinite(began) and before else np.nan
        marks = {}  # the newest report of each axis before the first row
        for axis, known in self._marks.items():
            begun = [start for start in known if start <= first]
            if begun:
                marks[axis] = known[max(begun)]
        self._covariates[number] = power_on_covariates(marks, rows) | {'hours': (hours, hours)}

    def add_zero(self, number, exposures, model):
        """Add the zero of a power-on from its exposures.

        Parameters
        ----------
        number : int
        exposures : PointingRun
        model : PointingModel
            Model of this night; only that of the first night is used.
        """
        if self._model is None:
            self._model = model
        held = self._model
        if not is_marked(exposures).any():
            # the model error is common to all zeros, and cancels in their differences
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
        """Predict the zero of a power-on from those before it.

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
    """Covariates of the zero of a power-on, except the time.

    Parameters
    ----------
    marks : dict of str to cross_check.Homing
        Newest report of the incremental encoder on its mark, by axis.
    rows : PointingRun
        Rows of this power-on; they give the air temperature, used for encoders without a
        thermometer.

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
            'side': both(lambda mark: SIDES.get(mark.side, np.nan))}


def season_rows(season):
    """A row for each power-on, JSON-ready; inverse of `season_from_rows`.

    Parameters
    ----------
    season : Season

    Returns
    -------
    list of dict
        ``run``, ``time`` (UTC s), and, as lists with one value per axis, ``zero_arcsec``,
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
    """Season from rows; inverse of `season_rows`."""
    def column(name):
        values = [[np.nan if v is None else v for v in row[name]] for row in rows]
        return np.array(values, dtype=float).reshape(-1, 2)
    return Season(np.array([row['run'] for row in rows], dtype=int),
                  np.array([row['time'] for row in rows], dtype=float),
                  column('zero_arcsec') * ARCSEC, column('sigma_arcsec') * ARCSEC,
                  {name: column(name) for name in COVARIATES})
